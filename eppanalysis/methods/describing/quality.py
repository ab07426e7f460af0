"""Stability of a predicted limit cycle (its error estimate is in ``describing_error``)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from eppanalysis.arrays import Array, BoolArray, ComplexArray
from eppanalysis.methods.describing.balance import Balance
from eppanalysis.models.systems.means import equilibrate
from eppanalysis.models.systems.sampled.averaged import AveragedSystem

#: Rates at which perturbations are tried, relative to the frequency of a cycle.
_RATES = np.geomspace(1e-6, 1e3, 126)
#: Growth from sample to sample, as an exponent, that means over samples do not describe. Half a turn is pi.
_BETWEEN_SAMPLES = 10.0


@dataclass(frozen=True, eq=False)
class Point:
    """One limit cycle of the balance with what its checks need (no batch dimension)."""

    #: amplitude, phase, bias: (m,)
    amplitude: Array
    phase: Array
    bias: Array
    omega: float
    #: mean, gain: (nw,)
    mean: Array
    gain: ComplexArray
    #: slopes_of_mean, slopes_of_gain: (nw,): derivatives by ln a, bias and ln omega.
    slopes_of_mean: tuple[Array, ...]
    slopes_of_gain: tuple[ComplexArray, ...]
    residual: float

    def unknowns(self, balance: Balance) -> Array:
        """The vector of unknowns of the balance that it is, shape (3 m + 1,)."""
        one = np.ones(1)
        return balance.pack(self.amplitude[None], self.phase[None], self.bias[None], self.omega * one, one)[0]


def point(balance: Balance, x: Array) -> Point:
    """Everything about one solution vector (3 m + 1,)."""
    X = x[None]
    a, phase, b, omega = balance.unpack(X)
    slopes = balance.slopes(X)
    return Point(
        amplitude=a[0],
        phase=phase[0],
        bias=b[0],
        omega=float(omega[0]),
        mean=slopes.means[0],
        gain=slopes.gains[0],
        slopes_of_mean=tuple(slopes.by_means[:, 0]),
        slopes_of_gain=tuple(slopes.by_gains[:, 0]),
        residual=float(balance.largest_residual(X)[0]),
    )


def growth(balance: Balance, p: Point) -> float | None:
    """Rate mu > 0 [1/s] of a real perturbation ``exp(mu t)`` of all amplitudes, phases and means together, or None.

    Loeb's criterion for several unknowns, of which none leads (Loeb 1956; Gelb and Vander Velde 1968, section 3.3): a
    perturbed phasor passes the linear part at ``j omega + mu``, a perturbed mean at mu. At each such rate the
    determinant of the perturbed balance changes sign; beside an unstable pole a slow cycle may grow far faster than it
    turns.
    """
    rates = p.omega * _RATES
    rates = rates[rates * _sample_time(balance) < _BETWEEN_SAMPLES]
    signs = _perturbation_signs(balance, p, rates)
    change = np.flatnonzero(signs[1:] * signs[:-1] < 0)
    return float(np.sqrt(rates[change[-1]] * rates[change[-1] + 1])) if change.size else None


def _sample_time(balance: Balance) -> float:
    """Longest time between two samples [s]; 0 in continuous time."""
    system = balance.system
    return system.slowest if isinstance(system, AveragedSystem) else float(system.time_step or 0.0)


def _perturbation_signs(balance: Balance, p: Point, rates: Array) -> Array:
    """Sign of the determinant of the perturbed balance, times that of det(mu - A), which takes its poles out."""
    m, system = balance.m, balance.system
    selector = _selector(balance)
    Z = p.amplitude * np.exp(1j * p.phase)
    fast = _linear_at(balance, np.asarray(1j * p.omega + rates, complex))
    slow = _linear_at(balance, rates.astype(complex)).real
    # Gains are analytic in s: to first order a rate of growth is a frequency turned by -j. That holds for slow ones.
    gain = p.gain - 1j * p.slopes_of_gain[2] * np.minimum(rates[:, None] / p.omega, 1.0)
    relative = fast * Z[balance.owner] / Z[:, None]
    in_a = relative @ (selector * (gain + p.slopes_of_gain[0])[..., None]) - np.eye(m)
    in_phase = 1j * (relative @ (selector * gain[..., None]) - np.eye(m))
    in_bias = relative @ (selector * p.slopes_of_gain[1][:, None])
    means = slow @ (selector * p.slopes_of_mean[0][:, None]), slow @ (selector * p.slopes_of_mean[1][:, None])
    top = np.concatenate([in_a, in_phase, in_bias * p.amplitude], axis=-1)
    by_bias = _scaled(means[1], p.amplitude) - np.eye(m)
    static = np.concatenate([means[0] / p.amplitude[:, None], np.zeros(by_bias.shape), by_bias], axis=-1)
    signs = np.linalg.slogdet(np.concatenate([top.real, top.imag, static], axis=-2))[0]
    poles = system.characteristic_matrix(rates).real
    return np.asarray(signs * np.linalg.slogdet(poles)[0] if system.A.size else signs)


def _scaled(matrix: Array, amplitude: Array) -> Array:
    """The same map between biases in units of their amplitudes."""
    return matrix * amplitude[None, :] / amplitude[:, None]


def _linear_at(balance: Balance, s: ComplexArray) -> ComplexArray:
    """Response from all outputs to the first inputs at any complex s (r,), shape (r, m, nw)."""
    return balance.system.response_at(s)[:, balance.rows]


def stability(balance: Balance, p: Point) -> tuple[bool, str]:
    """Verdict and the sentence that says by which criteria."""
    rate = growth(balance, p)
    stable = rate is None
    text = "Loeb's criterion: " + (
        "no perturbation of amplitudes, phases and means together grows"
        if rate is None
        else f"a perturbation of amplitudes, phases and means together grows at {rate:.3g} 1/s"
    )
    others = _other_poles(balance, p)
    if others is not None:
        unstable = others[others.real > 1e-5 * p.omega]
        unstable = unstable.real + 1j * np.abs(unstable.imag)  # of a pair the upper one, whatever rounding says
        stable &= not unstable.size
        text += "; the other poles of the quasi-linear loop are " + (
            f"unstable (at {unstable[np.argmax(unstable.real)]:.4g} 1/s)" if unstable.size else "stable"
        )
    return bool(stable), text + "."


def _other_poles(balance: Balance, p: Point) -> ComplexArray | None:
    """Poles of the loop with each element as a gain, its lead as a rate, its lag as dead time; less the cycle's pair.

    None in discrete time with elements that turn the phase.
    """
    system = balance.system
    turning = np.abs(p.gain.imag) > 1e-9 * np.abs(p.gain)
    poles: ComplexArray
    if system.time_step:
        if np.any(turning):
            return None
        closed = _closed_poles(balance, np.asarray(p.gain.real, float))
        poles = np.asarray(np.log(closed + 1e-300) / system.time_step, complex)
    else:
        poles = _delay_poles(balance, p, turning)
    # The pair next to the axis at the cycle's frequency is the cycle itself, of which Loeb's criterion speaks.
    for target in (1j * p.omega, -1j * p.omega):
        if poles.size:
            poles = np.delete(poles, int(np.argmin(np.abs(poles - target))))
    return poles


def _closed_poles(balance: Balance, gain: Array) -> ComplexArray:
    """Eigenvalues of the state matrix with real gains in place of the elements (no dead time)."""
    system = balance.system
    selector = _selector(balance) * gain[:, None]
    closed = np.linalg.solve(np.eye(balance.m) - system.D[balance.rows] @ selector, system.C[balance.rows])
    return np.asarray(np.linalg.eigvals(system.A + system.B @ selector @ closed), complex)


def _selector(balance: Balance) -> Array:
    return (balance.owner[:, None] == np.arange(balance.m)[None, :]).astype(float)


def _delay_poles(balance: Balance, p: Point, turning: BoolArray) -> ComplexArray:
    """Finite eigenvalues of the descriptor system with dead times as Chebyshev-collocated transport.

    States, in units of omega: x, the inputs z, then for each output its value after the lag of its element, the same
    after the dead time of the loop, and the nodes of both transports.
    """
    system, m, nw = balance.system, balance.m, len(p.gain)
    n = system.A.shape[0]
    lag = np.where(turning & (p.gain.imag < 0), -np.angle(p.gain), 0.0)
    lead = turning & (p.gain.imag >= 0)
    late = [(j, lag[j]) for j in range(nw)], [(j, system.delays[j] * p.omega) for j in range(nw)]
    counts = [[_transport_nodes(angle) for _, angle in group] for group in late]
    size = n + m + 2 * nw + sum(map(sum, counts))
    E, F = np.zeros((size, size)), np.zeros((size, size))
    E[:n, :n] = np.eye(n)
    F[:n, :n] = system.A / p.omega
    x, z, w, v = slice(0, n), slice(n, n + m), slice(n + m, n + m + nw), slice(n + m + nw, n + m + 2 * nw)
    F[x, v] = system.B / p.omega
    F[z, x], F[z, w], F[z, z] = system.C[balance.rows], system.D[balance.rows], -np.eye(m)
    place = n + m + 2 * nw
    for j in range(nw):
        row, source = w.start + j, z.start + balance.owner[j]
        # Before the lag: |N| z with a lag, p z + q dz/dt with a lead.
        proportional = p.gain[j].real if lead[j] or not turning[j] else abs(p.gain[j])
        place = _transport(E, F, row, source, proportional, lag[j], counts[0][j], place)
        if lead[j]:
            E[row, source] -= p.gain[j].imag
        place = _transport(E, F, v.start + j, row, 1.0, late[1][j][1], counts[1][j], place)
    # A factor on each column and row does not move the poles but evens out units.
    values = scipy.linalg.eigvals(*_balanced(F, E))
    # The algebraic equations have poles at infinity, which rounding brings to somewhere far out.
    finite = values[np.isfinite(values)]
    return np.asarray(finite[np.abs(finite) < 1e6] * p.omega, complex)


def _balanced(F: Array, E: Array) -> tuple[Array, Array]:
    row, column = equilibrate(np.abs(F) + np.abs(E))
    return row[:, None] * F * column, row[:, None] * E * column


def _transport_nodes(angle: float) -> int:
    return 0 if angle == 0 else int(8 + 2 * np.ceil(angle))


def _transport(E: Array, F: Array, row: int, source: int, gain: float, angle: float, n_nodes: int, place: int) -> int:
    """Equation ``state[row] = gain * state[source]`` delayed by `angle` [rad of the cycle]; returns the next place."""
    F[row, row] = -1.0
    if not n_nodes:
        F[row, source] = gain
        return place
    theta = np.pi * np.arange(n_nodes + 1) / n_nodes
    nodes = np.cos(theta)
    weight = np.where((np.arange(n_nodes + 1) == 0) | (np.arange(n_nodes + 1) == n_nodes), 2.0, 1.0)
    weight = weight * (-1.0) ** np.arange(n_nodes + 1)
    # Differentiation at Chebyshev's extrema (Trefethen, Spectral Methods in MATLAB, 2000, chapter 6); the diagonal from
    # the sums of rows, so that a constant has no derivative to rounding.
    D = np.outer(weight, 1.0 / weight) / (nodes[:, None] - nodes[None, :] + np.eye(n_nodes + 1))
    D -= np.diag(D.sum(1))
    inner = slice(place, place + n_nodes)
    # Node 0 is the entrance, dy/dt = (2/angle) dy/d(node) inside, the last node is the exit.
    E[inner, inner] = np.eye(n_nodes)
    F[inner, inner] = 2.0 / angle * D[1:, 1:]
    F[inner, source] += 2.0 / angle * D[1:, 0] * gain
    F[row, place + n_nodes - 1] = 1.0
    return place + n_nodes
