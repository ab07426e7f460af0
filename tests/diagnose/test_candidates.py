"""Loops with gains for elements, elements of other sizes, and cycles that grow in proportion."""

from __future__ import annotations

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.diagnose.candidates import candidates_of, resized, size_exponents
from eppanalysis.methods.margins.linearised import Linearised
from eppanalysis.models.systems.absorbed import with_gains

ELEMENTS = [
    epp.Play(0.7), epp.JumpAndFollow(1.0, 0.4, 2.0), epp.Saturation(-1.0, 2.0, 3.0), epp.DeadZone(-0.2, 0.5, 1.5),
    epp.Quantiser(0.25, 8), epp.Coulomb(0.8), epp.Relay(-1.5, 1.0, 0.2), epp.Preload(0.4, 2.0),
    epp.HysteresisRelay(0.5, 1.0),
]  # fmt: skip


def point(loop: epp.LureSystem) -> epp.OperatingPoint:
    return epp.OperatingPoint.of(loop)


@pytest.mark.parametrize("element", ELEMENTS, ids=lambda e: e.kind)
def test_an_element_of_another_size_has_the_same_map_enlarged(element):
    rng = np.random.default_rng(4)
    big, memory, other = resized(element, 2.5), None, None
    for x in rng.uniform(-3.0, 3.0, 40):
        y, memory = element.output(x, memory)
        z, other = big.output(2.5 * x, other)
        assert float(z) == pytest.approx(2.5 * float(y), abs=1e-12)


def test_sizes_that_are_ratios_or_zero_stay():
    assert size_exponents(epp.Friction(1.0, 2.0)) == {"coulomb": 1, "static": 1}
    assert size_exponents(epp.Friction(1.0, 2.0, stribeck=0.5))["stribeck"] == -1
    assert size_exponents(epp.Play(0.0)) == {}
    assert size_exponents(epp.RateLimiter(2.0)) == {"rate": 1}


def test_gains_take_the_place_of_elements_as_in_margins():
    loop = epp.LureSystem.from_blocks(
        [epp.Saturation(-1.0, 1.0, 2.0), ([3.0], [1.0, 2.0, 5.0]), epp.Play(1.0), ([1.0], [0.3, 1.0]),
         epp.Quantiser(0.1, 9)]
    )  # fmt: skip
    closed = with_gains(loop, {i: e.linear_gain() for i, e in enumerate(loop.elements)})
    assert closed.elements == ()
    # ((s^2 + 2 s + 5)(0.3 s + 1) + 6) = 0
    roots = np.roots(np.polyadd(np.polymul([1.0, 2.0, 5.0], [0.3, 1.0]), [6.0]))
    assert np.sort_complex(np.linalg.eigvals(closed.A)) == pytest.approx(np.sort_complex(roots), abs=1e-10)
    terms = Linearised.of(loop, "saturation").closed().terms
    assert np.sort_complex(np.linalg.eigvals(terms[0][1])) == pytest.approx(np.sort_complex(roots), abs=1e-10)


@pytest.mark.slow
def test_an_element_alone_is_in_the_loop_that_one_writes_by_hand():
    loop = epp.LureSystem.from_blocks(
        [epp.Saturation(-5.0, 5.0), ([5.0], [1.0, 1.0, 0.0]), epp.Play(2.0)], element_names=["limit", "gear"]
    )
    family = next(f for f in candidates_of(loop, point(loop)).families if f.name == "gear")
    by_hand = epp.find_limit_cycles(epp.LureSystem.from_tf(([5.0], [1.0, 1.0, 0.0]), epp.Play(2.0)))
    (cycle,) = family.cycles()
    assert family.in_proportion
    assert cycle.period == pytest.approx(by_hand.stable[0].period, rel=1e-9)
    assert cycle.peak_to_peak["gear_input"] == pytest.approx(by_hand.stable[0].peak_to_peak["x"], rel=1e-9)
    (doubled,) = epp.find_limit_cycles(family.loop(2.0)).stable
    assert doubled.period == pytest.approx(cycle.period, rel=1e-9)
    assert doubled.peak_to_peak["gear_input"] == pytest.approx(2.0 * cycle.peak_to_peak["gear_input"], rel=1e-9)


def test_what_has_no_gain_is_a_candidate_all_the_same():
    loop = epp.LureSystem.from_blocks([epp.Relay(), ([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Play(0.0)])
    found = candidates_of(loop, point(loop))
    assert set(found.left_out) == {"play"} and "no size" in found.left_out["play"]
    assert [family.name for family in found.families] == ["relay"]
    assert found.linear.refusal == "relay cannot be taken as linear"


def test_behind_dead_time_no_gain_takes_the_place_of_an_element_and_the_element_is_tried():
    loop = epp.LureSystem.from_tf(([1.0], [1.0, 1.0, 0.0]), epp.Play(1.0), delay=0.1)
    found = candidates_of(loop, point(loop))
    assert "dead time behind play" in found.linear.refusal
    assert [family.name for family in found.families] == ["play"]
