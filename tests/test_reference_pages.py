"""Pages of the reference that stand under version control say what the code says."""

from __future__ import annotations

import inspect
import re

import pytest

from eppanalysis.cases.blocks import element_class
from eppanalysis.cases.schema import LoopFile, LoopSection, RunSection, SignalRow
from eppanalysis.models.elements import ELEMENTS
from studies import DOCS
from studies.pages import elements

LOOPS = (DOCS / "reference" / "loops.md").read_text(encoding="utf-8")


def test_the_page_on_elements_is_that_of_the_code():
    assert elements.PAGE.read_text(encoding="utf-8") == elements.page(), "run python -m studies.pages.elements"


@pytest.mark.parametrize("kind", ELEMENTS)
def test_every_field_of_an_element_has_a_meaning_and_nothing_else_has(kind):
    assert set(elements.meanings(kind)) == set(inspect.signature(element_class(kind)).parameters)
    assert all(re.search(r"\w", text) for text in elements.meanings(kind).values())


@pytest.mark.parametrize("model", [LoopFile, LoopSection, RunSection, SignalRow])
def test_every_field_of_a_loop_stands_on_its_page(model):
    words = set(re.findall(r"[A-Za-z_]+", " ".join(re.findall(r"`+([^`]+)`+", LOOPS))))
    assert not set(model.model_fields) - words
