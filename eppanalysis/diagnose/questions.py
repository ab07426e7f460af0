"""Next questions about what a diagnosis names, each with the command that answers it as it is printed."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from eppanalysis.cases import Case
from eppanalysis.cases.command_line import Commands
from eppanalysis.diagnose.record import Oscillation, waveform
from eppanalysis.diagnose.result import DISTURBANCE, LINEAR, OWN, Explanation
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.subject import CaseLike
from eppanalysis.readable import DIGITS, number, readable, written

#: Points of a period on which a waveform is measured.
_POINTS = 400


def question(
    case: LureSystem | CaseLike, e: Explanation, found: Oscillation, units: Mapping[str, str], size: float
) -> str:
    """Next questions about a candidate that is named; empty where nothing is.

    Parameters
    ----------
    size : float
        Amplitude of a disturbance, as it explains the record [SI].
    """
    commands = Commands.of(case) if isinstance(case, Case) else None
    if e.name == DISTURBANCE:
        return _of_disturbance(commands, e, found, size)
    if e.name == LINEAR:
        command = (commands and commands.command("margins")) or f"epp.margins({'case' if commands else 'loop'})"
        return f"How far the gain is from its limit: {command}"
    if commands is None:
        return ""
    if e.name == OWN:
        return next((f"How far {n} must go for it to end: {q}" for n in commands.over if (q := commands.bounds(n))), "")
    command = commands.bounds(e.parameter, e.over) if e.parameter else ""
    if not command:
        return ""
    if not e.in_proportion:
        return f"How large {e.parameter} may be beside the model's other elements: {command}"
    half = _half(found, units)
    if commands.words:
        command = commands.bounds(e.parameter, e.over, "--allow", half)
    else:
        command = f"{command.removesuffix(')')}, allow={half!r})"
    return f"How large {e.parameter} may be for an oscillation of half the size ({half} peak to peak): {command}"


def _half(found: Oscillation, units: Mapping[str, str]) -> str:
    """Half of the first recorded signal's oscillation, as what is allowed is written."""
    name = found.names[0]
    shape = waveform(found, found.harmonics[0], np.linspace(0.0, found.period, _POINTS))
    unit = units.get(name, "")
    return f"{name} {number(0.5 * readable(unit)[1] * float(np.ptp(shape)), DIGITS - 1)} {written(unit)}".rstrip()


def _of_disturbance(commands: Commands | None, e: Explanation, found: Oscillation, size: float) -> str:
    place = e.note.removeprefix("comes in at ")
    if place == e.note or not np.isfinite(size):  # behind an element, where no command lets a sine come in
        return ""
    rate = found.omega / (2.0 * np.pi)
    sine = (f"{size:.{DIGITS}g}", f"{rate:.{DIGITS}g}")
    command = (
        commands.command("response", "--input", place, "--amplitude", sine[0], "--frequency", sine[1])
        if commands
        else ""
    )
    subject = "case" if commands else "loop"
    command = command or f"epp.forced_response({subject}, {place!r}, amplitude={sine[0]}, frequency={sine[1]})"
    return f"How the loop answers what {e.note}: {command}"
