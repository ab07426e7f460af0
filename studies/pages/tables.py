"""Tables of the documentation, computed from the shipped cases when it is built: ``python -m studies.pages.tables``."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import control
import numpy as np

import eppanalysis as epp
from eppanalysis.cases import GROUPS, Cycle
from eppanalysis.cases.expected import Published
from studies import GENERATED, first_order_tables, ladder as ladder_study, measured_coverage


def markdown(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table as Markdown."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines) + "\n"


@cache
def shipped() -> tuple[epp.Case, ...]:
    """All cases that ship."""
    return tuple(epp.case(name) for name in epp.shipped_cases())


@cache
def run(name: str) -> epp.Trajectory:
    """Simulation of a shipped case."""
    case = epp.case(name)
    return epp.simulate(case.to_system(), case.input, t_end=case.t_end)


@cache
def prediction(name: str) -> epp.Prediction:
    """Prediction for a shipped case."""
    case = epp.case(name)
    return epp.predict_limit_cycles(case)


def number(value: float | None, digits: int = 6) -> str:
    """A number, or a dash."""
    return "–" if value is None or not np.isfinite(value) else f"{value:.{digits}g}"


def cases_table() -> str:
    """What ships."""
    return markdown(
        ["name", "kind", "title", "source"],
        ([f"`{c.name}`", c.kind, c.title, c.expected.paper or c.expected.source] for c in shipped()),
    )


def sources_table() -> str:
    """Where every expected answer comes from, and what else is known of the same loop."""
    rows = []
    for case in shipped():
        expected = case.expected
        if expected.paper or not expected.source:
            continue
        published = "; ".join(_published(p) for p in expected.published)
        rows.append([f"`{case.name}`", expected.source, published or "–"])
    return markdown(["case", "where the expected answer comes from", "further answers for this loop"], rows)


def _published(found: Published) -> str:
    standing = [found.source, found.how_known, "confirmed" if found.confirmed else ""]
    return f"{found.quantity}: {number(found.value)} ({'; '.join(filter(None, standing))})"


def truth_table() -> str:
    """The experiments of the paper beside the simulation of the model."""
    rows = []
    for case in map(epp.case, GROUPS["truth-table"]):
        result, cycles = run(case.name), prediction(case.name)
        steady = result.limit_cycle
        rows.append(
            [
                f"`{case.name}`",
                case.expected.paper,
                case.expected.finding,
                "oscillates" if steady else result.status.name.lower().replace("_", " ").replace("settled", "settles"),
                number(steady.frequency, 4) if steady else "–",
                number(np.degrees(steady.peak_to_peak["theta"]), 4) if steady else "–",
                ", ".join(f"{c.frequency:.3g} Hz {'stable' if c.stable else 'unstable'}" for c in cycles) or "none",
            ]
        )
    header = ["case", "paper", "finding", "simulation", "frequency [Hz]", "peak to peak of theta [deg]", "DF"]
    return markdown(header, rows)


def _difference(found: float | None, expected: float | None) -> str:
    if found is None or not expected:
        return "–"
    difference = abs(found / expected - 1.0)
    return f"{difference:.0e}" if difference > 1e-12 else "< 1e-12"


def _pairs(
    expected: Sequence[Cycle], found: Sequence[epp.LimitCycle], signal: str
) -> list[tuple[Cycle | None, epp.LimitCycle | None]]:
    """Each expected cycle with the nearest that was found, then what was found beyond them."""
    left = list(found)
    pairs: list[tuple[Cycle | None, epp.LimitCycle | None]] = []
    for want in expected:
        near = min(left, key=lambda c: abs(np.log(c.amplitude(signal) / want.amplitude)), default=None)
        if near is not None:
            left.remove(near)
        pairs.append((want, near))
    return [*pairs, *((None, extra) for extra in left)]


def textbook_prediction() -> str:
    """First-order answers of the case files beside the prediction."""
    rows = []
    for case in shipped():
        expected, signal = case.expected.describing_function, case.expected.signal
        if expected is None or signal is None:
            continue
        pairs = _pairs(expected, prediction(case.name).cycles, signal)
        if not pairs:
            rows.append([f"`{case.name}`", "none", "none", "", "", "", ""])
        for want, have in pairs:
            amplitude, omega = (have.amplitude(signal), have.omega) if have else (None, None)
            rows.append(
                [
                    f"`{case.name}`",
                    number(want.amplitude) if want else "none",
                    number(amplitude) if have else "none",
                    _difference(amplitude, want.amplitude if want else None),
                    number(want.omega if want else None),
                    number(omega),
                    _difference(omega, want.omega if want else None),
                ]
            )
    header = ["case", "amplitude expected", "found", "difference", "ω expected [rad/s]", "found", "difference"]
    return markdown(header, rows)


def textbook_simulation() -> str:
    """Exact answers of the case files beside the simulation; only a stable cycle can be reached by one."""
    rows = []
    for case in shipped():
        expected, signal = case.expected.exact, case.expected.signal
        if expected is None or signal is None:
            continue
        steady = run(case.name).limit_cycle
        stable = [c for c in expected if c.stable is not False]
        if steady is None or not stable:
            rows.append([f"`{case.name}`", "–" if not stable else number(stable[0].amplitude)])
            rows[-1] += [
                "–",
                "–",
                "–" if not stable else number(stable[0].omega),
                "–",
                run(case.name).status.name.lower(),
            ]
            continue
        half = steady.peak_to_peak[signal] / 2.0
        want = min(stable, key=lambda c: abs(c.amplitude - half))
        rows.append(
            [
                f"`{case.name}`",
                number(want.amplitude),
                number(half),
                _difference(half, want.amplitude),
                number(want.omega),
                number(steady.omega),
                _difference(steady.omega, want.omega),
            ]
        )
    header = [
        "case",
        "amplitude expected",
        "found",
        "difference",
        "ω expected [rad/s]",
        "found",
        "difference or verdict",
    ]
    return markdown(header, rows)


def both_directions() -> str:
    """Cases that first order gets wrong, or right only in part, with the ladder's verdict."""
    rows = []
    for name in ("backlash_servo_unseen", "backlash_servo", "elbow_cycle_not_there", "light_forearm"):
        found = epp.ladder(epp.case(name))
        cycles = [f"{c.frequency:.3g} Hz {'stable' if c.stable else 'unstable'}" for c in found.prediction or ()]
        steady = found.run.limit_cycle
        runs = f"{steady.frequency:.4g} Hz" if steady else found.outcome.replace("settle", "settles")
        rows.append([f"`{name}`", ", ".join(cycles) or "none", runs, found.verdict])
    return markdown(["case", "DF", "simulation", "verdict"], rows)


class _ClosedForm(control.DescribingFunctionNonlinearity):
    """An element as python-control wants it, with the closed form of this package."""

    def __init__(self, element: epp.Nonlinearity) -> None:
        super().__init__()
        self.element = element

    def describing_function(self, amplitude: float) -> complex:
        """Gain of the fundamental; the mean is dropped, for python-control has no bias."""
        return complex(self.element.describing_function(amplitude)[1])


#: Amplitudes and frequencies that python-control is given to search.
GRID = 200


@dataclass(frozen=True)
class Comparison:
    """A loop that is hard for a search on a grid.

    Attributes
    ----------
    what : str
    transfer_function : (list, list)
        Numerator and denominator.
    element : Nonlinearity
    amplitudes : (float, float)
        Range that python-control searches; it starts where the element has a gain.
    theirs : DescribingFunctionNonlinearity, optional
        Their own class of the element, where there is one.
    """

    what: str
    transfer_function: tuple[list[float], list[float]]
    element: epp.Nonlinearity
    amplitudes: tuple[float, float]
    theirs: control.DescribingFunctionNonlinearity | None = None


def comparisons() -> list[Comparison]:
    """The loops of the comparison."""
    # K/(s (s + 1)^2) crosses -180 degrees with gain K/2, and the largest gain of the relay with dead zone is 2/pi.
    third, fold, relay = [1.0, 2.0, 1.0, 0.0], np.pi, epp.RelayDeadZone(threshold=1.0)
    return [
        Comparison("relay with dead zone, two cycles", ([5.0], third), relay, (1.001, 4.0)),
        Comparison("the same, gain 1e-6 above the fold", ([fold * (1 + 1e-6)], third), relay, (1.001, 4.0)),
        Comparison("the same, gain 1e-6 below the fold", ([fold * (1 - 1e-6)], third), relay, (1.001, 4.0)),
        Comparison(
            "play, total gap 2",
            ([5.0], [1.0, 1.0, 0.0]),
            epp.Play(gap=2.0),
            (1.001, 4.0),
            control.friction_backlash_nonlinearity(2.0),
        ),
        Comparison(
            "saturation from -0.5 to 2",
            ([8.0], [1.0, 2.0, 2.0, 1.0]),
            epp.Saturation(lower=-0.5, upper=2.0),
            (0.1, 10.0),
            control.saturation_nonlinearity(2.0, -0.5),
        ),
        Comparison(
            "relay with hysteresis 0.1",
            ([1.0], [1.0, 1.0, 0.0]),
            epp.HysteresisRelay(lower=-0.1, upper=0.1),
            (0.101, 2.0),
            control.relay_hysteresis_nonlinearity(1.0, 0.1),
        ),
        Comparison("ideal relay", ([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Relay(), (1e-3, 1.0)),
        Comparison("the same, unit of length 1e6 as long", ([1e-6], [1.0, 3.0, 2.0, 0.0]), epp.Relay(), (1e-9, 1e-6)),
    ]


def _theirs(loop: Comparison) -> str:
    amplitudes, omega = np.linspace(*loop.amplitudes, GRID), np.logspace(-2, 2, GRID)
    element = loop.theirs or _ClosedForm(loop.element)
    with np.errstate(all="ignore"):
        found = control.describing_function_response(control.tf(*loop.transfer_function), element, amplitudes, omega)
    return _listed(found.intersections)


def _ours(loop: Comparison) -> str:
    found = epp.predict_limit_cycles(epp.LureSystem.from_tf(loop.transfer_function, loop.element))
    return _listed((c.amplitude("x"), c.omega) for c in found)


def _listed(pairs: Iterable[tuple[float, float]]) -> str:
    texts = [f"{amplitude:.6g} at {omega:.6g}" for amplitude, omega in pairs]
    more = f"; {len(texts) - 4} more" if len(texts) > 4 else ""
    return "; ".join(texts[:4]) + more or "none"


def python_control() -> str:
    """Amplitude and angular frequency that python-control finds, beside ours."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        rows = [[loop.what, _theirs(loop), _ours(loop)] for loop in comparisons()]
    return markdown(["loop", f"python-control {control.__version__}", "eppanalysis"], rows)


TABLES: dict[str, Callable[[], str]] = {
    "cases": cases_table,
    "sources": sources_table,
    "truth_table": truth_table,
    "textbook_prediction": textbook_prediction,
    "textbook_simulation": textbook_simulation,
    "both_directions": both_directions,
    "python_control": python_control,
    "ladder": lambda: markdown(*ladder_study.table()),
    "measured_coverage": lambda: measured_coverage.table(measured_coverage.read()),
    "first_order_by_element": lambda: markdown(*first_order_tables.by_element()),
    "first_order_by_filter": lambda: markdown(*first_order_tables.by_filter()),
    "first_order_by_ratio": lambda: markdown(*first_order_tables.by_ratio()),
}


def make_all(folder: Path) -> None:
    """Write every table as a Markdown file."""
    for name, make in TABLES.items():
        (folder / f"{name}.md").write_text(make(), encoding="utf-8")


if __name__ == "__main__":
    GENERATED.mkdir(exist_ok=True)
    make_all(GENERATED)
