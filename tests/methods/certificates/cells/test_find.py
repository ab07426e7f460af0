"""Absence by cells of the return map: images hold what an integrator finds, and what proves nothing is refused."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

import eppanalysis as epp
from eppanalysis.methods.certificates import check_cells
from eppanalysis.methods.certificates.registry import sealed

flint = pytest.importorskip("flint")


def relay(gain: float, p: float = 1.0, q: float = 1.0) -> epp.LureSystem:
    """With p = q = 1 its exact fold of cycles is at a gain of 3.0074."""
    den = [1.0, p + q, p * q, 0.0]
    return epp.LureSystem.from_tf(([gain], den), epp.RelayDeadZone(threshold=1.0), name="relay")


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
            found = returns.reached(*([flint.arb(x) for x in side] for side in (low, high)))
            wanted = image(beta, kappa, v, a)
            held = wanted is None or any(
                all(float(x.lower()) - 1e-9 < y < float(x.upper()) + 1e-9 for x, y in zip(box, wanted, strict=True))
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
        {"claim": {"cells": 1}},
    ):
        with pytest.raises((check_cells.Refused, TypeError)):
            check_cells.verify(sealed({**document, **changed}))


def test_no_loop_with_a_cycle_is_certified() -> None:
    for gain in (3.02, 5.0):
        found = epp.certify(relay(gain), "absence")
        assert not found.proved and not found.document and "returns" in found.message
