"""The ladder's verdicts on loops where they are known, and the errors that it states."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

import eppanalysis as epp
from eppanalysis.methods.comparison.ladder import Agreement, largest_harmonic
from eppanalysis.methods.comparison.rungs import _sentence
from eppanalysis.results import Status
from tests.reference.elbow_reference import DEG, nominal, simulate_reference
from tests.reference.lure_reference import simulate_lure
from tests.sampled_relay import patterns, sampled_relay
from tests.shared import of_unknown_response, said_above


@pytest.fixture(scope="module")
def original() -> epp.Ladder:
    return epp.ladder(epp.case("fig8a_original"))


def test_original_elbow_has_both_cycles_and_runs_on_the_stable_one(original: epp.Ladder) -> None:
    assert original.agreement is Agreement.ROUGH and original.outcome == "oscillate"
    assert original.prediction is not None
    assert [c.stable for c in original.prediction] == [False, True]
    assert original.matched == 1
    unstable, stable = original.prediction
    assert unstable.peak_to_peak["theta"] < stable.peak_to_peak["theta"]


def test_errors_are_relative_to_the_simulation(original: epp.Ladder) -> None:
    assert original.prediction is not None and original.run.limit_cycle is not None
    guess, true = original.prediction[1], original.run.limit_cycle
    assert original.errors["frequency"]["frequency"] == pytest.approx(
        (guess.frequency - true.frequency) / true.frequency
    )
    for name, errors in original.errors.items():
        if name == "frequency":
            continue
        span = true.peak_to_peak[name]
        assert errors["peak_to_peak"] == pytest.approx((guess.peak_to_peak[name] - span) / span)
        assert errors["mean"] == pytest.approx((guess.mean[name] - true.mean[name]) / span)
    # Tens of per cent in frequency: the lock pin's blows are far from sines.
    assert 0.1 < original.errors["frequency"]["frequency"] < 0.3
    assert "off by +18.3 % in frequency" in original.verdict
    assert " agree" not in str(original) and "more than 10 % in frequency or size" in str(original)


def test_prediction_stands_where_the_harness_ends(original: epp.Ladder) -> None:
    """Mean angles agree to a thousandth, since both are for x_h behind the step (20 mm / 19 mm = 60.3 deg)."""
    assert original.prediction is not None and original.run.limit_cycle is not None
    for cycle in (*original.prediction, original.run.limit_cycle):
        assert cycle.mean["theta"] == pytest.approx(20 / 19, abs=2e-3)


def test_the_unstable_cycle_divides(original: epp.Ladder) -> None:
    """Runs from half its size rest, from twice its size they reach the stable cycle."""
    below, above = (p for p in original.probes if p.cycle == 0)
    assert (below.scale, above.scale) == (0.5, 2.0)
    assert (below.status, above.status) == (Status.SETTLED, Status.LIMIT_CYCLE)
    assert original.run.limit_cycle is not None
    assert above.peak_to_peak == pytest.approx(original.run.limit_cycle.peak_to_peak["theta"], rel=1e-6)
    assert "is on a basin boundary" in original.verdict


def test_rows_hold_every_method_with_its_time(original: epp.Ladder) -> None:
    assert [row.method for row in original.rows] == [
        "describing function, unstable",
        "describing function, stable",
        "harmonic balance, order 9",
        "harmonic balance, order 65",
        "exact orbit, unstable",
        "exact orbit, stable",
        "simulation",
    ]
    assert all(row.seconds > 0 and row.cycle is not None for row in original.rows)
    assert original.probe_seconds > 0


def test_plain_data_is_json(original: epp.Ladder) -> None:
    data: dict[str, Any] = json.loads(json.dumps(original.to_dict()))
    assert data["agreement"] == "rough" and data["oscillations"] == 1 and len(data["probes"]) == 5
    assert data["simulation"]["status"] == "limit_cycle"


def test_a_stable_cycle_that_this_start_does_not_reach(tmp_path: Path) -> None:
    """A relay with dead zone, from inside its unstable cycle."""
    path = tmp_path / "small.toml"
    path.write_text('base = "relay_deadzone"\nloop.initial_state = [0.0, 0.0, 0.1]\nexpected.outcome = "settle"\n')
    result = epp.ladder(epp.read_case(path))
    assert result.agreement is Agreement.BASIN_BOUNDARY and result.outcome == "settle"
    assert [p.status for p in result.probes if p.cycle == 1] == [Status.LIMIT_CYCLE] * 3


def test_neither_has_a_cycle() -> None:
    result = epp.ladder(epp.case("wheelchair").with_values({"play.gap": "6 mm"}))
    assert result.agreement is Agreement.FREE and not result.errors and not result.probes


# First order wrong in both directions ---------------------------------------------------------------------------------
def play_servo_half_orbit(gain: float) -> tuple[float, float]:
    """Amplitude and period of x'' + x' = -k play(x), gap 2: closed-form arcs, root of the return map.

    From rest at x = X the output is held at X - 1 until x has fallen by 2, then follows at x + 1 until x' = 0 at -X.
    """

    def flow(matrix: Any, forcing: Any, start: Any, t: float) -> Any:
        block = np.zeros((3, 3))
        block[:2, :2], block[:2, 2] = matrix, forcing
        return (expm(block * t) @ np.append(start, 1.0))[:2]

    held, following = np.array([[0.0, 1.0], [0.0, -1.0]]), np.array([[0.0, 1.0], [-gain, -1.0]])

    def half(size: float) -> tuple[float, float]:
        start, push = np.array([size, 0.0]), np.array([0.0, -gain * (size - 1.0)])
        first = brentq(lambda t: flow(held, push, start, t)[0] - (size - 2.0), 1e-9, 200.0, xtol=1e-14)
        begin, pull = flow(held, push, start, first), np.array([0.0, -gain])
        times = np.linspace(1e-6, 6.0, 300)
        speed = [flow(following, pull, begin, t)[1] for t in times]
        i = next(i for i in range(299) if speed[i] < 0 <= speed[i + 1])
        second = brentq(lambda t: flow(following, pull, begin, t)[1], times[i], times[i + 1], xtol=1e-14)
        return flow(following, pull, begin, second)[0] + size, first + second

    size = brentq(lambda s: half(s)[0], 1.2, 1.6, xtol=1e-14)
    return size, 2.0 * half(size)[1]


def test_a_servo_that_first_order_calls_safe_oscillates() -> None:
    case = epp.case("backlash_servo_unseen")
    result = epp.ladder(case)
    assert result.agreement is Agreement.NOT_PREDICTED and result.outcome == "oscillate"
    assert result.prediction is not None and len(result.prediction) == 0
    size, period = play_servo_half_orbit(3.3)
    cycle = result.run.limit_cycle
    assert cycle is not None and case.expected.exact
    assert cycle.period == pytest.approx(period, rel=1e-8)
    assert cycle.peak_to_peak["x"] / 2 == pytest.approx(size, rel=1e-8)
    assert case.expected.exact[0].amplitude == pytest.approx(size, rel=1e-12)
    assert case.expected.exact[0].period == pytest.approx(period, rel=1e-12)


@pytest.mark.slow
def test_an_independent_integrator_sees_the_unseen_cycle() -> None:
    system = epp.case("backlash_servo_unseen").to_system()
    reference = simulate_lure(system, np.linspace(0.0, 300.0, 11))
    times = reference.event_times("play: falls")
    # Deviations shrink by 0.75 a period; after 300 s a few 1e-6 of them are left.
    assert times[-1] - times[-2] == pytest.approx(play_servo_half_orbit(3.3)[1], rel=1e-5)


def test_first_order_has_no_cycle_below_the_gain_of_its_fold() -> None:
    """The case names the gain 3.41658; the describing function of play is written afresh here.

    With half a gap of one and u = 1 - 2/a: Re N = (pi/2 + arcsin u + u sqrt(1 - u^2))/pi, Im N = -4 (1 - 1/a)/(pi a).
    Then 1 + k N/(j w (j w + 1)) = 0 means w = -k Im N and w^2 = k Re N, so k = Re N/(Im N)^2: the least over a.
    """
    a = np.linspace(1.0005, 3.0, 400_001)
    u = 1.0 - 2.0 / a
    real = (np.pi / 2 + np.arcsin(u) + u * np.sqrt(1.0 - u**2)) / np.pi
    fold = float((real / (4.0 * (1.0 - 1.0 / a) / (np.pi * a)) ** 2).min())
    assert fold == pytest.approx(3.41658, abs=1e-5)
    for factor, count in ((1 + 1e-6, 2), (1 - 1e-6, 0)):
        loop = epp.LureSystem.from_tf(([fold * factor], [1.0, 1.0, 0.0]), epp.Play(gap=2.0))
        assert len(epp.predict_limit_cycles(loop)) == count


@pytest.mark.slow
def test_a_cycle_that_only_first_order_has() -> None:
    result = epp.ladder(epp.case("elbow_cycle_not_there"))
    assert result.agreement is Agreement.NOT_THERE and result.outcome == "settle"
    assert result.prediction is not None and any(c.stable for c in result.prediction)
    assert [p.status for p in result.probes] == [Status.SETTLED] * 5
    assert "is on no basin boundary here" in result.verdict


@pytest.mark.slow
def test_an_independent_integrator_comes_to_rest_there_too() -> None:
    run = simulate_reference(nominal(backlash=0.9 * DEG), 2.5, rtol=1e-8, atol=1e-10)
    assert run.verdict == "settle"


# The other verdicts ---------------------------------------------------------------------------------------------------
def test_a_run_that_is_too_short_is_no_witness_but_the_exact_search_is() -> None:
    result = epp.ladder(epp.case("relay_ideal_khalil79").with_values({"run.t_end": "3 s"}))
    assert result.agreement is Agreement.CONFIRMED and result.outcome == "undecided"
    assert "simulate for longer" in result.verdict and not result.missed


@pytest.mark.slow
def test_in_discrete_time_the_search_is_a_witness_too_where_a_run_is_too_short() -> None:
    result = epp.ladder(epp.case("backlash_discrete_pi_kp05_ki02").with_values({"run.t_end": "3 s"}))
    assert result.agreement is Agreement.FOUND and result.outcome == "undecided"
    assert result.search.stable and "simulate for longer" in result.verdict


HUNTING = """
kind = "loop"
title = "Positioning with integral action and stiction"
[loop]
A = [[0, 1, 0], [-25.0, -3.0, -20.0], [1, 0, 0]]
B = [[0], [-1.0], [0]]
C = [[0, 1, 0]]
initial_state = [{start}, 0, 0]
[[loop.elements]]
element = "friction"
name = "friction"
coulomb = "1 N"
static = "1.5 N"
[loop.signals]
position = {{ state = [1, 0, 0], unit = "m" }}
[run]
t_end = "{t_end} s"
[expected]
signal = "position"
"""


@pytest.mark.parametrize(("start", "t_end"), [(0.1, 12), (0.0, 12)])
def test_stable_cycles_that_exist_and_are_not_predicted_are_missed(start: float, t_end: float) -> None:
    """Whether the run is undecided or rests by its end, the exact search has the answer that first order has not."""
    case = epp.case_from_text(HUNTING.format(start=start, t_end=t_end))
    result = epp.ladder(case)
    assert result.prediction is not None and len(result.prediction) == 0 and result.search is not None
    assert result.agreement is Agreement.MISSED and result.to_dict()["agreement"] == "missed"
    assert result.missed == (0,) and result.search[0].stable
    assert (
        "The describing function misses the stable limit cycle." in result.verdict and "refuted" not in result.verdict
    )
    # Witness: a longer run of the engine is on that cycle.
    longer = epp.simulate(case.with_values({"loop.initial_state": [0.1, 0, 0]}).to_system(), t_end=300.0).limit_cycle
    assert longer is not None and longer.period == pytest.approx(result.search[0].period, rel=1e-6)
    figure = result.plot().figure
    drawn = {text.get_text() for ax in figure.axes if ax.get_legend() for text in ax.get_legend().get_texts()}
    assert any(text.startswith("exact") and text.endswith("the describing function misses it") for text in drawn)
    assert "The describing function misses" in said_above(figure)[1]


def test_an_element_without_a_describing_function_has_only_its_simulation() -> None:
    result = epp.ladder(of_unknown_response())
    assert result.agreement is Agreement.NO_PREDICTION and result.prediction is None
    assert result.outcome == "oscillate" and "An element has no describing function" in result.verdict


@pytest.mark.slow
def test_a_cycle_of_seven_turns_is_compared_oscillation_by_oscillation(monkeypatch: pytest.MonkeyPatch) -> None:
    """211 samples with seven oscillations: the frequency beside first order's 0.0396 is 7/211, not 1/211.

    The run has the cycle; what the search lists beside it takes seconds, and is not looked at here.
    """
    monkeypatch.setattr("eppanalysis.methods.search.sampled._MOST_WORK", 1e6)
    result = epp.ladder(epp.case("backlash_discrete_pi_kp05_ki01"))
    assert result.agreement is Agreement.ROUGH and result.oscillations == 7
    want = 0.24872573337585752 / (2 * math.pi) / (7 / 211) - 1
    assert result.errors["frequency"]["frequency"] == pytest.approx(want, rel=1e-6)
    assert "only after 7 oscillations of m" in result.verdict
    assert result.rows[-1].quantities["frequency"] == pytest.approx(7 / 211)


def test_largest_harmonic_of_an_ordinary_cycle_is_the_first(original: epp.Ladder) -> None:
    assert original.run.limit_cycle is not None
    assert largest_harmonic(original.run.limit_cycle, "theta") == 1


# The rungs ------------------------------------------------------------------------------------------------------------
def test_every_rung_is_nearer_to_the_exact_cycle_than_the_one_below(original: epp.Ladder) -> None:
    for number in (0, 1):
        rungs = [row for row in original.rows if row.exact == number]
        kinds = ["describing function", "harmonic balance", "exact orbit", "simulation"]
        assert [r.method.split(",")[0] for r in rungs] == kinds[: 3 + number]
        first, balance, exact = (abs(r.errors["period"]) for r in rungs[:3])
        assert first > 10 * balance > exact == 0.0
        assert balance < 2e-2
    simulated = original.rows[-1]
    assert abs(simulated.errors["period"]) < 1e-9 and abs(simulated.errors["peak-to-peak"]) < 1e-9


def test_errors_of_rungs_are_those_of_the_published_exact_cycle() -> None:
    case = epp.case("relay_deadzone")
    result = epp.ladder(case)
    assert case.expected.exact
    for exact in case.expected.exact:
        kind = "stable" if exact.stable else "unstable"
        row = next(r for r in result.rows if r.method == f"describing function, {kind}")
        assert row.cycle is not None
        assert row.errors["period"] == pytest.approx(row.cycle.period / exact.period - 1.0, rel=1e-6)


def test_a_predicted_cycle_without_counterpart_has_no_number() -> None:
    result = epp.ladder(epp.case("backlash_servo"))
    unstable = result.rows[0]
    assert unstable.method == "describing function, unstable" and unstable.exact is None and not unstable.errors
    assert "Exact limit cycles: 1 stable." in result.verdict


def test_a_loop_in_discrete_time_climbs_to_its_exact_cycles() -> None:
    """The upper of the two cycles of 18 samples is the run's, and runs begun near the predicted one end on it."""
    case = epp.case("backlash_discrete_pi_kp05_ki02")
    result = epp.ladder(case)
    assert [c.stable for c in result.search] == [False, True]
    first, balance, *_, simulated = result.rows
    assert abs(first.errors["period"]) > 0.1 > 0.02 > abs(balance.errors["period"])
    assert simulated.exact == 1 and max(map(abs, simulated.errors.values())) < 1e-12
    ends = [probe.peak_to_peak for probe in result.probes]
    assert ends == pytest.approx(3 * [result.search[1].peak_to_peak["m"]], rel=1e-9)


@pytest.mark.slow
def test_a_loop_with_a_sampled_controller_climbs_to_its_locked_cycle(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, few in (("_N_RANDOM", 0), ("_SCALES", (1.0,)), ("_MOST_SOUGHT", 500)):
        monkeypatch.setattr(f"eppanalysis.methods.search.sampled.{name}", few)
    case = sampled_relay().with_values({"dead": 0.1})
    result = epp.ladder(case)
    locked = [p for p in patterns(0.5, 9) if p.low < 0.1 < p.high]
    assert [row.method.partition(",")[0] for row in result.rows if row.exact == 0] == [
        "describing function",
        "harmonic balance",
        "exact orbit",
    ]
    exact = next(row for row in result.rows if row.method.startswith("exact"))
    assert exact.cycle is not None and round(exact.cycle.period / 0.5, 9) in {p.samples for p in locked}
    assert result.agreement is Agreement.AT_REST and result.run.status is Status.SETTLED


def test_a_run_that_stays_at_an_unstable_rest_is_guarded_by_nothing() -> None:
    """Van der Pol's oscillator at rest: it is a point of rest that no cycle guards, and any push leaves it."""
    rest = epp.LureSystem.build([[0.0, 1.0], [-1.0, 1.0]], [[0.0], [-1.0 / 3.0]], [[0.0, 1.0]], [epp.Cube(1.0)])
    result = epp.ladder(replace(rest, x0=np.zeros(2)))
    assert result.outcome == "settle" and result.search is not None and not result.search.unstable
    assert result.agreement is Agreement.AT_REST and "basin boundary of rest" not in str(result)


@pytest.mark.slow
def test_a_search_does_not_confirm_what_is_far_off() -> None:
    """Rayleigh's equation, x'' - mu (x' - x'^3/3) + x = 0, a relaxation oscillation: a run too short to show it."""
    mu = 4.0
    loop = epp.LureSystem.build(
        [[0.0, 1.0], [-1.0, mu]], [[0.0], [-mu / 3.0]], [[0.0, 1.0]], [epp.Cube(1.0)], x0=[0.01, 0.0]
    )
    result = epp.ladder(loop)
    assert result.outcome == "undecided" and result.agreement is Agreement.FOUND
    assert result.search is not None and result.prediction is not None
    assert result.search.cycles[0].period > 1.5 * result.prediction.cycles[0].period
    assert "confirms" not in str(result) and "with an error above 10 %" in str(result)


@pytest.mark.parametrize(
    ("plant", "element", "agreement"),
    [
        # The unstable cycle of three levels is 60 % slower than a sine makes it, the stable one 2 %.
        (([3.0], [1.0, 2.0, 1.0, 0.0]), epp.RelayDeadZone(0.3), Agreement.CONFIRMED_STABLE),
        # A limit before three integrators: one cycle, unstable, 16 % larger than first order has it.
        (([20.0, 40.0, 20.0], [0.01, 1.0, 0.0, 0.0, 0.0]), epp.Saturation(), Agreement.NONE_STABLE),
        (([10.0], [1.0, 3.0, 2.0, 0.0]), epp.Saturation(), Agreement.CONFIRMED),
    ],
)
def test_a_search_confirms_no_unstable_cycle_that_is_far_off(plant, element, agreement) -> None:
    result = epp.ladder(epp.LureSystem.from_tf(plant, element))
    assert result.outcome == "undecided" and result.agreement is agreement
    unstable = [row for row in result.rows if row.method.startswith("describing function, unstable")]
    assert all(max(map(abs, row.errors.values())) > 0.1 for row in unstable)


def test_what_the_search_leaves_open_is_said_beside_what_it_finds() -> None:
    """That it finds "this cycle and no other" is no news where runs of it were left undecided."""
    found = epp.ladder(epp.case("relay_ideal_khalil79"))
    assert "this limit cycle and no other" in str(found) and "open" not in str(found)
    by_runs = [replace(cycle, method="simulation") for cycle in found.search]
    assert "The search by runs finds" in str(replace(found, search=replace(found.search, cycles=by_runs)))
    left = replace(found.search, status=Status.UNDECIDED, left_open=("2 runs neither settled nor repeated themselves",))
    for told in (str(replace(found, search=left)), _sentence(left, "")):
        assert "The search leaves something open: 2 runs neither settled nor repeated themselves." in told


@pytest.mark.slow
def test_in_discrete_time_a_run_at_rest_does_not_confirm_a_prediction_that_misses_cycles() -> None:
    """A sampled servo with an encoder of coarse steps rests where it starts, and swings from other starts."""
    loop = epp.LureSystem.build(
        [[1.0, 0.7435], [0.0, 0.5353]], [[0.2565], [0.4647]], [[-1.0, 0.0]], [epp.Quantiser(1.0, 20)],
        time_step=1.0, x0=[0.3, 0.0],
    )  # fmt: skip
    result = epp.ladder(loop)
    assert result.run.status is epp.Status.SETTLED and len(result.prediction) == 0
    assert result.search.stable and "misses 6 of 6 stable limit cycles" in str(result)
    assert result.search.stable[0].period == round(result.search.stable[0].period)


@pytest.mark.parametrize(
    ("plant", "element", "start"),
    [
        (([6.0], [0.2 / 40**3, 1.0 / 40**2, -0.2 / 40, -1.0]), epp.Saturation(), 1.0),
        (([12.0], [1.0 / 40**3, 3.0 / 40**2, 2.0 / 40, 0.0]), epp.DeadZone(), 100.0),
    ],
)
def test_of_a_run_that_grows_without_bound_no_longer_one_is_asked_for(plant, element, start) -> None:
    result = epp.ladder(epp.LureSystem.from_tf(plant, element, x0=[start, 0.0, start]))
    assert result.run.status is Status.DIVERGED
    assert "grows without bound" in str(result) or "grew without bound" in str(result)
    assert "undecided" not in str(result).lower() and "longer" not in str(result)


@pytest.mark.parametrize("agreement", list(Agreement))
def test_no_sentence_beside_a_run_without_bound_calls_it_undecided(agreement) -> None:
    assert "undecided" not in agreement.sentence(Status.DIVERGED)
    assert agreement.sentence(Status.UNDECIDED) == agreement.value


STILL = """
kind = "loop"
title = "Only the set point is shown"
[loop]
A = [[-1, 0], [1, 0]]
B = [[-5], [0]]
C = [[0, 1]]
inputs = ["reference"]
input_matrix = [[0], [0]]
[loop.signals]
reference = { state = [0, 0], input = [1] }
[[loop.elements]]
element = "play"
gap = 2.0
[run]
t_end = "100 s"
"""


def test_a_loop_whose_signals_all_stand_still_has_errors_of_frequency_alone() -> None:
    """The size of a signal that stands still has no relative error; that of a prediction is estimated elsewhere."""
    found = epp.ladder(epp.case_from_text(STILL))
    assert found.agreement is Agreement.AGREE and set(found.errors) == {"frequency"}
    assert all(row.errors.get("peak-to-peak") in (None, 0.0) for row in found.rows)  # none, or exact
    assert "The describing function is off by +1.2 % in frequency." in str(found)
    moving = STILL.replace("input = [1] }", "input = [1] }\nangle = { state = [0, 1] }")
    errors = [
        [cycle.error_estimate for cycle in epp.predict_limit_cycles(epp.case_from_text(text)).cycles]
        for text in (STILL, moving)
    ]
    np.testing.assert_allclose(*errors, rtol=0.2)
