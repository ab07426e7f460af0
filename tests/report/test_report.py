"""Reports: complete or absent, one file without a network, re-runnable, and nothing in a case is markup."""

from __future__ import annotations

import ast
import re
import shutil
import signal
import subprocess
import sys
import time
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace

import nbformat
import numpy as np
import pandas
import pytest

import eppanalysis as epp
from eppanalysis.cli import report as command
from eppanalysis.errors import EppError
from eppanalysis.report import notebook as making, page, sections
from tests.explorer.browser import find_chromium, running_browser
from tests.shared import of_unknown_response

pytestmark = pytest.mark.slow

HOSTILE = """
base = "fig8a_original"
title = 'A <script>alert(1)</script> **elbow** [x](https://example.org/) with \"\"\" and \\ and $x$'
lock_pin.backlash = { value = "1.6 deg", mark = "measured", note = "<img src=https://example.org/p.png> dial gauge" }
"""


class Links(HTMLParser):
    """Everything that a page would fetch, and every element that runs."""

    def __init__(self) -> None:
        super().__init__()
        self.links: list[str] = []
        self.tags: set[str] = set()

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        self.links += [value or "" for name, value in attrs if name in ("src", "href", "srcset", "data", "action")]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("reports")


@pytest.fixture(scope="module")
def mine(folder) -> epp.Case:
    path = folder / "my_elbow.toml"
    path.write_text(HOSTILE, encoding="utf-8")
    return epp.read_case(path)


@pytest.fixture(scope="module")
def written(folder, mine) -> Path:
    return epp.report(mine, folder / "my.ipynb")


@pytest.fixture(scope="module")
def html(written) -> str:
    return page.to_html(nbformat.read(written, 4), written)


def outputs(notebook, heading: str) -> list:
    """Outputs of the cells under a heading."""
    found, inside = [], False
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            inside = cell.source.startswith(f"## {heading}")
        elif inside:
            found += cell.outputs
    return found


def test_every_section_has_something_to_show(written):
    notebook = nbformat.read(written, 4)
    for section in sections.SECTIONS:
        kinds = {kind for out in outputs(notebook, section.title) for kind in out.get("data", {"text": ""})}
        assert kinds & {"text/html", "image/png", "text"}, section.title
    for title in ("Prediction", "Ladder", "Limit cycles", "Branch", "Design map"):
        assert any("image/png" in out.get("data", {}) for out in outputs(notebook, title)), title


def test_several_elements_have_a_nyquist_picture_too(written):
    pictures = [out for out in outputs(nbformat.read(written, 4), "Prediction") if "image/png" in out.get("data", {})]
    assert len(pictures) == 2


def test_the_numbers_are_those_of_the_methods(written, mine):
    said = "".join(out.get("text", "") for out in outputs(nbformat.read(written, 4), "Ladder"))
    assert said.strip() == epp.ladder(mine).verdict
    shown = [out["data"]["text/html"] for out in outputs(nbformat.read(written, 4), "Case") if "data" in out]
    assert "1.6 deg" in shown[0] and "measured" in shown[0] and "0.0465 kg·m²" in shown[0]


def test_the_notebook_carries_its_case_and_uses_public_names_only(written, folder):
    code = [cell.source for cell in nbformat.read(written, 4).cells if cell.cell_type == "code"]
    plain = [re.sub(r"^%.*$", "", text, flags=re.MULTILINE) for text in code]
    for tree in map(ast.parse, plain):
        for node in ast.walk(tree):
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "epp":
                assert node.attr in dir(epp), node.attr
            if isinstance(node, ast.Attribute):
                assert not node.attr.startswith("_")
            if isinstance(node, ast.ImportFrom):
                assert node.module == "datetime"
    assert str(folder) not in "".join(code)


def test_the_page_is_one_file_that_fetches_and_runs_nothing(html):
    links = Links()
    links.feed(html)
    assert [link[:40] for link in links.links if not link.startswith(("data:image/png;base64,", "#"))] == []
    assert not links.tags & {"script", "iframe", "link", "object", "embed", "form"}
    assert "@import" not in html and "url(" not in html
    assert "default-src 'none'" in html


def test_texts_of_the_case_are_texts(html):
    assert "&lt;script&gt;" in html and "<script" not in html
    assert "<img src=https" not in html
    assert "<strong>elbow" not in html
    assert 'href="https://example.org' not in html


def test_pictures_say_what_they_are_of(html):
    assert html.count("<figure>") >= 5
    assert all(alt for alt in re.findall(r'<img alt="([^"]*)"', html))


@pytest.mark.parametrize("text", ["plain", 'with """ and \\ and \n newline', 'ends in "', "\r\n\0\u2028"])
def test_a_text_as_a_literal_is_the_text(text):
    assert ast.literal_eval(making.literal(text)) == text


def test_a_shipped_case_is_named_and_a_changed_one_is_not():
    shipped = epp.case("relay_hyst_servo")
    first = making.make_notebook([shipped]).cells[1].source
    assert 'epp.case("relay_hyst_servo")' in first
    changed = shipped.with_values({"title": "another"})
    assert "case_from_text" in making.make_notebook([changed]).cells[1].source


def test_the_star_of_a_design_map_stands_in_the_units_of_its_axes():
    """The gap is drawn in mm over the gain, and not over one side of the dead zone."""
    code = sections._map(epp.case("wheelchair"))
    assert 'plot(case.value("loop.gain") * 1.0, case.value("play.gap") * 1000.0, ' in code


def test_a_design_map_of_which_nothing_is_known_is_a_sentence(capsys):
    """Runs that are too short say nothing: a map would be grey from end to end."""
    short = epp.case("backlash_servo_unseen").with_values({"run.t_end": "0.01 s"})
    drawn = []
    exec(sections._map(short), {"epp": epp, "case": short, "cycles": None, "display": drawn.append})
    assert "No map: none of 81 runs" in capsys.readouterr().out and not drawn


def test_runs_of_a_design_map_are_long_enough_for_the_slowest_cycle_that_was_found(monkeypatch):
    case, asked = epp.case("backlash_servo_unseen"), []

    def sweep(asked_for, *others, **options):
        asked.append(asked_for.t_end)
        raise epp.EppError("enough")

    monkeypatch.setattr(epp, "sweep", sweep)
    for cycles in (None, [SimpleNamespace(period=0.1 * case.t_end), SimpleNamespace(period=10.0 * case.t_end)]):
        exec(sections._map(case), {"epp": epp, "case": case, "cycles": cycles})
    assert asked == [4.0 * case.t_end, 80.0 * case.t_end]


def test_no_remark_of_a_guideline_is_cut_off():
    """That nothing bounds the backlash was told up to "at eithe..."."""
    case, pages = epp.case("soft_cable"), []
    with pandas.option_context("display.max_colwidth", 50):
        exec("\n".join(line for line in sections.SETUP.splitlines() if line[:1] != "%"))
        shows = {"epp": epp, "case": case, "branch": None, "display": lambda frame: pages.append(frame._repr_html_())}
        exec(sections._guideline(case), shows)
    assert "so nothing bounds it there." in pages[0] and "..." not in pages[0]


def test_of_a_loop_in_samples_cycles_are_sought_in_a_short_report_too_and_a_refusal_is_told(monkeypatch, capsys):
    case = epp.case("virtual_spring")

    def refused(loop):
        raise epp.EppError(f"{loop.name}: is not searched here.")

    monkeypatch.setattr(epp, "find_limit_cycles", refused)
    scope = {"epp": epp, "case": case, "ladder": None}
    for section in sections.SECTIONS:
        if section.title in ("In short", "Limit cycles"):
            exec(section.cell(case, full=False), scope)
    assert "virtual_spring: is not searched here." in capsys.readouterr().out


def test_a_full_report_has_the_guideline_at_several_gains():
    short, long = (
        making.make_notebook([epp.case("fig8a_original")], full=full).cells[-5].source for full in (False, True)
    )
    assert "branch=branch" in short and "1.5 lbf" not in short
    assert "['1.5 lbf', '2 lbf', '2.5 lbf', '3 lbf', '3.5 lbf']" in long and "guide.plot().figure" in long


def test_several_cases_have_an_overview(folder, monkeypatch):
    few = tuple(s for s in sections.SECTIONS if s.title in ("Case",))
    monkeypatch.setattr(making, "SECTIONS", few)
    path = epp.report([epp.case("relay_hyst_servo"), epp.case("sat_khalil710")], folder / "two.ipynb")
    notebook = nbformat.read(path, 4)
    table = outputs(notebook, "Overview")[-1]["data"]["text/html"]
    assert "relay_hyst_servo" in table and "sat_khalil710" in table


def test_of_several_cases_each_ladder_is_computed_once_and_it_is_told_which_case_is_at_work(folder, monkeypatch):
    """Of one that no describing function covers the others have their overview nevertheless."""
    monkeypatch.setattr(making, "SECTIONS", sections.SECTIONS[:1])
    told = []
    path = folder / "three.ipynb"
    given = [epp.case("relay_hyst_servo"), of_unknown_response(), epp.case("sat_khalil710")]
    epp.report(given, path, progress=lambda done, total, doing: told.append(doing))
    notebook = nbformat.read(path, 4)
    assert sum(cell.source.count("epp.ladder(") for cell in notebook.cells) == 1
    table = outputs(notebook, "Overview")[-1]["data"]["text/html"]
    assert "relay_hyst_servo" in table and "sat_khalil710" in table
    assert {case.title for case in given} <= set(told) and f"{given[2].title}: In short" in told


def test_a_cell_that_fails_is_one_sentence_and_no_file(folder, monkeypatch):
    broken = (sections.Section("Broken", "Fails.", lambda case: "1 / 0"),)
    monkeypatch.setattr(making, "SECTIONS", broken)
    path = folder / "broken.html"
    with pytest.raises(
        EppError, match=r"broken.html: not written, because section 'Broken' failed \(ZeroDivisionError"
    ):
        epp.report(epp.case("fig8a_original"), path)
    assert not path.exists() and not list(folder.glob(".broken*"))


def test_an_old_report_outlives_a_failure(folder, monkeypatch):
    path = folder / "old.html"
    path.write_text("old")
    monkeypatch.setattr(making, "SECTIONS", (sections.Section("Broken", "", lambda case: "exit(3)"),))
    monkeypatch.setattr(page, "to_html", lambda notebook, path: 1 / 0)
    with pytest.raises((EppError, ZeroDivisionError)):
        epp.report(epp.case("fig8a_original"), path)
    assert path.read_text() == "old" and not list(folder.glob(".old*"))


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("report.docx", "expected one of .html, .ipynb, .pdf"),
        ("no/such/report.html", "the folder 'no/such' does not exist"),
    ],
)
def test_files_that_are_refused_at_once(name, expected):
    with pytest.raises(EppError, match=re.escape(expected)):
        epp.report(epp.case("fig8a_original"), name)


def test_missing_libraries_are_named(monkeypatch, folder):
    monkeypatch.setattr(sys.modules["eppanalysis.report"], "_NEEDED", ("nbformat", "no_such_library"))
    with pytest.raises(
        EppError, match=r"a report needs no_such_library; expected what \"pip install 'eppanalysis\[report"
    ):
        epp.report(epp.case("fig8a_original"), folder / "x.html")


def test_without_a_browser_a_pdf_is_refused_at_once(monkeypatch, folder):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    monkeypatch.setattr(page, "_MAC", "/no/such/program")
    with pytest.raises(
        EppError, match="a PDF is printed by Chromium or Chrome, and there is none; expected one installed"
    ):
        epp.report(epp.case("fig8a_original"), folder / "x.pdf")


@pytest.mark.skipif(not any(map(shutil.which, page.BROWSERS)), reason="no Chromium or Chrome is installed")
def test_pdf_is_printed_from_the_page(html, folder):
    page.print_page(html, folder / "printed.pdf", folder / "printed.pdf")
    content = (folder / "printed.pdf").read_bytes()
    assert content.startswith(b"%PDF") and content.rstrip().endswith(b"%%EOF")
    assert len(re.findall(rb"/Type /Page\b", content)) >= 3


@pytest.mark.skipif(find_chromium() is None, reason="no Chromium or Chrome is installed")
def test_no_table_of_a_printed_page_is_wider_than_its_column():
    """Notes of parameters lay over the second column, or were cut off at the edge of the paper."""
    shown = epp.table(epp.case("fig8a_original"))._repr_html_()
    style = (Path(page.__file__).parent / "templates/eppanalysis/style.css").read_text()
    told = f'<main><div class="part"></div><div class="part"><div class="wide">{shown}</div></div></main>'
    with running_browser() as browser:
        sheet = browser.new_page(viewport={"width": 695, "height": 1000})  # A4 but its margins
        sheet.emulate_media(media="print")
        sheet.set_content(f"<style>{style}</style><body>{told}")
        cells = sheet.evaluate(
            "[...document.querySelectorAll('td')].map(c => c.getBoundingClientRect()).map(r => [r.left, r.right])"
        )
    # None stands in the gap of the columns, nor beyond the paper.
    assert cells and not [(left, right) for left, right in cells if left < 695 / 2 < right or right > 695]


@pytest.mark.skipif(not find_chromium(), reason="no Chromium or Chrome is installed")
def test_on_a_phone_no_table_of_values_is_wider_than_the_page():
    """Notes and the last columns were behind the edge."""
    shown = [epp.table(epp.case(name))._repr_html_() for name in ("elbow", "x15_flare", "azimuth_servo")]
    style = (Path(page.__file__).parent / "templates/eppanalysis/style.css").read_text()
    told = "".join(f'<div class="wide">{table}</div>' for table in shown)
    with running_browser() as browser:
        tab = browser.new_page(viewport={"width": 420, "height": 900})
        tab.set_content(f'<style>{style}</style><body><main><div class="part">{told}</div></main>')
        widths = tab.evaluate("[...document.querySelectorAll('.wide')].map(n => [n.scrollWidth, n.clientWidth])")
    assert len(widths) == len(shown) and all(inside <= room for inside, room in widths), widths


@pytest.mark.parametrize(
    ("sheets", "taken"), [({0.94: 4, 1.0: 5, 1.1: 5, 1.2: 6}, 0.94), ({0.94: 3, 1.0: 3, 1.1: 3, 1.2: 4}, 1.1)]
)
def test_a_pdf_is_printed_as_large_as_it_goes_on_the_fewest_sheets(folder, monkeypatch, sheets, taken):
    """A few lines stood alone on a last sheet, or it was half empty."""
    monkeypatch.setattr(page, "find_browser", lambda path: "none")
    scales = {page._scaled("<head></head>", scale): scale for scale in sheets}

    def printed(browser, text, path):
        return b"/Type /Pages " + b"/Type /Page\n" * sheets[scales[text]] + str(scales[text]).encode()

    monkeypatch.setattr(page, "_printed", printed)
    page.print_page("<head></head>", folder / "scaled.pdf", folder / "scaled.pdf")
    assert (folder / "scaled.pdf").read_bytes().endswith(str(taken).encode())


@pytest.mark.parametrize(
    ("titles", "told", "lines"),
    [
        (["A"], ["A", "In short", "In short", "Case"], ["1 of 9: A", "2 of 9: In short", "4 of 9: Case"]),
        (["A", "B"], ["A", "A: In short", "B"], ["1 of 2: A", "2 of 2: B"]),
    ],
)
def test_where_no_bar_is_seen_each_section_of_one_case_is_told_and_each_of_several_cases(titles, told, lines, capsys):
    tell = command._progress_over(titles)
    for done, doing in enumerate(told):
        tell(done, 9, doing)
    assert capsys.readouterr().err.splitlines() == lines


def test_of_unstable_cycles_alone_it_is_said_that_no_disturbance_starts_one(capsys):
    """The table had no row and said "none"."""
    section = next(section for section in sections.SECTIONS if section.title == "Trigger")
    unstable = SimpleNamespace(stable=())
    exec(section.cell(epp.case("fig8a_original"), full=False), {"epp": epp, "cycles": unstable})
    assert capsys.readouterr().out.startswith("No stable limit cycle was found, so there is none that a disturbance")


def test_a_browser_that_fails_is_one_sentence(monkeypatch, folder):
    monkeypatch.setattr(shutil, "which", lambda name: sys.executable)
    with pytest.raises(EppError, match="did not print it"):
        page.print_page("<p>", folder / "none.pdf", folder / "none.pdf")
    assert not (folder / "none.pdf").exists()


@pytest.mark.parametrize("after", [1.5, 2.5, 4.0])
def test_command_line_and_interrupt(folder, after):
    """Before the kernel is there, as it starts, and at work."""
    call = [sys.executable, "-m", "eppanalysis", "report", "fig8a_original", "-o", str(folder / "late.html")]
    running = subprocess.Popen(call, stderr=subprocess.PIPE, text=True)
    time.sleep(after)
    running.send_signal(signal.SIGINT)
    _, said = running.communicate(timeout=30)
    # An interrupt that met code which is made from text on import ends Python by the signal: 130 to a shell, too.
    assert running.returncode in (130, -signal.SIGINT), said
    assert "Traceback" not in said
    assert not list(folder.glob("*late*"))


@pytest.mark.parametrize("name", ["robot_servo", "wheelchair"])
def test_a_design_that_takes_longer_to_settle_than_the_case_is_no_unknown_one_on_the_map(name):
    """At low gains and with little backlash a joint creeps to rest for longer than the case's own run goes on."""
    case, drawn = epp.case(name), []
    left: dict[str, object] = {"epp": epp, "case": case, "cycles": None, "display": drawn.append}
    exec(sections._map(case), left)
    own = epp.sweep(case, left["axes"], progress=False)["outcome"].values
    shown = left["cells"]["outcome"].values
    assert len(drawn) == 1 and np.sum(shown == 0) < max(np.sum(own == 0), 1)
    assert np.array_equal(shown[own != 0], own[own != 0])
