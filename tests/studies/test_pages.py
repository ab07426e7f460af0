"""The check of built pages finds each fault it is for, and the gallery shows what its lines make."""

from __future__ import annotations

import ast

import numpy as np
import pytest

from eppanalysis.plotting import figure_of
from studies import DOCS
from studies.pages import figures, gallery, sums
from tests.explorer.browser import find_chromium, running_browser
from tests.shared import touching
from tests.studies.pages import read_faults, seen_faults

pytestmark = pytest.mark.slow

GOOD = """<!doctype html><html><body data-theme="light" style="background:#fff;color:#222"><article id="top">
<p>Text with a <a href="other.html#there">link</a> and a <a href="#top">second</a>.</p><img src="a.png" alt="A curve">
<div style="overflow-x:auto;background:linear-gradient(#eee,#fff)"><table style="width:800px"><tr><td>x</table></div>
%s</article></body></html>"""


@pytest.fixture
def site(tmp_path):
    (tmp_path / "other.html").write_text('<html><body><h1 id="there">x</h1></body></html>', encoding="utf-8")
    (tmp_path / "a.png").write_bytes(b"")

    def write(more: str = ""):
        (tmp_path / "index.html").write_text(GOOD % more, encoding="utf-8")
        return tmp_path

    return write


def test_a_good_page_has_no_fault_in_its_file(site):
    assert list(read_faults(site())) == []


@pytest.mark.parametrize(
    ("more", "fault"),
    [
        ('<a href="gone.html">x</a>', "dead link gone.html"),
        ('<a href="other.html#nowhere">x</a>', "dead link other.html#nowhere"),
        ('<a href="#nowhere">x</a>', "dead link #nowhere"),
        ('<img src="a.png">', "picture without a text: a.png"),
        ('<img src="a.png" alt="a.png">', "picture without a text: a.png"),
    ],
)
def test_faults_of_a_file_are_found(site, more, fault):
    assert list(read_faults(site(more))) == [("index.html", fault)]


@pytest.mark.skipif(find_chromium() is None, reason="no Chromium is installed")
def test_faults_that_a_browser_sees_are_found(site):
    faults = {
        '<p style="color:#aaa">pale</p>': "little contrast",
        "<p>| a | row that no table has |</p>": "torn table: | a |",
        '<p style="color:#aaa" id="a">x</p><style>@media (min-width: 900px) {#a {display: none}}</style>': "little",
        "<p id='night'>pale</p><style>[data-theme=dark] #night {color: #ddd}</style>": "little contrast, dark",
        '<p style="width:600px">wide</p>': "wider than 420 px: p to",
        '<div style="overflow-x:auto"><p style="width:600px">formula</p></div>': "scrolled sideways at 420 px",
        '<div style="overflow-x:auto"><table style="width:600px"><tr><td>a</table></div>': "scrolled sideways",
        '<p>one m^3/(s<em>V)"); or ("2</em>Kp")</p>': "torn at",
        f"<p>{'word ' * 5}<code><span class='pre'>a-name-{'of-' * 12}parts</span></code></p>": "torn at 420 px: a-name",
        '<script>window.MathJax = {startup: {promise: 1}}</script><span class="math">x^2</span>': "broken formula: x^2",
    }
    with running_browser() as browser:
        assert list(seen_faults(browser, (site() / "index.html").as_uri())) == []
        for more, fault in faults.items():
            found = list(seen_faults(browser, (site(more) / "index.html").as_uri()))
            assert found and all(text.startswith(fault) for text in found), more


PICTURES = gallery.blocks(gallery.PAGE.read_text(encoding="utf-8"))[1:]


def test_every_picture_of_the_gallery_is_there_and_has_its_lines():
    made = {target for _, target in PICTURES}
    there = {str(path.relative_to(DOCS)) for path in (DOCS / "_static" / "gallery").glob("*.png")}
    assert made == there
    for code, target in PICTURES:
        assert isinstance(ast.parse(code).body[-1], ast.Expr), target
        assert (DOCS / target).stat().st_size < 150_000


@pytest.mark.parametrize("name", ["cycle", "margins", "nyquist"])
def test_lines_of_the_gallery_draw(name):
    names = {}
    exec(gallery.blocks(gallery.PAGE.read_text(encoding="utf-8"))[0][0], names)
    (code,) = (code for code, target in PICTURES if target.endswith(f"/{name}.png"))
    assert figure_of(gallery.drawn(code, names)).axes


@pytest.mark.parametrize(("name", "drawing"), figures.drawings().items())
def test_numbers_of_a_drawing_of_an_element_stand_apart(name, drawing):
    figure = figures.draw_element(drawing)
    figure.draw_without_rendering()
    assert not list(touching(figure)), name


@pytest.mark.parametrize(("name", "drawing"), figures.drawings().items())
def test_lines_of_a_drawing_of_an_element_are_whole(name, drawing):
    loops, functions = figures.draw_element(drawing).axes
    for line in loops.lines[: len(drawing.elements)]:
        assert tuple(line.get_xydata()[0]) == tuple(line.get_xydata()[-1])
    low, high = functions.get_ylim()
    for line in functions.lines:
        y = np.asarray(line.get_ydata(), float)
        (seen,) = np.nonzero((low <= y) & (y <= high))
        assert not seen.size or (np.diff(seen) == 1).all()


def test_what_the_checks_add_up_to_is_read_from_their_tables(tmp_path, monkeypatch):
    page = tmp_path / "checks.md"
    page.write_text("| runs of x | number | differ |\n| --- | --- | --- |\n| a | 2,000 | 0 |\n| b | 30 | 1 (see) |\n")
    monkeypatch.setattr(sums, "CHECKS", page)
    assert "| runs in time against another code | 2,030 | 1 |" in sums.sums_table()
    monkeypatch.undo()
    rows = sums.sums_table().splitlines()
    assert len(rows) == 6 and all(row.count("|") == 4 for row in rows)
