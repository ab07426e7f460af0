"""Guidelines to files: Markdown, CSV, LaTeX, HTML, Excel, Word, pictures; a text is never taken for a formula."""

from __future__ import annotations

import base64
import html
import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from eppanalysis.errors import EppError
from eppanalysis.guides.manual import manual_table, source
from eppanalysis.guides.result import Side, in_words
from eppanalysis.plotting import figure_of
from eppanalysis.readable import one_line
from eppanalysis.shown import png
from eppanalysis.tables.files import PICTURES, check_target, csv_cell, write_figure
from eppanalysis.tables.manual import keep_texts, size_rows
from eppanalysis.writing import at_once, atomic

if TYPE_CHECKING:
    import pandas

    from eppanalysis.guides.result import Guide

_STYLE = """
:root { color-scheme: light dark; }
body { font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 76rem; padding: 0 1rem; }
table { border-collapse: collapse; margin: 1rem 0; display: block; overflow-x: auto; }
th, td { border-bottom: 1px solid #8888; padding: .3rem .6rem; text-align: right; vertical-align: top; }
th { border-bottom: 2px solid #888; font-weight: 600; }
img { max-width: 100%; height: auto; }
footer { opacity: .8; font-size: 12px; margin-top: 2rem; overflow-wrap: anywhere; }
@media screen and (prefers-color-scheme: dark) { img { filter: invert(0.92) hue-rotate(180deg); } }
"""


def check_file(path: Path) -> None:
    """Refuse what cannot be written, before anything is computed for it.

    Raises
    ------
    EppError
        If the ending is not known, the folder does not exist, or a library that the ending needs is not there.
    """
    check_target(path, FILES, _NEEDED)


def write_guide(guide: Guide, path: Path) -> None:
    """Write a guide as the ending of `path` says.

    Raises
    ------
    EppError
        If the ending is not known, a library that it needs is not there or too old, or the file cannot be written.
    """
    check_file(path)
    if path.suffix.lower() in PICTURES:
        write_figure(guide.plot(), path)
        return
    if path.suffix.lower() == _MANUAL:
        manual_table(guide).write(path)  # what people want in a text of their own
        return
    writer = _WRITERS[path.suffix.lower()]
    with atomic(path) as part:
        try:
            writer(guide, part)
        except ImportError as error:
            raise EppError(f"{path}: cannot be written ({error}); expected what {_INSTALL} installs.") from error


def title(guide: Guide) -> str:
    """What the table is about."""
    which = "Largest" if guide.side is Side.BELOW else "Smallest"
    return f"{which} {in_words(guide.limit)} {guide.without('limit cycle')}: {guide.case.title or guide.case.name}"


def facts(guide: Guide) -> str:
    """Where the table comes from, in one line."""
    p = guide.provenance
    case = p.case
    return (
        f"eppanalysis {case['version']}, case {case['case']} (sha256 {case['sha256'][:16]}), "
        f"settings {json.dumps(p.settings, sort_keys=True)}"
    )


def _markdown(guide: Guide, path: Path) -> None:
    frame = guide.rounded().map(lambda text: text.replace("|", "\\|"))
    table = frame.to_markdown(index=False, disable_numparse=True)
    lines = "\n".join(f"* {s}" for s in guide.sentences())
    path.write_text(f"# {one_line(title(guide))}\n\n{table}\n\n{lines}\n\n{source(guide)}\n", encoding="utf-8")


def _csv(guide: Guide, path: Path) -> None:
    frame = guide.to_frame()
    texts = frame.select_dtypes(exclude="number").columns
    frame[texts] = frame[texts].map(csv_cell)
    frame["provenance"] = [csv_cell(facts(guide)), *[""] * (len(frame) - 1)]
    frame.to_csv(path, index=False, float_format="%.10g")


def _latex(guide: Guide, path: Path) -> None:
    import pandas

    def table(frame: pandas.DataFrame, columns: str, head: bool) -> str:
        style = frame.style.hide(axis="index").format(escape="latex").format_index(escape="latex", axis=1)
        style = style if head else style.hide(axis="columns")
        return style.to_latex(hrules=head, environment="longtable", column_format=columns)

    frame = guide.rounded()
    texts = pandas.DataFrame({"text": [one_line(t) for t in (title(guide), *guide.sentences(), source(guide))]})
    # Every column has a gap on both sides of it.
    width = f"\\dimexpr{1.0 / len(frame.columns):.4f}\\linewidth-2\\tabcolsep"
    numbers = f">{{\\raggedleft\\arraybackslash}}p{{{width}}}" * len(frame.columns)
    path.write_text(
        "% Needs the packages array, booktabs and longtable; wide: best on a landscape page.\n"
        + "{\\scriptsize\\setlength{\\tabcolsep}{3pt}\n"
        + table(frame, numbers, True)
        + "}\n"
        + table(texts, "p{\\dimexpr\\linewidth-2\\tabcolsep}", False),
        encoding="utf-8",
    )


def _html(guide: Guide, path: Path) -> None:
    frame = guide.rounded()
    style = frame.style.hide(axis="index").format(escape="html").format_index(escape="html", axis=1)
    table = style.to_html()
    image = base64.b64encode(png(figure_of(guide.plot()), 160)).decode()
    lines = "".join(f"<li>{html.escape(s)}</li>" for s in guide.sentences())
    name = html.escape(one_line(title(guide)))
    path.write_text(
        f'<!DOCTYPE html><html lang="en"><head><meta charset="utf-8"><title>{name}</title>'
        f"<style>{_STYLE}</style></head>"
        f'<body><h1>{name}</h1>{table}<ul>{lines}</ul><img alt="What the design does, by region" '
        f'src="data:image/png;base64,{image}"><footer>{html.escape(source(guide))}</footer></body></html>\n',
        encoding="utf-8",
    )


def _excel(guide: Guide, path: Path) -> None:
    import pandas
    from openpyxl.styles import Alignment, Font

    frame, rounded = guide.to_frame(), guide.rounded()
    for name in frame:
        # As the other files have them: four digits of a cell would be to the nearest, which may be the unsafe side.
        numbers = pandas.api.types.is_numeric_dtype(frame[name])
        frame[name] = pandas.to_numeric(rounded[name], errors="coerce") if numbers else rounded[name]
    sentences = pandas.DataFrame({"sentence": list(guide.sentences())})
    source = pandas.DataFrame({"provenance": [facts(guide)]})
    with at_once(path) as stream, pandas.ExcelWriter(stream, engine="openpyxl") as book:
        for name, sheet in (("guideline", frame), ("sentences", sentences), ("provenance", source)):
            sheet.to_excel(book, sheet_name=name, index=False)
            cells = book.sheets[name]
            cells.freeze_panes = "A2"
            cells.page_setup.orientation, cells.page_setup.fitToHeight = "landscape", 0
            cells.sheet_properties.pageSetUpPr.fitToPage = True
            for column in cells.columns:
                longest = max(len(str(cell.value)) for cell in column[1:])
                cells.column_dimensions[column[0].column_letter].width = min(max(longest + 2, 16), 100)
                column[0].font = Font(bold=True)
                for cell in column:
                    cell.alignment = Alignment(wrap_text=True, vertical="top")
            size_rows(cells)
            keep_texts(cells)


_WRITERS: dict[str, Callable[[Guide, Path], None]] = {
    ".md": _markdown,
    ".csv": _csv,
    ".tex": _latex,
    ".html": _html,
    ".xlsx": _excel,
}
#: Ending of the table for a manual.
_MANUAL = ".docx"
FILES = (*_WRITERS, _MANUAL, *PICTURES)
#: What pandas needs for an ending besides itself.
_NEEDED = {".md": ("tabulate",), ".tex": ("jinja2",), ".html": ("jinja2",), ".xlsx": ("openpyxl",), ".docx": ("docx",)}
_INSTALL = "pip install 'eppanalysis[tables]'"
