"""The loop of a measured linear part and its elements, and its substitute where methods take a loop.

The methods need of a loop its frequency response, for the balance of its means and for its named signals. All three are
known without a state: the first is measured, the second follows from the static gains. Linear states that elements
bring themselves are known, and are closed around the measured response frequency by frequency.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eppanalysis.arguments import checked_class, floats
from eppanalysis.arrays import Array, BoolArray, ComplexArray
from eppanalysis.errors import ModelError
from eppanalysis.models.elements.base import Nonlinearity
from eppanalysis.models.elements.dynamic.sampled import SampledController
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.measured.between import Between, columns_of, measured_of, ways_of
from eppanalysis.models.systems.measured.matrix import MeasuredMatrix
from eppanalysis.models.systems.measured.response import MeasuredResponse
from eppanalysis.models.systems.own_states import ports
from eppanalysis.models.systems.sampled.averaged import averaged
from eppanalysis.models.systems.signals import element_signals, labels_of, slices

#: Matrices of means on inputs and on outputs, and what they are balanced with.
Means = tuple[ArrayLike, ArrayLike, ArrayLike]

#: Amplitudes, over the spread of an element's thresholds, at which its own mean is evaluated.
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
        Of several elements a matrix: a row for each of their inputs, a column for each of their outputs. Rates of
        inputs, clocks, contact angles and their rates follow from others and have none.
    element : Nonlinearity or sequence of Nonlinearity
        Linear states that an element brings itself are not part of the response. A :class:`SampledController` is taken
        with hold and delay, in the mean over where its samples fall; the response is that of the plant around it, in
        continuous time.
    feedback : {-1, 1}
        Sign of the feedback.
    name : str
        Of the loop, in sentences and messages.
    means : (array (m, m), array (m, nw), array (m,)), optional
        Balance of the means, ``E b + F mean = p``, between mean inputs b and mean outputs of the elements. By default
        what the static gains say, ``b = feedback * G(0) mean``, and of an input that integrates a single output, that
        this output has no mean.

    Raises
    ------
    ModelError
        If shapes do not fit, an input of an element is neither measured nor a rate, `feedback` is neither -1 nor 1, or
        an element has a mean output for a sine of mean zero and the static gain, which then counts, is not given.

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
        for e in self.elements:
            if "unknown" in ways_of(e):
                what = f"{self.name}: {type(e).__name__} reads a second signal, which no describing function covers"
                raise ModelError(what, expected="elements of one input, its rate, or a clock; or a rational model")
        rows, columns = (len(places) for places in self._places)
        if self.matrix.shape != (rows, columns):
            what = f"{self.name}: the response has {self.matrix.shape[0]} outputs and {self.matrix.shape[1]} inputs"
            raise ModelError(what, expected=f"{rows} and {columns}, as the elements", field="response")
        self._check_means()

    def _check_means(self) -> None:
        m = self.matrix.shape[0]
        if self.means is not None:
            shapes = tuple(np.shape(part) for part in self.means)
            if shapes != ((m, m), (m, self.matrix.shape[1]), (m,)):
                raise ModelError(
                    f"{self.name}: means", f"of shapes {shapes}", f"{(m, m)}, {(m, self.matrix.shape[1])}, {(m,)}"
                )
            return
        places = slices([columns_of(e) for e in self.elements])
        for e, place in zip(self.elements, places, strict=True):
            linear = isinstance(e, SampledController)
            if not linear and np.any(self._open[:, place]) and _makes_a_mean(e):
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
    def _places(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Places of the measured ones among all signals before and among all signals behind the elements."""
        before, behind = (slices([ports(e)[k] for e in self.elements]) for k in (0, 1))
        rows = [z.start + i for e, z in zip(self.elements, before, strict=True) for i in measured_of(e)]
        columns = [w.start + j for e, w in zip(self.elements, behind, strict=True) for j in range(columns_of(e))]
        return np.array(rows, np.intp), np.array(columns, np.intp)

    @property
    def _open(self) -> BoolArray:
        """Paths whose part in the balance of means is not known, shape of the matrix."""
        gain = self.matrix.static_gain
        several = np.isinf(gain) & (np.isinf(gain).sum(1) > 1)[:, None]
        return np.isnan(gain) | several

    def _balance_of_means(self) -> tuple[Array, Array, Array]:
        if self.means is not None:
            on_bias, on_mean, prescribed = (np.asarray(part, float) for part in self.means)
            return on_bias, on_mean, prescribed
        gain, rows = self.matrix.static_gain, self.matrix.shape[0]
        on_bias, on_mean = np.eye(rows), -self.feedback * np.where(np.isfinite(gain), gain, 0.0)
        # An integrator leaves its input's mean open, and requires instead that what it integrates has none.
        for i in np.flatnonzero((np.isinf(gain).sum(1) == 1) & ~np.isnan(gain).any(1)):
            on_bias[i, i], on_mean[i] = 0.0, self.feedback * np.isinf(gain[i])
        return on_bias, on_mean, np.zeros(rows)

    def to_system(self) -> DataSystem:
        """The system for methods that need no states."""
        elements, (A, B, C, constant) = self.elements, self._means_as_states()
        labels, (p, q) = labels_of(elements, None), (len(C), B.shape[1])
        single = ("x", "y") if self.matrix.shape == (1, 1) and q == 1 else None
        signals = element_signals(elements, labels, C, np.zeros((p, q)), np.zeros((p, 0)), np.zeros(p), single)
        plain = averaged(
            LureSystem.build(
                A, B, C, elements, constant_state=constant, element_names=labels, signals=signals, name=self.name
            )
        )
        values = {f.name: getattr(plain, f.name) for f in fields(LureSystem)}
        known = self.means is not None or not np.any(self._open)
        return DataSystem(**values, matrix=self.matrix, feedback=self.feedback, outer=elements, means_known=known)

    def _means_as_states(self) -> tuple[Array, Array, Array, Array]:
        """Matrices of a loop whose states are the means b and their rates: constant means are balanced.

        No more of these states is seen. Behind them are contact angles, whose rates have no mean at rest, and a clock.
        """
        (on_bias, on_mean, prescribed), (rows, columns) = self._balance_of_means(), self._places
        ways = [way for e in self.elements for way in ways_of(e)]
        m, p, q = len(rows), len(ways), sum(ports(e)[1] for e in self.elements)
        contacts = np.setdiff1d(np.arange(q), columns)
        n = 2 * m + len(contacts) + ("clock" in ways)
        A, B, C, constant = np.zeros((n, n)), np.zeros((n, q)), np.zeros((p, n)), np.zeros(n)
        A[:m, m : 2 * m], A[m : 2 * m, :m] = np.eye(m), on_bias
        B[m : 2 * m, columns], B[2 * m + np.arange(len(contacts)), contacts] = on_mean, 1.0
        constant[m : 2 * m], constant[2 * m + len(contacts) :] = -prescribed, 1.0
        C[rows, :m] = np.eye(m)
        follows = {"rate": m + np.searchsorted(rows, np.arange(p)) - 1, "clock": np.full(p, n - 1)}
        follows["contact"] = 2 * m - 1 + np.cumsum([way == "contact" for way in ways])
        for i, way in enumerate(ways):
            if way != "measured":
                C[i, follows[way][i]] = 1.0
        return A, B, C, constant


def _inner(element: Nonlinearity) -> int:
    """Number of outputs that an element has by the DF, where controllers are linear."""
    return 0 if isinstance(element, SampledController) else element.n_outputs


def _makes_a_mean(element: Nonlinearity) -> bool:
    """Whether an element makes a mean of a sine that has none."""
    levels = np.abs(np.asarray(element.thresholds(), float)).ravel()
    levels = levels[levels > 0]
    a = (float(levels.max()) if levels.size else 1.0) * _AMPLITUDES
    with np.errstate(all="ignore"):
        mean, gain = element.describing_function(a, 0.0)
    size = np.abs(gain) * (a if gain.shape == a.shape else a[:, None])
    known = np.isfinite(mean) & np.isfinite(size)
    return bool(np.any(np.abs(mean[known]) > 1e-9 * np.max(size[known], initial=0.0)))


@dataclass(frozen=True, eq=False)
class DataSystem(LureSystem):
    """A loop whose responses are measured; its matrices say what means do, and nothing else."""

    matrix: MeasuredMatrix | None = None
    feedback: int = -1
    outer: tuple[Nonlinearity, ...] = ()  # the elements as they were given, with the states that they bring
    means_known: bool = True  # whether the balance of means was said, or follows from the static gains

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
    def slowest(self) -> float:
        """Longest time between two samples of a controller [s]; zero without one."""
        return max((c.sample_time for c, _, _ in self.between.controllers), default=0.0)

    @cached_property
    def between(self) -> Between:
        """What is between measured signals and the automata."""
        return Between.of(self.outer)

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
        """Itself: the substitute of its states has no poles that show."""
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
        # The rate of a contact angle is an output of its element, and does not act on the measured part.
        w = np.broadcast_to(np.eye(y.shape[-1]) + 0j, (*y.shape[:-2], y.shape[-1], y.shape[-1]))
        before, behind, inner = (
            slices([size(e) for e in self.outer]) for size in (lambda e: len(measured_of(e)), columns_of, _inner)
        )
        parts = [
            part
            for e, b, o, i in zip(self.outer, before, behind, inner, strict=True)
            for part in (x[..., b.start : b.start + 1, :], w[..., i, :] if e.own_states is None else y[..., o, :])
        ]
        return np.concatenate(parts, axis=-2)

    def state_response(self, omega: ArrayLike) -> ComplexArray:
        """Nothing: there are no states."""
        return np.zeros((*np.shape(omega), len(self.A), self.B.shape[1]), complex)

    def _closed(self, omega: Array) -> tuple[ComplexArray, ComplexArray, ComplexArray, ComplexArray]:
        """From the outputs of the automata: their inputs, these by omega, and the signals around the elements."""
        G, dG = (self.feedback * part for part in self.data.with_slope(omega))
        if self.between.passes:
            straight = np.broadcast_to(np.eye(G.shape[-1]) + 0j, (*omega.shape, G.shape[-1], G.shape[-1]))
            return G, dG, G, straight
        P, dP = self.between.at(omega)
        # x = (1 - G P_yx)^-1 G P_yw w (docs/theory/measured.md, The interval of a prediction).
        closed = np.eye(G.shape[-2]) - G @ P["yx"]
        x = np.linalg.solve(closed, G @ P["yw"])
        y = P["yx"] @ x + P["yw"]
        dx = np.linalg.solve(closed, dG @ y + G @ (dP["yx"] @ x + dP["yw"]))
        found = P["zx"] @ x + P["zw"], dP["zx"] @ x + P["zx"] @ dx + dP["zw"], x, y
        z, dz, x, y = (np.array(part, np.complex128) for part in found)
        return z, dz, x, y

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
        G = self.feedback * self.data.at(omega)
        into, out = (np.broadcast_to(np.eye(n) + 0j, (*G.shape[:-2], n, n)) for n in G.shape[-2:])
        if not self.between.passes:
            P, _ = self.between.at(omega)
            # With x = G y and y = P_yx x + P_yw w: dx = (1 - G P_yx)^-1 dG y.
            closed = np.asarray(np.linalg.inv(np.eye(G.shape[-2]) - G @ P["yx"]), np.complex128)
            into, out = P["zx"] @ closed, P["yx"] @ closed @ G @ P["yw"] + P["yw"]
        parts = [into[..., :, i, None] * G[..., i, j, None, None] * out[..., None, j, :] for i, j, _ in self.data.known]
        return np.stack(parts, -3)
