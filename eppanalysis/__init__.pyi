"""The public names, and the modules that hold them: the one list of both type checkers and ``__init__.py``."""

from eppanalysis.cases import (
    Case as Case,
    case as case,
    case_from_text as case_from_text,
    read_case as read_case,
    shipped_cases as shipped_cases,
)
from eppanalysis.cases.from_robot import from_robot as from_robot
from eppanalysis.cases.values.responses import read_linear as read_linear, read_response as read_response
from eppanalysis.diagnose import Diagnosis as Diagnosis, diagnose as diagnose
from eppanalysis.errors import (
    CaseError as CaseError,
    EppError as EppError,
    ModelError as ModelError,
    NotConverged as NotConverged,
)
from eppanalysis.fmu.export import to_fmu as to_fmu
from eppanalysis.fmu.read import from_fmu as from_fmu
from eppanalysis.guides.guideline import design_guide as design_guide
from eppanalysis.guides.manual import manual_table as manual_table
from eppanalysis.guides.result import Guide as Guide
from eppanalysis.identify import Identification as Identification, identify as identify
from eppanalysis.methods.bounds.design import DesignBounds as DesignBounds, design_bounds as design_bounds
from eppanalysis.methods.bounds.tolerances.bound import (
    ToleranceBound as ToleranceBound,
    tolerance_bound as tolerance_bound,
)
from eppanalysis.methods.certificates.certify import certify as certify, check_certificate as check_certificate
from eppanalysis.methods.certificates.orbits.certify import certify_orbit as certify_orbit
from eppanalysis.methods.certificates.orbits.result import (
    CertifiedOrbit as CertifiedOrbit,
    OrbitStability as OrbitStability,
    Proof as Proof,
)
from eppanalysis.methods.certificates.result import Certificate as Certificate, Check as Check
from eppanalysis.methods.comparison.ladder import Ladder as Ladder, ladder as ladder
from eppanalysis.methods.continuation.branch import continue_branch as continue_branch
from eppanalysis.methods.continuation.folds import FoldCurve as FoldCurve, continue_folds as continue_folds
from eppanalysis.methods.continuation.result import Branch as Branch
from eppanalysis.methods.describing.frozen import FrozenLoop as FrozenLoop, frozen_nyquist as frozen_nyquist
from eppanalysis.methods.describing.predict import predict_limit_cycles as predict_limit_cycles
from eppanalysis.methods.design.design import Design as Design, design as design
from eppanalysis.methods.dither.least import dither as dither
from eppanalysis.methods.dither.result import Dither as Dither
from eppanalysis.methods.dither.smoothed import smoothed as smoothed
from eppanalysis.methods.driven.forced import forced_response as forced_response
from eppanalysis.methods.driven.frequency import (
    amplitude_response as amplitude_response,
    frequency_response as frequency_response,
)
from eppanalysis.methods.driven.result import (
    ForcedResponse as ForcedResponse,
    FrequencyResponse as FrequencyResponse,
    PeriodicResponse as PeriodicResponse,
    ResponseBranch as ResponseBranch,
)
from eppanalysis.methods.elements.check import check_element as check_element
from eppanalysis.methods.elements.result import ElementCheck as ElementCheck
from eppanalysis.methods.harmonic.balance import harmonic_balance as harmonic_balance
from eppanalysis.methods.harmonic.sinusoidal import sinusoidal_harmonics as sinusoidal_harmonics
from eppanalysis.methods.margins.margins import margins as margins
from eppanalysis.methods.margins.olop import olop as olop
from eppanalysis.methods.margins.olop_result import OnsetPoint as OnsetPoint
from eppanalysis.methods.margins.result import Margins as Margins
from eppanalysis.methods.orbits.exact import exact_orbit as exact_orbit
from eppanalysis.methods.rational.fit import rational_model as rational_model
from eppanalysis.methods.rational.result import RationalModel as RationalModel
from eppanalysis.methods.search.find import find_limit_cycles as find_limit_cycles
from eppanalysis.methods.search.result import CycleSearch as CycleSearch
from eppanalysis.methods.search.simulate import simulate as simulate
from eppanalysis.methods.search.trigger import Trigger as Trigger, trigger as trigger
from eppanalysis.models.devices.elbow.loop import ElbowParameters as ElbowParameters, elbow as elbow
from eppanalysis.models.diagrams import Diagram as Diagram, blocks as blocks
from eppanalysis.models.elements import (
    AntiWindupPID as AntiWindupPID,
    Arctan as Arctan,
    AutomatonElement as AutomatonElement,
    BacklashCompensator as BacklashCompensator,
    BilinearSpring as BilinearSpring,
    BoucWen as BoucWen,
    ClampedPID as ClampedPID,
    CleggIntegrator as CleggIntegrator,
    Comparator as Comparator,
    Coulomb as Coulomb,
    Cube as Cube,
    DahlFriction as DahlFriction,
    DeadZone as DeadZone,
    DeadZoneSaturation as DeadZoneSaturation,
    Drag as Drag,
    FirstOrderReset as FirstOrderReset,
    FiveBandLaw as FiveBandLaw,
    FloorQuantiser as FloorQuantiser,
    Friction as Friction,
    FrictionCompensator as FrictionCompensator,
    HysteresisRelay as HysteresisRelay,
    HysteresisRelayDeadZone as HysteresisRelayDeadZone,
    ImpactStop as ImpactStop,
    JumpAndFollow as JumpAndFollow,
    LockPin as LockPin,
    LookupTable as LookupTable,
    LuGreFriction as LuGreFriction,
    MidRiseQuantiser as MidRiseQuantiser,
    MonotoneTable as MonotoneTable,
    NaturalPulseWidthModulator as NaturalPulseWidthModulator,
    Nonlinearity as Nonlinearity,
    NordinShaft as NordinShaft,
    OwnStates as OwnStates,
    PiecewiseLinear as PiecewiseLinear,
    Play as Play,
    Polynomial as Polynomial,
    PrandtlIshlinskii as PrandtlIshlinskii,
    Preload as Preload,
    PulseWidthModulator as PulseWidthModulator,
    Quantiser as Quantiser,
    RateLimitedServo as RateLimitedServo,
    RateLimiter as RateLimiter,
    Relay as Relay,
    RelayDeadZone as RelayDeadZone,
    SampledController as SampledController,
    Saturation as Saturation,
    Sine as Sine,
    StictionPulley as StictionPulley,
    StribeckFriction as StribeckFriction,
    Tanh as Tanh,
    TimedRelay as TimedRelay,
    ViscousCoulomb as ViscousCoulomb,
    WrapAround as WrapAround,
)
from eppanalysis.models.elements.automaton import (
    Automaton as Automaton,
    AutomatonBuilder as AutomatonBuilder,
    Guard as Guard,
    Mode as Mode,
    Smooth as Smooth,
)
from eppanalysis.models.systems import inputs as inputs
from eppanalysis.models.systems.cuts import Cuts as Cuts
from eppanalysis.models.systems.interchange.python_control import from_control as from_control
from eppanalysis.models.systems.linear import StateSpace as StateSpace
from eppanalysis.models.systems.lure import LureSystem as LureSystem
from eppanalysis.models.systems.measured.loop import MeasuredLoop as MeasuredLoop
from eppanalysis.models.systems.measured.matrix import MeasuredMatrix as MeasuredMatrix
from eppanalysis.models.systems.measured.response import MeasuredResponse as MeasuredResponse
from eppanalysis.models.systems.operating import OperatingPoint as OperatingPoint
from eppanalysis.remedies import Remedies as Remedies, remedies as remedies
from eppanalysis.report import report as report
from eppanalysis.report.summary import first_page as first_page
from eppanalysis.results import (
    Event as Event,
    LimitCycle as LimitCycle,
    Prediction as Prediction,
    Status as Status,
    Trajectory as Trajectory,
)
from eppanalysis.results.measured import MeasuredCycle as MeasuredCycle
from eppanalysis.sweep import (
    LatinHypercube as LatinHypercube,
    Sobol as Sobol,
    Tolerances as Tolerances,
    Zipped as Zipped,
    open_sweep as open_sweep,
    sweep as sweep,
    sweep_cost as sweep_cost,
)
from eppanalysis.sweep.boundary import (
    Boundary as Boundary,
    free_region as free_region,
    outcome_boundary as outcome_boundary,
)
from eppanalysis.sweep.parallel import plot_parallel as plot_parallel
from eppanalysis.sweep.picture import (
    plot_design_map as plot_design_map,
    plot_slices as plot_slices,
    plot_sweep as plot_sweep,
)
from eppanalysis.tables.frames import table as table
from eppanalysis.tables.manual import ManualTable as ManualTable

__version__: str
