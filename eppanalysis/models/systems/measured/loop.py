"""The loop of a measured linear part and its elements, and what stands for it where methods take a loop.

The methods ask a loop for its frequency response, for the balance of its means and for its named signals. All three are
known without a state: the first is measured, the second follows from the static gains. Linear states that elements
bring themselves are known, and are closed around the measured response frequency by frequency.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eppanalysis.arguments import checked_class, floats
from eppanalysis.errors import ModelError
from eppanalysis.models.elements.base import Nonlinearity
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.measured.matrix import MeasuredMatrix
from eppanalysis.models.systems.measured.response import MeasuredResponse
from eppanalysis.models.systems.own_states import ports, stacked
from eppanalysis.models.systems.signals import element_signals, labels_of, slices

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
#: Matrices of means on inputs and on outputs, and what they are balanced with.
Means = tuple[ArrayLike, ArrayLike, ArrayLike]

#: Amplitudes, over the spread of an element's thresholds, at which it is asked for a mean of its own.
_AMPLITUDES = np.geomspace(1e-2, 1e3, 60)
#: Nodes a decade of a response that is a smooth curve.
_PER_DECADE = 60
#: How far from a whole number the slope of a response at its end may be.
_WHOLE = 0.3


@checked_class
@dataclass(frozen=True, eq=False)
class MeasuredLoop:
    """A measured linear part G closed by its elements: ``x = feedback * G y``, ``y = elements(x)``.

    The signals of one element are "x", its input, and "y", its output; those of several are named after them. There are
    no states: what needs them takes the loop of a rational model of the data.

    Parameters
    ----------
    response : MeasuredResponse or MeasuredMatrix
        Of several elements a matrix: a row for each of their inputs, a column for each of their outputs.
        An input that is the rate of the one before it has no row.
    element : Nonlinearity or sequence of Nonlinearity
        Linear states that an element brings itself are no part of the response.
    feedback : {-1, 1}
        Sign of the feedback.
    name : str
    means : (array (m, m), array (m, nw), array (m,)), optional
        Balance of the means, ``E b + F mean = p``, between mean inputs b and mean outputs of the elements. By default
        what the static gains say, ``b = feedback * G(0) mean``, and of an input that integrates a single output, that
        this output has no mean.

    Raises
    ------
    ModelError
        If shapes do not fit, an input of an element is neither measured nor a rate, `feedback` is neither -1 nor 1, or
        an element makes a mean of a sine without one and the static gain, which then counts, is not given.

    Examples
    --------
    >>> import numpy as np
    >>> import eppanalysis as epp
    >>> s = 1j * np.geomspace(0.1, 100.0, 301)
    >>> response = epp.MeasuredResponse(s.imag, 1.0 / (s * (s + 1.0) * (s + 2.0)))
    >>> for cycle in epp.predict_limit_cycles(epp.MeasuredLoop(response, epp.Relay())):
    ...     print(f"amplitude {cycle.amplitude('x'):.4f}, {cycle.omega:.4f} rad/s")
    amplitude 0.2122, 1.4142 rad/s
    """

    response: MeasuredResponse | MeasuredMatrix
    element: Nonlinearity | Sequence[Nonlinearity]
    feedback: int = -1
    name: str = "measured loop"
    means: Means | None = None

    def __post_init__(self) -> None:
        if self.feedback not in (-1, 1):
            raise ModelError(self.name, self.feedback, "-1 or 1", field="feedback")
        rows, columns = len(self._rows), sum(ports(e)[1] for e in self.elements)
        if self.matrix.shape != (rows, columns):
            what = f"{self.name}: the response has {self.matrix.shape[0]} outputs and {self.matrix.shape[1]} inputs"
            raise ModelError(what, expected=f"{rows} and {columns}, as the elements", field="response")
        for e in self.elements:
            if ports(e)[0] > 1 and e.input_ports[1:] != ("rate",):
                what = f"{self.name}: {type(e).__name__} has several inputs"
                raise ModelError(what, expected="elements of one input, or one and its rate; or a rational model")
            if e.own_states is not None and e.own_states.rate is not None and np.any(e.own_states.rate):
                what = f"{self.name}: {type(e).__name__} has a clock"
                raise ModelError(what, expected="elements that take no samples, or a rational model")
        self._check_means()

    def _check_means(self) -> None:
        m = len(self._rows)
        if self.means is not None:
            shapes = tuple(np.shape(part) for part in self.means)
            if shapes != ((m, m), (m, self.matrix.shape[1]), (m,)):
                raise ModelError(
                    f"{self.name}: means", f"of shapes {shapes}", f"{(m, m)}, {(m, self.matrix.shape[1])}, {(m,)}"
                )
            return
        places = slices([ports(e)[1] for e in self.elements])
        for e, place in zip(self.elements, places, strict=True):
            if np.any(self._open[:, place]) and _makes_a_mean(e):
                raise ModelError(
                    f"{self.name}: {type(e).__name__} makes a mean of an oscillation without one, and the data have no "
                    "static gain, with which it comes round",
                    expected="static_gain of the response, infinite where it integrates, or the balance of means",
                )

    @property
    def elements(self) -> tuple[Nonlinearity, ...]:
        """The elements, in the order of rows and columns."""
        return (self.element,) if isinstance(self.element, Nonlinearity) else tuple(self.element)

    @property
    def matrix(self) -> MeasuredMatrix:
        """The response as a matrix."""
        return (
            self.response
            if isinstance(self.response, MeasuredMatrix)
            else MeasuredMatrix([[self.response]], self.response.name)
        )

    @property
    def _rows(self) -> NDArray[np.intp]:
        """Places of the measured ones among all signals before the elements: those that are no rates."""
        return np.array([s.start for s in slices([ports(e)[0] for e in self.elements])], dtype=np.intp)

    @property
    def _open(self) -> NDArray[np.bool_]:
        """Paths whose part in the balance of means is not known, shape of the matrix."""
        gain = self.matrix.static_gain
        several = np.isinf(gain) & (np.isinf(gain).sum(1) > 1)[:, None]
        return np.isnan(gain) | several

    def _balance_of_means(self) -> tuple[Array, Array, Array]:
        if self.means is not None:
            on_bias, on_mean, prescribed = (np.asarray(part, float) for part in self.means)
            return on_bias, on_mean, prescribed
        gain, rows = self.matrix.static_gain, len(self._rows)
        on_bias, on_mean = np.eye(rows), -self.feedback * np.where(np.isfinite(gain), gain, 0.0)
        # An integrator leaves its input's mean open, and asks instead that what it integrates has none.
        for i in np.flatnonzero((np.isinf(gain).sum(1) == 1) & ~np.isnan(gain).any(1)):
            on_bias[i, i], on_mean[i] = 0.0, self.feedback * np.isinf(gain[i])
        return on_bias, on_mean, np.zeros(rows)

    def to_system(self) -> DataSystem:
        """What stands for it in methods that need no states."""
        elements, (on_bias, on_mean, prescribed) = self.elements, self._balance_of_means()
        m, (q, p) = len(self._rows), (sum(ports(e)[k] for e in elements) for k in (1, 0))
        # The means b and their rates stand for the states: means that stand still are balanced, and no more of these
        # states is ever seen.
        A, B, C = np.eye(2 * m, k=m), np.zeros((2 * m, q)), np.zeros((p, 2 * m))
        A[m:, :m], B[m:], constant = on_bias, on_mean, np.append(np.zeros(m), -prescribed)
        C[self._rows, :m] = np.eye(m)
        for i, e in enumerate(elements):
            if ports(e)[0] > 1:
                C[self._rows[i] + 1, m + i] = 1.0
        labels = labels_of(elements, None)
        single = ("x", "y") if m == q == 1 else None
        D = np.zeros((p, q))
        signals = element_signals(elements, labels, C, D, np.zeros((p, 0)), np.zeros(p), single)
        plain = LureSystem.build(
            A, B, C, elements, constant_state=constant, element_names=labels, signals=signals, name=self.name
        )
        values = {f.name: getattr(plain, f.name) for f in fields(LureSystem)}
        known = self.means is not None or not np.any(self._open)
        return DataSystem(**values, matrix=self.matrix, feedback=self.feedback, outer=elements, means_known=known)


def _makes_a_mean(element: Nonlinearity) -> bool:
    """Whether an element makes a mean of a sine that has none."""
    levels = np.abs(np.asarray(element.thresholds(), float)).ravel()
    levels = levels[levels > 0]
    a = (float(levels.max()) if levels.size else 1.0) * _AMPLITUDES
    with np.errstate(all="ignore"):
        mean, gain = element.describing_function(a, 0.0)
    size = np.abs(gain) * a
    known = np.isfinite(mean) & np.isfinite(size)
    return bool(np.any(np.abs(mean[known]) > 1e-9 * np.max(size[known], initial=0.0)))


@dataclass(frozen=True, eq=False)
class DataSystem(LureSystem):
    """A loop whose responses are measured; its matrices say what means do, and nothing else.

    Attributes
    ----------
    matrix : MeasuredMatrix
    feedback : int
    outer : tuple of Nonlinearity
        The elements as they were given, with the states that they bring.
    means_known : bool
        Whether the balance of means was said, or follows from the static gains.
    """

    matrix: MeasuredMatrix | None = None
    feedback: int = -1
    outer: tuple[Nonlinearity, ...] = ()
    means_known: bool = True

    @property
    def data(self) -> MeasuredMatrix:
        """The measured responses."""
        assert self.matrix is not None
        return self.matrix

    @property
    def only(self) -> MeasuredResponse | None:
        """The measured response of a loop that has a single one, without states between."""
        alone = self.data.shape == (1, 1) and all(e.own_states is None for e in self.outer)
        return self.data.known[0][2] if alone else None

    @property
    def band(self) -> tuple[float, float]:
        """Frequencies [rad/s] between which responses are known."""
        return self.data.band

    def highest_harmonic(self, omega: float) -> int:
        """Highest harmonic of a frequency [rad/s] within the data."""
        return max(1, int(self.band[1] / omega * (1.0 + 1e-9)))

    def frequency_nodes(self) -> Array:
        """Ascending frequencies [rad/s] between which nothing happens that the data show."""
        low, high = self.band
        even = np.geomspace(low, high, int(_PER_DECADE * np.log10(high / low)) + 2)
        nodes = [even]
        for own in (r.curve.log_omega for _, _, r in self.data.known):
            nodes.append(np.exp(np.concatenate([own[1:-1], 0.5 * (own[1:] + own[:-1])])))
        found = np.concatenate(nodes)
        return np.unique(np.concatenate([[low], found[(found > low) & (found < high)], [high]]))

    @property
    def with_integrators_apart(self) -> tuple[LureSystem, Array]:
        """Itself: what stands for its states has no poles that show."""
        return self, np.eye(len(self.A))

    def frequency_response(self, omega: ArrayLike) -> ComplexArray:
        """Response from the elements' outputs to their inputs, shape (..., nz, nw); not a number outside the data."""
        return self.frequency_response_and_slope(omega)[0]

    def frequency_response_and_slope(self, omega: ArrayLike) -> tuple[ComplexArray, ComplexArray]:
        """:meth:`frequency_response` and its derivative by `omega`."""
        found = self._closed(floats(omega, "frequency_response: omega"))
        return found[0], found[1]

    def signal_response(self, omega: ArrayLike) -> ComplexArray:
        """Response from the elements' outputs to the named signals, shape (..., ns, nw)."""
        _, _, x, y = self._closed(floats(omega, "signal_response: omega"))
        before, behind = (slices([ports(e)[k] for e in self.outer]) for k in (0, 1))
        parts = [
            part
            for b, o in zip(before, behind, strict=True)
            for part in (x[..., b.start : b.start + 1, :], y[..., o, :])
        ]
        return np.concatenate(parts, axis=-2)

    def state_response(self, omega: ArrayLike) -> ComplexArray:
        """Nothing: there are no states."""
        return np.zeros((*np.shape(omega), len(self.A), self.B.shape[1]), complex)

    def _closed(self, omega: Array) -> tuple[ComplexArray, ComplexArray, ComplexArray, ComplexArray]:
        """From the outputs of the automata: their inputs, these by omega, and the signals around the elements."""
        G, dG = self._before(omega)
        own = self._own
        if self._straight:
            straight = np.broadcast_to(np.eye(G.shape[-1]) + 0j, (*omega.shape, G.shape[-1], G.shape[-1]))
            return G, dG, G, straight
        C, B = (
            np.concatenate(pair, axis) for pair, axis in (((own["C_z"], own["C_y"]), 0), ((own["B_x"], own["B_w"]), 1))
        )
        D = np.block([[own["D_zx"], own["D_zw"]], [own["D_yx"], own["D_yw"]]])
        resolvent = np.linalg.inv(1j * omega[..., None, None] * np.eye(len(own["A"])) - own["A"])
        P, dP = C @ resolvent @ B + D, -1j * (C @ resolvent @ resolvent @ B)
        nz, n_x = len(own["D_zx"]), own["B_x"].shape[1]
        (zx, zw), (yx, yw) = ((M[..., :n_x], M[..., n_x:]) for M in (P[..., :nz, :], P[..., nz:, :]))
        (dzx, dzw), (dyx, dyw) = ((M[..., :n_x], M[..., n_x:]) for M in (dP[..., :nz, :], dP[..., nz:, :]))
        # x = (1 - G P_yx)^-1 G P_yw w (docs/theory/measured.md, The interval of a prediction).
        closed = np.eye(n_x) - G @ yx
        x = np.linalg.solve(closed, G @ yw)
        y = yx @ x + yw
        dx = np.linalg.solve(closed, dG @ y + G @ (dyx @ x + dyw))
        return zx @ x + zw, dzx @ x + zx @ dx + dzw, x, y

    @property
    def _straight(self) -> bool:
        """Whether no element brings states of its own."""
        return not len(self._own["A"]) and self.data.shape[1] == self.B.shape[1]

    @property
    def straight(self) -> Array:
        """Rates at which inputs follow a step of an output, shape (nz, nw), where the end of the data falls as 1/omega.

        Zero where it falls more steeply, as far as the end shows.
        """
        top = self.band[1]
        G, dG = self.frequency_response_and_slope(top)
        with np.errstate(all="ignore"):
            slope = np.nan_to_num((top * dG / G).real)
        # Where G falls as CB/(j omega), the rate behind a step is CB.
        return np.where(np.abs(slope + 1.0) < _WHOLE, (1j * top * G).real, 0.0)

    def by_path(self, omega: ArrayLike) -> ComplexArray:
        """Change of :meth:`frequency_response` with the logarithm of each path, shape (..., paths, nz, nw)."""
        omega = floats(omega, "by_path: omega")
        before, _ = self._before(omega)
        own = self._own
        if self._straight:
            return self._by_path(before, np.eye(before.shape[-2]), np.eye(before.shape[-1]))
        y = self._closed(omega)[-1]
        resolvent = np.linalg.inv(1j * omega[..., None, None] * np.eye(len(own["A"])) - own["A"])
        zx, yx = (own[f"C_{s}"] @ resolvent @ own["B_x"] + own[f"D_{s}x"] for s in "zy")
        # With x = G y and y = P_yx x + P_yw w: dx = (1 - G P_yx)^-1 dG y.
        return self._by_path(before, zx @ np.linalg.inv(np.eye(before.shape[-2]) - before @ yx), y)

    def _by_path(self, before: ComplexArray, closed: NDArray[Any], y: NDArray[Any]) -> ComplexArray:
        parts = []
        for i, j, _ in self.data.known:
            part = np.zeros_like(before)
            rows = [r for r, (owner, _) in enumerate(self._ports) if owner == i]
            part[..., rows, j] = before[..., rows, j]
            parts.append(closed @ part @ y)
        return np.stack(parts, -3)

    @property
    def _ports(self) -> list[tuple[int, bool]]:
        """Of each signal before the elements: the row of the matrix, and whether it is the rate of that."""
        return [(i, k > 0) for i, e in enumerate(self.outer) for k in range(ports(e)[0])]

    @cached_property
    def _own(self) -> dict[str, Array]:
        """Linear states that the elements bring, as one system."""
        return stacked(self.outer)

    def _before(self, omega: Array) -> tuple[ComplexArray, ComplexArray]:
        """Response from behind to before the elements, rates included, and its derivative by omega."""
        G, dG = self.data.with_slope(omega)
        rows, rates = (list(part) for part in zip(*self._ports, strict=True))
        s = np.where(rates, 1j * omega[..., None], 1.0)[..., None]
        by_s = np.where(rates, 1j, 0.0)[:, None]
        G, dG = self.feedback * G[..., rows, :], self.feedback * dG[..., rows, :]
        return s * G, s * dG + by_s * G
