"""A linear part with an undamped pole swings by itself where the element passes nothing on: no box there is empty."""

from __future__ import annotations

from itertools import cycle, product

import numpy as np
import pytest

import eppanalysis as epp
from tests.shared import mostly_slow

pytest.importorskip("flint")
ELEMENTS = {
    "dead zone": epp.DeadZone(),
    "play": epp.Play(gap=2.0),
    "relay with dead zone": epp.RelayDeadZone(threshold=1.0),
    "quantiser": epp.Quantiser(step=2.0, levels=5),
    "relay with hysteresis": epp.HysteresisRelay(lower=-1.0, upper=1.0),
    "three levels": epp.HysteresisRelayDeadZone(on=1.0, off=0.5),
    "stiction": epp.JumpAndFollow(stick_band=2.0, slip_jump=0.5),
    "uneven dead zone": epp.DeadZone(-1.0, 3.0),
    "uneven relay": epp.HysteresisRelay(lower=-2.0, upper=2.5),
}
BOX = {"amplitude": (0.1, 0.9), "omega": (0.5, 2.0)}
#: Linear parts with a pole at 1 rad/s that no damping moves, of several orders, with delay and a zero.
PLANTS = {
    "oscillator": ([1.0], [1.0, 0.0, 1.0]),
    "with a lag": ([1.0], [1.0, 1.0, 1.0, 1.0]),
    "with an integrator": ([2.0, 1.0], [1.0, 0.0, 1.0, 0.0]),
}
#: Behind an integrator every bias within the dead zone balances, too: many boxes are left, of a small one.
BY_BIAS, SMALL = ("uneven dead zone", "with an integrator"), {"amplitude": (0.4, 0.5), "omega": (0.9, 1.1)}


@pytest.mark.parametrize(
    ("name", "plant"), mostly_slow(product(ELEMENTS, PLANTS), [*zip(ELEMENTS, cycle(PLANTS), strict=False)])
)
def test_what_swings_alone_is_not_proved_absent(name: str, plant: str) -> None:
    loop = epp.LureSystem.from_tf(PLANTS[plant], ELEMENTS[name])
    found = epp.certify(loop, box=SMALL if (name, plant) == BY_BIAS else BOX)
    if not found.document:
        assert found.message.startswith("Not covered")
        return
    assert not found.proved and found.undecided and (len(found.undecided) < 200 or (name, plant) == BY_BIAS)
    assert all(box.omega[0] <= 1.0 <= box.omega[1] for box in found.undecided)
    assert "At 1 rad/s the linear part has a pole without damping" in found.message


@pytest.mark.slow
@pytest.mark.parametrize("name", ["dead zone", "relay with hysteresis"])
def test_nor_is_what_swings_and_grows(name: str) -> None:
    """A double pole, beside which the balance is as small as the square of the distance."""
    found = epp.certify(epp.LureSystem.from_tf(([1.0], [1.0, 0.0, 2.0, 0.0, 1.0]), ELEMENTS[name]), box=BOX)
    assert not found.proved and all(abs(box.omega[0] - 1.0) < 1e-3 for box in found.undecided)


@pytest.mark.parametrize("delay", [0.3, 2.0])
def test_dead_time_does_not_hide_it(delay: float) -> None:
    loop = epp.LureSystem.from_tf(PLANTS["oscillator"], epp.DeadZone(), delay=delay)
    assert not epp.certify(loop, box=BOX).proved


def test_nor_do_samples() -> None:
    """A mode on the unit circle at 0.9 rad per sample, behind a dead zone."""
    A = np.array([[np.cos(0.9), -np.sin(0.9)], [np.sin(0.9), np.cos(0.9)]])
    loop = epp.LureSystem.build(A, [[0.0], [1.0]], [[1.0, 0.0]], [epp.DeadZone()], time_step=1.0)
    found = epp.certify(loop, box=BOX)
    # Its numbers are rounded ones: beside the mode of the stated loop, which may be damped a little, nothing hides.
    assert found.proved or all(box.omega[0] <= 0.9 + 1e-6 and box.omega[1] >= 0.9 - 1e-6 for box in found.undecided)


@pytest.mark.parametrize("amplitude", [(0.05, 0.45), None])
def test_a_mass_on_a_belt_slides_back_for_ever(amplitude: tuple[float, float] | None) -> None:
    """Slower than the belt the friction is a constant force, and the mass swings on its spring with any amplitude."""
    loop = epp.LureSystem.build(
        [[0.0, 1.0], [-1.0, 0.0]], [[0.0], [-1.0]], [[0.0, 1.0]], [epp.Friction(coulomb=0.3)], constant_input=[-0.5]
    )
    box = {"amplitude": amplitude, "omega": (0.5, 2.0), "bias": (-1.0, -0.4)} if amplitude else None
    found = epp.certify(loop, box=box)
    assert not found.proved and found.undecided
    assert any(b.omega[0] <= 1.0 <= b.omega[1] and b.bias[0] <= -0.5 <= b.bias[1] for b in found.undecided)
    sizes = [b.amplitude for b in found.undecided]
    assert min(low for low, _ in sizes) < 0.06 and max(high for _, high in sizes) > 0.44


def test_a_ring_with_an_undamped_link_is_not_proved_free_of_roots() -> None:
    """Two dead zones, of which neither passes anything on: the oscillator between them swings by itself."""
    A = [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]
    B, C = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], [[0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]
    loop = epp.LureSystem.build(A, B, C, [epp.DeadZone(), epp.DeadZone()])
    found = epp.certify(loop, box=BOX)
    assert not found.proved


@pytest.mark.parametrize("damping", [1e-6, 1e-3])
@pytest.mark.parametrize("name", ["dead zone", "relay with hysteresis", "uneven relay"])
def test_a_little_damping_decides(name: str, damping: float) -> None:
    """Then nothing swings below the threshold, and the box is proved empty."""
    loop = epp.LureSystem.from_tf(([1.0], [1.0, 2.0 * damping, 1.0]), ELEMENTS[name])
    box = BOX | ({"bias": (0.5, 1.4)} if name == "uneven relay" else {})
    found = epp.certify(loop, box=box)
    assert found.proved and not found.roots and "without damping" not in found.message
