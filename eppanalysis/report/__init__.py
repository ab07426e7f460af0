"""A report: a notebook made from a template, executed, and written as notebook, one HTML file, or PDF.

The notebook uses only the public face of the package and carries its cases with it, so that it opens and runs again in
Jupyter as it is. ``sections`` holds the template, ``notebook`` makes and executes, ``page`` writes.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from eppanalysis.cases import Case, as_case
from eppanalysis.errors import EppError, require_packages
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.progress import Progress

__all__ = ["SUFFIXES", "check", "report"]

SUFFIXES = (".html", ".ipynb", ".pdf")
_NEEDED = ("nbformat", "nbclient", "nbconvert", "ipykernel", "dask", "filelock", "zarr")


def check(path: Path) -> None:
    """Refuse what cannot be written, before anything is computed for it.

    Raises
    ------
    EppError
        If the suffix is not one of a report, the folder does not exist, a library or its templates are missing, or a
        PDF is requested and there is no browser that prints it.
    """
    from eppanalysis.report.page import exporter, find_browser
    from eppanalysis.tables.files import check_target

    check_target(path, SUFFIXES)
    require_packages(f"{path}: a report", "report", *_NEEDED)
    if path.suffix.lower() != ".ipynb":
        exporter(path)
    if path.suffix.lower() == ".pdf":
        find_browser(path)


def report(
    cases: Case | LureSystem | Sequence[Case | LureSystem],
    path: str | Path,
    *,
    full: bool = False,
    progress: Progress | None = None,
) -> Path:
    """Write a report of a case, or of several: everything that the methods say of it, with pictures and provenance.

    A first page (verdict, picture, numbers, what to do), then the sections of a case: prediction with margins and
    Nyquist plot, the ladder, all exact limit cycles, disturbances, the branch over a parameter, a small design map, of
    an elbow the bound on its backlash with the guideline, and last its values with their marks and where everything
    comes from.

    Parameters
    ----------
    cases : Case, LureSystem or sequence of them
    path : str or Path
        ``.html`` is one file that opens without a network, ``.ipynb`` the executed notebook, ``.pdf`` the page printed
        by Chromium or Chrome.
    full : bool
        The guideline of an elbow at five gains about its own, with the describing function beside it and each bound
        tested by a thousand runs, and what ends an oscillation; some minutes. Otherwise at its own gain, tested by a
        hundred runs.
    progress : callable, optional
        Called before each cell with its number, the number of cells, and its heading.

    Returns
    -------
    Path
        The file. It is complete, or it is not there.

    Raises
    ------
    EppError
        If there is no case, the file cannot be written, a library or the browser for a PDF is missing, or a cell of the
        notebook failed; a section that has nothing to say of a case says why in a sentence of its own.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> epp.report(epp.case("fig8a_original"), "report.html")  # doctest: +SKIP
    PosixPath('report.html')
    >>> epp.report(epp.case("fig8a_original"), "report.docx")
    Traceback (most recent call last):
    eppanalysis.errors.EppError: report.docx: cannot write a file that ends in
    '.docx'; ...
    """
    target = Path(path)
    check(target)
    one = isinstance(cases, LureSystem) or hasattr(cases, "to_system")
    given: tuple[Any, ...] = (cases,) if one else tuple(cases)  # type: ignore[arg-type]
    chosen = [as_case(case) for case in given]
    if not chosen:
        raise EppError(f"{target}: is a report of no case; expected one case or more.")

    from eppanalysis.report.notebook import execute, make_notebook
    from eppanalysis.report.page import write

    write(execute(make_notebook(chosen, full=full), str(target), progress), target)
    return target
