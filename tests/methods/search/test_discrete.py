"""Searches in discrete time: what they find beside runs, in what units, and what they say of the rest."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

import eppanalysis as epp
from eppanalysis.results import Status
from tests.coordinates import assert_same_cycles, rescaled, rotated
from tests.stress.families import problem
from tests.stress.machine import iterate


def spiral(element: epp.Nonlinearity) -> epp.LureSystem:
    """A turn of 40.3 samples that decays, beside an element."""
    angle = 2 * np.pi / 40.3
    A = 0.98 * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return epp.LureSystem.build(A, [[0.2], [0.0]], [[1.0, 0.0]], [element], x0=[0.5, 0.0], time_step=1.0)


@pytest.mark.slow
def test_cycles_beside_those_that_runs_end_on_are_found_and_what_was_sought_is_said():
    """One run of a thousand ends on either of a mirrored pair of 27 samples; four others have 26."""
    system = problem("quantiser, sampled", 402).system
    found = epp.find_limit_cycles(system)
    assert [round(c.period / system.time_step) for c in found] == [27, 27, 26, 26, 26, 26]
    images = []
    for c in found[:2]:
        states = iterate(epp.LureSystem.build(
            system.A, system.B, system.C, system.elements, x0=c.state, constant_input=system.constant_input,
            time_step=system.time_step,
        ), {}, 28)  # fmt: skip
        np.testing.assert_allclose(states[-1], states[0], rtol=0, atol=1e-12)
        images.append(states[:-1, 0])
    assert min(np.abs(np.roll(images[0], k) + images[1]).max() for k in range(27)) < 1e-9
    assert "sought by Newton's method at" in found.search and "with small basins may be missed" in str(found)


@pytest.mark.slow
def test_an_unstable_motion_that_no_samples_close_is_not_passed_over():
    """Inside it the spiral decays, beyond it the dead zone's gain drives it out: in between lies what is predicted."""
    found = epp.find_limit_cycles(spiral(epp.DeadZone(-1.0, 1.0)))
    assert found.settles and found.diverges and not len(found)
    assert found.status is Status.UNDECIDED and len(found.unclosed) == 1
    assert "no orbit was closed for the cycle predicted at" in str(found)


@pytest.mark.parametrize("amplitude", [1e-12, 1e12])
def test_units_of_amplitude_and_turned_states_change_nothing(amplitude):
    """Growth without bound is told by what a run began with, wherever that is."""
    system = problem("quantiser, sampled", 403).system
    found = epp.find_limit_cycles(system)
    other = epp.find_limit_cycles(rescaled(rotated(system, 3), 1.0, amplitude, 4))
    assert_same_cycles(other, found, "x0", 1.0, amplitude)
    assert (other.status, other.settles, other.diverges) == (found.status, found.settles, found.diverges)


@pytest.mark.parametrize(
    ("level", "samples"),
    [(1.0 / 5.0, 5), *(pytest.param(*case, marks=pytest.mark.slow) for case in ((1.0 / 3.0, 3), (3.0 / 7.0, 7)))],
)
def test_a_modulator_has_one_continuum_of_cycles(level: float, samples: int) -> None:
    """Delta and sigma: of a level p/q the pattern has q samples (both odd), and the integrator keeps its offset."""
    loop = epp.LureSystem.build(
        [[1.0]], [[-1.0]], [[1.0]], [epp.Relay()], constant_state=[level], x0=[0.123], time_step=1.0
    )
    found = epp.find_limit_cycles(loop)
    (cycle,) = found
    assert cycle.period == samples and cycle.stable and found.n_continua == 1
    assert cycle.mean["relay_output"] == pytest.approx(level)
    assert "continuum" in str(found)


@pytest.mark.slow
def test_no_cycle_of_two_integrators_in_a_chain_is_stable() -> None:
    """Of a modulator of second order a disturbance of the first integrator moves the second as far in each turn."""
    loop = epp.LureSystem.build(
        [[1.0, 0.0], [1.0, 1.0]], [[-1.0], [-2.0]], [[0.0, 1.0]], [epp.Relay()], constant_state=[0.0, 0.0],
        x0=[0.1, 0.2], time_step=1.0,
    )  # fmt: skip
    found = epp.find_limit_cycles(loop)
    assert found.n_continua and not found.stable and not found.status.ok
    (cycle,) = (c for c in found if c.period == 4.0)

    def turns(x: np.ndarray, most: int) -> np.ndarray:
        for _ in range(4 * most):
            v = 1.0 if x[1] >= 0.0 else -1.0
            x = np.array([x[0] - v, x[1] + x[0] - 2.0 * v])
        return x

    aside = cycle.state + [1e-6, 0.0]
    np.testing.assert_allclose(turns(cycle.state, 100), cycle.state, atol=1e-12)
    np.testing.assert_allclose(turns(aside, 100) - turns(aside, 50), [0.0, 4.0 * 50.0 * 1e-6], atol=1e-12)


@pytest.mark.parametrize(("p", "q", "period"), [(1, 3, 3), (1, 2, 4), (3, 7, 7), (2, 5, 10)])
def test_a_modulator_of_first_order_repeats_as_its_input_is_a_fraction(p: int, q: int, period: int) -> None:
    """Friedman 1988: the bits for a constant p/q repeat after q samples if p and q are odd, else after 2q."""
    loop = epp.LureSystem.build(
        [[1.0]], [[-1.0]], [[1.0]], [epp.Comparator()], constant_state=[p / q], x0=[0.1], time_step=1.0,
        element_names=["bit"],
    )  # fmt: skip
    (cycle,) = epp.find_limit_cycles(loop)
    assert cycle.period == period and cycle.mean["bit_output"] == pytest.approx(p / q, abs=1e-12)
    y, bits = 0.1, []
    for _ in range(40 * period):
        bits.append(1.0 if y >= 0.0 else -1.0)
        y += p / q - bits[-1]
    again = [n for n in range(1, 2 * period) if bits[-10 * period :] == bits[-10 * period - n : -n]]
    assert again[0] == period


@pytest.mark.slow  # 20 s; the multipliers that it hangs on are tested with the others
def test_two_integrators_in_a_chain_have_continua_alone_in_any_form() -> None:
    """Each cycle of a modulator of second order is one of many, whatever its states measure."""
    found = epp.find_limit_cycles(
        epp.LureSystem.from_tf(signal.dlti([2.0, -1.0], [1.0, -2.0, 1.0], dt=1.0), epp.Comparator())
    )
    assert 0 < found.n_continua == len(found) < 20


@pytest.mark.slow
def test_each_cycle_of_a_digital_filter_is_listed() -> None:
    """Cycles that differ in size by whole steps of rounding are no continuum."""
    loop = epp.LureSystem.build(
        [[0.0, 0.0], [1.0, 0.0]], [[1.0], [0.0]], [[1.8 * np.cos(0.7) * 0.98, -0.95]], [epp.Quantiser(1.0, 40)],
        x0=[7.0, 3.0], time_step=1.0,
    )  # fmt: skip
    found = epp.find_limit_cycles(loop)
    sizes = sorted(round(c.peak_to_peak["quantiser_output"]) for c in found)
    # The filter's own iteration from all states of whole numbers up to 15.
    x = np.array([[a, b] for a in range(-15, 16) for b in range(-15, 16)], float)
    path = []
    for _ in range(600):
        x = np.column_stack([np.floor(1.8 * np.cos(0.7) * 0.98 * x[:, 0] - 0.95 * x[:, 1] + 0.5), x[:, 0]])
        path.append(x[:, 0])
    seen = {int(size) for size in np.ptp(path[-24:], axis=0)} - {0}
    assert seen <= set(sizes) and found.n_continua == 0


def filter_of_whole_numbers(a: float, b: float) -> epp.LureSystem:
    """A digital filter of second order whose sum is rounded to whole numbers."""
    return epp.LureSystem.build(
        [[0.0, 0.0], [1.0, 0.0]], [[1.0], [0.0]], [[a, b]], [epp.Quantiser(1.0, 60)], x0=[7.0, 3.0], time_step=1.0
    )


@pytest.mark.slow
@pytest.mark.parametrize(("damping", "status"), [(0.97, Status.UNDECIDED), (0.8, Status.CONVERGED)])
def test_a_search_that_meets_ever_other_cycles_says_that_there_are_more(damping: float, status: Status) -> None:
    """Poles just within the unit circle: rounding holds more cycles of six samples than runs meet."""
    loop = filter_of_whole_numbers(damping, -damping)
    found = epp.find_limit_cycles(loop)
    x = np.array([[a, b] for a in range(-50, 51) for b in range(-50, 51)], float)
    for _ in range(1200):
        rounded = np.sign(x[:, 0] - x[:, 1]) * np.floor(damping * np.abs(x[:, 0] - x[:, 1]) + 0.5)
        x = np.column_stack([np.clip(rounded, -60.0, 60.0), x[:, 0]])
    # Each cycle once, by the least of its six states (those that close after fewer are rest).
    ends, y = [], x
    for _ in range(6):
        rounded = np.sign(y[:, 0] - y[:, 1]) * np.floor(damping * np.abs(y[:, 0] - y[:, 1]) + 0.5)
        y = np.column_stack([np.clip(rounded, -60.0, 60.0), y[:, 0]])
        ends.append(1000.0 * y[:, 0] + y[:, 1])
    there = set(np.min(ends, axis=0)[np.ptp(ends, axis=0) > 0].tolist())
    listed = [c for c in found if c.period == 6.0]
    assert len(listed) < len(there) if status is Status.UNDECIDED else len(listed) >= len(there)
    assert found.status is status
    assert ("more cycles that runs end on are likely" in str(found)) == (status is Status.UNDECIDED)
    assert "with small basins may be missed" in str(found)


def test_what_first_order_predicts_twice_is_told_once_with_both_means() -> None:
    found = epp.find_limit_cycles(filter_of_whole_numbers(1.5, -0.9))
    alike = [c for c in found.unclosed if c.mean["quantiser_output"] > 1e-9]
    assert alike, "no prediction has a mirror image here"
    for cycle in alike:
        assert str(found).count(f"{cycle.peak_to_peak['quantiser_input']:.4g} peak to peak") == 1
    assert " about -" in str(found)


@pytest.mark.slow
def test_starts_reach_a_basin_with_a_twentieth_of_all_states() -> None:
    # Of 200 Sobol points in a box twice as large as the listed cycles, 8 run onto an orbit of 198 samples.
    system = problem("quantiser, sampled", 320).system
    found = epp.find_limit_cycles(system)
    assert {35, 198, 1253} <= {round(c.period / system.time_step) for c in found}
