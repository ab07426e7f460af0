"""The page on the blocks of a diagram, made from their declared fields: ``python -m studies.pages.blocks``.

It is under version control, for it is read where nothing is built; a test compares it with the code.
"""

from __future__ import annotations

import dataclasses
import inspect
import re
from collections.abc import Iterable

from eppanalysis.cases.words import KINDS_OF_BLOCKS
from eppanalysis.models.devices.declared import Declared, Form, declared_fields
from eppanalysis.models.diagrams import BLOCKS, Block
from eppanalysis.readable import in_print
from studies import DOCS
from studies.pages.words import other_words_line

PAGE = DOCS / "reference" / "blocks.md"

_INTRODUCTION = """\
# Blocks of a diagram

<!-- Made by "python -m studies.pages.blocks" from the code; changes belong there. -->

The values of `kind =` in `[blocks]` of a diagram ({doc}`diagrams`), with ports and fields. A field without a default is
required. A value is a quantity (`"2 ohm"`, or a number in SI units) or an expression ({ref}`expressions`). In Python
the class of the same fields, by name: `epp.blocks.Motor(resistance=2.0, torque_constant=0.05, inertia=2e-5)`. Ports are
written as inputs → outputs. Words behind "Also" are read as the kind, or the field before them.

"""

_COMMON = """\
## All blocks

Every block also takes:

"""

#: Of a block of matrices: one, several, or those that are given names.
_PORTS_OF_MATRICES = "`{0}`; `{0}1`, `{0}2`, ...; or `{0}put_names`"


def page() -> str:
    """The page as Markdown."""
    common = _fields(declared_fields(Block).items(), Block)
    also = other_words_line("gain", {}).rstrip("\n")  # of a block that has no words of its own
    return f"{_INTRODUCTION}{_COMMON}{common}\n{also}\n" + "".join(map(_section, BLOCKS))


def _section(kind: str) -> str:
    """Heading, docstring, ports and the fields of a block."""
    made = BLOCKS[kind]
    says = _markdown(inspect.cleandoc(made.__doc__ or "").split("\n\nAttributes\n")[0].replace("\n\n", "\n"))
    parent = next(base for base in made.__mro__[1:] if base is Block or (issubclass(base, Block) and base.kind))
    own = [(name, about) for name, about in declared_fields(made).items() if name not in declared_fields(parent)]
    ports = f"`epp.blocks.{made.__name__}`: {_inputs(made)} → {_outputs(made)}."
    also = other_words_line(kind, KINDS_OF_BLOCKS, declared_fields(Block)).rstrip("\n")
    listed = ("" if parent is Block else f"Fields of `{parent.kind}`, and\n\n") + _fields(own, made)
    return "\n" + "\n\n".join(filter(None, (f"## {kind}", says, ports, also, listed.rstrip("\n")))) + "\n"


def _fields(fields: Iterable[tuple[str, Declared]], made: type[Block]) -> str:
    """A list of fields."""
    defaults = {field.name: field.default for field in dataclasses.fields(made)}
    return "".join(f"- `{name}`{_default(defaults[name])}: {_meaning(about)}\n" for name, about in fields)


def _meaning(about: Declared) -> str:
    unit = f" [{in_print(about.unit)}]" if about.unit else ""
    words = f": {', '.join(f'`{word}`' for word in about.choices)}" if about.choices else ""
    held = {Form.NUMBERS: " (numbers)", Form.NAMES: " (a list)"}.get(about.form, "")
    least = "; positive" if about.above == 0 else "; not negative" if about.at_least == 0 else ""
    return f"{about.about}{words}{held}{unit}{least}"


def _default(value: object) -> str:
    if value is dataclasses.MISSING:
        return ""
    if isinstance(value, str):
        return f" (`{value}`)"
    return f" ({value:g})" if isinstance(value, float) else " (optional)"


def _inputs(made: type[Block]) -> str:
    return _PORTS_OF_MATRICES.format("in") if made.kind == "state_space" else _listed(made.inputs)


def _outputs(made: type[Block]) -> str:
    return _PORTS_OF_MATRICES.format("out") if made.kind == "state_space" else _listed(made.outputs)


def _listed(names: tuple[str, ...]) -> str:
    return ", ".join(f"`{name}`" for name in names) or "none"


def _markdown(text: str) -> str:
    """Literals of a docstring as those of Markdown."""
    return re.sub(r"``([^`]+)``", r"`\1`", text)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
