"""The nonlinear elements: map in time, closed-form describing function, automaton."""

from eppanalysis.models.elements.base import ELEMENTS, Nonlinearity, OwnStates
from eppanalysis.models.elements.contact import LockPin, NordinShaft
from eppanalysis.models.elements.curves.monotone import MonotoneTable
from eppanalysis.models.elements.curves.pieces import (
    BilinearSpring,
    Comparator,
    FloorQuantiser,
    MidRiseQuantiser,
    WrapAround,
)
from eppanalysis.models.elements.curves.sliding import StribeckFriction, ViscousCoulomb
from eppanalysis.models.elements.curves.smooth import Arctan, Cube, Drag, Polynomial, Tanh
from eppanalysis.models.elements.curves.table import LookupTable
from eppanalysis.models.elements.dynamic.bouc_wen import BoucWen
from eppanalysis.models.elements.dynamic.bristles import LuGreFriction
from eppanalysis.models.elements.dynamic.clamping import ClampedPID
from eppanalysis.models.elements.dynamic.controller import AntiWindupPID
from eppanalysis.models.elements.dynamic.impact import ImpactStop
from eppanalysis.models.elements.dynamic.parking import ParkingBandLaw, SampledLaw
from eppanalysis.models.elements.dynamic.presliding import DahlFriction
from eppanalysis.models.elements.dynamic.pulses import NaturalPulseWidthModulator, PulseWidthModulator
from eppanalysis.models.elements.dynamic.rate import RateLimitedServo, RateLimiter
from eppanalysis.models.elements.dynamic.reset import CleggIntegrator, FirstOrderReset
from eppanalysis.models.elements.dynamic.sampled import ControllerMemory, SampledController
from eppanalysis.models.elements.dynamic.timed import TimedRelay
from eppanalysis.models.elements.friction import Friction
from eppanalysis.models.elements.hysteresis import HysteresisRelay, HysteresisRelayDeadZone
from eppanalysis.models.elements.memory import BacklashCompensator, JumpAndFollow, Play, Slip, StictionPulley
from eppanalysis.models.elements.own import AutomatonElement
from eppanalysis.models.elements.plays import PrandtlIshlinskii
from eppanalysis.models.elements.static import (
    Coulomb,
    DeadZone,
    DeadZoneSaturation,
    FiveBandLaw,
    FrictionCompensator,
    PiecewiseLinear,
    Preload,
    Quantiser,
    Relay,
    RelayDeadZone,
    Saturation,
    Sine,
)

__all__ = [
    "AntiWindupPID",
    "Arctan",
    "AutomatonElement",
    "ControllerMemory",
    "BacklashCompensator",
    "BilinearSpring",
    "BoucWen",
    "ClampedPID",
    "CleggIntegrator",
    "Comparator",
    "Coulomb",
    "Cube",
    "DahlFriction",
    "DeadZone",
    "DeadZoneSaturation",
    "Drag",
    "ELEMENTS",
    "FirstOrderReset",
    "FiveBandLaw",
    "FloorQuantiser",
    "Friction",
    "FrictionCompensator",
    "HysteresisRelay",
    "HysteresisRelayDeadZone",
    "ImpactStop",
    "JumpAndFollow",
    "LockPin",
    "LookupTable",
    "MonotoneTable",
    "LuGreFriction",
    "MidRiseQuantiser",
    "NaturalPulseWidthModulator",
    "Nonlinearity",
    "NordinShaft",
    "OwnStates",
    "ParkingBandLaw",
    "PiecewiseLinear",
    "Play",
    "Polynomial",
    "PrandtlIshlinskii",
    "Preload",
    "PulseWidthModulator",
    "Quantiser",
    "RateLimitedServo",
    "RateLimiter",
    "Relay",
    "RelayDeadZone",
    "SampledController",
    "SampledLaw",
    "Saturation",
    "Sine",
    "Slip",
    "StictionPulley",
    "StribeckFriction",
    "Tanh",
    "TimedRelay",
    "ViscousCoulomb",
    "WrapAround",
]
