"""State space of linear blocks, and the border to python-control."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eppanalysis.arguments import ORDINARY, are_ordinary, floats, is_number
from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.engine.balances import even_out
from eppanalysis.errors import ModelError, shown
from eppanalysis.foreign import line_for
from eppanalysis.models.systems.own_states import diagonal

#: What is smaller than this share of the terms that it is made of is rounding: a realisation in other coordinates
#: (rotated, balanced, identified) has such remainders where another one has zeros.
ROUNDING = 1e-13
#: What leads from state to state beside a state matrix: array (n, m) to the state rate, the outputs and inputs of each
#: element, array (k, n) from the state.
Around = tuple[Array, list[tuple[int, int]], Array]
#: Share of the fastest pole below which one is taken for that of an integrator.
_SLOW = 1e-9


@dataclass(frozen=True, eq=False)
class StateSpace:
    """``dx/dt = A x + B u, y = C x + D u`` (or its discrete-time form when `time_step` is set).

    Parameters
    ----------
    A, B, C, D : array_like, shapes (n, n), (n, nu), (ny, n), (ny, nu)
        Of n states, nu inputs and ny outputs; n may be zero.
    time_step : float, optional
        Sample time of a system in discrete time [s].

    Raises
    ------
    ModelError
        If shapes do not fit or a number is not finite.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> plant = epp.StateSpace([[-1.0]], [[1.0]], [[2.0]], [[0.0]])
    >>> epp.LureSystem.from_tf(plant, epp.Saturation()).A.tolist()
    [[-1.0]]
    """

    A: Array
    B: Array
    C: Array
    D: Array
    time_step: float | None = None

    def __post_init__(self) -> None:
        A, B, C, D = (floats(getattr(self, name), f"StateSpace: {name}") for name in "ABCD")
        n, inputs, outputs = A.shape[0] if A.ndim == 2 else -1, B.shape[-1:], C.shape[:1]
        shapes = {"A": (n, n), "B": (n, *inputs), "C": (*outputs, n), "D": (*outputs, *inputs)}
        for (name, shape), given in zip(shapes.items(), (A, B, C, D), strict=True):
            if given.shape != shape:
                found = f"StateSpace: {name} has shape {given.shape}"
                wanted = (
                    f"n by n, n by m, p by n, p by m: {name} {' by '.join(map(str, shape))}" if n >= 0 else "n by n"
                )
                raise ModelError(found, expected=wanted, field=name)
            object.__setattr__(self, name, given)
        step = self.time_step
        if step is not None and not (is_number(step) and step > 0):
            raise ModelError("StateSpace", step, "a positive number or None", field="time_step")


def as_state_space(plant: Any, time_step: float | None = None) -> StateSpace:
    """State space of a transfer function, a system of python-control or scipy, or a (numerator, denominator) pair.

    Parameters
    ----------
    plant : StateSpace, control.LTI, scipy.signal.lti, scipy.signal.dlti, sympy.Expr or (array_like, array_like)
        Single input, single output. A sympy expression is a quotient of polynomials of s; sympy's own transfer
        functions are taken, too.
    time_step : float, optional
        Sample time of a (numerator, denominator) pair in discrete time [s].

    Raises
    ------
    ModelError
        If the system is improper, not single-input single-output, or holds a number that is not finite.
    """
    if isinstance(plant, StateSpace):
        if plant.D.shape != (1, 1):
            raise ModelError("The linear part has several inputs or outputs", expected="one of each")
        return plant
    if isinstance(plant, tuple) and len(plant) == 2:
        return transfer_function(plant[0], plant[1], time_step)
    if type(plant).__module__.startswith("sympy."):
        return transfer_function(*_of_sympy(plant))
    if type(plant).__module__.startswith("scipy.") and (hasattr(plant, "gain") or hasattr(plant, "num")):
        ratio = plant.to_tf()  # of zeros, poles and a gain, too
        return transfer_function(_only_row(ratio.num), ratio.den, sample_time(ratio))
    if hasattr(plant, "num") and hasattr(plant, "den"):
        if plant.ninputs != 1 or plant.noutputs != 1:
            raise ModelError("The linear part has several inputs or outputs", expected="one of each")
        return transfer_function(plant.num[0][0], plant.den[0][0], sample_time(plant))
    if hasattr(plant, "A") and hasattr(plant, "D"):
        found = state_space_of(plant)
        if found.D.shape != (1, 1):
            raise ModelError("The linear part has several inputs or outputs", expected="one of each")
        return found
    expected = line_for(plant) or "a transfer function or a state space"
    raise ModelError(f"A {type(plant).__name__} is not a linear block", expected=expected)


def is_linear(given: Any) -> bool:
    """Whether something is a linear system of python-control, scipy or sympy, or a state space."""
    foreign = type(given).__module__.startswith(("control.", "scipy.signal.", "sympy."))
    has = (hasattr(given, "A") and hasattr(given, "D")) or hasattr(given, "num") or hasattr(given, "free_symbols")
    return isinstance(given, StateSpace) or (foreign and has)


def state_space_of(system: Any) -> StateSpace:
    """State space of a system that has matrices, of any number of inputs and outputs."""
    return StateSpace(system.A, system.B, system.C, system.D, sample_time(system))


def transfer_function(numerator: ArrayLike, denominator: ArrayLike, time_step: float | None = None) -> StateSpace:
    """State space of ``numerator/denominator`` (descending powers), in a controllable form scaled to its own frequency.

    The companion form of a plant with poles near ``w0`` has entries like ``w0**n``; scaling time by ``w0`` first keeps
    them near one, so that results do not depend on the unit of time.
    """
    num, den = floats(numerator, "numerator", ndmin=1), floats(denominator, "denominator", ndmin=1)
    for name, row in (("numerator", num), ("denominator", den)):
        if row.ndim != 1:
            found = f"The {name} of a transfer function has shape {row.shape}"
            raise ModelError(found, expected="a row of coefficients")
    num, den = np.trim_zeros(num, "f"), np.trim_zeros(den, "f")
    if not (np.all(np.isfinite(num)) and np.all(np.isfinite(den))):
        raise ModelError("A transfer function holds a coefficient that is not finite.")
    if den.size == 0:
        what, expected = "A transfer function has a denominator of zero", "a coefficient other than zero"
        raise ModelError(what, expected=expected, field="den")
    if num.size > den.size:
        raise ModelError(
            f"A transfer function is improper: its numerator has degree {num.size - 1}, its denominator {den.size - 1}",
            expected=f"at most the degree of the denominator, {den.size - 1}",
            field="num",
        )
    n = den.size - 1
    with np.errstate(all="ignore"):  # refused below
        num = np.concatenate([np.zeros(n + 1 - num.size), num]) / den[0]
        den = den / den[0]
        powers = np.arange(1, n + 1)
        sizes = np.abs(den[1:]) ** (1.0 / powers)
        # All poles lie within twice the largest of these (Fujiwara's bound).
        w0 = float(sizes.max()) if n and time_step is None and sizes.max() > 0 else 1.0
        a = den[1:] / w0**powers
        b = (num[1:] - num[0] * den[1:]) / w0**powers
    if not are_ordinary([w0, num[0], np.abs(b).max(initial=0.0)]):
        raise ModelError("A transfer function has a gain or a pole out of range", expected=ORDINARY)
    D = num[:1].reshape(1, 1)
    if n == 0:
        return StateSpace(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), D, time_step)
    A = np.eye(n, k=-1)
    A[0] = -a
    B = np.zeros((n, 1))
    B[0, 0] = 1.0
    return StateSpace(w0 * A, w0 * B, b.reshape(1, n), D, time_step)


def _of_sympy(plant: Any) -> tuple[list[float], list[float], float | None]:
    """Numerator, denominator and sample time of a quotient of polynomials of s, or of sympy's transfer function."""
    import sympy

    variable = getattr(plant, "var", sympy.Symbol("s"))
    quotient = sympy.together(plant.num / plant.den if hasattr(plant, "var") else plant)
    # A symbol of its own name is another one to sympy where one of them is called positive, say.
    same = {symbol: variable for symbol in quotient.free_symbols if str(symbol) == str(variable)}
    try:
        parts = sympy.fraction(quotient.subs(same))
        num, den = ([float(c) for c in sympy.Poly(part, variable).all_coeffs()] for part in parts)
    except (TypeError, ValueError, sympy.PolynomialError):
        expected = f"a quotient of polynomials of {variable} with numbers in it; a dead time by `delay`, not by exp"
        raise ModelError(f"The transfer function {shown(str(plant))}", expected=expected) from None
    step = getattr(plant, "sampling_time", None)
    return num, den, None if step is None else float(step)


def _only_row(numerator: Array) -> Array:
    """Coefficients of a numerator of scipy, which has a row for each output where there are several."""
    if np.ndim(numerator) > 1 and len(numerator) != 1:
        raise ModelError("The linear part has several inputs or outputs", expected="one of each")
    return np.asarray(numerator, float).ravel()


def sample_time(plant: Any) -> float | None:
    """Sample time of a system of python-control or scipy [s]; None in continuous time."""
    dt = getattr(plant, "dt", None)
    # True means "discrete, no time given"; note that 1.0 == True.
    return None if dt is None or dt == 0 else float(dt)


def poles(A: Array, rounding: float | None = None) -> ComplexArray:
    """Eigenvalues of a state matrix, those at zero exactly zero whatever the coordinates of the state.

    Parameters
    ----------
    A : array, shape (n, n)
    rounding : float, optional
        See :func:`integrators_apart`.

    Returns
    -------
    array, shape (n,)
        In the unit of `A`, zeros last.

    Examples
    --------
    >>> import numpy as np
    >>> Q = np.linalg.qr(np.arange(9.0).reshape(3, 3) % 5 + np.eye(3))[0]
    >>> np.abs(poles(Q @ np.diag([1.0, 1.0], 1) @ Q.T)).tolist()
    [0.0, 0.0, 0.0]
    """
    rest = balanced(A)[0] if rounding is None and A.size else A
    apart, _, k = integrators_apart(rest, rounding)
    out = np.zeros(len(A), complex)
    out[:k] = np.linalg.eigvals(apart[:k, :k])
    return out


def balanced(A: Array) -> tuple[Array, Array]:
    """A state matrix in units of its states that make rows and columns alike, and these units, shape (n,)."""
    even_out(out := np.array(np.asarray_chkfinite(A), float, order="C"), units := np.empty(len(A)))
    return out, units


def integrators_apart(A: Array, rounding: float | None = None) -> tuple[Array, Array, int]:
    """Orthogonal coordinates in which the integrators of a state matrix show as rows of zeros.

    An integrator is an eigenvalue of zero, and a chain of k of them comes out of a QR iteration at the k-th root of
    rounding errors. So the directions into which nothing flows are taken off first, one link of all chains at a time.

    Parameters
    ----------
    A : array, shape (n, n)
    rounding : float, optional
        Singular values below are zero; by default a share of the matrix's norm.

    Returns
    -------
    (A', Q, k) : array (n, n), array (n, n), int
        ``A' = Q' A Q``; its first k rows and columns hold all other eigenvalues, and below them it is zero up to the
        block above the diagonal with which integrators feed each other.
    """
    apart, Q, k = A.copy(), np.eye(len(A)), len(A)
    least = np.linalg.norm(A) * ROUNDING if rounding is None else rounding
    while k:
        U, s, _ = np.linalg.svd(apart[:k, :k])
        rank = int(np.sum(s > least))
        if rank == k:
            break
        turn = np.eye(len(A))
        turn[:k, :k] = U
        apart, Q = turn.T @ apart @ turn, Q @ turn
        # Into the directions of the last left singular vectors nothing flows but rounding.
        apart[rank:k, :k] = 0.0
        k = rank
    return apart, Q, k


def units_of_states(A: Array, around: Around) -> Array:
    """Units of the states that make all that leads from state to state alike, shape (n,).

    Parameters
    ----------
    A : array, shape (n, n)
    around : Around
        Parts that only this connects would otherwise be counted in units that have nothing to do with one another.
    """
    (B, sizes, C), n = around, len(A)
    k = n + B.shape[1]
    whole = np.zeros((k + len(C),) * 2)
    whole[:n, :n], whole[:n, n:k], whole[k:, :n] = A, B, C
    whole[n:k, k:] = diagonal([np.ones(size) for size in sizes])
    return balanced(whole)[1][:n]


def coordinates_with_integrators_apart(
    A: Array, *, discrete: bool, around: Around | None = None
) -> tuple[Array, Array, Array] | None:
    """A state matrix in coordinates in which its integrators show as rows of zeros (of the unit matrix where discrete).

    Parameters
    ----------
    A : array, shape (n, n)
    discrete : bool
        An integrator has its pole at one then.
    around : Around, optional
        Coordinates across parts that only this connects would otherwise lose what passes from one to the other.

    Returns
    -------
    (A', T, inverse) or None : array, shape (n, n), each
        ``A' = inverse A T``; None where they show already.
    """
    n = len(A)
    unit = np.eye(n) if discrete else np.zeros((n, n))
    if not n:
        return None
    size = balanced(A - unit)[1] if around is None else units_of_states(A - unit, around)
    even = (A - unit) * size / size[:, None]
    # In discrete time the entries of A are near one, so that their rounding does not shrink with the sample time.
    rounding = max(ROUNDING * float(np.linalg.norm(even)), 4 * n * np.finfo(float).eps) if discrete else None
    apart, Q, k = integrators_apart(even, rounding)
    if n - k <= int(np.sum(np.linalg.eigvals(A - unit) == 0)):
        return None
    return apart + unit, size[:, None] * Q, Q.T / size


@np.errstate(over="ignore", invalid="ignore")  # of numbers beyond all range nothing is found
def zeros(A: Array, B: Array, C: Array, D: Array) -> ComplexArray:
    """Finite zeros of ``C (s - A)^-1 B + D`` from one input to one output, whatever the coordinates of the state.

    While nothing passes straight through, an output that stays zero keeps the state within the null space of C, and
    its rate is the output of a smaller system with the same zeros (Emami-Naeini and Van Dooren 1982). The number of
    these steps is the relative degree; whether something passes is judged against the terms of which it is made.

    Parameters
    ----------
    A, B, C, D : array, shapes (n, n), (n, 1), (1, n), (1, 1)

    Returns
    -------
    array, shape (n - relative degree,)
        Empty where nothing of the input reaches the output at all.
    """
    n = len(A)
    both = np.zeros((n + 1, n + 1))
    both[:n, :n], both[:n, n:], both[n:, :n] = A, B, C
    both = balanced(both)[0]
    A, b, c, d = both[:n, :n], both[:n, n], both[n, :n], float(D[0, 0])
    size = _Sizes(np.abs(A), np.abs(b), np.abs(c), float(np.linalg.norm(A)), float(np.linalg.norm(c)))
    least = ROUNDING * abs(d)
    # What c and b were last made up of: in turned states entries are known to rounding of these, not of their own size.
    into, out = np.abs(b), np.abs(c)
    while abs(d) <= least:
        if not len(A) or np.linalg.norm(c) <= ROUNDING * size.of_c:
            return np.zeros(0, complex)
        N = np.linalg.qr(c[:, None], mode="complete")[0][:, 1:]
        # Remainders in N would count among the terms by whose size the next output is judged.
        N[np.abs(N) < ROUNDING] = 0.0
        terms = float(np.linalg.norm(out) * np.linalg.norm(into))
        least = max(ROUNDING * size.through(b), 8.0 * n * np.finfo(float).eps * terms)
        into, out = np.abs(N).T @ np.abs(b), np.abs(c) @ np.abs(A) @ np.abs(N)
        d, c, b = float(c @ b), c @ A @ N, N.T @ b
        A, size = N.T @ A @ N, size.within(np.abs(N))
    spread = size.a + float(np.linalg.norm(b)) * size.of_c / abs(d)
    return poles(A - np.outer(b, c) / d, ROUNDING * spread)


@dataclass(frozen=True, eq=False)
class _Sizes:
    """Sizes of the terms that make up A, b and c: entry by entry, and by norms, which rotations do not blow up."""

    A: Array
    b: Array
    c: Array
    a: float
    of_c: float

    def through(self, b: Array) -> float:
        """Size of the terms in ``c b``."""
        return min(float(self.c @ self.b), self.of_c * float(np.linalg.norm(b)))

    def within(self, N: Array) -> _Sizes:
        """The same for ``N' A N``, ``N' b`` and ``c A N``."""
        return _Sizes(N.T @ self.A @ N, N.T @ self.b, self.c @ self.A @ N, self.a, self.of_c * self.a)


def slowest_pole(A: Array) -> float:
    """Size of the slowest pole of a state matrix that is none of an integrator [1/s]; zero for integrators alone.

    Examples
    --------
    >>> slowest_pole(np.diag([-3.0, -2.0, 0.0]))
    2.0
    """
    rates = np.abs(poles(A))
    return float(rates[rates > _SLOW * rates.max(initial=0.0)].min(initial=np.inf)) if np.any(rates) else 0.0


def fastest_poles(A: Array) -> Array:
    """Size of the fastest pole of each state matrix [1/s]; exactly zero for integrators alone.

    Parameters
    ----------
    A : array, shape (k, n, n)

    Returns
    -------
    array, shape (k,)
    """
    n = A.shape[-1]
    fastest = np.abs(np.linalg.eigvals(A)).max(-1, initial=0.0)
    # A chain of n integrators alone shows in other coordinates as poles at the n-th root of rounding.
    shown = np.linalg.norm(A, axis=(-2, -1)) * (10.0 * n * np.finfo(float).eps) ** (1.0 / max(n, 1))
    for i in np.flatnonzero((fastest > 0) & (fastest < shown)):
        fastest[i] = np.abs(poles(A[i])).max()
    return np.asarray(fastest)


def solved(resolvent: ComplexArray, right: NDArray[Any]) -> NDArray[Any]:
    """``(s - A)^-1`` times a matrix, for many s; for one that is a pole to the last bit, a rounding beside it."""
    try:
        return np.linalg.solve(resolvent, right)
    except np.linalg.LinAlgError:
        size = np.abs(resolvent).max(axis=(-2, -1), keepdims=True)
        beside = 1j * np.finfo(float).eps * np.where(size > 0, size, 1.0)
        return np.linalg.solve(resolvent + beside * np.eye(resolvent.shape[-1]), right)
