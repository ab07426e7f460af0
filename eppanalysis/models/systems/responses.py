"""Frequency responses of a linear state space with delayed inputs, in the coordinates that suit each frequency."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.arguments import floats
from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.engine.balances import response_and_slope
from eppanalysis.models.systems.linear import solved
from eppanalysis.models.systems.signals import SignalMap


class Responses(ABC):
    """Responses of ``dx/dt = A x + B w(t - delay), z = C x + D w``, or of its form in discrete time."""

    A: Array
    B: Array
    C: Array
    D: Array
    signals: SignalMap
    delays: Array
    time_step: float | None

    @property
    @abstractmethod
    def with_integrators_apart(self) -> tuple[Responses, Array]:
        """The same in coordinates in which integrators have rows of zeros in A, and T of ``x = T y``."""

    def highest_harmonic(self, omega: float) -> int:
        """Highest harmonic of a frequency [rad/s] that has a response: in discrete time below half the sample rate.

        Beyond it harmonics fold back, and those that fold to near zero resonate with an integrator.
        """
        return max(1, int(0.999 * np.pi / (omega * self.time_step))) if self.time_step else 10**6

    def frequency_response(self, omega: ArrayLike) -> ComplexArray:
        """Response from the elements' outputs to their inputs, shape (..., nz, nw), dead time included.

        Parameters
        ----------
        omega : array_like
            Angular frequency [rad/s]. At a pole, where the response has no value, it is that of the frequency next to
            it, and huge.
        """
        return self._response(floats(omega, "frequency_response: omega"), self.C, self.D)

    def signal_response(self, omega: ArrayLike) -> ComplexArray:
        """Response from the elements' outputs to the named signals, shape (..., ns, nw)."""
        return self._response(omega, self.signals.C, self.signals.D)

    def state_response(self, omega: ArrayLike) -> ComplexArray:
        """Response from the elements' outputs to the state, shape (..., n, nw)."""
        n, nw = self.B.shape
        return self._response(omega, np.eye(n), np.zeros((n, nw)))

    def frequency_response_and_slope(self, omega: ArrayLike) -> tuple[ComplexArray, ComplexArray]:
        """:meth:`frequency_response` and its derivative by `omega`, both of shape (..., nz, nw)."""
        L, dL = self._answers(omega, self.C, 2)
        return L + self.D, dL

    def response_at(self, s: ArrayLike) -> ComplexArray:
        """Response from the elements' outputs to their inputs at any complex s [1/s], shape (..., nz, nw)."""
        s = np.asarray(s, complex)
        x = solved(self.characteristic_matrix(s), self.B + 0j) * np.exp(-s[..., None] * self.delays)[..., None, :]
        return np.asarray(self.C @ x + self.D, complex)

    def _response(self, omega: ArrayLike, C: Array, D: Array) -> ComplexArray:
        return np.asarray(self._answers(omega, C, 1)[0] + D, complex)

    def _answers(self, omega: ArrayLike, C: Array, count: int) -> ComplexArray:
        """Responses to what C takes of the states, and their derivatives by `omega` if two are requested."""
        apart, T = self._for_responses
        omega = np.asarray(omega, float)
        s, ds = self._place(1j * omega)
        A, B, C = (np.array(m, float, order="C") for m in (apart._rates, apart.B, C if T is None else C @ T))
        out = np.empty((count, *omega.shape, len(C), B.shape[1]), complex)
        response_and_slope(A, B, C, s.ravel(), 1j * ds.ravel(), out.reshape(count, omega.size, *out.shape[-2:]))
        if np.any(self.delays):
            out *= np.exp(-1j * omega[..., None] * self.delays)[..., None, :]
            out[1:] -= 1j * self.delays * out[:1]
        return out

    @property
    def _for_responses(self) -> tuple[Responses, Array | None]:
        """The loop in coordinates that suit a linear solution next to its poles; None where they are its own.

        In discrete time all slow poles are next to one: a companion form of theirs is singular there to rounding.
        """
        return self.with_integrators_apart if self.time_step else (self, None)

    def characteristic_matrix(self, s: ArrayLike) -> ComplexArray:
        """``s - A`` at complex frequencies s [1/s], shape (..., n, n); in discrete time ``exp(s T) - A``."""
        return np.asarray(self._place(s)[0][..., None, None] * np.eye(len(self.A)) - self._rates, complex)

    def _place(self, s: ArrayLike) -> tuple[ComplexArray, ComplexArray]:
        """The factor of the rate (in discrete time a step's change) at complex frequencies s [1/s], and its slope."""
        s = np.asarray(s, complex)
        if not self.time_step:
            return s, np.ones(s.shape, complex)
        step: float = self.time_step
        return np.asarray(np.expm1(s * step), complex), np.asarray(step * np.exp(s * step), complex)

    @property
    def _rates(self) -> Array:
        """A; in discrete time what a step changes, for there ``z - A`` is a difference of what both are beside one.

        All slow poles are near one.
        """
        return self.A - np.eye(len(self.A)) if self.time_step else self.A
