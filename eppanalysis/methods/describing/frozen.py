"""The loop cut at one element with all others frozen at their describing functions: a Nyquist plot for any loop.

With several elements there is no single -1/N locus, because the gains of the others change with amplitude too. Frozen
at the amplitudes of one given motion they leave a linear loop G, and that motion is a cycle of the DF just where
G(j omega) meets -1/N of the element at the cut, at the motion's own frequency and amplitude. Away from it the picture
is an approximation, quick enough to follow a slider. At rest the others are as steep as they get, as for the margins.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from eppanalysis.arguments import checked
from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.errors import ModelError
from eppanalysis.methods.describing.balance import Balance, describe, newton
from eppanalysis.methods.describing.search import frequency_scales
from eppanalysis.methods.harmonic.loop import Loop, inputs_of
from eppanalysis.models.systems.absorbed import gain_matrix
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.signals import SignalMap
from eppanalysis.models.systems.subject import CaseLike, PointLike, standing
from eppanalysis.readable import number, percent, words
from eppanalysis.results import LimitCycle, Result
from eppanalysis.results.provenance import Provenance
from eppanalysis.shown import frame_of

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

_POINTS = 400
_ITERATIONS = 15
#: A cycle of the DF at more than this multiple of a motion's frequency, or less than its inverse, is another one.
_FAR = 3.0


@dataclass(frozen=True, eq=False, repr=False)
class FrozenLoop(Result):
    """The loop cut at one element.

    Attributes
    ----------
    element : str
        Where it is cut.
    omega, response : array, shape (n,)
        Frequencies [rad/s], and the response of the rest with negative feedback at them.
    amplitude, locus : array, shape (k,)
        Amplitudes at the element's input, and -1/N there.
    point : complex or None
        -1/N at the amplitude of the motion; None at rest.
    """

    element: str
    omega: Array
    response: ComplexArray
    amplitude: Array
    locus: ComplexArray
    point: complex | None

    @property
    def nearest(self) -> int | None:
        """Index in `omega` at which the response comes nearest to the point of the motion; None at rest."""
        return None if self.point is None else int(np.argmin(np.abs(self.response - self.point)))

    def __str__(self) -> str:
        """Where the loop is cut, and how near the response comes to -1/N of the motion."""
        cut = f"The loop cut at {words(self.element)}, the other elements frozen"
        if self.nearest is None or self.point is None:
            return f"{cut}, at rest: G(jω) on {self.omega.size} frequencies."
        apart = abs(self.response[self.nearest] - self.point) / abs(self.point)
        near, place = percent(max(apart, 1e-4)), number(self.omega[self.nearest] / (2.0 * np.pi))
        return f"{cut}: G(jω) meets -1/N of the motion within {near}, at {place} Hz."

    def to_frame(self) -> pandas.DataFrame:
        """The response over the frequency [rad/s]."""
        parts = zip(self.omega.tolist(), self.response.tolist(), strict=True)
        rows = [{"omega": w, "real_part": g.real, "imaginary_part": g.imag} for w, g in parts]
        return frame_of(rows, {"omega": "rad/s"})

    @checked
    def plot(self, ax: Axes | None = None) -> Axes:
        """G(j omega) and -1/N of the element at the cut; a circle where the motion has -1/N."""
        return self.drawn("plot_frozen", ax)


def with_element_inputs(system: LureSystem, keep: tuple[str, ...]) -> LureSystem:
    """The system with the signals `keep`, and after them the first input of every element, as "input of NAME".

    Raises
    ------
    ModelError
        If a signal of `keep` does not exist.
    """
    old = system.signals
    for name in keep:
        if name not in old.names:
            raise ModelError(f"{system.name}: there is no signal {name!r}", expected=f"one of {', '.join(old.names)}")
    kept = [old.names.index(name) for name in keep]
    rows = [s.start for s in system.input_slices]
    units = old.units or ("",) * len(old.names)
    signals = SignalMap(
        (*keep, *(input_name(name) for name in system.element_names)),
        np.vstack([old.C[kept], system.C[rows]]),
        np.vstack([old.D[kept], system.D[rows]]),
        np.vstack([old.D_input[kept], system.D_input[rows]]),
        np.concatenate([old.constant[kept], system.constant_input[rows]]),
        (*(units[i] for i in kept), *("" for _ in rows)),
        old.time,
    )
    return replace(system, signals=signals)


def input_name(element: str) -> str:
    """What :func:`with_element_inputs` calls the first input of an element."""
    return f"input of {element}"


def nearest_cycle(
    system: LureSystem, phasor: Mapping[str, complex], bias: Mapping[str, float], omega: float, value: Array
) -> tuple[dict[str, float], dict[str, float], float] | None:
    """The cycle of the DF next to a given motion, by Newton's method from it.

    Parameters
    ----------
    phasor, bias : mapping of str to complex, to float
        Fundamental ``c`` of ``Re(c exp(j omega t))`` and mean of the first input of each element, by its name.
    omega : float
        [rad/s].
    value : array, shape (nv,)
        Steady values of the external inputs [SI].

    Returns
    -------
    (amplitude, bias, omega) or None
        None where Newton's method does not converge, or goes far away.
    """
    # From Re(c exp(j omega t)) to the phasors of the balance, which mean Im(P exp(j omega t)).
    z = 1j * np.array([phasor[name] for name in system.element_names])
    if not np.all(np.abs(z) > 0):
        return None
    with np.errstate(all="ignore"):
        try:
            balance = Balance.of(system, 0, value)
        except ModelError:
            return None
        means = np.array([[bias[name] for name in system.element_names]])
        start = balance.pack(np.abs(z)[None], np.angle(z / z[0])[None], means, np.array([omega]), np.ones(1))
        normal = np.zeros_like(start)
        normal[:, -1] = 1.0  # the loop as it is, without a gain in front
        found, done = newton(balance, start, normal, _ITERATIONS)
        if not done[0] or abs(found[0, 1] - start[0, 1]) > np.log(_FAR):
            return None
        a, _, b, w = balance.unpack(found)
    names = system.element_names
    return dict(zip(names, a[0].tolist(), strict=True)), dict(zip(names, b[0].tolist(), strict=True)), float(w[0])


def frozen_nyquist(
    system: LureSystem | CaseLike, cycle: LimitCycle, operating_point: PointLike | None = None
) -> FrozenLoop | None:
    """Nyquist plot of a loop with any number of elements at one of its cycles, the others frozen there.

    Parameters
    ----------
    system : LureSystem or Case
    cycle : LimitCycle
        Where the other elements are frozen. The curves meet in it if it is one of the describing function.
    operating_point : OperatingPoint or mapping of str to float, optional
        Where the external inputs are held, or some of them by name [SI]; by default that of the case or loop.

    Returns
    -------
    FrozenLoop or None
        None where an element has neither a describing function nor a slope.

    Raises
    ------
    ModelError
        If the cycle's signals do not determine the inputs of the elements.

    Examples
    --------
    >>> import numpy as np
    >>> import eppanalysis as epp
    >>> case = epp.case("sat_plus_backlash")
    >>> system = case.to_system()
    >>> cycle = epp.predict_limit_cycles(system)[0]
    >>> picture = epp.frozen_nyquist(system, cycle)
    >>> met = np.interp(cycle.omega, picture.omega, picture.response.real)
    >>> bool(abs(met - picture.point.real) < 1e-3 * abs(picture.point))
    True
    """
    system, at = standing(system, operating_point, "frozen_nyquist")
    loop = Loop.of(system, at.vector(system))
    Z = inputs_of(loop, cycle)
    rows = loop.rows.tolist()
    amplitude, bias = {}, {}
    for name, where in zip(system.element_names, system.input_slices, strict=True):
        found = Z[rows.index(where.start)] if where.start in rows else np.zeros(2, complex)
        amplitude[name], bias[name] = float(abs(found[1])), float(found[0].real)
    return frozen_loop(system, amplitude, bias, cycle.omega)


def frozen_loop(
    system: LureSystem, amplitude: Mapping[str, float], bias: Mapping[str, float], omega: float | None
) -> FrozenLoop | None:
    """Cut the loop at its principal element: the band law, or the first one.

    Parameters
    ----------
    amplitude, bias : mapping of str to float
        Of the first input of each element, by the element's name; where there is no oscillation only the biases count.
    omega : float or None
        Angular frequency of the motion [rad/s]; None at rest.

    Returns
    -------
    FrozenLoop or None
        None where an element has neither a describing function nor a slope.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> loop = epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Relay())
    >>> found = frozen_loop(loop, {"relay": 0.2}, {"relay": 0.0}, 1.4)
    >>> bool(abs(found.point + np.pi * 0.2 / 4) < 1e-12)
    True
    """
    names = system.element_names
    cut = system.principal
    with np.errstate(all="ignore"):
        gains = [
            _frozen(system, i, amplitude[n], bias[n], omega) if i != cut else np.zeros(_shape(system, i), complex)
            for i, n in enumerate(names)
        ]
        if any(g is None for g in gains):
            return None
        nodes = _nodes(system, omega)
        response = _rest(system, cut, [g for g in gains if g is not None], nodes)
        sizes = _amplitudes(system, cut, amplitude[names[cut]] if omega else None)
        gain = describe(
            system.elements[cut], sizes, np.full_like(sizes, bias[names[cut]]), np.full_like(sizes, omega or 1.0)
        )
        locus = -1.0 / gain[1][:, 0]
    used = np.isfinite(locus)
    if not used.any():
        return None
    point = _point(system, cut, amplitude[names[cut]], bias[names[cut]], omega) if omega else None
    made_by = Provenance("describing function, other elements frozen", {"system": system.name, "omega": omega})
    return FrozenLoop(names[cut], nodes, -response, sizes[used], locus[used], point, provenance=made_by)


def _point(system: LureSystem, cut: int, amplitude: float, bias: float, omega: float) -> complex | None:
    """-1/N of the motion; None where the element gives nothing."""
    gain = describe(system.elements[cut], np.array([amplitude]), np.array([bias]), np.array([omega]))[1][0, 0]
    return complex(-1.0 / gain) if np.isfinite(gain) and gain != 0 else None


def _shape(system: LureSystem, i: int) -> tuple[int, int]:
    return system.elements[i].n_outputs, system.elements[i].n_inputs


def _frozen(system: LureSystem, i: int, amplitude: float, bias: float, omega: float | None) -> ComplexArray | None:
    """Gains (n_outputs, n_inputs) of an element in the motion, or its slopes at rest."""
    if omega is None:
        slopes = system.elements[i].linear_gain()
        return np.asarray(slopes + 0.0j, complex) if np.all(np.isfinite(slopes)) else None
    if not amplitude > 0:
        return np.zeros(_shape(system, i), complex)
    gain = describe(system.elements[i], np.array([amplitude]), np.array([bias]), np.array([omega]))[1][0]
    found = np.zeros(_shape(system, i), complex)
    found[:, 0] = gain
    return found if np.all(np.isfinite(found)) else None


def _rest(system: LureSystem, cut: int, gains: list[ComplexArray], omega: Array) -> ComplexArray:
    """Response from the output of the element at the cut to its input, the other elements being gains."""
    K = gain_matrix(system, dict(enumerate(gains)))
    L = system.frequency_response(omega)
    # K is zero at the cut: what is closed are the loops of the others around it.
    closed = np.linalg.solve(np.eye(K.shape[1]) - L @ K, L[:, :, [system.output_slices[cut].start]])
    return np.asarray(closed[:, system.input_slices[cut].start, 0], complex)


def _nodes(system: LureSystem, omega: float | None) -> Array:
    """Frequencies round the poles of the linear part and round the motion's own."""
    scales = frequency_scales(system)
    scales = np.append(scales[scales > 0], [omega] if omega else [])
    low, high = (scales.min() / 30, scales.max() * 30) if scales.size else (1e-2, 1e2)
    if system.time_step:
        high = min(high, np.pi / system.time_step)
    near = omega * np.geomspace(0.5, 2.0, 101) if omega else np.zeros(0)
    return np.unique(np.concatenate([np.geomspace(low, high, _POINTS), near[near <= high]]))


def _amplitudes(system: LureSystem, cut: int, centre: float | None) -> Array:
    """Amplitudes round the motion's own and just above every threshold, where the locus moves fast."""
    thresholds = np.abs(np.asarray(system.elements[cut].thresholds(), float)).ravel()
    thresholds = thresholds[thresholds > 0][:20]
    middle = [centre] if centre else [*thresholds] or [1.0]
    above = thresholds[:, None] * (1.0 + np.geomspace(1e-6, 0.3, 40))
    return np.unique(np.concatenate([np.geomspace(min(middle) / 30, max(middle) * 30, _POINTS), above.ravel()]))
