"""The nonlinear elements: map in time, closed-form describing function, automaton."""

from eppanalysis.models.nonlinearities.base import ELEMENTS, Nonlinearity, OwnStates
from eppanalysis.models.nonlinearities.contact import LockPin, NordinShaft
from eppanalysis.models.nonlinearities.friction import Friction
from eppanalysis.models.nonlinearities.memory import (
    HysteresisRelay,
    HysteresisRelayDeadZone,
    JumpAndFollow,
    Play,
    Slip,
    StictionPulley,
)
from eppanalysis.models.nonlinearities.own import AutomatonElement
from eppanalysis.models.nonlinearities.parking import ParkingBandLaw, SampledLaw
from eppanalysis.models.nonlinearities.static import (
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
