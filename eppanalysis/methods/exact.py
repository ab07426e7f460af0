"""One exact orbit from an approximate cycle: from a run, from the edge of growth, or by way of harmonic balance."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from eppanalysis.errors import EppError, ModelError
from eppanalysis.methods.edge import orbits_on_edge
from eppanalysis.methods.harmonic import balances_of
from eppanalysis.methods.orbit_cycle import to_limit_cycle
from eppanalysis.methods.orbit_guess import require_autonomous
from eppanalysis.methods.shooting import Orbit, orbits_near
from eppanalysis.methods.stability import is_stable
from eppanalysis.models.hybrid import HybridSystem
from eppanalysis.models.lure import LureSystem, require_system
from eppanalysis.models.signals import Constant
from eppanalysis.models.starts import begun
from eppanalysis.results import LimitCycle, Status

Array = NDArray[np.float64]

#: Relative change of the period within which an orbit belongs to a balance, whatever the balance's own estimate says.
_NEAR = 0.01


def steady_hybrid(system: LureSystem, input_value: Mapping[str, float] | None = None) -> HybridSystem:
    """The hybrid system with its inputs at steady values.

    Raises
    ------
    EppError
        For a discrete-time system.
    ModelError
        If an input is unknown, or what is given names none.
    """
    value = system.input_vector(input_value)
    if system.time_step:
        raise EppError(f"{system.name}: a discrete-time loop has no exact orbits between samples; simulate it instead.")
    steps = zip(system.input_names, (value - system.v0).tolist(), strict=True)
    motions = {name: Constant(step) for name, step in steps if step}
    return require_autonomous(HybridSystem.from_lure(system, motions))


def exact_orbit(system: LureSystem, start: LimitCycle, input_value: Mapping[str, float] | None = None) -> LimitCycle:
    """The exact orbit near an approximate one (a prediction, a balance, or the limit cycle of a run).

    A run from the start gives the sequence of events. A run leaves an unstable cycle, and may be on another one before
    it has come round: for a cycle predicted unstable, the edge between growth and decay is bisected first. Where what
    is found is not of the predicted stability, harmonic balance of rising order is put in between.

    Parameters
    ----------
    system : LureSystem
        In continuous time.
    start : LimitCycle
        With state and period.
    input_value : mapping of str to float, optional
        Steady values of external inputs by name [SI].

    Returns
    -------
    LimitCycle
        With status NOT_CONVERGED, and otherwise as given, when there is no orbit near: none with a period between half
        and 1.6 times the given one.

    Raises
    ------
    EppError
        For a discrete-time system, or a start without a state.
    """
    require_system(system, "exact_orbit")
    hybrid = steady_hybrid(system, input_value)
    if start.state.size != system.A.shape[0]:
        raise EppError(f"{system.name}: the start has no state; expected a predicted cycle, or an exact one.")
    found = [o for o in orbits_of(system, hybrid, start, input_value) if 0.5 < o.period / start.period < 1.6]
    if found:
        return to_limit_cycle(system, found[-1])
    return replace(start, method="exact orbit", status=Status.NOT_CONVERGED, stable=None, residual=float("nan"))


def orbits_of(
    system: LureSystem,
    hybrid: HybridSystem,
    start: LimitCycle,
    input_value: Mapping[str, float] | None = None,
    by_balance: bool = True,
) -> Iterator[Orbit]:
    """Closed orbits that an approximate cycle leads to; the last one is what :func:`exact_orbit` gives."""
    if start.stable is False and "mean_state" in start.provenance:
        x, held = start_of(hybrid, start)
        centre = x.copy()
        centre[: hybrid.n_plant] = start.provenance["mean_state"]
        for orbit in orbits_on_edge(hybrid, x, centre, held, start.period):
            yield orbit
            return
    for orbit in orbits_near(hybrid, *start_of(hybrid, start), start.period):
        yield orbit
        if start.stable is None or is_stable(orbit.multipliers) == start.stable:
            return
        break
    if not by_balance:
        return
    for orbit in orbits_by_balance(system, hybrid, start, input_value):
        yield orbit
        if is_stable(orbit.multipliers) == start.stable:
            return


def orbits_by_balance(
    system: LureSystem, hybrid: HybridSystem, start: LimitCycle, input_value: Mapping[str, float] | None = None
) -> Iterator[Orbit]:
    """Exact orbits that balances of rising order lead to, each within the estimated error of its balance."""
    if not start.harmonics:
        return
    try:
        for balance in balances_of(system, start, input_value):
            for orbit in orbits_near(hybrid, *start_of(hybrid, balance), balance.period):
                if abs(orbit.period / balance.period - 1.0) < max(_NEAR, balance.error_estimate):
                    yield orbit
    except ModelError:  # an element that harmonic balance does not cover
        return


def start_of(hybrid: HybridSystem, cycle: LimitCycle, state: Array | None = None) -> tuple[Array, Array]:
    """State with inputs, and held values, at the begin of a cycle (or at another state with its memory)."""
    start = begun(hybrid, cycle.state if state is None else state, cycle.memory)
    return start.x0, start.H0
