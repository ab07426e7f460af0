"""Roots with a bias and of rings: against the search of the prediction, quadrature, other units, and changed files."""

from __future__ import annotations

import copy
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from flint import arb, fmpq

import eppanalysis as epp
from eppanalysis.methods.certificates import check_balance
from eppanalysis.methods.certificates.check_balance import Element, Jet, Refused
from eppanalysis.methods.certificates.rational import element_data
from eppanalysis.methods.certificates.registry import sealed
from eppanalysis.methods.certificates.roots.ring import order_of
from tests.shared import mostly_slow

ELEMENTS = (
    epp.Saturation(-0.5, 2.0, 1.3),
    epp.DeadZone(-0.4, 0.7, 2.0),
    epp.Relay(-0.7, 1.3),
    epp.RelayDeadZone(threshold=0.4, level=2.0),
    epp.BilinearSpring(lower=-0.4, upper=0.6, outer=3.0, inner=0.5),
    epp.Play(gap=0.6),
    epp.HysteresisRelay(-0.1, 0.3, -0.7, 1.3),
)


@pytest.mark.parametrize("element", ELEMENTS, ids=repr)
def test_gain_and_mean_are_those_of_the_describing_function_and_their_slopes_those_of_differences(
    element: epp.Nonlinearity,
) -> None:
    """Formulas of the checker against those of the elements, which quadrature confirms; a wide box holds its points."""
    described = Element(element_data(element))

    def over(*sides: float) -> tuple[Jet, Jet]:
        ends = [arb(fmpq(*Fraction(x).as_integer_ratio())) for x in sides]
        A, B = ends[0].union(ends[1]), ends[2].union(ends[3])
        return described.over(Jet(A, [arb(1), arb(0)]), Jet(B, [arb(0), arb(1)]))

    rng = np.random.default_rng(5)
    for a, b in rng.uniform((0.5, -1.0), (3.0, 1.0), (15, 2)):
        mean, gain = element.describing_function(a, b)
        found = over(a, a, b, b)
        if gain == 0:
            assert complex(found[0].x) == 0
            continue
        assert complex(found[0].x) == pytest.approx(complex(gain), rel=1e-12)
        assert float(found[1].x.mid()) == pytest.approx(float(mean), rel=1e-12, abs=1e-13)
        wide = over(a, a + 0.3, b, b + 0.2)
        for k, (da, db) in enumerate(((1e-6, 0.0), (0.0, 1e-6))):
            sides = [element.describing_function(a + sign * da, b + sign * db) for sign in (1, -1)]
            near = (sides[0].gain - sides[1].gain) / 2e-6, (sides[0].mean - sides[1].mean) / 2e-6
            assert complex(found[0].slopes[k]) == pytest.approx(complex(near[0]), rel=1e-4, abs=1e-6)
            assert complex(found[1].slopes[k]) == pytest.approx(complex(near[1]), rel=1e-4, abs=1e-6)
        inner = over(a + 0.1, a + 0.1, b + 0.1, b + 0.1)
        for one, other in zip(wide, inner, strict=True):
            assert abs(one.x - other.x).contains(0) or not one.x.is_finite()


BIASED = ("relay_biased_fopdt", pytest.param("sat_asymmetric", marks=pytest.mark.slow))
RINGS = tuple(pytest.param(name, marks=pytest.mark.slow) for name in ("sat_plus_backlash", "wheelchair"))


@pytest.mark.parametrize("name", [*BIASED, *RINGS])
def test_shipped_loops_with_a_bias_and_rings_are_decided(name: str) -> None:
    """Witness: the search of the prediction, which knows no balls."""
    case = epp.case(name)
    found, predicted = epp.certify(case), epp.predict_limit_cycles(case)
    assert found.proved and not found.undecided and len(found.roots) == len(predicted)
    label = case.to_system().element_names[order_of(case.to_system())[0]]
    for root, cycle in zip(found.roots, sorted(predicted, key=lambda c: c.elements[label]["amplitude"]), strict=True):
        assert root.amplitude[0] == pytest.approx(cycle.elements[label]["amplitude"], rel=1e-9)
        assert root.omega[0] == pytest.approx(cycle.omega, rel=1e-9)
        assert root.bias[0] == pytest.approx(cycle.elements[label]["bias"], rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("least", mostly_slow([0.25, 0.3], [0.3]))
def test_a_ring_is_decided_though_its_cuts_meet_the_threshold_of_play(least: float) -> None:
    """Play passes nothing on at 0.5: the amplitude before the saturation is zero, and its phase anything."""
    found = epp.certify(epp.case("sat_plus_backlash"), box={"amplitude": (least, 64.0)})
    assert found.proved and len(found.roots) == 2
    assert len(found.document["evidence"]["cover"][0]) < 1000


def relay(unit: float = 1.0, seconds: float = 1.0) -> epp.LureSystem:
    """A relay with a bias around 1/(s + 1)^3, in any units of its input and of time."""
    element = epp.HysteresisRelay(-0.1 * unit, 0.1 * unit, -0.7 * unit, 1.3 * unit)
    return epp.LureSystem.from_tf(([1.0], [seconds**3, 3 * seconds**2, 3 * seconds, 1.0]), element)


BOX = {"amplitude": (0.05, 2.0), "omega": (0.25, 4.0), "bias": (-1.0, 1.0)}


@pytest.fixture(scope="module")
def found() -> epp.Certificate:
    return epp.certify(relay(), box=BOX)


@pytest.mark.slow
@pytest.mark.parametrize(("unit", "seconds"), [(1e-6, 1e6), (1e6, 1e-6)])
def test_units_change_nothing(found: epp.Certificate, unit: float, seconds: float) -> None:
    ends = {"amplitude": unit, "omega": 1 / seconds, "bias": unit}
    (one,) = found.roots
    scaled = epp.certify(relay(unit, seconds), box={n: (a * ends[n], b * ends[n]) for n, (a, b) in BOX.items()})
    (other,) = scaled.roots
    assert scaled.proved
    for name, scale in ends.items():
        assert getattr(other, name)[0] == pytest.approx(scale * getattr(one, name)[0], rel=1e-10)


def test_a_constant_input_biases_a_loop_as_much_as_a_shifted_relay(found: epp.Certificate) -> None:
    """The same loop with its input counted from elsewhere has the same cycle, and the bias moved by as much."""
    loop = epp.LureSystem.build(
        relay().A, relay().B, relay().C, [epp.HysteresisRelay(0.1, 0.3, -0.7, 1.3)], constant_input=[0.2]
    )
    (moved,), (root,) = epp.certify(loop, box=BOX).roots, found.roots
    assert moved.amplitude[0] == pytest.approx(root.amplitude[0], rel=1e-12)
    assert moved.bias[0] - 0.2 == pytest.approx(root.bias[0], rel=1e-12)


@pytest.fixture(scope="module")
def document(found: epp.Certificate) -> dict[str, Any]:
    return dict(found.document)


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (("loop", "ring", 0, "num"), ["101/100"]),
        (("loop", "ring", 0, "delay"), "1/10"),
        (("loop", "ring", 0, "element", "low"), "-1"),
        (("loop", "ring", 0, "element", "upper"), "-1/5"),
        (("loop", "ring", 0, "element", "kind"), "hysteresis_relay"),
        (("loop", "means"), ["1", "1", "1"]),
        (("loop", "means"), ["2", "1", "0"]),
        (("loop", "means"), ["1", "2", "0"]),
        (("loop", "means"), ["0", "0", "0"]),
        (("loop", "means"), []),
        (("box", "bias"), ["-2", "2"]),
        (("evidence", "roots"), []),
        (("evidence", "roots", 0, "region", 5), "1"),
        (("evidence", "roots", 0, "enclosure", 1), "1/100"),
        (("evidence", "cover"), ["."]),
        (("claim", "roots"), 2),
    ],
)
def test_changed_certificates_are_refused(document: dict[str, Any], place: tuple[Any, ...], value: Any) -> None:
    changed = copy.deepcopy(document)
    assert check_balance.verify(changed) == {"roots": 1, "undecided": 0}
    part = changed
    for name in place[:-1]:
        part = part[name]
    assert part[place[-1]] != value
    part[place[-1]] = value
    with pytest.raises((Refused, LookupError, TypeError, ValueError)):
        check_balance.verify(sealed(changed))


def test_the_sentence_names_the_biases_and_the_box_refuses_what_is_none(found: epp.Certificate) -> None:
    assert str(found).endswith("for amplitudes 0.05 to 2, 0.25 to 4 rad/s and biases -1 to 1.")
    assert found.to_frame().bias_from[0] == found.roots[0].bias[0]
    assert found.plot().get_ylabel()
    with pytest.raises(epp.EppError, match="bias of the box is"):
        epp.certify(relay(), box={"bias": (1.0, -1.0)})
