"""What the first pages show: ``python -m studies.pages.intro``.

It is kept in ``docs/_static``, as a README is read where nothing has been built.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch, Polygon

import eppanalysis as epp
from eppanalysis.plotting import BLUE, GREY, SKY, SMALL, VERMILLION, figure_of, figure_of_height, panels_of, put_legend
from studies import STORED
from studies.pages.stored import case_on

#: Half the gap of the servo's play, by which positions are divided.
HALF_GAP = 1.0
#: Starts of the runs that are drawn, as multiples of the position at the edge of the gap.
INSIDE, OUTSIDE = 1.3, 3.6
#: The first-order fold of the servo, below which it calls every gain safe; a test computes it afresh.
FIRST_ORDER_FOLD = 3.41658
LARGEST_GAIN = 5.0
#: The place of a legend below a panel that has its title above.
_BELOW: dict[str, Any] = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.3)}


def servo(gain: float) -> epp.LureSystem:
    """The position servo of the shipped case with another gain."""
    case = epp.case("backlash_servo")
    return case.with_values({"loop.gain": gain / gain_of(case)}).to_system()


def gain_of(case: epp.Case) -> float:
    """The gain k of a servo k / (s (s + 1))."""
    return -float(case.to_system().C[0, 1])


def started_at(system: epp.LureSystem, position: float) -> epp.LureSystem:
    """The servo held at a position (half gaps) and let go."""
    return replace(system, x0=np.array([0.0, HALF_GAP * position / system.C[0, 1]]))


def limit_cycle() -> Figure:
    """What backlash does to a servo: the loop as it is drawn, its motion in time, and all motions on one cycle."""
    figure = figure_of_height(5.6)
    panels = figure.subplot_mosaic([["drawing", "drawing"], ["time", "plane"]], height_ratios=(1.0, 0.9))
    drawing, time, plane = panels.values()
    _draw_loop(drawing)
    system = servo(LARGEST_GAIN)
    run = epp.simulate(started_at(system, INSIDE), t_end=60.0)
    _draw_time(time, run)
    outside = epp.simulate(started_at(system, OUTSIDE), t_end=60.0)
    _draw_plane(plane, run, outside)
    return figure


def _box(ax: Axes, x: float, y: float, text: str, width: float = 2.3) -> None:
    corner = (x - width / 2, y - 0.55)
    ax.add_patch(FancyBboxPatch(corner, width, 1.1, boxstyle="round,pad=0.05", fc="white", ec="black", lw=1.2))
    ax.text(x, y, text, ha="center", va="center", fontsize=SMALL)


def _arrow(ax: Axes, points: Sequence[tuple[float, float]]) -> None:
    xs, ys = zip(*points, strict=True)
    ax.plot(xs[:-1], ys[:-1], color="black", linewidth=1.2, solid_capstyle="butt")
    head = {"arrowstyle": "-|>", "color": "black", "linewidth": 1.2, "shrinkA": 0.0, "shrinkB": 0.0}
    ax.annotate("", points[-1], points[-2], arrowprops=head)


def _draw_loop(ax: Axes) -> None:
    """Controller and motor, a tooth of the load's gear between two of the motor's, and the sensor behind them."""
    ax.set(xlim=(-1.2, 13.2), ylim=(-2.6, 7.6), aspect="equal")
    ax.set_axis_off()
    ax.set_title("Gear teeth have a gap ...", fontsize=10, loc="left")
    _box(ax, 0.8, 3.0, "controller", 3.4)
    _box(ax, 4.6, 3.0, "motor", 2.2)
    _box(ax, 12.0, 3.0, "load", 1.9)
    _arrow(ax, [(2.55, 3.0), (3.45, 3.0)])
    for left in (6.5, 9.0):
        tooth = [(left, 5.2), (left + 1.2, 5.2), (left + 0.9, 2.4), (left + 0.3, 2.4)]
        ax.add_patch(Polygon(tooth, fc=SKY, ec="black", lw=1.0))
    ax.plot([5.75, 6.1, 6.1, 10.5], [3.0, 3.0, 5.2, 5.2], color="black", linewidth=1.2)
    ax.add_patch(Polygon([(7.7, 1.0), (9.0, 1.0), (8.65, 3.9), (8.05, 3.9)], fc="#f3c9a5", ec="black", lw=1.0))
    ax.plot([7.0, 10.6, 10.6], [1.0, 1.0, 3.0], color="black", linewidth=1.2)
    _arrow(ax, [(10.6, 3.0), (11.0, 3.0)])
    ax.annotate("gap", (8.98, 3.2), (10.1, 6.6), fontsize=SMALL, ha="center", arrowprops={"arrowstyle": "-", "lw": 0.8})
    ax.annotate("", (8.68, 3.0), (9.3, 3.0), arrowprops={"arrowstyle": "<->", "lw": 0.8, "mutation_scale": 6})
    _arrow(ax, [(12.0, 2.35), (12.0, -1.3), (0.8, -1.3), (0.8, 2.35)])
    ax.text(6.4, -1.2, "position of the load", ha="center", va="bottom", fontsize=SMALL)


def _draw_time(ax: Axes, run: epp.Trajectory) -> None:
    """Two periods of motor and load on the cycle; shaded where the teeth are apart."""
    late = run.t > run.t[-1] - 2.0 * (run.limit_cycle.period if run.limit_cycle else 1.0)
    t, motor, load = run.t[late] - run.t[late][0], run.signals["x"][late], run.signals["y"][late]
    apart = np.abs(np.gradient(load, t)) < 1e-9
    ax.fill_between(t, -2.6, 2.6, where=apart, color=GREY, alpha=0.18, linewidth=0, label="teeth apart")
    ax.plot(t, motor / HALF_GAP, color=BLUE, linewidth=1.6, label="motor")
    ax.plot(t, load / HALF_GAP, color=VERMILLION, linewidth=1.6, label="load")
    ax.set(xlabel="time [s]", ylabel="position [half gaps]", ylim=(-2.6, 2.6), xlim=(0.0, t[-1]))
    ax.set_title("... the load waits\nwhile they cross it ...", fontsize=10, loc="left")
    put_legend(ax, **_BELOW)
    ax.spines[["top", "right"]].set_visible(False)


def _draw_plane(ax: Axes, *runs: epp.Trajectory) -> None:
    """Speed over position of the motor, from inside and outside onto the cycle."""
    for run, name, filled in zip(runs, ("small start", "large start"), ("white", "black"), strict=True):
        x, speed = run.signals["x"], np.gradient(run.signals["x"], run.t)
        ax.plot(x, speed, color=GREY, linewidth=0.9)
        ax.plot(x[0], speed[0], "o", mfc=filled, mec="black", markersize=5, linestyle="none", label=name)
    late = run.t > run.t[-1] - 1.01 * (run.limit_cycle.period if run.limit_cycle else 1.0)
    ax.plot(x[late], speed[late], color=BLUE, linewidth=2.4, label="limit cycle")
    ax.set(xlabel="motor [half gaps]", ylabel="speed [half gaps/s]")
    ax.set_title("... and both starts\nend on one cycle", fontsize=10, loc="left")
    put_legend(ax, **_BELOW)
    ax.spines[["top", "right"]].set_visible(False)


def first_order_blind() -> Figure:
    """Size of the servo's cycle over its gain, by first order and exactly; and a run at a gain that is called safe."""
    case = epp.case("backlash_servo_unseen")
    own = gain_of(case)
    figure, (size, time) = panels_of(2, 2.4)
    gains = np.r_[FIRST_ORDER_FOLD + 1e-4, np.linspace(3.425, LARGEST_GAIN, 40)]
    found = [epp.predict_limit_cycles(servo(gain)) for gain in gains]
    stable = [2.0 * one[-1].amplitude("x") for one in found]
    unstable = [2.0 * one[0].amplitude("x") for one in found]
    size.plot(gains, stable, color=VERMILLION, linewidth=1.5, label="DF, stable")
    size.plot(gains, unstable, color=VERMILLION, linewidth=1.2, linestyle="--", label="DF, unstable")
    values, exact = _exact_branch(case)
    size.plot(own * values, exact, color=BLUE, linewidth=2.0, label="exact, stable")
    run = epp.simulate(case)
    assert run.limit_cycle is not None
    size.plot(own, run.limit_cycle.peak_to_peak["x"], "x", color="black", markersize=7, label="simulated, as below")
    size.axvspan(own * values.min(), FIRST_ORDER_FOLD, color=VERMILLION, alpha=0.15, linewidth=0)
    middle = 0.5 * (own * values.min() + FIRST_ORDER_FOLD)
    size.text(middle, 4.0, "called\nsafe,\noscillates", ha="center", fontsize=SMALL)
    size.set(xlabel="gain", ylabel="motor, peak to peak\n[half gaps]", xlim=(2.8, LARGEST_GAIN), ylim=(1.8, 4.8))
    put_legend(size, ncols=2, **_BELOW)
    size.set_title(f"DF: no limit cycle below gain {FIRST_ORDER_FOLD:.3f}", fontsize=10, loc="left")
    shown = run.t < 120.0
    time.plot(run.t[shown], run.signals["x"][shown], color=BLUE, linewidth=1.0)
    time.set(xlabel="time [s]", ylabel="motor [half gaps]", xlim=(0.0, 120.0))
    time.set_title(
        f"The motion at gain {own:.1f}: {run.limit_cycle.frequency:.4f} Hz, for ever", fontsize=10, loc="left"
    )
    return figure


def _exact_branch(case: epp.Case) -> tuple[np.ndarray, np.ndarray]:
    """Gain (relative to that of the case) and size of the stable exact cycle, from its begin to the largest gain."""
    own = gain_of(case)
    down = epp.continue_branch(case, "loop.gain", start=1.0, stop=0.5, n_points=60)
    up = epp.continue_branch(case, "loop.gain", start=1.0, stop=LARGEST_GAIN / own)
    value, size = (np.r_[down.points[name][::-1], up.points[name]] for name in ("value", "x"))
    return value, size


def servo_of_the_page() -> epp.Case:
    """The servo that the page of the first ten minutes has its reader save."""
    return case_on("ten_minutes", "servo")


def ten_minutes() -> Figure:
    """What ``eppanalysis validate`` draws of that servo."""
    return figure_of(epp.ladder(servo_of_the_page()).plot())


def ten_minutes_table() -> str:
    """What ``eppanalysis bounds --manual`` writes of it."""
    over = [f"{gain} V/rad" for gain in (150, 200, 250)]
    return str(epp.manual_table(epp.design_bounds(servo_of_the_page(), over="Kp", limit="gap", at=over, starts=200)))


def make_all(folder: Path) -> None:
    """Make all of it."""
    for make in (limit_cycle, first_order_blind, ten_minutes):
        make().savefig(folder / f"{make.__name__}.png", dpi=150, metadata={"Software": None})
    (folder / "ten_minutes.md").write_text(f"{ten_minutes_table()}\n", encoding="utf-8")


if __name__ == "__main__":
    make_all(STORED)
