"""Pictures of driven loops: a jump resonance, the waveforms of three responses to one sine, a dithered relay."""

from __future__ import annotations

from matplotlib.figure import Figure

import eppanalysis as epp


def yielding_spring() -> epp.Diagram:
    """A mass on a spring whose force is limited: x'' + 0.2 x' = sat(force - x)."""
    return epp.Diagram(
        parts={
            "spring": epp.Saturation(lower=-1.0, upper=1.0),
            "mass": epp.blocks.TransferFunction(num=[1.0], den=[1.0, 0.2, 0.0]),
        },
        connect=["force - mass -> spring", "spring -> mass"],
        inputs=["force"],
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
