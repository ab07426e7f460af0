"""Branches through folds and changes of sequence: both sides of a fold, and searches at single values."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import eppanalysis as epp
from eppanalysis.errors import EppError
from eppanalysis.shown import for_people
from tests.coordinates import InOtherWords, rotated
from tests.noise import noise, with_shaken_matrices
from tests.shared import cycles_of, mostly_slow

POUND = 4.4482216152605


@pytest.fixture(scope="module")
def original():
    return epp.case("fig8a_original"), cycles_of("fig8a_original")


@pytest.mark.parametrize(
    ("parameter", "start", "stop", "unit", "expected"),
    [
        ("lock_pin.backlash", "2.5 deg", "0.6 deg", math.pi / 180, 0.978586853),
        pytest.param("bands.range", "2.5 lbf", "6 lbf", POUND, 5.005421649, marks=pytest.mark.slow),
    ],
)
def test_folds_are_the_same_from_both_sides(original, parameter, start, stop, unit, expected):
    case, found = original
    folds = []
    for cycle in found:
        branch = epp.continue_branch(case, parameter, start, stop, cycle=cycle, n_others=0)
        assert len(branch.folds) == 1
        folds.append(branch.folds[0])
    assert folds[0].value == pytest.approx(folds[1].value, rel=1e-9)
    assert folds[0].value / unit == pytest.approx(expected, rel=1e-8)
    for fold in folds:
        assert abs(fold.cycle.multipliers[0] - 1.0) < 1e-6
        assert fold.cycle.residual < 1e-9


@pytest.mark.slow
def test_nothing_oscillates_below_the_fold_and_two_cycles_exist_above():
    case = epp.case("fig8a_original")
    for degrees, expected in ((0.97, 0), (0.99, 2)):
        changed = case.with_values({"lock_pin.backlash": f"{degrees} deg"})
        assert len(epp.find_limit_cycles(changed)) == expected


def test_a_fold_just_within_the_end_of_the_range_is_found():
    """The first step leads past it and out of the range again."""
    case, threshold = epp.case("relay_deadzone"), "relay_dead_zone.threshold"
    (fold,) = epp.continue_branch(case, threshold, 1.6, 1.8, n_others=0).folds
    start = fold.value * (1.0 - 1e-6)
    branch = epp.continue_branch(case, threshold, start, 2.5, cycle=fold.cycle, n_others=0)
    assert [f.value for f in branch.folds] == pytest.approx([fold.value], rel=1e-9)
    assert branch.points["value"][[0, -1]] == pytest.approx([start, start], rel=1e-12)


def test_branch_passes_through_what_simulation_finds():
    case = epp.case("fig8a_original")
    branch = epp.continue_branch(case, "lock_pin.backlash", "2.5 deg", "1.2 deg", n_simulated=4, n_others=0)
    value, stable = branch.points["value"], branch.points["stable"]
    order = np.argsort(value[stable])
    for v, span in zip(branch.simulated["value"], branch.simulated["theta"], strict=True):
        on_branch = np.interp(v, value[stable][order], branch.points["theta"][stable][order])
        assert on_branch == pytest.approx(span, rel=2e-3)
    assert branch.points["residual"].max() < 1e-9
    assert {s.kind for s in branch.special} <= {"fold", "change of sequence"}
    assert branch.to_dict()["points"]["value"] == value.tolist()


def test_every_orbit_of_a_branch_is_a_cycle_of_its_own_case():
    case = epp.case("relay_deadzone")
    branch = epp.continue_branch(case, "relay_dead_zone.threshold", 1.0, 0.4, n_points=30, n_others=0)
    for i in (5, len(branch) - 1):
        changed = case.with_values({"relay_dead_zone.threshold": float(branch.points["value"][i])})
        periods = [c.period for c in epp.find_limit_cycles(changed.to_system())]
        assert min(abs(p / branch.points["period"][i] - 1.0) for p in periods) < 1e-9


@pytest.mark.parametrize("there", [pytest.param("2.4 lbf", marks=pytest.mark.slow), "3 lbf"])
def test_curve_of_folds(there):
    # Upwards a contact grazes beside the fold, and the curve goes on by a branch.
    case = epp.case("fig8a_original")
    curve = epp.continue_folds(
        case, "lock_pin.backlash", "bands.range", ("2.5 deg", "0.6 deg"), ("2.5 lbf", there), n_points=2
    )
    assert curve.values[0, 0] == pytest.approx(math.radians(0.978586853), rel=1e-8)
    assert np.all(np.abs(curve.multiplier - 1.0) < 1e-6)
    assert there in str(curve) and "2.5 lbf" in str(curve)
    assert "bands range [lbf]" in for_people(curve.to_frame()) and curve.plot().get_xlabel() == "bands range [lbf]"
    other = case.with_values({"bands.range": there})
    single = epp.continue_branch(other, "lock_pin.backlash", "2.5 deg", "0.6 deg", n_others=0)
    assert curve.values[1, 0] == pytest.approx(single.folds[0].value, rel=1e-9)


def test_an_orbit_that_sticks_is_followed_though_its_speed_is_rounding_of_zero():
    """A speed of -1e-33 at breakaway sent the engine backward first: the branch ended at 0.52 kg, or at 0.97 kg."""
    case = epp.case("pid_hunting")
    branch = epp.continue_branch(case, "mass.mass", 0.5, 0.8, n_others=0)
    assert branch.points["value"][[0, -1]] == pytest.approx([0.5, 0.8], rel=1e-12) and not branch.special
    i = len(branch) // 2
    run = epp.simulate(case.with_values({"mass.mass": float(branch.points["value"][i])}))
    assert run.limit_cycle.period == pytest.approx(branch.points["period"][i], rel=1e-9)


def test_a_branch_on_which_the_period_grows_without_bound_ends_there_once():
    """A servo with play, whose cycle is born with an infinite period at k = 2.077624."""
    loop = epp.LureSystem.from_tf(([2.1], [0.2, 1.2, 1.0, 0.0]), epp.Play(gap=1.0))
    cycle = epp.simulate(replace(loop, x0=np.array([0.156, 0.0, -13.2])), t_end=400.0).limit_cycle
    branch = epp.continue_branch(loop, "loop.gain", 1.0, 0.95, cycle=cycle, n_points=60, max_step=0.08)
    (end,) = branch.special
    assert end.kind == "infinite period" and 2.1 * end.value == pytest.approx(2.077624, rel=5e-7)
    assert branch.points["period"][-1] > 3 * branch.points["period"][0]
    assert branch.ends[1] == "ends where the period grows without bound" and len(branch) < 40
    assert "no folds; infinite period at 0.9893" in str(branch)


@pytest.mark.parametrize("seed", mostly_slow([None, 3], [None]))
def test_a_branch_ends_at_the_limit_of_linear_stability(seed):
    """Three lags of 1 s behind a limit: at 8 the loop ceases to be stable, and oscillates at sqrt(3) rad/s.

    Just before it the motion is beyond the limit for microseconds: what that leaves of its equations is no rounding.
    """
    loop = epp.LureSystem.from_tf(([8.0], [1.0, 3.0, 3.0, 1.0]), epp.Saturation(-1.0, 1.0))
    branch = epp.continue_branch(loop if seed is None else rotated(loop, seed), "loop.gain", 1.5, 0.5)
    assert np.all(branch.points["stable"]) and 1.0 < branch.points["value"][-1] < 1.001
    (end,) = branch.special
    assert end.kind == "linear limit" and end.value == pytest.approx(1.0, rel=1e-12)
    assert end.cycle.omega == pytest.approx(math.sqrt(3.0), rel=1e-7)
    assert branch.status is epp.Status.CONVERGED and "no folds; linear limit at 1. " in str(branch)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_what_grazes_at_a_border_is_shown_just_before_it(seed):
    """Where a contact is only just made nothing tells the multipliers: they were rounding, or one of a continuum."""
    case = epp.case("gain_brings_it_back")
    here = epp.continue_branch(case, "lock_pin.backlash", "0.5 deg", "0.47 deg", n_others=0)
    with noise(seed):
        there = epp.continue_branch(
            with_shaken_matrices(case, seed), "lock_pin.backlash", "0.5 deg", "0.47 deg", n_others=0
        )
    assert len(here.special) > 0
    for one, other in zip(here.special, there.special, strict=True):
        assert one.kind is other.kind and one.value == pytest.approx(other.value, rel=1e-9)
        assert one.cycle.stability_criterion == other.cycle.stability_criterion
        assert one.cycle.multipliers == pytest.approx(other.cycle.multipliers, abs=1e-5)
        beside = here.points["multiplier"][[one.index - 1, one.index]]
        assert 0.9 * beside.min() < abs(one.cycle.multipliers[0]) < 1.1 * beside.max()


@pytest.mark.slow
def test_a_branch_ends_where_cycles_are_a_continuum_at_each_value():
    """A valve that slips by half its band or more sticks at once, at whatever place: special points were rounding."""
    case, parameter = epp.case("stiction_level_S5J2"), "jump_and_follow.slip_jump"
    start, border, stop = 2.0, 2.5, 5.0
    turned = InOtherWords(case, lambda system: rotated(system, 3))
    branches = [epp.continue_branch(one, parameter, start, stop, n_others=0) for one in (turned, case)]
    (end,), (branch, _) = branches[0].special, branches
    assert branches[1].special[0].value == pytest.approx(end.value, rel=1e-6)
    assert end.kind == "continuum at each value" and end.value == pytest.approx(border, rel=1e-6)
    (gap,) = branch.missing
    assert {gap.low, gap.high} == {end.value, stop} and "continuum at each value" in gap.why
    assert "continuum at each value" in str(branch)
    within = sorted((stop, 0.5 * (border + stop)))
    alone = epp.continue_branch(case, parameter, *within, n_others=0)
    assert len(alone) == 1 and not alone.folds and [s.kind for s in alone.special] == ["continuum at each value"]
    assert [[g.low, g.high] for g in alone.missing] == [within]


def test_cycles_on_which_an_element_holds_its_value_are_said_to_be_many():
    """A gear that stays within its gap adds what it holds: the branch is that of this value."""
    parts = {"gear": epp.Play(gap=10.0), "plant": epp.blocks.TransferFunction(num=[1.0], den=[1.0, 2.0, 1.0, 0.0])}
    connect = ["-plant -> relay", "relay + gear -> plant", "plant -> gear"]
    system = epp.Diagram(parts={"relay": epp.Relay(), **parts}, connect=connect).to_system()
    branch = epp.continue_branch(system, "relay.high", 1.0, 1.5, n_others=0)
    assert [(s.kind, s.index) for s in branch.special] == [("continuum at each value", 0)] and branch.status.ok
    assert sorted(branch.points["value"][[0, -1]]) == [1.0, 1.5]


def test_empty_ranges_and_loops_without_cycles_are_refused():
    case = epp.case("fig8a_original")
    with pytest.raises(EppError, match="two different values"):
        epp.continue_branch(case, "lock_pin.backlash", "1 deg", "1 deg")
    with pytest.raises(EppError, match="no limit cycle"):
        epp.continue_branch(case, "lock_pin.backlash", "0.25 deg", "0.3 deg")


@dataclass(frozen=True)
class Chua:
    """Chua's circuit (piecewise linear; Matsumoto 1984) as a case with one parameter: it doubles its period."""

    alpha: float
    name: str = "Chua's circuit"
    input: None = None
    t_end: float = 400.0

    def to_system(self) -> epp.LureSystem:
        a, inner, outer = self.alpha, -8 / 7, -5 / 7
        A = [[-a * (1 + outer), a, 0], [1, -1, 1], [0, -100 / 7, 0]]
        B = [[-a * (inner - outer)], [0], [0]]
        return epp.LureSystem.build(A, B, [[1.0, 0, 0]], [epp.Saturation()], x0=[1.5, 0.1, -1.5], name=self.name)

    @property
    def operating_point(self) -> epp.OperatingPoint:
        return epp.OperatingPoint()

    def with_values(self, values):
        return Chua(float(values["alpha"]))

    def si(self, name, value):
        return float(value)

    def value(self, name):
        return self.alpha

    def unit(self, name):
        return "", ""

    def readable(self, name):
        return "", 1.0


def test_period_doubling_is_located_and_labelled():
    branch = epp.continue_branch(Chua(8.0), "alpha", 8.0, 8.3)
    (doubling,) = branch.special
    assert doubling.kind == "period doubling"
    assert min(abs(doubling.cycle.multipliers + 1.0)) < 1e-9
    # Regression value; runs on both sides witness it: one turn below, two turns above.
    assert doubling.value == pytest.approx(8.17520835, rel=1e-8)
    for offset, turns in ((-0.05, 1), (0.05, 2)):
        cycle = epp.simulate(Chua(doubling.value + offset).to_system(), t_end=800.0).limit_cycle
        assert cycle is not None
        assert cycle.period == pytest.approx(turns * doubling.cycle.period, rel=1e-2)


def settled_turns(alpha: float) -> tuple[float, float]:
    """Period and peak-to-peak of x on which Chua's circuit settles, by scipy's integrator and its own section."""

    def rate(t, v):
        x, y, z = v
        return [alpha * (y - x + 5 / 7 * x + 3 / 7 * min(max(x, -1.0), 1.0)), x - y + z, -100 / 7 * y]

    def section(t, v):
        return v[1]

    section.direction = 1
    kinds = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}
    begin = solve_ivp(rate, (0.0, 500.0), [1.5, 0.1, -1.5], **kinds | {"rtol": 1e-9}).y[:, -1]
    run = solve_ivp(rate, (0.0, 20.0), begin, events=section, dense_output=True, **kinds)
    at, states = run.t_events[0], run.y_events[0]
    turns = next(k for k in range(1, 5) if np.max(np.abs(states[k] - states[0])) < 1e-6)
    wave = run.sol(np.linspace(at[0], at[turns], 20_001))[0]
    return float(at[turns] - at[0]), float(np.ptp(wave))


def test_branch_of_doubled_period_is_what_the_circuit_settles_on():
    single = epp.continue_branch(Chua(8.0), "alpha", 8.0, 8.3)
    (doubling,) = single.special
    double = epp.continue_branch(Chua(8.0), "alpha", 8.0, 8.3, origin=doubling)
    points = double.points
    assert "half the period" in double.message and "leaves the range" in double.message
    # It leaves at twice the period, and only beyond the point, where the single turn is unstable.
    assert points["period"][0] == pytest.approx(2 * doubling.cycle.period, rel=1e-5)
    # Beside the point the equations are nearly singular, which leaves the first value six digits.
    assert points["value"].min() >= doubling.value - 1e-6 and points["value"][-1] == pytest.approx(8.3)
    assert points["stable"].all() and points["residual"].max() < 1e-8
    period, span = settled_turns(8.3)
    assert points["period"][-1] == pytest.approx(period, rel=1e-8)
    assert points[double.signals[0]][-1] == pytest.approx(span, rel=1e-6)


@pytest.mark.slow
def test_doubled_branch_leads_back_to_where_it_branches_off():
    branch = epp.continue_branch(Chua(8.25), "alpha", 8.25, 8.1)
    (meets,) = branch.special
    assert branch.points["period"][0] == pytest.approx(2 * 2.29, rel=1e-2)
    assert meets.kind == "period doubling" and "half the period" in meets.note
    assert meets.value == pytest.approx(8.17520835, rel=1e-8)
    assert "joins the branch of half its period" in branch.message


def test_nothing_branches_off_at_a_fold(original):
    case, found = original
    branch = epp.continue_branch(case, "lock_pin.backlash", "2.5 deg", "0.6 deg", cycle=found[1], n_others=0)
    with pytest.raises(EppError, match="expected a period doubling"):
        epp.continue_branch(case, "lock_pin.backlash", "2.5 deg", "0.6 deg", origin=branch.folds[0])


def test_steps_lead_on_from_a_grazing_contact_however_closely_it_is_located() -> None:
    """The new visit grows like a root there: from too close beside it no step arrives, and the branch would be lost."""
    case = epp.case("fig8a_original").with_values({"bands.range": "1.5 lbf", "pulley.friction": 0.0252})
    branch = epp.continue_branch(case, "lock_pin.backlash", "0.53 deg", "0.38 deg", n_points=20, max_step=0.05)
    graze = branch.special[0]
    assert "makes contact" in graze.note and graze.value == pytest.approx(np.radians(0.52704), rel=1e-5)
    values, n = branch.points["value"], graze.index
    assert n + 3 < len(values) and values[n + 1] != values[n]


# What a branch covers of what was asked ----------------------------------------------------------------------------
@pytest.mark.slow
def test_a_branch_that_ends_on_the_way_is_joined_by_those_of_other_cycles() -> None:
    """The wheelchair's stable cycle grows beyond all bounds near a gain of 1.41; an unstable one exists up to 2."""
    case = epp.case("wheelchair").with_values({"loop.gain": 1.0})
    branch = epp.continue_branch(case, "loop.gain", 1.0, 2.0, n_points=60)
    assert branch.points["value"].max() < 1.5 and "number of points" in branch.message
    (other,) = branch.others
    assert other.points["value"].min() == 1.0 and other.points["value"].max() == 2.0 and not branch.missing
    at_two = epp.find_limit_cycles(case.with_values({"loop.gain": 2.0}).to_system())
    assert min(abs(c.period / other.points["period"][np.argmax(other.points["value"])] - 1.0) for c in at_two) < 1e-9
    legend = [text.get_text() for text in branch.plot(signal="play_input").get_legend().get_texts()]
    assert legend == ["stable", "unstable"]
    assert branch.to_dict()["others"][0]["message"] == other.message


def test_what_a_branch_does_not_cover_is_said_in_result_and_picture() -> None:
    case = epp.case("wheelchair").with_values({"loop.gain": 1.0})
    alone = epp.continue_branch(case, "loop.gain", 1.0, 2.0, n_points=20, n_others=0)
    (gap,) = alone.missing
    assert gap.low == alone.points["value"].max() and gap.high == 2.0
    assert gap.why == "the branch stops at the given number of points" and "a part of the range" in alone.message
    figure = alone.plot(signal="play_input").figure
    assert f"not covered: {gap.why}" in [
        text.get_text().replace("\n", " ") for text in figure.axes[0].get_legend().get_texts()
    ]
    assert figure.axes[0].get_xlim()[1] >= 2.0
    assert alone.to_dict()["missing"] == [{"low": gap.low, "high": 2.0, "why": gap.why}]


def test_beyond_a_fold_there_is_no_orbit(original) -> None:
    case, found = original
    branch = epp.continue_branch(case, "lock_pin.backlash", "1.2 deg", "0.6 deg", cycle=None)
    (gap,) = branch.missing
    assert gap.low == math.radians(0.6) and gap.high == branch.folds[0].value
    assert "turns back" in gap.why and not branch.others


def test_a_cycle_whose_switch_comes_ever_later_is_followed_to_the_end_and_no_further():
    """A thermostat whose upper threshold comes to where the oven cools down to: at 0.2, and never beyond."""
    loop = epp.Diagram(
        parts={
            "thermostat": epp.HysteresisRelay(lower=0.0, upper=0.19, low=0.0, high=1.0),
            "oven": epp.blocks.TransferFunction(num=[4.0], den=[60.0, 1.0]),
            "late": epp.blocks.DeadTime(delay=5.0),
        },
        connect=["setpoint - oven -> thermostat", "thermostat -> late", "late -> oven"],
        inputs={"setpoint": 0.2},
    )
    branch = epp.continue_branch(loop.to_system(), "thermostat.upper", 0.19, 0.3, n_others=0)
    assert branch.ends[1] == "ends where the period grows without bound" and branch.status.ok
    assert 0.1999 < branch.points["value"].max() < 0.2
    assert np.all(np.diff(branch.points["period"]) > 0) and branch.points["period"][-1] > 500


@pytest.mark.slow
def test_a_branch_that_turns_just_before_it_touches_a_breakpoint_goes_on_behind_it() -> None:
    """From its stable end it went back the way it had come, past a second fold, and ended where it had begun."""
    loop = epp.LureSystem.from_tf(([30.0, 9.0], [1.0, 4.0, 4.0, 0.0, 0.0]), epp.DeadZoneSaturation(0.5, 4.0, 3.0))
    small, large = epp.find_limit_cycles(loop)
    down, up = (epp.continue_branch(loop, "loop.gain", 1.0, 0.05, cycle=c).to_frame() for c in (large, small))
    for branch, first, last in ((down, large, small), (up, small, large)):
        ends = branch["period"].to_numpy()[[0, -1]]
        assert ends == pytest.approx([first.period, last.period], rel=1e-9)
        assert (branch["special"] == "fold").sum() == 1
    # The fold lies between two points.
    assert down["loop.gain"].min() == pytest.approx(up["loop.gain"].min(), rel=1e-3)


@pytest.mark.slow
def test_cycles_that_no_branch_can_follow_are_not_said_to_be_missing() -> None:
    """A magnetic bearing with dead time and a limited current oscillates about rest."""
    blocks = epp.blocks

    def bearing(kp: float) -> epp.Diagram:
        return epp.Diagram(
            parts={
                "controller": blocks.PID(kp=kp, td=5e-3, tf=3e-4),
                "limit": epp.Saturation(lower=-3.0, upper=3.0),
                "late": blocks.DeadTime(delay=2e-4),
                "coil": blocks.LowPass(bandwidth=4000.0),
                "force": blocks.Gain(gain=40.0),
                "pull": blocks.Gain(gain=2e5),
                "rotor": blocks.Mass(mass=2.0, damping=1.0),
                "probe": blocks.LowPass(bandwidth=20000.0),
            },
            connect=[
                *("-probe -> controller", "controller -> limit", "limit -> late", "late -> coil", "coil -> force"),
                *("force + pull -> rotor", "rotor.position -> pull, probe"),
            ],
        )

    case = epp.Case.from_system(bearing(26000.0).to_system(), t_end=0.5, name="bearing")
    with pytest.raises(epp.EppError, match="limit cycles were found at the ends of the range of loop.gain, but none"):
        epp.continue_branch(case, "loop.gain", 0.99, 1.01)


def test_the_sentence_of_a_branch_names_no_value_that_it_leaves_out() -> None:
    """Of branches that leave a part between them it named the values from the first to the last of all."""
    case = epp.case("relay_biased_fopdt")
    parts = [
        epp.continue_branch(case, "hysteresis_relay.high", *over) for over in ((1.3, 1.1), (0.9, 0.7), (0.95, 0.9))
    ]
    one = replace(parts[0], others=tuple(parts[1:]))
    assert str(one).startswith("Limit cycles exist for hysteresis relay high from 0.7 to 0.95 and from 1.1 to 1.3;")


@pytest.mark.parametrize(
    "name, over, ends",
    [("relay_deadzone", "relay_dead_zone.threshold", (1.6, 1.8)), ("wheelchair", "play.gap", ("9 mm", "5 mm"))],
)
def test_what_meets_at_a_fold_is_what_lies_on_both_of_its_sides(name, over, ends) -> None:
    branch = epp.continue_branch(epp.case(name), over, *ends, n_others=0)
    (fold,) = branch.folds
    beside = branch.points["stable"][max(fold.index - 1, 0) : fold.index + 1]
    assert beside.any() == fold.note.startswith("a stable and an unstable cycle meet")
    assert not beside.all() and "or" not in fold.note.split()
