"""Pictures of the how-to pages: ``python -m studies.pages.howto``."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import eppanalysis as epp
from studies import GENERATED


def own_device_branch() -> Figure:
    """Cycles of the wheelchair over its free play."""
    return (
        epp.continue_branch(epp.case("wheelchair"), "play.gap", start=0.012, stop=0.004)
        .plot(signal="play_input")
        .figure
    )


def own_device_map() -> Figure:
    """Where the wheelchair settles, over gain and free play."""
    axes = {"loop.gain": "0.5:1.2:22", "play.gap": "0:0.02:21"}
    return epp.plot_design_map(epp.sweep(epp.case("wheelchair"), axes, progress=False))


def measured_prediction() -> Figure:
    """Cycles of a relay round a measured response."""
    loop = epp.MeasuredLoop(epp.read_response("frequency_response.csv"), epp.RelayDeadZone(threshold=1.0), name="relay")
    return epp.predict_limit_cycles(loop).plot().figure


def measured_model() -> Figure:
    """A measured response and its rational model."""
    return epp.rational_model(epp.read_response("frequency_response.csv")).plot().figure


def onset_point() -> Figure:
    """Onset point of a rate-limited actuator in a loop of pitch attitude."""
    airframe = {"num": [3.476, 3.1708072, 0.0896237936], "den": [1, 0.8608, 5.3159942, 0.108928, 0.0529]}
    attitude = epp.Diagram(
        parts={
            "pilot": epp.blocks.Gain(gain=1.0),
            "actuator": epp.RateLimitedServo(bandwidth=25.0, rate=np.deg2rad(15.0)),
            "pitch": epp.blocks.TransferFunction(**airframe),
        },
        connect=["command - pitch -> pilot", "pilot -> actuator", "actuator -> pitch"],
        inputs=["command"],
    )
    return epp.olop(attitude.to_system(), amplitude=np.deg2rad(5.0)).plot().figure


def make_all(folder: Path) -> None:
    """Make every picture."""
    for make in (own_device_branch, own_device_map, measured_prediction, measured_model, onset_point):
        make().savefig(folder / f"{make.__name__}.png", dpi=150, metadata={"Software": None})


if __name__ == "__main__":
    GENERATED.mkdir(exist_ok=True)
    make_all(GENERATED)
