"""The box in which roots are sought: it holds what the prediction lists, and ends where motions would come again."""

from __future__ import annotations

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.methods.certificates import check_roots
from eppanalysis.methods.certificates.registry import sealed
from tests.shared import mostly_slow

pytest.importorskip("flint")
L = epp.LureSystem.from_tf


def mode(damping: float) -> list[float]:
    """Two lags beside a mode at 1 rad/s."""
    return list(np.polymul([1.0, 2.0 * damping, 1.0], np.polymul([0.2, 1.0], np.polymul([0.2, 1.0], [0.2, 1.0]))))


LOOPS = {
    **{f"relay, damping {d:g}": L(([1.0, 1.0], mode(d)), epp.Relay()) for d in (0.0, 1e-14, 1e-9, 1e-6, 1e-3)},
    "Coulomb": L(([1.0, 1.0], mode(1e-9)), epp.Coulomb(0.3)),
    "saturation, great gain": L(([1e8], [1.0, 3.0, 3.0, 1.0]), epp.Saturation()),
    "saturation, slow and fast": L(([9.0e10], [1.0, 3.0e3, 3.0e6, 1.0e3]), epp.Saturation()),
    "cube": L(([1e-9], [1.0, 3.0, 3.0, 1.0]), epp.Cube(1.0)),
    "relay with hysteresis": L(([1e4], [1.0, 3.0, 3.0, 1.0]), epp.HysteresisRelay(-1e-6, 1e-6)),
    "play, great gain": L(([500.0], [0.2, 1.2, 1.0, 0.0]), epp.Play(gap=1e-3)),
    "dead time": L(([50.0], [1.0, 1.0]), epp.Saturation(), delay=0.5),
    "bias": L(([1.0], [1.0, 3.0, 3.0, 1.0]), epp.HysteresisRelay(-1e-4, 1e-4, -0.7, 1.3)),
}


@pytest.mark.parametrize("name", mostly_slow(LOOPS, [n for n in LOOPS if n != "bias"][::4]))
def test_no_predicted_cycle_lies_outside_of_the_default_box(name: str) -> None:
    loop = LOOPS[name]
    found, predicted = epp.certify(loop), epp.predict_limit_cycles(loop)
    (label,) = loop.element_names
    assert found.document and len(predicted)
    ends = {side: [check_roots.rational(x) for x in box] for side, box in found.document["box"].items()}
    for cycle in predicted:
        where = cycle.elements[label]["amplitude"], cycle.omega
        for (low, high), x in zip((ends["amplitude"], ends["frequency"]), where, strict=True):
            assert float(low.p) / float(low.q) < x < float(high.p) / float(high.q)
        sides = zip((*found.roots, *found.undecided), strict=True)
        assert any(
            box.amplitude[0] * (1 - 1e-6) <= where[0] <= box.amplitude[1] * (1 + 1e-6)
            and box.omega[0] * (1 - 1e-6) <= where[1] <= box.omega[1] * (1 + 1e-6)
            for (box,) in sides
        )


@pytest.mark.parametrize("damping", [0.0, 1e-14, 1e-9, 1e-3])
def test_the_box_of_an_element_without_thresholds_hangs_on_no_resonance(damping: float) -> None:
    """One root at 0.8665, whatever the damping of a mode beside it."""
    found = epp.certify(LOOPS[f"relay, damping {damping:g}"])
    assert found.proved and len(found.roots) == 1
    assert found.roots[0].amplitude[0] == pytest.approx(0.8665, rel=0.01)


def sampled(time_step: float) -> epp.LureSystem:
    """A lag and an integrator, sampled, behind a relay with hysteresis."""
    lag = np.exp(-time_step)
    A = [[1.0, 1.0 - lag], [0.0, lag]]
    return epp.LureSystem.build(
        A, [[-0.5], [-(1.0 - lag)]], [[1.0, 0.0]], [epp.HysteresisRelay(-0.1, 0.1)], time_step=time_step
    )


@pytest.mark.parametrize("time_step", [0.01, 1.0, 7.0])
@pytest.mark.parametrize("beyond", [1.0001, 1.5, 4.0])
def test_a_box_beyond_half_the_sampling_frequency_is_refused(time_step: float, beyond: float) -> None:
    loop = sampled(time_step)
    with pytest.raises(epp.EppError, match="half the sampling frequency"):
        epp.certify(loop, box={"amplitude": (0.11, 9.0), "omega": (0.01 / time_step, beyond * np.pi / time_step)})
    found = epp.certify(loop, box={"amplitude": (0.11, 9.0), "omega": (0.01 / time_step, 3.0 / time_step)})
    document = dict(found.document)
    document["box"] = {**document["box"], "frequency": [document["box"]["frequency"][0], str(int(9.0 / time_step) + 1)]}
    with pytest.raises(check_roots.Refused, match="half the sampling frequency"):
        check_roots.verify(sealed(document))


def test_the_box_that_is_printed_lies_in_the_one_that_is_proved() -> None:
    """Its ends are rounded inward, as what is proved of a box is not proved of a larger one."""
    box = {"amplitude": (0.123456, 9.87654), "omega": (0.333333, 7.77777)}
    found = epp.certify(L(([1.0], [1.0, 3.0, 3.0, 1.0]), epp.Saturation()), box=box)
    assert str(found).endswith("for amplitudes 0.1235 to 9.876, 0.3334 to 7.777 rad/s and no bias.")
