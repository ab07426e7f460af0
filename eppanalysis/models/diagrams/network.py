"""The parts of a diagram sorted into linear blocks and elements, with dead times as delayed outputs of elements.

A loop knows dead time at the outputs of its elements only. A block with states and nothing that goes straight through
is the same behind a delay as in front of it, so the delay is put at its inputs; else at its outputs. Where no element
stands there, one that hands its input on is put in.

All blocks that are executed together become one sampled controller: within one sample they act on one another at once.
Where nothing linear is left beside them, the loop is one of discrete time instead.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from eppanalysis.errors import ModelError
from eppanalysis.models.diagrams.blocks import Block, Constant, DeadTime, Sensor
from eppanalysis.models.diagrams.linear import Linear, closed_blocks
from eppanalysis.models.diagrams.wiring import Drawn, Port, free_name
from eppanalysis.models.elements.base import Nonlinearity
from eppanalysis.models.elements.dynamic.sampled import SampledController
from eppanalysis.models.elements.piecewise import PiecewiseLinear
from eppanalysis.models.systems.own_states import passes_outputs

Terms = list[tuple[float, Port]]
_SIDES = ("input_ports", "output_ports")


@dataclass(eq=False)
class Network:
    """What a diagram is made of while its loop is being closed; lives for one call."""

    wires: dict[Port, Terms]
    external: tuple[str, ...]
    who: str
    time_step: float | None = None  # of all that is linear, where the diagram is one of discrete time
    original: tuple[Port, ...] = ()  # ports that the diagram itself has
    #: Where ports of the diagram stand that have another place here.
    moved: dict[Port, Port] = field(default_factory=dict)
    shown: frozenset[Port] = frozenset()  # outputs that signals of the diagram name
    #: Ports of the diagram whose place carries what the port carries at another time.
    unseen: set[Port] = field(default_factory=set)
    constants: dict[Port, float] = field(default_factory=dict)  # outputs that do not move
    linear: dict[str, Linear] = field(default_factory=dict)
    elements: dict[str, Nonlinearity] = field(default_factory=dict)
    #: Inputs and outputs of each element.
    ports: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = field(default_factory=dict)
    late: dict[Port, float] = field(default_factory=dict)  # dead time of outputs of elements [s]
    #: What drives inputs of a sampled controller from among its own outputs, within a sample.
    within: dict[Port, Terms] = field(default_factory=dict)

    @classmethod
    def of(cls, diagram: Drawn, wires: Mapping[Port, Terms], shown: Iterable[Port] = ()) -> Network:
        """Sort the parts of a diagram; what comes out of the ports `shown` is to be seen at its own time."""
        network = cls({port: list(terms) for port, terms in wires.items()}, diagram.ports.external, diagram.name)
        network.shown = frozenset(shown)
        network.original = (*diagram.ports.sources, *diagram.ports.targets)
        network.time_step = _time_step_of_all(diagram.parts.values())
        sampled: dict[tuple[float, float], dict[str, Linear]] = {}
        for name, part in diagram.parts.items():
            if isinstance(part, Constant):
                network.constants[name, part.outputs[0]] = part.value
            elif isinstance(part, Block):
                linear, step = Linear.of(name, part), None if network.time_step else part.sample_time
                if step is None:
                    network.linear[name] = linear
                else:
                    sampled.setdefault((step, part.computation_delay), {})[name] = linear
            else:
                network.elements[name] = part
                network.ports[name] = diagram.ports.inputs[name], diagram.ports.outputs[name]
        sensors = {name: part for name, part in diagram.parts.items() if isinstance(part, Sensor)}
        steps = {name: network._quantise(name, part) for name, part in sensors.items()}
        for name, part in diagram.parts.items():
            if isinstance(part, Block) and part.delay and name in network.linear:
                (network._delay_alone if isinstance(part, DeadTime) else network._delay)(name, part.delay)
        for (step, delay), blocks in sampled.items():
            for stage, late in network._stages(blocks, delay):
                network._execute(stage, step, late)
        network.moved |= {(name, sensors[name].inputs[0]): port for name, port in steps.items()}
        return network

    def linear_ports(self) -> tuple[tuple[Port, ...], tuple[Port, ...]]:
        """Inputs and outputs of the linear blocks."""
        blocks = self.linear.values()
        return tuple(p for b in blocks for p in b.input_ports), tuple(p for b in blocks for p in b.output_ports)

    def element_ports(self) -> tuple[tuple[Port, ...], tuple[Port, ...]]:
        """Inputs and outputs of the elements."""
        inputs = tuple((name, p) for name, both in self.ports.items() for p in both[0])
        return inputs, tuple((name, p) for name, both in self.ports.items() for p in both[1])

    def external_ports(self) -> tuple[Port, ...]:
        """External inputs."""
        return tuple((name, "") for name in self.external)

    def delays(self) -> list[float]:
        """Dead time of every output of an element [s]."""
        return [self.late.get(port, 0.0) for port in self.element_ports()[1]]

    def start(self) -> np.ndarray:
        """States at the start."""
        return np.concatenate([np.zeros(0), *(block.start for block in self.linear.values())])

    def state_names(self) -> list[str]:
        """A name for each state."""
        return [name for block in self.linear.values() for name in block.state_names]

    def _quantise(self, name: str, sensor: Sensor) -> Port:
        """Put the quantiser of a sensor in front of it; its input."""
        made, entry = self._fresh(f"{name}_quantiser"), (name, sensor.inputs[0])
        self.elements[made] = sensor.quantiser
        self.ports[made] = ("in",), ("out",)
        self.wires[made, "in"] = self.wires[entry]
        self.wires[entry] = [(1.0, (made, "out"))]
        return made, "in"

    def _stages(self, blocks: Mapping[str, Linear], delay: float) -> list[tuple[dict[str, Linear], float]]:
        """Blocks that are executed together, in the order in which elements between them hand on; each with its delay.

        What stands before an element, such as the limit of a speed that is commanded, is computed first, and what
        reads the element then: all within one sample, so that the last stage alone waits for the end of the
        computation. Around a loop through an element nothing comes first.
        """
        names = list(blocks)
        owner = {port: i for i, b in enumerate(blocks.values()) for port in b.input_ports}
        direct, through = np.zeros((2, len(names), len(names)), bool)
        for i, block in enumerate(blocks.values()):
            for target in (t for port in block.output_ports for t in self._consumers(port)):
                if target in owner:
                    direct[i, owner[target]] = True
                else:
                    through[i, [owner[t] for t in self._reached(self._let_through(target)) if t in owner]] = True
        leads = direct | through
        while np.any(further := ~leads & (leads @ leads)):
            leads |= further
        ahead = through & ~leads.T
        number = np.zeros(len(names), int)
        for _ in names:
            number = np.maximum(number, np.where(leads, number[:, None] + ahead, 0).max(axis=0))
        stages = [{n: blocks[n] for n, at in zip(names, number, strict=True) if at == k} for k in np.unique(number)]
        inner = [self._stays_within(stage.values(), owner) for stage in stages[:-1]]
        if delay and not all(inner):
            return [(dict(blocks), delay)]
        return [*((stage, 0.0) for stage in stages[:-1]), (stages[-1], delay)]

    def _stays_within(self, stage: Iterable[Linear], owner: Mapping[Port, int]) -> bool:
        """Whether what a stage puts out is read, straight or through elements, by the blocks of `owner` alone."""
        targets = self._reached([port for block in stage for port in block.output_ports])
        return all(t in owner or self._let_through(t) for t in targets)

    def _execute(self, blocks: Mapping[str, Linear], step: float, delay: float) -> None:
        """Put blocks that are executed together in as one sampled controller."""
        name = next(iter(blocks)) if len(blocks) == 1 else self._fresh("_".join(blocks))
        closed = closed_blocks(blocks, self.wires, self.who)
        inputs, outputs = ([port for b in blocks.values() for port in getattr(b, side)] for side in _SIDES)
        if not any(source not in outputs for port in inputs for _, source in self.wires[port]):
            raise ModelError(f"{self.who}: nothing that {name} reads comes from outside of it", field="connect")
        start = np.concatenate([block.start for block in blocks.values()])
        # What is put out comes back at the same sample through a saturation, say: then the state is renewed behind the
        # outputs, so that an integrator sees what was cut off (docs/theory/sampled.md).
        outside = [t for port in outputs for t in self._consumers(port) if t not in inputs]
        back = self._reached([port for target in outside for port in self._let_through(target)])
        self.elements[name] = SampledController(
            closed.A, closed.B, closed.C, closed.D, sample_time=step, delay=delay, x0=start,
            state_last=not delay and any(port in back for port in inputs),
        )  # fmt: skip
        alone, sides = len(blocks) == 1, (inputs, outputs)
        named = [tuple(port[1] if alone else "_".join(port) for port in side) for side in sides]
        self.ports[name] = named[0], named[1]
        for side, new in zip(sides, named, strict=True):
            self.moved |= {port: (name, called) for port, called in zip(side, new, strict=True)}
        for port in inputs:
            terms = self.wires.pop(port)
            # What blocks of the same controller drive is closed among them within a sample, and no wire of the loop.
            self.within[self.moved[port]] = [(sign, self.moved[p]) for sign, p in terms if p in outputs]
            self.wires[self.moved[port]] = [(sign, p) for sign, p in terms if p not in outputs]
        for target, terms in self.wires.items():
            self.wires[target] = [(sign, self.moved.get(source, source)) for sign, source in terms]

    def _reached(self, outputs: Iterable[Port]) -> list[Port]:
        """Inputs that are acted on at once: straight, and through elements and blocks that let it through."""
        ahead = list(outputs)
        seen, found = set(ahead), []
        while ahead:
            for target in self._consumers(ahead.pop()):
                found.append(target)
                new = [port for port in self._let_through(target) if port not in seen]
                seen.update(new)
                ahead += new
        return found

    def _let_through(self, target: Port) -> list[Port]:
        """Outputs on which an input acts at once."""
        if target[0] in self.elements:
            return [(target[0], port) for port in self.ports[target[0]][1] if (target[0], port) not in self.late]
        block = self.linear.get(target[0])
        if block is None:
            return []
        column = block.system.D[:, block.input_ports.index(target)]
        return [port for port, gain in zip(block.output_ports, column, strict=True) if gain]

    def _delay(self, name: str, delay: float) -> None:
        """Put the dead time of a block where a loop can have it: in front of states alone, else behind the block."""
        block = self.linear[name]
        if len(block.system.A) and not np.any(block.system.D):
            for port in block.input_ports:
                made = self._fresh(f"{name}_{port[1]}_delay")
                self.wires[port] = [(1.0, self._late(made, self.wires[port], delay))]
            return
        for port in block.output_ports:
            self.unseen.add(port)
            if not self._late_behind_element(port, delay):
                consumers = self._consumers(port)
                late = self._late(self._fresh(f"{name}_{port[1]}_delay"), [(1.0, port)], delay)
                self._rewire(consumers, port, late)

    def _delay_alone(self, name: str, delay: float) -> None:
        """Put a dead time that stands alone where a loop can have it: before what stands in front of it, or behind."""
        entry, out = (name, "in"), (name, "out")
        before, terms, behind = self._only_feeds(name), self.wires[entry], self._consumers(out)
        del self.linear[name]
        if before is not None:
            # A block that feeds nothing but the dead time is as late as what comes out behind it, and not to be seen.
            place = terms[0][1]
            self._delay(before, delay)
            self.unseen |= {place, *(port for port, there in self.moved.items() if there == place)}
            self._rewire(behind, out, place)
        elif self._late_behind_element(out, delay):
            place = behind[0]
            sign = self.wires[place][0][0]
            self.wires[place] = [(sign * s, source) for s, source in terms]
            self.unseen.add(out)
        else:
            place = self._late(name, terms, delay)
            self._rewire(behind, out, place)
            self.unseen.add(out)
        if place != out:
            del self.wires[entry]
            self.moved |= {entry: place, out: place}

    def _late_behind_element(self, port: Port, delay: float) -> bool:
        """Whether what is late there drives nothing but one element: then its outputs are late in its place.

        An element with one input does the same later to what comes later.
        """
        behind = self._consumers(port)
        name = behind[0][0] if len(behind) == 1 else ""
        if name not in self.elements or len(self.wires[behind[0]]) > 1:
            return False
        element, (inputs, outputs) = self.elements[name], self.ports[name]
        if len(inputs) > 1 or element.own_states is not None:
            return False
        self.unseen |= {behind[0], *((name, out) for out in outputs)}
        for out in outputs:
            if not self._late_behind_element((name, out), delay):
                self.late[name, out] = self.late.get((name, out), 0.0) + delay
        return True

    def _consumers(self, port: Port) -> list[Port]:
        """Inputs that a port drives."""
        return [target for target, terms in self.wires.items() if any(p == port for _, p in terms)]

    def _rewire(self, targets: Iterable[Port], old: Port, new: Port) -> None:
        """Let inputs be driven by another port."""
        for target in targets:
            self.wires[target] = [(sign, new if p == old else p) for sign, p in self.wires[target]]

    def _fresh(self, name: str) -> str:
        """A name for an element that no part has."""
        return free_name(name, {*self.elements, *(part for part, _ in self.original)})

    def _only_feeds(self, name: str) -> str | None:
        """The block with states and one output that feeds a dead time and nothing else, not even a named signal."""
        terms = self.wires[name, "in"]
        if len(terms) != 1 or terms[0][0] != 1.0 or terms[0][1][0] not in self.linear or terms[0][1] in self.shown:
            return None
        source = terms[0][1]
        block = self.linear[source[0]]
        strict = len(block.system.A) and not np.any(block.system.D)
        alone = block.output_ports == (source,) and self._consumers(source) == [(name, "in")]
        return source[0] if strict and alone else None

    def _late(self, name: str, terms: Terms, delay: float) -> Port:
        """The output of an element that hands a sum on, late; one whose output goes nowhere else serves itself."""
        source = terms[0][1] if len(terms) == 1 and terms[0][0] == 1.0 else ("", "")
        users = sum(p == source for sums in self.wires.values() for _, p in sums)
        if source[0] in self.elements and users == 1 and passes_outputs(self.elements[source[0]]):
            self.late[source] = self.late.get(source, 0.0) + delay
            return source
        self.elements[name] = PiecewiseLinear([], [1.0], [0.0])
        self.ports[name] = ("in",), ("out",)
        self.wires[name, "in"] = terms
        self.late[name, "out"] = delay
        return name, "out"


def _time_step_of_all(parts: Iterable[Block | Nonlinearity]) -> float | None:
    """Sample time of a diagram in discrete time: all its linear blocks are executed together, at once and in no time.

    Blocks without states may be continuous: what they do to samples is the same. Elements that bring states of their
    own (a clock, a bristle) live in continuous time.
    """
    steps: set[float | None] = set()
    for part in parts:
        if isinstance(part, Constant):
            continue
        if not isinstance(part, Block):
            if part.own_states is not None:
                return None
        elif part.delay or part.computation_delay:
            return None
        elif part.sample_time or len(part.state_space().A):
            steps.add(part.sample_time)
    return steps.pop() if len(steps) == 1 else None
