"""Frequency responses of a linear state space with delayed inputs, in the coordinates that suit each frequency."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eppanalysis.arguments import floats
from eppanalysis.models.systems.linear import solved
from eppanalysis.models.systems.signals import SignalMap

Array = NDArray[np.float64]


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

    def frequency_response(self, omega: ArrayLike) -> NDArray[np.complex128]:
        """Response from the elements' outputs to their inputs, shape (..., nz, nw), dead time included.

        Parameters
        ----------
        omega : array_like
            Angular frequency [rad/s]. At a pole, where the response has no value, it is that of the frequency next to
            it, and huge.
        """
        return self._response(floats(omega, "frequency_response: omega"), self.C, self.D)

    def signal_response(self, omega: ArrayLike) -> NDArray[np.complex128]:
        """Response from the elements' outputs to the named signals, shape (..., ns, nw)."""
        return self._response(omega, self.signals.C, self.signals.D)

    def state_response(self, omega: ArrayLike) -> NDArray[np.complex128]:
        """Response from the elements' outputs to the state, shape (..., n, nw)."""
        n, nw = self.B.shape
        return self._response(omega, np.eye(n), np.zeros((n, nw)))

    def frequency_response_and_slope(self, omega: ArrayLike) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """:meth:`frequency_response` and its derivative by `omega`, both of shape (..., nz, nw).

        The derivative of the resolvent is its square: a second solution with the first as its right side.
        """
        apart, T = self._for_responses
        omega, ds, resolvent = apart._resolvent(omega)
        x = solved(resolvent, apart.B + 0j)
        dx = solved(resolvent, -ds[..., None, None] * x)
        if np.any(self.delays):
            late = np.exp(-1j * omega[..., None] * self.delays)[..., None, :]
            x, dx = x * late, (dx - 1j * self.delays * x) * late
        C = self.C if T is None else self.C @ T
        return np.asarray(C @ x + self.D, complex), np.asarray(C @ dx, complex)

    def response_at(self, s: ArrayLike) -> NDArray[np.complex128]:
        """Response from the elements' outputs to their inputs at any complex s [1/s], shape (..., nz, nw)."""
        s = np.asarray(s, complex)
        x = solved(self.characteristic_matrix(s), self.B + 0j) * np.exp(-s[..., None] * self.delays)[..., None, :]
        return np.asarray(self.C @ x + self.D, complex)

    def _response(self, omega: ArrayLike, C: Array, D: Array) -> NDArray[np.complex128]:
        apart, T = self._for_responses
        omega, _, resolvent = apart._resolvent(omega)
        x = solved(resolvent, apart.B + 0j)
        if np.any(self.delays):
            x = x * np.exp(-1j * omega[..., None] * self.delays)[..., None, :]
        return np.asarray((C if T is None else C @ T) @ x + D, complex)

    @property
    def _for_responses(self) -> tuple[Responses, Array | None]:
        """The loop in coordinates that suit a linear solution next to its poles; None where they are its own.

        In discrete time all slow poles are next to one: a companion form of theirs is singular there to rounding.
        """
        return self.with_integrators_apart if self.time_step else (self, None)

    def _resolvent(self, omega: ArrayLike) -> tuple[Array, NDArray[np.complex128], NDArray[np.complex128]]:
        """Frequencies, ``ds/d omega`` (dz/d omega in discrete time) and the matrices ``s - A`` (``z - A``) there."""
        omega = np.asarray(omega, float)
        step = self.time_step
        slope = 1j * step * np.exp(1j * omega * step) if step else np.full(omega.shape, 1j)
        return omega, np.asarray(slope, complex), self.characteristic_matrix(1j * omega)

    def characteristic_matrix(self, s: ArrayLike) -> NDArray[np.complex128]:
        """``s - A`` at complex frequencies s [1/s], shape (..., n, n); in discrete time ``exp(s T) - A``.

        There it is a difference of what both are beside one, near which all slow poles are.
        """
        s = np.asarray(s, complex)
        unit = np.eye(self.A.shape[0])
        if self.time_step:
            return np.asarray(np.expm1(s * self.time_step)[..., None, None] * unit - (self.A - unit), complex)
        return np.asarray(s[..., None, None] * unit - self.A, complex)
