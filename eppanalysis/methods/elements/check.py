"""The check of an element: its rules, the energy that it takes up, and its describing function."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.arguments import checked, floats
from eppanalysis.arrays import Array
from eppanalysis.errors import EppError, ModelError
from eppanalysis.methods.elements.result import ElementCheck
from eppanalysis.methods.elements.rules import Rules
from eppanalysis.models.elements.base import Nonlinearity
from eppanalysis.results import Status
from eppanalysis.results.provenance import Provenance

#: Amplitudes that are looked at where none are given: how many, from which share of the least threshold to which
#: multiple of the greatest.
_COUNT, _LEAST, _MOST = 40, 0.5, 20.0


@checked
def check_element(
    element: Nonlinearity,
    amplitudes: ArrayLike | None = None,
    bias: float = 0.0,
    omega: float = 1.0,
    name: str = "",
) -> ElementCheck:
    """Whether the rules of an element are unambiguous, whether it can chatter, what energy it takes up.

    The rules are examined by linear programs over all inputs, rates and memory values, whether a motion reaches them or
    not. The energy is that of a period of a sine at the input, and follows from the describing function.

    Parameters
    ----------
    element : Nonlinearity
        Its automaton is examined; a second input is taken for the rate of the first where the element is an
        `AutomatonElement` without own states, or calls it "rate".
    amplitudes : array_like, optional
        Of the sine, positive [unit of the input]; by default 40 from half the least threshold to twenty times the
        greatest.
    bias : float
        Of the input.
    omega : float
        Frequency [rad/s], on which the energy depends where an element has rates or states.
    name : str
        What the result calls it; by default the name of its class.

    Returns
    -------
    ElementCheck
        With the status INCOMPLETE where guards read smooth outputs, or are too many, there is no describing function,
        or it leaves out linear states that an `AutomatonElement` brings.

    Raises
    ------
    EppError
        If an amplitude or the frequency is not positive.

    Notes
    -----
    With ``x = b + A sin(w t)`` the loop that the output runs through over the input has the area
    ``integral of y dx = pi A^2 Im N``. It is what the element takes up in a period where x is a displacement and y the
    force against it. Where x is a speed, that is ``2 pi/w (A^2 Re N/2 + b mean)``.

    Examples
    --------
    Two guards that both catch an input above one:

    >>> import eppanalysis as epp
    >>> build = epp.AutomatonBuilder()
    >>> free, hard = build.mode("free"), build.mode("hard", from_input=2.0)
    >>> soft = build.mode("soft", from_input=1.0)
    >>> build.guard("catches hard", free, hard, on_input=1.0, constant=-1.0)
    >>> build.guard("catches softly", free, soft, on_input=1.0, constant=-1.0)
    >>> found = epp.check_element(epp.AutomatonElement(build.build()))
    >>> found.deterministic, found.findings[0].guards
    (False, ('catches hard', 'catches softly'))
    """
    if not (np.isfinite(omega) and omega > 0.0):
        raise EppError(f"check_element: omega is {omega!r}; expected a positive number.")
    sizes = _amplitudes(element) if amplitudes is None else np.atleast_1d(floats(amplitudes, "check_element"))
    if sizes.ndim != 1 or not np.all(np.isfinite(sizes) & (sizes > 0.0)):
        raise EppError("check_element: amplitudes are not a list of positive numbers; expected such a list.")
    automaton = element.automaton()
    rules = Rules(automaton, automaton.n_inputs == 2 and element.reads_rate)
    findings = tuple(rules.examine())
    said = [] if rules.complete else [_UNDECIDED]
    if element.by_quadrature and element.own_states is not None:
        said.append(_NOT_EXCITED)
    try:
        described = element.describing_function(sizes, bias, omega)
    except ModelError as error:
        said.append(f"There is no describing function: {error}")
        sizes, described = np.zeros(0), (np.zeros(0), np.zeros(0, complex))
    # Of the first output.
    mean, gain = (np.asarray(part).reshape(sizes.size, -1)[:, 0] if sizes.size else part for part in described)
    if without := int(np.sum(~np.isfinite(gain))):
        said.append(f"{_NOT_ANSWERED} {without} of {sizes.size} amplitudes.")
    # Of y = m + a (Re N sin + Im N cos) and x = bias + a sin: over a period T the
    # integral of y dx is pi a^2 Im N, that of y x dt is T (a^2 Re N/2 + bias m).
    turn = 2.0 * np.pi / omega
    return ElementCheck(
        name or element.called(),
        Status.INCOMPLETE if said else Status.CONVERGED,
        findings,
        sizes,
        np.real(mean),
        np.asarray(gain, complex),
        np.pi * sizes**2 * np.imag(gain),
        turn * (0.5 * sizes**2 * np.real(gain) + bias * mean),
        omega=omega,
        decided=rules.complete,
        message=" ".join(said),
        provenance=Provenance("check_element", {"bias": bias, "omega": omega}),
    )


_UNDECIDED = (
    "It is undecided whether the rules are unambiguous: guards read smooth functions through the output, or are too "
    "many."
)
_NOT_EXCITED = "Its linear states are not excited: describing function and energy are of its automaton alone."
_NOT_ANSWERED = "It does not answer with the period of a sine, or switches without end, at"


def _amplitudes(element: Nonlinearity) -> Array:
    """Amplitudes about the thresholds of an element; about one, where it has none."""
    levels = np.append(element.thresholds(), [] if element.thresholds().size else [1.0])
    return np.asarray(np.geomspace(_LEAST * float(np.min(levels)), _MOST * float(np.max(levels)), _COUNT))
