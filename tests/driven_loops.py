"""Loops that a sine drives, with the equations they stand for."""

import numpy as np

import eppanalysis as epp

TURN = 2.0 * np.pi


def loop(element, num, den):
    """A force on a plant behind which an element pulls back: plant(force - element(plant))."""
    return epp.Diagram(
        parts={"spring": element, "mass": epp.blocks.TransferFunction(num=num, den=den)},
        connect=["force - spring -> mass", "mass -> spring"],
        inputs=["force"],
    ).to_system()


def saturated():
    """x'' + 0.2 x' = sat(0.5 sin(omega t) - x), the spring in front of the mass."""
    return epp.Diagram(
        parts={
            "spring": epp.Saturation(lower=-1.0, upper=1.0),
            "mass": epp.blocks.TransferFunction(num=[1.0], den=[1.0, 0.2, 0.0]),
        },
        connect=["force - mass -> spring", "spring -> mass"],
        inputs=["force"],
    ).to_system()


def duffing(cubic=1.0, damping=0.2, stiffness=1.0):
    """x'' + damping x' + stiffness x + cubic x^3 = force."""
    return loop(epp.Cube(cubic), [1.0], [1.0, damping, stiffness])
