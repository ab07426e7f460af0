"""Limit cycles of loops with backlash, friction and other nonlinear elements.

The public face. Every name is imported from its module when it is first used, so that ``import eppanalysis`` costs
next to nothing; ``dir(eppanalysis)`` lists the names.

Examples
--------
>>> import eppanalysis as epp
>>> loop = epp.LureSystem.from_tf(([5.0], [1.0, 1.0, 0.0]), epp.Play(gap=2.0))
>>> loop.name
'loop'
"""

from __future__ import annotations

import sys
from functools import wraps
from importlib import import_module
from inspect import isfunction
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from eppanalysis.advice import design_advice as design_advice
    from eppanalysis.case import (
        Case as Case,
        case as case,
        case_from_text as case_from_text,
        read_case as read_case,
        shipped_cases as shipped_cases,
    )
    from eppanalysis.errors import (
        CaseError as CaseError,
        EppError as EppError,
        ModelError as ModelError,
        NotConverged as NotConverged,
    )
    from eppanalysis.guidelines import Guide as Guide, design_guide as design_guide
    from eppanalysis.identify import Identification as Identification, identify as identify
    from eppanalysis.methods.bounds import DesignBounds as DesignBounds, design_bounds as design_bounds
    from eppanalysis.methods.bounds_tolerance import (
        ToleranceBound as ToleranceBound,
        tolerance_bound as tolerance_bound,
    )
    from eppanalysis.methods.continuation import Branch as Branch, continue_branch as continue_branch
    from eppanalysis.methods.cycles import CycleSearch as CycleSearch, find_limit_cycles as find_limit_cycles
    from eppanalysis.methods.describing import predict_limit_cycles as predict_limit_cycles
    from eppanalysis.methods.describing_frozen import FrozenLoop as FrozenLoop, frozen_nyquist as frozen_nyquist
    from eppanalysis.methods.exact import exact_orbit as exact_orbit
    from eppanalysis.methods.folds import FoldCurve as FoldCurve, continue_folds as continue_folds
    from eppanalysis.methods.harmonic import harmonic_balance as harmonic_balance
    from eppanalysis.methods.knock import Knock as Knock, knock as knock
    from eppanalysis.methods.ladder import Ladder as Ladder, ladder as ladder
    from eppanalysis.methods.simulate import simulate as simulate
    from eppanalysis.models import signals as signals
    from eppanalysis.models.elbow import ElbowParameters as ElbowParameters, elbow as elbow
    from eppanalysis.models.linear import StateSpace as StateSpace
    from eppanalysis.models.lure import LureSystem as LureSystem
    from eppanalysis.models.nonlinearities import (
        Coulomb as Coulomb,
        Cube as Cube,
        DeadZone as DeadZone,
        DeadZoneSaturation as DeadZoneSaturation,
        FiveBandLaw as FiveBandLaw,
        Friction as Friction,
        HysteresisRelay as HysteresisRelay,
        HysteresisRelayDeadZone as HysteresisRelayDeadZone,
        JumpAndFollow as JumpAndFollow,
        LockPin as LockPin,
        Nonlinearity as Nonlinearity,
        NordinShaft as NordinShaft,
        PiecewiseLinear as PiecewiseLinear,
        Play as Play,
        Preload as Preload,
        Quantiser as Quantiser,
        Relay as Relay,
        RelayDeadZone as RelayDeadZone,
        Saturation as Saturation,
        Sine as Sine,
        StictionPulley as StictionPulley,
    )
    from eppanalysis.models.operating import OperatingPoint as OperatingPoint
    from eppanalysis.plots_map import (
        plot_design_map as plot_design_map,
        plot_parallel as plot_parallel,
        plot_slices as plot_slices,
        plot_sweep as plot_sweep,
    )
    from eppanalysis.report import report as report
    from eppanalysis.results import (
        Event as Event,
        LimitCycle as LimitCycle,
        Prediction as Prediction,
        Status as Status,
        Trajectory as Trajectory,
    )
    from eppanalysis.sweep import (
        LatinHypercube as LatinHypercube,
        Sobol as Sobol,
        Tolerances as Tolerances,
        Zipped as Zipped,
        open_sweep as open_sweep,
        sweep as sweep,
    )
    from eppanalysis.sweep.boundary import (
        Boundary as Boundary,
        fold_boundary as fold_boundary,
        outcome_boundary as outcome_boundary,
    )
    from eppanalysis.tables import table as table

__version__ = "0.1.0"

#: Public names by the module that holds them.
_NAMES = {
    "advice": ("design_advice",),
    "case": ("Case", "case", "case_from_text", "read_case", "shipped_cases"),
    "errors": ("CaseError", "EppError", "ModelError", "NotConverged"),
    "guidelines": ("Guide", "design_guide"),
    "identify": ("Identification", "identify"),
    "methods.bounds": ("DesignBounds", "design_bounds"),
    "methods.bounds_tolerance": ("ToleranceBound", "tolerance_bound"),
    "methods.continuation": ("Branch", "continue_branch"),
    "methods.cycles": ("CycleSearch", "find_limit_cycles"),
    "methods.describing": ("predict_limit_cycles",),
    "methods.describing_frozen": ("FrozenLoop", "frozen_nyquist"),
    "methods.exact": ("exact_orbit",),
    "methods.folds": ("FoldCurve", "continue_folds"),
    "methods.harmonic": ("harmonic_balance",),
    "methods.knock": ("Knock", "knock"),
    "methods.ladder": ("Ladder", "ladder"),
    "methods.simulate": ("simulate",),
    "plots_map": ("plot_design_map", "plot_parallel", "plot_slices", "plot_sweep"),
    "sweep": ("LatinHypercube", "Sobol", "Tolerances", "Zipped", "open_sweep", "sweep"),
    "sweep.boundary": ("Boundary", "fold_boundary", "outcome_boundary"),
    "models.elbow": ("ElbowParameters", "elbow"),
    "models.linear": ("StateSpace",),
    "models.lure": ("LureSystem",),
    "models.operating": ("OperatingPoint",),
    "models.nonlinearities": (
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
        "PiecewiseLinear",
        "Play",
        "Preload",
        "Quantiser",
        "Relay",
        "RelayDeadZone",
        "Saturation",
        "Sine",
        "StictionPulley",
    ),
    "report": ("report",),
    "results": ("Event", "LimitCycle", "Prediction", "Status", "Trajectory"),
    "tables": ("table",),
}
_MODULE_OF = {name: module for module, names in _NAMES.items() for name in names}
#: Public modules, for names that would not be clear on their own (the motions Step, Ramp, Sine, ...).
_MODULES = {"signals": "models.signals"}


def __getattr__(name: str) -> Any:
    """Import a public name on its first use (PEP 562)."""
    if name in _MODULES:
        value: Any = import_module(f"{__name__}.{_MODULES[name]}")
    elif name in _MODULE_OF:
        value = getattr(import_module(f"{__name__}.{_MODULE_OF[name]}"), name)
        if isfunction(value):
            value = _at_the_door(value)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value
    return value


#: Methods over parameters, which need a case and stand below the cases: a loop becomes one at the door.
_OVER_PARAMETERS = ("continue_branch", "continue_folds", "design_bounds", "ladder", "tolerance_bound")


def _at_the_door(function: Any) -> Any:
    """The public function, which refuses arguments of wrong types in a sentence; inside the package nobody asks."""
    from eppanalysis.arguments import checked

    door = checked(_with_case(function) if function.__name__ in _OVER_PARAMETERS else function)
    door.__module__ = __name__  # so that processes find it by its public name
    return door


def _with_case(function: Any) -> Any:
    """A method whose argument `case` may be a loop, too."""

    @wraps(function)
    def call(case: Any, *args: Any, **kwargs: Any) -> Any:
        return function(import_module(f"{__name__}.case").as_case(case), *args, **kwargs)

    return call


def __dir__() -> list[str]:
    """Public names and the version."""
    return sorted([*_MODULE_OF, *_MODULES, "__version__"])


class _Package(ModuleType):
    """Keeps the public function `case` in front of the module ``eppanalysis.case``.

    Importing a submodule sets the attribute of its name on the package, which would hide the function behind the module
    from then on.
    """

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name in _MODULE_OF and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
