"""Pictures of what all methods share: a run, one period of a cycle, the Nyquist plot of a prediction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from eppanalysis.arrays import Array
from eppanalysis.plotting import (
    BLUE,
    DARK,
    GREEN,
    GREY,
    SKY,
    SMALL,
    STABILITY,
    chosen,
    draw_nyquist,
    label_of,
    label_time,
    label_up,
    legend_below,
    main_signals,
    mark_events,
    note_below,
    number_powers,
    place_of,
    places_of,
    put_legend,
    show_constant,
)
from eppanalysis.readable import lasting, number, readable, time_unit, with_unit, words
from eppanalysis.results import LimitCycle, Prediction, Status, Trajectory

#: So many signals of a run are all drawn where none are named; of more the two that answer what it does.
MOST_PANELS = 3
#: Fewest and most samples of the shown part of a run, how many times finer each row of them is, and points drawn.
_SAMPLES, _MOST_SAMPLES, _FINER, _MOST_POINTS = 1000, 300_000, 2.618, 12_000
#: A curve is resolved where fewer than this share of its values lie off the lines by more than this share of its range.
_OFF, _FEW_OFF = 0.02, 0.02
#: Periods of a steady motion that are shown; more merge into a bar, behind which nobody sees how it began.
_PERIODS_SHOWN = 15
#: A run is at rest in a picture from where all signals stay this near to their last value, relative to their range; so
#: much of that time is shown, and if no more than so much of the run would be left out, all of it.
_AT_REST, _BEYOND, _REST_OF_RUN = 0.005, 1.5, 0.2
#: Misfit of a cycle, relative to its size, that is not seen.
_SEEN = 1e-3
#: What the shaded part of a run is.
_STEADY = {Status.SETTLED: "at rest", Status.LIMIT_CYCLE: "on the limit cycle"}


def plot_trajectory(trajectory: Trajectory, signals: Sequence[str] | None = None, given: Axes | None = None) -> Figure:
    """Signals against time, one panel each; grey marks at the foot are events, shaded is where the run is steady.

    Of a long steady motion a part is shown. Units are those that the case types.

    Parameters
    ----------
    signals : sequence of str, optional
        Which signals, in this order; by default all, of more than three the first and what the controller reads.
    given : matplotlib.axes.Axes, optional
        Where to draw the first of them; a figure of its own by default.

    Raises
    ------
    EppError
        If the trajectory has no such signal.
    """
    names = chosen(trajectory.signals, signals)
    left_out: list[str] = []
    if signals is None and len(names) > MOST_PANELS:
        names, every = main_signals(names), names
        left_out = [name for name in every if name not in names]
    figure, panels = places_of(given, len(names))
    until, motion = shown_until(trajectory), motion_of(trajectory)
    times = np.array([event.time for event in trajectory.events if event.time <= until])
    for name, ax in zip(names, panels, strict=False):
        label, factor = label_of(name, trajectory.units)
        draw_run(ax, trajectory, motion, name, factor, 1.0)
        show_constant(ax, factor * trajectory.signals[name])
        label_up(ax, label)
        mark_events(ax, times)
        if 0.0 < trajectory.settled_since < until:
            steady: dict[str, Any] = {"color": SKY, "alpha": 0.3, "linewidth": 0}
            since = lasting(trajectory.settled_since, trajectory.units)
            text = f"{_STEADY.get(trajectory.status, 'steady')} (from {since} on)"
            ax.axvspan(trajectory.settled_since, until, **steady, label=text)
    label_time(panels, time_of(trajectory), trajectory.units)
    if given is None:
        legend_below(figure, panels[0])
        if left_out:
            note_below(panels[len(names) - 1], f"Not drawn: {', '.join(map(words, left_out))}.")
    return figure


def shown_until(run: Trajectory) -> float:
    """The time up to which a run is shown: some periods of its cycle, or a while of its rest, but for a short run all.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> run = epp.simulate(epp.case("backlash_servo"), t_end=1000.0)
    >>> 1000.0 > shown_until(run) == run.settled_since + 15 * run.limit_cycle.period
    True
    """
    if not run.t.size:
        return 0.0
    end = until = run.end_time
    if run.carried_to > end:  # it is steady behind its end alone
        return end
    if run.limit_cycle is not None:
        until = np.nan_to_num(run.settled_since) + _PERIODS_SHOWN * run.limit_cycle.period
    elif run.settled_at:
        moves = [np.abs(y - y[-1]) > _AT_REST * np.ptp(y) for y in run.signals.values()]
        late = np.flatnonzero(np.any(moves, axis=0))
        until = _BEYOND * float(run.t[late[-1]]) if late.size else end
    return float(until) if 0.0 < until < (1.0 - _REST_OF_RUN) * end else end


def time_of(run: Trajectory) -> str:
    """What the time axis of a run is called: how long it goes on where it is not all shown."""
    goes_on = f", the same up to {lasting(run.end_time, run.units)}" if shown_until(run) < run.end_time else ""
    return f"{with_unit('time', time_unit(run.units))}{goes_on}"


def motion_of(run: Trajectory) -> tuple[Array, Mapping[str, Array]]:
    """Times and signals of a run, so near to one another that straight lines between them are its curve.

    The samples that a run holds may miss the peaks of a fast motion, so that it seems to be a slow one. Each finer row
    of times has no whole ratio to the one before it: a motion that repeats itself from sample to sample of one does not
    do so in the other. Of what is faster still the extremes over short times are drawn, a band.
    """
    t, until = run.t, shown_until(run)
    signals: Mapping[str, Array] = run.signals
    n = max(_SAMPLES, int(np.count_nonzero(t <= until)))
    while run.again is not None and t.size > 1 and n < _MOST_SAMPLES:
        n = round(_FINER * n)
        finer = np.linspace(t[0], until, n)
        values = run.again(finer)
        # One that ends by its events ends there again.
        finer = finer[: min(map(len, values.values()), default=0)]
        if all(_is_on(np.interp(finer, t, signals[name]), y) for name, y in values.items()):
            break
        t, signals = finer, values
    return t, signals


def _is_on(line: Array, values: Array) -> bool:
    """Whether values lie on a line, but for those few about their jumps."""
    return bool(np.mean(np.abs(line - values) > _OFF * np.ptp(values)) < _FEW_OFF) if values.size else True


def draw_run(
    ax: Axes, run: Trajectory, motion: tuple[Array, Mapping[str, Array]], name: str, factor: float, linewidth: float
) -> None:
    """A signal of the shown part of a run in time, from its motion."""
    t, values = motion[0], factor * motion[1][name]
    if t.size > _MOST_POINTS:
        t, values = _extremes(t, values)
    ax.plot(t, values, color=BLUE, linewidth=linewidth)
    if shown_until(run) < run.end_time:
        ax.set_xlim(run.t[0], shown_until(run))


def _extremes(t: Array, values: Array) -> tuple[Array, Array]:
    """Least and greatest value of each short piece of a curve, in their order: it fills the same dots."""
    size = 2 * len(t) // _MOST_POINTS + 1
    rows = np.append(values, np.repeat(values[-1], -len(values) % size)).reshape(-1, size)
    places = np.sort(np.stack([rows.argmin(axis=1), rows.argmax(axis=1)], axis=1), axis=1)
    at = np.minimum((places + size * np.arange(len(rows))[:, None]).ravel(), len(t) - 1)
    at = np.append(at, len(t) - 1)
    return t[at], values[at]


def plot_limit_cycle(cycle: LimitCycle, signals: Sequence[str] | None = None, given: Axes | None = None) -> Figure:
    """One period of a limit cycle, one panel a signal, with its mean (dashed) and its switches (grey marks).

    One that may not exist, or was not reached, is grey and dotted. Units are those that the case types.

    Parameters
    ----------
    signals : sequence of str, optional
        Which signals, in this order; all by default.
    given : matplotlib.axes.Axes, optional
        Where to draw the first of them; a figure of its own by default.

    Raises
    ------
    EppError
        If the cycle has no such signal.
    """
    time, waveform = one_period(cycle)
    names = chosen(waveform, signals)
    figure, panels = places_of(given, len(names))
    switches = np.array([event.time for event in cycle.events if event.time <= cycle.period])
    doubtful = cycle.may_not_exist or not cycle.status.ok
    style: dict[str, Any] = {"color": GREY, "linestyle": ":"} if doubtful else {"color": BLUE}
    for name, ax in zip(names, panels, strict=False):
        label, factor = label_of(name, cycle.units)
        values = factor * np.asarray(waveform[name])
        ax.plot(time, values, linewidth=1.2, **style)
        ax.axhline(factor * cycle.mean[name], color=GREY, linewidth=0.8, linestyle="--", label="mean")
        show_constant(ax, values)
        label_up(ax, label)
        mark_events(ax, switches)
    label_time(panels, with_unit("time within the period", time_unit(cycle.units)), cycle.units)
    if given is None:
        legend_below(figure, panels[0])
    return figure


def plot_nyquist(prediction: Prediction, ax: Axes | None = None) -> Figure:
    """Nyquist plot: the loop's response, the -1/N locus with growing amplitude, and the cycles where they meet.

    A filled circle is a stable cycle, an open one any other; grey is one that may not exist. Loops with several
    elements have no single -1/N locus; for them the picture is the loop gain over the peak to peak at the principal
    element, cut there, at the frequency at which the loop's phase closes and with all other balances met. A cycle is
    where it is one: where it rises with the size an oscillation grows away from the cycle, where it falls it returns
    to it.

    Parameters
    ----------
    ax : matplotlib.axes.Axes, optional
        Where to draw; a figure of its own by default.
    """
    drawn = prediction.curves.get("kind") == "nyquist" or prediction.curves.get("branches")
    figure, ax = place_of(ax, 4.4 if drawn else 0.6)
    if prediction.curves.get("kind") == "nyquist":
        _draw_nyquist(ax, prediction)
    elif drawn:
        _draw_loop_gain(ax, prediction)
    else:
        ax.set_axis_off()
        ax.text(
            0.5, 0.5, "The phase closes at no size of an oscillation.", transform=ax.transAxes, ha="center", color=DARK
        )
    return figure


def _draw_nyquist(ax: Axes, prediction: Prediction) -> None:
    curves = prediction.curves
    response = np.asarray(curves["response"], complex)
    locus = np.asarray(curves["locus"], complex)
    meets = [complex(point["value"]) for point in curves["intersections"]]
    draw_nyquist(ax, response, locus, meets)
    if curves.get("measured") is not None:
        points = np.asarray(curves["measured"], complex)
        window = ax.get_xlim(), ax.get_ylim()
        ax.plot(points.real, points.imag, ".", color=GREY, markersize=5, zorder=1, label="measured")
        ax.set(xlim=window[0], ylim=window[1])
    _mark_cycles(ax, meets, prediction.cycles)


def _draw_loop_gain(ax: Axes, prediction: Prediction) -> None:
    curves = prediction.curves
    element = words(str(curves.get("element", "the element")))
    unit, factor = readable(curves.get("unit", ""))
    ax.axhline(1.0, color=GREY, linewidth=0.8)
    for branch in curves.get("branches", ()):
        ax.plot(2.0 * factor * np.asarray(branch["amplitude"]), branch["loop_gain"], color=BLUE, linewidth=1.3)
    points = [complex(2.0 * factor * point["amplitude"], 1.0) for point in curves.get("intersections", ())]
    ax.set_xscale("log")
    ax.set_yscale("log")
    _mark_cycles(ax, points, prediction.cycles)
    ax.set_xlabel(with_unit(f"peak to peak at the input of {element}", unit))
    ax.set_ylabel("loop gain (one at a cycle)")
    number_powers(ax.xaxis, (2.0, 5.0))  # numbers side by side need more room
    number_powers(ax.yaxis, (2.0, 3.0, 5.0))


def _mark_cycles(ax: Axes, points: Sequence[complex], cycles: Sequence[LimitCycle]) -> None:
    """Filled circles for stable cycles, open ones around them for the others; numbers lead to the legend."""
    to_share = ax.transData + ax.transAxes.inverted()
    # A Nyquist curve climbs to the right, a loop gain falls behind its largest cycle.
    beside = (8, 5) if ax.get_xscale() == "log" else (8, -13)
    places: dict[tuple[int, int], list[int]] = {}
    for i, (point, cycle) in enumerate(zip(points, cycles, strict=True)):
        colour = GREY if cycle.may_not_exist else GREEN
        face, size = (colour, 7) if cycle.stable else ("none", 11)
        name = next(iter(cycle.harmonics))
        unit, factor = readable(cycle.units.get(name, ""))
        large = f"{words(name)} {number(factor * cycle.peak_to_peak[name])} {unit}".strip()
        text = f"{STABILITY[cycle.stable]}: {number(cycle.frequency)} Hz, {large} peak to peak"
        text += "\n(may not exist)" * cycle.may_not_exist
        style: dict[str, Any] = {
            "mfc": face,
            "mec": colour,
            "mew": 1.5,
            "markersize": size,
            "linestyle": "none",
            "zorder": 5,
        }
        ax.plot([point.real], [point.imag], marker="o", label=f"{i + 1} {text}", **style)
        share = to_share.transform((point.real, point.imag))
        # Cycles at one point share their numbers.
        places.setdefault((round(50 * share[0]), round(50 * share[1])), []).append(i)
    for numbers in places.values():
        point = points[numbers[0]]
        ax.annotate(
            ", ".join(str(i + 1) for i in numbers),
            (point.real, point.imag),
            beside,
            textcoords="offset points",
            fontsize=SMALL,
            path_effects=[withStroke(linewidth=2.5, foreground="white")],
            zorder=6,
        )
    if len(points) or ax.get_legend_handles_labels()[0]:
        put_legend(ax)


def closes(cycle: LimitCycle) -> bool:
    """Whether the end of a cycle's period meets its beginning, as far as is seen in a picture."""
    return not cycle.time.size or cycle.residual < _SEEN


def periods(cycle: LimitCycle, name: str, n: int = 2) -> tuple[Array, Array]:
    """Times and values of a signal over so many periods, between which the line breaks where they do not close."""
    time, waveform = one_period(cycle)
    seam = np.zeros(0) if closes(cycle) else np.array([np.nan])
    both = np.concatenate([part for k in range(n) for part in (time + k * cycle.period, seam)])
    return both, np.concatenate([part for _ in range(n) for part in (np.asarray(waveform[name], float), seam)])


def one_period(cycle: LimitCycle) -> tuple[Array, Mapping[str, Array]]:
    """Times and waveform; of a cycle that has only harmonics, their sum."""
    if cycle.time.size:
        return cycle.time, cycle.waveform
    time = np.linspace(0.0, cycle.period, 401)
    return time, {
        name: sum((c * np.exp(1j * k * cycle.omega * time) for k, c in enumerate(coefficients)), np.zeros(401)).real
        for name, coefficients in cycle.harmonics.items()
    }
