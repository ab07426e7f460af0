"""Nothing missed, nothing invented: the searches for limit cycles against runs from grids of initial states.

Every attractor that a run ends on must be among the stable cycles found (or rest), and a run that starts on a stable
cycle found must stay there. By default a few cases from 64 starts each; ``EPP_STARTS=1024`` in the environment takes
all loops of the verification set and all cases of the truth table from so many (some minutes).
"""

from __future__ import annotations

import os
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import qmc

import eppanalysis as epp
from eppanalysis.methods.search.basin import REST, UNDECIDED, basin
from tests.shared import cycles_of, shipped

LOOPS = [
    name
    for name, case in shipped().items()
    if case.kind == "loop" and case.expected.exact is not None and not case.to_system().time_step
]
TRUTH_TABLE = [
    "fig8a_original",
    "fig8b_reduced_backlash",
    "gain_brings_it_back",
    "fig6a_original_pulley",
    "fig6b_ball_bearing",
    "soft_cable",
    "light_forearm",
    "upright",
]
#: Cases of the small version, which shows one of each kind.
QUICK = ["relay_deadzone", "quantised_sensor_ct", "backlash_servo", "thruster_dz_hyst", "belt_leine", "light_forearm"]


def starts_around(system: epp.LureSystem, cycles: epp.CycleSearch, count: int) -> np.ndarray:
    """Low-discrepancy points of a box twice as large as all cycles, half of them in one a tenth as large."""
    n = system.A.shape[0]
    corners = np.concatenate([c.event_states for c in cycles] or [[system.x0, np.zeros(n)]])
    middle, half = corners.mean(axis=0), 2.0 * np.maximum(np.ptp(corners, axis=0), 1e-6)
    points = 2.0 * qmc.Sobol(n, seed=3).random(2 ** int(np.ceil(np.log2(count))))[:count] - 1.0
    points[::2] *= 0.1
    starts = middle + half * points
    if "contact_angle" in system.state_names:
        # Elsewhere than in the middle of the gap the contact angle is tied to the twist.
        starts[:, system.state_names.index("contact_angle")] = 0.0
    return starts


def check(name: str, count: int) -> None:
    case = epp.case(name)
    system, value = case.to_system(), case.operating_point
    found = cycles_of(name)
    reached = basin(system, found, starts_around(system, found, count), value)
    stable = {i for i, c in enumerate(found) if c.stable}
    assert set(reached.ends.tolist()) <= stable | {REST, UNDECIDED}, f"{name}: a run ends on what was not found"
    # Without verdict are runs that an integrator takes through a band without gain, ever more slowly, for ages.
    assert reached.count(UNDECIDED) <= 0.15 * count
    if REST in reached.ends:
        assert found.settles
    if stable and not any(m is not None for c in found for m in c.memory):
        again = basin(system, found, np.array([found[i].state for i in sorted(stable)]), value)
        assert again.ends.tolist() == sorted(stable), f"{name}: a run does not stay on a stable cycle that was found"


@pytest.mark.slow
@pytest.mark.parametrize("name", [*LOOPS, *TRUTH_TABLE] if "EPP_STARTS" in os.environ else QUICK)
def test_every_run_ends_on_what_was_found(name: str) -> None:
    count = int(os.environ.get("EPP_STARTS", "64"))
    # The upright forearm moves by series instead of matrices, and its runs take a hundred times as long.
    check(name, count // 8 if name == "upright" else count)


def test_a_missed_cycle_would_be_noticed() -> None:
    case = epp.case("quantised_sensor_ct")
    system, found = case.to_system(), cycles_of(case.name)
    blind = replace(found, cycles=tuple(c for c in found if c is not found.stable[-1]))
    reached = basin(system, blind, starts_around(system, found, 16))
    assert set(reached.ends.tolist()) - {i for i, c in enumerate(blind) if c.stable} - {REST, UNDECIDED}


@pytest.mark.slow
def test_a_cycle_of_four_turns_is_listed_once() -> None:
    """Chua's circuit behind two doublings: runs were not near enough to close it, and its mirror image stood twice."""
    loop = epp.LureSystem.build(
        [[-2.4, 8.4, 0.0], [1.0, -1.0, 1.0], [0.0, -14.286, 0.0]], [[3.6], [0.0], [0.0]], [[1.0, 0.0, 0.0]],
        [epp.Saturation(-1.0, 1.0)],
    )  # fmt: skip
    found = epp.find_limit_cycles(loop)
    assert "could not be closed" not in found.message
    # Both members of three generations, and the symmetric one around them; by the period alone they are told apart.
    assert sorted(round(c.period, 6) for c in found) == [
        2.317459, 2.317459, 2.362914, 4.594685, 4.594685, 9.189493, 9.189493,
    ]  # fmt: skip
    for period in (2.317459, 4.594685, 9.189493):
        one, other = (c.mean["saturation_input"] for c in found if round(c.period, 6) == period)
        assert one == pytest.approx(-other, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("unit", [1.0, 1e-3])
def test_unstable_cycles_that_bound_nothing_are_no_full_list(unit: float) -> None:
    """Chua's circuit with five pieces: all runs end on the large cycle, and those around both eyes have no end."""
    loop = epp.LureSystem.build(
        [[-11.5, 11.5, 0.0], [1.0, -1.0, 1.0], [0.0, -100.0 / 7.0, 0.0]], [[-11.5], [0.0], [0.0]], [[1.0, 0.0, 0.0]],
        [epp.PiecewiseLinear(
            np.array([-10.0, -1.0, 1.0, 10.0]) * unit, [5.0, -5.0 / 7.0, -8.0 / 7.0, -5.0 / 7.0, 5.0],
            np.array([400.0 / 7.0 + 3.0 / 7.0, 3.0 / 7.0, 0.0, -3.0 / 7.0, -400.0 / 7.0 - 3.0 / 7.0]) * unit,
        )],
        x0=[0.1 * unit, 0.0, 0.0],
    )  # fmt: skip
    found = epp.find_limit_cycles(loop)
    assert len(found.stable) == 1 and len(found.unstable) > 1
    assert "unstable cycles: others like them may be missed where no prediction is near" in str(found)


@pytest.mark.slow
def test_a_prediction_is_answered_by_the_cycle_that_its_estimate_promises() -> None:
    """The nerve of FitzHugh and Nagumo, a relaxation oscillation: 2.1 times as slow as predicted, within 1.11."""
    loop = epp.LureSystem.build(
        [[1.0, -1.0], [0.08, -0.064]], [[-1.0 / 3.0], [0.0]], [[1.0, 0.0]], [epp.Cube(1.0)],
        constant_state=[0.335, 0.056],
    )  # fmt: skip
    (predicted,) = epp.predict_limit_cycles(loop)
    found = epp.find_limit_cycles(loop)
    assert found.status is epp.Status.CONVERGED
    assert not found.unclosed
    (cycle,) = found
    # DOP853 at 1e-12, between the rises of the potential through its middle.
    assert cycle.period == pytest.approx(47.6140274, rel=1e-8)
    assert 1.0 < predicted.omega / cycle.omega - 1.0 < predicted.error_estimate


def test_the_size_that_an_estimate_promises_is_that_of_the_first_signal() -> None:
    """McKean's nerve of three pieces (Adv. Math. 4, 1970): where the output of its element is a difference of large
    parts, it is six times as large as predicted. The input, and the period, are within the estimate.
    """
    loop = epp.LureSystem.build(
        [[0.0, -1.0], [0.1, -0.05]], [[1.0], [0.0]], [[1.0, 0.0]],
        [epp.PiecewiseLinear([-1.0, 1.0], [-1.0, 1.0, -1.0], [-2.0, 0.0, 2.0])], constant_state=[0.15, 0.0],
    )  # fmt: skip
    found = epp.find_limit_cycles(loop)
    assert found.status is epp.Status.CONVERGED
    assert not found.unclosed
    # DOP853 at 1e-12 in steps of 0.05, between the rises of the potential through zero.
    assert [c.period for c in found] == [pytest.approx(33.367002, rel=1e-7)]


@pytest.mark.parametrize(("zero", "settles"), [(0.5, True), (0.05, False)])
def test_a_loop_without_a_size_of_its_own_is_run_in_any_units(zero, settles):
    """No run was made from a start at rest; of an integrator that is reset no threshold tells how far to start."""
    for size, unit in ((1.0, 1.0), (1e-3, 1.0), (1.0, 1e3)):
        plant = ([size * zero * unit, size], [unit**2, 0.2 * unit, 0.0])
        clegg = epp.CleggIntegrator(gain=1.0 / (size * unit))
        found = epp.find_limit_cycles(epp.LureSystem.from_tf(plant, clegg, x0=[0.0, 0.0]))
        assert found.n_runs > 100
        assert (found.settles, found.diverges, len(found), found.status.ok) == (settles, not settles, 0, True)


@pytest.mark.parametrize("gain", [1.5, 30.0, 1000.0])
def test_a_limited_loop_about_an_unstable_plant_is_seen_to_leave_from_far_at_any_gain(gain):
    """All starts were said to settle at a high gain, where the limit is reached near the rest."""
    loop = epp.LureSystem.from_tf(([gain], [0.2, 0.8, -1.0]), epp.Saturation(), x0=[0.0, 0.0])
    found = epp.find_limit_cycles(loop)
    assert (found.settles, found.diverges, len(found)) == (True, True, 0)
