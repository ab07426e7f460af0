"""Tables for manuals and drawings: few columns, plain words, numbers rounded to the safe side, ready to be pasted.

What is written is what a reader of a manual needs: a title, a table, the notes that say how to read it. Everything else
(tests, tolerances, provenance) is in the tables that programs read.
"""

from __future__ import annotations

import html
import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from decimal import Decimal
from enum import StrEnum
from pathlib import Path
from typing import Any

from eppanalysis.errors import EppError
from eppanalysis.readable import one_line
from eppanalysis.tables.files import check_target
from eppanalysis.writing import at_once, atomic

#: Letters in a column of a workbook.
_LETTERS = 24
_LATEX = {c: f"\\{c}" for c in "&%$#_{}"} | {
    "\\": "\\textbackslash{}",
    "~": "\\textasciitilde{}",
    "^": "\\textasciicircum{}",
    "<": "\\textless{}",
    ">": "\\textgreater{}",
}
#: Between a number and its unit no line of a narrow column is broken; what is counted in a long word is broken there.
_WITH_UNIT = re.compile(r"(?<=\d) (?=[A-Za-zµ%]\S{0,7}(?:\s|$))")
_STYLE = """
:root { color-scheme: light dark; }
body { font: 15px/1.45 system-ui, sans-serif; margin: 2rem; max-width: 52rem; }
table { border-collapse: collapse; margin: 1rem 0; display: block; overflow-x: auto; }
caption { text-align: left; font-weight: 600; margin-bottom: .5rem; }
th, td { border: 1px solid #999; padding: .3rem .6rem; vertical-align: top; text-align: left; }
th { background: #8882; } td.number { text-align: right; white-space: nowrap; }
"""


class Shade(StrEnum):
    """How sure a row is, as the colour of its second cell (red, green and blue in hexadecimal)."""

    SURE = "D5EFE3"
    LIKELY = "DCEBF7"
    ROUGH = "FCEBD0"
    NONE = ""


@dataclass(frozen=True)
class ManualTable:
    """A table that goes into a manual as it is.

    Attributes
    ----------
    title : str
        The caption.
    columns : tuple of str
        Headings, with units in brackets.
    rows : tuple of tuple of (Decimal or str)
        Numbers have as many decimals as are to be printed.
    notes : tuple of str
        How to read it, a sentence each.
    shades : tuple of Shade
        How sure the second cell of each row is, which the rows say in words as well; empty for a table without colours.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Decimal | str, ...], ...]
    notes: tuple[str, ...]
    shades: tuple[Shade, ...] = ()

    def __post_init__(self) -> None:
        if len(self.shades) not in (0, len(self.rows)):
            raise EppError(f"{self.title}: has {len(self.shades)} shades; expected one a row, or none.")
        if any(len(row) != len(self.columns) for row in self.rows):
            raise EppError(f"{self.title}: a row has other cells than headings; expected {len(self.columns)} a row.")

    def texts(self) -> tuple[tuple[str, ...], ...]:
        """The rows as they are printed."""
        return tuple(tuple(_printed(cell) for cell in row) for row in self.rows)

    def shaded(self) -> Iterator[tuple[tuple[str, ...], Shade]]:
        """The rows as they are printed, each with its shade."""
        return zip(self.texts(), self.shades or [Shade.NONE] * len(self.rows), strict=True)

    def is_number(self, column: int) -> bool:
        """Whether a column holds numbers (and dashes where there is none)."""
        return any(isinstance(row[column], Decimal) for row in self.rows)

    def __str__(self) -> str:
        """The table in Markdown, which is text that people read as it is."""
        return _markdown(self)

    def _repr_html_(self) -> str:
        return _html_table(self)

    def write(self, path: Path | str) -> None:
        """Write it as Markdown, LaTeX, HTML, Word or Excel, by the ending of the name.

        Raises
        ------
        EppError
            If the ending is not known, a library that it needs is not installed, or the file cannot be written.
        """
        path = Path(path)
        check_manual(path)
        with atomic(path) as part:
            _WRITERS[path.suffix.lower()](self, part)


def check_manual(path: Path) -> None:
    """Refuse what cannot be written, before anything is computed for it.

    Raises
    ------
    EppError
        If the ending is not known, the folder does not exist, or a library that the ending needs is not there.
    """
    check_target(path, MANUALS, _NEEDED)


def _printed(cell: Decimal | str) -> str:
    """A cell on one line; a number without powers of ten."""
    return f"{cell:f}" if isinstance(cell, Decimal) else one_line(cell)


def _markdown(table: ManualTable) -> str:
    def line(cells: Sequence[str]) -> str:
        return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"

    rule = line(["---:" if table.is_number(i) else "---" for i in range(len(table.columns))])
    rows = [line(table.columns), rule, *map(line, table.texts())]
    notes = "\n".join(f"* {note}" for note in table.notes)
    return "\n".join([f"**{table.title}**", "", *rows, "", notes])


def _latex_text(text: str) -> str:
    return "".join(_LATEX.get(character, character) for character in one_line(text))


def _latex(table: ManualTable) -> str:
    n = len(table.columns)
    width = f"\\dimexpr{1 / n:.4f}\\linewidth-2\\tabcolsep"
    kinds = ["\\raggedleft" if table.is_number(i) else "\\raggedright" for i in range(n)]
    columns = "".join(f">{{{kind}\\arraybackslash}}p{{{width}}}" for kind in kinds)
    lines = [_latex_line(row, shade) for row, shade in table.shaded()]
    head = " & ".join(f"\\textbf{{{_latex_text(name)}}}" for name in table.columns) + " \\\\"
    notes = "\n".join(f"  \\item {_latex_text(note)}" for note in table.notes)
    return "\n".join(
        [
            "% Needs the packages array, booktabs, longtable"
            + (" and xcolor with its option table." if table.shades else "."),
            f"\\begin{{longtable}}{{{columns}}}",
            f"\\caption{{{_latex_text(table.title)}}} \\\\",
            f"\\toprule\n{head}\n\\midrule\n\\endhead",
            *lines,
            "\\bottomrule\n\\end{longtable}",
            f"\\begin{{itemize}}\n{notes}\n\\end{{itemize}}",
        ]
    )


def _latex_line(row: Sequence[str], shade: Shade) -> str:
    cells = [_latex_text(cell) for cell in row]
    if shade:
        cells[1] = f"\\cellcolor[HTML]{{{shade}}}{cells[1]}"
    return " & ".join(cells) + " \\\\"


def _html_table(table: ManualTable) -> str:
    head = "".join(f"<th>{html.escape(name)}</th>" for name in table.columns)
    kinds = [' class="number"' if table.is_number(i) else "" for i in range(len(table.columns))]

    def cell(i: int, text: str, shade: Shade) -> str:
        fill = f' style="background: #{shade}; color: #222"' if shade and i == 1 else ""
        return f"<td{kinds[i]}{fill}>{html.escape(text)}</td>"

    rows = "\n".join(
        f"<tr>{''.join(cell(i, text, shade) for i, text in enumerate(row))}</tr>" for row, shade in table.shaded()
    )
    notes = "".join(f"<li>{html.escape(note)}</li>" for note in table.notes)
    caption = html.escape(one_line(table.title))
    return (
        f"<table><caption>{caption}</caption>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{rows}\n</tbody></table>"
        f"\n<ul>{notes}</ul>"
    )


def _html(table: ManualTable) -> str:
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>{html.escape(one_line(table.title))}'
        f"</title><style>{_STYLE}</style></head>\n<body>\n{_html_table(table)}\n</body></html>"
    )


def _word(table: ManualTable, path: Path) -> None:
    from docx import Document
    from docx.enum.text import WD_ALIGN_PARAGRAPH
    from docx.oxml import OxmlElement
    from docx.oxml.ns import qn

    document = Document()
    document.add_heading(one_line(table.title), level=2)
    grid = document.add_table(rows=1, cols=len(table.columns), style="Table Grid")
    for cell, name in zip(grid.rows[0].cells, table.columns, strict=True):
        cell.paragraphs[0].add_run(name).bold = True
    # The headings are repeated on every page.
    grid.rows[0]._tr.get_or_add_trPr().append(OxmlElement("w:tblHeader"))
    for texts, shade in table.shaded():
        for i, (cell, text) in enumerate(zip(grid.add_row().cells, texts, strict=True)):
            cell.text = _WITH_UNIT.sub("\N{NO-BREAK SPACE}", text)
            if shade and i == 1:
                fill = OxmlElement("w:shd")
                fill.set(qn("w:val"), "clear")
                fill.set(qn("w:fill"), shade)
                cell._tc.get_or_add_tcPr().append(fill)
            if table.is_number(i):
                cell.paragraphs[0].alignment = WD_ALIGN_PARAGRAPH.RIGHT
    document.add_paragraph()
    for note in table.notes:
        document.add_paragraph(note, style="List Bullet")
    with at_once(path) as stream:
        document.save(stream)


def size_rows(sheet: Any, first: int = 1) -> None:
    """Make rows as high as their wrapped texts: not every program looks for that itself."""
    for row in sheet.iter_rows(min_row=first):
        widths = (sheet.column_dimensions[cell.column_letter].width for cell in row)
        texts = (str(cell.value or "") for cell in row)
        # Bold letters and margins take a tenth.
        lines = (math.ceil(1.1 * len(text) / width) for text, width in zip(texts, widths, strict=True))
        sheet.row_dimensions[row[0].row].height = 15.0 * max(1, *lines)


def keep_texts(sheet: Any) -> None:
    """Make every text of a sheet a text, whatever it begins with: none is run as a formula, and none needs a mark."""
    for cell in (cell for row in sheet.iter_rows() for cell in row if isinstance(cell.value, str)):
        cell.data_type, cell.quotePrefix = "s", True


def _excel(table: ManualTable, path: Path) -> None:
    from openpyxl import Workbook
    from openpyxl.styles import Alignment, Border, Font, PatternFill, Side

    book = Workbook()
    sheet = book.active
    sheet.title = "guideline"
    sheet.append([one_line(table.title)])
    sheet["A1"].font = Font(bold=True, size=13)
    sheet.append(list(table.columns))
    line = Side(style="thin", color="999999")
    wrapped = Alignment(wrap_text=True, vertical="top")
    shades = [shade for _, shade in table.shaded()]
    for row, shade in zip(table.rows, shades, strict=True):
        sheet.append([float(cell) if isinstance(cell, Decimal) else one_line(cell) for cell in row])
        for cell, value in zip(sheet[sheet.max_row], row, strict=True):
            if isinstance(value, Decimal):
                places = max(0, -int(value.as_tuple().exponent))
                cell.number_format = "0." + "0" * places if places else "0"
        if shade:
            sheet.cell(sheet.max_row, 2).fill = PatternFill("solid", start_color=shade)
    for cells in sheet.iter_rows(min_row=2):
        for cell in cells:
            cell.alignment, cell.border = wrapped, Border(line, line, line, line)
    for cell in sheet[2]:
        cell.font, cell.fill = Font(bold=True), PatternFill("solid", start_color="F0F0F0")
        sheet.column_dimensions[cell.column_letter].width = _LETTERS
    size_rows(sheet, first=2)
    for note in table.notes:
        sheet.append([note])
        sheet.merge_cells(start_row=sheet.max_row, end_row=sheet.max_row, start_column=1, end_column=len(table.columns))
        sheet.cell(sheet.max_row, 1).alignment = wrapped
        sheet.row_dimensions[sheet.max_row].height = 15.0 * math.ceil(len(note) / 110)
    sheet.freeze_panes = "A3"
    sheet.print_title_rows = "2:2"
    sheet.page_setup.orientation, sheet.page_setup.fitToHeight = "landscape", 0
    sheet.sheet_properties.pageSetUpPr.fitToPage = True
    keep_texts(sheet)
    with at_once(path) as stream:
        book.save(stream)


def _text(make: Callable[[ManualTable], str]) -> Callable[[ManualTable, Path], None]:
    def write(table: ManualTable, path: Path) -> None:
        path.write_text(f"{make(table)}\n", encoding="utf-8")

    return write


_WRITERS: dict[str, Callable[[ManualTable, Path], None]] = {
    ".md": _text(_markdown),
    ".tex": _text(_latex),
    ".html": _text(_html),
    ".docx": _word,
    ".xlsx": _excel,
}
#: Endings of the files that manuals take their tables from.
MANUALS = tuple(_WRITERS)
#: The package to be installed for an ending, and the module that it brings.
_NEEDED = {".docx": ("docx",), ".xlsx": ("openpyxl",)}
