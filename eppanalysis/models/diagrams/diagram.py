"""The diagram: parts with named ports, connections, external inputs, named signals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from eppanalysis.arguments import checked_class
from eppanalysis.errors import ModelError, did_you_mean
from eppanalysis.models.diagrams.blocks import PI, PID, Block
from eppanalysis.models.diagrams.blocks.foreign import as_part
from eppanalysis.models.diagrams.closing import close
from eppanalysis.models.diagrams.of_loop import drawn
from eppanalysis.models.diagrams.wiring import NAME, Port, Ports, driven, plain_name, port_names
from eppanalysis.models.elements.base import Nonlinearity
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.operating import OperatingPoint


@checked_class
@dataclass(frozen=True, eq=False)
class Diagram:
    """Linear blocks and elements with named ports, and how they are connected.

    Parameters
    ----------
    parts : mapping of str to Block or Nonlinearity
        By their names. Linear systems of python-control, scipy.signal and sympy are taken, too, and python-control's
        elements; a state space keeps the names of its signals.
    connect : sequence of str
        Connections, such as ``"setpoint - encoder -> controller"``: a signed sum of outputs and external inputs, and
        the inputs that it drives. A part with a single input or output is called by its name alone.
    inputs : mapping of str to float, or sequence of str
        External inputs and where they are before the start [SI]; zero where only names are given.
    signals : mapping of str to str
        Named signals beside those of all ports: signed sums of ports.
    units : mapping of str to str
        Units of the signals.
    memory : mapping of str to Any
        What elements remember at the start.
    margins_at : str or sequence of str
        Ports at which margins are taken; by default the output of the first PI or PID, else of the first element.
    principal : str
        Element at which pictures cut the loop; by default the first.
    ports_as_signals : bool
        Whether all ports are signals beside those named.
    name : str
        Of the loop, in sentences and messages.

    Raises
    ------
    ModelError
        If a port is not known, left open or driven twice, or an algebraic loop has no unique answer.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> servo = epp.Diagram(
    ...     parts={
    ...         "controller": epp.blocks.PI(kp=2.0, ti=5.0),
    ...         "valve": epp.Saturation(lower=-1.0, upper=1.0),
    ...         "plant": epp.blocks.TransferFunction(num=[1.0], den=[1.0, 1.0, 0.0]),
    ...     },
    ...     connect=[
    ...         "setpoint - plant -> controller",
    ...         "controller -> valve",
    ...         "valve -> plant",
    ...     ],
    ...     inputs=["setpoint"],
    ... )
    >>> servo.to_system().A.shape
    (3, 3)
    """

    parts: Mapping[str, Any]
    connect: Sequence[str]
    inputs: Mapping[str, float] | Sequence[str] = ()
    signals: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    memory: Mapping[str, Any] = field(default_factory=dict)
    margins_at: str | Sequence[str] = ()
    principal: str = ""
    ports_as_signals: bool = True
    name: str = "diagram"

    def __post_init__(self) -> None:
        for name in (*self.parts, *self.levels):
            if not NAME.fullmatch(name):
                such = f"such as {plain_name(name)!r} here and in connections"
                raise ModelError(
                    self.name, name, f"a plain name of letters, digits and underscores, {such}", field="name"
                )
        object.__setattr__(self, "parts", {name: self._part(name, given) for name, given in self.parts.items()})
        for name in self.parts:
            if name in self.levels:
                taken = f"{self.name}: {name} is a part and an external input"
                raise ModelError(taken, expected="different names", field=f"inputs.{name}")
        elements = [name for name, part in self.parts.items() if isinstance(part, Nonlinearity)]
        called = [*(("memory", name) for name in self.memory), *[("principal", self.principal)] * bool(self.principal)]
        for field_name, name in called:
            if name not in elements:
                raise ModelError(self.name, name, f"an element: {did_you_mean(name, elements)}", field=field_name)

    def _part(self, name: str, given: Any) -> Block | Nonlinearity:
        try:
            return as_part(given)
        except ModelError as error:
            said = f"{self.name}: {name}: {error.what}"
            raise ModelError(said, expected=error.expected or "a block or an element") from None

    @classmethod
    def of(cls, loop: LureSystem) -> Diagram:
        """A loop as a diagram: its elements, around one block that holds all of its linear part.

        The loop that it closes has the same matrices, to the bit, and the same signals, memory, dead times and start.
        Places to cut are the ports of the diagram.

        Parameters
        ----------
        loop : LureSystem

        Raises
        ------
        ModelError
            If a name has other characters than letters, digits and underscores, an element brings linear states of
            its own, or an output with a dead time acts on more than states and signals.

        Examples
        --------
        >>> import eppanalysis as epp
        >>> loop = epp.LureSystem.from_tf(([5.0], [1.0, 1.0, 0.0]), epp.Play(gap=2.0))
        >>> drawing = epp.Diagram.of(loop)
        >>> list(drawing.parts), drawing.connect
        (['play', 'linear'], ('play -> linear.play', 'linear.play_in -> play'))
        >>> bool((drawing.to_system().A == loop.A).all())
        True
        """
        return cls(**drawn(loop))

    @cached_property
    def levels(self) -> dict[str, float]:
        """External inputs and where they are before the start [SI]."""
        given = self.inputs
        return {k: float(v) for k, v in given.items()} if isinstance(given, Mapping) else dict.fromkeys(given, 0.0)

    @cached_property
    def ports(self) -> Ports:
        """Names of all ports."""
        named = {name: port_names(part) for name, part in self.parts.items()}
        inputs, outputs = ({name: both[k] for name, both in named.items()} for k in (0, 1))
        return Ports(inputs, outputs, tuple(self.levels), self.name)

    @cached_property
    def idle_inputs(self) -> tuple[str, ...]:
        """External inputs that drive nothing and are in no signal."""
        sums = [*self.wires.values(), *self.named.values()]
        used = {port for terms in sums for _, port in terms}
        return tuple(name for name in self.levels if (name, "") not in used)

    @cached_property
    def cuts(self) -> tuple[str, ...]:
        """Ports at which margins are requested."""
        if isinstance(self.margins_at, str):
            return (self._cut(self.margins_at, "margins_at"),)
        return tuple(self._cut(text, f"margins_at.{i}") for i, text in enumerate(self.margins_at))

    def _cut(self, text: str, field: str) -> str:
        """A port at which margins are taken, in full."""
        if text in self.levels:
            raise ModelError(self.name, text, "a port of a part, as nothing drives an external input", field=field)
        return ".".join(self.ports.either(text, field))

    @property
    def controllers(self) -> tuple[str, ...]:
        """Outputs of the blocks that are controllers by their kind; margins are taken at the first by default."""
        return tuple(f"{name}.out" for name, part in self.parts.items() if isinstance(part, PI | PID))

    def to_system(self) -> LureSystem:
        """The loop that the diagram closes."""
        return self._system

    @property
    def operating_point(self) -> OperatingPoint:
        """The external inputs where they are before the start; with :meth:`to_system`, all that analyses need."""
        return OperatingPoint.of(self._system)

    @cached_property
    def _system(self) -> LureSystem:
        return close(self, self.wires, self.named)

    @cached_property
    def wires(self) -> dict[Port, list[tuple[float, Port]]]:
        """The signed sum of sources that drives each input."""
        return driven(self.ports, self.connect)

    @cached_property
    def named(self) -> dict[str, list[tuple[float, Port]]]:
        """The named signals as signed sums of sources."""
        return {name: self.ports.terms(text, f"signals.{name}") for name, text in self.signals.items()}
