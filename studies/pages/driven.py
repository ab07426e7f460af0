"""Pictures of driven loops: jump resonance, three responses to one sine, a dithered relay, anti-windup by clamping."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

import eppanalysis as epp
from eppanalysis.plotting import BLUE, GREY, VERMILLION, label_time, panels_of, put_legend


def yielding_spring() -> epp.Diagram:
    """A mass on a spring whose force is limited: x'' + 0.2 x' = sat(end - x)."""
    return epp.Diagram(
        parts={
            "spring": epp.Saturation(lower=-1.0, upper=1.0),
            "mass": epp.blocks.TransferFunction(num=[1.0], den=[1.0, 0.2, 0.0]),
        },
        connect=["end - mass -> spring", "spring -> mass"],
        inputs=["end"],
        name="yielding spring",
    )


def jump_resonance() -> Figure:
    """Response over the frequency, through both folds, with first order beside it."""
    return (
        epp.frequency_response(yielding_spring(), output="mass", amplitude=0.5, frequencies=(0.09, 0.18)).plot().figure
    )


def three_responses() -> Figure:
    """All periodic responses to one sine between the folds."""
    return (
        epp.forced_response(yielding_spring(), amplitude=0.5, frequency=0.127).plot(signals=["mass", "spring"]).figure
    )


def dithered_relay() -> Figure:
    """What a fast sine leaves of a relay's limit cycle over its amplitude, and of the relay."""
    loop = epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Relay())
    return epp.dither(loop, frequency=4.0).plot().figure


def clamped_pid() -> Figure:
    """A large step of a servo: the clamped PI controller before and behind its limits, and one that winds up."""
    figure, (left, right) = panels_of(2, 1.8)
    times = np.linspace(0.0, 12.0, 601)
    controllers = {
        "clamped": (epp.ClampedPID(kp=1.0, ki=0.3), BLUE),
        "winds up": (epp.AntiWindupPID(kp=1.0, ki=0.3, tracking_time=1e4), VERMILLION),
    }
    for label, (controller, colour) in controllers.items():
        servo = epp.Diagram(
            parts={"pi": controller, "servo": epp.blocks.TransferFunction(num=[1.0], den=[1.0, 1.5, 0.0])},
            connect=["r - servo -> pi", "pi -> servo"],
            inputs=["r"],
            signals={"position": "servo"},
        )
        run = epp.simulate(servo, epp.inputs.Step(3.0), t_end=12.0, t_eval=times)
        left.plot(times, run.signals["position"], color=colour, label=label)
        right.plot(times, run.signals["pi"], color=colour, label=label)
    left.axhline(3.0, color=GREY, linewidth=0.5)
    left.set_ylabel("position")
    right.set_ylabel("output u")
    label_time([left, right], "time [s]")
    put_legend(left)
    return figure
