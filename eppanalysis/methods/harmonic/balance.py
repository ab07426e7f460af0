"""Harmonic balance of any order with bias: one limit cycle from a guess, with an estimate of its own error.

The answers of the elements are exact, so the only approximation is that their inputs are cut off at order n. Order 1
has the equations of the describing function, but for a limited rate, where the error inside is cut off
(docs/theory/rate_limit.md). Sticking has no place in a balance, as the force at rest is not a function of the
element's input: where an element would stick (friction at rest, a relay that slides) it passes at once from one side
to the other, as ``sgn`` does; orbits with long sticking need many orders, or the exact orbit. In discrete time the
balance is that of the invariant curve of the samples where the period is not commensurate with the sample time.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from eppanalysis.arrays import ComplexArray
from eppanalysis.errors import EppError, ModelError
from eppanalysis.methods.harmonic.averaged import LEFT_OUT, of_samples
from eppanalysis.methods.harmonic.elements import Regime, Unsettled
from eppanalysis.methods.harmonic.loop import Equations, Loop, inputs_of, order_one
from eppanalysis.methods.harmonic.newton import Iterate, newton
from eppanalysis.methods.harmonic.series import TURN, anchored, extrema, orders, sampled
from eppanalysis.methods.simulation.states import without_held_states
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.means import mean_state
from eppanalysis.models.systems.measured.loop import DataSystem, MeasuredLoop
from eppanalysis.models.systems.operating import OperatingPoint
from eppanalysis.models.systems.sampled.averaged import AveragedSystem, averaged
from eppanalysis.models.systems.subject import CaseLike, PointLike, standing
from eppanalysis.results import HARMONIC_BALANCE, Event, LimitCycle, Status
from eppanalysis.results.provenance import Provenance

#: Orders tried in turn, and the estimated relative error at which they end.
AUTOMATIC = (1, 3, 5, 9, 15, 25, 41, 65)
TOLERANCE = 1e-4
_MOST_SHARES = 8
_SEEDS, _HIGHEST_SEED = 1 / 3, 25  # and below which it may lead to an exact orbit, up to this order
#: Estimate below which a balance need not be compared with a yet higher order, and the highest that low ones are.
_FINE, _MOST_COMPARED = 1e-6, 65
#: Of a distance between orders, and of the estimate at the higher one, what is added for what is beyond it: where the
#: harmonics fall slowly, the estimate is up to three times too small.
_MARGIN, _REST = 0.1, 3.0
_NONE = np.zeros(0)
_TRUSTED = 0.05  # estimated error below which a balance of the highest order counts as the cycle's


def harmonic_balance(
    system: LureSystem | CaseLike | MeasuredLoop,
    guess: LimitCycle,
    order: int | None = None,
    operating_point: PointLike | None = None,
) -> LimitCycle:
    """Refine a limit cycle by harmonic balance with bias.

    Parameters
    ----------
    system : LureSystem, Case or MeasuredLoop
        With any elements, memory included. Measured data must reach the harmonics of the order, and have a static gain
        where the cycle has a mean.
    guess : LimitCycle
        From :func:`~eppanalysis.predict_limit_cycles`, a simulation or another balance;
        period and harmonics of its named signals are used.
    order : int, optional
        Highest harmonic. By default the order rises (1, 3, 5, 9, ...) until the estimated error is below 1e-4.
    operating_point : OperatingPoint or mapping of str to float, optional
        Where the external inputs are held, or some of them by name [SI]; by default that of the case or loop.

    Returns
    -------
    LimitCycle
        Of the given order, or of the one that the neglected harmonics change least. Status NOT_CONVERGED where Newton's
        iteration fails at the given order (the last iterate is returned), or, where no order is given, where they
        change the answer of each by more than 5 % or higher orders do not settle. ``error_estimate`` is the relative
        error of frequency and fundamentals, from balances of higher orders; it is not-a-number where those do not
        settle, and `note` says why: an exact orbit need not be near then. ``provenance.statistics["orders"]`` lists the
        orders tried, with the change that the neglected harmonics cause to the describing function's cycle.

    Raises
    ------
    ModelError
        If an element cannot take part, an input is unknown, or the static balance does not determine the means.
    EppError
        If `order` is not a positive integer, or an input is not constant.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> loop = epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Relay())
    >>> guess = epp.predict_limit_cycles(loop)[0]
    >>> orders = [epp.harmonic_balance(loop, guess, order=n) for n in (1, 3, 9, 27)]
    >>> [round(found.period, 4) for found in orders]
    [4.4429, 4.5292, 4.5494, 4.551]
    """
    own, at = standing(system, operating_point, "harmonic_balance")
    if (other := without_held_states(own)) is not None:
        return other.to_user(harmonic_balance(other.system, other.from_user(guess), order, at))
    system = averaged(own)
    if order is not None and (int(order) != order or order < 1):
        raise EppError(f"harmonic_balance: order is {order}; expected a positive integer or None.")
    with np.errstate(all="ignore"):
        loop, start = _begin(system, guess, at)
        if order is not None and order > loop.highest(guess.omega):
            most = loop.highest(guess.omega)
            ends = "the end of the data" if isinstance(system, DataSystem) else "half the sample rate"
            raise EppError(f"harmonic_balance: order is {order}; expected at most {most} ({ends}).")
        found, log = _fixed(loop, start, int(order)) if order is not None else _automatic(loop, start)
        if found.converged:
            found = _compared(loop, found)
        if order is None:  # an order that was not given has to settle (docs/theory/harmonic_balance.md)
            found = replace(found, converged=found.converged and bool(np.isfinite(found.error)))
        try:
            cycle = replace(_cycle(system, loop, found, log), operating_point=at)
            if isinstance(system, AveragedSystem | DataSystem) and system.slowest:
                cycle = replace(of_samples(system, cycle), note=f"{cycle.note} {LEFT_OUT}".strip())
            return replace(cycle, state=_NONE, mean_state=_NONE) if isinstance(system, DataSystem) else cycle
        except Unsettled:
            method = f"{HARMONIC_BALANCE}, order {found.order}"
            return replace(guess, method=method, status=Status.NOT_CONVERGED, operating_point=at)


def balances_of(system: LureSystem, guess: LimitCycle, at: OperatingPoint) -> Iterator[LimitCycle]:
    """Balances of rising order that may be trusted a little, as starts for an exact orbit; until one order fails.

    Yields
    ------
    LimitCycle
        Converged, with an estimated error below a third.

    Raises
    ------
    ModelError
        As :func:`harmonic_balance`.
    """
    with np.errstate(all="ignore"):
        loop, start = _begin(system, guess, at)
        for point in _rising(loop, start, _HIGHEST_SEED):
            if not point.converged and point.order > 1:
                return
            if point.converged and point.error < _SEEDS:
                try:
                    yield _cycle(system, loop, point, [])
                except Unsettled:
                    continue


def _begin(system: LureSystem, guess: LimitCycle, at: OperatingPoint) -> tuple[Loop, _Point]:
    """The loop with its inputs at their values, and the guess as its start."""
    loop = Loop.of(system, at.vector(system))
    return loop, _anchored(inputs_of(loop, guess), guess.omega)


def settled(loop: Loop, Z: ComplexArray, omega: float) -> tuple[ComplexArray, float] | None:
    """Newton's method from inputs (F, n + 1) and a frequency that nearly balance; None where it fails.

    Parameters
    ----------
    Z : array, shape (F, n + 1)
        Coefficients of the elements' free inputs, of the order that is wanted.
    omega : float
        [rad/s].
    """
    with np.errstate(all="ignore"):
        start = _anchored(Z, omega)
        found = _solve(loop, start, start.order, estimate=False)
    return (found.Z, found.omega) if found.converged else None


def cycle_of(loop: Loop, Z: ComplexArray, omega: float) -> LimitCycle:
    """The limit cycle with balanced inputs (F, n + 1) of the elements, as from :func:`settled`."""
    with np.errstate(all="ignore"):
        point = replace(_anchored(Z, omega), converged=True)
        return _cycle(loop.system, loop, point, [point])


@dataclass(frozen=True, eq=False)
class _Point:
    """A solution (or the last iterate): free inputs (F, n + 1), omega, and how good it is."""

    Z: ComplexArray
    omega: float
    pivot: int
    converged: bool
    residual: float = float("nan")
    error: float = float("nan")
    iterations: int = 0
    note: str = ""

    @property
    def order(self) -> int:
        return self.Z.shape[1] - 1


def _anchored(Z: ComplexArray, omega: float) -> _Point:
    """The same motion, with the phase in which it is compared."""
    if not np.any(np.abs(Z[:, 1]) > 0):
        raise ModelError("harmonic_balance: the guess does not oscillate at the input of any element.")
    turned, pivot = anchored(Z)
    return _Point(turned, omega, pivot, False)


def _fixed(loop: Loop, start: _Point, order: int) -> tuple[_Point, list[_Point]]:
    """The wanted order: directly, else by way of the orders between."""
    found = _solve(loop, start, order)
    if found.converged:
        return found, [found]
    last, log = start, []
    for n in [*(n for n in AUTOMATIC if n < order), order]:
        step = _reach(loop, last, n)
        log.append(step)
        if not step.converged and len(log) > 1 and not log[-2].converged:
            break
        last = step if step.converged else last
    return (log[-1] if log[-1].order == order else found), log


def _automatic(loop: Loop, start: _Point) -> tuple[_Point, list[_Point]]:
    """Rising orders until the estimated error is small, or two of them fail."""
    log = list(_rising(loop, start, max(AUTOMATIC)))
    if log[-1].error < TOLERANCE:
        return log[-1], log
    good = [p for p in log if p.converged]
    if not good:
        return log[-1], log
    best = min(good, key=lambda p: p.error if np.isfinite(p.error) else np.inf)
    return replace(best, converged=best.error < _TRUSTED), log


def _compared(loop: Loop, point: _Point) -> _Point:
    """The balance with an error that is measured: by how far it is from balances of higher orders.

    Higher orders are solved until what is left of the error, as estimated there, is small beside the distance, and one
    more confirms it: it lies within what was said to be left. The change by the neglected harmonics alone (see
    :func:`_error`) does not see that they move switches far, add some, or lead elsewhere, and one higher order may be
    near by chance. Where no further one converges it counts alone.
    """
    better, distance, settled, alone = point, 0.0, False, False
    for order in _higher(point.order, loop.highest(point.omega)):
        trial = _solve(loop, better, order)
        if not trial.converged:
            trial = _solve(loop, better, (better.order + order) // 2)
        if not trial.converged:
            alone = settled = True
            break
        confirmed = better is not point and _distance(better, trial) <= _left(better, distance)
        better, distance = trial, _distance(point, trial)
        settled = confirmed or better.error < _FINE
        if settled and _is_reportable(better, distance):
            break
    if better is point:
        return _unknown(point, "No balance of a higher order, with which it would be compared, converges.")
    if not (settled and _is_reportable(better, distance)):
        return _unknown(point, f"Balances up to order {better.order} do not settle; no exact orbit need be near.")
    error = distance + _left(better, distance)
    if not _switches_alike(loop, point, error):
        return _unknown(point, "Elements switch otherwise in a period within its error; no exact orbit need be near.")
    note = f"Its error is that against order {better.order} alone: no higher one converges." if alone else point.note
    return replace(point, error=error, note=note)


def _switches_alike(loop: Loop, point: _Point, error: float) -> bool:
    """Whether the elements switch alike where the period is shorter and longer by its error: some measure time."""

    def switches(omega: float) -> list[set[tuple[int, int]]]:
        _, regimes = loop.answers(point.Z, omega)
        return [{(s.mode, id(s.mode_guard.guard)) for s in regime.switches} for regime in regimes]

    try:
        as_found = switches(point.omega)
        return all(switches(point.omega * (1.0 + change)) == as_found for change in (-error, error))
    except Unsettled:
        return False


def _left(better: _Point, distance: float) -> float:
    """What is left of an error at a higher order that is so far away."""
    return _MARGIN * distance + _REST * better.error


def _is_reportable(better: _Point, distance: float) -> bool:
    """Whether a balance so far from a higher order is known well enough to have an error."""
    return better.error < _TRUSTED and distance + _left(better, distance) < _SEEDS


def _unknown(point: _Point, why: str) -> _Point:
    return replace(point, error=float("nan"), note=why)


def _higher(order: int, highest: int) -> list[int]:
    """Orders with which one is compared; two at least, so that the last can confirm what the first says."""
    most = min(max(_MOST_COMPARED, order + order // 2), highest)
    wanted = {min(n, most) for n in (2 * order + 7, 3 * order + 14, 4 * order + 21)}
    return sorted(n for n in (wanted if len(wanted) > 1 else {(order + most) // 2, most}) if n > order)


def _distance(point: _Point, other: _Point) -> float:
    """Largest relative difference of frequency and fundamentals."""
    change = np.abs(other.Z[:, 1] - point.Z[:, 1]) / np.abs(other.Z[:, 1]).clip(1e-300)
    return float(max(change.max(), abs(point.omega / other.omega - 1.0)))


def _rising(loop: Loop, start: _Point, highest: int) -> Iterator[_Point]:
    """One order after the other, each from the last one that converged."""
    last, trusted, failed = start, False, False
    for n in (n for n in AUTOMATIC if n <= min(highest, loop.highest(start.omega))):
        found = _solve(loop, last, n) if trusted else _reach(loop, last, n)
        yield found
        if found.error < TOLERANCE or (not found.converged and (trusted or last is start or failed)):
            return
        failed, trusted = not found.converged, trusted or found.error < _TRUSTED
        last = found if found.converged else last


def _reach(loop: Loop, start: _Point, order: int) -> _Point:
    """Solve at an order, if need be by letting the new harmonics in step by step."""
    found = _solve(loop, start, order)
    if found.converged or start.order >= order or not start.converged:
        return found
    share, width, point = 0.0, 0.5, start
    for _ in range(_MOST_SHARES):
        trial = _solve(loop, point, order, min(1.0, share + width), start.order)
        if trial.converged and share + width >= 1.0:
            return trial
        if trial.converged:
            share, point, width = share + width, trial, 2 * width
        else:
            width /= 4
    return found


def _solve(loop: Loop, start: _Point, order: int, share: float = 1.0, kept: int = 0, estimate: bool = True) -> _Point:
    """Damped Newton at an order; harmonics above `kept` pass the linear part with the factor `share`.

    Without `estimate` the point does not say how good it is.
    """
    # A share of zero is the balance of the lower order, one of the higher: a way from one to the other
    # (docs/theory/harmonic_balance.md, Error estimate and choice of the order).
    weight = np.where(orders(order)[1:] > kept, share, 1.0) if share < 1.0 else np.ones(order)
    equations = Equations(loop, order, start.pivot, weight)
    try:
        X = equations.pack(loop.continued(start.Z, start.omega, order), start.omega)
        last, ok, count = newton(equations, X, descend=True)
        if not ok:
            last, ok, more = newton(equations, X, descend=False)
            count += more
        Z, omega = equations.unpack(last.X)
        ok &= bool(np.abs(Z[start.pivot, 1]) > 1e-6 * np.abs(start.Z[start.pivot, 1]) and omega > 0)
        error = _error(loop, equations, last) if ok and share == 1.0 and estimate else float("nan")
    except Unsettled:
        Z = np.pad(start.Z[:, : order + 1], ((0, 0), (0, max(0, order - start.order))))
        return _Point(Z, start.omega, start.pivot, False)
    return _Point(Z, omega, start.pivot, ok, last.residual, error, count)


def _error(loop: Loop, equations: Equations, last: Iterate) -> float:
    """Relative change of omega and fundamentals by the neglected harmonics, to first order.

    The inputs get the harmonics n + 1 .. 3 n + 8 that the linear part makes of the outputs; what this changes in the
    equations of order n is a disturbance of the linearised balance.
    """
    n = equations.n
    Z, omega = equations.unpack(last.X)
    most = max(n, min(3 * n + 8, loop.highest(omega)))
    longer = loop.continued(Z, omega, most, min(2, len(loop.elements)))
    W, _ = loop.outputs(longer, omega)
    R = equations.residual(Z, W[:, : n + 1], loop.linear(omega, n)) / last.rows
    change = last.unknowns * last.solve(R)
    moved, _ = equations.unpack(np.append(change[:-1], 0.0))
    relative = np.abs(moved[:, 1]) / np.abs(Z[:, 1]).clip(1e-300)
    return float(max(relative.max(), abs(change[-1]) / omega))


def _cycle(system: LureSystem, loop: Loop, point: _Point, log: list[_Point]) -> LimitCycle:
    n, omega, Z = point.order, point.omega, point.Z
    W, regimes = loop.answers(Z, omega)
    signals = system.signals
    # Means by the static balance, harmonics by responses: at zero frequency an integrator has none.
    x = mean_state(loop.system, loop.value, Z[:, 0].real, W[:, 0].real)
    at = omega * orders(n)[1:]
    c = np.zeros((len(signals.names), n + 1), complex)
    c[:, 0] = signals.C @ x + signals.D @ W[:, 0].real + signals.D_input @ loop.value + signals.constant
    c[:, 1:] = (system.signal_response(at) @ W.T[1:, :, None])[..., 0].T
    states = (system.state_response(at) @ W.T[1:, :, None])[..., 0].sum(0).real
    names, period = signals.names, TURN / omega
    heights = [float(v.max() - v.min()) if v.size else 0.0 for _, v in extrema(c)]
    count = max(128, 16 * n)
    wave = np.pad(sampled(c, count), [(0, 0), (0, 1)], mode="wrap")
    return LimitCycle(
        method=f"{HARMONIC_BALANCE}, order {n}",
        status=Status.CONVERGED if point.converged else Status.NOT_CONVERGED,
        period=period,
        mean={k: float(m.real) for k, m in zip(names, c[:, 0], strict=True)},
        peak_to_peak=dict(zip(names, heights, strict=True)),
        harmonics=dict(zip(names, c, strict=True)),
        residual=point.residual,
        error_estimate=point.error,
        events=_events(system, loop, regimes, omega),
        time=np.linspace(0.0, period, count + 1),
        waveform=dict(zip(names, wave, strict=True)),
        state=x + states,
        memory=tuple(r.stored_at_zero for r in regimes),
        units=signals.units_of_results(),
        mean_state=x,
        note=" ".join(filter(None, (point.note, order_one(system, n)))),
        provenance=Provenance(
            "harmonic balance",
            {"system": system.name, "input": dict(zip(system.input_names, loop.value.tolist(), strict=True))},
            statistics={"order": n, "iterations": point.iterations, "orders": [_entry(p) for p in log]},
        ),
    )


def _entry(p: _Point) -> dict[str, Any]:
    return {
        "order": p.order,
        "converged": p.converged,
        "period": TURN / p.omega,
        "error_estimate": p.error,
        "iterations": p.iterations,
    }


def _events(system: LureSystem, loop: Loop, regimes: tuple[Regime, ...], omega: float) -> tuple[Event, ...]:
    """Switches of all elements within one period, in order."""
    out = []
    for name, e, regime in zip(system.element_names, loop.elements, regimes, strict=True):
        for s in regime.switches:
            out.append(Event(s.phase % TURN / omega, name, s.mode_guard.guard.name, e.automaton.modes[s.mode].name))
    return tuple(sorted(out, key=lambda event: event.time))
