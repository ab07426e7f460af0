"""Gains that fall through what a loop asks for and through zero within a hair: friction where a sine just stops it."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

import eppanalysis as epp

_COULOMB, _STATIC, _STRIBECK = 0.6, 1.0, 0.2


def _friction(v: float) -> float:
    return (_COULOMB + (_STATIC - _COULOMB) * np.exp(-((v / _STRIBECK) ** 2))) * np.sign(v)


def _gain(amplitude: float, bias: float) -> float:
    """Sine describing function of the friction, by quadrature."""
    rest = np.arcsin(-bias / amplitude) if abs(bias) < amplitude else 0.0
    parts = quad(
        lambda p: _friction(bias + amplitude * np.sin(p)) * np.sin(p),
        -np.pi / 2.0, np.pi / 2.0, points=[rest], epsabs=1e-12, epsrel=1e-12, limit=200,
    )  # fmt: skip
    return float(2.0 * parts[0] / (np.pi * amplitude))


def _block(speed: float, damping: float, friction: epp.Nonlinearity, tilt: float = 0.0) -> epp.LureSystem:
    """A block on a spring and a belt with friction; with a `tilt` the belt's speed follows the position."""
    return epp.Diagram(
        parts={
            "block": epp.blocks.Mass(mass=1.0, damping=damping, stiffness=1.0, start=[1.0, 0.0]),
            "friction": friction,
            "tilt": epp.blocks.Gain(gain=tilt),
            "belt": epp.blocks.Constant(value=speed),
        },
        connect=["block.position -> tilt", "block.speed + tilt - belt -> friction", "-friction -> block.force"],
    ).to_system()


@pytest.mark.parametrize("speed", [0.02, 0.1, 0.3])
@pytest.mark.parametrize("damping", [1e-3, 0.05])
def test_the_cycle_that_just_comes_to_rest_on_its_belt_is_predicted(speed: float, damping: float) -> None:
    # The damper and the friction together take nothing out of the motion at 1 rad/s.
    largest = brentq(lambda a: _gain(a, -speed) + damping, speed * (1.0 + 1e-12), 1.2 * speed, xtol=1e-15)
    friction = epp.StribeckFriction(coulomb=_COULOMB, static=_STATIC, velocity=_STRIBECK)
    predicted = [cycle for cycle in epp.predict_limit_cycles(_block(speed, damping, friction)) if cycle.stable]
    assert [cycle.omega for cycle in predicted] == pytest.approx([1.0], rel=1e-9)
    assert predicted[0].peak_to_peak["block_speed"] / 2.0 == pytest.approx(largest, rel=1e-8)


def test_it_is_predicted_where_the_mean_goes_along_with_the_size() -> None:
    falling = epp.PiecewiseLinear(
        breakpoints=[-0.4, 0.0, 0.4], slopes=[0.0, -1.0, -1.0, 0.0], intercepts=[-0.6, -1.0, 1.0, 0.6]
    )
    tilt = 1e-4
    plain, tilted = (epp.predict_limit_cycles(_block(0.1, 0.05, falling, t)) for t in (0.0, tilt))
    assert len(tilted) == len(plain) == 1
    assert tilted[0].omega == pytest.approx(plain[0].omega, rel=5.0 * tilt)
    # A position of about one moves the speed of the belt by as much.
    sizes = [prediction[0].peak_to_peak["block_speed"] for prediction in (plain, tilted)]
    assert sizes[1] == pytest.approx(sizes[0], rel=20.0 * tilt)
    assert sizes[1] != sizes[0]
