"""What elements say of themselves in exact numbers is what they do; elements of one's own may say it too."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.models.elements.exact import Exact, Half, Named, Pieces, Reading
from tests.wrong_arguments import fields_of_elements

MADE = {kind.__name__: kind(**fields) for kind, fields in fields_of_elements()}
STATIC = [
    *(element for element in MADE.values() if element.is_single and element._isstatic()),
    epp.BilinearSpring(lower=-0.5, upper=1.25, outer=3.0, inner=0.5),
    epp.DeadZone(-0.25, 0.75, 2.0),
    epp.PiecewiseLinear([-1.0, 0.5], [1.0, 0.0, 2.0], [0.0, -1.0, 0.25]),
    epp.Relay(-1.0, 2.0),
    epp.Saturation(-0.5, 2.0, 1.5),
]


def value(half: Half, x: Fraction) -> Fraction:
    """What a half says at x > 0, off its bends and jumps."""
    bent = sum((change * (x - at) for at, change in half.bends if at < x), Fraction(0))
    return half.slope * x + bent + sum((height for at, height in half.jumps if at < x), Fraction(0))


def test_pieces_are_the_map_itself() -> None:
    for element in STATIC:
        exact = element.exact(Fraction)
        if not isinstance(exact, Pieces):
            assert exact is None or exact.kind in ("cube", "drag")
            continue
        x = np.random.default_rng(3).uniform(0.0, 8.0, 200)
        for half, way in zip(exact, (1.0, -1.0), strict=True):
            said = [float(value(half, Fraction(at))) for at in x]
            assert said == pytest.approx(way * element.output(way * x)[0], rel=1e-12, abs=1e-12)


def test_a_name_comes_with_the_numbers_of_the_element() -> None:
    assert epp.Play(gap=0.25).exact(Fraction) == Named("play", {"gap": Fraction(1, 4)})
    named = [
        e for e in MADE.values() if not isinstance(e, epp.HysteresisRelay) and isinstance(e.exact(Fraction), Named)
    ]
    assert {type(e).__name__ for e in named} >= {"Cube", "Drag", "JumpAndFollow", "Play"}
    biased = {"lower": Fraction(1, 4), "upper": Fraction(1, 2), "low": Fraction(-1), "high": Fraction(1)}
    assert epp.HysteresisRelay(0.25, 0.5).exact(Fraction) == Named("biased_relay", biased)


class Valve(epp.AutomatonElement):
    """A saturation that is nobody's subclass."""

    def exact(self, read: Reading) -> Exact | None:
        return epp.Saturation().exact(read)

    def under_dither(self, amplitude: float) -> epp.Nonlinearity:
        return epp.Saturation(slope=1.0 / (1.0 + amplitude))


def test_an_element_of_ones_own_takes_part() -> None:
    own, known = Valve(epp.Saturation().automaton()), epp.Saturation()
    plant = ([5.99], [1.0, 3.0, 2.0, 0.0])
    proofs = [epp.certify(epp.LureSystem.from_tf(plant, e, name="valve"), "absence") for e in (own, known)]
    assert proofs[0].proved and proofs[0].document == proofs[1].document
    assert epp.smoothed(own, 1.0) == epp.Saturation(slope=0.5)
