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

#: Names that may change in any release, by what they are for; all others are public.
PROVISIONAL = {
    "proofs and their files": (
        "certify check_certificate certify_orbit Certificate Check CertifiedOrbit OrbitStability Proof"
    ),
    "design and tolerances": (
        "design Design tolerance_bound ToleranceBound design_guide Guide manual_table ManualTable dither "
        "Dither smoothed"
    ),
    "diagnosis and remedies": "diagnose Diagnosis remedies Remedies",
    "elements of your own": (
        "Automaton AutomatonBuilder AutomatonElement Guard Mode Smooth OwnStates check_element ElementCheck"
    ),
    "curves of folds, boundaries and pictures of maps": (
        "continue_folds FoldCurve Boundary free_region outcome_boundary plot_design_map plot_parallel plot_slices "
        "plot_sweep"
    ),
    "disturbances, onset points and frozen loops": "trigger Trigger olop OnsetPoint frozen_nyquist FrozenLoop",
    "several measured paths and rational models": "MeasuredMatrix rational_model RationalModel MeasuredCycle",
    "parts of reports, costs of sweeps": "first_page sweep_cost",
}
_PROMISE = """\
Every name on this page is **public** or **provisional**.

* A public name keeps its meaning, its arguments and the fields of its result within a minor version (0.1.x). A later
  minor version changes it only after one that warned, and CHANGELOG.md says so.
* A provisional name may change in any release without a warning.
* What this page does not list (modules, names with an underscore) is internal.

Provisional are:

"""


def _promise() -> str:
    return _PROMISE + "\n".join(
        f"* {job}: {', '.join(f'`{name}`' for name in names.split())}" for job, names in PROVISIONAL.items()
    )


def page() -> str:
    """The page as Markdown."""
    names: dict[str, list[str]] = {title: [] for title in _SECTIONS}
    for name, module in epp._MODULE_OF.items():
        if not inspect.ismodule(getattr(epp, name)):
            names[_section(name, module)].append(name)
    parts = [
        "# Python API",
        '<!-- Made by "python -m studies.pages.api" from the code; changes belong there. -->',
        _promise(),
    ]
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
