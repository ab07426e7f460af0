"""From a diagram to the loop that it closes: linear blocks become one state space around the elements.

Write e for what drives the inputs of the linear blocks from outside them. Their connections among one another are
closed first, which leaves ``x' = A x + B e, y = C x + D e``; outputs of elements and external inputs enter through e.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np

from eppanalysis.arrays import Array, BoolArray
from eppanalysis.errors import ModelError, did_you_mean
from eppanalysis.models.diagrams.blocks import Block
from eppanalysis.models.diagrams.blocks.control import Constant
from eppanalysis.models.diagrams.linear import closed_blocks
from eppanalysis.models.diagrams.network import Network
from eppanalysis.models.diagrams.wiring import Drawn, Port, incidence, written
from eppanalysis.models.systems.cuts import Cuts
from eppanalysis.models.systems.linear import StateSpace
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.signals import SignalMap

Terms = list[tuple[float, Port]]
#: Rows on states, outputs of elements, external inputs and one.
Rows = tuple[Array, Array, Array, Array]


def close(diagram: Drawn, wires: Mapping[Port, Terms], shown: Mapping[str, Terms]) -> LureSystem:
    """The loop of a diagram.

    Parameters
    ----------
    wires : mapping of Port to list of (float, Port)
        The signed sum of sources that drives each input.
    shown : mapping of str to list of (float, Port)
        Signals that are named in the diagram, as sums of sources.

    Raises
    ------
    ModelError
        If an algebraic loop has no unique answer, or a dead time acts straight on an element.
    """
    system = _closed_loop(diagram, wires, shown)
    if straight := _straight_delay(system):
        _refuse_straight_delay(diagram, wires, shown, *straight)
    return system


def _closed_loop(diagram: Drawn, wires: Mapping[Port, Terms], shown: Mapping[str, Terms]) -> LureSystem:
    network = Network.of(diagram, wires, (port for terms in shown.values() for _, port in terms))
    closed = _Closed.of(network)
    A, B, B_input, constant_state = closed.rate
    C, D, D_input, constant_input = closed.to_elements
    return LureSystem.build(
        A,
        B,
        C,
        list(network.elements.values()),
        D=D,
        B_input=B_input,
        D_input=D_input,
        input_names=network.external,
        constant_state=constant_state,
        constant_input=constant_input,
        element_names=tuple(network.elements),
        signals=closed.signals(diagram, shown),
        x0=network.start(),
        v0=list(diagram.levels.values()),
        memory=[diagram.memory.get(name) for name in network.elements],
        delays=network.delays(),
        time_step=network.time_step,
        state_names=network.state_names(),
        principal=list(network.elements).index(diagram.principal) if diagram.principal else 0,
        cuts=closed.cuts,
        margins_at=diagram.cuts or [port for port in diagram.controllers if port in closed.cuts.names][:1],
        name=diagram.name,
    )


@dataclass(frozen=True, eq=False)
class _Closed:
    """Linear part on the elements' outputs w, the external inputs v, and disturbances d of all ports."""

    #: rate, to_elements: of the state, and of the elements' inputs: on x, w, v and one.
    rate: Rows
    to_elements: Rows
    places: dict[Port, int]  # rows of ports among those of `carried`
    carried: Rows  # what every port carries, on x, w, v and one
    kicks: BoolArray  # outputs of elements that have impulses
    cuts: Cuts  # all ports of the diagram as places to cut

    @classmethod
    def of(cls, network: Network) -> _Closed:
        """Close the linear blocks of a network."""
        linear, elements = network.linear_ports(), network.element_ports()
        inner = closed_blocks(network.linear, network.wires, network.who)
        # What drives linear inputs (u) and element inputs (z): linear outputs (y), those of elements (w), inputs (v),
        # among them constants.
        from_y, from_w, from_v = linear[1], elements[1], (*network.external_ports(), *network.constants)
        uy, uw, uv = (incidence(network.wires, linear[0], s) for s in (from_y, from_w, from_v))
        zy, zw, zv = (incidence(network.wires, elements[0], s) for s in (from_y, from_w, from_v))
        y = (inner.C, inner.D @ uw, inner.D @ uv)
        z = (zy @ y[0], zy @ y[1] + zw, zy @ y[2] + zv)
        u = (uy @ y[0], uy @ y[1] + uw, uy @ y[2] + uv)
        n, nw, nv = len(inner.A), len(from_w), len(from_v)
        w = (np.zeros((nw, n)), np.eye(nw), np.zeros((nw, nv)))
        v = (np.zeros((nv, n)), np.zeros((nv, nw)), np.eye(nv))
        ports = (*from_y, *from_w, *from_v, *linear[0], *elements[0])
        carried = tuple(np.vstack([part[k] for part in (y, w, v, u, z)]) for k in range(3))
        places = {port: i for i, port in enumerate(ports)}
        cuts = _cuts(network, inner, (uy, uw, zy, zw), carried)
        places |= {port: places[there] for port, there in network.moved.items()}
        late = np.any(carried[1][: len(from_y)] * network.delays(), axis=1)
        for port in (*network.unseen, *(port for port, is_late in zip(from_y, late, strict=True) if is_late)):
            places.pop(port, None)
        levels = np.array(list(network.constants.values()))
        first = {(name, network.ports[name][1][0]) for name, e in network.elements.items() if e.has_impulses}
        kicks = np.array([port in first for port in from_w], bool)

        def with_constants(x: Array, w: Array, v: Array) -> Rows:
            """Constants taken out of the external inputs."""
            last = v.shape[1] - len(levels)
            return x, w, v[:, :last], v[:, last:] @ levels

        rate, seen = with_constants(inner.A, inner.B @ uw, inner.B @ uv), with_constants(*carried)
        return cls(rate, with_constants(*z), places, seen, kicks, cuts)

    def row(self, terms: Terms) -> list[Any]:
        """A signed sum of ports, on x, w, v and one."""
        rows = [self.places[port] for _, port in terms]
        signs = np.array([sign for sign, _ in terms])
        return [signs @ part[rows] for part in self.carried]

    def _jolts(self, port: Port) -> bool:
        """Whether a port carries impulses, which have no value."""
        return port in self.places and bool(np.any(self.carried[1][self.places[port]][self.kicks]))

    def signals(self, diagram: Drawn, shown: Mapping[str, Terms]) -> SignalMap:
        """Signals that the diagram names, then those of all ports that it can tell and that carry no impulses."""
        terms = dict(shown)
        if diagram.ports_as_signals:
            for name, port in signals_of_ports(diagram).items():
                if not self._jolts(port):
                    terms.setdefault(name, [(1.0, port)])
        known = {name: sums for name, sums in terms.items() if all(port in self.places for _, port in sums)}
        for name in shown:
            if name not in known:
                expected = "ports on the other side of their dead time, as a loop has only one of the two"
                raise ModelError(diagram.name, diagram.signals[name], expected, field=f"signals.{name}")
        for name in diagram.units:
            if name not in terms and name not in diagram.signals:
                raise ModelError(diagram.name, name, f"a signal: {did_you_mean(name, list(known))}", field="units")
        rows = [self.row(sums) for sums in known.values()]
        C, D, D_input, constant = (
            np.reshape([row[k] for row in rows], (len(rows), *part.shape[1:])) for k, part in enumerate(self.carried)
        )
        return SignalMap(tuple(known), C, D, D_input, constant, tuple(diagram.units.get(n, "") for n in known))


def signals_of_ports(diagram: Drawn) -> dict[str, Port]:
    """A signal for every output and external input, and for the inputs of elements; what is constant comes last.

    Sentences speak of the first signal, which should be one that moves.
    """
    ports = diagram.ports
    wanted = [(part, port, len(names) == 1) for part, names in ports.outputs.items() for port in names]
    wanted += [(name, "", True) for name in ports.external]
    inputs = {part: names for part, names in ports.inputs.items() if not isinstance(diagram.parts[part], Block)}
    wanted += [(part, port, False) for part, names in inputs.items() for port in names]
    found: dict[str, Port] = {}
    wanted.sort(key=lambda one: isinstance(diagram.parts.get(one[0]), Constant))
    single = {part for part, _, alone in wanted if alone}
    for part, port, alone in wanted:
        name = part if alone else f"{part}_{port}"
        found[name if alone or name not in {*single, *found} else f"{part}.{port}"] = part, port
    return found


def _cuts(
    network: Network, inner: StateSpace, wired: tuple[Array, Array, Array, Array], carried: Sequence[Array]
) -> Cuts:
    """All ports of the diagram as places to cut.

    Parameters
    ----------
    inner : StateSpace
        The linear blocks, closed among one another.
    wired : tuple of arrays
        How linear blocks (y) and elements (w) drive linear blocks (u) and elements (z): uy, uw, zy, zw.
    carried : sequence of arrays
        What outputs of linear blocks and elements, external inputs, and inputs carry, on x and w.
    """
    uy, uw, zy, zw = wired
    linear, elements = network.linear_ports(), network.element_ports()
    within = incidence({port: network.within.get(port, []) for port in elements[0]}, *elements)
    ports = (*linear[1], *elements[1], *linear[0], *elements[0])
    ny, nw, nu, nz = len(linear[1]), len(elements[1]), len(linear[0]), len(elements[0])
    # What a disturbance at each port adds to the drives of the linear blocks, to z, and to the port itself.
    drives = np.hstack([uy, uw, np.eye(nu), np.zeros((nu, nz))])
    straight = np.hstack([zy, zw + within, np.zeros((nz, nu)), np.eye(nz)])
    through = inner.D @ drives
    back = np.vstack([through, np.zeros((nw, len(ports))), uy @ through, np.zeros((nz, len(ports)))])
    E, F = zy @ through + straight, np.diag(back)
    outputs = ny + nw
    C, D = (np.vstack([part[:outputs], part[-(nu + nz) :]]) for part in carried[:2])
    D[-nz or len(D) :] += within
    delays = np.array(network.delays())
    late = [_delay_of(network.late, delays, port, C[i], D[i], E[:, i]) for i, port in enumerate(ports)]
    number = {port: i for i, port in enumerate(ports)}
    own = {port: number.get(network.moved.get(port, port), -1) for port in network.original}
    kept = {written(port): i for port, i in own.items() if i >= 0 and late[i] is not None}
    at = list(kept.values())
    return Cuts(
        tuple(kept), B=(inner.B @ drives)[:, at], E=E[:, at], C=C[at], D=D[at], F=F[at],
        delays=np.array([late[i] for i in at], float),
    )  # fmt: skip


def _delay_of(known: Mapping[Port, float], delays: Array, port: Port, C: Array, D: Array, E: Array) -> float | None:
    """Dead time of a disturbance at a port that carries ``C x + D w`` and acts on elements through E.

    A port that hands on nothing but a late output carries it before the dead time, as far as a loop can tell, and so
    the disturbance is late instead. Where more is mixed a loop cannot tell: None.
    """
    if port in known:
        return known[port]
    waits = set(delays[D != 0].tolist())
    if not any(waits):
        return 0.0
    return waits.pop() if len(waits) == 1 and not np.any(C) and not np.any(E) else None


def _straight_delay(system: LureSystem) -> tuple[str, str] | None:
    """An element with a late output and one on which that acts straight, where it would act without its dead time."""
    for late, outputs in zip(system.element_names, system.output_slices, strict=True):
        for hit, inputs in zip(system.element_names, system.input_slices, strict=True):
            if np.any(system.D[inputs, outputs][:, system.delays[outputs] > 0]):
                return late, hit
    return None


def _refuse_straight_delay(
    diagram: Drawn, wires: Mapping[Port, Terms], shown: Mapping[str, Terms], late: str, hit: str
) -> NoReturn:
    """Say what a dead time that acts straight on an element lacks: states, or freedom from signals before it."""
    part = max((name for name in diagram.parts if late.startswith(name)), key=len, default=late)
    between = f"a block with states {f'between {part} and' if part != hit else 'in front of'} {hit}"
    fixing = [name for name in shown if _goes_without(diagram, wires, {n: t for n, t in shown.items() if n != name})]
    if not fixing and shown and _goes_without(diagram, wires, {}):
        fixing = list(shown)
    if not fixing:
        said = f"{diagram.name}: the dead time of {part} acts straight on {hit}"
        raise ModelError(said, expected=between, field="connect")
    which = f"signal {fixing[0]}" if len(fixing) == 1 else f"signals {', '.join(fixing[:-1])} and {fixing[-1]}"
    expected = f"no {which}, so that the dead time of {part} may be elsewhere, or {between}"
    raise ModelError(diagram.name, diagram.signals[fixing[0]], expected, field=f"signals.{fixing[0]}")


def _goes_without(diagram: Drawn, wires: Mapping[Port, Terms], shown: Mapping[str, Terms]) -> bool:
    """Whether the loop closes with these signals alone, without a dead time straight on an element."""
    try:
        return not _straight_delay(_closed_loop(diagram, wires, shown))
    except ModelError:
        return False
