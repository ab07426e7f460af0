"""What is hardly meant between bodies: a play, whose output friction holds, between two that turn freely."""

from __future__ import annotations

from collections.abc import Iterator

from eppanalysis.models.diagrams import Diagram
from eppanalysis.models.diagrams.blocks import CartPendulum, Gear, Inertia, Mass, Motor, Shaft
from eppanalysis.models.diagrams.wiring import Port
from eppanalysis.models.elements import Play

_BODIES = (Inertia, Mass, Motor, CartPendulum)
#: Outputs that say where a body is, and inputs by which it is pushed.
_PLACES, _PUSHES = ("angle", "position", "wheel_angle"), ("torque", "force")
#: Parts that hand a place or a push on, without states.
_RIGID = (Gear, Shaft)


def plays_between_bodies(diagram: Diagram) -> tuple[str, ...]:
    """A sentence for each play that gets the places of two bodies, or moves one by the place of another.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> drive = epp.Diagram(
    ...     parts={
    ...         "gear": epp.Play(gap=0.1),
    ...         "shaft": epp.blocks.Shaft(stiffness=100.0),
    ...         "motor": epp.blocks.Inertia(inertia=1.0),
    ...         "load": epp.blocks.Inertia(inertia=2.0),
    ...     },
    ...     connect=[
    ...         "motor.angle - load.angle -> gear",
    ...         "gear -> shaft.twist",
    ...         "motor.speed - load.speed -> shaft.rate",
    ...         "shaft -> load",
    ...         "-shaft -> motor",
    ...     ],
    ... )
    >>> print(plays_between_bodies(drive)[0].partition(";")[0])
    gear is a play between motor and load, so friction would have to hold its output
    """
    plays = [name for name, part in diagram.parts.items() if type(part) is Play]
    return tuple(_sentence(name, bodies) for name in plays if len(bodies := _bodies_of(diagram, name)) > 1)


def _sentence(name: str, bodies: list[str]) -> str:
    return (
        f"{name} is a play between {bodies[0]} and {bodies[1]}, so friction would have to hold its output; for a gap "
        f'in which no torque acts write kind = "lock_pin", with gap, stiffness and damping.'
    )


def _bodies_of(diagram: Diagram, play: str) -> list[str]:
    """Bodies whose place a play gets, and behind them those that it pushes by it."""
    before = dict.fromkeys(_places_before(diagram, (play, "in"), {play}))
    behind = dict.fromkeys(_pushed_behind(diagram, (play, "out"), {play})) if before else {}
    return list(before | behind)


def _places_before(diagram: Diagram, port: Port, seen: set[str]) -> Iterator[str]:
    for _, (part, output) in diagram.wires[port]:
        made = diagram.parts.get(part)
        if isinstance(made, _BODIES) and output in _PLACES:
            yield part
        elif isinstance(made, Gear) and output == "angle" and part not in seen:
            yield from _places_before(diagram, (part, "angle_in"), {*seen, part})


def _pushed_behind(diagram: Diagram, port: Port, seen: set[str]) -> Iterator[str]:
    for (part, input_name), terms in diagram.wires.items():
        made = diagram.parts[part]
        if not any(source == port for _, source in terms):
            continue
        if isinstance(made, _BODIES) and input_name in _PUSHES:
            yield part
        elif isinstance(made, _RIGID) and part not in seen:
            for output in made.outputs:
                yield from _pushed_behind(diagram, (part, output), {*seen, part})
