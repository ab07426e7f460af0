"""The nonlinear elements: map in time, closed-form describing function, automaton."""

from eppanalysis.models.elements.base import ELEMENTS, Nonlinearity, OwnStates
from eppanalysis.models.elements.contact import LockPin, NordinShaft
from eppanalysis.models.elements.friction import Friction
from eppanalysis.models.elements.hysteresis import HysteresisRelay, HysteresisRelayDeadZone
from eppanalysis.models.elements.memory import JumpAndFollow, Play, Slip, StictionPulley
from eppanalysis.models.elements.own import AutomatonElement
from eppanalysis.models.elements.parking import ParkingBandLaw, SampledLaw
from eppanalysis.models.elements.static import (
    Coulomb,
    Cube,
    DeadZone,
    DeadZoneSaturation,
    FiveBandLaw,
    PiecewiseLinear,
    Preload,
    Quantiser,
    Relay,
    RelayDeadZone,
    Saturation,
    Sine,
)

__all__ = [
    "ELEMENTS",
    "AutomatonElement",
    "Coulomb",
    "Cube",
    "DeadZone",
    "DeadZoneSaturation",
    "FiveBandLaw",
    "Friction",
    "HysteresisRelay",
    "HysteresisRelayDeadZone",
    "JumpAndFollow",
    "LockPin",
    "Nonlinearity",
    "NordinShaft",
    "OwnStates",
    "ParkingBandLaw",
    "PiecewiseLinear",
    "Play",
    "Preload",
    "Quantiser",
    "Relay",
    "RelayDeadZone",
    "SampledLaw",
    "Saturation",
    "Sine",
    "Slip",
    "StictionPulley",
]
