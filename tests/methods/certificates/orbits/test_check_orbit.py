"""The checker of certified orbits refuses files whose numbers prove nothing, and orbits that close but are none."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

import eppanalysis as epp
from eppanalysis.methods.certificates.orbits.axes import OwnAxes
from eppanalysis.methods.certificates.orbits.document import document_of
from eppanalysis.methods.certificates.orbits.path import ExactPath
from eppanalysis.methods.certificates.orbits.shooting import Shooting
from eppanalysis.methods.certificates.registry import sealed
from eppanalysis.methods.orbits.exact import start_of, steady_hybrid
from eppanalysis.methods.orbits.guess import Guess
from eppanalysis.methods.orbits.orbit import solve
from eppanalysis.methods.orbits.shooting import orbits_near
from eppanalysis.models.systems.subject import standing
from eppanalysis.results import LimitCycle, Status

flint = pytest.importorskip("flint")
from eppanalysis.methods.certificates import check_orbit  # noqa: E402

Document = dict[str, Any]
#: What the program of a checker turns into a refusal.
UNREADABLE = (check_orbit.Refused, LookupError, TypeError, ValueError, AttributeError, ArithmeticError)
#: The original elbow, of the drive of which friction sticks and breaks away at once; from a state on its orbit.
ELBOW = LimitCycle(
    "exact orbit", Status.CONVERGED, 0.11143840595, {}, {}, {}, True, memory=(None,) * 4,
    state=np.array([1.07672208857, -1.59535106532, 1.05490547292, -1.01184361578, -3.04599200703, -8.52635516511,
                    0.636443321161]),
)  # fmt: skip


def hysteresis(h: float, den: tuple[float, ...] = (1.0, 1.0)) -> tuple[epp.LureSystem, LimitCycle]:
    loop = epp.LureSystem.from_tf(([1.0], den), epp.HysteresisRelay(lower=-h, upper=h), name="relay")
    if len(den) > 2:
        cycle = epp.simulate(loop, t_end=60.0).limit_cycle
        assert cycle is not None
        return loop, epp.exact_orbit(loop, cycle)
    period = 2.0 * math.log((1.0 + h) / (1.0 - h))
    return loop, LimitCycle("exact orbit", Status.CONVERGED, period, {}, {}, {}, state=np.zeros(1), memory=(1.0,))


@pytest.fixture(scope="module")
def relay() -> Document:
    return dict(epp.certify_orbit(*hysteresis(0.5)).document)


@pytest.fixture(scope="module")
def elbow() -> Document:
    return dict(epp.certify_orbit(epp.case("fig8a_original"), ELBOW).document)


def copy_of(document: Document) -> Any:
    return json.loads(json.dumps(document))


def refused(document: Document) -> bool:
    """Whether a certificate is refused, its digest made to fit."""
    try:
        check_orbit.verify(sealed(document))
    except UNREADABLE:
        return True
    return False


def test_the_period_that_is_proved_holds_the_closed_form(relay: Document) -> None:
    claim = check_orbit.verify(copy_of(relay))
    low, high = map(Fraction, claim["period"])
    with flint.ctx.workprec(256):
        exact = 2 * flint.arb(3).log()
        assert flint.fmpq(*low.as_integer_ratio()) < exact < flint.fmpq(*high.as_integer_ratio())
    assert 0 < high - low < Fraction(1, 10**30) and claim["events"] == 2


@pytest.mark.slow
def test_events_without_delay_are_checked_as_well(elbow: Document) -> None:
    assert any(arc["at_once"] for arc in elbow["loop"]["arcs"]) and any(arc["levels"] for arc in elbow["loop"]["arcs"])
    low, high = map(Fraction, check_orbit.verify(copy_of(elbow))["period"])
    assert abs(float(low + high) / 2 - ELBOW.period) < 1e-10


def test_the_precision_of_others_is_left_alone(relay: Document) -> None:
    """Balls have one precision in a process, and other checkers have theirs."""
    with flint.ctx.workprec(53):
        check_orbit.verify(copy_of(relay))
        assert flint.ctx.prec == 53


def test_the_file_is_written_and_checked_in_a_process_of_its_own(tmp_path) -> None:
    found = epp.certify_orbit(*hysteresis(0.5))
    said = epp.check_certificate(found.write(tmp_path / "orbit.json"))
    assert said.accepted and "of the arcs in the file: they close to a limit cycle of 2.197 s with 2 events" in str(
        said
    )
    nothing = epp.certify_orbit(hysteresis(0.5)[0], hysteresis(0.3)[1])
    if not nothing.proved:
        with pytest.raises(epp.EppError, match="no certificate to write"):
            nothing.write(tmp_path / "none.json")


def scaled(text: str, by: str) -> str:
    return str(Fraction(text) * Fraction(by) + (Fraction(text) == 0))


@pytest.mark.parametrize("name", ["rate", "jump"])
def test_every_number_of_the_arcs_counts(relay: Document, name: str) -> None:
    for k, arc in enumerate(relay["loop"]["arcs"]):
        for i, row in enumerate(arc[name]):
            for j, value in enumerate(row):
                changed = copy_of(relay)
                changed["loop"]["arcs"][k][name][i][j] = scaled(value, "1.0000000000000001")
                assert refused(changed), (k, i, j)


@pytest.mark.parametrize("place", range(3))
def test_what_is_not_the_orbit_is_refused(relay: Document, place: int) -> None:
    evidence = copy_of(relay)["evidence"]
    for name, value in (
        ("solution", [scaled(v, "1.000001") if i == place else v for i, v in enumerate(evidence["solution"])]),
        ("solution", evidence["solution"][:-1]),
        ("radius", scaled(evidence["radius"], "1/1000000")),
        ("radius", "0"),
        ("radius", "1"),
        ("sizes", ["0", *evidence["sizes"][1:]]),
        ("weights", ["-1"] * len(evidence["weights"])),
        ("weights", []),
    ):
        assert refused({**copy_of(relay), "evidence": {**evidence, name: value}}), (name, value)
    for claim in ({"events": 3}, {"period": ["0", "100"]}, {"box": "1"}):
        assert refused({**copy_of(relay), "claim": {**relay["claim"], **claim}})
    wide = {**copy_of(relay), "evidence": {**evidence, "box": "1000"}}
    assert refused({**wide, "claim": {**relay["claim"], "box": "1000"}})
    with pytest.raises(check_orbit.Refused, match="changed"):
        check_orbit.verify({**relay, "digest": 1})


def test_a_guard_that_rises_earlier_is_met(relay: Document) -> None:
    """A second threshold: just below the one that fires it is reached before, just above it is not."""
    for share, earlier in (("0.9999999", True), ("1.0000001", False)):
        changed = copy_of(relay)
        for arc in changed["loop"]["arcs"]:
            row = list(arc["guards"][arc["fired"]])
            arc["guards"].append([*row[:-1], scaled(row[-1], share)])
            arc["on_rates"].append(False)
        if earlier:
            with pytest.raises(check_orbit.Refused, match="earlier"):
                check_orbit.verify(sealed(changed))
        else:
            check_orbit.verify(sealed(changed))


def test_changed_arcs_of_the_elbow_are_refused(elbow: Document) -> None:
    arcs = copy_of(elbow)["loop"]["arcs"]
    size = len(arcs[0]["rate"])
    for arc in arcs:
        arc["levels"].append(["1"] * size)  # stands on nothing, and must not be believed
    orbit = check_orbit.Orbit([check_orbit.Arc(arc, size - 1) for arc in arcs], size - 1)
    for k in orbit.timed:
        assert len(orbit.zero[k]) == len(arcs[k]["levels"]) and [1] * size not in orbit.zero[k]
    instants = [k for k, arc in enumerate(elbow["loop"]["arcs"]) if arc["at_once"]]
    for k in (instants[0], instants[0] - 1):
        changed = copy_of(elbow)
        changed["loop"]["arcs"][k]["at_once"] = not changed["loop"]["arcs"][k]["at_once"]
        assert refused(changed), f"arc {k} with other time"


def test_ghosts_of_a_relay_are_refused() -> None:
    """On a resonant plant many half periods close the equations; all but the shortest pass the threshold before."""
    loop, cycle = hysteresis(0.9, (1.0, 0.2, 1.0))
    system, at = standing(loop, None, "certify_orbit")
    hybrid = steady_hybrid(system, at)
    orbit = next(orbits_near(hybrid, *start_of(hybrid, cycle), cycle.period))
    A, b, c, one = loop.A, loop.B[:, 0], loop.C[0], np.eye(2)

    def begin(tau: float) -> np.ndarray:
        flow = expm(A * tau)
        return np.linalg.solve(one + flow, np.linalg.solve(A, (flow - one) @ b))

    times = np.linspace(0.5, 25.0, 500)
    miss = np.array([c @ begin(t) + 0.9 for t in times])
    guesses = times[:-1][(miss[:-1] * miss[1:] < 0.0) & (np.abs(miss[:-1] - miss[1:]) < 0.5)]
    first, ghosts = int(orbit.arcs.event_sequence.modes[0, 0]), 0
    for tau in guesses:
        y = orbit.y.copy()
        y[:2] = begin(tau) if first == 0 else -begin(tau)
        found = solve(hybrid, Guess(orbit.arcs.event_sequence, y, np.array([tau, tau])))
        if found.residual < 1e-9 and found.period > 1.01 * cycle.period:
            path = ExactPath.of(found)
            with flint.ctx.workprec(128):
                axes = OwnAxes.states(path, found)
                shooting = Shooting(axes, found)
                document = document_of(shooting.path, axes.basis, shooting, shooting.enclose())
            with pytest.raises(check_orbit.Refused, match="earlier"):
                check_orbit.verify(copy_of(document))
            ghosts += 1
    assert ghosts >= 3


def run_twice(document: Document) -> Document:
    """The same arcs twice over, with the solution of both rounds, sealed anew."""
    out = copy_of(document)
    out["loop"]["arcs"] *= 2
    out["loop"]["course"]["modes"] *= 2
    out["loop"]["course"]["guards"] *= 2
    for name in ("solution", "weights"):
        out["evidence"][name] *= 2
    return with_claim(out)


def with_claim(document: Document) -> Document:
    """A certificate with the claim that its evidence would show."""
    evidence, events = document["evidence"], len(document["loop"]["arcs"])
    k, timed = len(evidence["sizes"]), sum(not arc["at_once"] for arc in document["loop"]["arcs"])
    off = Fraction(evidence["radius"]) * Fraction(evidence["sizes"][-1]) * timed
    period = sum(map(Fraction, evidence["solution"][k - 1 :: k]))
    claim = {"events": events, "period": [str(period - off), str(period + off)], "box": evidence["box"]}
    return sealed({**document, "claim": claim})


@pytest.mark.parametrize("name", ["relay", pytest.param("elbow", marks=pytest.mark.slow)])
def test_an_orbit_that_is_run_twice_is_refused(name: str, request: pytest.FixtureRequest) -> None:
    """It closes after twice its period as well, which is not its period; nor where the rounds are told apart by a
    guard that is written otherwise.
    """
    document = request.getfixturevalue(name)
    check_orbit.verify(with_claim(copy_of(document)))
    doubled = run_twice(document)
    with pytest.raises(check_orbit.Refused, match="more than once"):
        check_orbit.verify(doubled)
    arc = doubled["loop"]["arcs"][0]
    arc["guards"] = [[scaled(v, "2") if Fraction(v) else v for v in row] for row in arc["guards"]]
    with pytest.raises(check_orbit.Refused, match="more than once"):
        check_orbit.verify(with_claim(doubled))


def assert_only_its_own_course(document: Document, own: Any, about: Callable[[Document, Any], bool | None]) -> None:
    assert about(document, epp.case("backlash_servo")) is False and about(document, epp.case("sat_am165")) is False
    for place, value in (
        ("modes", [[9]]),
        ("guards", [99]),
        ("unknown", [7]),
        ("basis", [["3"]]),
        ("held", [[0, "1"]]),
    ):
        changed = copy_of(document)
        changed["loop"]["course"][place] = value
        assert about(changed, own) is False


@pytest.mark.parametrize("name", ["relay", pytest.param("elbow", marks=pytest.mark.slow)])
def test_a_file_is_about_the_loop_whose_arcs_it_has_and_no_other(
    name: str, request: pytest.FixtureRequest, tmp_path
) -> None:
    document = request.getfixturevalue(name)
    own = hysteresis(0.5)[0] if name == "relay" else epp.case("fig8a_original")
    other = hysteresis(0.5000001)[0] if name == "relay" else own.with_values({"lock_pin.backlash": "2.27 deg"})
    path = tmp_path / "orbit.json"

    def about(document: Document, loop: Any) -> bool | None:
        path.write_text(json.dumps(sealed(document)))
        return epp.check_certificate(path, loop).about

    assert about(document, own) is True and about(document, other) is False
    if name == "relay":
        assert_only_its_own_course(document, own, about)
    guards = [(k, g) for k, arc in enumerate(document["loop"]["arcs"]) for g in range(len(arc["guards"]))]
    left_out = 0
    for k, g in [x for x in guards if x[1] != document["loop"]["arcs"][x[0]]["fired"]][:3]:
        changed = copy_of(document)
        arc = changed["loop"]["arcs"][k]
        arc["guards"].pop(g)
        arc["on_rates"].pop(g)
        arc["fired"] -= g < arc["fired"]
        assert about(changed, own) is not True
        left_out += 1
    assert name == "relay" or left_out == 3
