"""Random loops by family: what engineers close loops around, each with the elements that belong there.

A family makes the loop of a seed, the same one for ever. States are turned by a random orthogonal matrix every second
time, so that no method gains from coordinates in which a loop happens to have been written down.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import scipy.linalg
import scipy.signal

import eppanalysis as epp
from eppanalysis.models.systems.signals import SignalMap

Rng = np.random.Generator
Fraction = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Problem:
    """A loop, the steps of its input, and how long it is worth running [s]."""

    system: epp.LureSystem
    t_end: float
    steps: Mapping[str, epp.inputs.Step] = field(default_factory=dict)


def _poles(rng: Rng, count: int, integrators: int = 0, resonant: bool = False, unstable: bool = False) -> np.ndarray:
    """Poles between 0.3 and 5 rad/s, real or in pairs."""
    poles: list[complex] = [0.0] * integrators
    while len(poles) < count:
        speed = float(np.exp(rng.uniform(np.log(0.3), np.log(5.0))))
        if len(poles) + 2 <= count and (resonant or rng.random() < 0.4):
            damping = rng.uniform(0.02, 0.15) if resonant else rng.uniform(0.2, 0.9)
            pair = speed * (-damping + 1j * np.sqrt(1.0 - damping**2))
            poles += [pair, pair.conjugate()]
            resonant = False
        else:
            poles.append(speed if unstable else -speed)
            unstable = False
    return np.array(poles)


def _plant(rng: Rng, order: int, degree: int, **kind: bool | int) -> Fraction:
    """Transfer function with so many more poles than zeros; gain one at the frequency in the middle."""
    behind = bool(kind.pop("nonminimum", False))
    poles = _poles(rng, order, **kind)
    zeros = -np.exp(rng.uniform(np.log(0.3), np.log(8.0), order - degree))
    if behind and zeros.size:
        zeros[0] = -zeros[0] * 2.0
    numerator, denominator = np.atleast_1d(np.real(np.poly(zeros))), np.real(np.poly(poles))
    middle = 1j * float(np.exp(np.mean(np.log(np.maximum(np.abs(poles), 0.3)))))
    gain = np.exp(rng.uniform(np.log(0.5), np.log(6.0))) / abs(
        np.polyval(numerator, middle) / np.polyval(denominator, middle)
    )
    sign = -1.0 if behind and zeros.size and rng.random() < 0.5 else 1.0
    return sign * gain * numerator, denominator


def _size(rng: Rng, low: float = 0.2, high: float = 1.5) -> float:
    return float(rng.uniform(low, high))


def with_states(system: epp.LureSystem) -> epp.LureSystem:
    """The loop with its states as signals: they are continuous, outputs jump."""
    n, nw, nv = system.A.shape[0], system.B.shape[1], len(system.input_names)
    names = tuple(f"x{i}" for i in range(n))
    signals = SignalMap(names, np.eye(n), np.zeros((n, nw)), np.zeros((n, nv)), np.zeros(n), ("",) * n)
    return replace(system, signals=signals)


def turned(system: epp.LureSystem, rng: Rng) -> epp.LureSystem:
    """The same loop in states turned by a random orthogonal matrix."""
    Q = scipy.linalg.qr(rng.normal(size=system.A.shape))[0]
    return system.in_coordinates(Q.T, Q)


def _ring(
    rng: Rng,
    elements: list[epp.Nonlinearity],
    plant: Fraction,
    *,
    bias: float = 0.0,
    delay: float = 0.0,
    step: bool = False,
) -> epp.LureSystem:
    """One element before a plant, or elements in parallel on it, with an input at the summing point."""
    A, B, C, _ = scipy.signal.tf2ss(*plant)
    n, count = A.shape[0], len(elements)
    share = np.ones(count) / count if count > 1 else np.ones(1)
    return epp.LureSystem.build(
        A, B @ share[None, :], -np.repeat(C, count, axis=0), elements, x0=rng.normal(size=n) * rng.choice([0.3, 2.0]),
        constant_input=np.full(count, bias), delays=np.full(count, delay),
        input_names=["reference"] if step else [], B_input=np.zeros((n, 1)) if step else None,
        D_input=np.ones((count, 1)) if step else None,
    )  # fmt: skip


def _single(
    element: Callable[[Rng], epp.Nonlinearity], degree: int = 2, **options: object
) -> Callable[[Rng], epp.LureSystem]:
    """Family of one element: order 2 to 8 behind it."""
    ring = {k: options.pop(k) for k in ("bias", "delay", "step") if k in options}

    def make(rng: Rng) -> epp.LureSystem:
        integrators = int(options.get("integrators", 0))
        order = int(rng.integers(max(degree, 2 + integrators), 9))
        extra: dict = {k: (v(rng) if callable(v) else v) for k, v in ring.items()}
        return _ring(rng, [element(rng)], _plant(rng, order, degree, **options), **extra)

    return make


def _cascade(
    first: Callable[[Rng], epp.Nonlinearity], second: Callable[[Rng], epp.Nonlinearity]
) -> Callable[[Rng], epp.LureSystem]:
    """Two elements straight behind one another before the plant."""

    def make(rng: Rng) -> epp.LureSystem:
        A, B, C, _ = scipy.signal.tf2ss(*_plant(rng, int(rng.integers(3, 7)), 3))
        n = A.shape[0]
        return epp.LureSystem.build(
            A, np.hstack([np.zeros((n, 1)), B]), np.vstack([-C, np.zeros((1, n))]), [first(rng), second(rng)],
            D=[[0.0, 0.0], [1.0, 0.0]], x0=rng.normal(size=n), constant_input=[0.1 * rng.normal(), 0.0],
        )  # fmt: skip

    return make


def _friction(rng: Rng) -> epp.LureSystem:
    """A mass with dry friction under PID control: static friction above Coulomb's, a bias force."""
    mass, kp, kd, ki = rng.uniform(0.5, 2.0), rng.uniform(1.0, 4.0), rng.uniform(0.1, 1.0), rng.uniform(0.0, 0.6)
    coulomb = _size(rng)
    A = [[0.0, 1.0, 0.0], [-kp / mass, -kd / mass, -ki / mass], [1.0, 0.0, 0.0]]
    return epp.LureSystem.build(
        A, [[0.0], [-1.0 / mass], [0.0]], [[0.0, 1.0, 0.0]], [epp.Friction(coulomb, coulomb * rng.uniform(1.05, 1.6))],
        x0=rng.normal(size=3) * 2.0, constant_state=[0.0, 0.2 * rng.normal() / mass, 0.0],
    )  # fmt: skip


def _belt(rng: Rng) -> epp.LureSystem:
    """A block on a spring on a running belt with friction that falls with the speed."""
    mass, spring, damping, speed = 1.0, rng.uniform(0.5, 3.0), rng.uniform(0.0, 0.05), rng.uniform(0.1, 1.0)
    coulomb = _size(rng)
    return epp.LureSystem.build(
        [[0.0, 1.0], [-spring / mass, -damping / mass]], [[0.0], [-1.0 / mass]], [[0.0, 1.0]],
        [epp.Friction(coulomb, coulomb, rng.uniform(0.3, 2.0))], constant_input=[-speed], x0=rng.normal(size=2),
    )  # fmt: skip


def _coupled(rng: Rng) -> epp.LureSystem:
    """Two or three elements on random full matrices."""
    n, count = int(rng.integers(3, 9)), int(rng.integers(2, 4))
    makers = (_saturation, _dead_zone, _play, _hysteresis_relay, _quantiser, _three_level, _jump_and_follow)
    elements = [makers[rng.integers(len(makers))](rng) for _ in range(count)]
    damping, speed = rng.uniform(-0.02, 0.8, n // 2), rng.uniform(0.3, 5.0, n // 2)
    pairs = [[[-d * s, s], [-s, -d * s]] for d, s in zip(damping, speed, strict=True)]
    blocks = scipy.linalg.block_diag(*pairs)
    A = scipy.linalg.block_diag(blocks, -np.eye(n % 2)) if n % 2 else blocks
    B, C = rng.normal(size=(n, count)), rng.normal(size=(count, n))
    return epp.LureSystem.build(A, B, C, elements, x0=rng.normal(size=n), constant_state=0.2 * rng.normal(size=n))


def _sampled(element: Callable[[Rng], epp.Nonlinearity]) -> Callable[[Rng], epp.LureSystem]:
    """A plant behind a zero-order hold: a loop in discrete time."""

    def make(rng: Rng) -> epp.LureSystem:
        loop = _ring(rng, [element(rng)], _plant(rng, int(rng.integers(2, 6)), 2), bias=0.3 * rng.normal())
        period = float(rng.choice([0.05, 0.1, 0.2]))
        n = loop.A.shape[0]
        whole = scipy.linalg.expm(period * np.block([[loop.A, loop.B], [np.zeros((1, n + 1))]]))
        return replace(loop, A=whole[:n, :n], B=whole[:n, n:], time_step=period)

    return make


def _saturation(r: Rng) -> epp.Nonlinearity:
    return epp.Saturation(-_size(r), _size(r), r.uniform(0.5, 4.0))


def _dead_zone(r: Rng) -> epp.Nonlinearity:
    return epp.DeadZone(-_size(r), _size(r), r.uniform(0.5, 3.0))


def _play(r: Rng) -> epp.Nonlinearity:
    return epp.Play(_size(r, 0.2, 2.0))


def _hysteresis_relay(r: Rng) -> epp.Nonlinearity:
    return epp.HysteresisRelay(-_size(r, 0.02, 0.8), _size(r, 0.02, 0.8), -_size(r), _size(r))


def _quantiser(r: Rng) -> epp.Nonlinearity:
    return epp.Quantiser(_size(r, 0.1, 0.8), int(r.integers(2, 12)))


def _three_level(r: Rng) -> epp.Nonlinearity:
    off = _size(r, 0.1, 0.5)
    return epp.HysteresisRelayDeadZone(off + _size(r, 0.02, 0.4), off, _size(r))


def _jump_and_follow(r: Rng) -> epp.Nonlinearity:
    return epp.JumpAndFollow(_size(r, 0.4, 1.5), _size(r, 0.02, 0.3))


def _relay(r: Rng) -> epp.Nonlinearity:
    return epp.Relay(-1.0, 1.0)


def _relay_dead_zone(r: Rng) -> epp.Nonlinearity:
    return epp.RelayDeadZone(_size(r, 0.1, 1.0), _size(r))


def _five_band(r: Rng) -> epp.Nonlinearity:
    low, high = -_size(r, 0.05, 0.5), _size(r, 0.05, 0.5)
    return epp.FiveBandLaw(low - _size(r), low, high, high + _size(r), 2.0)


#: What makes each family's loops.
FAMILIES: dict[str, Callable[[Rng], epp.LureSystem]] = {
    "relay on lags": _single(_relay),
    "asymmetric relay": _single(lambda r: epp.Relay(-_size(r), _size(r), 0.2 * r.normal())),
    "relay with hysteresis": _single(_hysteresis_relay, 1),
    "relay with hysteresis, integrator": _single(_hysteresis_relay, 1, integrators=1),
    "relay with hysteresis, non-minimum phase": _single(_hysteresis_relay, 1, nonminimum=True),
    "relay with dead zone": _single(_relay_dead_zone),
    "relay with dead zone, integrator": _single(_relay_dead_zone, 2, integrators=1),
    "three levels with hysteresis": _single(_three_level, 1, integrators=1),
    "saturation": _single(_saturation),
    "saturation, unstable pole": _single(_saturation, 2, unstable=True),
    "saturation, resonance": _single(_saturation, 2, resonant=True),
    "saturation, biased": _single(_saturation, 2, bias=lambda r: 0.4 * r.normal()),
    "dead zone, non-minimum phase": _single(_dead_zone, 1, nonminimum=True),
    "dead zone, resonance": _single(_dead_zone, 2, resonant=True),
    "dead zone and saturation": _single(lambda r: epp.DeadZoneSaturation(_size(r, 0.1, 0.5), 2.0, _size(r))),
    "preload": _single(lambda r: epp.Preload(_size(r), r.uniform(0.3, 1.5))),
    "quantiser": _single(_quantiser),
    "quantiser, integrator, biased": _single(_quantiser, 2, integrators=1, bias=lambda r: 0.4 * r.normal()),
    "play, integrator": _single(_play, 2, integrators=1),
    "play, resonance": _single(_play, 2, resonant=True),
    "play, step of the input": _single(_play, 2, integrators=1, step=True),
    "jump and follow": _single(_jump_and_follow, 2, integrators=1),
    "jump and follow, step of the input": _single(_jump_and_follow, 2, step=True),
    "five bands": _single(_five_band, 2, integrators=1),
    "friction under PID": _friction,
    "friction on a belt": _belt,
    "cube": _single(lambda r: epp.Cube(_size(r)), 1),
    "tanh, deep in saturation": _single(
        lambda r: epp.Tanh(_size(r), float(np.exp(r.uniform(np.log(3.0), np.log(100.0)))))
    ),
    "sine": _single(lambda r: epp.Sine(_size(r)), 2, resonant=True),
    "saturation before play": _cascade(_saturation, _play),
    "relay with hysteresis before play": _cascade(_hysteresis_relay, _play),
    "quantiser before jump and follow": _cascade(_quantiser, _jump_and_follow),
    "two or three elements": _coupled,
    "relay with hysteresis, step of the input": _single(_hysteresis_relay, 1, step=True),
    "relay with hysteresis, dead time": _single(_hysteresis_relay, 1, delay=lambda r: r.uniform(0.1, 1.0)),
    "saturation, dead time": _single(_saturation, 1, delay=lambda r: r.uniform(0.1, 1.0)),
    "play, dead time": _single(_play, 2, delay=lambda r: r.uniform(0.1, 1.0)),
    "saturation, sampled": _sampled(_saturation),
    "play, sampled": _sampled(_play),
    "quantiser, sampled": _sampled(_quantiser),
}


def problem(family: str, seed: int) -> Problem:
    """The problem of a family and a seed.

    Raises
    ------
    KeyError
        If there is no such family.
    """
    make = FAMILIES[family]
    rng = np.random.default_rng([zlib.crc32(family.encode()), seed])
    system = make(rng)
    if rng.random() < 0.5:
        system = turned(system, rng)
    t_end = 12.0
    steps = {n: epp.inputs.Step(float(rng.normal() * 2.0), float(rng.uniform(0.5, 6.0))) for n in system.input_names}
    return Problem(replace(with_states(system), name=f"{family} {seed}"), t_end, steps)
