"""How stiff a virtual spring and a virtual wall may be: the largest stiffness that comes to rest, found twice.

Once by the engine on the diagram, once by closed forms that know nothing of it: between two samples the force is
constant, so while the speed keeps its sign ``m x'' + b x' = F -+ f_c`` has an exponential as its solution, and where
the speed has come to zero the mass sticks while the force is no more than f_c. Beside them stand the bounds of
passivity ``2 b/T`` and ``2 f_c/quantum``: Diolaiti, Niemeyer, Barbagli and Salisbury, "Stability of haptic rendering:
discretization, quantization, time delay, and Coulomb effects", IEEE Trans. Robotics 22(2), 2006, 256-268.

The edge is not a simple one: 0.2 mm (four steps of the encoder) aside, springs of 3453.98 to 3456 N/m do not come to
rest, those above do again up to 3550 N/m, and islands of both follow. Engine and closed forms agree on them; the table
shows the first that does not. The wall's limit is another one: with the hand at 0.5 N the mass can only rest where the
force of one of the encoder's steps is within f_c of the hand's, and from ``(0.5 N + f_c)/(5 quantum)`` on none is.

Run it: ``python -m studies.virtual_spring``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import eppanalysis as epp
from eppanalysis.results import PlainData

__all__ = ["STARTS", "Haptic", "SpringRow", "by_closed_forms", "by_engine", "comes_to_rest", "spring_table"]

_LONGEST = 60.0
_MOST_EVENTS = 60_000
#: Ratio of the steps in which the edge is looked for.
_FINE = 1.0005


@dataclass(frozen=True)
class Haptic:
    """A mass on a virtual spring, or before a virtual wall [SI].

    Attributes
    ----------
    aside : float
        Where it is let go [m]; a wall stands at zero, before it positions are negative.
    wall : bool
        Whether the spring only pushes back at positive positions.
    hand : float
        Constant force towards the wall [N].
    mass, damping, coulomb, sample_time, quantum : float
    """

    aside: float
    wall: bool = False
    hand: float = 0.0
    mass: float = 0.1
    damping: float = 0.1
    coulomb: float = 0.05
    sample_time: float = 1e-3
    quantum: float = 50e-6

    @property
    def bounds(self) -> tuple[float, float]:
        """Stiffnesses up to which damping, and friction, keep it passive [N/m]."""
        return 2.0 * self.damping / self.sample_time, 2.0 * self.coulomb / self.quantum

    def loop(self, stiffness: float) -> epp.LureSystem:
        """The loop that the engine runs."""
        parts: dict[str, epp.Block | epp.Nonlinearity] = {
            "mass": epp.blocks.Mass(mass=self.mass, damping=self.damping, start=[self.aside, 0.0]),
            "friction": epp.Friction(coulomb=self.coulomb),
            "encoder": epp.Quantiser(step=self.quantum, levels=2000),
            "spring": epp.blocks.Gain(gain=stiffness, sample_time=self.sample_time),
            "hand": epp.blocks.Constant(value=self.hand),
        }
        connect = ["hand - spring - friction -> mass", "mass.speed -> friction", "mass.position -> encoder"]
        if self.wall:
            parts["wall"] = epp.PiecewiseLinear(breakpoints=[0.0], slopes=[0.0, 1.0], intercepts=[0.0, 0.0])
            connect += ["encoder -> wall", "wall -> spring"]
        else:
            connect += ["encoder -> spring"]
        return epp.Diagram(parts=parts, connect=connect, name="virtual_spring").to_system()

    def settles(self, stiffness: float) -> bool:
        """Whether the engine's run comes to rest."""
        run = epp.simulate(self.loop(stiffness), t_end=_LONGEST, t_eval=[_LONGEST], max_events=_MOST_EVENTS)
        return run.status is epp.Status.SETTLED


def comes_to_rest(device: Haptic, stiffness: float) -> bool:
    """The same by closed forms from sample to sample.

    It is at rest where it sticks at a sample, as nothing changes from there on.
    """
    position, speed = device.aside, 0.0
    for _ in range(round(_LONGEST / device.sample_time)):
        seen = device.quantum * math.floor(position / device.quantum + 0.5)
        force = device.hand - stiffness * (max(seen, 0.0) if device.wall else seen)
        if speed == 0.0 and abs(force) <= device.coulomb:
            return True
        position, speed = _until_next_sample(device, position, speed, force)
        if abs(position) > 1.0:
            return False
    return False


def _until_next_sample(device: Haptic, position: float, speed: float, force: float) -> tuple[float, float]:
    """Position and speed one sample time later, from one change of the speed's sign to the next."""
    left = device.sample_time
    while left > 0.0:
        if speed == 0.0 and abs(force) <= device.coulomb:
            return position, 0.0
        net = force - math.copysign(device.coulomb, speed or force)
        final, rate = net / device.damping, device.damping / device.mass
        stops = math.log1p(-speed / final) / rate if net * speed < 0.0 else math.inf
        time = min(stops, left)
        decayed = -math.expm1(-rate * time)
        position += final * time + (speed - final) * decayed / rate
        speed = 0.0 if stops < left else speed + (final - speed) * decayed
        left -= time
    return position, speed


def climb(settles: Callable[[float], bool], stiffness: float, ratio: float) -> float:
    """The last stiffness that settles, in steps of a `ratio` from one that does [N/m].

    Springs that are stiffer still may come to rest again, so it is looked for from below and not by halving.
    """
    if not settles(stiffness):
        raise ValueError(f"A stiffness of {stiffness:g} N/m does not come to rest; expected one that does.")
    while settles(stiffness * ratio):
        stiffness *= ratio
    return stiffness


def by_closed_forms(device: Haptic) -> float:
    """The largest stiffness that comes to rest by closed forms, to 0.05 % [N/m]."""

    def settles(stiffness: float) -> bool:
        return comes_to_rest(device, stiffness)

    return climb(settles, climb(settles, 100.0, 1.01) / 1.05, _FINE)


def by_engine(device: Haptic, near: float) -> float:
    """The largest stiffness that comes to rest by the engine, to 0.05 %, from 0.4 % below `near` on [N/m]."""
    return climb(device.settles, near / _FINE**8, _FINE)


#: What is let go: on a spring 0.2 mm and 5 mm aside, and as far before a wall that a hand presses it to with 0.5 N.
STARTS = (Haptic(2e-4), Haptic(5e-3), Haptic(-2e-4, wall=True, hand=0.5), Haptic(-5e-3, wall=True, hand=0.5))


@dataclass(frozen=True)
class SpringRow(PlainData):
    """One start and what it allows [SI].

    Attributes
    ----------
    start : str
    engine, reference : float
        Largest stiffness that comes to rest, by the engine and by closed forms.
    damping_bound, friction_bound : float
        Up to which damping, and friction, keep it passive.
    """

    start: str
    engine: float
    reference: float
    damping_bound: float
    friction_bound: float


def spring_table(devices: Sequence[Haptic] = STARTS) -> tuple[SpringRow, ...]:
    """The largest stiffness for each of some devices."""
    rows = []
    for device in devices:
        reference = by_closed_forms(device)
        what = "before a wall, hand 0.5 N" if device.wall else "aside on a spring"
        start = f"{abs(device.aside) * 1e3:g} mm {what}"
        rows.append(SpringRow(start, by_engine(device, reference), reference, *device.bounds))
    return tuple(rows)


def main() -> None:
    """Print the table."""
    print(f"{'let go':<33} {'engine':>8} {'closed forms':>13} {'2b/T':>6} {'2fc/q':>6}   [N/m]")
    for row in spring_table():
        print(f"{row.start:<33} {row.engine:8.0f} {row.reference:13.0f} "
              f"{row.damping_bound:6.0f} {row.friction_bound:6.0f}")  # fmt: skip


if __name__ == "__main__":
    main()
