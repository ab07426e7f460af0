"""Higher-order sinusoidal-input describing functions: every harmonic of an element's answer to a sine."""

from __future__ import annotations

import numpy as np

from eppanalysis.arguments import check_counts
from eppanalysis.arrays import ComplexArray
from eppanalysis.errors import EppError, ModelError
from eppanalysis.methods.harmonic.coefficients import respond
from eppanalysis.methods.harmonic.elements import PeriodicElement, Unsettled
from eppanalysis.models.elements.base import Nonlinearity


def sinusoidal_harmonics(
    element: Nonlinearity, amplitude: float, bias: float = 0.0, omega: float = 1.0, order: int = 9
) -> ComplexArray:
    """Harmonics of an element's settled output for ``x = bias + amplitude * sin(omega t)``, relative to the amplitude.

    The output is ``mean + sum over k of Im(H[k] * amplitude * exp(j k omega t))``; H[1] is the describing function.

    Parameters
    ----------
    element : Nonlinearity
        With one input, or a second one that it declares to be the rate of the first (lock pin) or a clock, which is
        zero at phase zero (parking law).
    amplitude : float
        Of the sine, positive, in the unit of the input.
    bias : float
        Its mean.
    omega : float
        Angular frequency [rad/s], for elements whose answer depends on it.
    order : int
        Highest harmonic.

    Returns
    -------
    complex array, shape (n_outputs, order + 1)
        H[:, 0] is the mean of the output over the amplitude, real.

    Raises
    ------
    ModelError
        If the amplitude or omega is not positive, if harmonic balance does not cover the element, or if it has states
        of its own, as a rate limiter has: :func:`~eppanalysis.forced_response` closes the motion of it alone.
    EppError
        If the element does not answer with the period of its input.

    References
    ----------
    Nuij, Bosgra and Steinbuch, "Higher-order sinusoidal input describing functions for the analysis of non-linear
    systems with harmonic responses", Mechanical Systems and Signal Processing 20, 2006.

    Examples
    --------
    >>> import numpy as np
    >>> import eppanalysis as epp
    >>> H = epp.sinusoidal_harmonics(epp.Relay(), amplitude=2.0, order=3)
    >>> (0.25 * np.pi * 2.0 * H[0].real).round(6).tolist()
    [0.0, 1.0, 0.0, 0.333333]
    """
    check_counts("sinusoidal_harmonics", {"order": (order, 1)})
    for name, value in (("amplitude", amplitude), ("omega", omega)):
        if not (np.isfinite(value) and value > 0):
            raise ModelError("sinusoidal_harmonics", value, "a positive number", field=name)
    if (known := element.harmonics(amplitude, bias, omega, order)) is not None:
        if not np.all(np.isfinite(known)):
            raise EppError(f"sinusoidal_harmonics: the mean of {type(element).__name__} grows without bound.")
        return known
    if element.own_states is not None:
        raise ModelError(
            f"sinusoidal_harmonics: {type(element).__name__} has states of its own",
            expected="an element without; forced_response closes its motion where it is a loop's only part",
        )
    second = "rate" if element.reads_rate else "clock" if element.input_ports[1:] == ("clock",) else ""
    roles = ("free", second)[: element.n_inputs]
    if len(roles) < element.n_inputs or not all(roles):
        what = f"{type(element).__name__} has {element.n_inputs} inputs"
        raise ModelError(what, expected="one, or it and its rate or a clock")
    series = np.zeros((1, order + 1), complex)
    series[0, 0], series[0, 1] = bias, -1j * amplitude
    # Coefficients of real parts become those of imaginary parts; the mean is what it is.
    try:
        found = respond(PeriodicElement.of(element, roles), series, omega).coefficients / amplitude
    except Unsettled as reason:
        raise EppError(f"sinusoidal_harmonics: {reason}") from None
    return np.asarray(np.hstack([found[:, :1], 1j * found[:, 1:]]), complex)
