"""The house style of pictures: size, letters, colours, panels, legends, labels with units. Knows no result."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure, SubFigure
from matplotlib.font_manager import FontProperties
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.text import Annotation
from matplotlib.textpath import TextPath
from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator

from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.errors import EppError, shown
from eppanalysis.readable import number, readable, with_unit, words

#: Colours that stay apart under every form of colour blindness (Okabe and Ito, "Color Universal Design", 2008).
BLUE, VERMILLION, GREEN, ORANGE, SKY, PURPLE, GREY = (
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#E69F00",
    "#56B4E9",
    "#CC79A7",
    "#7F7F7F",
)
#: The two light ones as lines and small marks, whose contrast with paper is to be three to one, by day and by night.
DARK_ORANGE, DARK_SKY = "#B87F00", "#3A93C9"
#: Grey letters that are still read with ease.
DARK = "#4D4D4D"
#: Every picture is so wide [inch]: 12 cm. Print it at 8 cm, and its smallest letters are of 6 points.
WIDTH = 12.0 / 2.54
#: Size of the smallest letters [points]; labels of axes and their numbers have matplotlib's own 10.
SMALL = 9.0
STABILITY = {True: "stable", False: "unstable", None: "stability unknown"}
#: More marks than these merge into a bar that says nothing.
_MOST_MARKS = 300
#: So many numbers along an axis, of 0.0005 s or -0.075, are written side by side.
_MOST_NUMBERS = 6
#: Height of a panel, and of one of many [inch].
_PANEL_HEIGHT, _LOW_PANEL, _MANY_PANELS = 1.5, 1.15, 4
#: Letters of a label on an inch of a panel's height.
_LABEL_IN_AN_INCH = 12.5
#: What varies by less than this share of itself is a constant, whose digits are rounding errors.
_CONSTANT = 1e-6
#: Highest over lowest value of an axis of powers of ten, below which numbers between them are written, too, and those
#: of even steps instead.
_NARROW, _SHORT = 30.0, 5.0
#: Half height of the axis around a constant, relative to it.
_AROUND = 0.05
#: A curve runs away that exceeds so many times what it stays below over this share of its width.
_RUNS_AWAY, _KEPT = 5.0, 0.9
#: Size of the verdict's letters [points]; how many of them, and of the small ones, fit side by side on an inch.
_BOLD, _BOLD_IN_AN_INCH = 10.0, 11.3
_SMALL_IN_AN_INCH = 15.2
#: Height of a line of letters, relative to their size.
_LINE = 1.25
#: Distance of titles from the edges of a figure [inch], and letters of words that are not broken.
_MARGIN, _LONG_WORD = 0.06, 20
#: Lines of small print above a picture; longer details are below it, where they keep nobody from the evidence.
_MOST_ABOVE = 4
#: What the sign and the gaps of an entry of a legend take, in sizes of its letters.
_SIGN = 4.8
#: Axes that reach farther, as a share of the figure's width, have none to their right.
_OUTERMOST = 0.85
#: Letters on a screen are up to a twelfth wider than their outlines.
_HINTED = 0.92
#: Spaces at which a line is not broken: behind a number, and between a letter and a number.
_WITH_NUMBER = re.compile(r"(?<=\d) (?=[A-Za-z%])|(?<=\b[A-Za-z]) (?=[-\d])")
#: What the controller of an elbow reads.
_READ = "sensor_force"
#: What systems are called that were given no name.
_UNNAMED = ("loop", "diagram")


def put_verdict(figure: Figure, verdict: str, details: str = "", subject: str = "") -> None:
    """The verdict above a picture as a bold line, and small below it the case or the system, and what else is known.

    Long details are below the picture. The figure grows by the height of what is written, so that its panels keep
    theirs.
    """
    name = "" if subject in _UNNAMED else subject  # a loop that nobody named has no name to show
    width = figure.get_figwidth()
    bold = _within(width, verdict, _BOLD_IN_AN_INCH, _BOLD, "bold")
    small, below = _within(width, ": ".join(filter(None, (name, details))), _SMALL_IN_AN_INCH, SMALL), []
    if len(small) > _MOST_ABOVE and not figure.legends:  # which are at the foot, too
        small, below = (_within(width, text, _SMALL_IN_AN_INCH, SMALL) for text in (name, details))
    heights = _LINE * _BOLD, _LINE * SMALL
    room = math.ceil(len(small) * heights[1] / heights[0])  # empty lines of the title, where the small ones go
    figure.set_figheight(figure.get_figheight() + (len(bold) + room) * heights[0] / 72.0)
    above: dict[str, Any] = {"x": 0.012, "ha": "left", "fontsize": _BOLD, "fontweight": "bold", "linespacing": _LINE}
    title = figure.suptitle("\n".join(bold) + "\n" * room, **above)
    fine: dict[str, Any] = {"fontsize": SMALL, "color": DARK, "va": "bottom", "linespacing": _LINE}
    if small:
        figure.add_artist(Annotation("\n".join(small), (0.0, 0.0), xycoords=title, **fine))
    if below:
        _put_below(figure, Annotation("\n".join(below), (0.012, 0.0), xycoords="figure fraction", **fine))
    engine = figure.get_layout_engine()
    if engine is not None and any(ax.get_aspect() != "auto" for ax in figure.axes):
        engine.execute(figure)  # its two rounds at drawing do not suffice where a title takes room from a fixed shape


def _within(width: float, text: str, in_an_inch: float, size: float, weight: str = "normal") -> list[str]:
    """A text in lines of a width [inch]: so many letters fit on an inch as a rule, fewer where they are broad."""
    room = _HINTED * 72.0 * (width - 2.0 * _MARGIN) / size
    lines = lines_of(text, in_an_inch * width)
    for letters in range(int(in_an_inch * width) - 1, _LONG_WORD, -1):
        if all(_length(line, weight) <= room for line in lines):
            break
        lines = lines_of(text, letters)
    return lines


def _put_below(figure: Figure, text: Annotation) -> None:
    """Small print at the foot of a figure, which grows by its height."""
    height = (1 + text.get_text().count("\n")) * _LINE * SMALL / 72.0 + 0.5 * SMALL / 72.0
    whole = figure.get_figheight() + height
    figure.set_figheight(whole)
    text.xyann = (0.012, 0.5 * SMALL / 72.0 / whole)
    figure.add_artist(text)
    engine = figure.get_layout_engine()
    if isinstance(engine, ConstrainedLayoutEngine):
        engine.set(rect=(0.0, height / whole, 1.0, 1.0 - height / whole))


def lines_of(text: str, letters: float) -> list[str]:
    """A text in as few lines of so many letters as may be, of like length; a number stays with the word behind it.

    A dollar would begin a formula.
    """
    text = _WITH_NUMBER.sub("\N{NO-BREAK SPACE}", text.replace("$", r"\$"))
    wrap = partial(textwrap.wrap, text, break_long_words=False)
    lines = wrap(int(letters))
    least = math.ceil(len(text) / max(len(lines), 1))
    ways = (wrap(width) for width in range(max(least, 1), int(letters)))
    return next((way for way in ways if len(way) == len(lines)), lines)


def show_constant(ax: Axes, *curves: Array) -> None:
    """Draw what is constant but for rounding as a flat line, on an axis around it; no axis counts from an offset."""
    ax.ticklabel_format(axis="y", useOffset=False)
    values = np.concatenate([np.ravel(curve) for curve in curves] or [np.zeros(0)])
    values = values[np.isfinite(values)]
    largest = float(np.abs(values).max()) if values.size else 0.0
    if largest > 0.0 and np.ptp(values) < _CONSTANT * largest:
        middle = float(values.mean())
        ax.set_ylim(middle - _AROUND * largest, middle + _AROUND * largest)


def height_of(x: Array, y: Array) -> float:
    """Up to which height a curve is shown: all of it, but where it runs away over next to no change of x.

    Cycles grow without bound where the linear loop is at the limit of its stability: all others would lie on the axis.

    Examples
    --------
    >>> x = np.array([0.0, 1.0, 2.0, 2.001])
    >>> height_of(x, np.array([1.0, 2.0, 3.0, 4.0]))
    4.0
    >>> height_of(x, np.array([1.0, 2.0, 3.0, 1e9]))
    6.0
    """
    width, height = np.abs(np.diff(x)), np.fmax(y[1:], y[:-1])
    order = np.argsort(height)
    share = np.cumsum(width[order])
    top = float(np.max(y, initial=0.0))
    usual = float(height[order][np.searchsorted(share, _KEPT * share[-1])]) if len(share) else top
    return top if top <= _RUNS_AWAY * usual else 2.0 * usual


def number_powers(axis: Axis, between: Sequence[float]) -> None:
    """Numbers of an axis of powers of ten: where it has few of these, multiples `between` them or even steps, too."""
    low, high = axis.get_view_interval()
    if high < _NARROW * low:  # powers of ten alone would leave the axis without numbers
        axis.set_major_formatter(lambda value, _: number(value))
        axis.set_minor_locator(LogLocator(subs=between))
        axis.set_minor_formatter(lambda value, _: number(value))
    if high < _SHORT * low:  # where even steps would crowd at the upper end
        axis.set_major_locator(MaxNLocator(4))
        axis.set_minor_locator(NullLocator())


def mark_events(ax: Axes, times: Array) -> None:
    """Grey marks at the foot of a panel where elements switch."""
    if 0 < times.size <= _MOST_MARKS:
        foot: dict[str, Any] = {"color": GREY, "markersize": 5, "transform": ax.get_xaxis_transform()}
        ax.plot(times, np.zeros_like(times), "|", label="switch of an element", **foot)


def draw_nyquist(ax: Axes, response: ComplexArray, locus: ComplexArray, meets: Sequence[complex]) -> None:
    """G(j omega) and -1/N(A) with their directions, in a window that shows where they meet."""
    box = nyquist_window(locus, meets)
    ax.axhline(0.0, color=GREY, linewidth=0.5)
    ax.axvline(0.0, color=GREY, linewidth=0.5)
    ax.plot(response.real, response.imag, color=BLUE, linewidth=1.3, label=r"$G(j\omega)$, growing frequency")
    ax.plot(
        locus.real, locus.imag, color=VERMILLION, linewidth=1.3, linestyle="--", label=r"$-1/N(A)$, growing amplitude"
    )
    _arrows(ax, response, box, BLUE)
    _arrows(ax, locus, box, VERMILLION)
    few_numbers(ax)
    ax.set_xlim(box[0], box[1])
    ax.set_ylim(box[2], box[3])
    ax.set_xlabel("real part")
    ax.set_ylabel("imaginary part")


def nyquist_window(locus: ComplexArray, meets: Sequence[complex]) -> tuple[float, float, float, float]:
    """Limits that show the origin and every cycle (where there is none, -1 and the locus's nearest point).

    Curves that run to infinity are cut.
    """
    finite = locus[np.isfinite(locus)]
    points = [0j, *meets] if len(meets) else [0j, -1.0 + 0j, *finite[np.argsort(np.abs(finite))[:1]]]
    reach = 1.3 * max([abs(p) for p in points])
    reals, imags = [p.real for p in points], [p.imag for p in points]
    return min(reals) - 0.8 * reach, max(reals) + 0.5 * reach, min(imags) - 0.65 * reach, max(imags) + 0.65 * reach


def _arrows(ax: Axes, curve: ComplexArray, box: tuple[float, float, float, float], colour: str) -> None:
    """Two arrow heads along the part of a curve that is inside the picture."""
    with np.errstate(invalid="ignore"):
        inside = (curve.real > box[0]) & (curve.real < box[1]) & (curve.imag > box[2]) & (curve.imag < box[3])
    index = np.flatnonzero(inside[:-1] & inside[1:])
    length = np.cumsum(np.abs(np.diff(curve)[index]))
    if not index.size or length[-1] == 0.0:
        return
    head = {"arrowstyle": "-|>", "color": colour, "linewidth": 1.3}
    for share in (0.3, 0.75):
        k = index[int(np.searchsorted(length, share * length[-1]))]
        start, end = curve[k], curve[k + 1]
        near = end + 1e-3 * (start - end)
        ax.annotate("", (end.real, end.imag), (near.real, near.imag), arrowprops=head)


def chosen(available: Mapping[str, Any], signals: Sequence[str] | None) -> list[str]:
    """The signals that were requested; all by default."""
    names = list(available) if signals is None else list(signals)
    missing = [name for name in names if name not in available]
    if missing:
        raise EppError(f"There is no signal {shown(missing[0])}; expected one of {', '.join(available)}.")
    if not names:
        raise EppError("There is no signal to draw; expected at least one.")
    return names


def main_signals(names: Sequence[str], own: str | None = None) -> list[str]:
    """Of many signals the two that are drawn: a loop's own, by default the first, and what its controller reads.

    Examples
    --------
    >>> main_signals(["theta", "theta_dot", "voltage", "sensor_force"])
    ['theta', 'sensor_force']
    >>> main_signals(["x", "y", "z"], "y")
    ['y', 'x']
    """
    first = own or names[0]
    others = sorted((name for name in names if name != first), key=lambda name: name != _READ)
    return [first, *others[:1]]


def figure_of_height(height: float) -> Figure:
    """An empty figure of the house's width, and so high [inch]."""
    return Figure(figsize=(WIDTH, height), layout="constrained")


def panels_of(n: int, height: float = _PANEL_HEIGHT) -> tuple[Figure, list[Axes]]:
    """A figure with `n` panels below each other; many are lower."""
    figure = figure_of_height(0.9 + n * (min(height, _LOW_PANEL) if n > _MANY_PANELS else height))
    panels = list(figure.subplots(n, 1, squeeze=False)[:, 0])
    for ax in panels:
        ax.spines[["top", "right"]].set_visible(False)
    return figure, panels


def place_of(ax: Axes | None, height: float) -> tuple[Figure, Axes]:
    """The given axes with their figure, or axes of their own on a figure of this height [inch]."""
    if ax is not None:
        return root_figure(ax), ax
    figure = figure_of_height(height)
    return figure, figure.add_subplot()


def places_of(ax: Axes | None, n: int, height: float = _PANEL_HEIGHT) -> tuple[Figure, list[Axes]]:
    """The given axes, which have room for the first panel alone, or `n` panels on a figure of their own."""
    return panels_of(n, height) if ax is None else (root_figure(ax), [ax])


class _InUnit(MaxNLocator):
    """Round numbers of a unit, on an axis of SI values."""

    def __init__(self, factor: float) -> None:
        super().__init__(nbins=_MOST_NUMBERS, steps=[1, 1.5, 2, 3, 5, 6, 10])
        self.factor = factor

    def tick_values(self, vmin: float, vmax: float) -> Any:
        """Where the ticks are [SI]."""
        return np.asarray(super().tick_values(vmin * self.factor, vmax * self.factor)) / self.factor


def label_time(panels: Sequence[Axes], text: str, units: Mapping[str, str] | None = None) -> None:
    """The lowest of the panels carries the label of the time axis, and all share its range; its numbers are in the
    unit in which people read times beside signals of these units.
    """
    factor = readable((units or {}).get("time", "s"))[1]
    for ax in panels:
        few_numbers(ax)
        if factor != 1.0:
            ax.xaxis.set_major_locator(_InUnit(factor))
            ax.xaxis.set_major_formatter(lambda time, _: number(factor * time))
        ax.margins(x=0.0)
        ax.tick_params(labelbottom=ax is panels[-1])
    panels[-1].set_xlabel(text)
    root_figure(panels[0]).align_ylabels(panels)


def few_numbers(ax: Axes) -> None:
    """The level axis has so few numbers that long ones do not touch."""
    ax.locator_params(axis="x", nbins=_MOST_NUMBERS)


def label_up(ax: Axes, text: str, least: float = _LOW_PANEL) -> None:
    """The label of the upright axis, in as many lines as the height of its panel, `least` [inch] or more, needs."""
    height = ax.get_position().height * root_figure(ax).get_figheight()
    letters = _LABEL_IN_AN_INCH * max(height, least)
    ax.set_ylabel(text if len(text) < letters else "\n".join(lines_of(text, letters)))


def label_of(
    name: str, units: Mapping[str, str], shown: Mapping[str, tuple[str, float]] | None = None
) -> tuple[str, float]:
    """A name with the unit that people read it in, that of `shown` where it is there, and the factor from SI."""
    unit, factor = (shown or {}).get(name) or readable(units.get(name, ""))
    return with_unit(words(name), unit), factor


def each_once(ax: Axes) -> dict[str, Any]:
    """What a legend names, by its text: marks that share one are there once."""
    handles, texts = ax.get_legend_handles_labels()
    return dict(zip(texts, handles, strict=True))


def put_legend(ax: Axes, handles: Sequence[Artist] = (), **place: Any) -> None:
    """What marks mean, in as many columns as there is room for, above the axes, where they cover nothing.

    In a figure that nothing lays out what is above axes is cut off; there it is put where it covers least.
    """
    marks = {str(handle.get_label()): handle for handle in handles} or each_once(ax)
    if not marks:
        return
    laid_out = root_figure(ax).get_layout_engine() is not None
    equal = ax.get_aspect() != "auto"  # such axes do not fill their place, whose width the legend may take
    above: dict[str, Any] = {"frameon": False, "borderaxespad": 0.2, "loc": "lower center" if equal else "lower left"}
    above["bbox_to_anchor"] = (0.5 if equal else 0.0, 1.0)
    inside: dict[str, Any] = {"framealpha": 0.9, "loc": "best"}
    here = ax.get_position()
    right = 1.0 if here.x1 > _OUTERMOST else here.x1
    texts, columns = in_columns(marks, (right - here.x0) * root_figure(ax).get_figwidth())
    usual: dict[str, Any] = {"ncols": columns, "fontsize": SMALL} | (above if laid_out else inside)
    ax.legend(marks.values(), texts, **(usual | place))


def legend_below(figure: Figure, *panels: Axes) -> None:
    """What the marks and shades of panels mean, once, below all of them: of a figure of their own."""
    marks: dict[str, Any] = {}
    for ax in panels:
        marks |= each_once(ax)
    if marks:
        texts, columns = in_columns(marks, 0.96 * figure.get_figwidth())
        place: dict[str, Any] = {"loc": "outside lower center", "frameon": False}
        figure.legend(marks.values(), texts, ncols=columns, fontsize=SMALL, **place)


def in_columns(texts: Iterable[str], width: float) -> tuple[list[str], int]:
    r"""Texts of a legend, long ones in lines, and the columns, four at most, in which it fits into a width [inch].

    Examples
    --------
    >>> in_columns(["stable", "unstable"], 4.0)
    (['stable', 'unstable'], 2)
    >>> in_columns(["no size tried starts a cycle"], 2.0)
    (['no size tried\nstarts a cycle'], 1)
    """
    room = _HINTED * 72.0 * width / SMALL
    most = room - _SIGN
    lines = [text if _length(text) < most else "\n".join(lines_of(text, 1.6 * most)) for text in texts]
    sizes = [max(map(_length, text.split("\n"))) + _SIGN for text in lines]
    for columns in range(min(4, len(sizes)), 1, -1):
        if sum(map(max, np.array_split(sizes, columns))) <= room:  # as matplotlib shares entries out
            return lines, columns
    return lines, 1


def _length(text: str, weight: str = "normal") -> float:
    """How long a text is, in sizes of its letters."""
    if not text.strip():
        return 0.0
    # Curves of letters turn at their points: to look for turns between these takes twenty times as long.
    outline = TextPath((0.0, 0.0), text, size=1.0, prop=FontProperties(weight=weight))
    return float(np.ptp(outline.vertices[outline.codes != outline.CLOSEPOLY, 0]))


def figure_of(picture: Axes | Figure) -> Figure:
    """A figure itself, or that of axes."""
    return root_figure(picture) if isinstance(picture, Axes) else picture


def root_figure(ax: Axes) -> Figure:
    """The outermost figure of axes."""
    figure = ax.figure
    while isinstance(figure, SubFigure):
        figure = figure.figure
    return figure


def note_below(ax: Axes, text: str) -> None:
    """Small print below a panel: what its picture does not show."""
    width = ax.get_position().width * root_figure(ax).get_figwidth()
    place: dict[str, Any] = {"xytext": (0.0, -34.0), "textcoords": "offset points", "va": "top"}
    lines = "\n".join(lines_of(text.strip(), _SMALL_IN_AN_INCH * width))
    ax.annotate(lines, (0.0, 0.0), xycoords="axes fraction", fontsize=SMALL, color=DARK, **place)
