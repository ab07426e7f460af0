"""Periodic orbits that are proved: existence, uniqueness, period and stability of a cycle in ball arithmetic.

Float arithmetic only finds the orbit. What is proved is proved in rationals and balls, in the steps of
`docs/theory/proofs.md`: the modes in rationals (`exact_modes`), the sequence of events in them
(`exact_path`), one solution of the shooting equations (`shooting_balls`), no event earlier (`guard_proof`), and the
discs of the multipliers (`multiplier_discs`).
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eppanalysis.errors import EppError, ModelError, require_packages
from eppanalysis.methods.certificates.numbers import NotCovered
from eppanalysis.methods.certificates.orbits.axes import OwnAxes
from eppanalysis.methods.certificates.orbits.document import document_of
from eppanalysis.methods.certificates.orbits.guards import Violated, prove_arc, require_at_once, starts_of
from eppanalysis.methods.certificates.orbits.modes import rational
from eppanalysis.methods.certificates.orbits.multipliers import discs_of, return_map
from eppanalysis.methods.certificates.orbits.path import Closed, ExactPath
from eppanalysis.methods.certificates.orbits.result import CertifiedOrbit, OrbitStability, Proof
from eppanalysis.methods.certificates.orbits.shooting import Enclosure, Shooting
from eppanalysis.methods.certificates.orbits.timed import (
    Response,
    Sinusoid,
    TimedMotion,
    driven_motion,
    locked_motion,
)
from eppanalysis.methods.certificates.registry import STATEMENTS
from eppanalysis.methods.orbits.exact import exact_orbit, start_of, steady_hybrid
from eppanalysis.methods.orbits.guess import recurrences
from eppanalysis.methods.orbits.orbit import Orbit, solve
from eppanalysis.methods.orbits.shooting import orbits_near
from eppanalysis.methods.simulation.in_samples import InSamples
from eppanalysis.methods.simulation.runs import run_hybrid
from eppanalysis.methods.simulation.states import unobservable_apart
from eppanalysis.models.systems.hybrid import HybridSystem
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.operating import OperatingPoint
from eppanalysis.models.systems.sampled.strobe import is_sampled
from eppanalysis.models.systems.subject import CaseLike, driven_input, facts_of, standing
from eppanalysis.results import EXACT_ORBIT, LimitCycle
from eppanalysis.results.provenance import Provenance

#: Which numbers a proof is about.
NUMBERS = "shortest decimals of up to 14 digits; else the simplest fraction within 2**-50 of the float"
#: Bits of the ball arithmetic, and those for what these do not decide.
PRECISIONS = (128, 256)
#: Difference of periods, relative, above which an orbit is another one.
_SAME_PERIOD = 1e-6
#: Orbits near the start that are looked at.
_TRIED = 4
#: Residual with which an orbit is near enough for Newton's method in balls, and events of a run that looks for one.
_NEARLY_CLOSED, _MOST_EVENTS = 1e-5, 2000


def certify_orbit(
    system: LureSystem | CaseLike, cycle: LimitCycle | Response, input: str | None = None
) -> CertifiedOrbit:
    """Prove that a cycle exists, that it is the only one near, and whether it is stable.

    The proof is in rational and ball arithmetic. Each number of the loop (of its matrices, thresholds, slopes and held
    inputs) is its shortest decimal where that has up to 14 digits; a longer one has been computed in floats and is
    replaced by the simplest fraction within 2**-50 of it: 0.1111111111111111 is 1/9. A sequence of events that closes,
    but at which an element would have switched earlier or otherwise, is refused.

    Parameters
    ----------
    system : LureSystem or Case
        Piecewise affine, without dead time between continuous signals; with sampled controllers, or in discrete time,
        too.
    cycle : LimitCycle or PeriodicResponse
        As `find_limit_cycles`, `exact_orbit` and `forced_response` give it; another cycle (a prediction, a run's) is
        made exact first. Its operating point is where the inputs are held.
    input : str, optional
        Of a response: the driven input; by default that of the case's own sine, or the only one. The angular frequency
        of the sine is one of the numbers of the loop.

    Returns
    -------
    CertifiedOrbit
        Not proved, with the reason, where the proof does not succeed.

    Raises
    ------
    EppError
        For a loop that is not covered: with dead time, with smooth elements, with samples that never come round
        together; for a cycle without a state; and where python-flint is not installed.

    Notes
    -----
    Shooting over the events, Krawczyk's operator for existence and uniqueness (Krawczyk, Computing 4, 1969), Taylor
    polynomials in Bernstein form for the guards, Gershgorin's discs for the multipliers, in the ball arithmetic of Arb
    (Johansson, IEEE Transactions on Computers 66, 2017).

    Examples
    --------
    A relay with hysteresis 0.5 and the plant 1/(s + 1) has the period 2 ln((1 + 0.5)/(1 - 0.5)):

    >>> import eppanalysis as epp
    >>> loop = epp.LureSystem.from_tf(
    ...     ([1.0], [1.0, 1.0]), epp.HysteresisRelay(lower=-0.5, upper=0.5)
    ... )
    >>> orbit = epp.certify_orbit(loop, epp.find_limit_cycles(loop).cycles[0])
    >>> orbit.proved, orbit.stability.name, f"{orbit.period:.9f}"
    (True, 'STABLE', '2.197224577')
    """
    require_packages("certify_orbit", "proof", "flint")
    response, cycle = (None, cycle) if isinstance(cycle, LimitCycle) else (cycle, cycle.cycle)
    loop, at = standing(system, cycle.operating_point, "certify_orbit")
    facts = dict(facts_of(system))
    if response is None and cycle.method != EXACT_ORBIT:
        cycle = exact_orbit(loop, cycle, at)
    cycle.require_state(loop.A.shape[0])
    form = InSamples.at(loop, at) if loop.time_step else None
    if form is not None:
        loop, cycle = form.system, form.from_user(cycle)
    _refuse(loop)
    try:
        sinusoid = None if response is None else Sinusoid.of(response, driven_input(system, input, "certify_orbit"))
        orbit = _closed_of(loop, cycle, response, sinusoid, at)
    except NotCovered as no:
        return CertifiedOrbit(Proof.NOT_DECIDED, str(no), operating_point=at, provenance=_provenance(loop, facts))
    if orbit is None:
        why = "" if unobservable_apart(loop) is None else ", as an unobservable integral goes on"
        reason = f"From the state of the cycle the loop does not return to it after its period{why}."
        return CertifiedOrbit(Proof.NOT_DECIDED, reason, operating_point=at, provenance=_provenance(loop, facts))
    found = certified(orbit, sinusoid)
    state = found.state if form is None or not found.proved else form.state(orbit.y)
    return replace(found, state=state, operating_point=at, provenance=_provenance(loop, facts))


def _closed_of(
    loop: LureSystem, cycle: LimitCycle, response: Response | None, sinusoid: Sinusoid | None, at: OperatingPoint
) -> Orbit | TimedMotion | None:
    """The motion of a cycle, closed in floats; None where it does not close."""
    if response is not None and sinusoid is not None:
        return driven_motion(loop, response, sinusoid, at)
    if is_sampled(loop.elements):
        return locked_motion(loop, cycle, at)
    hybrid = steady_hybrid(loop, at)
    return next((o for o in _closed(hybrid, cycle) if abs(o.period / cycle.period - 1.0) < _SAME_PERIOD), None)


def proof_of_orbit(system: LureSystem | CaseLike, cycle: LimitCycle) -> tuple[CertifiedOrbit | None, str]:
    """The proof of a cycle, or None and why there is none."""
    try:
        found = certify_orbit(system, cycle)
    except EppError as error:
        return None, str(error)
    return found if found.proved else None, found.message


def _closed(hybrid: HybridSystem, cycle: LimitCycle) -> Iterator[Orbit]:
    """Orbits from the state of a cycle: as the engine closes them, then those that it closes but for its rounding.

    In bad coordinates floats do not come nearer; balls of more bits do.
    """
    x, memory = start_of(hybrid, cycle)
    yield from islice(orbits_near(hybrid, x, memory, cycle.period), _TRIED)
    start = replace(hybrid, x0=x, H0=memory)
    run = run_hybrid(start, 2.6 * cycle.period, np.zeros(0), 2.0 * hybrid.time_scale, _MOST_EVENTS, _MOST_EVENTS)
    for guess in recurrences(hybrid, run, (0.5 * cycle.period, 1.6 * cycle.period), _TRIED):
        try:
            orbit = solve(hybrid, guess)
        except ModelError:
            continue
        if orbit.residual < _NEARLY_CLOSED:
            yield orbit


def _provenance(loop: LureSystem, facts: dict[str, Any]) -> Provenance:
    from flint import __version__

    settings = {"system": loop.name, "numbers": NUMBERS}
    return Provenance("certified orbit", settings, statistics={"python-flint": __version__}, case=facts)


def _refuse(loop: LureSystem) -> None:
    """Loops that are not piecewise affine.

    Raises
    ------
    EppError
    """
    covered = "certify_orbit covers piecewise-affine loops without dead time"
    if np.any(loop.delays > 0):
        raise EppError(f"{loop.name} has a dead time of {loop.delays.max():g} s; {covered}.")
    for name, element in zip(loop.element_names, loop.elements, strict=True):
        if element.automaton().smooth:
            raise EppError(f"{loop.name}: {name} is smooth between its switches, not affine; {covered}.")


def certified(orbit: Orbit | TimedMotion, sinusoid: Sinusoid | None = None) -> CertifiedOrbit:
    """What is proved of an orbit with its sequence of events, closed in floats; the sequence is taken as it is.

    Parameters
    ----------
    orbit : Orbit or TimedMotion
        Whether it is a motion of the loop is not taken for granted: its events are proved.
    sinusoid : Sinusoid, optional
        That drives the loop.
    """
    try:
        path = ExactPath.of(orbit)
    except NotCovered as why:
        return CertifiedOrbit(Proof.NOT_DECIDED, str(why))
    unknowns, most = len(path.timed) * (path.m + 1), STATEMENTS["orbit"].functions().UNKNOWNS
    if unknowns > most:
        reason = f"The equations of the cycle have {unknowns} unknowns, of which the checker takes {most} at most."
        return CertifiedOrbit(Proof.NOT_DECIDED, reason, events=_events(path))
    best = CertifiedOrbit(Proof.NOT_DECIDED, events=_events(path))
    for make in (OwnAxes.states, OwnAxes.signals):
        axes = make(path, orbit)
        if axes is None:
            continue
        for bits in PRECISIONS:
            found = _at_precision(orbit, axes, bits, sinusoid)
            best = found if found.proved or not best.proved else best
            if _final(best, path):
                return best
    return best


def _final(found: CertifiedOrbit, path: ExactPath) -> bool:
    """Whether other coordinates or more bits would not tell more."""
    decided = found.stability is not OrbitStability.NOT_DECIDED or path.continuum
    return found.status is Proof.VIOLATED or (found.proved and decided)


def _at_precision(orbit: Closed, axes: OwnAxes, bits: int, sinusoid: Sinusoid | None) -> CertifiedOrbit:
    """What is proved with so many bits."""
    from flint import ctx

    events = _events(axes.path)
    with ctx.workprec(bits):
        try:
            return _proved(orbit, axes, bits, sinusoid)
        except Violated as why:
            return CertifiedOrbit(Proof.VIOLATED, str(why), events=events)
        except NotCovered as why:
            return CertifiedOrbit(Proof.NOT_DECIDED, str(why), events=events)
        except (ZeroDivisionError, OverflowError, ValueError):
            reason = "The balls grow beyond all bounds on the way round the cycle."
            return CertifiedOrbit(Proof.NOT_DECIDED, reason, events=events)


def _events(path: ExactPath) -> tuple[str, ...]:
    return tuple(path.guard_name(int(guard)) for guard in path.course.guards)


def _proved(orbit: Closed, axes: OwnAxes, bits: int, sinusoid: Sinusoid | None) -> CertifiedOrbit:
    """The certificate at a precision; raises where it is not to be had."""
    from flint import arb

    path, shooting = axes.path, Shooting(axes, orbit)
    enclosure = shooting.enclose()
    pieces = _prove_events(path, shooting, enclosure)
    period = sum(enclosure.durations, arb(0))
    made = CertifiedOrbit(
        Proof.PROVED,
        period=float(period),
        period_ball=period.str(bits, radius=True),
        radius=_upward(enclosure.radius),
        unique_within=float(enclosure.unique_within),
        events=_events(path),
        state=orbit.y[: orbit.hybrid.n_plant].copy(),
        n_pieces=pieces,
        evidence=_evidence(orbit, axes, shooting, enclosure, bits),
        document=document_of(path, axes.basis, shooting, enclosure, sinusoid),
    )
    return _with_stability(made, path, shooting, enclosure)


def _upward(value: Any) -> float:
    return float(np.nextafter(float(value), np.inf))


def _prove_events(path: ExactPath, shooting: Shooting, enclosure: Enclosure) -> int:
    """Prove that the events are those of the loop; returns the number of pieces that this took."""
    from flint import arb_mat

    pieces = 0
    for leg, a, start, duration in zip(shooting.legs, path.timed, enclosure.starts, enclosure.durations, strict=True):
        pieces += prove_arc(path, a, start, duration, shooting.columns[: path.m])
        state = arb_mat(path.stages[a].jump) * ((leg.rate * duration).exp() * start)
        after = (a + 1) % len(path.stages)
        while path.stages[after].at_once:
            require_at_once(path, after, starts_of(path, after, state))
            state = arb_mat(path.stages[after].jump) * state
            after = (after + 1) % len(path.stages)
    return pieces


def _with_stability(made: CertifiedOrbit, path: ExactPath, shooting: Shooting, enclosure: Enclosure) -> CertifiedOrbit:
    """The certificate with the discs of the multipliers, and what follows from them."""
    if path.continuum:
        reason = "An element holds a value that no event renews: the cycle is one of many."
        return replace(made, stability_message=reason)
    try:
        discs = discs_of(return_map(shooting, enclosure), shooting.columns[: path.m])
    except (ZeroDivisionError, ValueError, np.linalg.LinAlgError):
        return replace(made, stability_message="The return map has no basis that separates its multipliers.")
    made = replace(
        made,
        multipliers=np.array([d.centre for d in discs], complex),
        multiplier_radii=np.array([d.radius for d in discs], float),
    )
    unsure = [d for d in discs if not (d.inside or d.outside)]
    if unsure:
        shown = f"{abs(unsure[0].centre):.6g} with a radius of {unsure[0].radius:.1g}"
        return replace(made, stability_message=f"The disc of a multiplier of size {shown} meets the unit circle.")
    return replace(made, stability=OrbitStability.of(sum(d.outside for d in discs)))


def _evidence(orbit: Closed, axes: OwnAxes, shooting: Shooting, enclosure: Enclosure, bits: int) -> dict[str, str]:
    """What the proof can be done again from; numbers of the loop as the fractions that were taken."""
    model, course = orbit.hybrid.model, axes.path.course
    tables = {name: _fractions(getattr(model, name)) for name in model._fields if "smooth" not in name}
    middle = [_exactly(v) for start in enclosure.starts for v in start.entries()[: axes.path.m]]
    return {
        "statement": "one closed orbit with these events in the box about 'states' (in 'axes') and 'durations' [s]",
        "numbers": NUMBERS,
        "precision_bits": str(bits),
        "tables": json.dumps(tables),
        "modes": json.dumps(course.modes.tolist()),
        "guards": json.dumps(course.guards.tolist()),
        "at_once": json.dumps(course.at_once.tolist()),
        "unknown_places": json.dumps(list(axes.path.free)),
        "axes": json.dumps([[v.hex() for v in row] for row in axes.basis.tolist()]),
        "held": json.dumps(_fractions(orbit.y)),
        "states": json.dumps(middle),
        "durations": json.dumps([_exactly(t) for t in enclosure.durations]),
        "time_size": float(shooting.columns[axes.path.m]).hex(),
        "radius": repr(_upward(enclosure.radius)),
        "unique_within": repr(float(enclosure.unique_within)),
    }


def _fractions(values: NDArray[Any]) -> Any:
    """Nested lists of the fractions that floats mean, as texts."""
    return [_fractions(v) for v in values] if values.ndim else str(rational(values.item()))


def _exactly(ball: Any) -> str:
    """Middle of a ball, exactly, as ``mantissa*2^exponent``."""
    mantissa, exponent = ball.mid().man_exp()
    return f"{mantissa}*2^{exponent}"
