"""The four pictures of the page, as Bokeh figures that take new data without being made anew."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from bokeh.events import Pan, PanEnd, PanStart, PointEvent, Tap
from bokeh.models import ColumnDataSource, LinearColorMapper, Range1d
from bokeh.models.annotations import Span, Title
from bokeh.models.glyphs import MultiLine
from bokeh.plotting import figure

from eppanalysis.explorer.quick import Quick
from eppanalysis.plotting import BLUE, GREEN, GREY, ORANGE, VERMILLION, height_of, nyquist_window
from eppanalysis.readable import with_unit, words
from eppanalysis.sweep.picture import OUTCOME_COLOURS

_TOOLS = "pan,box_zoom,wheel_zoom,reset,save"
_HEIGHT = 360
#: Of a run's line [px]: a wider one is an outline that browsers fill, some twenty times as long for many oscillations.
_THIN = 1.0
#: Dashes [px]; what Bokeh calls dashed is dotted in a row of curves.
_DASHED = "6 5"
#: How near to the design a drag begins, relative to the axes.
_NEAR = 0.06
#: Outcomes of the map's cells in words, as its legend has them; of those between runs of different ends it is not said.
_CODES = {1: "settles", 2: "oscillates", 3: "diverges", 0: "not decided", len(OUTCOME_COLOURS): "changes in between"}
_BETWEEN, _BETWEEN_COLOUR = len(OUTCOME_COLOURS), "#f0f0f0"
_MAP_COLOURS = (*OUTCOME_COLOURS, _BETWEEN_COLOUR)
#: What follows the design in the map's legend.
DRAGGED = " (drag or tap)"
_NOTHING: dict[str, list[Any]] = {"x": [], "y": []}
#: Columns of the Nyquist plot.
_CURVES = ("response", "locus")
_NYQUIST = [f"{name}_{axis}" for name in (*_CURVES, "first", "run") for axis in "xy"]
#: Room round what the Nyquist plot must show; from its square on the window shrinks.
_ROOM = 1.2

#: Left, right, bottom, top.
Window = tuple[float, float, float, float]


def _figure(title: str, x: str, y: str, **options: Any) -> Any:
    """An empty picture with labelled axes."""
    made = figure(
        title=Title(text=title, text_font_size="14px"),
        x_axis_label=x,
        y_axis_label=y,
        height=_HEIGHT,
        sizing_mode="stretch_width",
        tools=_TOOLS,
        active_drag=None,
        active_scroll=None,
        toolbar_location="above",
        **options,
    )
    made.toolbar.logo = None
    # Until the page says which: white that is painted over by night would stay as a line at the picture's edges.
    made.border_fill_color = None
    for axis in made.axis:
        axis.axis_label_text_font_style = "normal"
        axis.axis_label_text_font_size = "13px"
    return made


def _mark_run(made: figure, source: ColumnDataSource, x: str = "x", y: str = "y") -> None:
    """The cross of the own run, in ink: black by day, light by night."""
    style: dict[str, Any] = {"marker": "x", "size": 12, "color": "black", "line_width": 2, "tags": ["ink"]}
    made.scatter(x, y, source=source, legend_label="run", **style)


def _legend(made: Any) -> None:
    """Below the picture, where it hides nothing; it names what there is."""
    legend = made.legend[0]
    for item in legend.items:
        source = item.renderers[0].data_source
        source.on_change("data", partial(_name_what_is_there, item))
        _name_what_is_there(item, "data", None, source.data)
    made.add_layout(legend, "below")
    legend.orientation, legend.ncols = "horizontal", 3
    legend.label_text_font_size = "11px"
    legend.border_line_color = None
    legend.padding = legend.margin = 2
    legend.spacing = 10


def _name_what_is_there(item: Any, attr: str, old: Any, data: Any) -> None:
    """A name in the legend whose mark has no place would be alone."""
    glyph = item.renderers[0].glyph
    places = data[glyph.xs if isinstance(glyph, MultiLine) else glyph.x]
    item.visible = any(bool(np.isfinite(place).any()) for place in places)


class RunPictures:
    """The two pictures that follow every move: their curves come in one row, so that both are drawn at once.

    Apart, the second would wait until the browser has drawn the first.
    """

    def __init__(self, signal: str, unit: str) -> None:
        self.row = ColumnDataSource(data={})
        self.step, self.nyquist = StepPicture(signal, unit, self.row), NyquistPicture(self.row)

    def show(self, quick: Quick, text: str) -> None:
        """New data, and in words of what."""
        self.row.data = self.step.columns(quick, text) | self.nyquist.columns(quick)


class StepPicture:
    """The run in time."""

    def __init__(self, signal: str, unit: str, row: ColumnDataSource) -> None:
        self.row, self.ghost = row, ColumnDataSource(data={"time": [], "values": []})
        self.row.data = {**self.row.data, **self.ghost.data}
        made = self.figure = _figure("Step response", "time [s]", with_unit(words(signal), unit), name="step")
        now = made.multi_line("time", "values", source=self.row, color=BLUE, line_width=_THIN, legend_label="now")
        made.x_range.renderers = [now]  # a ghost that was shown for longer would make it look as if it ended
        behind: dict[str, Any] = {"color": GREY, "line_width": _THIN, "alpha": 0.85, "level": "underlay"}
        made.multi_line("time", "values", source=self.ghost, legend_label="before", **behind)
        self.now, self.before = made.legend[0].items
        self.kept, self.text = False, ""
        self.old: tuple[dict[str, Any], str] | None = None
        _legend(made)
        made.legend[0].ncols = 1

    def columns(self, quick: Quick, text: str) -> dict[str, Any]:
        """What is drawn of a run, which in words is `text`."""
        if self.kept:
            self.kept, self.old = False, ({name: self.row.data[name] for name in self.ghost.data}, self.text)
        self.text = text
        return {"time": [quick.time.astype(np.float32)], "values": [quick.values.astype(np.float32)]}

    def keep(self) -> None:
        """The run of now will be the ghost behind the next."""
        self.kept = True

    def name(self) -> None:
        """The ghost and the names in the legend, which cost a second drawing."""
        self.now.label = {"value": f"now: {self.text}"}
        if self.old is not None:
            self.ghost.data, text = self.old
            self.before.label = {"value": f"before: {text}"}
            self.old = None


class NyquistPicture:
    """The rest of the loop and -1/N of the element at the cut."""

    def __init__(self, row: ColumnDataSource) -> None:
        ranges = {"x_range": Range1d(start=-2.0, end=1.0), "y_range": Range1d(start=-1.5, end=1.5)}
        self.window: Window | None = None
        made = self.figure = _figure("Nyquist", "real part", "imaginary part", name="nyquist", **ranges)
        for dimension in ("width", "height"):
            made.add_layout(Span(location=0, dimension=dimension, line_color=GREY, line_width=0.7))
        row.data = {**row.data, **dict.fromkeys(_NYQUIST, [])}
        made.multi_line("response_x", "response_y", source=row, color=BLUE, line_width=1.5, legend_label="G(jω)")
        style: dict[str, Any] = {"color": VERMILLION, "line_width": 2, "line_dash": _DASHED}
        made.multi_line("locus_x", "locus_y", source=row, legend_label="−1/N(A)", **style)
        made.scatter(
            "first_x", "first_y", source=row, color=GREEN, size=10, legend_label="cycle of the describing function"
        )
        _mark_run(made, row, "run_x", "run_y")
        _legend(made)

    def columns(self, quick: Quick) -> dict[str, Any]:
        """What is drawn of a loop, in a window round the origin and the cycle."""
        loop = quick.loop
        if loop is None:
            self.figure.title.text = "Nyquist: an element has no gain to draw"
            return {name: [[] if name.startswith(_CURVES) else math.nan] for name in _NYQUIST}
        self.figure.title.text = f"Nyquist, cut at {words(loop.element)}"
        box = self._frame(nyquist_window(loop.locus, [] if loop.point is None else [loop.point]))
        curves = {"response": _curve(loop.response, box), "locus": _curve(loop.locus, box)}
        marks = {"first": _mark(loop.point if quick.first_order else None), "run": _mark(quick.of_run)}
        return {f"{name}_{axis}": [value] for name, place in {**curves, **marks}.items() for axis, value in place}

    def _frame(self, wanted: Window) -> Window:
        """The window stays while it holds what is wanted and not much more: curves move, axes do not."""
        now = self.window
        if now is None or not _holds(now, wanted) or _holds(now, _grown(wanted, _ROOM**2)):
            now = self.window = _grown(wanted, _ROOM)
            self.figure.x_range.update(start=now[0], end=now[1])
            self.figure.y_range.update(start=now[2], end=now[3])
        return now


def _holds(outer: Window, inner: Window) -> bool:
    return all(outer[i] <= inner[i] and inner[i + 1] <= outer[i + 1] for i in (0, 2))


def _grown(box: Window, factor: float) -> Window:
    """The same middle, wider and higher."""
    (x, dx), (y, dy) = (((box[i] + box[i + 1]) / 2, factor * (box[i + 1] - box[i]) / 2) for i in (0, 2))
    return x - dx, x + dx, y - dy, y + dy


def _put(source: ColumnDataSource, data: dict[str, list[float]]) -> None:
    """New marks, unless they are the old ones: what did not change is not drawn again."""
    if dict(source.data) != data:
        source.data = data


def _mark(point: complex | None) -> tuple[tuple[str, float], ...]:
    return ("x", math.nan if point is None else point.real), ("y", math.nan if point is None else point.imag)


def _curve(values: Any, box: Window) -> tuple[tuple[str, Any], ...]:
    """The part of a curve that may be seen; far away from the window it is cut."""
    near = np.abs(values) < 6.0 * max(map(abs, box))
    cut = np.where(near, values, complex(math.nan, math.nan))
    return ("x", cut.real.astype(np.float32)), ("y", cut.imag.astype(np.float32))


class BranchPicture:
    """All limit cycles over one parameter, with those of the case on it."""

    def __init__(self, signal: str, unit: str) -> None:
        label = f"{with_unit(words(signal), unit)}, peak to peak"
        made = self.figure = _figure("Limit cycles", "", label, name="branch")
        self.stable, self.unstable = (ColumnDataSource(data={"xs": [], "ys": []}) for _ in range(2))
        self.begins, self.exact_stable, self.exact_unstable, self.run = (
            ColumnDataSource(data=_NOTHING) for _ in range(4)
        )
        made.multi_line("xs", "ys", source=self.stable, color=BLUE, line_width=2, legend_label="stable")
        style: dict[str, Any] = {"color": VERMILLION, "line_width": 2, "line_dash": _DASHED}
        made.multi_line("xs", "ys", source=self.unstable, legend_label="unstable", **style)
        made.scatter("x", "y", source=self.begins, marker="diamond", size=11, color=ORANGE, legend_label="cycles begin")
        marks: dict[str, Any] = {"size": 10, "line_color": GREEN, "line_width": 2}
        made.scatter("x", "y", source=self.exact_stable, fill_color=GREEN, legend_label="exact, stable", **marks)
        made.scatter("x", "y", source=self.exact_unstable, fill_color="white", legend_label="exact, unstable", **marks)
        _mark_run(made, self.run)
        self.here = Span(location=0, dimension="height", line_color=GREY, line_dash="dotted", line_width=1.5)
        made.add_layout(self.here)
        made.y_range.start = 0
        _legend(made)

    def show_run(self, place: float, size: float) -> None:
        """The place of the case on the axis, and what its run does; nan if that is not decided."""
        self.here.location = place
        _put(self.run, _NOTHING if math.isnan(size) else {"x": [place], "y": [size]})

    def show_branch(self, facts: dict[str, Any], label: str, x_factor: float, y_factor: float) -> None:
        """The branch."""
        lines: dict[bool, dict[str, list[list[float]]]] = {kind: {"xs": [], "ys": []} for kind in (True, False)}
        for piece in facts["pieces"]:
            top = height_of(np.array(piece["value"]), np.array(piece["size"]))
            for kind, xs, ys in _runs_of(piece["stable"], piece["value"], piece["size"]):
                lines[kind]["xs"].append([x_factor * x for x in xs])
                lines[kind]["ys"].append([y_factor * y if y <= top else math.nan for y in ys])
        self.stable.data, self.unstable.data = lines[True], lines[False]
        self.begins.data = {
            "x": [x_factor * x for x, _ in facts["begins"]],
            "y": [y_factor * y for _, y in facts["begins"]],
        }
        self.figure.xaxis.axis_label = label

    def show_exact(self, facts: dict[str, Any] | None, place: float, factor: float) -> None:
        """The exact cycles of the case; None takes them away."""
        for kind, source in ((True, self.exact_stable), (False, self.exact_unstable)):
            sizes = (
                []
                if facts is None
                else [s for s, stable in zip(facts["size"], facts["stable"], strict=True) if stable is kind]
            )
            _put(source, {"x": [place] * len(sizes), "y": [factor * s for s in sizes]})


def _runs_of(
    stable: Sequence[bool], x: Sequence[float], y: Sequence[float]
) -> list[tuple[bool, list[float], list[float]]]:
    """Pieces of equal stability; each begins where the one before ends."""
    out: list[tuple[bool, list[float], list[float]]] = []
    for i, kind in enumerate(map(bool, stable)):
        if not out or out[-1][0] is not kind:
            out.append((kind, [x[i - 1]] if i else [], [y[i - 1]] if i else []))
        out[-1][1].append(x[i])
        out[-1][2].append(y[i])
    return out


class MapPicture:
    """Where the design settles and where it oscillates, with the case on it."""

    def __init__(self, x_label: str, y_label: str, xs: tuple[float, float], ys: tuple[float, float]) -> None:
        ranges = {"x_range": Range1d(start=xs[0], end=xs[1]), "y_range": Range1d(start=ys[0], end=ys[1])}
        made = self.figure = _figure("Design map", x_label, y_label, name="map", **ranges)
        self.cells = ColumnDataSource(data={"image": [], "x": [], "y": [], "dw": [], "dh": []})
        self.star, self.begins = ColumnDataSource(data=_NOTHING), ColumnDataSource(data=_NOTHING)
        colours = LinearColorMapper(palette=_MAP_COLOURS, low=-0.5, high=len(_MAP_COLOURS) - 0.5)
        made.image(image="image", x="x", y="y", dw="dw", dh="dh", source=self.cells, color_mapper=colours)
        for code, word in _CODES.items():
            made.scatter([math.nan], [math.nan], marker="square", size=11, color=_MAP_COLOURS[code], legend_label=word)
        self.border = ColumnDataSource(data=_NOTHING)
        made.line("x", "y", source=self.border, color="black", line_width=2.0, legend_label="cycles end, exactly")
        edged: dict[str, Any] = {"fill_color": "white", "line_color": "black", "line_width": 1.5}
        made.scatter(
            "x", "y", source=self.begins, marker="diamond", size=13, legend_label="cycles begin, exactly", **edged
        )
        # Black with a white edge: the map's colours are light by day and by night, and its paper is dark at night.
        star: dict[str, Any] = {"marker": "star", "size": 19, "fill_color": "black", "line_color": "white"}
        made.scatter("x", "y", source=self.star, legend_label="the case", **star)
        _legend(made)
        for item in made.legend[0].items[: len(_CODES)]:
            item.visible = True  # colours that have no place of their own
        made.legend[0].ncols = 2  # on a phone three are wider than the screen

    def show_place(self, x: float, y: float) -> None:
        """The place of the case, in the picture and in its legend."""
        _put(self.star, {"x": [x], "y": [y]})
        self.figure.legend[0].items[-1].label = {"value": f"the design: {x:.4g}, {y:.4g}{DRAGGED}"}

    def show_begins(self, places: Sequence[tuple[float, float]]) -> None:
        """Where cycles appear exactly, which cells tell to their width only."""
        self.begins.data = {"x": [x for x, _ in places], "y": [y for _, y in places]}

    def show_border(self, facts: dict[str, Any], x_factor: float, y_factor: float) -> None:
        """The whole border of where there is no limit cycle."""
        self.border.data = {n: np.asarray(facts[n]) * f for n, f in (("x", x_factor), ("y", y_factor))}

    def on_drag(self, begin: Callable[[], None], move: Callable[[float, float], None], end: Callable[[], None]) -> None:
        """Say what is done when the design is dragged on the map, or put to where the map is tapped."""
        dragged = False

        def begins(event: PanStart) -> None:
            nonlocal dragged
            dragged = self._is_near(event)
            if dragged:
                begin()

        def moves(event: Pan) -> None:
            if dragged and event.x is not None and event.y is not None:
                move(event.x, event.y)

        def ends(event: PanEnd) -> None:
            nonlocal dragged
            if dragged:
                dragged = False
                end()

        def put(event: Tap) -> None:
            if event.x is not None and event.y is not None:
                begin()
                move(event.x, event.y)
                end()

        for kind, act in ((PanStart, begins), (Pan, moves), (PanEnd, ends), (Tap, put)):
            self.figure.on_event(kind, act)

    def _is_near(self, event: PointEvent) -> bool:
        """Whether a place is at the design, so that box zoom and pan are left what begins elsewhere."""
        if not self.star.data["x"] or event.x is None or event.y is None:
            return False
        spans = (self.figure.x_range, self.figure.y_range)
        away = (event.x - self.star.data["x"][0], event.y - self.star.data["y"][0])
        return all(abs(d) < _NEAR * (s.end - s.start) for d, s in zip(away, spans, strict=True))

    def show_cells(self, facts: dict[str, Any], x_factor: float, y_factor: float) -> None:
        """The outcomes, and in the legend those that there are.

        A cell has runs at its corners, and is what all of them are: where they end differently, a border goes through
        it, and where that is the cell does not know.
        """
        xs, ys = (np.asarray(facts[n]) * f for n, f in (("x", x_factor), ("y", y_factor)))
        ends = np.asarray(facts["outcome"], dtype=np.uint8)
        corners = np.stack([ends[:-1, :-1], ends[1:, :-1], ends[:-1, 1:], ends[1:, 1:]])
        outcome = np.where(np.ptp(corners, axis=0) == 0, corners[0], _BETWEEN).astype(np.uint8)
        for code, item in zip(_CODES, self.figure.legend[0].items, strict=False):
            item.visible = bool(np.any(outcome == code))
        self.cells.data = {
            "image": [outcome],
            "x": [xs[0]],
            "y": [ys[0]],
            "dw": [xs[-1] - xs[0]],
            "dh": [ys[-1] - ys[0]],
        }
