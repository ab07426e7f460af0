"""Gain, phase, disk and delay margins of the linearised loop, cut open at any of its places."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, overload

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.errors import EppError, ModelError
from eppanalysis.methods.margins.crossovers import Response
from eppanalysis.methods.margins.linearised import Linearised, small_signal
from eppanalysis.methods.margins.measured import MeasuredGain, unstable_poles
from eppanalysis.methods.margins.reach import out_of_reach
from eppanalysis.methods.margins.result import Margins
from eppanalysis.methods.margins.stability import is_stable
from eppanalysis.models.elements.piecewise import UNITY
from eppanalysis.models.systems.cuts import port_names, require_places
from eppanalysis.models.systems.linear import is_linear
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.means import static_balance
from eppanalysis.models.systems.measured.loop import DataSystem, MeasuredLoop
from eppanalysis.models.systems.measured.response import MeasuredResponse
from eppanalysis.models.systems.sampled.averaged import averaged
from eppanalysis.models.systems.subject import CaseLike, facts_of, standing, system_of
from eppanalysis.readable import number
from eppanalysis.results import Status
from eppanalysis.results.provenance import Provenance

if TYPE_CHECKING:
    import control

_NAN, _INF = float("nan"), float("inf")


@overload
def margins(
    loop: LureSystem | CaseLike | MeasuredLoop | MeasuredResponse | control.LTI, at: str | None = None
) -> Margins: ...
@overload
def margins(
    loop: LureSystem | CaseLike | MeasuredLoop | MeasuredResponse | control.LTI, at: list[str] | tuple[str, ...]
) -> tuple[Margins, ...]: ...
def margins(
    loop: LureSystem | CaseLike | MeasuredLoop | MeasuredResponse | control.LTI,
    at: str | list[str] | tuple[str, ...] | None = None,
) -> Margins | tuple[Margins, ...]:
    """Gain, phase, disk and delay margins of the linearised loop, cut open at a place.

    Every element is replaced by the gain that it names for it (its ``linear_gain``), and the result says which. An
    element that jumps, such as a relay, has no gain: where the loop leads through one, it has no margins.

    Parameters
    ----------
    loop : LureSystem, Case, MeasuredLoop, or a loop gain
        A loop gain is a linear system of python-control, scipy or sympy with one input and one output, or its measured
        response, closed by a feedback of -1 as for ``control.margin``.
    at : str, or list or tuple of str, optional
        Names of places (``LureSystem.places``): the inputs and outputs of elements, "gear.in" and "gear.out", and what
        else the loop names, also by a signal that is taken at one. By default where the loop says (``margins_at``), at
        the first place where it names several, else the output of its principal element.

    Returns
    -------
    Margins or tuple of Margins
        One for each place where several are given.

    Raises
    ------
    ModelError
        If there is no such place, or the algebraic loop that is left has no unique solution.
    EppError
        If `loop` is none of them.

    Notes
    -----
    Crossovers are roots of the exact frequency response, dead time included. The closed loop is judged by its poles;
    with dead time, and of measured data, by the argument principle. Data show crossovers between their ends alone. The
    numbers do not depend on the order or the coordinates of anything.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> loop = epp.LureSystem.from_tf(
    ...     ([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Saturation(-1.0, 1.0)
    ... )
    >>> found = epp.margins(loop)
    >>> found.at, round(found.gain_margin, 6), round(found.phase_crossover, 6)
    ('saturation.out', 6.0, 1.414214)
    >>> [m.at for m in epp.margins(loop, ["saturation.in", "saturation.out"])]
    ['saturation.in', 'saturation.out']
    """
    loop = _closed_by_itself(loop)
    system = small_signal(system_of(loop, "margins"))
    if at is None:
        names: Sequence[str] = places_of(loop)[:1]
    else:
        names = [at] if isinstance(at, str) else list(at)
    names = [_place(system, name) for name in names]
    made_by = Provenance("margins", {"system": system.name}, case=facts_of(loop))
    with np.errstate(all="ignore"):
        if isinstance(system, DataSystem):
            found = tuple(_of_data(Linearised.of(system, name), system, name, made_by) for name in names)
        else:
            nowhere = _drifts(loop)
            found = tuple(_margins(Linearised.of(system, name), name, nowhere, made_by) for name in names)
    return found[0] if at is None or isinstance(at, str) else found


def _closed_by_itself(
    loop: LureSystem | CaseLike | MeasuredLoop | MeasuredResponse | control.LTI,
) -> LureSystem | CaseLike | MeasuredLoop:
    """A loop as it is; a loop gain closed by a feedback of -1, to be cut at "loop.out"."""
    if isinstance(loop, MeasuredResponse) or hasattr(loop, "frdata"):
        measured = loop if isinstance(loop, MeasuredResponse) else MeasuredResponse.from_control(loop)
        return replace(MeasuredLoop(measured, UNITY, name=measured.name).to_system(), element_names=("loop",))
    if not is_linear(loop):
        return loop
    return LureSystem.from_blocks([UNITY, loop], element_names=["loop"], name="loop")


def _place(system: LureSystem, name: str) -> str:
    """The place that a name means: its own, that of a part, or that of a signal which is taken there."""
    places, signals = system.places, system.signals
    if places.called(name) not in places.names and name in signals.names:
        i = signals.names.index(name)
        same = np.all(np.hstack([places.C - signals.C[i], places.D - signals.D[i]]) == 0.0, axis=1)
        if not same.any():
            what = f"margins: {system.name} cannot be cut at signal {name!r}, which is that of no single place"
            raise ModelError(what, expected=f"one of {', '.join(places.distinct)}")
        return places.names[int(np.argmax(same))]
    require_places(f"margins: {system.name}", [name], places)
    return places.called(name)


def places_of(loop: LureSystem | CaseLike | MeasuredLoop) -> tuple[str, ...]:
    """Names of the places at which margins cut a loop where nothing is requested.

    Raises
    ------
    EppError
        If the loop has no element and names no place.
    """
    system = small_signal(system_of(loop, "margins"))
    if system.margins_at:
        return system.margins_at
    if not system.elements:
        if system.places.names:
            return system.places.names[:1]
        raise EppError(f"margins: {system.name} has no element and names no place; expected a place to cut the loop.")
    element, label = system.elements[system.principal], system.element_names[system.principal]
    outputs, inputs = (port_names(label, what, n) for what, n in (("out", element.n_outputs), ("in", element.n_inputs)))
    gain = element.linear_gain()
    acting = np.flatnonzero(np.any(gain != 0.0, axis=1))
    if acting.size > 1 and element.n_inputs == 1:
        return (inputs[0],)
    return (outputs[int(acting[0]) if acting.size else 0],)


def _drifts(loop: LureSystem | CaseLike | MeasuredLoop) -> str:
    """Why a loop has no point at rest about which it could be linearised; nothing where none is known."""
    try:
        given, at = standing(loop, None, "margins")
        system = averaged(given).with_integrators_apart[0]
        return next(out_of_reach(system, static_balance(system, at.vector(system))), "")
    except EppError:  # an input that moves, or means that the loop leaves open
        return ""


def _margins(linearised: Linearised, at: str, nowhere: str, made_by: Provenance) -> Margins:
    """The margins at one place, unless the loop is nowhere at rest."""
    system = linearised.system
    rule = linearised.rule()
    if nowhere:
        return Margins(at, Status.INCOMPLETE, rule, nowhere, provenance=made_by)
    in_the_way = linearised.in_the_way(at)
    if in_the_way:
        return _without_a_gain(linearised, in_the_way, at, made_by)
    loop, closed = linearised.opened(at), linearised.closed()
    rates = np.concatenate([loop.rates, closed.rates])
    stable = is_stable(closed, rates)
    response = Response.of(loop, rates)
    if not np.any(response.value):
        why = "A signal from there does not return: no loop of elements with a gain leads through it."
        if linearised.system.cuts is not None:
            why += f" Other places of the loop: {', '.join(linearised.system.places.others(at))}."
        return Margins(at, Status.INCOMPLETE, rule, why, stable=stable, provenance=made_by)
    message = ""
    if stable is None:
        message = "The stability of the linearised loop is undecided: it is on the border within rounding."
    elif linearised.without:
        stable = None
        names = " and ".join(system.element_names[i] for i in linearised.without)
        message = (
            f"{names} without a gain: the stability of the whole loop is unknown; the margins are of the loop cut here."
        )
    ramp = _NAN if stable is False else loop.behind_a_ramp()
    return _read(response, stable, float(loop.D[0, 0]), ramp, Margins(at, Status.CONVERGED, rule, message), made_by)


def _of_data(linearised: Linearised, system: DataSystem, at: str, made_by: Provenance) -> Margins:
    """The margins at one place of a measured loop."""
    rule = linearised.rule()
    if linearised.without:
        return _without_a_gain(linearised, linearised.without, at, made_by)
    loop = MeasuredGain.of(system, linearised.gains, at)
    response = Response.refined(loop, loop.nodes)
    growing = None if system.only is None else unstable_poles(system.only, response.value)
    stable = None if growing is None else growing == 0
    message = f"Measured from {' to '.join(map(number, system.band))} rad/s."
    if system.only is not None:
        message += f" Unstable poles of the measured part: {system.only.unstable_poles or 'none'}."
    if stable is None:
        message += " The data do not decide the stability of the closed loop."
    return _read(response, stable, 0.0, _NAN, Margins(at, Status.CONVERGED, rule, message), made_by)


def _without_a_gain(linearised: Linearised, which: Sequence[int], at: str, made_by: Provenance) -> Margins:
    """What is said of a loop that leads through elements that no gain describes."""
    names = " and ".join(linearised.system.element_names[i] for i in which)
    why = f"The loop leads through {names}, without a gain there, so it has no margins."
    return Margins(at, Status.INCOMPLETE, linearised.rule(), why, provenance=made_by)


def _read(
    response: Response, stable: bool | None, straight: float, ramp: float, begun: Margins, made_by: Provenance
) -> Margins:
    """The margins that a response shows, beside what is known of the loop; `straight` passes at all frequencies."""
    of_gain, phase_crossover = _gain_margin(*response.phase_crossovers())
    crossovers = response.gain_crossovers()
    angles = np.angle(-response.loop.response(crossovers)) if crossovers.size else np.zeros(0)
    best = _least(np.abs(angles)) if angles.size else -1
    disk, disk_frequency = response.nearest_to_minus_one()
    return replace(
        begun,
        status=Status.CONVERGED if response.complete and stable is not None else Status.INCOMPLETE,
        gain_margin=of_gain,
        phase_margin=float(angles[best]) if angles.size else _INF,
        disk_margin=0.0 if stable is False else disk,
        delay_margin=_delay_margin(angles, crossovers, stable, straight),
        phase_crossover=phase_crossover,
        gain_crossover=float(crossovers[best]) if angles.size else _NAN,
        disk_frequency=disk_frequency,
        bandwidth=_NAN if stable is False else response.bandwidth(),
        tracking_error=ramp,
        stable=stable,
        omega=response.omega,
        response=response.value,
        provenance=made_by,
    )


def _gain_margin(omega: Array, real: Array) -> tuple[float, float]:
    """The factor nearest to one that brings the loop to the border, and its crossover."""
    if not omega.size:
        return _INF, _NAN
    best = _least(np.abs(np.log(-real)))
    return float(-1.0 / real[best]), float(omega[best])


def _least(sizes: Array) -> int:
    """Number of the least size in the order of frequencies; of several that are equal but for rounding the first."""
    return int(np.argmax(sizes <= sizes.min() * (1.0 + 1e-9)))


def _delay_margin(angles: Array, omega: Array, stable: bool | None, straight: float) -> float:
    """Least dead time that brings a stable loop to the border [s]; nan where it is not stable."""
    if not stable:
        return 0.0 if stable is False else _NAN
    # With a gain of one at frequencies without end, the least
    # dead time turns the phase to -180 degrees at some of them.
    if abs(straight) >= 1.0:
        return 0.0
    # The crossover whose phase a dead time brings to -180 degrees first is not always that of the least phase margin.
    return float(np.min(np.mod(angles, 2.0 * np.pi) / omega, initial=_INF))
