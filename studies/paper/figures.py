"""Pictures of the pages on the paper, made from the shipped cases: ``python -m studies.paper.figures``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

import eppanalysis as epp
from eppanalysis.plotting import (
    BLUE,
    DARK,
    GREEN,
    GREY,
    ORANGE,
    SKY,
    SMALL,
    VERMILLION,
    WIDTH,
    figure_of_height,
    in_columns,
    legend_below,
    put_legend,
)
from eppanalysis.readable import words
from eppanalysis.sweep import sweep
from eppanalysis.sweep.picture import plot_design_map
from studies import GENERATED
from studies.paper import runs as made, sensitivity
from studies.paper.runs import DEGREE, LBF

BANDS = ("slack", "extension", "parking", "flexion", "full flexion")


def _plain(*axes: Axes) -> None:
    for ax in axes:
        ax.spines[["top", "right"]].set_visible(False)


def _law(case: epp.Case, force: np.ndarray) -> np.ndarray:
    """Voltage over force [N] of a case's band law."""
    slack, low, high, top = case.elbow_parameters.bands.thresholds
    law = epp.FiveBandLaw(slack, low, high, top, case.value("drive.supply_voltage"))
    return np.array([law.output(f)[0] for f in force], float)


#: Lines at a value, dark and wide enough for a print of 8 cm.
AT: dict[str, Any] = {"color": DARK, "linewidth": 1.0, "linestyle": ":"}
#: Label of the lines at both ends of a profile.
ENDS = r"$F_\mathrm{slack}$, $F_\mathrm{max}$"


def paper_figure_2() -> Figure:
    """The band law with both profiles that the cases use."""
    figure = figure_of_height(3.9)
    ax = figure.subplots()
    force = np.linspace(0.0, 5.0, 2001)
    wide, narrow = epp.case("fig8a_original"), epp.case("fig6a_original_pulley")
    for case, colour, origin in ((wide, BLUE, "assumed for Figure 8"), (narrow, VERMILLION, "about that in Figure 6")):
        label = f"profile range {case.parameters['bands.range']} ({origin})"
        ax.plot(force, _law(case, force * LBF), color=colour, label=label)
    thresholds = np.array(wide.elbow_parameters.bands.thresholds) / LBF
    for x, label in zip(thresholds, ("thresholds of the wider profile", None, None, None), strict=True):
        ax.axvline(x, **AT, label=label)
    edges = [0.0, *thresholds, 5.0]
    for name, left, right in zip(BANDS, edges, edges[1:], strict=False):
        at = (left + right) / 2, 21.0 if name == "parking" else 17.5
        ax.text(*at, name, ha="center", fontsize=SMALL, bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0})
    names = [r"$F_\mathrm{slack}$", r"$F_\mathrm{low}$", r"$F_\mathrm{high}$", r"$F_\mathrm{max}$"]
    for name, x, shift in zip(names, thresholds, (-0.23, -0.19, 0.18, 0.21), strict=True):
        ax.text(x + shift, -20.0, name, ha="center", fontsize=SMALL)
    ax.set_ylim(-21.5, 24.0)
    ax.set_xlim(0.0, 5.0)
    ax.set_xlabel("input force [lbf]")
    ax.set_ylabel("output voltage [V]")
    put_legend(ax)
    _plain(ax)
    return figure


def paper_figure_4() -> Figure:
    """Weight-tray tests, up and down."""
    case = epp.case("elbow")
    friction, kinetic = case.value("pulley.friction"), case.value("pulley.kinetic_ratio")
    panels = {
        "(a), (c) sensor alone; ball bearing": made.tray(0.0, 1.0),
        "(b) original pulley, static friction only": made.tray(friction, 1.0),
        f"(b) original pulley, kinetic ratio {kinetic:g}": made.tray(friction, kinetic),
    }
    figure = figure_of_height(5.4)
    axes = figure.subplots(3, 1, sharex=True, sharey=True)
    for ax, (title, test) in zip(axes, panels.items(), strict=True):
        up, down = slice(None, test.top + 1), slice(test.top, None)
        ax.plot(test.weight[up] / LBF, test.voltage[up], color=BLUE, marker=".", markersize=3, label="loading")
        ax.plot(
            test.weight[down] / LBF, test.voltage[down], color=VERMILLION, marker=".", markersize=3, label="unloading"
        )
        ax.set_title(title, fontsize=SMALL, loc="left")
        ax.set_ylabel("sensor [V]")
    axes[-1].set_xlabel("weight on the tray [lbf]")
    legend_below(figure, axes[0])
    _plain(*axes)
    return figure


def paper_figure_5() -> Figure:
    """The four phases: where sensor and harness side are on the band law, and when."""
    name = "fig6a_original_pulley"
    case, result, phase = epp.case(name), made.run(name, t_end=1.0), made.paper_slip()
    figure = figure_of_height(7.6)
    grid = figure.add_gridspec(4, 2, height_ratios=[1.0, 1.0, 1.5, 0.8])
    first = float(result.t[0])
    moments = (
        (first, "(a) at rest"),
        (first + 5e-4, "(b) step: flexion"),
        (phase.slips - 5e-4, "(c) pulley stuck: still flexion"),
        (phase.extension + 5e-4, "(d) pulley slipped: extension"),
    )
    force = np.linspace(0.0, 5.0, 501)
    for i, (time, title) in enumerate(moments):
        ax = figure.add_subplot(grid[divmod(i, 2)])
        ax.plot(force, _law(case, force * LBF), color=GREY, linewidth=1.0)
        _mark_forces(ax, case, result, time, resting=i == 0)
        ax.set_title(title, fontsize=SMALL)
        ax.set_xlim(0.0, 5.0)
        ax.tick_params(labelleft=i % 2 == 0, labelbottom=i > 1)
        _plain(ax)
        if i % 2 == 0:
            ax.set_ylabel("voltage [V]")
        if i > 1:
            ax.set_xlabel("force [lbf]")
    _draw_phases(figure, grid, case, result, phase)
    return figure


def _mark_forces(ax: Axes, case: epp.Case, result: epp.Trajectory, time: float, resting: bool) -> None:
    """Sensor side filled, harness side open; before the step both are in the middle of the parking band."""
    middle = case.elbow_parameters.bands.parking_centre
    for signal, face, size in (("harness_force", "none", 9), ("sensor_force", BLUE, 5)):
        value = middle if resting else float(np.interp(time, result.t, result.signals[signal]))
        edge = VERMILLION if face == "none" else BLUE
        beyond = value > 5.0 * LBF
        shown = min(value, 4.85 * LBF)
        marker = ">" if beyond else "o"
        ax.plot([shown / LBF], _law(case, np.array([value])), marker, mfc=face, mec=edge, ms=size, mew=1.4)


def _draw_phases(figure: Figure, grid, case: epp.Case, result: epp.Trajectory, phase: made.Slip) -> None:
    top, bottom = figure.add_subplot(grid[2, :]), figure.add_subplot(grid[3, :])
    window = (0.53, 0.66)
    keep = (result.t >= window[0]) & (result.t <= window[1])
    t = 1e3 * result.t[keep]
    for signal, colour, label in (
        ("sensor_force", BLUE, "sensor (forearm spring)"),
        ("harness_force", VERMILLION, "harness spring"),
    ):
        top.plot(t, result.signals[signal][keep] / LBF, color=colour, label=label)
    slack, low, high, most = np.array(case.elbow_parameters.bands.thresholds) / LBF
    top.axhspan(low, high, color=GREY, alpha=0.25, linewidth=0, label="parking band")
    for level, label in ((slack, ENDS), (most, None)):
        top.axhline(level, **AT, label=label)
    for ax in (top, bottom):
        for k, event in enumerate(result.events[:-1]):
            following = next((e for e in result.events[k + 1 :] if e.element == "cable"), None)
            if event.element == "cable" and event.name == "sticks" and following is not None:
                ax.axvspan(1e3 * event.time, 1e3 * following.time, color=SKY, alpha=0.25, linewidth=0)
        ax.set_xlim(1e3 * window[0], 1e3 * window[1])
    for time, letter in ((phase.slips - 5e-4, "(c)"), (phase.extension + 5e-4, "(d)")):
        top.annotate(letter, (1e3 * time + 0.4, 3.42), fontsize=SMALL)
        top.axvline(1e3 * time, color="black", linewidth=0.7)
    top.set_ylim(1.5, 3.65)
    top.set_ylabel("force [lbf]")
    top.tick_params(labelbottom=False)
    put_legend(top, [*top.get_legend_handles_labels()[0], Patch(color=SKY, alpha=0.25, label="pulley stuck")])
    bottom.plot(t, result.signals["theta"][keep] / DEGREE, color=GREEN)
    bottom.set_ylabel("forearm [deg]")
    bottom.set_xlabel("time after the step [ms]")
    _plain(top, bottom)
    figure.align_ylabels([top, bottom])


def _three_steps(names: tuple[str, str], titles: tuple[str, str]) -> Figure:
    """Angle over three steps, and the end of the third step close up."""
    figure = figure_of_height(4.6)
    axes = figure.subplots(2, 2, width_ratios=[2.6, 1.0])
    for row, name, title in zip(axes, names, titles, strict=True):
        result, input_signal = made.run(name), epp.case(name).input
        theta = result.signals["theta"] / DEGREE
        for ax in row:
            ax.plot(result.t, theta, color=BLUE, linewidth=0.7)
        down = input_signal.value(result.t) < 0.5 * input_signal.values.max()
        row[0].fill_between(
            result.t, 0, 1, where=down, color=GREY, alpha=0.3, linewidth=0, transform=row[0].get_xaxis_transform()
        )
        row[0].set_title(title, fontsize=SMALL, loc="left")
        row[0].set_ylabel("forearm [deg]")
        row[0].set_xlim(0.0, result.t[-1])
        end = result.t > result.t[-1] - 0.5
        row[1].set_xlim(result.t[-1] - 0.5, result.t[-1])
        middle = float(np.mean(theta[end]))
        row[1].set_ylim(middle - 3.0, middle + 3.0)
        row[1].set_title("last half second", fontsize=SMALL)
    for ax in axes[1]:
        ax.set_xlabel("time [s]")
    _plain(*axes.flat)
    return figure


def paper_figure_6() -> Figure:
    """Three steps with either pulley."""
    return _three_steps(made.FIGURE_6, ("(a) original pulley", "(b) ball-bearing pulley"))


def paper_figure_8() -> Figure:
    """Three steps with either gap."""
    gaps = [epp.case(name).parameters["lock_pin.backlash"] for name in made.FIGURE_8]
    return _three_steps(made.FIGURE_8, (f"(a) original, gap {gaps[0]}", f"(b) reduced, gap {gaps[1]}"))


def paper_figure_7() -> Figure:
    """Force and pin torque while the forearm is moved by hand through the gap, the drive standing still."""
    figure = figure_of_height(5.0)
    axes = figure.subplots(2, 1, sharex=True)
    for ax, name, title in (
        (axes[0], "fig8a_original", "original lock pin"),
        (axes[1], "fig8b_reduced_backlash", "modified lock pin"),
    ):
        p = epp.case(name).elbow_parameters
        pin = epp.LockPin(gap=p.lock_pin.backlash, stiffness=p.lock_pin.stiffness, damping=p.lock_pin.damping)
        angle = np.linspace(-1.8, 1.8, 721) * DEGREE
        tension = p.bands.parking_centre - p.cable.stiffness * p.pulley.radius * angle
        torque = np.array([float(np.atleast_1d(pin.output((-a, 0.0))[0])[0]) for a in angle])
        ax.plot(angle / DEGREE, tension / LBF, color=BLUE, label="input force")
        half = p.lock_pin.backlash / 2
        ax.axvspan(-half / DEGREE, half / DEGREE, color=SKY, alpha=0.25, linewidth=0, label="gap")
        slack, low, high, top = np.array(p.bands.thresholds) / LBF
        ax.axhspan(low, high, color=GREY, alpha=0.25, linewidth=0, label="parking band")
        for level, label in ((slack, ENDS), (top, None)):
            ax.axhline(level, **AT, label=label)
        other = ax.twinx()
        other.plot(angle / DEGREE, torque, color=VERMILLION, linestyle="--", linewidth=1.0)
        other.set_ylim(-25.0, 25.0)
        for side in (ax, other):
            side.spines["top"].set_visible(False)
        ax.set_title(f"{title}: gap {p.lock_pin.backlash / DEGREE:.3g}°", fontsize=SMALL, loc="left")
        ax.set_ylim(1.0, 4.0)
        ax.set_ylabel("input force [lbf]")
        other.set_ylabel("pin torque [N·m]")
        ax.plot([], [], color=VERMILLION, linestyle="--", linewidth=1.0, label="pin torque (right)")
    axes[-1].set_xlabel("forearm against drive [deg]")
    legend_below(figure, axes[0])
    return figure


def paper_boundaries() -> Figure:
    """Exact cycles over the four quantities that the paper changed."""
    nominal = epp.case("elbow")
    panels = (
        (made.gap_branch(), 1 / DEGREE, "backlash [deg]", ("fig8b_reduced_backlash", "fig8a_original")),
        (
            made.gain_branch(),
            1 / LBF,
            "profile range [lbf],\nreduced gap",
            ("gain_brings_it_back", "fig8b_reduced_backlash"),
        ),
        (made.friction_branch(), 1.0, "pulley friction", ("fig6b_ball_bearing", "fig6a_original_pulley")),
        (
            made.cable_branch(),
            1 / nominal.value("cable.stiffness"),
            "cable stiffness,\nshare of the nominal",
            ("soft_cable", "fig8a_original"),
        ),
    )
    figure = figure_of_height(5.4)
    for ax, (found, factor, label, cases) in zip(figure.subplots(2, 2).flat, panels, strict=True):
        value, size = factor * found.points["value"], found.points["theta"] / DEGREE
        stable = found.points["stable"].astype(bool)
        ax.plot(value, np.where(stable, size, np.nan), color=BLUE, label="stable")
        ax.plot(value, np.where(stable, np.nan, size), color=VERMILLION, linestyle="--", label="unstable")
        ax.axvline(factor * made.stable_limit(found), **AT, label="cycles end")
        for name in cases:
            case, result = epp.case(name), made.run(name)
            steady = result.limit_cycle.peak_to_peak["theta"] / DEGREE if result.limit_cycle else 0.0
            ax.plot(factor * case.value(found.parameter), steady, "o", color=GREEN, label="step, simulated", zorder=4)
        ax.set_xlabel(label)
        ax.set_ylim(bottom=-0.15)
        _plain(ax)
    figure.supylabel("oscillation of the forearm, peak to peak [deg]", fontsize=SMALL + 1.0)
    legend_below(figure, *figure.axes)
    return figure


def paper_mass() -> Figure:
    """Which steps start the oscillation, over the forearm's inertia and over the cable's stiffness."""
    # Some runs creep to rest through the drive, so they are given more time than the case has.
    case = epp.case("fig8a_original").with_values({"run.t_end": 10.0})
    inertia, stiffness = case.value("forearm.inertia"), case.value("cable.stiffness")
    share = np.linspace(0.15, 1.2, 22)
    steps = [s for s in np.linspace(-40.0, 40.0, 21) * 1e-3 if s != 0]
    figure = figure_of_height(6.6)
    for ax, name, nominal in zip(
        figure.subplots(2, 1), ("forearm.inertia", "cable.stiffness"), (inertia, stiffness), strict=True
    ):
        found = sweep(case, {name: share * nominal, "harness.step": steps}, progress=False)
        plot_design_map(found, name, "harness.step", lines=False, ax=ax)
        if name == "cable.stiffness":
            ax.set_xlabel("cable stiffness [kN/m]")
            ax.set_xticks(ax.get_xticks(), [f"{1e-3 * x:g}" for x in ax.get_xticks()])
            ax.set_xlim(0.1225 * nominal, 1.225 * nominal)
        ax.axvline(nominal, color="black", linewidth=1.2, linestyle="--")
        ax.text(nominal, 38.0, " nominal", fontsize=SMALL, va="top")
    return figure


def paper_upright() -> Figure:
    """The upright elbow as it is, and with backlash and friction."""
    figure = figure_of_height(3.0)
    axes = figure.subplots(1, 2, width_ratios=[2.2, 1.0])
    for result, colour, label in (
        (made.run("upright", *made.ORIGINAL_ELBOW), VERMILLION, "original gap and pulley"),
        (made.run("upright"), BLUE, "reduced gap, ball bearing"),
    ):
        for ax in axes:
            ax.plot(result.t, result.signals["theta"] / DEGREE, color=colour, linewidth=0.9, label=label)
    end = result.t[-1]
    axes[0].set_xlim(0.0, 3.0)
    axes[1].set_xlim(end - 0.5, end)
    axes[1].set_ylim(result.signals["theta"][-1] / DEGREE - 4.0, result.signals["theta"][-1] / DEGREE + 4.0)
    axes[1].set_title("last half second", fontsize=SMALL)
    axes[0].set_ylabel("forearm angle [deg]")
    for ax in axes:
        ax.set_xlabel("time after the step [s]" if ax is axes[0] else "time [s]")
    legend_below(figure, axes[0])
    _plain(*axes)
    return figure


def paper_parking() -> Figure:
    """The same run without and with parking logic."""
    name = "parking_stops_it"
    case = epp.case(name)
    figure = figure_of_height(4.4)
    axes = figure.subplots(2, 2, sharex="col", sharey="row", height_ratios=[1.0, 1.0])
    without = made.run(name, ("parking.dwell_time", 10.0), t_end=4.0)
    _, low, high, _ = np.array(case.elbow_parameters.bands.thresholds) / LBF
    for column, result, title in (
        (0, without, "without parking logic"),
        (1, made.run(name, t_end=4.0), f"dwell time {case.parameters['parking.dwell_time']}"),
    ):
        upper, lower = axes[:, column]
        upper.plot(result.t, result.signals["theta"] / DEGREE, color=BLUE, linewidth=0.9)
        lower.plot(result.t, result.signals["sensor_force"] / LBF, color=BLUE, linewidth=0.9)
        lower.axhspan(low, high, color=GREY, alpha=0.25, linewidth=0, label="parking band")
        last = next(e for e in reversed(result.events) if e.element == "bands")
        if last.name == "parks":
            upper.axvline(last.time, color=VERMILLION, linewidth=1.0, label="parks for good")
        upper.set_title(title, fontsize=SMALL)
        lower.set_xlabel("time after step [s]")
        upper.set_ylim(58.5, 62.5)
        lower.set_ylim(1.6, 3.4)
        upper.set_xlim(0.2, 4.0)
    axes[0, 0].set_ylabel("forearm angle [deg]")
    axes[1, 0].set_ylabel("input force [lbf]")
    legend_below(figure, *axes[:, 1])
    _plain(*axes.flat)
    return figure


def paper_sensitivity() -> Figure:
    """For each finding and each open parameter: does it hold at 50 to 150 per cent?"""
    names = sensitivity.assumed()
    factors = sensitivity.FACTORS
    n = len(factors)
    table = np.full((len(names), n * len(sensitivity.FINDINGS)), 0)
    for j, finding in enumerate(sensitivity.FINDINGS):
        want = epp.case(finding).expected.outcome
        for name, found in sensitivity.one_at_a_time(finding).items():
            codes = [1 if word == want else 2 if word in ("settle", "oscillate") else 3 for word in found]
            table[names.index(name), n * j : n * (j + 1)] = codes
    meanings = ("given by the paper, or what the finding itself changes", "holds", "flips", "undecided")
    colours = ("#D9D9D9", SKY, VERMILLION, ORANGE)
    figure = figure_of_height(1.6 + 0.18 * len(names))
    ax = figure.subplots()
    ax.pcolormesh(table, cmap=ListedColormap(colours), norm=BoundaryNorm(np.arange(5) - 0.5, 4), edgecolors="white")
    for j in range(1, len(sensitivity.FINDINGS)):
        ax.axvline(n * j, color="black", linewidth=1.2)
    ax.set_yticks(np.arange(len(names)) + 0.5, [words(name) for name in names], fontsize=SMALL)
    ax.set_xticks(n * (np.arange(len(sensitivity.FINDINGS)) + 0.5), range(1, len(sensitivity.FINDINGS) + 1))
    ax.set_xlabel(f"finding; each at {', '.join(f'{100 * (f - 1):+.0f}' for f in factors)} %", fontsize=SMALL)
    ax.invert_yaxis()
    ax.tick_params(length=0)
    there = [
        Patch(facecolor=c, edgecolor=GREY, label=w)
        for i, (w, c) in enumerate(zip(meanings, colours, strict=True))
        if i in table
    ]
    texts, columns = in_columns([str(patch.get_label()) for patch in there], 0.96 * WIDTH)
    figure.legend(there, texts, fontsize=SMALL, loc="outside lower center", ncols=columns, frameon=False)
    return figure


PICTURES: tuple[Callable[[], Figure], ...] = (
    paper_figure_2,
    paper_figure_4,
    paper_figure_5,
    paper_figure_6,
    paper_figure_7,
    paper_figure_8,
    paper_boundaries,
    paper_mass,
    paper_upright,
    paper_parking,
    paper_sensitivity,
)


def make_all(folder: Path) -> None:
    """Make every picture."""
    for make in PICTURES:
        make().savefig(folder / f"{make.__name__}.png", dpi=150, metadata={"Software": None})


if __name__ == "__main__":
    GENERATED.mkdir(exist_ok=True)
    make_all(GENERATED)
