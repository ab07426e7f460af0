"""How often intervals of predictions from noisy data cover what the model predicts, for each loop that ships.

The linear part of a loop gives 200 points a decade, each with 1 % of noise. Run it:
``python -m studies.measured_coverage``, with names of cases for some. All take half an hour, so that the result
is kept in ``_static/measured_coverage.csv``.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import count, islice

import numpy as np

import eppanalysis as epp
from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.methods.describing.balance import Balance, newton
from eppanalysis.methods.describing.data.intervals import IS_ONE, Noise
from eppanalysis.methods.describing.predict import search_balance
from eppanalysis.models.elements.base import Nonlinearity
from eppanalysis.models.systems.means import static_balance
from eppanalysis.models.systems.measured.between import columns_of, measured_of
from eppanalysis.models.systems.measured.loop import Means
from eppanalysis.models.systems.own_states import ports
from eppanalysis.models.systems.signals import slices
from eppanalysis.results import PlainData
from studies import STORED
from studies.stored_tables import read_rows, write_rows

__all__ = ["CASES", "Covered", "coverage", "coverages", "of_case", "read", "table"]

RESULT = STORED / "measured_coverage.csv"
#: The loops that ship that have a cycle of first order, without those that differ from another in nothing here.
CASES = (
    "actuator_both_limits", "backlash_discrete_pi", "backlash_discrete_pi_kp02_ki02", "backlash_discrete_pi_kp05_ki01",
    "backlash_discrete_pi_kp05_ki02", "backlash_servo", "band_two_cycles", "buck_converter", "clegg_loop", "elbow",
    "elbow_cycle_not_there", "fig6a_original_pulley", "fig8a_original", "freeplay_section", "gain_brings_it_back",
    "level_valve", "light_forearm", "parking_stops_it", "quantised_sensor_ct", "quantised_sensor_ct_large",
    "rate_limited_aircraft", "relay_biased_fopdt", "relay_deadzone", "relay_fopdt_closed", "relay_hyst_goncalves6",
    "relay_hyst_servo", "relay_ideal_khalil79", "robot_servo", "sat_am165", "sat_asymmetric", "sat_khalil710",
    "sat_plus_backlash", "sat_pycontrol_doc", "steering_compensated", "stiction_level_S5J2", "thruster_dz_hyst",
    "two_mass_damped_shaft", "two_mass_damped_shaft_classical", "two_mass_deadzone", "van_der_pol_mu1",
    "virtual_spring", "wheelchair", "x15_flare",
)  # fmt: skip
#: Points a decade, their standard deviation, and draws of them.
PER_DECADE, DEVIATION, DRAWS = 200, 0.01, 200
#: How far Newton's method goes to a cycle at most, in logarithms; beyond, the motion counts that is refused least.
_SAME = 0.25
#: Of the first case's draws; each further one has the next.
_SEED = 2027


@dataclass(frozen=True)
class Covered(PlainData):
    """One cycle of one loop.

    Attributes
    ----------
    case : str
    amplitude, frequency : float
        Of the model: at the first element's input, and in Hz.
    draws, with_amplitude, with_frequency : int
        Draws of the data, and those whose interval covers it.
    gone, at_a_fold : int
        Draws whose own curve has not the cycle, and those that say that it may not exist, these among them.
    """

    case: str
    amplitude: float
    frequency: float
    draws: int
    with_amplitude: int
    with_frequency: int
    gone: int
    at_a_fold: int


def of_case(
    name: str,
    per_decade: int = PER_DECADE,
    noise: np.random.Generator | None = None,
    deviation: float | None = None,
    top: float = 60.0,
) -> epp.MeasuredLoop:
    """A shipped loop with data in place of its linear part, and its balance of means.

    From a thirtieth of its slowest cycle's frequency to `top` times that of its fastest.
    """
    elements, omega, G, means, unstable = _without_noise(name, per_decade, top)
    none = np.abs(G).max(0) < 1e-13 * np.abs(G).max()
    if noise is not None:
        G = G * (1.0 + DEVIATION * (noise.standard_normal(G.shape) + 1j * noise.standard_normal(G.shape)))

    def path(i: int, j: int) -> epp.MeasuredResponse | None:
        if none[i, j]:
            return None
        return epp.MeasuredResponse(omega, G[:, i, j], deviation, unstable_poles=unstable)

    paths = [[path(i, j) for j in range(G.shape[2])] for i in range(G.shape[1])]
    return epp.MeasuredLoop(epp.MeasuredMatrix(paths), elements, feedback=1, means=means)


@cache
def _without_noise(
    name: str, per_decade: int, top: float
) -> tuple[tuple[Nonlinearity, ...], Array, ComplexArray, Means | None, int]:
    """Elements, frequencies, responses, the balance of means where it is known, unstable poles."""
    case = epp.case(name)
    system, known = case.to_system(), epp.predict_limit_cycles(case)
    given = system.given or system
    grows = np.linalg.eigvals(given.A)
    sizes = [c.omega for c in known] or list(np.abs(grows)[np.abs(grows) > 1e-6 * np.abs(grows).max()])
    low, high = min(sizes) / 30.0, top * max(sizes)
    if given.time_step:
        high = min(high, np.pi / given.time_step)
    omega = np.geomspace(low, high, int(per_decade * np.log10(high / low)) + 1)
    sides = [[ports(e)[k] for e in given.elements] for k in (0, 1)] if system.given else None
    before, behind = map(slices, sides) if sides else (system.input_slices, system.output_slices)
    rows = [z.start + i for e, z in zip(given.elements, before, strict=True) for i in measured_of(e)]
    columns = [w.start + j for e, w in zip(given.elements, behind, strict=True) for j in range(columns_of(e))]
    G = given.frequency_response(omega)[:, rows][..., columns]
    unstable = int(np.sum(np.abs(grows) > 1.0 + 1e-9 if given.time_step else grows.real > 1e-9 * np.abs(grows)))
    return given.elements, omega, G, _means(system, case, columns), unstable


def _means(system: epp.LureSystem, case: epp.Case, columns: list[int]) -> Means | None:
    """The balance of means between what is measured; None if an element has states of its own."""
    if system.given is not None:
        return None
    apart = system.with_integrators_apart[0]
    sampled = [isinstance(e, epp.SampledController) for e in apart.elements]
    clocks = [z.stop - 1 for z, clock in zip(apart.input_slices, sampled, strict=True) if clock]
    kept = np.setdiff1d(np.arange(len(apart.C)), clocks)
    # A controller's laws of its means are its own: here it is any element of one input and one output.
    plain = replace(
        apart,
        elements=tuple(epp.Saturation() if e else own for e, own in zip(sampled, apart.elements, strict=True)),
        cuts=None,
        **{part: getattr(apart, part)[kept] for part in ("C", "D", "D_input", "constant_input")},
    )
    on_bias, on_mean, prescribed = static_balance(plain, case.operating_point.vector(system))[1:]
    return on_bias, on_mean[:, columns], prescribed


def coverage(name: str, draws: int = DRAWS, seed: int = 3) -> tuple[Covered, ...]:
    """Each cycle of a loop, followed from the data without noise to each draw.

    Where a draw has it not nearby, the interval is that of the motion that the draw refuses least, from the cycle on.
    """
    return next(islice(coverages(name, seed), draws - 1, None))


def coverages(name: str, seed: int) -> Iterator[tuple[Covered, ...]]:
    """:func:`coverage` after each further draw."""
    system = of_case(name).to_system()
    balance, found, points = search_balance(system, np.zeros(0))
    start, rng = found.cycles[np.argsort(found.cycles[:, balance.places[0]])], np.random.default_rng(seed)
    told = sorted(points, key=lambda p: float(p.amplitude[0]))
    counts = np.zeros((len(start), 4), int)
    for draws in count(1):
        with np.errstate(all="ignore"):
            drawn = of_case(name, noise=rng, deviation=DEVIATION).to_system()
            here = Balance.of(drawn, balance.pivot, np.zeros(0))
            counts += np.array([_covers(Noise(here, drawn), x) for x in start])
        yield tuple(
            Covered(name, float(p.amplitude[0]), p.omega / (2.0 * np.pi), draws, *map(int, n))
            for p, n in zip(told, counts, strict=True)
        )


def _covers(noise: Noise, truth: Array) -> tuple[bool, bool, bool, bool]:
    """Whether amplitude and frequency are covered, the cycle is gone, and it is said that it may not exist."""
    balance = noise.balance
    (x,), (ok,) = newton(balance, truth[None], np.eye(len(truth))[-1:])
    there = bool(ok) and np.abs(x - truth)[:2].max() < _SAME
    if not there:
        (x,), (off,) = noise.least_refused([truth])
        there = off <= IS_ONE
    interval = noise.interval(x, at_a_fold=not there)
    values = np.exp(truth[[balance.places[0], 1]])
    within = [bool(a <= v <= b) for v, (a, b) in zip(values, (interval.amplitude, interval.omega), strict=True)]
    return within[0], within[1], not there, interval.at_a_fold


def read() -> list[Covered]:
    """The stored rows."""
    return read_rows(Covered, RESULT)


def table(rows: Sequence[Covered]) -> str:
    """The cycles in Markdown."""
    lines = [
        "| loop | amplitude | frequency [Hz] | amplitude covered | frequency covered | not in the draw | doubt said |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for r in rows:
        shares = (r.with_amplitude, r.with_frequency, r.gone, r.at_a_fold)
        told = " | ".join(f"{100.0 * n / r.draws:.3g} %" for n in shares)
        lines.append(f"| {r.case} | {r.amplitude:.4g} | {r.frequency:.4g} | {told} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    made: list[Covered] = []
    for case in sys.argv[1:] or CASES:
        made += (rows := coverage(case, seed=_SEED + CASES.index(case)))
        sys.stdout.write("\n".join(table(rows).splitlines()[2:]) + "\n")
        sys.stdout.flush()
    if not sys.argv[1:]:
        write_rows(made, Covered, RESULT, __file__)
