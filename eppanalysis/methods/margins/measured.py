"""The loop gain of a measured loop, and how many poles of the closed loop grow, by Nyquist's criterion on the data."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.methods.margins.linearised import closed_size
from eppanalysis.models.systems.measured.loop import DataSystem
from eppanalysis.models.systems.measured.response import MeasuredResponse

#: How far from a whole number the slope of a response towards low frequencies may be.
_WHOLE = 0.3


def unstable_poles(measured: MeasuredResponse, back: ComplexArray) -> int | None:
    """Number of unstable poles of a loop closed round one measured part.

    The curve ``1 + L`` is closed beyond the data: towards zero by as many integrators as its slope shows, upwards by a
    loop gain below one. None where that is not to be seen.

    Parameters
    ----------
    measured : MeasuredResponse
        The part.
    back : complex array, shape (m,)
        Loop gain L, for a feedback of -1, at ascending frequencies from one end of the data to the other.
    """
    if abs(back[-1]) >= 1.0:
        return None
    turn = np.unwrap(np.angle(1.0 + back))
    start = _start(measured, turn, abs(back[0]))
    if start is None:
        return None
    # Above the data the loop gain is below one, and 1 + L ends at one. Each half turn about zero up to there is a
    # pole less on the right (docs/theory/measured.md, Stability).
    end = 2.0 * np.pi * np.round(turn[-1] / (2.0 * np.pi))
    return measured.unstable_poles - round((end - start) / np.pi)


def _start(measured: MeasuredResponse, turn: Array, size: float) -> float | None:
    """Argument, a multiple of pi, of ``1 + L`` where it leaves the real axis at zero frequency."""
    gain = measured.static_gain
    if gain is not None and np.isfinite(gain):
        return float(np.pi * np.round(turn[0] / np.pi))
    value, by_omega = measured.with_slope(measured.band[0])
    slope = float((measured.band[0] * by_omega / value).real)
    if slope > 1.0 - _WHOLE and size < 1.0:
        return float(2.0 * np.pi * np.round(turn[0] / (2.0 * np.pi)))
    # Of k integrators 1 + L comes from infinity, a quarter turn behind the real axis for each.
    integrators = max(0, round(-slope))
    if abs(slope + integrators) > _WHOLE:
        return None
    return float(np.pi * np.round((turn[0] + 0.5 * np.pi * integrators) / np.pi))


@dataclass(frozen=True, eq=False)
class MeasuredGain:
    """The loop gain of a measured loop cut open at an input or an output of an element, the others being gains.

    With ``z = G w`` of the data, and ``w = K z + b u`` of the elements and of the cut, from which u goes on, it is
    ``-c z``.
    """

    system: DataSystem
    K: Array  # (nw, nz): gains that stay closed
    b: Array  # (nw, 1)
    c: Array  # (1, nz)

    @classmethod
    def of(cls, system: DataSystem, gains: Array, place: str) -> MeasuredGain:
        """Cut open at a place, the elements as gains (nw, nz)."""
        cuts, (nw, nz) = system.places, gains.shape
        number = cuts.number(place)
        # Of the places of elements, the inputs are the first.
        if number < nz:
            kept, b, c = np.diag(np.arange(nz) != number), gains[:, [number]], np.eye(nz)[[number]]
            return cls(system, gains @ kept, b, c)
        kept = np.diag(np.arange(nw) != number - nz)
        return cls(system, kept @ gains, np.eye(nw)[:, [number - nz]], gains[[number - nz]])

    @property
    def nodes(self) -> Array:
        """Frequencies between which nothing happens that the data show."""
        return self.system.frequency_nodes()

    def response(self, omega: Array) -> ComplexArray:
        """At frequencies (m,) [rad/s]; nan outside the data."""
        return self._with_slope(omega)[0]

    def slope(self, omega: Array) -> ComplexArray:
        """Derivative of the response by the frequency."""
        return self._with_slope(omega)[1]

    def _with_slope(self, omega: Array) -> tuple[ComplexArray, ComplexArray]:
        G, dG = self.system.frequency_response_and_slope(omega)
        closed = np.eye(len(self.c[0])) - G @ self.K
        z = np.linalg.solve(closed, G @ self.b)
        dz = np.linalg.solve(closed, dG @ (self.K @ z + self.b))
        L, dL = -(self.c @ z)[..., 0, 0], -(self.c @ dz)[..., 0, 0]
        return np.asarray(L, complex), np.asarray(dL, complex)

    @cached_property
    def at_rest(self) -> float | None:
        """Loop gain at frequency zero of a single measured part; None where it is not known, or infinite."""
        gain = None if self.system.only is None else self.system.only.static_gain
        if gain is None or not np.isfinite(gain):
            return None
        # Its input is the first: others are rates, which are zero.
        G = self.system.feedback * gain
        return float(-self.c[0, 0] * np.divide(G * self.b[0, 0], 1.0 - G * self.K[0, 0]))

    def slow_end(self, lowest: float) -> tuple[float, float] | None:
        """Frequency zero and the loop gain there, where the static gain is known."""
        return None if self.at_rest is None else (0.0, self.at_rest)

    def fast_end(self) -> tuple[float, float] | None:
        """Nothing is known above the data."""
        return None

    def closed_at_rest(self, lowest: float) -> float:
        """Size of the closed loop at frequency zero; nan where it is not known."""
        only = self.system.only
        if only is not None and only.static_gain == np.inf:
            return 1.0
        return float("nan") if self.at_rest is None else float(closed_size(np.array([self.at_rest + 0j]))[0])
