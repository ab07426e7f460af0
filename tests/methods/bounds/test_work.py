"""How much is computed for a bound: what nobody looks at, and what is known already, is not."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis import workers
from eppanalysis.methods.bounds import elasticity, fold
from eppanalysis.methods.bounds.balanced import BalancedSweep, BoundProblem
from eppanalysis.methods.bounds.design import design_bounds
from eppanalysis.methods.bounds.tolerances import exact
from eppanalysis.methods.harmonic.loop import inputs_of
from eppanalysis.results import Status
from tests import made_bounds

GAP, GAIN = "play.gap", "loop.gain"
RELAY, THRESHOLD, LEVEL, SCALE = "relay_deadzone", "relay_dead_zone.threshold", "relay_dead_zone.level", "loop.gain"


class Counted:
    """A function that counts what it is asked for."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, place: object, name: str) -> None:
        self.asked: list[tuple[object, ...]] = []
        self.function = getattr(place, name)
        monkeypatch.setattr(place, name, self)

    def __call__(self, *given: object, **named: object) -> object:
        self.asked.append(given)
        return self.function(*given, **named)


@pytest.mark.slow
def test_elasticities_are_computed_when_they_are_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    slopes = Counted(monkeypatch, elasticity, "exact_slopes")
    (cell,) = design_bounds(made_bounds.wheelchair(), GAP, GAIN, at=[0.012], starts=10)
    assert not slopes.asked
    assert cell.elasticities[GAP] < 0.0 and len(slopes.asked) == 1


@pytest.mark.slow
def test_a_neighbouring_case_takes_over_programmes_and_has_the_same_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    case, given = epp.case(RELAY), {"at": [1.0], "within": (1.0, 3.0), "exact": False}
    other = case.with_values({LEVEL: 1.05})
    (alone,) = design_bounds(other, SCALE, THRESHOLD, **given)
    sweep = BalancedSweep(BoundProblem(case, THRESHOLD, *given["within"], SCALE))
    design_bounds(case, SCALE, THRESHOLD, sweep=sweep, **given)
    written = Counted(monkeypatch, fold, "write")
    (found,) = design_bounds(other, SCALE, THRESHOLD, sweep=sweep, **given)
    assert found.first_order == pytest.approx(alone.first_order, rel=1e-12) and not written.asked


@pytest.mark.slow
def test_variants_of_a_guideline_share_the_processes_and_have_the_same_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = {"over": SCALE, "limit": THRESHOLD, "within": (1.0, 3.0), "variants": {LEVEL: [1.0, 1.05]}, "starts": 10}
    monkeypatch.setattr(workers, "Workers", ThreadPoolExecutor)
    started = Counted(monkeypatch, workers, "Workers")
    alone, shared = (epp.design_guide(epp.case(RELAY), [1.0], workers=n, **asked) for n in (1, 2))
    assert shared.to_frame().equals(alone.to_frame())
    assert [row.cell.verified for row in alone.rows] == [True, True]
    assert np.isfinite([row.from_rest for row in alone.rows]).any()
    assert started.asked == [(2,)]


@pytest.mark.slow
def test_where_the_switches_change_a_bound_is_sought_next_to_the_last_one(monkeypatch: pytest.MonkeyPatch) -> None:
    low, high = (math.radians(angle) for angle in (0.4, 3.0))
    question = BoundProblem(epp.case("fig8a_original"), "lock_pin.backlash", low, high, "bands.range")
    sweep, first, then = BalancedSweep(question), 6.672332422890751, 7.071531798619257  # 1.5 lbf and 1.59 lbf
    sweep.bound(first)
    written = Counted(monkeypatch, fold, "write")
    _, found = sweep.bound(then)
    n_written = len(written.asked)
    alone = BalancedSweep(question)
    alone.bound(then)
    # One of a new sequence, or two; from the far end of the range it is one for every change on the way.
    assert n_written <= 2 < len(written.asked) - n_written
    assert found.fold.cycle.value == pytest.approx(alone.families[0].cycle.value, rel=1e-9)


def test_sizes_of_equations_are_their_largest_changes() -> None:
    question = BoundProblem(epp.case(RELAY), THRESHOLD, 1.0, 3.0)
    model, value = question.model(), 1.2
    predicted = epp.predict_limit_cycles(question.case_at(value))[0]
    cycle = fold.Cycle(value, inputs_of(model.loop(value), predicted)[:, :2], predicted.omega)
    step = fold._Step.of(model, fold.Programmes(), cycle, -1.0, 0.1, None)
    assert step is not None
    theta = step.numbers.at(value)[step.expressions.used]
    largest = np.zeros(step.sizes.size)
    for k, scale in enumerate(step.scales):
        h = np.zeros(step.scales.size)
        h[k] = 1e-6 * scale
        up, down = (step.expressions.residual(step.start[:-1] + side * h, theta) for side in (1.0, -1.0))
        largest = np.maximum(largest, np.abs(np.array(up - down)).ravel() / 2e-6)
    assert step.sizes == pytest.approx(largest, rel=1e-6)


def test_a_draw_that_oscillates_is_run_no_further_and_has_the_same_verdict(monkeypatch: pytest.MonkeyPatch) -> None:
    question = BoundProblem(epp.case(RELAY), THRESHOLD, 1.0, 3.0)
    box = exact.ExactBox.of(question, {LEVEL: 0.1}, None)
    values = box.centre.value * np.array([0.7, 0.95, 1.05, 1.3])
    cases = [question.case] * values.size
    every = []
    for value in values.tolist():
        base = exact.steady_hybrid(question.case_at(value).to_system(), question.case.operating_point)
        stack = exact.HybridStack.of(box._starts(base), question.case.to_system().signals.names)
        every.append(exact.simulate_batch(stack, exact.PERIODS * box.orbit.period).status)
    batches = Counted(monkeypatch, exact, "simulate_batch")
    found = box._oscillating(cases, values, 1)
    assert found.tolist() == [Status.LIMIT_CYCLE in statuses for statuses in every]
    assert found.any() and not found.all()
    assert sum(stack.n_cells for stack, _ in batches.asked) < sum(map(len, every))


def test_a_corner_that_is_only_checked_is_asked_for_no_slopes(monkeypatch: pytest.MonkeyPatch) -> None:
    question = BoundProblem(epp.case(RELAY), THRESHOLD, 1.0, 3.0)
    widths, slopes = {LEVEL: 0.1, SCALE: 0.1}, Counted(monkeypatch, exact, "exact_slopes")
    box = exact.ExactBox.of(question, widths, None)
    worst, message, n_corners = box.worst()
    assert not message and n_corners == 3
    # The centre's slopes and those of the corner to which they point.
    assert len(slopes.asked) == 2
    assert {name for _, _, sizes in slopes.asked for name in sizes} == set(widths)
    assert worst.value == pytest.approx(1.1 * 1.1 * box.centre.value, rel=1e-6)
