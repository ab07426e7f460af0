"""The page on the Python interface, made from the public names and their modules: ``python -m studies.pages.api``.

It is under version control, for the summaries of the names are made from it before anything else is; a test compares
it with the code.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterable

import eppanalysis as epp
import eppanalysis.models.elements as model_elements
from eppanalysis.models.diagrams import BLOCKS
from studies import DOCS

PAGE = DOCS / "reference" / "api.md"
#: Sections by the beginnings of the modules whose names they hold; of all other modules analyses and their results.
_SECTIONS = {
    "Cases": ("eppanalysis.cases",),
    "Analyses": (),
    "Sweeps": ("eppanalysis.sweep",),
    "Identification": ("eppanalysis.identify", "eppanalysis.diagnose"),
    "Results": (),
    "Systems": ("eppanalysis.models.systems", "eppanalysis.models.devices", "eppanalysis.models.diagrams"),
    "Elements": ("eppanalysis.models.elements",),
    "Errors": ("eppanalysis.errors",),
}


def page() -> str:
    """The page as Markdown."""
    names: dict[str, list[str]] = {title: [] for title in _SECTIONS}
    for name, module in epp._MODULE_OF.items():
        if not inspect.ismodule(getattr(epp, name)):
            names[_section(name, module)].append(name)
    parts = ["# Python API", '<!-- Made by "python -m studies.pages.api" from the code; changes belong there. -->']
    for title, listed in names.items():
        parts.append(f"## {title}\n\n{_summaries('eppanalysis', listed)}")
        if title == "Systems":
            kinds = [kind.__name__ for kind in dict.fromkeys(BLOCKS.values())]
            where = "In `eppanalysis.blocks`, with ports and fields of each: {doc}`blocks`."
            module = "eppanalysis.models.diagrams.blocks"
            parts.append(f"## Blocks of a diagram\n\n{where}\n\n{_summaries(module, ['Block', *kinds])}")
        if title == "Elements":
            own = [name for name in model_elements.__all__ if name not in {*dir(epp), "ELEMENTS"}]
            where = "In `eppanalysis.models.elements`, what an element remembers and laws that loops are made with:"
            parts.append(f"{where}\n\n{_summaries(model_elements.__name__, own)}")
            summaries = _summaries(epp.inputs.__name__, signals())
            parts.append(f"## Input signals\n\nIn `eppanalysis.inputs`:\n\n{summaries}")
    return "\n\n".join(parts) + "\n"


def signals() -> list[str]:
    """Names of the input signals."""
    own = {n: v for n, v in vars(epp.inputs).items() if getattr(v, "__module__", "") == epp.inputs.__name__}
    return [name for name, value in own.items() if hasattr(value, "__dataclass_fields__") and not name.startswith("_")]


def _section(name: str, module: str) -> str:
    found = [title for title, begins in _SECTIONS.items() if module.startswith(begins or "-")]
    return found[0] if found else "Analyses" if inspect.isfunction(getattr(epp, name)) else "Results"


def _summaries(module: str, names: Iterable[str]) -> str:
    """The directive that lists names of a module with the first lines of their docstrings."""
    head = f".. currentmodule:: {module}\n.. autosummary::\n   :toctree: ../_generated/api\n\n"
    return "```{eval-rst}\n" + head + "".join(f"   {name}\n" for name in names) + "```"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
