"""What a ladder says of the errors of the DF, and of the cycles that it misses."""

from __future__ import annotations

from eppanalysis.methods.comparison.rungs import largest_harmonic
from eppanalysis.methods.search.result import CycleSearch
from eppanalysis.readable import lasting, signed_percent, words
from eppanalysis.results import LimitCycle


def missed_sentences(missed: tuple[int, ...], search: CycleSearch | None) -> list[str]:
    """How many of the stable exact cycles the DF does not predict."""
    if not missed or search is None:
        return []
    if len(missed) == len(search.stable) == 1:
        return ["The describing function misses the stable limit cycle."]
    return [f"The describing function misses {len(missed)} of {len(search.stable)} stable limit cycles."]


def cycle_sentences(reached: LimitCycle | None, errors: dict[str, dict[str, float]], signal: str) -> list[str]:
    """How often a run oscillates until it repeats itself, and how far the DF is off on its cycle."""
    out = []
    oscillations = largest_harmonic(reached, signal) if reached else 1
    if reached and oscillations > 1:
        period = lasting(reached.period, reached.units)
        out.append(
            f"The run repeats itself only after {oscillations} oscillations of {signal} ({period}); "
            "its frequency is compared oscillation by oscillation."
        )
    return [*out, *error_sentences(errors, signal)]


def error_sentences(errors: dict[str, dict[str, float]], signal: str) -> list[str]:
    """How far the DF is off on the matched cycle."""
    if not errors:
        return []
    f, a = errors["frequency"]["frequency"], errors.get(signal, {}).get("peak_to_peak")
    size = "" if a is None else f" and {signed_percent(a)} in the size of {words(signal)}"
    return [f"The describing function is off by {signed_percent(f)} in frequency{size}."]
