"""Limit cycles by cells of the return map: images hold what an integrator finds, and what proves nothing is refused."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

import eppanalysis as epp
from eppanalysis.methods.certificates import check_cells
from eppanalysis.methods.certificates.cells import find
from eppanalysis.methods.certificates.registry import sealed
from tests.shared import mostly_slow

flint = pytest.importorskip("flint")


def relay(gain: float, p: float = 1.0, q: float = 1.0, threshold: float = 1.0) -> epp.LureSystem:
    """With p = q = 1 its exact fold of cycles is at a gain of 3.0074."""
    den = [1.0, p + q, p * q, 0.0]
    return epp.LureSystem.from_tf(([gain], den), epp.RelayDeadZone(threshold=threshold), name="relay")


@pytest.fixture(scope="module")
def five() -> epp.Certificate:
    """The list at a gain of 5, which takes seconds to find."""
    return epp.certify(relay(5.0), "cycles")


def proved_cycles(found: epp.Certificate) -> list[tuple[float, float, int]]:
    """Periods from and to, and multipliers outside."""
    return [tuple(row) for row in found.to_frame().itertuples(index=False)]


def next_switch(matrix: np.ndarray, z: np.ndarray, levels: tuple[float, ...]) -> np.ndarray | None:
    """Where the position next meets a level, by the exact flow; None where it has come to rest."""

    def beyond(t: float, start: np.ndarray, level: float) -> float:
        return float((expm(matrix * t) @ start)[0] - level)

    step = expm(matrix * 2e-3)
    for _ in range(40_000):
        later = step @ z
        for level in levels:
            if (z[0] - level) * (later[0] - level) < 0.0:
                return expm(matrix * brentq(beyond, 0.0, 2e-3, args=(z, level))) @ z
        z = later
    return None


def image(beta: float, kappa: float, v: float, a: float) -> tuple[float, float] | None:
    """The next switch to a level, mirrored if need be; None where the motion comes to rest."""
    matrix = np.array([[0, 1, 0, 0], [0, 0, 1, 0], [0, -beta, -1, -kappa], [0, 0, 0, 0]])
    z = next_switch(matrix, np.array([1.0 + 1e-15, v, a, 1.0]), (1.0,))
    assert z is not None
    z = next_switch(matrix, np.array([1.0 - 1e-15, z[1], z[2], 0.0]), (-1.0, 1.0))
    return None if z is None else (float(np.sign(z[0]) * z[1]), float(np.sign(z[0]) * z[2]))


@pytest.mark.parametrize(("p", "q"), [(1.0, 1.0), (0.3, 1.7), (2.5, 0.8)])
def test_images_hold_the_motions(p: float, q: float) -> None:
    with flint.ctx.workprec(check_cells.BITS):
        returns = check_cells.ReturnMap(epp.certify(relay(1.7 * p * q * (p + q), p, q)).document["loop"])
        beta, kappa, *sides = (float(flint.arb(x).mid()) for x in (returns.beta, returns.kappa, *returns.sides))
        rng = np.random.default_rng(4)
        for _ in range(6):
            v, a = rng.uniform(0.05, 0.5) * sides[0], rng.uniform(-0.3, 0.3) * sides[1]
            low, high = (0.98 * v, 1.02 * v), sorted((0.98 * a, 1.02 * a))
            found = returns.images(*(flint.arb(x).union(flint.arb(y)) for x, y in (low, high)))
            wanted = image(beta, kappa, v, a)
            held = wanted is None or any(
                all(float(x.lower()) - 1e-9 < y < float(x.upper()) + 1e-9 for x, y in zip(box[:2], wanted, strict=True))
                for box in found
            )
            assert held, (v, a, wanted, found)


def test_absence_is_proved_where_popov_fails_and_changed_files_are_refused(tmp_path) -> None:
    found = epp.certify(relay(2.05), "absence")
    assert found.proved and "return map" in str(found)
    assert epp.check_certificate(found.write(tmp_path / "relay.json")).accepted
    document = dict(found.document)
    evidence = document["evidence"]
    for changed in (
        {"loop": {**document["loop"], "num": ["16/5"]}},  # which has two cycles
        {"evidence": {**evidence, "order": evidence["order"][::-1]}},
        {"evidence": {**evidence, "cover": evidence["cover"][:-1]}},
        {"claim": {"cells": 1, "cycles": []}},
    ):
        with pytest.raises((check_cells.Refused, ValueError)):
            check_cells.verify(sealed({**document, **changed}))


@pytest.mark.slow
def test_no_loop_with_a_cycle_is_certified_to_have_none() -> None:
    for gain in (3.01, 3.02, 5.0):
        found = epp.certify(relay(gain), "absence")
        assert not found.proved and not found.document and "returns" in found.message


@pytest.mark.slow
def test_absence_is_proved_to_a_hundredth_of_the_fold() -> None:
    assert epp.certify(relay(2.977), "absence").proved


@pytest.mark.slow
def test_the_list_is_that_of_the_exact_orbits(five: epp.Certificate) -> None:
    found, exact = proved_cycles(five), epp.find_limit_cycles(relay(5.0)).cycles
    assert len(found) == len(exact) == 2
    for (low, high, outside), cycle in zip(found, sorted(exact, key=lambda c: c.period), strict=True):
        assert low < cycle.period < high
        assert (outside == 0) == cycle.stable


@pytest.mark.slow
def test_the_list_is_the_same_with_both_signs_other_levels_and_another_unit_of_time(five: epp.Certificate) -> None:
    same = epp.LureSystem.from_tf(([-2.5], [1.0, 2.0, 1.0, 0.0]), epp.RelayDeadZone(threshold=0.3, level=-0.6))
    assert epp.certify(same, "cycles").document["claim"] == five.document["claim"]
    other = epp.certify(relay(40.0, 2.0, 2.0), "cycles")
    for (low, high, outside), fast in zip(proved_cycles(five), proved_cycles(other), strict=True):
        assert fast == pytest.approx((low / 2, high / 2, outside), rel=1e-11)


@pytest.mark.parametrize(
    ("gain", "p", "q", "count"),
    mostly_slow([(0.04, 0.1, 1.0, 0), (8.0, 1.0, 2.5, 0)], [(0.04, 0.1, 1.0, 0)]),
)
def test_cycles_of_other_poles(gain: float, p: float, q: float, count: int) -> None:
    found = epp.certify(relay(gain, p, q), "cycles")
    assert found.proved
    assert len(found.document["claim"]["cycles"]) == len(found.to_frame()) == count


@pytest.mark.slow
def test_changed_lists_are_refused(five: epp.Certificate, tmp_path) -> None:
    check = epp.check_certificate(five.write(tmp_path / "cycles.json"))
    assert check.accepted and "exactly 2 limit cycles" in str(check)
    document = dict(five.document)
    claim, evidence = document["claim"], document["evidence"]
    one, other = claim["cycles"]
    (number, form), (another, its_form) = evidence["forms"]
    all_one = [number] * claim["cells"]
    for changed in (
        {"claim": {**claim, "cycles": [one]}},
        {"claim": {**claim, "cycles": []}, "evidence": {**evidence, "forms": []}},
        {"claim": {**claim, "cycles": [one]}, "evidence": {**evidence, "forms": [[number, form]]}},
        {"claim": {**claim, "cycles": [one, one]}, "evidence": {**evidence, "forms": [[number, form]] * 2}},
        {"claim": {**claim, "cycles": [other, one]}},
        {"claim": {**claim, "cycles": [{**one, "outside": 1}, other]}},
        {"claim": {**claim, "cycles": [{**one, "period": ["6.3", "6.31"]}, other]}},
        {"evidence": {**evidence, "forms": [[number, its_form], [another, form]]}},
        {"evidence": {**evidence, "forms": [[number, ["0", "0", "0"]], [another, its_form]]}},
        {"evidence": {**evidence, "order": [another if n == number else n for n in evidence["order"]]}},
        {"claim": {**claim, "cycles": [one]}, "evidence": {**evidence, "forms": [[number, form]], "order": all_one}},
        {"loop": {**document["loop"], "num": ["51/10"]}},
    ):
        with pytest.raises((check_cells.Refused, ValueError, TypeError, ArithmeticError)):
            check_cells.verify(sealed({**document, **changed}))


def test_what_is_not_covered_says_so(monkeypatch) -> None:
    for element in (epp.Saturation(), epp.Relay(), epp.HysteresisRelay(lower=-1.0, upper=1.0)):
        loop = epp.LureSystem.from_tf(([5.0], [1.0, 2.0, 1.0, 0.0]), element, name="other")
        found = epp.certify(loop, "cycles")
        assert not found.proved and not found.document and str(found).startswith("Not covered: lists of cycles")
    monkeypatch.setattr(find, "_MOST_CELLS", 400)
    early = epp.certify(relay(5.0), "cycles")
    assert not early.proved and not early.document and "Not decided: the list of cycles" in str(early)
