"""Pages of the reference that stand under version control say what the code says."""

from __future__ import annotations

import ast
import builtins
import doctest
import inspect
import math
import re
import runpy
from enum import Enum

import pytest

import eppanalysis as epp
import eppanalysis.models.elements as model_elements
from eppanalysis.cases.blocks import element_class
from eppanalysis.cases.schema import CutRow, DiagramFile, LoopFile, LoopSection, RunSection, SignalRow, SignalSum
from eppanalysis.cases.values.expressions import FUNCTIONS
from eppanalysis.models.diagrams import BLOCKS
from eppanalysis.models.diagrams.wiring import port_names
from eppanalysis.models.elements import ELEMENTS
from studies import DOCS
from studies.pages import api, assistants, blocks, elements, kinds

LOOPS = (DOCS / "reference" / "loops.md").read_text(encoding="utf-8")
DIAGRAMS = (DOCS / "reference" / "diagrams.md").read_text(encoding="utf-8")
#: Elements whose ports are not called "in" and "out".
WITH_PORTS = [
    epp.LockPin(gap=0.1, stiffness=1.0, damping=1.0),
    epp.NordinShaft(gap=0.1, stiffness=1.0, damping=1.0),
    epp.StictionPulley(harness_stiffness=1.0, forearm_stiffness=1.0, friction=0.1, kinetic_ratio=0.5),
    epp.ImpactStop(-1.0, 1.0, 1.0),
]


def _literals(page):
    return set(re.findall(r"[A-Za-z_]+", " ".join(re.findall(r"`+([^`]+)`+", page))))


def test_the_page_on_the_interface_is_that_of_the_code():
    assert api.PAGE.read_text(encoding="utf-8") == api.page(), "run python -m studies.pages.api"


def test_what_assistants_read_first_is_that_of_the_help_and_the_pages():
    told = {assistants.SKILL: assistants.skill(), assistants.LLMS: assistants.llms()}
    for page, text in told.items():
        assert page.read_text(encoding="utf-8") == text, "run python -m studies.pages.assistants"
    assert sum(len(text.split()) for text in told.values()) <= 500


def test_every_public_name_stands_on_the_page_of_the_interface():
    page = api.page()
    listed = re.findall(r"^   (\w+)$", page, re.MULTILINE)
    modules = {name for name in dir(epp) if inspect.ismodule(getattr(epp, name))}
    every = {*dir(epp), *api.signals(), *model_elements.__all__} - {"__version__", "ELEMENTS"} - modules
    assert every <= set(listed) and all(f"`eppanalysis.{name}`" in page for name in modules)


def test_provisional_names_are_public_ones_and_stand_once():
    names = [name for listed in api.PROVISIONAL.values() for name in listed.split()]
    assert set(names) <= set(dir(epp)) and len(names) == len(set(names))


def test_the_page_on_elements_is_that_of_the_code():
    assert elements.PAGE.read_text(encoding="utf-8") == elements.page(), "run python -m studies.pages.elements"


def test_every_field_of_an_element_has_a_meaning_and_nothing_else_has():
    for kind in ELEMENTS:
        assert set(elements.meanings(kind)) == set(inspect.signature(element_class(kind)).parameters)
        assert all(re.search(r"\w", text) for text in elements.meanings(kind).values())


def test_every_public_analysis_has_a_row_on_the_page_of_kinds():
    assert {*kinds.public_analyses()} == {*kinds.ANALYSES}
    assert {*kinds.told(kinds.PAGE.read_text(encoding="utf-8"))} == {*kinds.ANALYSES}


@pytest.mark.slow
def test_the_page_on_kinds_says_what_the_analyses_say():
    """But for those that take a minute together, which the page itself was made with."""
    names = kinds.ANALYSES.keys() - kinds.DEAR
    told = kinds.told(kinds.PAGE.read_text(encoding="utf-8"))
    assert {name: told[name] for name in names} == kinds.answers(names), "run python -m studies.pages.kinds"


@pytest.mark.parametrize("model", [CutRow, LoopFile, LoopSection, RunSection, SignalRow])
def test_every_field_of_a_loop_stands_on_its_page(model):
    assert not set(model.model_fields) - _literals(LOOPS)


def test_the_page_on_blocks_is_that_of_the_code():
    assert blocks.PAGE.read_text(encoding="utf-8") == blocks.page(), "run python -m studies.pages.blocks"


@pytest.mark.parametrize("page", [blocks.PAGE, elements.PAGE], ids=["blocks", "elements"])
def test_no_star_of_a_unit_is_read_as_emphasis(page):
    text = re.sub(r"`[^`\n]*`", "", page.read_text(encoding="utf-8"))
    assert "*" not in text.replace("**", "")


def test_every_kind_of_block_is_reached_in_python_by_one_name():
    for kind in BLOCKS:
        assert getattr(epp.blocks, BLOCKS[kind].__name__) is BLOCKS[kind]


@pytest.mark.parametrize("model", [DiagramFile, RunSection, SignalSum])
def test_every_field_of_a_diagram_stands_on_its_page(model):
    assert not set(model.model_fields) - _literals(DIAGRAMS)


def test_every_function_of_an_expression_stands_on_the_page_of_diagrams():
    assert not set(FUNCTIONS) - _literals(DIAGRAMS)


def test_ports_of_elements_that_have_names_stand_on_the_page_of_diagrams():
    named = {kind for kind in ELEMENTS if element_class(kind).input_ports or element_class(kind).output_ports}
    assert {type(element) for element in WITH_PORTS} == {element_class(kind) for kind in named}
    for element, kind in zip(WITH_PORTS, ("lock_pin", "nordin_shaft", "stiction_pulley", "impact_stop"), strict=True):
        before, behind = (", ".join(f"`{port}`" for port in ports) for ports in port_names(element))
        assert f"| `{kind}` | {before} | {behind} |" in DIAGRAMS


def _public() -> dict[str, object]:
    """Everything that has a page of its own."""
    modules = {"eppanalysis": epp, "elements": model_elements, "inputs": epp.inputs}
    names = {"eppanalysis": dir(epp), "elements": model_elements.__all__, "inputs": api.signals()}
    found = {name: getattr(modules[place], name) for place, listed in names.items() for name in listed}
    return {name: value for name, value in found.items() if inspect.isclass(value) or inspect.isfunction(value)}


def test_an_example_imports_what_it_uses():
    for name in _public():
        examples = doctest.DocTestParser().get_examples(inspect.getdoc(_public()[name]) or "")
        nodes = [node for example in examples for node in ast.walk(ast.parse(example.source))]
        named = [node for node in nodes if isinstance(node, ast.Name)]
        imported = [alias for node in nodes if isinstance(node, ast.Import | ast.ImportFrom) for alias in node.names]
        bound = {alias.asname or alias.name.partition(".")[0] for alias in imported}
        bound |= {node.id for node in named if isinstance(node.ctx, ast.Store)} | set(dir(builtins))
        assert {node.id for node in named} <= bound


def test_an_example_fits_its_page_without_scrolling():
    for name in _public():
        whole = _public()[name]
        members = [part for key, part in vars(whole).items() if key[0] != "_"] if inspect.isclass(whole) else []
        texts = [inspect.getdoc(part) or "" for part in (whole, *members)]
        examples = [example for text in texts for example in doctest.DocTestParser().get_examples(text)]
        code = [f">>> {line}" for example in examples for line in example.source.splitlines()]
        printed = [line for example in examples for line in example.want.splitlines()]
        assert not [line for line in (*code, *printed) if len(line) > 84]


@pytest.fixture(scope="module")
def configuration():
    pytest.importorskip("sphinx")
    return runpy.run_path(str(DOCS / "conf.py"))


def test_signatures_of_blocks_begin_with_what_must_be_given_and_hide_what_is_no_plain_value(configuration):
    read = configuration["as_read"]
    shown, _ = read(None, "class", "", epp.blocks.PI, None, str(inspect.signature(epp.blocks.PI)), None)
    assert shown.startswith("(*, kp, ti=None, ki=None, integral_input='in', delay=0.0,")
    assert read(None, "class", "", epp.Cuts, None, "(names, F=<factory>, _own=1)", None) == ("(names, F=...)", None)
    assert read(None, "function", "", epp.identify, None, f"(wrap={math.pi})", None) == ("(wrap=pi)", None)


LINES = """\
Off by +11.6 % at 8.84 Hz, 0.867 deg or 2·10⁻⁵ kg·m², by 20 per cent of 3 rows.

Within ± 20 % after 1 h, < 0.001 beside Figure 4(b) and Equation (2), at rtol 1e-06.

The gain ($K_p$) is 5 times $10^{-6}$ N·m/rad, so $x$ rests, $a$-$b$; ``2 mm`` and $y = 2 s$.

```python
>>> 1
1

```
"""


def test_no_line_ends_within_a_number_before_a_unit_or_beside_a_formula(tmp_path, configuration):
    from docutils import nodes
    from sphinx.application import Sphinx
    from sphinx.util.docutils import docutils_namespace, patch_docutils

    (tmp_path / "index.md").write_text(f"# Title\n\n{LINES}", encoding="utf-8")
    settings = {"extensions": ["myst_parser"], "myst_enable_extensions": ["dollarmath"]}
    with patch_docutils(), docutils_namespace():
        app = Sphinx(tmp_path, None, tmp_path / "out", tmp_path / "tree", "dummy", settings, status=None, warning=None)
        for name in ("OneLine", "LastLine"):
            app.add_transform(configuration[name])
        app.build()
        page = app.env.get_doctree("index")
    plain, numbers, formulas = page.findall(nodes.paragraph)
    held = "Off by +11.6~% at 8.84~Hz, 0.867~deg or 2·10⁻⁵~kg·m², by 20~per cent of 3 rows."
    assert plain.astext() == held.replace("~", "\N{NO-BREAK SPACE}")
    held = "Within ±~20~% after 1~h, <~0.001 beside Figure~4(b) and Equation~(2), at rtol 1e-\N{WORD JOINER}06."
    assert numbers.astext() == held.replace("~", "\N{NO-BREAK SPACE}")
    assert [block.astext() for block in page.findall(nodes.literal_block)] == [">>> 1\n1"]
    runs = [run.astext() for run in formulas.findall(nodes.inline)]
    assert runs == ["(K_p)", "10^{-6}\N{NO-BREAK SPACE}N·m/rad,", "a-b;", "y = 2 s."]
    assert [code.astext() for code in formulas.findall(nodes.literal)] == ["2 mm"]


def _undescribed(function, *docstrings) -> set[str]:
    """Arguments that none of the docstrings names in its list or between back ticks."""
    words = {name for text in docstrings for name in re.findall(r"\w+", " ".join(_listed(text or "")))}
    return {name for name in inspect.signature(function).parameters if name not in ("self", "cls")} - words


def _listed(text: str) -> list[str]:
    return re.findall(r"^ *[*]*\w[\w*, ]*(?= :|$)", inspect.cleandoc(text), re.MULTILINE)


def test_a_function_says_what_it_takes_and_returns():
    for name in [name for name, value in _public().items() if inspect.isfunction(value)]:
        function = _public()[name]
        text = inspect.getdoc(function) or ""
        assert not _undescribed(function, text)
        assert inspect.signature(function).return_annotation == "None" or re.search(r"^(Returns|Yields)\n-", text, re.M)


def test_a_class_says_what_it_is_made_from():
    for name in [name for name, value in _public().items() if inspect.isclass(value)]:
        made = _public()[name]
        if issubclass(made, Enum | Exception | type(epp.blocks)) or getattr(made, "__init__", None) is object.__init__:
            continue
        fields = {p for p in inspect.signature(made).parameters if not p.startswith("_")}
        listed = re.search(r"^(Parameters|Attributes)\n-", inspect.getdoc(made) or "", re.M)
        assert listed or not fields
        for maker in ("from_tf", "from_blocks", "from_control", "from_csv", "build"):
            method = getattr(made, maker, None)
            assert method is None or not _undescribed(method, method.__doc__, made.__doc__)


def test_every_field_of_a_class_says_what_it_is():
    for name in [name for name, value in _public().items() if inspect.isclass(value)]:
        read = pytest.importorskip("numpydoc.docscrape").NumpyDocString(inspect.getdoc(_public()[name]) or "")
        fields = [field for section in ("Parameters", "Attributes") for field in read[section]]
        assert not [field.name for field in fields if not "".join(field.desc).strip()]


def test_no_field_shows_the_docstring_of_a_type():
    for name in [name for name, value in _public().items() if inspect.isclass(value)]:
        made = _public()[name]
        own = vars(made) if not issubclass(made, Enum) else {}
        assert not [field for field, value in own.items() if not field.startswith("_") and inspect.isclass(value)]
