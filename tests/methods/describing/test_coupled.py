"""First order of loops that swing by themselves and act on each other."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import fsolve

import eppanalysis as epp

DEN = [1.0, 3.0, 2.0, 0.0]


def coupled(first: epp.Nonlinearity, second: epp.Nonlinearity, share: float, den: list[float] = DEN) -> epp.LureSystem:
    """Two loops of one plant, each with an element, that take a share of each other's output."""
    plant, gain = epp.blocks.TransferFunction, epp.blocks.Gain
    parts = {
        "a": first,
        "b": second,
        "pa": plant(num=[1.0], den=den, start=[0.2, 0.0, 0.0]),
        "pb": plant(num=[1.0], den=den),
    }
    parts |= {"to_b": gain(gain=share), "to_a": gain(gain=share)}
    wires = ["-pa -> a", "-pb -> b", "a -> to_b", "b -> to_a", "a + to_a -> pa", "b + to_b -> pb"]
    return epp.Diagram(parts=parts, connect=wires).to_system()


@pytest.mark.parametrize("share", [0.3, 0.01])
@pytest.mark.parametrize(
    "element",
    [
        pytest.param(lambda: epp.HysteresisRelay(-0.05, 0.05), id="hysteresis"),
        pytest.param(epp.Relay, id="relay"),
        pytest.param(lambda: epp.Saturation(-0.05, 0.05, 40.0), id="saturation"),
        pytest.param(lambda: epp.Arctan(1.0, 20.0), id="arctan"),
    ],
)
def test_two_equal_loops_swing_together_and_against_each_other_as_one_loop_does(
    element: Callable[[], epp.Nonlinearity], share: float
):
    found = epp.predict_limit_cycles(coupled(element(), element(), share))
    for sign in (1.0, -1.0):
        (one,) = epp.predict_limit_cycles(epp.LureSystem.from_tf(([1.0 + sign * share], DEN), element()))
        like = [
            c
            for c in found
            if c.omega == pytest.approx(one.omega, rel=1e-9)
            and [c.elements[e]["amplitude"] for e in "ab"] == pytest.approx([one.amplitude("x")] * 2, rel=1e-9)
            and np.cos(c.elements["b"]["phase"]) == pytest.approx(sign)
        ]
        assert len(like) == 1, found
        assert like[0].stable is (sign > 0)


def test_unequal_relays_that_act_on_each_other_swing_as_their_balance_says():
    widths, share = (0.05, 0.2), 0.3

    def plant(w: float) -> complex:
        return 1.0 / np.polyval(DEN, 1j * w)

    def off(x: np.ndarray) -> list[float]:
        a, b, turn, w = np.exp(x[0]), np.exp(x[1]), np.exp(1j * x[2]), np.exp(x[3])
        u, v = (
            4 / np.pi * (np.sqrt(max(1 - (h / z) ** 2, 0.0)) - 1j * h / z) for z, h in zip((a, b), widths, strict=True)
        )
        first, second = a + plant(w) * (u + share * v * turn), b + plant(w) * (v + share * u / turn)
        return [first.real, first.imag, second.real, second.imag]

    known, rng = set(), np.random.default_rng(1)
    for _ in range(120):
        start = np.array([*rng.uniform(-2, 0, 2), rng.uniform(-np.pi, np.pi), rng.uniform(-1, 1)])
        with np.errstate(all="ignore"):
            x, _, ok, _ = fsolve(off, start, full_output=True, xtol=1e-12)
        if ok == 1 and np.abs(off(x)).max() < 1e-9:
            known.add((round(float(np.exp(x[3])), 6), round(float(np.exp(x[0])), 6), round(float(np.exp(x[1])), 6)))
    relays = (epp.HysteresisRelay(-h, h) for h in widths)
    found = epp.predict_limit_cycles(coupled(*relays, share))
    told = sorted((c.omega, c.elements["a"]["amplitude"], c.elements["b"]["amplitude"]) for c in found)
    assert len(known) == 2
    assert np.array(told) == pytest.approx(np.array(sorted(known)), abs=2e-6)


def test_three_loops_in_a_ring_swing_one_after_the_other():
    # Each takes a share of the one before it: a turn of the phase by 0, or a third of a turn to either side.
    share, blocks = 0.2, epp.blocks
    parts = {}
    for i in range(3):
        parts |= {f"e{i}": epp.HysteresisRelay(-0.05, 0.05), f"k{i}": blocks.Gain(gain=share)}
        parts[f"p{i}"] = blocks.TransferFunction(num=[1.0], den=DEN, start=[0.2 * (i == 0), 0.0, 0.0])
    wires = [w for i in range(3) for w in (f"-p{i} -> e{i}", f"e{i} -> k{(i + 1) % 3}", f"e{i} + k{i} -> p{i}")]
    found = epp.predict_limit_cycles(epp.Diagram(parts=parts, connect=wires).to_system())
    for turn in (0.0, 2 * np.pi / 3, -2 * np.pi / 3):
        # One loop whose plant has the gain 1 + share exp(-i turn).
        factor = 1.0 + share * np.exp(-1j * turn)

        def off(x: np.ndarray, factor: complex = factor) -> list[float]:
            a, w = np.exp(x)
            gain = 4 / np.pi / a * (np.sqrt(max(1 - (0.05 / a) ** 2, 0.0)) - 0.05j / a)
            left = 1.0 + factor * gain / np.polyval(DEN, 1j * w)
            return [left.real, left.imag]

        a, w = np.exp(fsolve(off, [np.log(0.3), 0.2], xtol=1e-12))
        assert any(
            c.omega == pytest.approx(w, rel=1e-8)
            and all(e["amplitude"] == pytest.approx(a, rel=1e-8) for e in c.elements.values())
            and np.angle(np.exp(1j * (c.elements["e1"]["phase"] - c.elements["e0"]["phase"] - turn)))
            == pytest.approx(0, abs=1e-6)
            for c in found
        ), (turn, w, a)
