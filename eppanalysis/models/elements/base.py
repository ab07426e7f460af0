"""What every element offers: its map in time, its describing function, its automaton, its slopes, its fields."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache, wraps
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.arguments import floats
from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.engine.describing import describe_map
from eppanalysis.errors import ModelError, shown
from eppanalysis.models.elements.automaton import Automaton, slopes_of, switching_levels
from eppanalysis.models.elements.exact import Exact, Reading

if TYPE_CHECKING:
    import control

#: Mean output and complex gain, as a describing function gives them.
Answer = tuple[Array, ComplexArray]
#: Exponents of the units of input, output and time in a field of an element.
Role = tuple[int, int, int]
IN: Role = (1, 0, 0)
OUT: Role = (0, 1, 0)
SLOPE: Role = (-1, 1, 0)
DAMPING: Role = (-1, 1, 1)
SLOPE_PER_TIME: Role = (-1, 1, -1)
OUT_PER_TIME: Role = (0, 1, -1)
RATIO: Role = (0, 0, 0)
TIME: Role = (0, 0, 1)
PER_TIME: Role = (0, 0, -1)

#: Mean of an output, relative to its oscillation, that is rounding.
_ROUNDING = 1e-9

#: Elements by the name that a case file calls them: what a class gives as its `kind`.
ELEMENTS: dict[str, type[Nonlinearity]] = {}


@dataclass(frozen=True, eq=False)
class OwnStates:
    """Linear states that an element brings into the loop, between the loop's signals and its automaton's.

    With the loop's signal x before the element and y behind it, and inputs z and outputs w of the automaton, ::

        ds/dt = A s + B [x; w] + rate
        [z; y] = C s + D [x; w]

    Parameters
    ----------
    A : array, shape (k, k)
        From the states to their rates.
    B : array, shape (k, x + w)
        From x and w to the rates.
    C : array, shape (z + y, k)
        From the states to z and y.
    D : array, shape (z + y, x + w)
        From x and w straight to z and y.
    n_before, n_behind : int
        Numbers of the loop's signals x and y; one each by default.
    start : array, shape (k,)
        States at the start; zero by default.
    rate : array, shape (k,)
        Constant part of their rates: 1 for a clock. Clocks that several elements bring become one.

    Raises
    ------
    ModelError
        If shapes do not fit, or a number is not finite.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    n_before: int = 1
    n_behind: int = 1
    start: Array | None = None
    rate: Array | None = None

    def __post_init__(self) -> None:
        read = {name: floats(getattr(self, name), f"OwnStates: {name}") for name in "ABCD"}
        n = len(np.atleast_1d(read["A"]))
        for name in ("start", "rate"):
            given = getattr(self, name)
            read[name] = np.zeros(n) if given is None else floats(given, f"OwnStates: {name}")
        columns, rows = read["B"].shape[-1:], read["C"].shape[:1]
        shapes = {"A": (n, n), "B": (n, *columns), "C": (*rows, n), "D": (*rows, *columns)}
        shapes |= {"start": (n,), "rate": (n,)}
        for name, shape in shapes.items():
            values = read[name]
            if values.shape != shape or not np.all(np.isfinite(values)):
                raise ModelError(f"OwnStates: {name} has shape {values.shape}; expected finite numbers, {shape}.")
            values.flags.writeable = False
            object.__setattr__(self, name, values)


class MeanAndGain(NamedTuple):
    """What a describing function gives: the mean of the output, and the complex gain of its fundamental.

    As one complex number, which is what python-control takes it for, it is the gain; with a mean it is none.
    """

    mean: Array
    gain: ComplexArray

    def __complex__(self) -> complex:
        """The gain of one amplitude, of an element with one output that has no mean there.

        Raises
        ------
        ModelError
            If there is a mean, or more than one gain.
        """
        mean, gain = np.asarray(self.mean), np.asarray(self.gain)
        if gain.size != 1:
            raise ModelError(f"A describing function of {gain.size} gains is no number", expected="one amplitude")
        if abs(mean.item()) > _ROUNDING * abs(gain.item()):
            raise ModelError(
                f"The output has a mean of {mean.item():.6g}, which python-control does not know",
                expected="an element without one; predict_limit_cycles balances means",
            )
        return complex(gain.item())


class RateLimit(NamedTuple):
    """How fast the output of an element may move [its unit per s], and below that its bandwidth [rad/s]."""

    rate: float
    bandwidth: float


class Estimate(NamedTuple):
    """A field of an element that may follow from sizes of the part: its unit, the sizes with theirs, how, by what."""

    field: str
    unit: str
    sizes: Mapping[str, str]
    of: Callable[..., float]
    by: str


class ClosedForm(NamedTuple):
    """What the engine computes mean and gain of an element from: its map in pieces, or the numbers of a lock pin.

    A relay with hysteresis has, where the input passes both of its thresholds, mean and real part of the gain of a map
    that makes half of its jump at either; its imaginary part is minus the area of its loop over ``pi a**2``. The law
    inside a limited rate has the mean of its map, and the gain that belongs to its limit.
    """

    #: (k,), (k + 1,), (k + 1,), (k,): breakpoints, slopes, intercepts and jumps.
    pieces: tuple[Array, ...] = (np.zeros(0), np.zeros(1), np.zeros(1), np.zeros(0))
    #: Gap, stiffness, damping, and whether it only pushes; zeros for a map.
    pin: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    loop: float = 0.0  # area of a hysteresis loop over pi
    limit: RateLimit = RateLimit(0.0, 0.0)

    def described(self, amplitude: Array, bias: Array) -> tuple[Array, Array, Array]:
        """Mean and gain of the map, of any one shape, and the derivatives of the mean by bias and amplitude."""
        shape, a, b = np.shape(amplitude), amplitude.flatten(), bias.flatten()
        mean, gain, by = np.empty(a.size), np.empty(a.size), np.empty((2, a.size))
        breakpoints, slopes, intercepts, jumps = self.pieces
        describe_map(breakpoints, slopes, intercepts, jumps, a, b, mean, gain, by)
        return mean.reshape(shape), gain.reshape(shape), by.reshape(2, *shape)


class _OfMore(MeanAndGain):
    """The same of an element whose gain hangs on more than an amplitude."""

    def __complex__(self) -> complex:
        raise ModelError(
            "This describing function depends on the frequency, or has several inputs or outputs",
            expected="an element of one input and one output without states of its own",
        )


class Nonlinearity(ABC):
    """One nonlinear element of a loop.

    A subclass gives its map, its describing function and its automaton; what is known of its slopes, its sector and its
    thresholds is read off the automaton, where the subclass does not say it better.

    Attributes
    ----------
    n_inputs, n_outputs : int
        Numbers of scalar inputs and outputs. Only the first input is excited in the describing function; others
        follow from it, such as its rate (lock pin), or are a clock or a state.
    input_ports, output_ports : tuple of str
        What a diagram calls its inputs and outputs, where there are several.
    kind : str
        Name of the element in case files: ``class Play(Nonlinearity, kind="play")``. Empty where none can hold it.
    units : mapping of str to (int, int, int)
        Exponents of the units of input, output and time in each field that is a number or a list of numbers.
    same_unit : bool
        Whether the output has the unit of the input.
    input_is, output_is : str
        "way" (a displacement) and "force", where a unit that does not exist is a mistake; empty where anything may be.
    columns : tuple of str
        Fields that a case file may take from the columns of a CSV file.
    remembers_a_list : bool
        Whether its memory is a list of numbers of any length.
    estimate : Estimate or None
        How a case file may have a field follow from the sizes of the part.
    input_unit : str
        Unit of the first input where it is always the same [SI]; empty where it is the loop's.
    breakpoints : array, shape (k,)
        Inputs at which a static map that is linear between them bends or jumps; empty for all other elements.
    slopes, intercepts : array, shape (k + 1,)
        Of such a map's pieces.
    jumps : array, shape (k,)
        Of such a map at its breakpoints.
    own_states : OwnStates or None
        Linear states that a loop appends to its own. What the element says of itself holds behind them, for its
        automaton, or, where it has an element inside, from the loop's signal before it to the one behind it.
    inside : Nonlinearity or None
        Element in a loop between the own states, where this one is described together with them.
    small_signal : Nonlinearity or None
        Of such an element, what it is for margins of the linearised loop.
    rate_limit : RateLimit or None
        Of an element whose output follows its input no faster than that.
    of_frequency : bool
        Whether the describing function depends on the frequency though there is one input.
    by_quadrature : bool
        Whether the describing function is a quadrature, which takes some tenths of a millisecond a point.
    linear_gain_is : str
        What `linear_gain` is, in words that margins print beside it.
    """

    n_inputs: ClassVar[int] = 1
    n_outputs: ClassVar[int] = 1
    input_ports: ClassVar[tuple[str, ...]] = ()
    output_ports: ClassVar[tuple[str, ...]] = ()
    kind: ClassVar[str] = ""
    units: ClassVar[Mapping[str, Role]] = {}
    same_unit: ClassVar[bool] = False
    input_is: ClassVar[str] = ""
    output_is: ClassVar[str] = ""
    columns: ClassVar[tuple[str, ...]] = ()
    remembers_a_list: ClassVar[bool] = False
    estimate: ClassVar[Estimate | None] = None
    input_unit: ClassVar[str] = ""
    linear_gain_is: ClassVar[str] = "its steepest slope"

    breakpoints: Array = np.zeros(0)
    slopes: Array = np.zeros(0)
    intercepts: Array = np.zeros(0)
    jumps: Array = np.zeros(0)
    own_states: OwnStates | None = None
    inside: Nonlinearity | None = None
    small_signal: Nonlinearity | None = None
    rate_limit: RateLimit | None = None
    of_frequency: ClassVar[bool] = False
    by_quadrature: ClassVar[bool] = False

    def __init_subclass__(cls, kind: str = "", **options: Any) -> None:
        super().__init_subclass__(**options)
        cls.kind = kind
        if kind:
            ELEMENTS[kind] = cls
        if "describing_function" in vars(cls):
            cls.describing_function = _named(cls.describing_function)  # type: ignore[method-assign]

    @classmethod
    def called(cls) -> str:
        """What an element is called that was given no name: its kind, or that of its class in words."""
        return cls.kind or re.sub(r"(?<=[a-z])(?=[A-Z])", "_", cls.__name__).lower()

    def __call__(self, x: float) -> float:
        """Output of an element without memory for an input, as python-control calls a function.

        Raises
        ------
        ModelError
            If it remembers something (`output` takes that and gives it back, :meth:`to_control` keeps it from call to
            call), or has several inputs or outputs.

        Examples
        --------
        >>> from eppanalysis.models.elements import DeadZone
        >>> DeadZone()(3.0)
        2.0
        """
        self._refuse_several()
        y, memory = self.output(np.squeeze(x), None)
        if memory is not None:
            expected = "to_control(), which keeps it from call to call"
            raise ModelError(f"{type(self).__name__} remembers where it has been", expected=expected)
        return float(y)

    def _isstatic(self) -> bool:
        """Whether it has no memory, which python-control reads before it samples the calls."""
        return self.output(0.0, None)[1] is None

    @abstractmethod
    def output(self, x: Any, memory: Any = None) -> tuple[Any, Any]:
        """Output for the input `x` that is reached, monotonically, from the state `memory`: (output, memory)."""

    @abstractmethod
    def describing_function(self, amplitude: ArrayLike, bias: ArrayLike = 0.0, omega: ArrayLike = 1.0) -> Answer:
        """Mean output and complex gain for ``x = bias + amplitude * sin(omega t)``.

        The output is approximated by ``mean + Im(gain * amplitude * exp(j omega t))``: with
        ``y ~ mean + b1 sin + a1 cos`` the gain is ``(b1 + j a1)/amplitude``. Arguments broadcast; with several
        outputs both results have a trailing axis of length `n_outputs`.
        """

    @abstractmethod
    def automaton(self) -> Automaton:
        """Modes, guards and resets of the element for the hybrid system."""

    def start(self, automaton: Automaton, memory: Any = None) -> tuple[int, Array]:
        """Mode and memory values at a start with a memory as `output` takes it (None: the element's own).

        The mode need not be the one in which the element is: what an input has passed it leaves at once.
        """
        stored = automaton.start_memory.copy()
        if memory is not None and stored.size:
            stored[0] = memory
        return automaton.start_mode, stored

    @property
    def has_impulses(self) -> bool:
        """Whether its first output has impulses, by which states of the loop jump: as a signal that has no value."""
        return False

    @property
    def remembers(self) -> bool:
        """Whether a start may give it a memory: a held value, a mode, or a state of its own."""
        has_states = self.own_states is not None or self.inside is not None
        return has_states or type(self).start is not Nonlinearity.start or self.automaton().n_memory > 0

    def memory_at(self, mode: int, stored: Array, x: Array, output: Array) -> Any:
        """Memory as `output` and `start` take it, from the mode, the memory values, shape (n_memory,), input
        and output.
        """
        return self.memory_of(output)

    def memory_of(self, output: Array) -> float | None:
        """First memory value of the automaton for an output, shape (n_outputs,); None without such a memory."""
        return None

    def thresholds(self, bias: float = 0.0) -> Array:
        """Positive amplitudes about `bias` at which the describing function changes its form.

        They are the scales of an amplitude search: distances of the automaton's switching levels from the bias.
        """
        sizes = np.unique(np.abs(switching_levels(self.automaton(), bias)))
        return sizes[sizes > 0]

    def slope_bounds(self) -> tuple[float, float]:
        """Least and greatest slope of the first output over the first input; infinite where the output jumps with it.

        Where the output depends on memory, or on another input, over all that they may be.
        """
        low, high = slopes_of(self.automaton())
        return float(low[0, 0]), float(high[0, 0])

    def sector(self) -> tuple[float, float]:
        """Least and greatest ratio of the first output to the first input, over all inputs but zero and all memories.

        Infinite where the output need not be zero with the input, or where nothing is known.
        """
        return -np.inf, np.inf

    def described_with_slopes(self, amplitude: Array, bias: Array) -> tuple[Array, Array, Array] | None:
        """Mean, gain (real) and derivatives of the mean, of a map that has them in closed form; None for any other.

        Mean and gain have shape (n,), the derivatives by bias and amplitude shape (2, n). At amplitudes above zero. The
        gain's own derivatives follow: by the amplitude 2 (by bias - gain) / A, by the bias 2 (by amplitude) / A.
        """
        return None

    @property
    def closed_form(self) -> ClosedForm | None:
        """Numbers from which compiled code computes its mean and gain; None where there is no such code for it."""
        return None

    def linear_gain(self) -> Array:
        """Gains, shape (n_outputs, n_inputs), of the element in the margins of the linearised loop.

        The steepest slopes, infinite where the element jumps.
        """
        if (self.n_outputs, self.n_inputs) == (1, 1):  # smooth elements know their slopes, which no automaton shows
            return np.array([[max(self.slope_bounds(), key=abs)]])
        low, high = slopes_of(self.automaton())
        return np.where(np.abs(low) > np.abs(high), low, high)

    def exact(self, read: Reading) -> Exact | None:
        """What it does in exact numbers, for certificates; None where none can state it.

        `read` gives the rational number of a field. May raise a ModelError that says why there is none.
        """
        return None

    def under_dither(self, amplitude: float) -> Nonlinearity | None:
        """The element that slow signals find while a fast dither of that amplitude rides on its input.

        None where it is not an element of its own: without a memory it is a mean over the dither, with one unknown.
        """
        return None

    def harmonics(self, amplitude: float, bias: float, omega: float, order: int) -> ComplexArray | None:
        """Harmonics of the settled output for ``bias + amplitude sin(omega t)``, over the amplitude, from the mean on.

        Shape (1, order + 1); None where the answer is that of the automaton to its input.
        """
        return None

    @property
    def reads_rate(self) -> bool:
        """Whether its describing function takes the second input for the rate of the first."""
        return self.input_ports[1:2] == ("rate",)

    @property
    def sticks_and_slips(self) -> bool:
        """Whether it resists more at rest than in motion, so that a loop with integral action hunts."""
        return False

    @property
    def goes_on_in_jumps(self) -> bool:
        """Whether its output stays where it is until its input is well beyond, and then jumps, as a sticky valve's."""
        return False

    def to_control(self) -> control.DescribingFunctionNonlinearity:
        """The element as one of python-control's own, which keeps what it remembers from call to call.

        ``control.describing_function_plot`` and its like take the element itself, too, by its describing function.
        There that is a number of the amplitude alone: an element with a mean output without a bias is refused.

        Raises
        ------
        ModelError
            If it has several inputs or outputs, or linear states of its own.

        Examples
        --------
        >>> import control
        >>> from eppanalysis.models.elements import Play
        >>> play = Play(gap=1.0).to_control()
        >>> control.describing_function(play, [1.0, 2.0]).round(4).tolist()
        [(0.5-0.3183j), (0.8045-0.2387j)]
        """
        self._refuse_several()
        return _for_control(self)

    @property
    def is_single(self) -> bool:
        """Whether it has one input, one output and no linear states of its own."""
        return (self.n_inputs, self.n_outputs) == (1, 1) and self.own_states is None

    def _refuse_several(self) -> None:
        if not self.is_single:
            who = type(self).__name__
            raise ModelError(f"{who} has several inputs or outputs, or states of its own", expected="one of each alone")


def _named(described: Callable[..., tuple[Any, Any]]) -> Callable[..., MeanAndGain]:
    """A describing function whose mean and gain are named."""

    @wraps(described)
    def named(element: Nonlinearity, *args: Any, **kwargs: Any) -> MeanAndGain:
        kind = MeanAndGain if element.is_single and not element.of_frequency else _OfMore
        return kind(*described(element, *args, **kwargs))

    return named


def _for_control(element: Nonlinearity) -> control.DescribingFunctionNonlinearity:
    import control

    class Described(control.DescribingFunctionNonlinearity):
        """An element for python-control."""

        def __init__(self) -> None:
            super().__init__()
            self.memory = None

        def __call__(self, x: float) -> float:
            y, self.memory = element.output(np.squeeze(x), self.memory)
            return float(y)

        def describing_function(self, A: float) -> complex:
            return _gain_alone(element, A)

        def _isstatic(self) -> bool:
            return element.output(0.0, None)[1] is None

        def __repr__(self) -> str:
            return f"{element!r}.to_control()"

    return Described()


def _gain_alone(element: Nonlinearity, amplitude: float) -> complex:
    """Describing function at no bias, of an element whose output has no mean there."""
    mean, gain = (np.asarray(v).item() for v in element.describing_function(amplitude))
    if abs(mean) > _ROUNDING * abs(gain) * amplitude:
        raise ModelError(
            f"{shown(element)} has a mean output of {mean:.6g} at amplitude {amplitude:g}; python-control knows none",
            expected="an element without one; predict_limit_cycles balances means",
        )
    return complex(gain)


def automaton_of(element: Nonlinearity) -> Automaton:
    """The automaton of an element; elements that are equal share one, as in cases that differ by one parameter."""
    return _shared(element) if is_hashable(element) else element.automaton()


@lru_cache(maxsize=64)
def _shared(element: Nonlinearity) -> Automaton:
    return element.automaton()


def is_hashable(element: Nonlinearity) -> bool:
    """Whether an element can be looked up: one that holds lists or arrays cannot."""
    try:
        hash(element)
    except TypeError:
        return False
    return True
