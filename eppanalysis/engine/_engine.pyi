"""The compiled engine: what it takes and gives, without a look at its sources."""

from typing import Any

import numpy as np

from eppanalysis.arrays import Array, BoolArray, ComplexArray, IntArray

_Regime = tuple[int, int, float, Array, Array, IntArray, Array]

parts: Any  #: Parts of the engine, for its tests.
AVX2: bool  #: Whether a module for AVX2 stands beside this one, and the processor has it.
SOURCES: str  #: Digest of the sources that it was built from.
ALWAYS: float  #: Seconds before a start from which on a delayed output is as it was.

def run(
    model: tuple[Any, ...],
    compiled: tuple[Any, ...],
    work: tuple[Any, ...],
    workspace: tuple[Any, ...],
    samples: tuple[Any, ...],
    buffer: tuple[Any, ...],
    now: np.void,
) -> int: ...
def step_at_start(
    model: tuple[Any, ...],
    compiled: tuple[Any, ...],
    work: tuple[Any, ...],
    workspace: tuple[Any, ...],
    none: tuple[Any, ...],
    buffer: tuple[Any, ...],
    now: np.void,
    x0: Array,
    modes0: IntArray,
    H0: Array,
    without_memory: BoolArray,
) -> None: ...
def run_cells(
    stack: tuple[Any, ...],
    compiled: tuple[Any, ...],
    work: tuple[Any, ...],
    workspace: tuple[Any, ...],
    none: tuple[Any, ...],
    period_samples: tuple[Any, ...],
    buffer: tuple[Any, ...],
    now: np.void,
    x0: Array,
    modes0: IntArray,
    H0: Array,
    compared: BoolArray,
    base_step: Array,
    first: int,
    last: int,
    out: tuple[Any, ...],
) -> None: ...
def verdict_of_run(
    model: tuple[Any, ...],
    ev_t: Array,
    ev_guard: IntArray,
    ev_x: Array,
    ev_v: Array,
    count: int,
    t_end: float,
    low: Array,
    high: Array,
    x_end: Array,
    rate_end: Array,
    compared: BoolArray,
    found: Array,
) -> int: ...
def rounding_of_motion(
    states: Array,
    memory: Array,
    moves: Array,
    period: float,
    compared: BoolArray,
    on_inputs: Array,
    elements: tuple[Any, ...],
    changes: tuple[Any, ...],
    rounding: float,
) -> tuple[bool, float]: ...
def settle(
    table: tuple[Any, ...],
    z: ComplexArray,
    omega: float,
    mode: int,
    clocked: bool,
    rest: Array,
) -> _Regime: ...
def even_out(
    A: Array,
    sizes: Array,
) -> None: ...
def find_extrema(
    c: ComplexArray,
    phase: Array,
    value: Array,
) -> int: ...
def spans(
    c: Array,
    fine: Array,
    grid: Array,
    out: Array,
) -> None: ...
def build_arcs(
    model: tuple[Any, ...],
    compiled: tuple[Any, ...],
    work: tuple[Any, ...],
    base_step: float,
    modes: IntArray,
    guards: IntArray,
    timing: IntArray,
    F: Array,
    S: Array,
    g: Array,
    gs: Array,
    J: Array,
    smooth: IntArray,
    sense: Array,
    Y: Array,
    Ys: Array,
    W: Array,
) -> int: ...
def sizes_of_residuals(
    g: Array,
    at_once: IntArray,
    free: IntArray,
    scale: Array,
    period: float,
    rows: Array,
) -> None: ...
def correct(
    channels: tuple[Any, ...] | None,
    chain: tuple[Any, ...],
    curve: tuple[Any, ...],
    input_place: int,
    n_inputs: int,
    effort: tuple[Any, ...],
    plane: tuple[Any, ...],
    step: Array,
    progress: Array,
    u: Array,
    here: tuple[Any, ...],
) -> tuple[int, float]: ...
def states_at(
    channels: tuple[Any, ...] | None,
    F: Array,
    S: Array,
    smooth: IntArray,
    starts: Array,
    marks: Array,
    times: Array,
    out: Array,
) -> None: ...
def extents(
    channels: tuple[Any, ...] | None,
    F: Array,
    S: Array,
    smooth: IntArray,
    Y: Array,
    Ys: Array,
    starts: Array,
    tau: Array,
    low: Array,
    high: Array,
) -> None: ...
def newton_orbit(
    channels: tuple[Any, ...] | None,
    chain: tuple[Any, ...],
    effort: tuple[Any, ...],
    iterations: int,
    step: Array,
    here: tuple[Any, ...],
    share: int,
) -> tuple[int, int, float]: ...
def derivative_of_run(
    model: tuple[Any, ...],
    compiled: tuple[Any, ...],
    work: tuple[Any, ...],
    base_step: float,
    y: Array,
    modes: IntArray,
    met: tuple[Any, ...],
    t_end: float,
    D: Array,
    shift: Array,
) -> int:
    """The derivative D (N, N) of a run's end by its start, and of how much later its events come, `shift` (N,)."""

def sweep_by(
    channels: tuple[Any, ...] | None,
    F: Array,
    S: Array,
    g: Array,
    gs: Array,
    J: Array,
    smooth: IntArray,
    at_once: IntArray,
    starts: Array,
    tau: Array,
    free: IntArray,
    of_channels: tuple[Any, ...] | None,
    dF: Array,
    dS: Array,
    dg: Array,
    dgs: Array,
    dJ: Array,
    dshift: Array,
    dy: Array,
    out: Array,
) -> None: ...
def describe_stiction_pulley(
    forearm: float,
    harness: float,
    of: Array,
    amplitude: Array,
    bias: Array,
    mean: Array,
    gain: ComplexArray,
) -> None: ...
def describe_lock_pin(
    gap: float,
    stiffness: float,
    damping: float,
    unilateral: bool,
    amplitude: Array,
    bias: Array,
    omega: Array,
    mean: Array,
    gain: ComplexArray,
) -> None: ...
def describe_map(
    breakpoints: Array,
    slopes: Array,
    intercepts: Array,
    jumps: Array,
    amplitude: Array,
    bias: Array,
    mean: Array,
    gain: Array,
    by: Array,
) -> None: ...
def describe_automaton(
    rules: tuple[Any, ...],
    start_mode: int,
    a: Array,
    b: Array,
    omega: Array,
    mean: Array,
    gain: ComplexArray,
) -> None: ...
def describe_clamped(
    low: Array,
    high: Array,
    kappa: Array,
    eta: Array,
    tau: Array,
    mean: Array,
    gain: ComplexArray,
) -> None: ...
def describe_nordin_shaft(
    gap: float,
    stiffness: float,
    damping: float,
    amplitude: Array,
    bias: Array,
    omega: Array,
    mean: Array,
    share: ComplexArray,
) -> None: ...
def describe_rate_limit(
    alpha: Array,
    kappa: Array,
    gain: ComplexArray,
) -> None: ...
def describe_rate_limit_inside(
    error: Array,
    kappa: Array,
    gain: ComplexArray,
) -> None: ...
def response_and_slope(
    A: Array,
    B: Array,
    C: Array,
    s: ComplexArray,
    ds: ComplexArray,
    out: ComplexArray,
) -> None: ...
def shift(
    X: Array,
    places: IntArray,
    pivot: int,
    of_outputs: IntArray,
    relative: float,
    inputs: ComplexArray,
    a: Array,
    b: Array,
    omega: Array,
    steps: Array,
) -> None: ...
def assemble(
    X: Array,
    places: IntArray,
    owner: IntArray,
    pivot: int,
    static: tuple[Any, ...],
    of_elements: tuple[Any, ...],
    inputs: ComplexArray,
    L: ComplexArray,
    dL: ComplexArray,
    J: Array,
    R: Array,
) -> None: ...
def drive(
    L: ComplexArray,
    gains: ComplexArray,
    owner: IntArray,
    others: IntArray,
    pivot: int,
    inputs: ComplexArray,
) -> None: ...
def solve(
    J: Array,
    R: Array,
    rows: IntArray,
    columns: IntArray,
    border: Array,
    edge: float,
    step: Array,
    regular: BoolArray,
) -> None: ...
def move(
    X: Array,
    places: IntArray,
    step: Array,
    longest: float,
    largest: Array,
    sound: BoolArray,
) -> None: ...
def newton_balance(
    X: Array,
    normal: Array,
    iterations: int,
    limits: tuple[Any, ...],
    parts: tuple[Any, ...],
    places: IntArray,
    pivot: int,
    static: tuple[Any, ...],
    elements: tuple[Any, ...],
    linear: tuple[Any, ...],
    L: ComplexArray,
    around: ComplexArray,
    jacobian: Array,
    found: BoolArray,
) -> None: ...
def answer(
    table: tuple[Any, ...],
    z: ComplexArray,
    omega: float,
    mode: int,
    clocked: bool,
    rest: Array,
) -> tuple[_Regime, tuple[Any, ...], tuple[ComplexArray, ComplexArray, ComplexArray]]: ...
def slopes(
    table: tuple[Any, ...],
    pieces: tuple[Any, ...],
    z: ComplexArray,
    omega: float,
    S: ComplexArray,
    R: ComplexArray,
    jump: Array,
    at_rest: Array,
) -> ComplexArray: ...
def jacobian(
    dW: ComplexArray,
    W: ComplexArray,
    L: ComplexArray,
    dL: ComplexArray,
    on_bias: Array,
    on_mean: Array,
    pivot: int,
) -> Array: ...
def equations(
    automata: tuple[Any, ...],
    rest: Array,
    X: Array,
    linear: tuple[Any, ...],
    means: tuple[Any, ...],
    pivot: int,
    J: Array,
    R: Array,
    W: ComplexArray,
    switches: IntArray,
) -> bool: ...
