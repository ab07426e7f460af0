"""Cases: validated case files, the quantities in them, and the systems that they describe.

A case file is TOML. It may name a `base` in the same folder, or one that ships, and override single fields of it; each
value is a quantity as people write it, or a table of value, mark, note and tolerance.
"""

from __future__ import annotations

from pathlib import Path

from eppanalysis.cases.expected import Cycle, Expected, Published
from eppanalysis.cases.files import (
    GROUPS,
    PLAIN_NAME,
    Missing,
    parse_raw,
    read_raw,
    shipped_cases,
    shipped_cases_folder,
)
from eppanalysis.cases.model import Case, json_schema, opened
from eppanalysis.cases.values.quantities import Parameter
from eppanalysis.cases.variation import Variation
from eppanalysis.errors import CaseError
from eppanalysis.models.diagrams import Diagram
from eppanalysis.models.systems.lure import LureSystem

__all__ = [
    "GROUPS",
    "Case",
    "Cycle",
    "Expected",
    "Parameter",
    "Published",
    "as_case",
    "case",
    "case_from_text",
    "json_schema",
    "read_case",
    "shipped_cases",
    "shipped_cases_folder",
    "variation_of",
]


def read_case(path: str | Path) -> Case:
    """Read and validate a case file.

    Parameters
    ----------
    path : str or Path
        The TOML file.

    Returns
    -------
    Case

    Raises
    ------
    CaseError
        If anything in it, or in a base of it, is not valid: one sentence with file, field, value and what was expected.

    Examples
    --------
    >>> from eppanalysis.cases import read_case, shipped_cases_folder
    >>> found = read_case(shipped_cases_folder() / "fig8a_original.toml")
    >>> found.name, str(found.parameters["lock_pin.backlash"])
    ('fig8a_original', '2.5 deg')
    """
    return opened(read_raw(Path(path), str(path)))


def as_case(given: Case | LureSystem | Diagram) -> Case:
    """What an analysis over parameters was handed, a loop as the case that it makes.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> plant = ([5.0], [1.0, 1.0, 0.0])
    >>> as_case(epp.LureSystem.from_tf(plant, epp.Play(gap=2.0), name="servo")).name
    'servo'
    """
    return Case.from_system(given) if isinstance(given, LureSystem | Diagram) else given


def case_from_text(text: str, name: str = "case", folder: str | Path | None = None) -> Case:
    r"""The case that a TOML text holds, as notebooks carry it with them.

    Parameters
    ----------
    text : str
        The text of a case file.
    name : str
        Name of the case: letters, digits, underscores, hyphens and dots.
    folder : str or Path, optional
        Where files that it names are looked for; only the cases that ship by default.

    Returns
    -------
    Case

    Raises
    ------
    CaseError
        If anything in it is not valid, as for :func:`read_case`.

    Examples
    --------
    >>> from eppanalysis import case_from_text
    >>> mine = case_from_text(
    ...     'base = "fig8a_original"\nlock_pin.backlash = "1 deg"', name="mine"
    ... )
    >>> mine.name, str(mine.parameters["lock_pin.backlash"])
    ('mine', '1 deg')
    """
    if not PLAIN_NAME.fullmatch(str(name)):
        raise CaseError("case_from_text", "name", name, "a plain name such as 'my_elbow'")
    return opened(parse_raw(str(text), str(name), shipped_cases_folder() if folder is None else Path(folder)))


def case(name: str) -> Case:
    """A case that comes with the package.

    Parameters
    ----------
    name : str
        Name of its file without the ending; :func:`shipped_cases` lists them.

    Returns
    -------
    Case

    Raises
    ------
    CaseError
        If no such case ships.

    Examples
    --------
    >>> from eppanalysis import case
    >>> case("relay_ideal_khalil79").kind
    'loop'
    """
    import difflib

    known = shipped_cases()
    if name not in known:
        close = difflib.get_close_matches(str(name)[:100], known, n=1)
        expected = (
            f"a case that ships: did you mean {close[0]!r}?" if close else "a case file, or the name of a shipped case"
        )
        if str(name).endswith(".toml"):
            expected = "the name of a case that ships; read_case reads a file"
        raise CaseError(str(name)[:100], "", Missing(), expected)
    return opened(read_raw(shipped_cases_folder() / f"{name}.toml", f"{name}.toml"))


def variation_of(case: Case) -> Variation:
    """What is worth varying in a case.

    Examples
    --------
    >>> from eppanalysis.cases import case
    >>> [slider.label() for slider in variation_of(case("backlash_servo")).sliders()]
    ['loop gain', 'play gap']
    """
    return case._variation
