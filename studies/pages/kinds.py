"""The page on what each analysis takes, made by running all of them on small loops: ``python -m studies.pages.kinds``.

It is under version control, for it is read where nothing is built; a test compares it with a fresh run.
"""

from __future__ import annotations

import csv
import inspect
import re
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

import eppanalysis as epp
from studies import DOCS

PAGE = DOCS / "reference" / "kinds.md"

_INTRODUCTION = """\
# What each analysis takes

<!-- Made by "python -m studies.pages.kinds", which runs all analyses; changes belong there. -->

Every analysis was run on a small loop of each kind:

"""
_LEGEND = {
    "autonomous": "three lags and a relay with dead zone, in continuous time",
    "sampled controller": "two lags and a gain executed every 0.5 s, with the same relay",
    "discrete time": "a difference equation of second order with the same relay",
    "dead time behind a switching element": "two lags and a dead time behind the same relay",
    "dead time behind a continuous element": "a lag and a dead time behind a saturation with dead zone",
}
_MORE = """
`margins` and `olop` need a gain and a rate limiter: a saturation, or a rate limiter, replaces the relay for them,
except with dead time behind a switching element.

"""
_ALL = "All kinds: "
_SOME = "In the table a number leads to the sentence of an analysis that declines, or found no answer for this loop."
#: Functions that take a loop or a case by these names are analyses, where they take one of these types.
_TAKES, _TYPES = ("case", "cases", "loop", "system"), re.compile(r"LureSystem|\bCase\b|CaseLike")

_LATE: dict[str, Any] = {"num": [8.0], "den": [1.0, 2.0, 1.0], "delay": 0.6, "start": [0.1, 0.1]}
_PLANTS: dict[str, dict[str, Any]] = {
    "autonomous": {"num": [16.0], "den": [1.0, 3.0, 3.0, 1.0], "start": [0.1, 0.1, 0.1]},
    "sampled controller": {"num": [20.0], "den": [1.0, 2.0, 1.0], "start": [0.1, 0.1]},
    "discrete time": {"num": [1.2], "den": [1.0, -1.0, 0.25], "sample_time": 0.5, "start": [0.1, 0.1]},
    "dead time behind a switching element": _LATE,
    "dead time behind a continuous element": {"num": [12.0], "den": [1.0, 1.0], "delay": 1.0, "start": [0.1]},
}
SWITCHING, CONTINUOUS = list(_PLANTS)[3:]
#: Ranges of the dead zone that hold the least one without a limit cycle.
NEAR = dict(zip(_PLANTS, ((0.9, 2.0), (0.9, 6.0), (0.9, 6.0), (0.9, 1.5), (0.9, 3.0)), strict=True))


@dataclass(frozen=True)
class Tried:
    """A loop of a kind, and what several analyses begin with."""

    kind: str
    folder: Path

    def with_element(self, element: epp.Nonlinearity) -> epp.Case:
        """The loop with an element in its valve."""
        parts: dict[str, Any] = {"valve": element, "plant": epp.blocks.TransferFunction(**_PLANTS[self.kind])}
        before = "valve"
        if self.kind == "sampled controller":
            parts["controller"], before = epp.blocks.Gain(gain=1.0, sample_time=0.5), "controller"
        wires = [f"command - plant -> {before}", "valve -> plant"] + ["controller -> valve"] * (before != "valve")
        loop = epp.Diagram(parts, wires, inputs=["command"], signals={"x": "plant"}, margins_at="valve", name="loop")
        return epp.Case.from_system(loop, t_end=40.0, signal="x")

    def with_its_own(self, element: epp.Nonlinearity) -> epp.Case:
        """The loop with an element, but where the kind is one of a switching element."""
        return self.case if self.kind == SWITCHING else self.with_element(element)

    @cached_property
    def case(self) -> epp.Case:
        """The loop with its own element."""
        if self.kind == CONTINUOUS:
            return self.with_element(epp.DeadZoneSaturation(dead_zone=1.0, slope=2.0, limit=1.0))
        return self.with_element(epp.RelayDeadZone(threshold=1.0, level=1.0))

    @property
    def dead(self) -> str:
        """Field of the element: where it begins to act."""
        return "valve.dead_zone" if self.kind == CONTINUOUS else "valve.threshold"

    @property
    def level(self) -> str:
        """Field of the element: how much it gives."""
        return "valve.limit" if self.kind == CONTINUOUS else "valve.level"

    @cached_property
    def guess(self) -> epp.LimitCycle:
        """The stable cycle of first order."""
        return epp.predict_limit_cycles(self.case)[-1]

    @cached_property
    def found(self) -> epp.CycleSearch:
        """All cycles."""
        return epp.find_limit_cycles(self.case)

    @cached_property
    def record(self) -> epp.Trajectory:
        """A run with the input in motion."""
        return epp.simulate(self.case, epp.inputs.Sine(2.0, 0.1), t_end=8.0)

    def turns(self) -> dict[str, np.ndarray]:
        """Twelve turns of a cycle, as a record has them."""
        cycle = self.found[-1]
        times = (cycle.time + turn * cycle.period for turn in range(12))
        return {"time": np.concatenate([*times]), "x": np.tile(cycle.waveform["x"], 12)}

    def recorded(self) -> Path:
        """It, in a file."""
        path = self.folder / f"{len(list(self.folder.iterdir()))}.csv"
        with path.open("w", newline="", encoding="utf-8") as file:
            rows = csv.writer(file)
            rows.writerow(["time [s]", "command", "x"])
            run = self.record
            every = max(run.t.size // 400, 1)
            columns = (run.t, run.signals["command"], run.signals["x"])
            rows.writerows(zip(*(column[::every] for column in columns), strict=True))
        return path


def _ranges(t: Tried) -> dict[str, Any]:
    return {t.dead: [0.9, 1.1], t.level: [1.0, 1.1]}


_SINE = {"amplitude": 0.5, "n_points": 3, "max_step": 0.1}
_FEW: dict[str, Any] = {"starts": 10, "seed": 1}
_ONE: dict[str, Any] = {"workers": 1, "progress": False}

#: How each analysis is run, with arguments that make it cheap.
ANALYSES: dict[str, Callable[[Tried], Any]] = {
    "simulate": lambda t: epp.simulate(t.case),
    "predict_limit_cycles": lambda t: epp.predict_limit_cycles(t.case),
    "harmonic_balance": lambda t: epp.harmonic_balance(t.case, t.guess, order=1),
    "exact_orbit": lambda t: epp.exact_orbit(t.case, t.guess),
    "find_limit_cycles": lambda t: t.found,
    "remedies": lambda t: epp.remedies(t.case, t.found),
    "trigger": lambda t: epp.trigger(t.case, cycles=t.found, states=()),
    "ladder": lambda t: epp.ladder(t.case),
    "continue_branch": lambda t: epp.continue_branch(
        t.case, t.dead, 1.0, 1.05, cycle=t.found[-1], n_points=3, max_step=0.05, n_others=0
    ),
    "continue_folds": lambda t: epp.continue_folds(t.case, t.dead, t.level, NEAR[t.kind], (1.0, 1.1), n_points=2),
    "forced_response": lambda t: epp.forced_response(t.case, amplitude=0.5, frequency=0.2, most_periods=1),
    "frequency_response": lambda t: epp.frequency_response(t.case, "command", "x", frequencies=(0.2, 0.25), **_SINE),
    "amplitude_response": lambda t: epp.amplitude_response(
        t.case, "command", "x", frequency=0.2, amplitudes=(0.4, 0.5), n_points=3, max_step=0.1
    ),
    "margins": lambda t: epp.margins(t.with_its_own(epp.Saturation(-1.0, 1.0))),
    "design_bounds": lambda t: epp.design_bounds(
        t.case, t.level, t.dead, start=1.0, stop=1.1, points=1, within=NEAR[t.kind], verify=False, **_FEW
    ),
    "design_guide": lambda t: epp.design_guide(
        t.case, [1.0], over=t.level, limit=t.dead, within=NEAR[t.kind], samples=2, **_FEW
    ),
    "tolerance_bound": lambda t: epp.tolerance_bound(
        t.case, t.dead, {t.level: 0.05}, within=NEAR[t.kind], probabilities=(0.9,), samples=2, seed=1
    ),
    "design": lambda t: epp.design(t.case, {t.dead: NEAR[t.kind]}, minimise=t.dead, verify=False, **_FEW),
    "sweep": lambda t: epp.sweep(t.case, _ranges(t), **_ONE),
    "sweep_cost": lambda t: epp.sweep_cost(t.case, _ranges(t)),
    "outcome_boundary": lambda t: epp.outcome_boundary(t.case, _ranges(t), halvings=1, **_ONE),
    "free_region": lambda t: epp.free_region(t.case, {t.level: [1.0, 1.1], t.dead: list(NEAR[t.kind])}),
    "dither": lambda t: epp.dither(t.case, frequency=50.0, tolerance=0.1),
    "olop": lambda t: epp.olop(t.with_its_own(epp.RateLimiter(1.0)), 0.5, "command"),
    "frozen_nyquist": lambda t: epp.frozen_nyquist(t.case, t.guess),
    "certify": lambda t: epp.certify(t.case),
    "certify_orbit": lambda t: epp.certify_orbit(t.case, t.found[-1]),
    "diagnose": lambda t: epp.diagnose(t.case, t.turns(), steps=100),
    "identify": lambda t: epp.identify(t.case, step=t.recorded(), fit=(t.level,)),
    "report": lambda t: epp.report(t.case, t.folder / "report.html"),
    "first_page": lambda t: epp.first_page(t.case, epp.simulate(t.case)),
    "to_fmu": lambda t: epp.to_fmu(t.case, t.folder / "loop.fmu"),
}


#: Those that take most of the time.
DEAR = {
    "design_bounds", "design_guide", "tolerance_bound", "design", "diagnose", "dither", "free_region",
    "identify", "ladder", "report",
}  # fmt: skip


def public_analyses() -> Iterator[str]:
    """Names of the public functions that take a loop or a case first, by their signatures."""
    for name in dir(epp):
        function = getattr(epp, name)
        first = (
            next(iter(inspect.signature(function).parameters.values()), None) if inspect.isfunction(function) else None
        )
        if first is not None and first.name in _TAKES and _TYPES.search(str(first.annotation)):
            yield name


def answer(name: str, tried: Tried) -> str:
    """Empty where an analysis answers, else its sentence."""
    try:
        result = ANALYSES[name](tried)
    except epp.EppError as error:
        return str(error)
    return str(result) if isinstance(result, epp.LimitCycle) and not result.status.ok else ""


def answers(names: Iterable[str]) -> dict[str, list[str]]:
    """What analyses say of a loop of each kind, see :func:`answer`."""
    with tempfile.TemporaryDirectory() as folder:
        tried = [Tried(kind, Path(folder)) for kind in _PLANTS]
        return {name: [answer(name, one) for one in tried] for name in names}


def page(found: Mapping[str, Sequence[str]]) -> str:
    """The page as Markdown, of what all analyses say."""
    sentences = list(dict.fromkeys(text for row in found.values() for text in row if text))
    kinds = "".join(f"- {kind}: {what}\n" for kind, what in _LEGEND.items())
    everywhere = f"{_ALL}{', '.join(f'`{name}`' for name, row in found.items() if not any(row))}.\n\n{_SOME}\n\n"
    head = f"| analysis | {' | '.join(_PLANTS)} |\n|{' --- |' * (len(_PLANTS) + 1)}\n"
    rows = "".join(
        f"| `{name}` | {' | '.join(str(sentences.index(text) + 1) if text else 'yes' for text in row)} |\n"
        for name, row in found.items()
        if any(row)
    )
    notes = "".join(f"{i}. {text}\n" for i, text in enumerate(sentences, 1))
    return f"{_INTRODUCTION}{kinds}{_MORE}{everywhere}{head}{rows}\n## Why not\n\n{notes}"


def told(text: str) -> dict[str, list[str]]:
    """What a page says of each analysis, as :func:`answers` has it."""
    sentences = dict(re.findall(r"^(\d+)\. (.*)$", text, re.MULTILINE))
    (everywhere,) = re.findall(rf"^{_ALL}(.*)\.$", text, re.MULTILINE)
    rows = re.findall(r"^\| `(\w+)` \| (.*) \|$", text, re.MULTILINE)
    found = {name: [""] * len(_PLANTS) for name in re.findall(r"`(\w+)`", everywhere)}
    return found | {name: [sentences.get(cell, "") for cell in cells.split(" | ")] for name, cells in rows}


if __name__ == "__main__":
    PAGE.write_text(page(answers(ANALYSES)), encoding="utf-8")
