"""Files that were changed and sealed anew: each is refused, or says what is true of the loop that it now states."""

from __future__ import annotations

import functools
import importlib
import json
import math
import tempfile
from collections.abc import Callable, Iterator
from fractions import Fraction
from itertools import groupby
from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest
from scipy.linalg import expm

import eppanalysis as epp
from eppanalysis.methods.certificates.elbow.find import gained
from eppanalysis.methods.certificates.registry import STATEMENTS, of_text, sealed
from eppanalysis.methods.certificates.result import sentence
from eppanalysis.results import LimitCycle, Status
from tests.driven_loops import saturated
from tests.methods.certificates.tampering import Edit, another_form, another_size, twice
from tests.methods.certificates.test_absence import tuned
from tests.shared import mostly_slow
from tests.switched_samples import switched

pytest.importorskip("flint")
Document = dict[str, Any]
#: What the program of a checker turns into a refusal.
UNREADABLE = (LookupError, TypeError, ValueError, AttributeError, ArithmeticError, RecursionError)
L = epp.LureSystem.from_tf


def _of_roots(den: list[float], element: epp.Nonlinearity, num: float = 1.0, **box: Any) -> Callable[[], Document]:
    delay = box.pop("delay", 0.0)
    return lambda: dict(epp.certify(L(([num], den), element, delay=delay), box=box or None).document)


def _absence(loop: epp.LureSystem, sectors: int = 48) -> Callable[[], Document]:
    return lambda: dict(epp.certify(loop, "absence", sectors=sectors).document)


def _range(loop: epp.LureSystem, low: float, high: float, sectors: int = 48) -> Callable[[], Document]:
    within = {"loop.gain": (low, high)}
    return lambda: dict(epp.certify(epp.Case.from_system(loop), "absence", within=within, sectors=sectors).document)


def _box() -> Document:
    with tempfile.TemporaryDirectory() as folder:
        case = tuned(Path(folder) / "tuned.toml")
        return dict(epp.certify(case, "absence", within={"Kp": (1.0, 3.0), "damping": (0.8, 1.2)}).document)


def _orbit() -> Document:
    relay = L(([1.0], [1.0, 1.0]), epp.HysteresisRelay(lower=-0.5, upper=0.5))
    x, period = np.zeros(1), 2.0 * math.log(3.0)
    cycle = LimitCycle("exact orbit", Status.CONVERGED, period, {}, {}, {}, state=x, memory=(1.0,))
    return dict(epp.certify_orbit(relay, cycle).document)


def _locked() -> Document:
    case = switched("sampled controller")
    return dict(epp.certify_orbit(case, epp.find_limit_cycles(case)[0]).document)


def _jumps() -> Document:
    case = epp.case("backlash_discrete_pi_kp05_ki02")
    return dict(epp.certify_orbit(case, epp.find_limit_cycles(case)[0]).document)


def _response() -> Document:
    loop = saturated()
    (response, *_) = epp.forced_response(loop, amplitude=0.5, frequency=0.9 / (2.0 * math.pi), most_periods=1)
    return dict(epp.certify_orbit(loop, response).document)


def _elbow() -> Document:
    case = epp.case("fig8a_original").with_values({"lock_pin.backlash": "0.06 deg"})
    return dict(epp.certify(case, "absence").document)


def _sampled() -> Document:
    return dict(epp.certify(epp.case("backlash_discrete_pi")).document)


def _cells() -> Document:
    loop = L(([2.5], [1.0, 2.0, 1.0, 0.0]), epp.RelayDeadZone(threshold=1.0))
    return dict(epp.certify(loop, "cycles").document)


def _two_cycles() -> Document:
    return dict(epp.certify(L(([5.0], [1.0, 2.0, 1.0, 0.0]), epp.RelayDeadZone(threshold=1.0)), "cycles").document)


def _ring() -> Document:
    return dict(
        epp.certify(epp.case("sat_plus_backlash"), box={"amplitude": (0.55, 4.0), "omega": (0.2, 4.0)}).document
    )


THIRD, SERVO = [1.0, 3.0, 3.0, 1.0], [0.2, 1.2, 1.0, 0.0]
NARROW = {"amplitude": (0.3, 3.0), "omega": (0.5, 4.0)}
ABOUT_BIAS = {"amplitude": (0.1, 1.0), "omega": (0.5, 3.0), "bias": (-0.5, 0.5)}
MADE: dict[str, Callable[[], Document]] = {
    "roots, dead zone": _of_roots(THIRD, epp.DeadZoneSaturation(0.3, 2.0, 0.9), 9.0, **NARROW),
    "roots, no root": _of_roots(THIRD, epp.DeadZone(-0.4, 0.4, 2.0), 2.0, **NARROW),
    "roots, play": _of_roots(SERVO, epp.Play(gap=1.0), 5.0, amplitude=(0.51, 4.0), omega=(0.3, 4.0)),
    "roots, stiction": _of_roots(SERVO, epp.JumpAndFollow(0.9, 0.4, 1.2), 4.0, amplitude=(0.46, 4.0), omega=(0.3, 4.0)),
    "roots, relay": _of_roots(THIRD, epp.HysteresisRelay(-0.1, 0.1), 2.0, delay=0.5, **NARROW),
    "roots, three levels": _of_roots(THIRD, epp.HysteresisRelayDeadZone(on=0.2, off=0.1), 4.0, **NARROW),
    "roots, cube": _of_roots(THIRD, epp.Cube(0.7), 4.0, **NARROW),
    "roots, drag": _of_roots(THIRD, epp.Drag(0.7), 4.0, **NARROW),
    "roots, sampled": _sampled,
    "balance, relay": _of_roots(THIRD, epp.HysteresisRelay(-0.1, 0.1, -0.7, 1.3), **ABOUT_BIAS),
    "balance, saturation": _of_roots(THIRD, epp.Saturation(-0.2, 0.5, 1.0), 9.0, **ABOUT_BIAS),
    "balance, ring": _ring,
    "absence, saturation": _absence(L(([5.9], [1.0, 3.0, 2.0, 0.0]), epp.Saturation())),
    "absence, uneven": _absence(L(([1.0], THIRD), epp.DeadZone(-0.4, 0.7, 2.0))),
    "absence, drag": _absence(L(([1.0, 1.0], [1.0, 3.0, 2.0]), epp.Drag(2.0))),
    "absence, play": _absence(L(([0.5], SERVO), epp.Play(gap=0.1))),
    "play": _absence(L(([1.5], SERVO), epp.Play(gap=1.0)), sectors=4),
    "play, range": _range(L(([1.0], SERVO), epp.Play(gap=1.0)), 1.4, 1.6, sectors=4),
    "play, range with a zero": _range(L(([0.3, 1.0], SERVO), epp.Play(gap=1.0)), 2.6, 3.0, sectors=6),
    "absence, range": _range(L(([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Saturation()), 1.0, 5.9),
    "absence, range with play": _range(L(([1.0], SERVO), epp.Play(gap=1.0)), 0.1, 0.8),
    "absence, box": _box,
    "absence, samples": _absence(
        epp.LureSystem.from_tf(control.tf([0.2, 0.1], [1.0, -0.6, 0.05], 0.5), epp.Saturation(), delay=1.0)
    ),
    "absence, dead time": _absence(L(([1.2], [1.0, 1.0, 0.0]), epp.Saturation(), delay=0.5)),
    "absence, play and dead time": _absence(L(([0.4], [1.0, 1.0]), epp.Play(gap=0.1), delay=0.5)),
    "absence, range of dead times": lambda: dict(
        epp.certify(
            epp.Case.from_system(L(([1.0], [1.0, 1.0, 0.0]), epp.Saturation(), delay=0.5)),
            "absence",
            within={"loop.gain": (0.5, 1.2), "loop.delay": (0.3, 0.5)},
        ).document
    ),
    "absence, samples and play": _absence(
        epp.LureSystem.from_tf(control.tf([0.3], [1.0, -1.0], 0.5), epp.Play(gap=0.1))
    ),
    "absence, any element": _absence(L(([0.7, 1.0], [1.0, 0.0, 0.0]), epp.RelayDeadZone(threshold=0.5))),
    "orbit": _orbit,
    "orbit, samples": _locked,
    "orbit, sine": _response,
    "orbit, jumps": _jumps,
    "elbow": _elbow,
    "cells": _cells,
    "cells, two cycles": _two_cycles,
}
#: Those of which changed values are tried in seconds; of each checker one whose names and kinds of values are changed.
FAST = ("roots, dead zone", "roots, relay", "balance, relay", "absence, saturation", "absence, play", "play")
FAST += (
    "absence, samples",
    "absence, samples and play",
    "absence, dead time",
    "absence, range of dead times",
    "play, range",
    "absence, range",
    "absence, box",
    "absence, range with play",
    "absence, any element",
)
FIRST = ("roots, dead zone", "balance, relay", "absence, saturation", "play, range", "absence, any element")
FIRST += ("orbit", "orbit, samples", "orbit, sine")
#: Of which all of that takes a second or two.
FASTEST = ("roots, dead zone", "absence, saturation", "absence, range", "absence, box", "absence, any element")
FASTEST += ("absence, samples", "absence, dead time")


@pytest.fixture(scope="module")
def made() -> Callable[[str], Document]:
    known: dict[str, Document] = {}

    def document(name: str) -> Document:
        if name not in known:
            known[name] = json.loads(json.dumps(MADE[name]()))
        return known[name]

    return document


def checker_of(document: Document) -> Any:
    return importlib.import_module(of_text(document["statement"]).functions().__name__)


def refused(checker: Any, document: Document) -> bool:
    """Whether a checker refuses the text of a document, its digest made to fit."""
    try:
        checker.verify(checker.read(json.dumps(sealed(document))))
    except (checker.Refused, *UNREADABLE):
        return True
    return False


def stated(document: Document) -> Document:
    """What its statement rests on: not the evidence, nor the course of an orbit, for those who know the loop."""
    loop = {name: part for name, part in document["loop"].items() if name != "course"}
    return {name: loop if name == "loop" else document[name] for name in document if name not in ("evidence", "digest")}


def some(edits: Iterator[Edit], step: int) -> Iterator[Edit]:
    """Of the edits of each place the first and every so many more."""
    for _, group in groupby(edits, lambda edit: edit[0].partition(" = ")[0]):
        yield from list(group)[::step]


def test_every_kind_of_certificate_is_here() -> None:
    texts = {statement.text for statement in STATEMENTS.values()}
    assert {name.split(",")[0] for name in MADE} == {"roots", "balance", "absence", "play", "orbit", "elbow", "cells"}
    assert len(texts) == 7


@pytest.mark.parametrize("name", mostly_slow(MADE, FIRST))
def test_names_and_kinds_of_values_are_as_they_should_be(made: Callable[[str], Document], name: str) -> None:
    document = made(name)
    checker = checker_of(document)
    assert not refused(checker, document)
    tried = 0
    for label, edited in another_form(document):
        assert refused(checker, edited), label
        tried += 1
    for label, text in twice(document):
        with pytest.raises(checker.Refused, match="twice"):
            checker.verify(checker.read(text))
        tried += 1
        assert label
    assert tried > 100


@pytest.mark.parametrize("name", mostly_slow(MADE, FASTEST))
def test_what_is_not_refused_is_true(made: Callable[[str], Document], name: str) -> None:
    document, said = made(name), 0
    checker = checker_of(document)
    # Every place of each kind; of dear ones every third value of a place, or the first.
    step = 1 if name in FAST else 99 if name.startswith("cells") else 3
    for label, edited in some(another_size(document), step):
        if not refused(checker, edited):
            said += 1
            assert stated(edited) == stated(document) or WITNESS[name.partition(",")[0]](edited), (
                f"{label}: {sentence(edited)}"
            )
            assert "Proved" in sentence(edited)
    assert said < 1000


# Witnesses, which share nothing with the checkers: quadrature and Newton's method in floats, dense frequencies, runs.


def numbers(texts: list[str]) -> np.ndarray:
    return np.array([float(Fraction(text)) for text in texts])


def element_of(stated: Document) -> Callable[[float, float], tuple[complex, float]]:
    """Gain and mean of an element for a bias and a sine, as the package's elements have them, not the checkers."""
    v = {n: float(Fraction(x)) for n, x in stated.items() if isinstance(x, str) and n != "kind"}
    known: dict[str, Callable[[], epp.Nonlinearity]] = {
        "play": lambda: epp.Play(v["gap"]),
        "jump_and_follow": lambda: epp.JumpAndFollow(v["stick_band"], v["slip_jump"], v["slope"]),
        "hysteresis_relay": lambda: epp.HysteresisRelay(-v["threshold"], v["threshold"], -v["level"], v["level"]),
        "hysteresis_relay_dead_zone": lambda: epp.HysteresisRelayDeadZone(v["on"], v["off"], v["level"]),
        "biased_relay": lambda: epp.HysteresisRelay(v["lower"], v["upper"], v["low"], v["high"]),
        "cube": lambda: epp.Cube(v["scale"]),
        "drag": lambda: epp.Drag(v["scale"]),
    }
    element = known.get(stated["kind"], lambda: lines_of(stated))()

    def described(a: float, b: float) -> tuple[complex, float]:
        mean, gain = element.describing_function(a, b)
        return complex(gain), float(mean)

    return described


def lines_of(stated: Document) -> epp.PiecewiseLinear:
    """The lines of a static element, read off its values."""
    halves = (stated, stated) if stated["kind"] == "odd_pieces" else (stated["positive"], stated["negative"])
    sides = [{float(Fraction(at)) for name in ("bends", "jumps") for at, _ in half[name]} for half in halves]
    edges = sorted({0.0, *sides[0], *(-at for at in sides[1])})
    inside = [edges[0] - 1.0, *((x + y) / 2 for x, y in zip(edges, edges[1:], strict=False)), edges[-1] + 1.0]
    near = [0.1 * min(abs(x - edge) for edge in edges) for x in inside]
    low, high = (values_of(stated, np.array(inside) + sign * np.array(near)) for sign in (-1.0, 1.0))
    slopes = (high - low) / (2.0 * np.array(near))
    return epp.PiecewiseLinear(edges, list(slopes), list((high + low) / 2.0 - slopes * np.array(inside)))


def values_of(stated: Document, x: np.ndarray) -> np.ndarray:
    """Output of a static element."""
    if stated["kind"] in ("cube", "drag"):
        return float(Fraction(stated["scale"])) * (x**3 if stated["kind"] == "cube" else x * np.abs(x))
    halves = (stated, stated) if stated["kind"] == "odd_pieces" else (stated["positive"], stated["negative"])
    y = np.zeros_like(x)
    for half, way in zip(halves, (1.0, -1.0), strict=True):
        z = np.maximum(way * x, 0.0)
        out = float(Fraction(half["slope"])) * z
        for at, change in half["bends"]:
            out = out + float(Fraction(change)) * np.maximum(z - float(Fraction(at)), 0.0)
        for at, height in half["jumps"]:
            out = out + float(Fraction(height)) * (way * x > float(Fraction(at)))
        y = y + way * out
    return y


def balance_of(loop: Document) -> Callable[[np.ndarray], np.ndarray]:
    """What is zero at a root (amplitude, frequency, and bias if there is one)."""
    links = loop.get("ring", [loop])
    elements = [element_of(link["element"]) for link in links]
    means = numbers(loop.get("means", []))
    step = None if loop.get("time_step") is None else float(Fraction(loop["time_step"]))

    def F(x: np.ndarray) -> np.ndarray:
        a, w, b = x[0], x[1], x[2] if means.size else 0.0
        s = np.exp(1j * w * step) if step else 1j * w
        whole, each, mean = 1.0 + 0j, complex(1.0), 0.0
        for link, element in zip(links, elements, strict=True):
            gain, mean = element(float(a), float(b))
            num, den = np.polyval(numbers(link["num"]), s), np.polyval(numbers(link["den"]), s)
            part = -gain * num * np.exp(-1j * w * float(Fraction(link["delay"])))
            whole, each = whole * den, each * part
            a = abs(part / den) * a
        out = [(whole - each).real, (whole - each).imag]
        return np.array(out + ([means[0] * b + means[1] * mean - means[2]] if means.size else []))

    return F


def roots_are_as_many(document: Document) -> bool:
    """By Newton's method from a grid: as many roots in the box as are claimed, if none of it is left open."""
    box = [numbers(document["box"][side]) for side in ("amplitude", "frequency", "bias") if side in document["box"]]
    F, found = balance_of(document["loop"]), []
    axes = [np.geomspace(*side, 8)[1:-1] if side[0] > 0 else np.linspace(*side, 5)[1:-1] for side in box]
    with np.errstate(all="ignore"):
        for start in np.stack(np.meshgrid(*axes), -1).reshape(-1, len(box)):
            x = newton(F, start, box)
            if x is not None and not any(np.allclose(x, y, rtol=1e-5) for y in found):
                found.append(x)
    claimed = document["claim"]["roots"]
    return len(found) == claimed or (document["claim"]["undecided"] > 0 and len(found) >= claimed)


def newton(F: Callable[[np.ndarray], np.ndarray], x: np.ndarray, box: list[np.ndarray]) -> np.ndarray | None:
    for _ in range(25):
        here = F(x)
        steps = 1e-6 * np.maximum(np.abs(x), x[0])
        J = np.stack([(F(x + h * e) - F(x - h * e)) / (2 * h) for h, e in zip(steps, np.eye(x.size), strict=True)], 1)
        if not np.isfinite(J).all() or abs(np.linalg.det(J)) < 1e-300:
            return None
        move = np.linalg.solve(J, here)
        x = x - move * min(1.0, 0.3 * float(np.min(np.maximum(np.abs(x), x[0]) / np.maximum(np.abs(move), 1e-300))))
        if not x[:2].min() > 0:
            return None
        if np.max(np.abs(move) / np.maximum(np.abs(x), x[0])) < 1e-9:
            inside = all(low < value < high for value, (low, high) in zip(x, box, strict=True))
            return x if inside else None
    return None


def between(loop: Document) -> list[tuple[np.ndarray, np.ndarray]]:
    """Numerators and denominators of a file: the one, or some of the line or box between several."""
    sides = len(loop["num"]).bit_length() - 1
    found = []
    for shares in np.random.default_rng(0).uniform(size=(7, sides)) if sides else [np.zeros(0)]:
        weights = [math.prod(t if k >> i & 1 else 1.0 - t for i, t in enumerate(shares)) for k in range(2**sides)]
        sums = [
            functools.reduce(np.polyadd, (w * numbers(row) for w, row in zip(weights, loop[n], strict=True)))
            for n in ("num", "den")
        ]
        found.append((sums[0], sums[1]))
    return found


def no_cycle_by_frequency(document: Document) -> bool:
    """The criterion at many frequencies, with the sector of the element's own values."""
    loop, multiplier = document["loop"], float(Fraction(document["claim"]["multiplier"]))
    low, high = (None if edge is None else float(Fraction(edge)) for edge in document["claim"]["sector"])
    omega, room = np.geomspace(1e-4, 1e4, 4001), 0.0 if low is None or high is None else 1.0 / (high - low)
    s, late = 1j * omega, numbers(loop["delay"] if isinstance(loop["delay"], list) else [loop["delay"]])
    passed = np.exp(-np.linspace(late[0], late[-1], 7)[:, None] * s)[:, None]
    if loop["time_step"] is not None:
        s = np.exp(2j * np.append(np.arctan(omega), np.pi / 2))
        passed = s ** -float(Fraction(loop["delay"]) / Fraction(loop["time_step"]))
        if multiplier != 0.0 or low is None:
            return False
    G = np.array([np.polyval(num, s) / np.polyval(den, s) for num, den in between(loop)]) * passed
    if low is None:  # of any memoryless element
        return loop["element"]["kind"] != "play" and bool((multiplier * (s * G).real > 0.0).all())
    G = G / (1 + low * G)
    holds = bool(np.all(((1 + multiplier * s) * G).real + room > -1e-9))
    if loop["element"]["kind"] == "play":
        return holds and (low, high, multiplier) == (0.0, 1.0, 0.0) and Fraction(loop["element"]["gap"]) > 0
    x = np.concatenate([-np.geomspace(1e-3, 1e3, 999), np.geomspace(1e-3, 1e3, 999)])
    ratio = values_of(loop["element"], x) / x
    return holds and bool((ratio >= low - 1e-9).all() and (high is None or (ratio <= high + 1e-9).all()))


def no_cycle_with_play(document: Document) -> bool:
    loop, gap = document["loop"], float(Fraction(document["loop"]["element"]["gap"]))
    made = (L((list(num), list(den)), epp.Play(gap)) for num, den in between(loop)[::3])
    return all(len(epp.find_limit_cycles(own)) == 0 for own in made)


def arcs_close(document: Document) -> bool:
    """The arcs, integrated in floats: each ends where its guard rises through zero, none earlier, and all close."""
    arcs, claim = document["loop"]["arcs"], document["claim"]
    n, evidence = len(arcs[0]["rate"]), document["evidence"]
    x, legs = np.append(numbers(evidence["solution"])[: n - 1], 1.0), 0.0
    start, taken = x.copy(), iter(numbers(evidence["solution"])[n - 1 :: n])
    for arc in arcs:
        rate, jump = (np.array([numbers(row) for row in arc[name]]) for name in ("rate", "jump"))
        guards = np.array([numbers(row) for row in arc["guards"]])
        if not arc["at_once"]:
            duration = float(next(taken))
            legs += duration
            path = np.stack([expm(rate * t) @ x for t in np.linspace(0.0, duration, 60)])
            values = path @ guards.T
            early = values[1:-1].max() > 1e-9 * np.abs(values).max()
            if early or abs(values[-1, arc["fired"]]) > 1e-9 * np.abs(values).max():
                return False
            x = path[-1]
        x = jump @ x
    low, high = numbers(claim["period"])
    return np.allclose(x, start, rtol=1e-9, atol=1e-9) and low <= legs * (1 + 1e-12) and legs * (1 - 1e-12) <= high


def cycles_are_these(document: Document) -> bool:
    loop, claim = document["loop"], document["claim"]
    (at, level), *_ = loop["element"]["jumps"]
    element = epp.RelayDeadZone(threshold=float(Fraction(at)), level=float(Fraction(level)))
    found = epp.find_limit_cycles(L((list(numbers(loop["num"])), list(numbers(loop["den"]))), element)).cycles
    periods = sorted(cycle.period for cycle in found)
    ends = [numbers(cycle["period"]) for cycle in claim["cycles"]]
    return len(periods) == len(ends) and all(a <= t <= b for t, (a, b) in zip(periods, ends, strict=True))


def gap_loses(document: Document) -> bool:
    """Of the elbow: what the gap lets the loop gain, at many frequencies and in floats, is less than what it loses."""
    omega = np.geomspace(1e-2, 1e6, 4001)
    return bool((gained(document, omega) < 1.0).all()) and document["claim"]["backlash"] == document["loop"]["backlash"]


WITNESS = {
    "roots": roots_are_as_many,
    "balance": roots_are_as_many,
    "absence": no_cycle_by_frequency,
    "play": no_cycle_with_play,
    "orbit": arcs_close,
    "cells": cycles_are_these,
    "elbow": gap_loses,
}
