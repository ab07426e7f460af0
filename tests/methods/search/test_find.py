"""All limit cycles of the loops of the verification set and of the truth table, and the disturbances that
start them.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import fsolve
from scipy.special import ellipk

import eppanalysis as epp
from eppanalysis.errors import EppError, ModelError
from eppanalysis.results import Status
from tests.freeplay import freeplay
from tests.random_loops import random_loop
from tests.sampled_relay import sampled_relay
from tests.shared import cycles_of, mostly_slow
from tests.stress.families import problem, turned

LOOPS = [
    name
    for name in epp.shipped_cases()
    if (case := epp.case(name)).kind == "loop" and case.expected.exact and not case.to_system().time_step
]


#: A memory, a smooth one, a bias, two cycles, two elements, two masses.
FIRST = (
    "backlash_servo_unseen",
    "belt_leine",
    "relay_biased_fopdt",
    "relay_deadzone",
    "sat_am165",
    "two_mass_damped_shaft",
)


@pytest.mark.parametrize("name", mostly_slow(LOOPS, FIRST))
def test_every_cycle_of_the_verification_set_is_found_to_eight_digits(name):
    case, found = epp.case(name), cycles_of(name)
    for expected in case.expected.exact:
        near = min(found, key=lambda c: abs(c.period - expected.period))
        assert near.period == pytest.approx(expected.period, rel=1e-8)
        assert near.peak_to_peak[case.expected.signal] / 2 == pytest.approx(expected.amplitude, rel=1e-8)
        assert near.stable == expected.stable
        if expected.largest_multiplier is not None:
            assert abs(near.multipliers[0]) == pytest.approx(expected.largest_multiplier, rel=1e-5)


@pytest.mark.parametrize("seed", mostly_slow(range(2), [0]))
def test_a_loop_in_turned_states_has_the_cycles_that_it_has_in_its_own(seed):
    """Three of four were missing: in the states of its stiffest motions nothing was predicted."""
    section = freeplay(20.0)
    one, other = (epp.find_limit_cycles(loop) for loop in (section, turned(section, np.random.default_rng(seed))))
    assert len(one) == 4
    np.testing.assert_allclose([c.period for c in other], [c.period for c in one], rtol=1e-9)


def test_original_elbow_has_a_stable_and_an_unstable_cycle():
    found = cycles_of("fig8a_original")
    assert [c.stable for c in found] == [False, True]
    assert found.settles
    assert found.status is Status.CONVERGED
    # Regression values; the stable one is that of a long run (test_shooting).
    assert found[0].period == pytest.approx(0.192932133055, rel=1e-9)
    assert abs(found[0].multipliers[0]) == pytest.approx(8.29921, rel=1e-5)
    assert found[1].period == pytest.approx(0.111438405954, rel=1e-9)


def test_unstable_cycle_separates_outcomes():
    case = epp.case("relay_deadzone")
    unstable = cycles_of(case.name).unstable[0]
    ends = [
        epp.simulate(replace(case.to_system(), x0=scale * unstable.state), t_end=60 * unstable.period).status
        for scale in (0.99, 1.01)
    ]
    assert ends == [Status.SETTLED, Status.LIMIT_CYCLE]


@pytest.mark.parametrize(
    "name", mostly_slow(["fig8b_reduced_backlash", "fig6b_ball_bearing", "soft_cable", "upright"], ["soft_cable"])
)
def test_nothing_is_invented_where_all_starts_settle(name):
    case = epp.case(name)
    found = epp.find_limit_cycles(case)
    assert len(found) == 0
    assert found.settles


def test_a_step_that_settles_is_no_proof():
    # The light forearm settles after the step, and yet a stable cycle exists beside the resting state.
    case = epp.case("light_forearm")
    assert epp.simulate(case.to_system(), case.input, t_end=case.t_end).status is Status.SETTLED
    assert [c.stable for c in epp.find_limit_cycles(case)] == [False, True]


def test_triggers_are_confirmed_on_both_sides():
    case = epp.case("relay_deadzone")
    found = epp.trigger(case.to_system(), states=["x2"])
    assert [np.sign(k.size) for k in found] == [1.0, -1.0]
    assert found[0].size == pytest.approx(-found[1].size, rel=1e-6)
    for size, status in ((found[0].settles, Status.SETTLED), (found[0].starts, Status.LIMIT_CYCLE)):
        system = replace(case.to_system(), x0=np.array([0.0, 0.0, size]))
        assert epp.simulate(system, t_end=400.0).status is status


def test_a_loop_without_stable_cycle_needs_no_trigger():
    assert epp.trigger(epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Saturation())) == ()


def test_bad_arguments_raise():
    system = epp.case("relay_deadzone").to_system()
    with pytest.raises(ModelError, match="no input"):
        epp.find_limit_cycles(system, {"nothing": 1.0})
    with pytest.raises(EppError, match="no state"):
        epp.trigger(system, states=["nothing"])


def test_search_is_plain_data():
    found = cycles_of("sat_am165")
    assert found.to_dict()["cycles"][0]["stable"] is True
    assert "predicted" in found.search


def test_a_search_tells_how_far_it_is():
    told = []
    found = epp.find_limit_cycles(epp.case("relay_deadzone").to_system(), progress=lambda *state: told.append(state))
    done = [runs for runs, _, _ in told]
    assert done[0] == 0 and done == sorted(done) and done[-1] < found.n_runs
    assert {total for _, total, _ in told} == {None}
    assert told[-1][2].endswith(f"{found.provenance.statistics['boundaries']} basin boundaries, 2 cycles")


@pytest.mark.parametrize(
    "case",
    [pytest.param(epp.case("backlash_discrete_pi"), marks=pytest.mark.slow), sampled_relay()],
    ids=lambda case: case.name,
)
def test_a_search_of_a_sampled_loop_tells_how_far_it_is(case: epp.Case) -> None:
    told: list[tuple[int, int | None, str]] = []
    found = epp.find_limit_cycles(case, progress=lambda *state: told.append(state))
    counted = [(done, of) for done, of, _ in told if of is not None]
    assert counted == sorted(counted) and counted[0][0] == 0 and counted[-1][0] < counted[-1][1]
    assert all(text for _, _, text in told) and found.cycles


def test_a_cycle_whose_delayed_signal_moves_is_closed() -> None:
    loop = epp.LureSystem.from_tf(([1.0], [1.0, 1.0, 0.0]), epp.Saturation(slope=4.0), delay=0.6)
    found = epp.find_limit_cycles(loop)
    (cycle,) = found
    assert cycle.method == "exact orbit" and cycle.stable and found.status is Status.CONVERGED
    assert "delayed signals are at rest" in found.search
    assert "leave out fast modes of a dead time" in found.search
    run = epp.simulate(replace(loop, x0=cycle.state), t_end=40.0 * cycle.period)
    assert cycle.period == pytest.approx(run.limit_cycle.period, rel=1e-9)


def test_a_cycle_with_dead_time_goes_round_once():
    # Ten turns of a run come closer to their begin than one; the orbit is that of one turn.
    loop = epp.LureSystem.from_tf(([2.0], [1.0, 1.0, 0.0]), epp.RelayDeadZone(0.3), delay=0.3)
    (stable,) = epp.find_limit_cycles(loop).stable
    run = epp.simulate(replace(loop, x0=stable.state), t_end=100.0 * stable.period)
    assert stable.period == pytest.approx(run.limit_cycle.period, rel=1e-9)
    assert len(stable.events) == 4


# Rest ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("slower", [1e6, 1e-6])
def test_a_loop_of_integrators_alone_has_no_time_scale_of_its_own(slower):
    # Steps of a second would not end on cycles of months.
    system = epp.case("thruster_dz_hyst").to_system()
    other = replace(system, A=system.A / slower, B=system.B / slower)
    assert not np.any(np.linalg.eigvals(system.A)) and not np.any(system.constant_state)
    # The velocity is measured in the old time, so that the switching line stays where it is.
    own, scaled = epp.find_limit_cycles(system), epp.find_limit_cycles(other)
    assert [c.period for c in scaled] == pytest.approx([slower * c.period for c in own], rel=1e-9)
    assert [c.stable for c in scaled] == [c.stable for c in own]


@pytest.mark.slow
def test_a_run_that_has_gone_is_not_made_longer():
    """Beyond an unstable cycle of three integrators under a valve with overlap states grow to 1e23, and what turned
    states leave of the valve's input is rounding: it switched without number, until no work was left.
    """
    lead, lag = np.polymul([1.0, 1.5], [1.0, 1.5]), np.polymul([0.04, 1.0], [0.02, 1.0])
    valve = epp.DeadZoneSaturation(0.2, 1.0, 1.5)
    loop = epp.LureSystem.from_tf((60.0 * lead, np.append(lag, [0.0, 0.0, 0.0])), valve)
    found = epp.find_limit_cycles(turned(loop, np.random.default_rng(0)))
    # Of the work of a search, 2e7 steps, all was taken, and basin boundaries and starts were left.
    assert found.provenance.statistics["work"] < 1e7
    assert found.diverges and found.settles
    # A machine of pieces and matrix exponentials that knows no orbits ends on the first, and is parted by the other.
    assert [(round(c.period, 6), c.stable) for c in found] == [(7.605703, True), (4.066934, False)]


@pytest.mark.slow
def test_a_switched_current_has_its_cycle_however_slowly_the_drive_nears_it():
    """Over a cycle of 0.43 ms the drive's speed keeps 99.9 % of its distance: runs ended undecided. The cycle is that
    of two pulses, each solved by a matrix exponential, at whose ends the current's error is at the thresholds.
    """
    A, b, k = np.array([[-40.0, -20.0, 0.0], [30.0, -2.0, 0.0], [1.0, 0.0, 0.0]]), np.array([400.0, 0.0, 0.0]), 0.5
    c, constant, levels = np.array([-1.0, 0.0, -5.0]), np.array([0.0, -8.0, -0.4]), (14.0, -10.0)
    loop = epp.LureSystem.build(
        A, b[:, None], c[None], [epp.HysteresisRelay(-k, k, levels[1], levels[0])],
        constant_state=constant, constant_input=[1.0],
    )  # fmt: skip

    def pulses(unknown):
        x = np.append(unknown[:3], 1.0)
        steps = [expm(np.block([[A, (b * u + constant)[:, None]], [np.zeros((1, 4))]]) * t)
                 for t, u in zip(1e-4 * unknown[3:], levels, strict=True)]  # fmt: skip
        away = (steps[1] @ steps[0] @ x - x)[:3]
        return [*(1e3 * away), c @ x[:3] + 1.0 - k, c @ (steps[0] @ x)[:3] + 1.0 + k]

    period = 1e-4 * fsolve(pulses, [-0.1, 2.0, 0.12, 2.0, 2.0], xtol=1e-13)[3:].sum()
    found = epp.find_limit_cycles(loop)
    assert found.status is Status.CONVERGED
    assert [c.period for c in found] == [pytest.approx(period, rel=1e-8)]
    assert 0.999 < abs(found[0].multipliers[0]) < 1.0


@pytest.mark.parametrize("slower", mostly_slow([1.0, 1e3, 1e-3], [1e3]))
def test_what_no_prediction_is_near_is_found_in_any_unit_of_time(slower):
    """A spacecraft under thrusters with a Schmitt trigger and dead time, of which first order sees nothing: runs were
    100 s long. The period is that of a run of relays and dead time alone, solved from switch to switch.
    """
    loop = epp.LureSystem.build(
        [[0.0, 0.0], [1.0 / slower, 0.0]], [[1.0 / slower], [0.0]], [[-1.0, -0.5]],
        [epp.HysteresisRelayDeadZone(0.1, 0.06, 0.4)], delays=[0.12 * slower],
    )  # fmt: skip
    found = epp.find_limit_cycles(loop)
    assert found.status is Status.CONVERGED
    assert [c.period / slower for c in found] == [pytest.approx(10.31566, rel=1e-6)]


@pytest.mark.parametrize(
    ("seed", "periods", "many"),
    [
        pytest.param(41032, [6.70328410720], False, marks=pytest.mark.slow),
        (41033, [5.26874840229, 5.28214585336], True),
    ],
)
def test_cycles_along_which_an_element_slides_or_holds_are_listed_once(seed, periods, many):
    # Hundreds were listed: a play within its gap holds any value, and cycles are a continuum. A preload that slides all
    # round stands on its level, and its cycle is alone.
    loop = random_loop(seed)
    found = epp.find_limit_cycles(loop)
    # The loop is symmetric: a cycle may come with its mirror image.
    assert sorted({round(c.period, 9) for c in found}) == pytest.approx(periods, rel=1e-9)
    assert len(found) <= 2 * len(periods)
    assert ("one of a continuum" in found.search) is many
    first = found[0]
    assert first.stable and ("one of a continuum" in first.stability_criterion) is many
    # A run beside it is on another one of the same period, or comes back.
    beside = replace(loop, x0=first.state * (1.0 + 1e-3))
    run = epp.simulate(beside, t_end=400.0 * first.period)
    assert run.limit_cycle is not None
    assert run.limit_cycle.period == pytest.approx(first.period, rel=1e-5)
    if not many:
        assert run.limit_cycle.peak_to_peak == pytest.approx(first.peak_to_peak, rel=1e-6, abs=1e-9)


def test_an_isolated_cycle_is_none_of_a_continuum():
    for name in ("fig8a_original", "relay_deadzone", "backlash_servo", "stiction_level_S5J2"):
        found = cycles_of(name)
        assert found and "continuum" not in found.search + "".join(c.stability_criterion for c in found)


def test_stick_slip_far_slower_than_the_linear_part_is_found():
    # Stuck, this loop creeps for 37 s between slips, while its plant alone moves within half a second.
    loop = random_loop(42018)
    cycle, mirrored = epp.find_limit_cycles(loop)
    run = epp.simulate(loop, t_end=1600.0)
    assert cycle.stable and mirrored.stable
    assert cycle.period == pytest.approx(run.limit_cycle.period, rel=1e-9) == mirrored.period
    assert cycle.period > 100.0 / np.abs(np.linalg.eigvals(loop.A)).min()


@pytest.mark.parametrize("scale", [1.0, 1e-3])
def test_a_loop_that_starts_at_zero_and_has_no_prediction_is_searched_nevertheless(scale: float) -> None:
    """A thermostat: first order has no cycle, but the temperature saws between the thresholds.

    Warming from 1 - 0.1 to 1 + 0.1 towards 2 and cooling back towards 0, with a time constant of 5 s.
    """
    relay = epp.HysteresisRelay(-0.1 * scale, 0.1 * scale, 0.0, 1.0)
    loop = epp.LureSystem.build([[-0.2]], [[0.4 * scale]], [[-1.0]], [relay], constant_input=[scale])
    (cycle,) = epp.find_limit_cycles(loop)
    assert cycle.stable
    assert cycle.period == pytest.approx(5.0 * 2.0 * np.log(1.1 / 0.9), rel=1e-10)


def test_starts_reach_beyond_the_elements_limits() -> None:
    """An unstable plant in a saturated loop comes back from within 3 and not from beyond."""
    search = epp.find_limit_cycles(epp.LureSystem.from_tf(([3.0], [1.0, -1.0]), epp.Saturation(), x0=[0.1]))
    assert search.status is Status.CONVERGED and not search.cycles
    assert search.settles and search.diverges


@pytest.mark.slow
@pytest.mark.parametrize(
    ("plant", "element"),
    [
        (([1.0], [1.0, 1.0, 0.0]), epp.Relay()),
        (([1.0], [1.0, 2.0, 1.0]), epp.Preload(0.5, 1.0)),
    ],
)
def test_switches_that_pile_up_while_the_motion_dwindles_are_rest(plant, element) -> None:
    """Of second order without zeros: the relay's describing function never meets the locus, and no cycle exists."""
    search = epp.find_limit_cycles(epp.LureSystem.from_tf(plant, element))
    assert search.status is Status.CONVERGED and not search.cycles
    assert search.settles and not search.diverges


@pytest.mark.parametrize("inside", mostly_slow([0.99, 0.997], [0.99]))
def test_runs_that_are_held_up_beside_a_fold_come_to_rest(inside: float) -> None:
    """Below the gap at which cycles are born motions become smaller for long before they rest; all are decided."""
    case = epp.case("wheelchair")
    fold = epp.continue_branch(case, "play.gap", start=0.012, stop=0.004).folds[0].value
    found = epp.find_limit_cycles(case.with_values({"play.gap": inside * fold}))
    assert found.status.ok and len(found) == 0 and found.settles and not found.left_open


def test_integrators_that_run_away_leave() -> None:
    """Conditionally stable: within the unstable cycle the motion comes to rest, beyond it piles up for ever."""
    loop = epp.LureSystem.from_tf(([2.0, 4.0, 2.0], [1.0, 0.0, 0.0, 0.0]), epp.Saturation())
    search = epp.find_limit_cycles(loop)
    (cycle,) = search
    assert not cycle.stable and cycle.omega == pytest.approx(0.932901, abs=1e-6)
    assert search.status is Status.CONVERGED and search.settles and search.diverges


def test_growth_is_no_rest() -> None:
    """With dead time beyond ln 2 nothing holds this plant: what is far away and grows does not rest."""
    search = epp.find_limit_cycles(epp.LureSystem.from_tf(([1.0], [1.0, -1.0]), epp.Relay(), delay=0.75))
    assert search.diverges and not search.cycles
    assert np.all(np.abs(search.rest_state) <= 1.0)


@pytest.mark.parametrize("slope", [1.4, 1.55])
def test_runs_that_fly_off_lose_no_cycle(slope: float) -> None:
    """Far out rounding moves a state across a switch and back: switches at one instant are no period."""
    plant = ([0.35], [1.0, 3.33, 2.88, 0.91, 0.64])
    loop = epp.LureSystem.from_tf(plant, epp.DeadZone(-0.45, 0.35, slope=slope))
    search = epp.find_limit_cycles(loop)
    assert search.settles and search.diverges and len(search) == 1
    # Within the dead zone the plant is stable, beyond it not: the cycle between is unstable.
    assert not search[0].stable and search[0].residual < 1e-9


@pytest.mark.parametrize("delay", [0.0, 0.1])
def test_a_loop_without_gain_has_no_cycle(delay: float) -> None:
    loop = epp.LureSystem.from_tf(([0.0], [1.0, 1.0, 0.0]), epp.HysteresisRelay(-0.2, 0.2), delay=delay)
    assert len(epp.predict_limit_cycles(loop)) == 0
    search = epp.find_limit_cycles(loop)
    assert search.status is Status.CONVERGED and not len(search)


# Continua and rounding ----------------------------------------------------------------------------------------------
#: Period times peak of x'' = -x^3, from x'^2 / 2 + x^4 / 4: the complete elliptic integral of modulus 1/2.
CUBIC = 4.0 * ellipk(0.5)


@pytest.mark.parametrize(
    ("plant", "element", "families"),
    [
        (([1.0], [1.0, 0.0, 0.0]), epp.Cube(1.0), [lambda peak: CUBIC / peak]),
        # Four quarters of a sine outside the dead zone of 1, and twice across it, at constant speed.
        (([1.0], [1.0, 0.0, 0.0]), epp.DeadZone(), [lambda peak: 2.0 * np.pi + 4.0 / (peak - 1.0)]),
        (([1.0], [1.0, 0.0, 0.0]), epp.Relay(), [lambda peak: 4.0 * np.sqrt(2.0 * peak)]),
        # Linear within the dead zone, where nothing switches.
        pytest.param(
            ([0.1], [1.0, 0.0, 1.0]), epp.DeadZone(), [lambda peak: 2.0 * np.pi, None], marks=pytest.mark.slow
        ),
    ],
    ids=["cubic", "dead zone", "relay", "oscillator"],
)
def test_a_centre_is_one_continuum_and_not_a_list_of_cycles(plant, element, families):
    """Every amplitude has its own closed orbit, and often its own period."""
    found = epp.find_limit_cycles(epp.LureSystem.from_tf(plant, element), predicted=())
    assert len(found) == len(families)
    for cycle, period in zip(found, families, strict=True):
        assert cycle.method == "exact orbit" and cycle.stable
        assert "one of a continuum" in cycle.stability_criterion
        assert np.min(np.abs(cycle.multipliers - 1.0)) < 1e-5
        if period is not None:
            assert cycle.period == pytest.approx(period(cycle.peak_to_peak["x"] / 2.0), rel=1e-9)
    assert "one of a continuum of cycles" in found.search


@pytest.mark.parametrize("element", [epp.DeadZone(), pytest.param(epp.Saturation(), marks=pytest.mark.slow)])
def test_an_undamped_swing_does_not_settle(element):
    """However small it is beside what was predicted: nothing takes its energy."""
    loop = epp.LureSystem.from_tf(([1.0], [1.0, 0.0, 1.0]), element)
    found = epp.find_limit_cycles(loop)
    assert not found.settles and not found.rest_state.size
    assert epp.simulate(loop, t_end=300.0).status is not Status.SETTLED


def test_a_damped_swing_settles():
    damped = epp.find_limit_cycles(epp.LureSystem.from_tf(([1.0], [1.0, 0.5, 1.0]), epp.Saturation()))
    assert damped.settles


def test_what_rounding_moves_at_rest_is_no_cycle():
    # A play that nothing moves is let go and caught again by the last bits of its input: twelve such were listed.
    blocks = [epp.DeadZone(-0.2, 0.2), ([8.0], [1.0, 1.0, 0.0]), epp.Play(1.0)]
    loop = epp.LureSystem.from_blocks(blocks, x0=[4.55938567, 0.42925234])
    found = epp.find_limit_cycles(loop, predicted=())
    assert [c.stable for c in found] == [False, True] and found.settles
    assert min(c.peak_to_peak["play_input"] for c in found) > 1.0
    still = replace(loop, x0=np.array([-5.4e-25, -0.0701351276]), memory=(None, 0.5713134929))
    run = epp.simulate(still, t_end=300.0)
    assert run.status is Status.SETTLED and run.limit_cycle is None


@pytest.mark.parametrize("unit", mostly_slow([1.0, 1e-3], [1.0]))
def test_a_doubtful_slow_prediction_does_not_set_how_long_runs_are(unit: float):
    """Beyond 4 the relay cannot hold an unstable plant; a prediction of 271 s, 13 times off, took all steps before."""
    loop = epp.LureSystem.from_tf(
        ([2.0 / unit], [1.0, -0.5 / unit]), epp.HysteresisRelay(-0.2, 0.2), delay=0.3 * unit, x0=[0.1]
    )
    found = epp.find_limit_cycles(loop)
    assert (
        found.diverges and "steps of the engine" not in found.search and not any("steps" in t for t in found.left_open)
    )
    assert len(found.stable) == 1 and found[0].period == pytest.approx(unit * 1.78862607, rel=1e-6)


def test_a_start_on_an_unstable_state_of_rest_is_no_motion_that_settles():
    loop = epp.LureSystem.from_tf(([1.0], [1.0, -1.0]), epp.HysteresisRelay(-0.5, 0.5), x0=[1.0], memory=1.0)
    assert loop.A @ [1.0] + loop.B @ [loop.elements[0].output(loop.C @ [1.0], 1.0)[0].item()] == 0.0
    found = epp.find_limit_cycles(loop)
    assert found.diverges and not found.settles and not found.rest_state.size


CHATTERS = "as the output of an element, its own or another's, acts straight on it"


def limited(before: epp.Nonlinearity, *between: tuple[list[float], list[float]]) -> epp.LureSystem:
    return epp.LureSystem.from_blocks([([1.0], [1.0, 1.0, 0.0]), before, *between, epp.RateLimiter(1.0)])


def test_a_run_of_a_limiter_straight_behind_a_curved_element_is_said_to_chatter():
    before = epp.Tanh(1.0, 1.0)
    run = epp.simulate(limited(before), t_end=30.0)
    assert run.status is epp.Status.EVENT_LIMIT and CHATTERS in run.note
    assert CHATTERS not in epp.simulate(limited(before, ([5.0], [1.0, 5.0])), t_end=30.0).note


@pytest.mark.slow
def test_a_search_of_a_limiter_straight_behind_another_element_is_said_to_chatter():
    found = epp.find_limit_cycles(limited(epp.Tanh(4.0, 0.25)))
    assert not found.status.ok and CHATTERS in found.message
    assert CHATTERS not in epp.find_limit_cycles(limited(epp.Tanh(4.0, 0.25), ([5.0], [1.0, 5.0]))).message


@pytest.mark.slow
def test_a_search_ends_with_its_work_and_says_what_it_left(monkeypatch):
    """Switches that pile up in turned states take all the steps that a search has; here it has a tenth of them."""
    monkeypatch.setattr("eppanalysis.methods.search.find._MOST_WORK", 2e6)
    found = epp.find_limit_cycles(problem("relay on lags", 320).system)
    assert found.status is Status.UNDECIDED and found.provenance.statistics["work"] < 3e6
    assert "The search ended after 2e+06 steps" in found.search and "starts left when" in found.message
    assert "basin boundaries" in found.search and "tried" not in found.search


def test_the_ends_of_runs_add_up_to_their_starts() -> None:
    """Runs of bisections and continued ones were counted with the starts: 22 at rest and 89 on a cycle of 168."""
    said = re.search(r"runs from (\d+) starts: .*?\(([^)]*)\)", epp.find_limit_cycles(epp.case("wheelchair")).search)
    assert said is not None
    assert int(said[1]) == sum(int(end.split()[0]) for end in said[2].split(", ")) > 48  # the random ones among them
