"""Pictures of the documentation, made from the package itself: ``python -m studies.pages.figures``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

import eppanalysis as epp
from eppanalysis.plotting import BLUE, GREEN, GREY, VERMILLION, figure_of_height, legend_below
from studies import GENERATED
from studies.first_order_tables import first_order_errors
from studies.pages.cycles import elbow_basins, elbow_branch
from studies.pages.driven import clamped_pid, dithered_relay, jump_resonance, three_responses
from studies.pages.harmonic import harmonic_convergence

Array = NDArray[np.float64]

#: Thick lines first, so that curves that coincide in part are all seen.
STYLES = ((BLUE, 2.6), (VERMILLION, 1.5), (GREEN, 0.9))


@dataclass(frozen=True)
class Drawing:
    """An element (or several, for comparison) in time and as a describing function.

    Attributes
    ----------
    elements : dict
        By the label in the legend.
    amplitude : float
        Of the sine in the left panel.
    largest : float
        Amplitude to which the describing function is drawn.
    omega : float
        Angular frequency [rad/s], for elements whose describing function depends on it.
    bias : float
        Of the sine, in both panels.
    names : tuple of str
        Input and output with their units.
    """

    elements: dict[str, epp.Nonlinearity]
    amplitude: float
    largest: float
    omega: float = 1.0
    bias: float = 0.0
    names: tuple[str, str] = ("input x", "output y")


#: Points of a valve's curve.
_VALVE = ([-1.0, -0.4, -0.1, 0.1, 0.4, 1.0], [-1.0, -0.7, 0.0, 0.0, 0.7, 1.0])


def drawings() -> dict[str, Drawing]:
    """All pictures of elements, by file name."""
    lbf, degree = 4.4482216152605, np.pi / 180.0
    bands = {"slack": 1.25 * lbf, "low": 2.4 * lbf, "high": 2.6 * lbf, "max": 3.75 * lbf, "supply_voltage": 16.0}
    pin = {"gap": 2.5 * degree, "stiffness": 1000.0, "damping": 3.0}
    slow = {"damping": 40.0}
    cable = {"harness_stiffness": 8381.6, "forearm_stiffness": 33526.3, "friction": 0.0447}
    return {
        "saturation": Drawing({"symmetric": epp.Saturation(), "upper limit 0.5": epp.Saturation(upper=0.5)}, 2.0, 6.0),
        "dead_zone": Drawing({"symmetric": epp.DeadZone(), "from -1 to 0.5": epp.DeadZone(upper=0.5)}, 2.0, 6.0),
        "relay": Drawing({"relay": epp.Relay(), "preload, slope 0.5": epp.Preload(level=1.0, slope=0.5)}, 1.5, 4.0),
        "dead_zone_saturation": Drawing(
            {"dead zone 1, limited from 1.5": epp.DeadZoneSaturation(dead_zone=1.0, slope=4.0, limit=2.0)}, 3.0, 8.0
        ),
        "relay_dead_zone": Drawing({"threshold 1": epp.RelayDeadZone(threshold=1.0)}, 2.0, 6.0),
        "quantiser": Drawing({"step 1": epp.Quantiser(step=1.0, levels=20)}, 3.2, 6.0),
        "monotone_table": Drawing(
            {
                "monotone cubics": epp.MonotoneTable(*_VALVE, "hold"),
                "straight lines": epp.LookupTable(*_VALVE, "hold"),
            },
            1.6,
            3.0,
        ),
        "five_band_law": Drawing(
            {
                "symmetric": epp.FiveBandLaw(**bands),
                "wide upper band": epp.FiveBandLaw(**{**bands, "max": 5.5 * lbf}),
                "offset voltage 2 V": epp.FiveBandLaw(**bands, offset_voltage=2.0),
            },
            10.0,
            30.0,
            bias=2.5 * lbf,
            names=("force [N]", "voltage [V]"),
        ),
        "hysteresis_relay": Drawing({"thresholds -0.5, 0.5": epp.HysteresisRelay(lower=-0.5, upper=0.5)}, 1.5, 4.0),
        "hysteresis_relay_dead_zone": Drawing(
            {"on 1, off 0.6": epp.HysteresisRelayDeadZone(on=1.0, off=0.6)}, 1.5, 4.0
        ),
        "backlash_compensator": Drawing(
            {"gap 1": epp.BacklashCompensator(1.0), "gap 1, travel 0.6": epp.BacklashCompensator(1.0, 0.6)}, 1.5, 4.0
        ),
        "dahl": Drawing(
            {"1 N/mm": epp.DahlFriction(1e3, 1.0), "10 N/mm": epp.DahlFriction(1e4, 1.0)},
            0.005,
            0.05,
            omega=2.0,
            names=("velocity [m/s]", "force [N]"),
        ),
        "bouc_wen": Drawing(
            {f"gamma = {g:g} / mm": epp.BoucWen(1e3, 1e3, 1e3 * g) for g in (-0.5, 0.0, 1.0)},
            0.005,
            0.05,
            omega=2.0,
            names=("velocity [m/s]", "force [N]"),
        ),
        "lugre": Drawing(
            {
                "1 N/mm": epp.LuGreFriction(1e3, 1.0, 1.5, 1e-3),
                "10 N/mm": epp.LuGreFriction(1e4, 1.0, 1.5, 1e-3),
            },
            0.005,
            0.05,
            omega=2.0,
            names=("velocity [m/s]", "force [N]"),
        ),
        "friction_compensator": Drawing(
            {"jump": epp.FrictionCompensator(1.0), "ramp of 0.3": epp.FrictionCompensator(1.0, 0.3)},
            1.5,
            4.0,
            names=("velocity [m/s]", "force [N]"),
        ),
        "play": Drawing({"gap 1": epp.Play(gap=1.0)}, 1.5, 4.0),
        "prandtl_ishlinskii": Drawing(
            {"four plays": epp.PrandtlIshlinskii([0.1, 0.2, 0.4, 0.8], [0.3, 0.2, 0.2, 0.1], straight=0.5)}, 1.5, 4.0
        ),
        "jump_and_follow": Drawing(
            {f"S = 1, J = {jump:g}": epp.JumpAndFollow(stick_band=1.0, slip_jump=jump) for jump in (0.0, 0.5, 1.0)},
            1.5,
            4.0,
        ),
        "stiction_pulley": Drawing(
            {f"kinetic ratio {k:g}": epp.StictionPulley(**cable, kinetic_ratio=k) for k in (1.0, 0.6)},
            4e-4,
            2e-3,
            bias=1.66e-3,
            names=("cable stretch [m]", "sensor force [N]"),
        ),
        "friction": Drawing(
            {
                "Coulomb": epp.Friction(coulomb=1.0),
                "falling with speed": epp.Friction(coulomb=1.0, static=1.0, stribeck=3.0),
            },
            1.5,
            4.0,
            names=("velocity [m/s]", "force [N]"),
        ),
        "powers": Drawing(
            {
                "sine": epp.Sine(1.0),
                "cube / 6": epp.Cube(1.0 / 6.0),
                "polynomial: the sine up to the fifth power": epp.Polynomial([0.0, 1.0, 0.0, -1.0 / 6, 0.0, 1.0 / 120]),
            },
            3.0,
            3.5,
        ),
        "smooth_curves": Drawing(
            {"tanh": epp.Tanh(level=1.0), "arctan": epp.Arctan(level=1.0), "drag": epp.Drag(scale=0.2)}, 3.0, 6.0
        ),
        "stribeck": Drawing(
            {
                "viscous and Coulomb": epp.ViscousCoulomb(coulomb=0.6, viscous=0.3),
                "Stribeck": epp.StribeckFriction(coulomb=0.6, static=1.2, velocity=0.3, viscous=0.3),
            },
            1.5,
            4.0,
            names=("velocity [m/s]", "force [N]"),
        ),
        "bilinear_spring": Drawing(
            {
                "freeplay with a slope inside": epp.BilinearSpring(lower=-1.0, upper=1.0, outer=1.0, inner=0.2),
                "from -0.5 to 1, preload 0.3": epp.BilinearSpring(lower=-0.5, upper=1.0, outer=1.0, preload=0.3),
            },
            2.0,
            6.0,
        ),
        "quantisers": Drawing(
            {"rounds down": epp.FloorQuantiser(1.0, 20), "step at zero": epp.MidRiseQuantiser(1.0, 20)}, 3.2, 6.0
        ),
        "rate_limiter": Drawing(
            {
                "rate limiter": epp.RateLimiter(rate=1.0),
                "servo of 5 rad/s": epp.RateLimitedServo(bandwidth=5.0, rate=1.0),
            },
            1.5,
            4.0,
        ),
        "reset": Drawing(
            {
                "Clegg's integrator": epp.CleggIntegrator(gain=1.0),
                "first order, pole 1 rad/s": epp.FirstOrderReset(pole=1.0, gain=1.0),
            },
            1.5,
            4.0,
        ),
        "nordin_shaft": Drawing(
            {"damped shaft": epp.NordinShaft(**pin | slow), "contact only pushes": epp.LockPin(**pin | slow)},
            1.6 * degree,
            5.0 * degree,
            omega=60.0,
            names=("twist [rad]", "torque [N·m]"),
        ),
        "lock_pin": Drawing(
            {
                "contact only pushes": epp.LockPin(**pin),
                "classical": epp.LockPin(**pin, model="classical"),
            },
            1.6 * degree,
            5.0 * degree,
            omega=60.0,
            names=("twist [rad]", "torque [N·m]"),
        ),
    }


def loop_of(element: epp.Nonlinearity, drawing: Drawing, n: int = 4000) -> tuple[Array, Array]:
    """One steady period of input and (first) output, by stepping the element's own map along the sine."""
    if element.inside is not None:
        return _loop_of_states(element, drawing, n)
    if isinstance(element, epp.NordinShaft):
        return _loop_of_contact(element, drawing, n)
    phase = np.linspace(0.0, 4.0 * np.pi, 2 * n + 1)
    x = drawing.bias + drawing.amplitude * np.sin(phase)
    rate = drawing.amplitude * drawing.omega * np.cos(phase)
    y = np.empty_like(x)
    memory: Any = None
    for i in range(x.size):
        given = x[i] if element.n_inputs == 1 else (x[i], rate[i])
        value, memory = element.output(given, memory)
        y[i] = np.atleast_1d(value)[0]
    return x[n:], y[n:]


def _loop_of_states(element: epp.Nonlinearity, drawing: Drawing, n: int) -> tuple[Array, Array]:
    """The same of an element that is a system of its own, from a run: it has settled after a few periods."""
    alone = epp.LureSystem.build(
        np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), [element], D_input=[[1.0]], input_names=["x"]
    )
    period = 2.0 * np.pi / drawing.omega
    times = period * (5.0 + np.linspace(0.0, 1.0, n + 1))
    run = epp.simulate(alone, epp.inputs.Sine(drawing.amplitude, 1.0 / period), t_end=float(times[-1]), t_eval=times)
    return drawing.amplitude * np.sin(drawing.omega * times), run.signals[alone.signals.names[1]]


def _loop_of_contact(shaft: epp.NordinShaft, drawing: Drawing, n: int) -> tuple[Array, Array]:
    """The same of a shaft whose twist is that of an oscillator: its contact angle has settled after a few periods."""
    A, B = np.zeros((3, 3)), np.array([[0.0, 0.0], [0.0, 0.0], [0.0, 1.0]])
    A[0, 1], A[1, 0] = drawing.omega, -drawing.omega
    C = np.array([[1.0, 0.0, 0.0], [0.0, drawing.omega, 0.0], [0.0, 0.0, 1.0]])
    turning = epp.LureSystem.build(A, B, C, [shaft], x0=[0.0, drawing.amplitude, 0.0])
    times = 2.0 * np.pi / drawing.omega * (5.0 + np.linspace(0.0, 1.0, n + 1))
    run = epp.simulate(turning, t_end=float(times[-1]), t_eval=times)
    return drawing.amplitude * np.sin(drawing.omega * times), run.signals[turning.signals.names[1]]


#: Numbers on an axis shorter than this are so wide that few stand side by side.
_WIDE_NUMBERS = 0.1


def draw_element(drawing: Drawing) -> Figure:
    """Map under a sine on the left; real and imaginary part of the describing function on the right."""
    figure = figure_of_height(2.9 + 0.15 * len(drawing.elements))
    left, right = figure.subplots(1, 2)
    amplitude = np.linspace(0.0, drawing.largest, 802)[1:]
    for (colour, width), (label, element) in zip(STYLES, drawing.elements.items(), strict=False):
        width = width if len(drawing.elements) > 1 else 1.3
        # Closed, for a reset makes a jump where the period ends.
        x, y = (np.append(values, values[0]) for values in loop_of(element, drawing))
        left.plot(x, y, color=colour, linewidth=width, label=label)
        _, gain = element.describing_function(amplitude, drawing.bias, drawing.omega)
        gain = gain[..., 0] if element.n_outputs > 1 else gain
        right.plot(amplitude, gain.real, color=colour, linewidth=width)
        if np.nanmax(np.abs(gain.imag)) > 0:
            right.plot(amplitude, gain.imag, color=colour, linewidth=width, linestyle="--")
    left.set_xlabel(drawing.names[0])
    left.set_ylabel(drawing.names[1])
    right.set_xlabel("amplitude a" + drawing.names[0][drawing.names[0].find(" [") :] * ("[" in drawing.names[0]))
    right.set_ylabel("describing function N")
    for ax in (left, right):
        ax.locator_params(axis="x", nbins=5 if np.ptp(ax.get_xlim()) > _WIDE_NUMBERS else 3)
    _limit_poles(right)
    for ax in (left, right):
        ax.axhline(0.0, color=GREY, linewidth=0.5)
        ax.spines[["top", "right"]].set_visible(False)
    if any(line.get_linestyle() == "--" for line in right.lines):
        for part, style in (("real part", "-"), ("imaginary part", "--")):
            right.plot([], [], color="black", linestyle=style, label=part)
    legend_below(figure, left, right)
    return figure


def _limit_poles(ax: Axes) -> None:
    """Cut a describing function that grows without bound, or far, towards small amplitudes (relays, stiff bristles)."""
    values = np.concatenate([np.asarray(line.get_ydata(), float) for line in ax.lines])
    values = values[np.isfinite(values)]
    top = float(np.quantile(np.abs(values), 0.97))
    if np.abs(values).max() > 3.0 * top:
        low, high = ax.set_ylim(max(1.1 * values.min(initial=0.0), -1.3 * top), 1.3 * top)
        for line in ax.lines:  # one that comes from outside begins there: what it did before would be a loose stroke
            y = np.asarray(line.get_ydata(), float)
            (outside,) = np.nonzero((y < low) | (y > high))
            line.set_ydata(np.where(np.arange(y.size) < outside.max(initial=0), np.nan, y))


def nyquist_play() -> Figure:
    """The servo of the quickstart."""
    return epp.predict_limit_cycles(epp.LureSystem.from_tf(([5.0], [1.0, 1.0, 0.0]), epp.Play(gap=2.0))).plot().figure


def nyquist_relay_dead_zone() -> Figure:
    """The loop of the README."""
    loop = epp.LureSystem.from_tf(([5.0], [1.0, 2.0, 1.0, 0.0]), epp.RelayDeadZone(threshold=1.0))
    return epp.predict_limit_cycles(loop).plot().figure


def save(figure: Figure, path: Path) -> None:
    """Write a picture."""
    figure.savefig(path, dpi=150, metadata={"Software": None})


def make_all(folder: Path) -> None:
    """Make every picture of the pages."""
    for name, drawing in drawings().items():
        save(draw_element(drawing), folder / f"{name}.png")
    pictures: Sequence[Callable[[], Figure]] = (
        nyquist_play,
        nyquist_relay_dead_zone,
        harmonic_convergence,
        first_order_errors,
        elbow_basins,
        elbow_branch,
        jump_resonance,
        three_responses,
        dithered_relay,
        clamped_pid,
    )
    for make in pictures:
        save(make(), folder / f"{make.__name__}.png")


if __name__ == "__main__":
    GENERATED.mkdir(exist_ok=True)
    make_all(GENERATED)
