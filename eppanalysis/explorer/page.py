"""One page: its sliders, its pictures, its history. Every tab has one of its own."""

from __future__ import annotations

import base64
import math
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import partial
from typing import TYPE_CHECKING, Any

from bokeh.events import DocumentReady
from bokeh.models import ColumnDataSource, CustomJS, CustomJSTickFormatter
from bokeh.models.widgets import Button, Div, Select, Slider as SliderWidget, TextInput

from eppanalysis.cases import Case, variation_of
from eppanalysis.cases.elbow_case import current
from eppanalysis.cases.variation import Slider
from eppanalysis.errors import EppError
from eppanalysis.explorer import quick, slow
from eppanalysis.explorer.figures import BranchPicture, MapPicture, RunPictures
from eppanalysis.explorer.looks import LOOKS, WIDGETS
from eppanalysis.explorer.standalone import standalone
from eppanalysis.explorer.values import Values, moved_case, read_pair, read_query, write_query
from eppanalysis.readable import DIGITS, in_print, readable, words

if TYPE_CHECKING:
    from bokeh.document import Document

#: How long after the last move the slow pictures begin [ms].
_CALM = 500
#: How long after a run the pictures beside it follow [ms].
_MOMENT = 50
_MOST_STEPS_BACK = 200
#: A slider's number as all are written, however small.
_DIGITS = f"return String(+tick.toPrecision({DIGITS}))"
_ADDRESS = "history.replaceState(null, '', cb_obj.data.query[0] ? '?' + cb_obj.data.query[0] : location.pathname);"
_COPY = """
const done = () => { cb_obj.label = 'Link copied'; setTimeout(() => { cb_obj.label = 'Copy link'; }, 1500); };
if (navigator.clipboard) { navigator.clipboard.writeText(location.href).then(done); }
else { window.prompt('Link', location.href); }
"""
_SAVE = """
const bytes = Uint8Array.from(atob(cb_obj.data.base64[0]), (c) => c.charCodeAt(0));
const link = document.createElement('a');
link.href = URL.createObjectURL(new Blob([bytes], {type: cb_obj.data.mime[0]}));
link.download = cb_obj.data.name[0];
link.click();
setTimeout(() => URL.revokeObjectURL(link.href), 1000);
"""


class Page:
    """The page of one tab.

    Parameters
    ----------
    doc : bokeh.document.Document
    base : Case
        The case as it was given.
    threads : ThreadPoolExecutor
        Where quick things are computed.
    workshop : slow.Workshop
        Where slow things are.
    """

    def __init__(self, doc: Document, base: Case, threads: ThreadPoolExecutor, workshop: slow.Workshop) -> None:
        self.doc, self.base, self.threads, self.workshop = doc, base, threads, workshop
        self.signal = quick.shown_signal(base)
        units = base.to_system().signals.units_by_name()
        self.unit, self.factor = readable(units.get(self.signal, ""))
        self.sliders = {slider.name: slider for slider in variation_of(base).sliders()}
        self.values: Values = {}
        self.history: list[Values] = []
        self.case = base
        self.version = 0
        self.computing = self.marking = self.setting = False
        self.size, self.until = math.nan, 0.0
        self.later: Any = None
        self.running: dict[str, Future[Any]] = {}
        self.shown: dict[str, Any] = {}
        self._make_widgets()
        self._make_pictures()
        self._open(_arguments(doc))

    def close(self) -> None:
        """The tab is gone: nothing that it requested is needed any more."""
        for future in self.running.values():
            future.cancel()

    def _make_widgets(self) -> None:
        self.widgets = {name: self._slider(slider) for name, slider in self.sliders.items()}
        self.heading = Div(text="", name="heading", render_as_text=True, sizing_mode="stretch_width")
        self.verdict = Div(text="", name="verdict", render_as_text=True, sizing_mode="stretch_width")
        self.exact = Div(text="", name="exact", render_as_text=True, sizing_mode="stretch_width")
        self.ends = Div(text="", name="ends", render_as_text=True, sizing_mode="stretch_width")
        self.message = Div(text="", name="message", render_as_text=True, sizing_mode="stretch_width")
        self.field = TextInput(
            title="Set any field",
            placeholder=variation_of(self.base).example,
            name="field",
            sizing_mode="stretch_width",
            stylesheets=[WIDGETS],
        )
        self.field.on_change("value", lambda attr, old, new: self._set_field(new))
        self.over = Select(
            title="Limit cycles over",
            options=list[Any]((s.name, s.title) for s in self.sliders.values()),
            value=self._first("lock_pin.backlash"),
            name="over",
            sizing_mode="stretch_width",
            stylesheets=[WIDGETS],
        )
        self.over.on_change("value", lambda attr, old, new: self._begin_slow())
        self.address = ColumnDataSource(data={"query": [""]})
        self.address.js_on_change("data", CustomJS(code=_ADDRESS))
        self.download = ColumnDataSource(data={"name": [], "mime": [], "base64": []})
        self.download.js_on_change("data", CustomJS(code=_SAVE))
        self.undo = self._button("Undo", "undo", self._undo)
        self.reset = self._button("Reset", "reset", self._reset)
        self.undo.tags = [self.address, self.download]  # they are of the page without being seen on it
        self.link = Button(label="Copy link", name="link", sizing_mode="stretch_width", stylesheets=[WIDGETS])
        self.link.js_on_click(CustomJS(code=_COPY))
        self.remedies = self._button("What ends it?", "remedies", self._ask_remedies)
        self.save_case = self._button("Case file", "save_case", self._save_case)
        self.save_picture = self._button("Picture", "save_picture", self._save_picture)
        self.save_page = self._button("Page", "save_page", self._save_page)
        said = (self.heading, self.verdict, self.exact, self.ends, self.message)
        files = (self.remedies, self.link, self.save_case, self.save_picture, self.save_page)
        for widget in (*said, self.field, self.over, self.undo, self.reset, *files):
            self.doc.add_root(widget)

    def _slider(self, slider: Slider) -> SliderWidget:
        widget = SliderWidget(
            title=in_print(slider.label()),
            start=slider.low,
            end=slider.high,
            step=slider.step,
            value=slider.value,
            format=CustomJSTickFormatter(code=_DIGITS),
            name=f"slider_{len(self.doc.roots)}",
            tags=[slider.name],
            sizing_mode="stretch_width",
            stylesheets=[WIDGETS],
        )
        widget.on_change("value", lambda attr, old, new: self._move(slider, new))
        widget.on_change("value_throttled", lambda attr, old, new: self._moved())
        self.doc.add_root(widget)
        return widget

    def _button(self, label: str, name: str, act: Callable[[], None]) -> Button:
        button = Button(label=label, name=name, sizing_mode="stretch_width", stylesheets=[WIDGETS])
        button.on_click(act)
        return button

    def _make_pictures(self) -> None:
        self.run = RunPictures(self.signal, self.unit)
        self.step = self.run.step
        self.branch = BranchPicture(self.signal, self.unit)
        self.pictures: list[Any] = [self.step, self.run.nyquist, self.branch]
        self.axes: tuple[Slider, Slider] | None = None
        self.map: MapPicture | None = None
        names = [n for n in ("bands.range", "lock_pin.backlash") if n in self.sliders] or list(self.sliders)[:2]
        if len(names) == 2:
            self.axes = (self.sliders[names[0]], self.sliders[names[1]])
            ends = [(a.low, a.high) for a in self.axes]
            self.map = MapPicture(self.axes[0].label(), self.axes[1].label(), *ends)
            self.pictures.append(self.map)
            self.map.on_drag(self._drag_begins, self._drag, self._moved)
        for picture in self.pictures:
            self.doc.add_root(picture.figure)
        self.doc.js_on_event(DocumentReady, CustomJS(code=LOOKS))

    def _first(self, liked: str) -> str:
        return liked if liked in self.sliders else next(iter(self.sliders), "")

    # What the reader does.

    def _open(self, arguments: Mapping[str, list[bytes]]) -> None:
        """Begin with the values of the address."""
        values, sentences = read_query(self.base, arguments)
        self._take(values, remember=False)
        self.message.text = " ".join(sentences)

    def _move(self, slider: Slider, value: float) -> None:
        if self.setting:
            return
        # A whole drag is one step of Undo.
        if not self.shown.get("moving"):
            self._remember()
            self.shown["moving"] = True
        self.values = {**self.values, slider.name: value * slider.per_unit}
        self.message.text = ""
        self._begin_quick()

    def _drag_begins(self) -> None:
        self._remember()
        self.shown["moving"] = True

    def _drag(self, x: float, y: float) -> None:
        """The design is moved on the map, to a place in the units of its axes."""
        assert self.axes is not None
        places = {a.name: _on_slider(a, value) for a, value in zip(self.axes, (x, y), strict=True)}
        given = {name: value * self.sliders[name].per_unit for name, value in places.items()}
        try:
            moved_case(self.base, {**self.values, **given})
        except EppError as error:
            self.message.text = str(error)
            return
        self.values = {**self.values, **given}
        self.message.text = ""
        self.setting = True
        try:
            for name, value in places.items():
                self.widgets[name].value = value
        finally:
            self.setting = False
        self._begin_quick()

    def _moved(self) -> None:
        """A slider, or the design on the map, has been let go."""
        self.shown["moving"] = False
        if not self.computing:  # the picture comes first
            self._write_address()

    def _set_field(self, text: str) -> None:
        if not text.strip():
            return
        name, _, value = text.partition("=")
        try:
            values = {**self.values, name.strip(): read_pair(self.base, name.strip(), value.strip())}
            moved_case(self.base, values)
        except EppError as error:
            self.message.text = str(error)
            return
        self.field.value = ""
        self._take(values)

    def _undo(self) -> None:
        if self.history:
            self._take(self.history.pop(), remember=False)

    def _reset(self) -> None:
        if self.values:
            self._take({})

    def _remember(self) -> None:
        self.step.keep()
        self.history = [*self.history[1 - _MOST_STEPS_BACK :], self.values]

    def _take(self, values: Values, remember: bool = True) -> None:
        """Go to other values at once, sliders and all."""
        if remember:
            self._remember()
        self.values = dict(values)
        self.message.text = ""
        self.setting = True
        try:
            case = moved_case(self.base, self.values)
            for name, widget in self.widgets.items():
                slider = self.sliders[name]
                shown = (current(case, name) or 0.0) / slider.per_unit if name in values else slider.value
                widget.start, widget.end = min(widget.start, shown), max(widget.end, shown)
                widget.value = shown
        finally:
            self.setting = False
        self._write_address()
        self._begin_quick()

    def _write_address(self) -> None:
        self.address.data = {"query": [write_query(self.base, self.values)]}

    def _save_case(self) -> None:
        self._send(f"{self.base.name}.toml", "application/toml", self.case.to_toml(comments=True).encode())

    def _ask_remedies(self) -> None:
        """Why the case oscillates as it is now, and what ends it."""
        self.shown["ends"] = dict(self.values)
        self.ends.text = "What ends it: being tried ..."

        def then(facts: slow.Facts) -> None:
            if self.shown.get("ends") == self.values:
                self.ends.text = facts["error"] if "error" in facts else facts["sentence"]

        self._ask("remedies", slow.remedies, (slow.Given.of(self.case, self.signal),), then)

    def _save_picture(self) -> None:
        self.save_picture.label = "Picture ..."

        def then(facts: slow.Facts) -> None:
            self.save_picture.label = "Picture"
            if "error" in facts:
                self.message.text = facts["error"]
            else:
                self._send(f"{self.base.name}.png", "image/png", facts["png"])

        self._ask("picture", slow.picture, (slow.Given.of(self.case, self.signal),), then)

    def _save_page(self) -> None:
        """The page as one file: what it says and shows now."""
        said = (self.verdict.text, self.exact.text, self.ends.text, self.heading.text)
        names = [picture.figure.name for picture in self.pictures]
        page = standalone(self.doc, self.base.title, said, names)
        self._send(f"{self.base.name}.html", "text/html", page.encode())

    def _send(self, name: str, mime: str, content: bytes) -> None:
        """Give the browser a file, which it makes itself."""
        coded = base64.b64encode(content).decode()
        self.download.data = {"name": [name], "mime": [mime], "base64": [coded]}

    # What the page does then.

    def _begin_quick(self) -> None:
        """Compute what is seen at once; while that runs, only the last of all moves is kept."""
        self.version += 1
        if self.computing:
            return
        self.computing = True
        version = self.version
        future = self.threads.submit(quick.compute, self.base, self.signal, dict(self.values), self.until)
        future.add_done_callback(lambda done: self._next_tick(partial(self._end_quick, done, version)))

    def _end_quick(self, done: Future[quick.Quick], version: int) -> None:
        self.computing = False
        error = done.exception()
        if error is None:
            self._show(done.result())
        else:
            self.message.text = str(error) if isinstance(error, EppError) else f"It could not be computed: {error}."
        if self.version != version:
            self.version -= 1  # the move that is under way is no new one
            self._begin_quick()
        elif error is None:
            self._soon(self._begin_slow)

    def _show(self, result: quick.Quick) -> None:
        """The run and its Nyquist plot; what else changes follows, once for all moves till then."""
        self.case, self.size, self.until = result.case, result.peak_to_peak, result.until
        with self._together():
            self.run.show(result, _in_short(self.base, self.values))
            self.verdict.text = result.sentence
        if not self.marking:
            self.marking = True
            self.doc.add_timeout_callback(self._show_marks, _MOMENT)

    def _show_marks(self) -> None:
        """What a move changes beside the run: ghost, heading, places on branch and map."""
        self.marking = False
        with self._together():
            self.step.name()
            self.heading.text = f"With {self.step.text}."
            place = self._place(self.over.value)
            self.branch.show_run(place, self.size)
            if self.shown.get("exact") != self.values:
                self.branch.show_exact(None, place, self.factor)
                self.exact.text = "Exact limit cycles: being sought ..."
            if self.shown.get("ends") != self.values:
                self.ends.text = ""
            if self.map is not None and self.axes is not None:
                self.map.show_place(*(self._place(a.name) for a in self.axes))
            if not self.shown.get("moving"):
                self._write_address()

    @contextmanager
    def _together(self) -> Iterator[None]:
        """Changes go to the browser at the end, each once."""
        self.doc.hold("combine")
        try:
            yield
        finally:
            self.doc.unhold()

    def _place(self, name: str) -> float:
        """The place of the case on an axis, in the axis' unit."""
        slider = self.sliders.get(name)
        if slider is None:
            return 0.0
        value = self.values.get(name)
        return slider.value if value is None else value / slider.per_unit

    def _begin_slow(self) -> None:
        """Request the slow pictures that the values have made old."""
        given = slow.Given.of(self.case, self.signal)
        if self.axes is not None:
            x, y = self.axes
            ends = [(a.low * a.per_unit, a.high * a.per_unit) for a in self.axes]
            at = {a.name: a.value * a.per_unit for a in self.axes}
            self._ask_once("map", slow.design_map, at, (x.name, y.name, *ends), self._show_map)
            self._ask_once("border", slow.border, at, (x.name, y.name, *ends), self._show_border)
        self._ask("exact", slow.all_cycles, (given,), partial(self._show_exact, dict(self.values)))
        over = self.sliders.get(self.over.value)
        if over is not None:
            at = {over.name: over.value * over.per_unit}
            low, high = over.low * over.per_unit, over.high * over.per_unit
            here = {a.name: self._place(a.name) for a in self.axes or ()}
            self._ask_once("branch", slow.branch, at, (over.name, low, high), partial(self._show_branch, over, here))

    def _ask_once(
        self,
        kind: str,
        job: Callable[..., slow.Facts],
        at: Values,
        args: tuple[Any, ...],
        then: Callable[[slow.Facts], None],
    ) -> None:
        """Request a picture that does not depend on the fields `at`, unless it is there already."""
        try:
            fixed = moved_case(self.base, {**self.values, **at})
        except EppError:
            return
        wanted = (slow.Given.of(fixed, self.signal), *args)
        if self.shown.get(kind) == wanted:
            return
        self.shown[kind] = wanted
        picture = {"branch": self.branch, "map": self.map}.get(kind)
        if picture is not None:
            picture.figure.title.text = _TITLES[kind] + ": being computed ..."
        elif self.map is not None:  # the border of other values is none of these, and takes a minute or two
            self.map.show_border({"x": [], "y": []}, 1.0, 1.0)
        self._ask(kind, job, wanted, then)

    def _ask(
        self, kind: str, job: Callable[..., slow.Facts], args: tuple[Any, ...], then: Callable[[slow.Facts], None]
    ) -> None:
        """Have it done elsewhere; earlier requests are dropped."""
        before = self.running.pop(kind, None)
        if before is not None:
            before.cancel()
        # What has begun is not cancelled; its answer comes with an old token, and is left.
        token = object()
        self.shown[f"{kind} token"] = token

        def arrived(facts: slow.Facts) -> None:
            if self.shown.get(f"{kind} token") is token:
                then(facts)

        self.running[kind] = self.workshop.ask(job, args, lambda facts: self._next_tick(partial(arrived, facts)))

    def _show_exact(self, values: Values, facts: slow.Facts) -> None:
        if "error" in facts:
            self.exact.text = f"Exact limit cycles: {facts['error']}"
            return
        self.shown["exact"] = values
        self.branch.show_exact(facts, self._place(self.over.value), self.factor)
        self.exact.text = _in_words(facts, self.unit, self.factor)

    def _show_branch(self, over: Slider, here: Values, facts: slow.Facts) -> None:
        """The branch, and where its cycles begin on the map at the values `here` of its axes."""
        said = facts["error"] if "error" in facts else facts["doubts"]
        self.branch.figure.title.text = ": ".join(filter(None, (_TITLES["branch"], said)))
        if "error" in facts:
            facts = {"pieces": [], "begins": []}
        self.branch.show_branch(facts, over.label(), 1.0 / over.per_unit, self.factor)
        if self.map is not None:
            places = [{**here, over.name: value / over.per_unit} for value, _ in facts["begins"] if over.name in here]
            self.map.show_begins([(x, y) for x, y in map(dict.values, places)])

    def _show_map(self, facts: slow.Facts) -> None:
        assert self.map is not None and self.axes is not None
        if "error" in facts:
            self.map.figure.title.text = f"Design map: {facts['error']}"
            return
        self.map.figure.title.text = "Design map"
        self.map.show_cells(facts, *(1.0 / a.per_unit for a in self.axes))

    def _show_border(self, facts: slow.Facts) -> None:
        """The border of the design map; where there is none, its cells alone say what they do."""
        assert self.map is not None and self.axes is not None
        self.map.show_border({"x": [], "y": []} if "error" in facts else facts, *(1.0 / a.per_unit for a in self.axes))

    def _next_tick(self, act: Callable[[], None]) -> None:
        """Do something in the thread of the page, if the page is still there."""
        with suppress(RuntimeError, ValueError, AttributeError):
            self.doc.add_next_tick_callback(act)

    def _soon(self, act: Callable[[], None]) -> None:
        """Do something when the reader has been calm for a moment."""
        if self.later is not None:
            with suppress(ValueError):
                self.doc.remove_timeout_callback(self.later)

        def begin() -> None:
            self.later = None
            act()

        self.later = self.doc.add_timeout_callback(begin, _CALM)


def _on_slider(slider: Slider, value: float) -> float:
    """The value of a slider that is nearest to one."""
    steps = round((value - slider.low) / slider.step)
    return min(max(slider.low + steps * slider.step, slider.low), slider.high)


def _in_short(case: Case, values: Mapping[str, float]) -> str:
    """What was moved, and to where."""
    moved = [f"{words(name)} {case.text(name, value, 4)}" for name, value in values.items()]
    return ", ".join(moved) or "the values of its file"


def _arguments(doc: Document) -> dict[str, list[bytes]]:
    """The query of the address that the page was opened with."""
    request = getattr(doc.session_context, "request", None)
    return dict(request.arguments) if request is not None else {}


_TITLES = {"branch": "Limit cycles", "map": "Design map"}


def _in_words(facts: slow.Facts, unit: str, factor: float) -> str:
    """The exact cycles as a sentence."""
    cycles = [
        f"{'stable' if stable else 'unstable'} {factor * size:.4g} {unit}".rstrip() + f" at {frequency:.4g} Hz"
        for size, frequency, stable in zip(facts["size"], facts["frequency"], facts["stable"], strict=True)
        if math.isfinite(size)
    ]
    settles = " It can also rest." if facts["settles"] and cycles else ""
    return f"Exact limit cycles: {'; '.join(cycles) or 'none'}.{settles} {facts['doubts']}".rstrip()
