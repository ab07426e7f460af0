"""The least dither that removes a limit cycle: proposed by the smoothed loop, settled by exact runs on both sides."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from eppanalysis.errors import EppError, did_you_mean
from eppanalysis.methods.describing.predict import search_balance
from eppanalysis.methods.describing.quality import stability
from eppanalysis.methods.dither.result import Dither
from eppanalysis.methods.dither.runs import DitherRun, Rig
from eppanalysis.methods.dither.smoothed import Wave, smoothed
from eppanalysis.methods.search.find import find_limit_cycles
from eppanalysis.models.elements.dynamic.sampled import SampledController
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.sampled.averaged import averaged
from eppanalysis.models.systems.subject import CaseLike, PointLike, facts_of, standing
from eppanalysis.results import LimitCycle, Status
from eppanalysis.results.provenance import Provenance

#: Amplitudes at which the DF is evaluated, relative to that of the cycle, and halvings between two of them.
_ASKED, _HALVINGS = np.geomspace(0.05, 3.0, 10), 10
#: Step between amplitudes that are run where runs and the DF differ, and how often.
_STEP, _MOST_STEPS = 1.08, 20
#: A dither with fewer periods in one of the cycle is not fast.
_FAST = 5.0


def dither(
    system: LureSystem | CaseLike,
    *,
    frequency: float,
    wave: Wave = "sine",
    element: str | None = None,
    operating_point: PointLike | None = None,
    tolerance: float = 0.02,
) -> Dither:
    """The least amplitude of a fast dither at an element's input that removes the loop's limit cycle.

    The describing function of the loop with the smoothed element (:func:`smoothed`) proposes the amplitude; exact runs
    with the dither as an input, begun on the largest stable limit cycle and at the loop's own start, tell on both sides
    whether the cycle stays or goes, and narrow it down.

    Parameters
    ----------
    system : LureSystem or Case
        Beside sampled controllers the element is in the continuous part, where the dither passes between samples.
    frequency : float
        Of the dither [Hz]; at least five times that of the cycle.
    wave : {"sine", "triangle"}
        Form of the dither.
    element : str, optional
        Name of the element that is dithered: one without memory, or a play; by default the only one.
    operating_point : OperatingPoint or mapping of str to float, optional
        Where the inputs are held; by default that of the case or loop.
    tolerance : float
        Distance between the amplitudes at which the cycle stays and goes, relative to them.

    Returns
    -------
    Dither

    Raises
    ------
    EppError
        If a number is not valid, the loop has no stable limit cycle, or is in discrete time; if the dither is not fast
        beside the cycle.
    ModelError
        If the element is not covered.

    References
    ----------
    As :func:`smoothed`.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> loop = epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Relay())
    >>> found = epp.dither(loop, frequency=4.0, wave="triangle")
    >>> round(found.first_order, 3), found.stays < 1 / 6 * 1.02, found.status.name
    (0.167, True, 'CONVERGED')
    """
    if not 0.0 < tolerance <= 0.5:
        raise EppError(f"dither: tolerance is {tolerance}; expected more than 0 and 0.5 at most.")
    if not (np.isfinite(frequency) and frequency > 0):
        raise EppError(f"dither: frequency is {frequency}; expected a positive number [Hz].")
    loop, at = standing(system, operating_point, "dither")
    if loop.time_step:
        raise EppError(
            f"dither: {loop.name} is in discrete time, and nothing moves between samples that a dither could smooth; "
            "expected continuous time, where controllers may be sampled."
        )
    number = _number(loop, element)
    smoothed(loop.elements[number], 1.0, wave)  # refused here, before anything is searched for
    cycle = _largest(system, operating_point)
    if frequency * cycle.period < _FAST:
        raise EppError(
            f"dither: frequency is {frequency:.6g} Hz; expected {_FAST:g} times that of the limit cycle, "
            f"{cycle.frequency:.4g} Hz, or more (for a slower sine use forced_response)."
        )
    held = replace(loop, v0=at.vector(loop))
    rig = Rig.of(held, number, cycle, frequency, wave)
    search = _Search(held, number, rig, rig.size_of_cycle(), tolerance)
    proposed = search.proposed()
    stays, goes = search.settled(proposed)
    settings = {"system": loop.name, "frequency": frequency, "wave": wave, "tolerance": tolerance}
    return Dither(
        element=loop.element_names[number],
        characteristic=loop.elements[number],
        wave=wave,
        frequency=frequency,
        amplitude=goes,
        stays=stays,
        first_order=proposed,
        size=search.size,
        cycle=cycle,
        returned=search.returned(goes if np.isfinite(goes) else proposed),
        predicted=np.array(sorted(search.predicted.items()), float).reshape(-1, 2),
        runs=tuple(sorted(search.runs, key=lambda run: (run.amplitude, run.start))),
        status=Status.CONVERGED if np.isfinite(goes) and goes <= stays * (1.0 + tolerance) else Status.UNDECIDED,
        provenance=Provenance("smoothed loop and runs with dither", settings, case=facts_of(system)),
        operating_point=at,
    )


def _number(loop: LureSystem, element: str | None) -> int:
    own = [i for i, e in enumerate(loop.elements) if not isinstance(e, SampledController)]
    if element is None and len(own) != 1:
        names = ", ".join(loop.element_names[i] for i in own)
        raise EppError(f"dither: {loop.name} has {len(own)} elements ({names}); expected the name of one.")
    if element is not None and element not in loop.element_names:
        raise EppError(
            f"dither: there is no element {element!r}; expected {did_you_mean(element, loop.element_names)}."
        )
    return own[0] if element is None else loop.element_names.index(element)


def _largest(system: LureSystem | CaseLike, operating_point: PointLike | None) -> LimitCycle:
    """The largest stable limit cycle, which comes last."""
    stable = [c for c in find_limit_cycles(system, operating_point) if c.stable]
    if not stable:
        raise EppError("dither: the search finds no stable limit cycle; expected a loop with one to remove.")
    return stable[-1]


@dataclass(eq=False)
class _Search:
    """The search for the least dither; lives for one call."""

    loop: LureSystem
    number: int
    rig: Rig
    size: float
    tolerance: float
    predicted: dict[float, float] = field(default_factory=dict)
    runs: list[DitherRun] = field(default_factory=list)

    def proposed(self) -> float:
        """The least amplitude without a stable cycle in the smoothed loop, by the DF; nan where there is none."""
        before = 0.0
        for amplitude in (float(share) * 0.5 * self.size for share in _ASKED):
            # Not where rest becomes stable: under a sine the cycle may live on beside
            # it (docs/theory/dither.md, The least dither that removes a cycle).
            if not self.first_order(amplitude):
                for _ in range(_HALVINGS):
                    middle = 0.5 * (before + amplitude)
                    before, amplitude = (middle, amplitude) if self.first_order(middle) else (before, middle)
                return amplitude
            before = amplitude
        return float("nan")

    def first_order(self, amplitude: float) -> float:
        """Peak-to-peak at the element's input of the largest stable cycle of the smoothed loop; 0 where none is."""
        elements = list(self.loop.elements)
        elements[self.number] = smoothed(elements[self.number], amplitude, self.rig.wave)
        memory = tuple(None if k == self.number else m for k, m in enumerate(self.loop.memory))
        loop = averaged(replace(self.loop, elements=tuple(elements), memory=memory, given=None))
        loop, place = loop.with_integrators_apart[0], loop.element_names.index(self.loop.element_names[self.number])
        with np.errstate(all="ignore"):
            balance, _, points = search_balance(loop, self.loop.v0)
            stable = [p for p in points if stability(balance, p)[0]]
        size = max((2.0 * float(p.amplitude[place]) for p in stable), default=0.0)
        self.predicted[amplitude] = size
        return size

    def settled(self, proposed: float) -> tuple[float, float]:
        """Amplitudes at which the cycle stays and goes in runs, near each other; 0 and nan where runs show no such."""
        near = proposed if np.isfinite(proposed) else float(_ASKED[-1]) * 0.5 * self.size
        stays, goes = 0.0, float("nan")
        # Half a tolerance above what the DF says: where it is
        # right, this run and the next, a tolerance lower, will do.
        amplitude = near * (1.0 + 0.5 * self.tolerance)
        for _ in range(_MOST_STEPS):
            if self._goes(amplitude):
                goes, amplitude = amplitude, amplitude / (_STEP if np.isfinite(goes) else 1.0 + self.tolerance)
            else:
                stays, amplitude = amplitude, amplitude * _STEP
            if stays and np.isfinite(goes):
                break
        while stays and goes > stays * (1.0 + self.tolerance):
            middle = float(np.sqrt(stays * goes))
            stays, goes = (stays, middle) if self._goes(middle) else (middle, goes)
        return stays, goes

    def _goes(self, amplitude: float) -> bool:
        made = self.rig.removes(amplitude, self.size)
        self.runs += made
        return all(run.gone for run in made)

    def returned(self, amplitude: float) -> float:
        """How much of the dither the loop brings back to the element's input, by the DF."""
        if not np.isfinite(amplitude):
            return float("nan")
        row, column = self.loop.input_slices[self.number].start, self.loop.output_slices[self.number].start
        gain = complex(self.loop.elements[self.number].describing_function(amplitude)[1])
        response = self.loop.frequency_response(np.array([2.0 * np.pi * self.rig.frequency]))[0, row, column]
        return float(abs(gain * response))
