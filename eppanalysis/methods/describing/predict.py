"""Describing-function prediction: all limit cycles that DF harmonic balance with bias has.

The equations are in ``describing_balance``, the searches in ``describing_search`` (one element) and
``describing_multi`` (several), stability in ``describing_quality``, error estimates in ``describing_error``, what a
picture needs in ``describing_picture``.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.errors import ModelError
from eppanalysis.methods.describing.balance import Balance
from eppanalysis.methods.describing.data.cycles import above_the_data, cautions, of_data
from eppanalysis.methods.describing.data.stability import stability_of_data
from eppanalysis.methods.describing.equilibrium import levels_held
from eppanalysis.methods.describing.error import Estimate
from eppanalysis.methods.describing.multi import choose_pivot, search_several
from eppanalysis.methods.describing.neglected_harmonics import blind_spots, jumps, made_by_harmonics
from eppanalysis.methods.describing.nyquist import loop_gain_curves, nyquist_curves
from eppanalysis.methods.describing.quality import Point, point, stability
from eppanalysis.methods.describing.search import Found, is_one_loop, search_one
from eppanalysis.methods.harmonic.averaged import left_out, locking, of_samples
from eppanalysis.methods.harmonic.loop import role_of_input
from eppanalysis.methods.margins.linearised import within_range
from eppanalysis.methods.margins.margins import margins, places_of
from eppanalysis.methods.margins.result import Margins
from eppanalysis.methods.simulation.states import Subsystem, elements_apart, parts_apart, without_held_states
from eppanalysis.models.elements.piecewise import UNITY
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.means import mean_state, static_balance
from eppanalysis.models.systems.measured.loop import DataSystem, MeasuredLoop
from eppanalysis.models.systems.operating import OperatingPoint
from eppanalysis.models.systems.own_states import ports
from eppanalysis.models.systems.sampled.averaged import AveragedSystem, averaged
from eppanalysis.models.systems.subject import CaseLike, PointLike, standing
from eppanalysis.readable import count, listed
from eppanalysis.results import DESCRIBING_FUNCTION, LimitCycle, Prediction, Status
from eppanalysis.results.deferred import Deferred
from eppanalysis.results.measured import MeasuredCycle
from eppanalysis.results.provenance import Provenance

#: Relative residual of the balance up to which a cycle is one.
_RESIDUAL = 1e-9
#: Sum of the cubes of the phases [rad^3] that a dead time turns at the cycles of a loop, up to which they are kept.
_MOST_MODES = 5e7
#: Share below which a part of an input is rounding, as in coordinates that were turned.
_SAME = 1e-9
#: Amplitude of a constant input.
_STILL = 1e-9


def predict_limit_cycles(
    system: LureSystem | CaseLike | MeasuredLoop, operating_point: PointLike | None = None
) -> Prediction:
    """Limit cycles by describing functions with bias: stable and unstable, symmetric and biased.

    Parameters
    ----------
    system : LureSystem, Case or MeasuredLoop
        Of a measured loop all cycles between the lowest and the highest frequency of the data, each a
        :class:`~eppanalysis.results.measured.MeasuredCycle`.
    operating_point : OperatingPoint or mapping of str to float, optional
        Where the external inputs are held, or some of them by name [SI]; by default that of the case or loop.

    Returns
    -------
    Prediction
        Cycles in ascending order of amplitude at the first element's input, which is in sine phase.

    Raises
    ------
    ModelError
        If an element has no describing function, an input is unknown, the static balance does not determine the
        means, numbers are beyond all range, or measured data end below harmonics that matter to a cycle.
    EppError
        If an input is not constant.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> loop = epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Relay())
    >>> prediction = epp.predict_limit_cycles(loop)
    >>> [(round(c.omega, 6), round(c.amplitude("x"), 6), c.stable) for c in prediction]
    [(1.414214, 0.212207, True)]
    """
    own, at = standing(system, operating_point, "predict_limit_cycles")
    if not isinstance(own, DataSystem):
        _require_range(own)
    apart = None if isinstance(own, DataSystem) else elements_apart(own)
    seen = own if apart is None else apart.system
    parts = _parts(seen, at)
    if not parts:
        return _of_one(own, at)
    found = _of_parts(seen, at, parts)
    return found if apart is None else replace(found, cycles=tuple(map(apart.to_user, found)))


def _of_parts(own: LureSystem, at: OperatingPoint, parts: Sequence[tuple[Subsystem, LureSystem, Array]]) -> Prediction:
    """The predictions of groups of elements that swing without the others, as one."""
    each = [_of_one(loop, at) for _, loop, _ in parts]
    cycles = [p.to_user(c, own, state) for (p, _, state), found in zip(parts, each, strict=True) for c in found]
    # What only hands a late input on is no element to the user.
    groups = [_nonlinear(loop) for _, loop, _ in parts]
    names = [f"Of {listed(group)}: " if group != _nonlinear(own) else "" for group in groups]
    apart = (
        "Not all elements act on one another: each cycle is of one group that swings alone "
        f"({'; '.join(map(listed, groups))}), with the others at rest or their means."
    )
    return Prediction(
        cycles=tuple(cycles),
        status=next((found.status for found in each if not found.status.ok), Status.CONVERGED),
        search=" ".join(f"{name}{found.search}" for name, found in zip(names, each, strict=True)),
        on_grid=any(found.on_grid for found in each),
        unseen=partial(_unseen_of_parts, apart if any(names) else "", each),
        curves=max(each, key=len).curves,
        margins=Deferred(partial(_of_small_signals, own, at)),
        provenance=_made_by(own, at),
        operating_point=at,
    )


def _unseen_of_parts(apart: str, each: Sequence[Prediction]) -> tuple[str, ...]:
    return (*[apart] * bool(apart), *(sentence for found in each for sentence in found.warnings))


def _nonlinear(loop: LureSystem) -> list[str]:
    return [name for name, element in zip(loop.element_names, loop.elements, strict=True) if element != UNITY]


def _of_one(own: LureSystem, at: OperatingPoint) -> Prediction:
    """The prediction of a loop whose elements all act on one another."""
    balance, found, points, estimates, cycles = _balanced(own, at)
    loop, asked = balance.system, (balance, points, estimates, found)
    with np.errstate(all="ignore"):
        if isinstance(loop, DataSystem):
            told, seen = of_data(loop, balance, points, estimates, cycles)
            excluded = len(seen) == len(cycles) and (bool(seen) or not above_the_data(loop, balance, seen))
            points, cycles, found = told, seen, replace(found, complete=found.complete and excluded)
        if is_one_loop(loop):
            curves = Deferred(partial(nyquist_curves, balance, points, cycles))
        else:
            curves = Deferred(partial(loop_gain_curves, balance, found, points, cycles))

    return Prediction(
        cycles=cycles,
        status=Status.CONVERGED if found.complete else Status.INCOMPLETE,
        search=found.search,
        on_grid=found.on_grid,
        unseen=partial(_unseen, *asked, cycles),
        curves=curves,
        margins={} if isinstance(own, DataSystem) else Deferred(partial(_of_small_signals, own, at)),
        provenance=_made_by(own, at),
        operating_point=at,
    )


def _of_small_signals(own: LureSystem, at: OperatingPoint) -> dict[str, Any]:
    """The margins of the linearised loop; where they cannot be taken, why."""
    loop = replace(own, v0=at.vector(own))
    try:
        return margins(loop).summary()
    except ModelError as refused:
        return Margins(places_of(loop)[0], Status.INCOMPLETE, (), str(refused)).summary()


def why_not_predicted(loop: LureSystem) -> str:
    """Why :func:`predict_limit_cycles` does not take a loop, whatever its numbers lead to; empty where it does."""
    try:
        _require_range(loop)
        seen = without_held_states(loop)
        _require_rates(loop if seen is None else seen.system)
        with np.errstate(all="ignore"):
            for element in loop.elements:
                element.describing_function(1.0)
    except ModelError as refused:
        return str(refused)
    return ""


def predicted_cycles(system: LureSystem | CaseLike, operating_point: PointLike | None = None) -> tuple[LimitCycle, ...]:
    """The cycles of :func:`predict_limit_cycles` alone: without its warnings, which take most of its time.

    Besides, to begin searches from, those that sampled controllers see with fewer than two samples a turn.

    Raises
    ------
    ModelError, EppError
        As :func:`predict_limit_cycles`.
    """
    own, at = standing(system, operating_point, "predict_limit_cycles")
    apart = None if isinstance(own, DataSystem) else elements_apart(own)
    seen = own if apart is None else apart.system
    if parts := _parts(seen, at):
        cycles = (p.to_user(c, seen, state) for p, loop, state in parts for c in _balanced(loop, at, True)[-1])
        return tuple(cycles if apart is None else map(apart.to_user, cycles))
    return _balanced(own, at, True)[-1]


def _parts(own: LureSystem, at: OperatingPoint) -> list[tuple[Subsystem, LureSystem, Array]]:
    """Groups of elements that swing without the others, these at rest or their means, and the state at these."""
    out = []
    for part, others in [] if isinstance(own, DataSystem) else parts_apart(own):
        state, output, stands = np.full(len(own.A), np.nan), np.full(own.B.shape[1], np.nan), True
        for other in others:
            alone = other.of(own, np.zeros(state.size), np.zeros(output.size))
            state[other.states], output[other.outputs], rests = _steady(alone, at)
            # What acts on the group must rest, or the group does not swing alone.
            stands &= rests or not np.any(part.acting & other.elements)
        if stands:
            out.append((part, part.of(own, state, output), np.where(np.isnan(state), own.x0, state)))
    return [] if all(np.all(part.elements) for part, _, _ in out) else out


def _steady(loop: LureSystem, at: OperatingPoint) -> tuple[Array, Array, bool]:
    """Mean state and outputs of a loop, and whether it rests there; not-a-number where they are not known.

    They are those of its first cycle, or at rest where it has none.
    """
    from scipy.optimize import root

    unknown = np.full(len(loop.A), np.nan), np.full(loop.B.shape[1], np.nan), False
    if not all(ports(e) == (1, 1) for e in loop.elements):
        return unknown
    with suppress(ModelError, np.linalg.LinAlgError):
        _, _, points, _, cycles = _balanced(loop, at)
        if cycles:
            return cycles[0].mean_state, points[0].mean, False
        value = at.vector(loop)
        rest = static_balance(loop, value)

        def unbalanced(b: Array) -> Array:
            return rest.on_bias @ b + rest.on_mean @ _means(loop, b) - rest.prescribed

        found = root(unbalanced, np.zeros(len(loop.C)))
        if found.success and not np.any(np.isnan(found.x)):
            mean = _means(loop, found.x)
            return mean_state(loop, value, found.x, mean), mean, True
    return unknown


def _means(loop: LureSystem, bias: Array) -> Array:
    """Outputs of elements with one input and output whose inputs hardly move."""
    return np.array(
        [float(e.describing_function(_STILL, b)[0]) for e, b in zip(loop.elements, bias.tolist(), strict=True)]
    )


def _balanced(
    own: LureSystem, at: OperatingPoint, unseen_by_samples: bool = False
) -> tuple[Balance, Found, list[Point], list[Estimate], tuple[LimitCycle, ...]]:
    """The balance of a loop whose integrators are apart, its search, and the cycles with their error estimates."""
    if (other := without_held_states(own)) is not None:
        balance, found, points, estimates, cycles = _balanced(other.system, at, unseen_by_samples)
        return balance, found, points, estimates, tuple(map(other.to_user, cycles))
    _require_rates(own)
    loop, coordinates = averaged(own).with_integrators_apart
    if not loop.elements:
        raise ModelError(f"{loop.name}: a prediction needs at least one nonlinear element.")
    with np.errstate(all="ignore"):
        balance, found, points = search_balance(loop, at.vector(own))
        if isinstance(loop, AveragedSystem) and not unseen_by_samples:
            points = [p for p in points if loop.takes(p.omega, _outputs(balance, p))]
        estimates = [Estimate(balance, p) for p in points]
        cycles = tuple(_cycle(balance, p, at, e, coordinates) for p, e in zip(points, estimates, strict=True))
        if isinstance(loop, AveragedSystem):
            cycles = tuple(of_samples(loop, c) for c in cycles)
        elif loop.time_step and any(map(jumps, loop.elements)):
            cycles = tuple(locking(c, loop.time_step) for c in cycles)
    return balance, found, points, estimates, cycles


def _require_range(system: LureSystem) -> None:
    """Refuse numbers beyond all range."""
    # Elements meet what B and C make together: units of the states alone may be of any size.
    with np.errstate(over="ignore"):
        together = np.abs(system.C).max(initial=0.0) * system.B
    within_range(system.name, system.A, system.D, together)


def _require_rates(system: LureSystem) -> None:
    """Refuse an element whose describing function takes its inputs for another motion than they have."""
    if system.time_step:
        return
    for name, e, z, w in zip(
        system.element_names, system.elements, system.input_slices, system.output_slices, strict=True
    ):
        if e.reads_rate and role_of_input(system, z.start, z.start + 1) != "rate":
            what = f"{system.name}: the second input of {name} is not the rate of its first"
            raise ModelError(
                what, expected="that rate for the describing function; or a search, a run or the exact orbit"
            )
        if "contact" in e.input_ports:
            c, own = system.C[z.stop - 1], np.eye(1, system.B.shape[1], w.stop - 1)[0]
            drifts = np.abs(c @ system.A).max() / np.abs(system.A).max()
            if max(drifts, np.abs(c @ system.B - own).max()) > _SAME * np.abs(c).max():
                what = f"{system.name}: the contact angle of {name} is not the integral of its contact rate"
                raise ModelError(what, expected="that integral for the describing function")


def search_balance(system: LureSystem, value: Array) -> tuple[Balance, Found, list[Point]]:
    """The DF balance of a loop whose integrators are apart, its search, and the cycles that solve it.

    Parameters
    ----------
    system : LureSystem
        With one element or more.
    value : array
        Its inputs, held.
    """
    single = is_one_loop(system)
    balance = Balance.of(system, 0 if single else choose_pivot(system), value)
    found = search_one(balance) if single else search_several(balance)
    found, cycles = _slowest(system, found)
    points = sorted((point(balance, x) for x in cycles), key=lambda p: float(p.amplitude[0]))
    points = [p for p in points if p.residual < _RESIDUAL and np.all(p.amplitude > 0)]
    return balance, found, [p for p in points if _can_be(balance, p)]


def _can_be(balance: Balance, p: Point) -> bool:
    """Whether each element that its input does not switch gives what one of its modes gives.

    A relay with hysteresis whose input reaches neither threshold stays at one level; its describing function, which
    does not know at which, has the mean of both.
    """
    for i, (a, b) in enumerate(zip(p.amplitude, p.bias, strict=True)):
        own = np.flatnonzero(balance.owner == i)
        if np.any(p.gain[own]) or (held := levels_held(balance, i)) is None:
            continue
        mean = p.mean[own[0]]
        if not any(low <= b - a and b + a <= high and least <= mean <= most for (low, high), (least, most) in held):
            return False
    return True


def _slowest(system: LureSystem, found: Found) -> tuple[Found, Array]:
    """The slowest of the modes that a dead time makes, as many as can be judged, and what is said of the others."""
    if isinstance(system, DataSystem) or not np.any(system.delays) or not len(found.cycles):
        return found, found.cycles
    omega = np.exp(found.cycles[:, 1])
    order = np.argsort(omega, kind="stable")
    # Poles beside a cycle are those of a matrix as large as the phase that the dead time turns.
    work = np.cumsum((omega[order] * system.delays.max()) ** 3)
    kept = order[work <= _MOST_MODES]
    if kept.size == order.size:
        return found, found.cycles
    open_ones = np.sort(omega)[kept.size :] / (2.0 * np.pi)
    text = (
        f" The dead time makes {count(order.size, 'cycle')}: those from {open_ones[0]:.3g} to {open_ones[-1]:.3g} Hz "
        "are open, because the dead time turns their phase so often that their stability takes too long to decide."
    )
    return replace(found, search=found.search + text, complete=False), found.cycles[np.sort(kept)]


@np.errstate(all="ignore")
def _unseen(
    balance: Balance, points: Sequence[Point], estimates: Sequence[Estimate], found: Found, cycles: Sequence[LimitCycle]
) -> tuple[str, ...]:
    """Sentences about what the DF does not see in a loop with these cycles."""
    loop = balance.system
    if isinstance(loop, DataSystem):
        seen = [c for c in cycles if isinstance(c, MeasuredCycle)]
        told = cautions(loop, balance, points, found, seen)
        return (*told, *made_by_harmonics(balance, points, estimates, found), *left_out(loop, cycles))
    sentences = blind_spots(balance, points, estimates, found, stable=any(c.stable for c in cycles))
    return (*sentences, *left_out(loop, cycles))


def _outputs(balance: Balance, p: Point) -> ComplexArray:
    """Phasors of the elements' outputs, the first one's input in sine phase."""
    return np.asarray(p.gain * (p.amplitude * np.exp(1j * (p.phase - p.phase[0])))[balance.owner], complex)


def _cycle(balance: Balance, p: Point, at: OperatingPoint, estimate: Estimate, coordinates: Array) -> LimitCycle:
    """One predicted cycle; `coordinates` bring the state of the balance's loop back to that of the user."""
    system, value = balance.system, at.vector(balance.system)
    W = _outputs(balance, p)
    signals = system.signals
    # Phasors mean Im(P exp(j omega t)) = Re(-j P exp(j omega t)).
    c1 = -1j * (system.signal_response(np.array([p.omega]))[0] @ W)
    x = mean_state(system, value, p.bias, p.mean)
    c0 = signals.C @ x + signals.D @ p.mean + signals.D_input @ value + signals.constant
    if isinstance(system, DataSystem):
        stable, criterion = stability_of_data(system, balance, p)
    else:
        stable, criterion = stability(balance, p)
    period = 2.0 * np.pi / p.omega
    time = np.linspace(0.0, period, 129)
    wave = np.exp(1j * p.omega * time)
    names = signals.names
    response = system.state_response(np.array([p.omega]))[0] @ W
    return LimitCycle(
        method=DESCRIBING_FUNCTION,
        status=Status.CONVERGED,
        period=period,
        mean={n: float(c) for n, c in zip(names, c0, strict=True)},
        peak_to_peak={n: 2.0 * float(abs(c)) for n, c in zip(names, c1, strict=True)},
        harmonics={n: np.array([a, b], complex) for n, a, b in zip(names, c0, c1, strict=True)},
        stable=stable,
        stability_criterion=criterion,
        residual=p.residual,
        error_estimate=partial(getattr, estimate, "error"),
        time=time,
        waveform={n: float(a) + np.real(b * wave) for n, a, b in zip(names, c0, c1, strict=True)},
        state=coordinates @ (x + response.imag),
        memory=tuple(
            e.memory_of((p.mean + W.imag)[ws]) for e, ws in zip(system.elements, system.output_slices, strict=True)
        ),
        units=signals.units_of_results(),
        mean_state=coordinates @ x,
        elements={
            n: {"amplitude": float(a), "bias": float(b), "phase": float(np.angle(np.exp(1j * (q - p.phase[0]))))}
            for n, a, b, q in zip(system.element_names, p.amplitude, p.bias, p.phase, strict=True)
        },
        harmonic_content=partial(getattr, estimate, "content"),
        provenance=_made_by(system, at),
        operating_point=at,
    )


def _made_by(system: LureSystem, at: OperatingPoint) -> Provenance:
    return Provenance(DESCRIBING_FUNCTION, {"system": system.name, "input": dict(at.inputs)}, {"residual": _RESIDUAL})
