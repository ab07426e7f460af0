"""From an executed notebook to a file: the notebook itself, one HTML page, or that page printed as PDF."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from eppanalysis.errors import EppError
from eppanalysis.writing import atomic

if TYPE_CHECKING:
    from nbconvert import HTMLExporter
    from nbformat import NotebookNode

#: Browsers that print a page without a window, by the names of their programs.
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "msedge")
_MAC = "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome"
_TEMPLATES = Path(__file__).parent / "templates"
#: A number with what a line would break at: the sign of its exponent, or the space before its unit; no entity.
_NUMBER = re.compile(r"(?<![\w#.])-?\d[\d.]*(?:e[-+]\d+(?: [A-Za-z%]+)?| [A-Za-z%]+)")
#: How long a browser may take to print a page [s].
_LONGEST_PRINT = 120
#: How much larger than its style says what comes after the first page is printed at least, and may be, largest first.
_LEAST, _LARGER = 0.94, (1.2, 1.1, 1.0)
#: The pages of a PDF that Chromium prints.
_PAGE = re.compile(rb"/Type\s*/Page\b(?!s)")


def write(notebook: NotebookNode, path: Path) -> None:
    """Write an executed notebook as the kind of file that the suffix of `path` names, completely or not at all.

    Raises
    ------
    EppError
        If the file cannot be written, or a PDF is requested and no browser prints it.
    """
    with atomic(path) as part:
        if path.suffix.lower() == ".ipynb":
            import nbformat

            nbformat.validate(notebook)
            part.write_text(nbformat.writes(notebook) + "\n", encoding="utf-8")
        elif path.suffix.lower() == ".html":
            part.write_text(to_html(notebook, path), encoding="utf-8")
        else:
            print_page(to_html(notebook, path), part, path)


def to_html(notebook: NotebookNode, path: Path) -> str:
    """The page for a file: without scripts and without links to anything outside."""
    return str(exporter(path).from_notebook_node(notebook)[0])


def exporter(path: Path) -> HTMLExporter:
    """What makes pages of notebooks.

    Raises
    ------
    EppError
        If the templates that nbconvert brings beside its modules are not there; it names `path`.
    """
    from jinja2 import TemplateNotFound
    from nbconvert import HTMLExporter

    try:
        made = HTMLExporter(template_name="eppanalysis", extra_template_basedirs=[str(_TEMPLATES)])
        made.register_filter("unbroken", unbroken)
        made.template  # noqa: B018  # is read when it is first requested, which is where one that is missing shows
    except (ValueError, TemplateNotFound):
        how = "'pip install --force-reinstall nbconvert' installs, or a report that ends in .ipynb"
        raise EppError(
            f"{path}: a page needs the templates of nbconvert, which are missing; expected what {how}."
        ) from None
    return made


def unbroken(text: str) -> str:
    """Escaped text in which no line ends within a number, or between it and its unit or the word behind it.

    Examples
    --------
    >>> unbroken("it&#39;s 2 Hz, 3e-05.")
    'it&#39;s <span class="number">2 Hz</span>, <span class="number">3e-05</span>.'
    """
    return _NUMBER.sub(r'<span class="number">\g<0></span>', text)


def find_browser(path: Path) -> str:
    """The program that prints pages.

    Raises
    ------
    EppError
        If there is none; it names `path`, which cannot be written without.
    """
    for name in BROWSERS:
        found = shutil.which(name)
        if found:
            return found
    if sys.platform == "darwin" and os.access(_MAC, os.X_OK):
        return _MAC
    raise EppError(
        f"{path}: a PDF is printed by Chromium or Chrome, and there is none; expected one installed "
        "(Debian and Ubuntu: apt install chromium), or a report that ends in .html, which any browser prints."
    )


def print_page(page: str, part: Path, path: Path) -> None:
    """Print a page to `part`, as large as it goes on the fewest sheets; messages call it `path`.

    Raises
    ------
    EppError
        If there is no browser or it fails.
    """
    browser = find_browser(path)
    fewest = _printed(browser, _scaled(page, _LEAST), path)
    larger = (_printed(browser, _scaled(page, scale), path) for scale in _LARGER)
    sheets = len(_PAGE.findall(fewest))
    part.write_bytes(next((printed for printed in larger if len(_PAGE.findall(printed)) <= sheets), fewest))


def _scaled(page: str, scale: float) -> str:
    """A page of which all but the first sheet is printed larger; tables of many columns have no room to grow."""
    tables = f".part + .part table:has(td:nth-child(4)) {{ zoom: {min(1.0, 1.0 / scale):.4f}; }}"
    style = f"<style>@media print {{ .part + .part {{ zoom: {scale}; }} {tables} }}</style></head>"
    return page.replace("</head>", style, 1)


def _printed(browser: str, page: str, path: Path) -> bytes:
    """The PDF of a page.

    Raises
    ------
    EppError
        If the browser fails.
    """
    with tempfile.TemporaryDirectory(prefix="eppanalysis-print-", ignore_cleanup_errors=True) as folder:
        source, printed = Path(folder) / "report.html", Path(folder) / "report.pdf"
        source.write_text(page, encoding="utf-8")
        command = [browser, *_options(folder), "--no-pdf-header-footer", f"--print-to-pdf={printed}", source.as_uri()]
        try:
            ended = subprocess.run(command, check=False, capture_output=True, timeout=_LONGEST_PRINT)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise EppError(f"{path}: {browser} did not print it ({error}); expected a working browser.") from error
        if not printed.is_file() or not printed.stat().st_size:
            said = ended.stderr.decode(errors="replace").strip().splitlines()[-1:]
            raise EppError(f"{path}: {browser} did not print it ({''.join(said)[:200]}); expected a working browser.")
        return printed.read_bytes()


def _options(folder: str) -> list[str]:
    """No window, no network, a profile that is thrown away."""
    options = [
        "--headless",
        "--disable-gpu",
        "--disable-extensions",
        "--disable-background-networking",
        "--disable-component-update",
        "--disable-sync",
        "--no-first-run",
        "--host-resolver-rules=MAP * ~NOTFOUND",
        f"--user-data-dir={folder}/profile",
    ]
    # Chromium refuses to sandbox itself for root, as in most containers.
    as_root = hasattr(os, "geteuid") and os.geteuid() == 0
    return [*options, "--no-sandbox"] if as_root else options
