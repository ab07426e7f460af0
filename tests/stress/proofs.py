"""Loops with a limit cycle, of kinds that certificates speak of: none may be proved to have none.

Each loop is taken at a gain near the least at which its cycle exists, where a proof that goes too far would succeed.
The cycle is an exact orbit of the engine; the certificate is asked for of the same loop, in states turned every second
time, and of a range of gains that ends there.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

import eppanalysis as epp
from eppanalysis.results import Status, Trajectory
from tests.stress.families import Rng, turned

Plant = tuple[np.ndarray, np.ndarray]
#: Runs of a loop that look for its cycle: how long [slowest time constants], and how large their starts are.
_LENGTH, _FAR, _NEAR = 80.0, 30.0, 0.1
#: Gains tried downward from the first, and halvings between the last with a cycle and the first without.
_DOWN, _STEPS, _HALVINGS = 0.75, 14, 5
#: Loops of a seed that are looked at for one with a cycle.
_MOST = 40
#: Sectors of a quarter plane with play: enough for two per cent of the onset.
_SECTORS = 16


def _lags(rng: Rng, count: int, integrators: int) -> np.ndarray:
    """A denominator of so many poles on the real axis, each of few digits."""
    rates = np.round(np.exp(rng.uniform(np.log(0.3), np.log(5.0), count - integrators)), 2)
    return np.poly([*-rates, *[0.0] * integrators])


def _with_zero(rng: Rng, den: np.ndarray) -> Plant:
    """A zero on either side of the origin."""
    return np.array([float(np.round(rng.uniform(-0.1, 0.4), 3)), 1.0]), den


def _any_lags(rng: Rng) -> Plant:
    return np.ones(1), _lags(rng, int(rng.integers(3, 5)), int(rng.integers(0, 2)))


def _swinging(rng: Rng) -> Plant:
    """A pair of poles that swings, beside lags."""
    rate, damping = np.round(np.exp(rng.uniform(-1.0, 1.0)), 2), np.round(rng.uniform(0.05, 0.8), 2)
    return np.ones(1), np.polymul([1.0, 2.0 * damping * rate, rate**2], _lags(rng, int(rng.integers(1, 3)), 0))


def _unstable(rng: Rng) -> Plant:
    """One pole to the right of the origin, beside two lags and a zero."""
    den = np.polymul(_lags(rng, 2, 0), [1.0, -float(np.round(rng.uniform(0.02, 0.3), 3))])
    return np.array([float(np.round(rng.uniform(0.1, 2.0), 2)), 1.0]), den


def _play(rng: Rng) -> epp.Play:
    return epp.Play(rng.uniform(0.2, 2.0))


def _saturation(rng: Rng) -> epp.Saturation:
    return epp.Saturation(-rng.uniform(0.2, 2.0), rng.uniform(0.2, 2.0))


def _relay_dead_zone(rng: Rng) -> epp.RelayDeadZone:
    return epp.RelayDeadZone(rng.uniform(0.1, 1.0), rng.uniform(0.2, 1.5))


#: What each family closes its loop with, and around.
PROVABLE: dict[str, tuple[Callable[[Rng], Any], Callable[[Rng], Plant]]] = {
    "play, second order": (_play, lambda r: (np.ones(1), _lags(r, 2, 1))),
    "play, third order": (_play, lambda r: (np.ones(1), _lags(r, 3, int(r.integers(0, 2))))),
    "play, third order with a zero": (_play, lambda r: _with_zero(r, _lags(r, 3, 1))),
    "play, swinging": (_play, _swinging),
    "saturation": (_saturation, _any_lags),
    "saturation, unstable pole": (_saturation, _unstable),
    "saturation behind a dead zone": (lambda r: epp.DeadZoneSaturation(r.uniform(0.1, 0.5), 2.0, 1.0), _any_lags),
    "quantiser": (lambda r: epp.Quantiser(r.uniform(0.1, 0.8), int(r.integers(2, 12))), _any_lags),
    "relay with dead zone": (_relay_dead_zone, _any_lags),
    "relay with dead zone, two lags, integrator": (_relay_dead_zone, lambda r: (np.ones(1), _lags(r, 3, 1))),
}


def proof(family: str, seed: int) -> dict[str, Any]:
    """Whether the first loop of a seed that has a cycle is proved to have none, and at which gain it still has it."""
    rng = np.random.default_rng([zlib.crc32(family.encode()), seed])
    for loop_number in range(_MOST):
        element, plant = (make(rng) for make in PROVABLE[family])
        found = _least_with_cycle(lambda gain, e=element, p=plant: _closed(gain, e, p), rng)
        if found is None:
            continue
        gain, orbit = found
        asked = _closed(gain, element, plant)
        if rng.random() < 0.5:
            asked = turned(asked, rng)
        certificate = epp.certify(asked, "absence", sectors=_SECTORS)
        case = epp.Case.from_system(_closed(1.0, element, plant))
        ranges = [
            epp.certify(case, "absence", within={"loop.gain": (low * gain, high * gain)}, sectors=_SECTORS).proved
            for low, high in ((0.2, 1.0), (0.1, 0.2))
        ]
        return {
            "family": family,
            "seed": seed,
            "outcome": "proved" if certificate.proved or ranges[0] else "not proved",
            "loops": loop_number + 1,
            "gain": gain,
            "period": orbit.period,
            "residual": orbit.residual,
            "covered": certificate.message.startswith("Not decided"),
            "far_below": ranges[1],
        }
    return {"family": family, "seed": seed, "outcome": "refused", "loops": _MOST}


def _closed(gain: float, element: Any, plant: Plant) -> epp.LureSystem:
    return epp.LureSystem.from_tf((gain * plant[0], plant[1]), element)


def _least_with_cycle(made: Callable[[float], epp.LureSystem], rng: Rng) -> tuple[float, epp.LimitCycle] | None:
    """The least gain tried at which an exact orbit exists, with the orbit."""
    scale = _border(made)
    start = rng.normal(size=made(1.0).A.shape[0])
    kept, without = None, 0.0
    for gain in _gains(scale):
        orbit = _orbit(made(gain), start)
        if orbit is None and kept is not None:
            without = gain
            break
        kept = kept if orbit is None else (gain, orbit)
    for _ in range(_HALVINGS if kept and without else 0):
        gain = float(f"{np.sqrt(kept[0] * without):.5g}")
        orbit = _orbit(made(gain), start)
        kept, without = (kept, gain) if orbit is None else ((gain, orbit), without)
    return kept


def _gains(scale: float) -> Iterator[float]:
    return (float(f"{2.0 * scale * _DOWN**k:.4g}") for k in range(_STEPS))


def _border(made: Callable[[float], epp.LureSystem]) -> float:
    """A gain beyond which the loop without its element is unstable; one in the middle where none is."""
    gains = np.geomspace(0.01, 1e3, 120)
    loops = (made(float(gain)) for gain in gains)
    stable = [np.max(np.linalg.eigvals(loop.A + loop.B @ loop.C).real) <= 0.0 for loop in loops]
    ends = np.flatnonzero(np.array(stable[:-1]) & ~np.array(stable[1:]))
    return float(gains[ends[-1] + 1]) if ends.size else 5.0


def _orbit(loop: epp.LureSystem, start: np.ndarray) -> epp.LimitCycle | None:
    """The exact orbit that a run from far out ends on, if it ends on one; from near, where motions far out grow."""
    poles = np.linalg.eigvals(loop.A)
    t_end = _LENGTH / float(np.min(np.abs(poles)[np.abs(poles) > 1e-9]))
    size = _NEAR if np.max(poles.real) > 1e-9 else _FAR
    run = epp.simulate(replace(loop, x0=size * start), t_end=t_end, max_events=20_000)
    return _closed_orbit(loop, run)


def _closed_orbit(loop: epp.LureSystem, run: Trajectory) -> epp.LimitCycle | None:
    if run.limit_cycle is None:
        return None
    orbit = epp.exact_orbit(loop, run.limit_cycle)
    return orbit if orbit.status is Status.CONVERGED else None
