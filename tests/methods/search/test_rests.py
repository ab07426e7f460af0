"""Searches name states of rest that few starts lead to; the witness is the closed form of a single mode."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import eppanalysis as epp
from tests.shared import mostly_slow
from tests.stress.families import problem, turned

#: Slip motions of a mass under PID: a swing that decays faster than one real motion does (a multiple of one, and more).
FADING, SWING = 0.25, 1.5


def _hunting(slowest: float) -> epp.LureSystem:
    """A mass that hunts under PID with static friction above Coulomb's, its slowest slip motion of a given rate."""
    kd, kp, ki = np.poly([-slowest, -FADING + 1j * SWING, -FADING - 1j * SWING]).real[1:]
    A = [[0.0, 1.0, 0.0], [-kp, -kd, -ki], [1.0, 0.0, 0.0]]
    return epp.LureSystem.build(
        A, [[0.0], [-1.0], [0.0]], [[0.0, 1.0, 0.0]], [epp.Friction(0.7, 0.9)], x0=[0.3, 0.2, -0.1]
    )


def _slips_for_ever(loop: epp.LureSystem, start: np.ndarray) -> bool:
    """Whether the slip from a start keeps its sense while it decays to a state of rest, by its eigenvectors."""
    rates, ways = np.linalg.eig(loop.A)
    sense = np.sign((loop.C @ start)[0])
    rest = -np.linalg.solve(loop.A, loop.B[:, 0] * loop.elements[0].coulomb * sense)
    shares = np.linalg.solve(ways, start - rest) * (loop.C @ ways)[0]
    t = np.linspace(0.0, 200.0, 40_001)
    # Beside the slowest motion the others vanish: what is left decides once they are a thousandth of it.
    speed = (shares[:, None] * np.exp((rates[:, None] - rates.real.max()) * t)).sum(axis=0).real
    return bool(np.all(sense * speed > 0.0)) and bool(np.all(rates.real < 0.0))


@pytest.mark.parametrize("slowest", [0.1, 0.2, 0.3])
@pytest.mark.parametrize("seed", mostly_slow([None, 1, 2], [None]))
def test_rest_on_the_edge_of_a_slip_is_named_where_a_slip_decays_to_it(slowest, seed):
    loop = _hunting(slowest)
    if seed is not None:
        loop = turned(loop, np.random.default_rng(seed))
    ways = np.linalg.eig(loop.A)[1]
    rates = np.linalg.eigvals(loop.A)
    k = int(np.argmax(rates.real))
    rest = -np.linalg.solve(loop.A, loop.B[:, 0] * 0.7)
    starts = [rest + s * ways[:, k].real for s in (0.5, -0.5) if s * (loop.C @ ways[:, k].real)[0] > 0]
    comes_to_rest = any(_slips_for_ever(loop, start) for start in starts)
    # Where the swing decays more slowly, no slip keeps its sense, and nothing but the cycle is come to.
    assert comes_to_rest == (slowest < FADING)
    found = epp.find_limit_cycles(loop)
    assert found.settles == comes_to_rest
    assert len(found.stable) == 1
    if comes_to_rest:
        assert epp.simulate(replace(loop, x0=starts[0]), t_end=400.0).status is epp.Status.SETTLED


def test_rest_in_a_narrow_band_is_named_where_all_other_starts_grow():
    loop = problem("jump and follow", 306).system
    found = epp.find_limit_cycles(loop)
    assert found.settles and found.diverges
    # While the element is stuck at zero the loop moves freely, by the matrix exponential: it never comes to the band's
    # edge, and its own motions are all but one of them damped, the last being an integrator that stands.
    rates, ways = np.linalg.eig(loop.A)
    start = 1e-3 * loop.x0
    free = (loop.C @ ways)[0] * np.linalg.solve(ways, start)
    passed = np.abs((free[:, None] * np.exp(rates[:, None] * np.linspace(0.0, 200.0, 20_001))).sum(axis=0))
    assert passed.max() < loop.elements[0].stick_band
    assert np.sort(rates.real)[-2] < 0.0 and abs(rates).min() < 1e-12


def test_rest_of_a_relay_that_stands_behind_a_dead_time_is_named():
    loop = problem("relay with hysteresis, dead time", 317).system
    found = epp.find_limit_cycles(loop)
    assert found.settles and len(found.stable) == 1
    # The plant is stable, and its constant answer to one of the two levels does not make the relay switch.
    relay = loop.elements[0]
    answers = [float((-loop.C @ np.linalg.solve(loop.A, loop.B))[0, 0]) * level for level in (relay.low, relay.high)]
    assert answers[0] > relay.lower or answers[1] < relay.upper
    assert np.linalg.eigvals(loop.A).real.max() < 0.0


def test_the_rest_that_a_run_creeps_to_is_handed_out():
    """A block that a belt carries rests where its spring holds the friction."""
    belt = epp.LureSystem.build(
        [[0.0, 1.0], [-1.0, -0.05]], [[0.0], [-1.0]], [[0.0, 1.0]], [epp.Friction(1.0, 1.4)], constant_input=[-0.2]
    )
    found = epp.find_limit_cycles(belt)
    assert found.settles and len(found.stable) == 1
    assert found.rest_state == pytest.approx([1.0, 0.0])


@pytest.mark.parametrize("seed", mostly_slow([None, 5, 8], [None]))
def test_rest_that_a_motion_could_only_swing_to_is_not_named(seed):
    """A double integrator behind a play that holds drifts; in contact the loop swings, and leaves it before rest."""
    loop = epp.LureSystem.from_blocks([epp.Play(0.8), ([4.0, 1.5], [1.0, 7.0, 0.0, 0.0])])
    assert np.iscomplex(max(np.roots([1.0, 7.0, 4.0, 1.5]), key=np.real))
    found = epp.find_limit_cycles(loop if seed is None else turned(loop, np.random.default_rng(seed)))
    assert len(found) == 1 and not found.settles


@pytest.mark.parametrize(("detuning", "rests"), mostly_slow([(0.6, True), (1.3, False)], [(0.6, True)]))
def test_a_phase_locked_loop_rests_within_its_hold_range_alone(detuning: float, rests: bool) -> None:
    """A sine has no threshold and its loop no gain of one: no run was made; a slip for ever drifts, and is no rest."""
    loop = epp.LureSystem.build(
        [[0.0, -1.0], [0.0, -0.5]], [[-0.1], [0.45]], [[1.0, 0.0]], [epp.Sine(1.0)], constant_state=[detuning, 0.0]
    )
    found = epp.find_limit_cycles(loop)
    assert found.n_runs > 0 and not len(found)
    assert found.settles is rests
    assert (found.status is epp.Status.CONVERGED) is rests
    if rests:
        assert np.sin(found.rest_state[0]) == pytest.approx(detuning, abs=1e-6)


@pytest.mark.parametrize("seed", [None, 0, 1, 3])
def test_rest_on_the_edge_of_a_gap_is_named_in_all_coordinates(seed):
    """In contact all motions of (6s + 2)/(s(s - 0.2)(s + 4)) decay, the slowest without a swing: from one side the play
    keeps its contact up to rest. Beyond that rounding opens the gap, in which motions grow.
    """
    plant = np.polymul([1.0, -0.2, 0.0], [1.0, 4.0])
    rates = np.roots(np.polyadd(plant, [6.0, 2.0]))
    assert np.all(rates.real < 0.0) and rates[np.argmax(rates.real)].imag == 0.0
    loop = epp.LureSystem.from_tf(([6.0, 2.0], plant), epp.Play(0.6))
    found = epp.find_limit_cycles(loop if seed is None else turned(loop, np.random.default_rng(seed)))
    assert found.settles and found.status is epp.Status.CONVERGED and len(found.stable) == len(found) == 1


def test_a_decay_to_the_edge_of_a_gap_takes_no_more_than_its_time():
    """Where a run that has nearly decayed ends on a gap's edge its rate foretold a slip after a million seconds."""
    first, second = ([2.0, 1.0], [1.0, 1.0, 0.0]), ([1.0], [0.2, 1.0])
    found = epp.find_limit_cycles(epp.LureSystem.from_blocks([epp.Saturation(-1.0, 1.0), first, epp.Play(0.5), second]))
    assert found.status is epp.Status.CONVERGED and found.settles and not found


@pytest.mark.slow
@pytest.mark.parametrize("damping", [0.5, -0.5])
def test_switches_that_accumulate_are_rest_only_where_zeros_decay(
    damping: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A relay on two poles more than zeros switches ever faster, then slides as the zeros say: to rest or away.

    A tenth of the steps that a search has is enough to see it.
    """
    monkeypatch.setattr("eppanalysis.methods.search.find._MOST_WORK", 2e6)
    system = epp.LureSystem.from_tf(([1.0, damping, 2.0], np.poly([-1.0, -2.0, -0.5, -1.5])), epp.Relay())
    assert epp.find_limit_cycles(system).settles is (damping > 0.0)
