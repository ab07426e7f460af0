"""A rational model of measured data: poles by AAA, moved by vector fitting, and residues by least squares.

AAA (Nakatsukasa, Sete and Trefethen, SIAM J. Sci. Comput. 40 (2018) A1494) finds poles without a guess but fits the
largest values best; vector fitting (Gustavsen and Semlyen, IEEE Trans. Power Delivery 14 (1999) 1052) moves them with
every point weighed by its own size. Poles come in conjugate pairs and are kept left of the imaginary axis. Integrators
and the fall towards high frequencies are read off the ends of the data and built in: the model has them exactly.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from eppanalysis.arguments import check_counts, checked
from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.errors import EppError
from eppanalysis.methods.rational.result import RationalModel
from eppanalysis.models.systems.linear import StateSpace
from eppanalysis.models.systems.measured.response import MeasuredResponse
from eppanalysis.results import Status
from eppanalysis.results.provenance import Provenance

__all__ = ["rational_model"]

#: Steps of vector fitting.
_MOVES = 12
#: How far from a whole number the slope of a response towards an end may be to count as that of integrators.
_WHOLE = 0.25
#: Misfit above which a model is none, in standard deviations and at least.
_DEVIATIONS, _POOR = 5.0, 0.02
#: Highest order that is tried, orders without a gain after which no more are, decades of an end that tell its slope.
_HIGHEST, _PATIENCE, _END = 16, 3, 0.3
#: Phase that a dead time may turn at the highest frequency [rad].
_MOST_TURN = 1e4
#: Real part of a pole, over its size, that is at least left.
_DAMPED = 1e-6


@checked
def rational_model(
    response: MeasuredResponse,
    order: int | None = None,
    integrators: int | None = None,
    delay: float = 0.0,
    tolerance: float = 1e-6,
) -> RationalModel:
    """Stable rational model of a measured response, with real coefficients, and its misfit.

    Parameters
    ----------
    response : MeasuredResponse
        The data, from :func:`read_response` or of one's own arrays.
    order : int, optional
        Number of states beside the integrators. By default as few as bring the misfit below `tolerance` or, with a
        standard deviation, as many as Schwarz's criterion finds in the data, up to 16.
    integrators : int, optional
        Number of poles at zero; by default as the slope towards low frequencies says, none with a finite static gain.
    delay : float
        Dead time [s] that is taken out of the data and put into the loop.
    tolerance : float
        Largest relative misfit at which data without a standard deviation count as met.

    Returns
    -------
    RationalModel
        With status NOT_CONVERGED where it does not meet the data: a part with unstable poles or dead time does not
        have one.

    Raises
    ------
    EppError
        If scipy is older than 1.15, which has no AAA; if an argument is out of its range.

    Examples
    --------
    >>> import numpy as np
    >>> import eppanalysis as epp
    >>> s = 1j * np.geomspace(0.01, 100.0, 401)
    >>> model = epp.rational_model(
    ...     epp.MeasuredResponse(s.imag, 2.0 / (s * (s + 1.0) * (s + 4.0)))
    ... )
    >>> np.sort_complex(model.poles).real.round(6).tolist()
    [-4.0, -1.0, 0.0]
    >>> loop = model.loop(epp.Relay())
    """
    check_counts("rational_model", {"order": (1 if order is None else order, 1)})
    if not (np.isfinite(delay) and delay >= 0.0 and np.isfinite(tolerance) and tolerance > 0.0):
        raise EppError(f"rational_model: delay is {delay:g}, tolerance {tolerance:g}; expected >= 0 and above 0.")
    if integrators is not None and not 0 <= integrators <= 4:
        raise EppError(f"rational_model: integrators is {integrators}; expected 0 to 4.")
    omega, value = np.asarray(response.omega, float), np.asarray(response.value, complex)
    if delay * omega[-1] > _MOST_TURN:
        raise EppError(f"rational_model: delay is {delay:g} s; expected at most {_MOST_TURN / omega[-1]:.3g} s.")
    value = value * np.exp(1j * omega * delay)
    at_zero, falls = _ends(response)
    k = at_zero if integrators is None else integrators
    data = _Data(omega, value, response.deviation, k, max(falls - k, 0))
    if order is not None and order < data.degree:
        raise EppError(
            f"rational_model: order is {order}; expected at least {data.degree}, as steeply as the data fall."
        )
    orders = range(max(1, data.degree), _HIGHEST + 1) if order is None else [order]
    found = _chosen(data, orders, tolerance)
    allowed = tolerance if response.deviation is None else _DEVIATIONS * float(np.max(data.deviation))
    meets = found.misfit <= max(allowed, _POOR)
    return RationalModel(
        status=Status.CONVERGED if meets else Status.NOT_CONVERGED,
        system=found.system,
        poles=np.concatenate([found.poles, np.zeros(k)]),
        integrators=k,
        delay=delay,
        misfit=found.misfit,
        typical_misfit=found.typical,
        omega=omega,
        measured=np.asarray(response.value, complex),
        fitted=found.fitted * np.exp(-1j * omega * delay),
        provenance=Provenance("rational model", {"system": response.name, "order": len(found.poles), "delay": delay}),
    )


def _ends(response: MeasuredResponse) -> tuple[int, int]:
    """Numbers of integrators, and of poles more than zeros, by the slopes of the curve at its ends."""
    low, high = response.band
    # Over a share of the band: wide enough for noise, near enough to the end.
    share = min(10.0**_END, (high / low) ** 0.25)
    size = np.log(np.abs(response.at([low, low * share, high / share, high])))
    slopes = [(size[0] - size[1]) / np.log(share), (size[2] - size[3]) / np.log(share)]
    known = response.static_gain is not None and np.isfinite(response.static_gain)
    whole = abs(slopes[0] - round(slopes[0])) <= _WHOLE
    return 0 if known or not whole else max(0, round(slopes[0])), max(0, int(np.floor(slopes[1] + _WHOLE)))


@dataclass(frozen=True, eq=False)
class _Data:
    """What is fitted: ``H = G s^integrators`` at ``s = j omega``, with a deviation, and poles more than zeros."""

    omega: Array
    value: ComplexArray
    given: object
    integrators: int
    degree: int

    @property
    def s(self) -> ComplexArray:
        return np.asarray(1j * self.omega, complex)

    @property
    def H(self) -> ComplexArray:
        return np.asarray(self.value * self.s**self.integrators, complex)

    @property
    def deviation(self) -> Array:
        return np.ones(len(self.omega)) if self.given is None else np.asarray(self.given, float)


@dataclass(frozen=True, eq=False)
class _Model:
    """A model of an order, its values at the data and its relative misfit."""

    poles: ComplexArray
    system: StateSpace
    fitted: ComplexArray
    misfit: float
    typical: float
    loss: float


def _chosen(data: _Data, orders: Sequence[int], tolerance: float) -> _Model:
    """The simplest that meets the data; with a deviation the one that Schwarz's criterion finds."""
    found: list[_Model] = []
    for n in orders:
        # Where noise misleads AAA, poles that are spread over the data find their way.
        found.append(min((_model(data, p) for p in (_poles_by_aaa(data, n), _spread(data, n))), key=lambda m: m.loss))
        best = min(range(len(found)), key=lambda i: _criterion(data, found[i]))
        if found[-1].misfit <= tolerance or (data.given is not None and len(found) - best > _PATIENCE):
            break
    return min(found, key=lambda m: _criterion(data, m))


def _criterion(data: _Data, model: _Model) -> float:
    """Schwarz's (1978), with two numbers to a pole; without a deviation, the misfit."""
    return model.misfit if data.given is None else model.loss + 2.0 * len(model.poles) * np.log(2.0 * len(data.omega))


def _spread(data: _Data, order: int) -> ComplexArray:
    """Lightly damped pairs, and a real pole for an odd order, evenly over the data."""
    turns = np.geomspace(data.omega[0], data.omega[-1], order // 2 + 2)[1:-1]
    pairs = [z for w in turns for z in (complex(-0.1 * w, w), complex(-0.1 * w, -w))]
    return np.array(pairs + [complex(-np.exp(np.log(data.omega).mean()))] * (order % 2), complex)


def _model(data: _Data, poles: ComplexArray) -> _Model:
    for _ in range(_MOVES):
        poles = _moved(data, poles)
    system = _with_integrators(_realised(data, poles), data.integrators)
    A, B, C, D = system.A, system.B, system.C, system.D
    resolvent = data.s[:, None, None] * np.eye(len(A)) - A
    fitted = (C @ np.linalg.solve(resolvent, B + 0j))[:, 0, 0] + D[0, 0]
    off = np.abs(fitted / data.value - 1.0)
    loss = float(((off / data.deviation) ** 2).sum())
    return _Model(poles, system, fitted, float(off.max()), float(np.sqrt((off**2).mean())), loss)


def _poles_by_aaa(data: _Data, order: int) -> ComplexArray:
    """Poles (order,) to begin with, in conjugate pairs left of the axis."""
    try:
        from scipy.interpolate import AAA
    except ImportError:
        raise EppError("rational_model: this scipy has no AAA; expected scipy 1.15 or newer.") from None
    # Evened by what falls towards high frequencies, so that small values count.
    scale = float(np.exp(np.log(data.omega).mean()))
    H = data.H * (1.0 + data.s / scale) ** data.degree
    both = np.concatenate([data.s, data.s.conj()])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that it does not converge with so few terms: it need not
        found = AAA(both, np.concatenate([H, H.conj()]), max_terms=order + 1, rtol=1e-13, clean_up=False)
    return _paired(np.asarray(found.poles(), complex), order, data.omega)


def _paired(poles: ComplexArray, order: int, omega: Array) -> ComplexArray:
    """As many poles, in pairs, real ones last, all left of the axis; what is missing is spread over the data."""
    poles = poles[np.isfinite(poles)]
    # Poles to the right of the axis are turned over (docs/theory/measured.md, A rational model).
    poles = -np.abs(poles.real) - _DAMPED * np.abs(poles) + 1j * np.abs(poles.imag)
    pairs: list[complex] = []
    real: list[float] = []
    left = sorted(poles, key=lambda p: (abs(p.imag), abs(p)))
    while left:
        p = left.pop()
        mates = [q for q in left if abs(q - p) < 1e-3 * abs(p)]
        if p.imag > 1e-6 * abs(p) and mates and 2 * len(pairs) + 2 <= order:
            left.remove(mates[-1])
            pairs.append(p)
        else:
            real.append(-abs(p))
    real = real[: max(order - 2 * len(pairs), 0)]
    spare = order - 2 * len(pairs) - len(real)
    real += (-np.geomspace(omega[0], omega[-1], spare + 2)[1:-1]).tolist()
    return np.array([z for p in pairs for z in (p, p.conjugate())] + real, complex)


def _real_form(poles: ComplexArray) -> tuple[Array, Array]:
    """A (n, n) and b (n, 1), real, with these poles: a block of two for each pair."""
    blocks, b = [], []
    i = 0
    while i < len(poles):
        p = poles[i]
        if p.imag:
            blocks.append(np.array([[p.real, p.imag], [-p.imag, p.real]]))
            b += [2.0, 0.0]
            i += 2
        else:
            blocks.append(np.array([[p.real]]))
            b.append(1.0)
            i += 1
    return np.asarray(scipy.linalg.block_diag(*blocks), float), np.array(b)[:, None]


def _basis(data: _Data, poles: ComplexArray) -> tuple[Array, Array, ComplexArray]:
    """The real form and its responses ``(s - A)^-1 b``, shape (m, n)."""
    A, b = _real_form(poles)
    responses = np.linalg.solve(data.s[:, None, None] * np.eye(len(A)) - A, b + 0j)[..., 0]
    return A, b, np.asarray(responses, complex)


def _least(rows: NDArray, right: NDArray) -> Array:
    """Real least-squares solution of complex equations, columns scaled."""
    matrix = np.concatenate([rows.real, rows.imag])
    size = np.linalg.norm(matrix, axis=0)
    size = np.where(size > 0, size, 1.0)
    solution = np.linalg.lstsq(matrix / size, np.concatenate([right.real, right.imag]), rcond=None)[0]
    return np.asarray(solution / size, float)


def _moved(data: _Data, poles: ComplexArray) -> ComplexArray:
    """One step of vector fitting: the zeros of the function that makes the data rational with these poles."""
    A, b, basis = _basis(data, poles)
    weight = 1.0 / (np.abs(data.H) * data.deviation)
    H = data.H[:, None]
    straight = np.ones((len(data.s), 0 if data.degree else 1))
    rows = weight[:, None] * np.hstack([basis, straight, -H * basis])
    # The data times sigma = 1 + c (s - A)^-1 b are rational with these poles, so that the poles of the data are the
    # zeros of sigma, the eigenvalues of A - b c (docs/theory/measured.md, A rational model).
    c = _least(rows, weight * data.H)[-len(A) :]
    return _left(np.linalg.eigvals(A - b @ c[None]), data.omega)


def _left(values: NDArray, omega: Array) -> ComplexArray:
    """Eigenvalues of a real matrix in pairs, turned over to the left of the axis, none of them far beyond the data."""
    size = np.clip(np.abs(values), 1e-3 * omega[0], 1e3 * omega[-1])
    values = values / np.where(values == 0, 1.0, np.abs(values)) * size
    values = -np.maximum(np.abs(values.real), _DAMPED * size) + 1j * values.imag
    upper = values[values.imag > 0]
    real = values[values.imag == 0]
    return np.array([z for p in upper for z in (p, p.conjugate())] + real.tolist(), complex)


def _realised(data: _Data, poles: ComplexArray) -> StateSpace:
    """Residues by least squares of relative errors, such that the model falls as the data do."""
    A, b, basis = _basis(data, poles)
    n = len(A)
    weight = 1.0 / (np.abs(data.H) * data.deviation)
    if not data.degree:
        found = _least(weight[:, None] * np.hstack([basis, np.ones((len(data.s), 1))]), weight * data.H)
        return StateSpace(A, b, found[None, :n], found[n:].reshape(1, 1))
    # C b = C A b = ... = 0, as many as the slope at high frequencies says.
    scale = np.abs(poles).max()
    powers = [np.linalg.matrix_power(A / scale, j) @ b for j in range(data.degree - 1)]
    free = scipy.linalg.null_space(np.hstack(powers).T) if powers else np.eye(n)
    c = free @ _least(weight[:, None] * (basis @ free), weight * data.H)
    return StateSpace(A, b, c[None], np.zeros((1, 1)))


def _with_integrators(system: StateSpace, count: int) -> StateSpace:
    """The same with integrators behind it."""
    for _ in range(count):
        n = len(system.A)
        A = np.block([[system.A, np.zeros((n, 1))], [system.C, np.zeros((1, 1))]])
        B = np.vstack([system.B, system.D])
        system = StateSpace(A, B, np.eye(n + 1)[-1:], np.zeros((1, 1)))
    return system
