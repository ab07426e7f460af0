"""Records of eight mechanisms by an integrator of its own, and how often a diagnosis names the right one.

Every loop is written here once more as a state space and stepped with the element's output held over a thousandth
of a period (matrix exponentials of scipy): nothing of it is the package's engine. Each record has another size of the
element, other parameters of the plant within a per cent, another start, length, sampling, and two per cent of noise.

    python -m studies.diagnose          the table of the page, and the record that ships
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

import eppanalysis as epp
from eppanalysis.diagnose import explained
from eppanalysis.diagnose.candidates import Candidates, candidates_of
from eppanalysis.diagnose.record import oscillation_of, record_of
from eppanalysis.models.systems.subject import standing
from studies import STORED

Array = NDArray[np.float64]

#: Steps of the integrator in a period, periods before the record begins, relative spread of the plant, noise.
_STEPS, _SETTLING, _SPREAD, NOISE = 1000, 15.0, 0.01, 0.02
SEED, RECORDS = 20261123, 25


def held(A: Array, B: Array, C: Array, element: Callable[[float], float], x: Array, dt: float, n: int) -> Array:
    """States of ``dx/dt = A x + B w, w = element(C x)``, w held over every step, shape (n, states)."""
    k = len(A)
    both = expm(dt * np.block([[A, B[:, None]], [np.zeros((1, k + 1))]]))
    F, g = both[:k, :k], both[:k, k]
    out = np.empty((n, k))
    for i in range(n):
        out[i] = x
        x = F @ x + g * element(float(C @ x))
    return out


def play(gap: float) -> Callable[[float], float]:
    """Output pushed by its input."""
    y = 0.0

    def step(x: float) -> float:
        nonlocal y
        y = min(max(y, x - gap / 2), x + gap / 2)
        return y

    return step


def stiction(band: float, jump: float) -> Callable[[float], float]:
    """Choudhury, Thornhill and Shah's valve: stuck since a reversal until the input has moved by the band."""
    y, stuck, reversal, before, way = 0.0, True, 0.0, 0.0, 0.0

    def step(x: float) -> float:
        nonlocal y, stuck, reversal, before, way
        move = x - before
        if not stuck and move * way < 0.0:
            stuck, reversal = True, before
        if stuck and abs(x - reversal) > band:
            stuck, way = False, np.sign(x - reversal)
        if not stuck:
            y = x - way * (band - jump) / 2
        before = x
        return y

    return step


def rate_limit(rate: float, dt: float) -> Callable[[float], float]:
    """Output that follows no faster than the rate."""
    y = 0.0

    def step(x: float) -> float:
        nonlocal y
        y += min(max(x - y, -rate * dt), rate * dt)
        return y

    return step


def with_friction(p: dict[str, float], coulomb: float, static: float, x: Array, dt: float, n: int) -> Array:
    """A mass under PID with friction, stuck or sliding; the states are position, speed and the integral."""
    A = np.array([[0.0, 1.0, 0.0], [-p["kp"], -p["kd"], -p["ki"]], [1.0, 0.0, 0.0]])
    both = expm(dt * np.block([[A, np.array([[0.0], [1.0], [0.0]])], [np.zeros((1, 4))]]))
    F, g = both[:3, :3], both[:3, 3]
    out, way = np.empty((n, 3)), 1.0
    for i in range(n):
        out[i] = x
        if way == 0.0:
            force = A[1] @ x
            if abs(force) <= static:
                x = np.array([x[0], 0.0, x[2] + dt * x[0]])
                continue
            way = float(np.sign(force))
        x = F @ x - g * coulomb * way
        if x[1] * way <= 0.0:
            way, x = 0.0, np.array([x[0], 0.0, x[2]])
    return out


def tank(rng: np.random.Generator, gain: float = 1.0) -> tuple[Array, Array, Array]:
    """Level, its rate and the controller's integral; the command is the input of the valve."""
    kp, ti, lag, k = _near(rng, 0.5 * gain, 10.0, 1.5, 1.0)
    A = np.array([[0.0, 1.0, 0.0], [0.0, -1.0 / lag, 0.0], [-1.0, 0.0, 0.0]])
    return A, np.array([0.0, k / lag, 0.0]), np.array([-kp, 0.0, kp / ti])


def process(rng: np.random.Generator, gain: float = 12.0) -> tuple[Array, Array, Array]:
    """Three lags behind each other; what the actuator gets is minus the last times the gain."""
    k, a, b, c = _near(rng, gain, 1.0, 1.0, 1.0)
    A = np.array([[-1 / a, 0.0, 0.0], [1 / b, -1 / b, 0.0], [0.0, 1 / c, -1 / c]])
    return A, np.array([1 / a, 0.0, 0.0]), np.array([0.0, 0.0, -k])


def servo(rng: np.random.Generator, gain: float = 5.6) -> tuple[Array, Array, Array]:
    """A motor with two lags: angle, speed and torque; its encoder sees the angle."""
    k, a, b = _near(rng, gain, 1.0, 0.5)
    A = np.array([[0.0, 1.0, 0.0], [0.0, -1 / a, 1 / a], [0.0, 0.0, -1 / b]])
    return A, np.array([0.0, 0.0, -0.5 * k / b]), np.array([1.0, 0.0, 0.0])


def _near(rng: np.random.Generator, *values: float) -> tuple[float, ...]:
    return tuple(float(v * np.exp(_SPREAD * rng.normal())) for v in values)


def _size(rng: np.random.Generator) -> float:
    return float(np.exp(rng.uniform(np.log(0.3), np.log(3.0))))


def _cycle(
    period: float, run: Callable[[float, int], dict[str, Array]], rng: np.random.Generator
) -> tuple[dict[str, Array], float]:
    """A part of a long run, sampled: its rough period is known so that steps are short enough."""
    dt = period / _STEPS
    length = rng.uniform(8.0, 25.0)
    n = int((_SETTLING + length) * _STEPS)
    signals = run(dt, n)
    every = int(_STEPS / rng.integers(40, 160))
    chosen = slice(int(_SETTLING * _STEPS) + int(rng.integers(_STEPS)), None, every)
    return {name: values[chosen] for name, values in signals.items()}, every * dt


def noisy(signals: dict[str, Array], dt: float, rng: np.random.Generator) -> dict[str, Array]:
    """Signals with two per cent of noise, and their times."""
    n = len(next(iter(signals.values())))
    dirty = {
        name: v + NOISE * float(v.std()) * rng.normal(size=n) + float(rng.normal()) * float(v.std())
        for name, v in signals.items()
    }
    return {"time": rng.uniform(0.0, 1e3) + dt * np.arange(n), **dirty}


def of_tank(kind: str, rng: np.random.Generator) -> tuple[dict[str, Array], float]:
    """A record of the tank, and the true size of the element."""
    A, B, C = tank(rng)
    factor = _size(rng)
    if kind == "play":
        element, period, size = play(2e-3 * factor), 34.1, 2e-3 * factor
    else:
        element, period, size = stiction(2e-3 * factor, 0.8e-3 * factor), 20.6, 2e-3 * factor
    start = np.array([5e-3 * factor, 0.0, 0.0])

    def run(dt: float, n: int) -> dict[str, Array]:
        x = held(A, B, C, element, start, dt, n)
        return {"level": x[:, 0], "command": x @ C}

    signals, dt = _cycle(period, run, rng)
    return noisy(signals, dt, rng), size


def of_process(kind: str, rng: np.random.Generator) -> tuple[dict[str, Array], float]:
    """A record of the process whose gain is too high."""
    A, B, C = process(rng)
    factor = _size(rng)
    period = 3.645 if kind == "saturation" else 9.688

    def run(dt: float, n: int) -> dict[str, Array]:
        element = (lambda u: min(max(u, -factor), factor)) if kind == "saturation" else rate_limit(factor, dt)
        x = held(A, B, C, element, np.array([factor, 0.0, 0.0]), dt, n)
        return {"flow": x[:, 2], "command": x @ C}

    signals, dt = _cycle(period, run, rng)
    return noisy(signals, dt, rng), factor


def of_encoder(rng: np.random.Generator) -> tuple[dict[str, Array], float]:
    """A record of the servo with a coarse encoder: angle, torque."""
    A, B, C = servo(rng)
    step = _size(rng)

    def run(dt: float, n: int) -> dict[str, Array]:
        x = held(A, B, C, lambda z: step * np.floor(z / step + 0.5), np.array([step, 0.0, 0.0]), dt, n)
        return {"angle": x[:, 0], "torque": x[:, 2]}

    signals, dt = _cycle(4.46, run, rng)
    return noisy(signals, dt, rng), step


def of_friction(rng: np.random.Generator) -> tuple[dict[str, Array], float]:
    """A record of the slide that hunts: position and speed."""
    p = dict(zip(("kp", "kd", "ki"), _near(rng, 10.0, 1.0, 5.0), strict=True))
    coulomb = _size(rng)

    def run(dt: float, n: int) -> dict[str, Array]:
        x = with_friction(p, coulomb, 2.0 * coulomb, np.array([0.1 * coulomb, 0.0, 0.0]), dt, n)
        return {"position": x[:, 0], "integral": x[:, 2]}

    signals, dt = _cycle(12.0, run, rng)
    return noisy(signals, dt, rng), coulomb


def of_instability(rng: np.random.Generator) -> tuple[dict[str, Array], float]:
    """A record of the servo with a gain that is too high: it grows without a bound."""
    gain = rng.uniform(6.2, 7.0)
    A, B, C = servo(rng, gain)
    n, dt = int(4.4 * rng.uniform(10.0, 20.0) / 0.05), 0.05
    x = held(A + np.outer(B, C), 0.0 * B, C, lambda _: 0.0, np.array([1e-3, 0.0, 0.0]), dt, n + 400)[400:]
    return noisy({"angle": x[:, 0], "torque": x[:, 2]}, dt, rng), gain / 5.6


def of_disturbance(rng: np.random.Generator) -> tuple[dict[str, Array], float]:
    """A record of the tank whose inflow swings."""
    A, B, C = tank(rng)
    closed, period = A + np.outer(B, C), float(np.exp(rng.uniform(np.log(8.0), np.log(100.0))))
    s = 2j * np.pi / period
    x = np.linalg.solve(s * np.eye(3) - closed, B)
    dt = period / rng.integers(40, 160)
    t = dt * np.arange(int(rng.uniform(8.0, 25.0) * period / dt))
    swing = np.exp(s * t + 1j * rng.uniform(0.0, 6.0)) * _size(rng) * 1e-3
    return noisy({"level": np.real(x[0] * swing), "command": np.real((C @ x) * swing)}, dt, rng), period


def _process_loop() -> epp.Diagram:
    return epp.Diagram(
        parts={
            "controller": epp.blocks.Gain(gain=12.0),
            "amplifier": epp.Saturation(-1.0, 1.0),
            "drive": epp.RateLimiter(1.0),
            "plant": epp.blocks.TransferFunction(num=[1.0], den=[1.0, 3.0, 3.0, 1.0]),
            "linkage": epp.Play(0.1),
        },
        connect=["load - linkage -> controller", "controller -> amplifier", "amplifier -> drive", "drive -> plant",
                 "plant -> linkage"],
        inputs=["load"],
        signals={"flow": "plant", "command": "controller"},
    )  # fmt: skip


def _servo_loop() -> epp.Diagram:
    return epp.Diagram(
        parts={
            "gain": epp.blocks.Gain(gain=2.8),
            "lag": epp.blocks.TransferFunction(num=[1.0], den=[0.5, 1.0]),
            "motor": epp.blocks.TransferFunction(num=[1.0], den=[1.0, 1.0, 0.0]),
            "gear": epp.Play(0.5),
            "encoder": epp.Quantiser(step=1.0, levels=20),
            "amplifier": epp.Saturation(-50.0, 50.0),
        },
        connect=["-encoder -> gain", "gain -> amplifier", "amplifier -> lag", "lag -> motor", "motor -> gear",
                 "gear -> encoder"],
        signals={"angle": "motor", "torque": "lag"},
    )  # fmt: skip


def _slide_loop() -> epp.LureSystem:
    from eppanalysis.models.systems.signals import SignalMap

    A, C = [[0, 1, 0], [0, -1, -5], [0, 0, 0]], [[0, 1, 0], [1, 0, 0], [0, 0, 0]]
    seen = SignalMap(
        ("position", "integral"), np.array([[1.0, 0, 0], [0, 0, 1.0]]), np.zeros((2, 3)), np.zeros((2, 0)), np.zeros(2)
    )
    return epp.LureSystem.build(
        A, [[0, 0, 0], [-1, 0, -10], [0, 0, 1]], C, [epp.Friction(1.0, 2.0), epp.Play(0.1), epp.Quantiser(0.1, 100)],
        D=[[0, 0, 0], [0, 0, 0], [0, 1, 0]], element_names=["friction", "gear", "encoder"], signals=seen,
        x0=[0.1, 0.0, 0.0], name="slide",
    )  # fmt: skip


def _two_limits() -> epp.Diagram:
    return epp.Diagram(
        parts={
            "controller": epp.blocks.Gain(gain=12.0),
            "amplifier": epp.Saturation(-1.0, 1.0),
            "valve": epp.Saturation(-2.0, 2.0),
            "plant": epp.blocks.TransferFunction(num=[1.0], den=[1.0, 3.0, 3.0, 1.0]),
        },
        connect=["-plant -> controller", "controller -> amplifier", "amplifier -> valve", "valve -> plant"],
        signals={"flow": "plant", "command": "controller"},
    )  # fmt: skip


LOOPS: dict[str, Callable[[], object]] = {
    "tank": lambda: epp.case("level_valve"),
    "process": _process_loop,
    "servo": _servo_loop,
    "slide": _slide_loop,
    "two limits": _two_limits,
}

#: What should be named, in which loop, by which records, and the field of which the true value is known.
MECHANISMS: dict[str, tuple[str, str, Callable[[np.random.Generator], tuple[dict[str, Array], float]], str]] = {
    "backlash": ("linkage", "tank", lambda rng: of_tank("play", rng), "gap"),
    "stiction": ("stem", "tank", lambda rng: of_tank("stiction", rng), "stick_band"),
    "quantiser": ("encoder", "servo", of_encoder, "step"),
    "friction and integral action": ("friction", "slide", of_friction, "coulomb"),
    "saturation": ("amplifier", "process", lambda rng: of_process("saturation", rng), "upper"),
    "rate limit": ("drive", "process", lambda rng: of_process("rate limit", rng), "rate"),
    "linear instability": ("linear instability", "servo", of_instability, "gain"),
    "external disturbance": ("external disturbance", "tank", of_disturbance, ""),
}
#: Records that two elements explain alike.
ALIKE: dict[str, tuple[str, str, Callable[[np.random.Generator], tuple[dict[str, Array], float]], str]] = {
    "one of two limits": ("amplifier", "two limits", lambda rng: of_process("saturation", rng), "upper"),
}
ALL = MECHANISMS | ALIKE


@cache
def candidates(loop: str) -> tuple[Candidates, epp.LureSystem]:
    """Candidates of a loop; its cycles are sought once."""
    system, at = standing(LOOPS[loop](), None, "diagnose")
    return candidates_of(system, at), system


def diagnosed(mechanism: str, number: int, model_error: float = 0.02) -> tuple[epp.Diagnosis, float]:
    """The diagnosis of one record, and the true size of its element."""
    _, loop, run, _ = ALL[mechanism]
    given, size = run(np.random.default_rng([SEED, list(ALL).index(mechanism), number]))
    found, system = candidates(loop)
    units = dict.fromkeys(system.signals.names, "")
    record = record_of(given, units)
    return explained(found, system, record, oscillation_of(record), model_error), size


def judged(mechanism: str, found: epp.Diagnosis, size: float) -> tuple[str, bool | None]:
    """Named rightly, wrongly, or not told; and whether the interval holds the true size."""
    name, _, _, field = ALL[mechanism]
    if found.verdict != "named":
        return (found.verdict if name in found.names or not found.names else "wrong among several"), None
    if found.names[0] != name:
        return "wrong", None
    if not field:
        return "right", None
    _, low, high = found[0].fields[field]
    return "right", bool(low <= size <= high)


def rows(records: int = RECORDS) -> Iterator[dict[str, object]]:
    """For every mechanism how its records were judged."""
    for mechanism in ALL:
        ends: Counter[str] = Counter()
        inside: list[bool] = []
        for number in range(records):
            found, size = diagnosed(mechanism, number)
            end, holds = judged(mechanism, found, size)
            ends[end] += 1
            inside += [holds] if holds is not None else []
            if end != "right":
                print(mechanism, number, end, found, file=sys.stderr)
        yield {
            "mechanism": mechanism,
            **{str(end): count for end, count in ends.items()},
            "interval holds": f"{sum(inside)} of {len(inside)}" if inside else "-",
        }


def shipped_record() -> str:
    """The record of the tank that ships: backlash, in the units of a plant."""
    given, _ = of_tank("play", np.random.default_rng([SEED, 99]))
    remark = f"# Synthetic: studies/diagnose.py, seed {SEED}; no plant was measured."
    lines = [remark, "time [s],level [mm],command [mm]"]
    t = given["time"] - given["time"][0]
    for row in zip(t, 1e3 * given["level"], 1e3 * given["command"], strict=True):
        lines.append(",".join(f"{value:.4f}" for value in row))
    return "\n".join(lines) + "\n"


_COLUMNS = ("right", "undecided", "unexplained", "wrong among several", "wrong", "interval holds")


def table(found: list[dict[str, object]]) -> str:
    """The rows as a table of the page."""
    lines = [f"| mechanism | {' | '.join(_COLUMNS)} |", f"| --- {'| --- ' * len(_COLUMNS)}|"]
    for row in found:
        lines.append(f"| {row['mechanism']} | {' | '.join(str(row.get(name, 0)) for name in _COLUMNS)} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    record = Path("cases/measured/tank_level.csv")
    record.write_text(shipped_record(), encoding="utf-8")
    picture = epp.diagnose(epp.case("level_valve"), record).plot().figure
    picture.savefig(STORED / "diagnose.png", dpi=150, metadata={"Software": None})
    found = []
    for row in rows(int(sys.argv[1]) if len(sys.argv) > 1 else RECORDS):
        print(row, flush=True)
        found.append(row)
    (STORED / "diagnose.md").write_text(table(found), encoding="utf-8")


if __name__ == "__main__":
    main()
