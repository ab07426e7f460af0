"""The parts of a diagram sorted into linear blocks and elements, with dead times as delayed outputs of elements.

A loop knows dead time at the outputs of its elements only. A block with states and nothing that goes straight through
is the same behind a delay as in front of it, so the delay is put at its inputs; else at its outputs. So are blocks
that elements drive and that feed nothing else: an element that switches is as late as they are, and its output is
constant between switches. Where there is no element, one that hands its input on is put in.

All blocks that are executed together become one sampled controller: within one sample they act on one another at once.
Where nothing linear is left beside them, the loop is one of discrete time instead.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Set
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
    #: Places of ports of the diagram that have another one here.
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

        What is before an element, such as the limit of a speed that is commanded, is computed first, and what
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
        if _is_strict(block):
            self._delay_inputs(block.input_ports, delay)
            return
        for port in block.output_ports:
            self.unseen.add(port)
            if not self._late_behind_element(port, delay):
                consumers = self._consumers(port)
                late = self._late(self._fresh(f"{name}_{port[1]}_delay"), [(1.0, port)], delay)
                self._rewire(consumers, port, late)

    def _delay_alone(self, name: str, delay: float) -> None:
        """Put a dead time that is alone where a loop can have it: before what is in front of it, or behind."""
        entry, out = (name, "in"), (name, "out")
        terms, behind, before = self.wires[entry], self._consumers(out), self._handing_on([entry])
        blocks = {source[0] for _, source in terms if source not in self.constants}
        carried = bool(blocks) and blocks <= before
        place = out
        if carried and all(_is_strict(self.linear[b]) for b in blocks):
            self._delay_inputs([entry], delay, blocks)
        elif self._late_behind_element(out, delay):
            place = behind[0]
            sign = self.wires[place][0][0]
            self.wires[place] = [(sign * s, source) for s, source in terms]
        elif carried and self._made_by_elements([entry], before):
            self._delay_inputs([entry], delay)
        else:
            del self.linear[name]
            place = self._late(name, terms, delay)
            self._rewire(behind, out, place)
            self.unseen.add(out)
        if place != out:
            self.unseen.add(out)
            self.linear.pop(name, None)
            del self.wires[entry]
            self.moved |= {entry: place, out: place}

    def _delay_inputs(self, ports: Iterable[Port], delay: float, least: Set[str] = frozenset()) -> None:
        """Let what drives inputs be late: before all blocks that hand it on, where elements drive these, or `least`.

        Blocks that feed nothing but what is late do the same later to what comes later, and are not to be seen.
        """
        ports = tuple(ports)
        handing_on = self._handing_on(ports)
        before = handing_on if self._made_by_elements(ports, handing_on) else least
        places = {port for b in before for port in self.linear[b].output_ports}
        self.unseen |= places | {port for port, there in self.moved.items() if there in places}
        entering = self._entering(ports, before)
        uses = Counter(source for terms in self.wires.values() for _, source in terms)
        uses.subtract(source for terms in entering.values() for _, source in terms)
        own = {p for terms in entering.values() for _, p in terms if p[0] in self.elements and not uses[p]}
        own = {source for source in own if passes_outputs(self.elements[source[0]])}
        for source in own:
            self.late[source] = self.late.get(source, 0.0) + delay
        for port, terms in entering.items():
            others = [term for term in terms if term[1] not in own]
            if others:
                made = self._late(self._fresh(f"{port[0]}_{port[1]}_delay"), others, delay)
                self.wires[port] = [*(t for t in self.wires[port] if t not in others), (1.0, made)]

    def _handing_on(self, ports: Iterable[Port]) -> set[str]:
        """Linear blocks whose outputs lead to these inputs and to nothing else, not even a named signal."""
        found, ahead = set[str](), list(ports)
        while ahead:
            new = {p[0] for _, p in self.wires[ahead.pop()] if p[0] in self.linear} - found
            found |= new
            ahead += [port for name in new for port in self.linear[name].input_ports]
        while True:
            ends = {*ports, *(port for name in found for port in self.linear[name].input_ports)}
            kept = {name for name in found if all(self._leads_to(p, ends) for p in self.linear[name].output_ports)}
            if kept == found:
                return found
            found = kept

    def _leads_to(self, port: Port, ends: Set[Port]) -> bool:
        """Whether an output drives some of these inputs and nothing else."""
        consumers = self._consumers(port)
        return bool(consumers) and port not in self.shown and all(target in ends for target in consumers)

    def _entering(self, ports: Iterable[Port], before: Set[str]) -> dict[Port, Terms]:
        """What drives inputs, or those of the blocks before them, from outside of these; constants are never late."""
        inner = {*self.constants, *(port for b in before for port in self.linear[b].output_ports)}
        entries = (*ports, *(port for b in before for port in self.linear[b].input_ports))
        return {port: [term for term in self.wires[port] if term[1] not in inner] for port in entries}

    def _made_by_elements(self, ports: Iterable[Port], before: Set[str]) -> bool:
        """Whether no linear block drives inputs, or those of the blocks before them, from outside of these."""
        terms = [term for sums in self._entering(ports, before).values() for term in sums]
        return all(source[0] not in self.linear for _, source in terms)

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


def _is_strict(block: Linear) -> bool:
    """Whether a block has states and nothing that goes straight through."""
    return bool(len(block.system.A)) and not np.any(block.system.D)


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
