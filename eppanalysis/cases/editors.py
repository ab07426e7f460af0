"""One JSON schema of all case files, for editors that complete and check them while they are written."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from eppanalysis.cases.blocks import field_types, known_elements
from eppanalysis.cases.model import KINDS, json_schema
from eppanalysis.cases.values.automata import AUTOMATON
from eppanalysis.cases.words import (
    ELEMENT,
    FILE,
    KIND,
    KINDS_OF_BLOCKS,
    KINDS_OF_ELEMENTS,
    OF_ALL,
    other_kinds,
    other_words,
)
from eppanalysis.models.devices.declared import Declared, declared_fields
from eppanalysis.models.diagrams import BLOCKS

_DEFINITIONS = "$defs"
#: What a file that inherits may leave out is for the file that it inherits from to say.
_PARTLY = "partly_"


def case_schema() -> dict[str, Any]:
    """JSON schema (draft 2020-12) of a case file of any kind; of one that inherits every part may be left out.

    It knows fields, those of each kind of block and element among them, types and choices. Units, ranges and what parts
    mean together are checked by ``eppanalysis check``.

    Examples
    --------
    >>> case_schema()["else"]["properties"]["kind"]["enum"]
    ['elbow', 'loop', 'diagram']
    """
    definitions: dict[str, Any] = {}
    for kind in KINDS:
        whole = json_schema(kind)
        for prefix, change in (("", False), (_PARTLY, True)):
            name = f"{prefix}{kind}"
            parts = {**whole.get(_DEFINITIONS, {}), "": {k: v for k, v in whole.items() if k != _DEFINITIONS}}
            for part, schema in parts.items():
                definitions[_place(name, part)] = _moved(schema, name, partly=change)
    for prefix, change in (("", False), (_PARTLY, True)):
        definitions |= {f"{prefix}{part}": schema for part, schema in _parts(partly=change).items()}
        for section, part in (("blocks", "block"), ("elements", "element")):
            for named in definitions[f"{prefix}diagram"]["properties"][section]["patternProperties"].values():
                named["$ref"] = f"#/{_DEFINITIONS}/{prefix}{part}"
            # A ring's parts may be without an element, and are then linear.
            for choice in definitions[f"{prefix}loop.LoopSection"]["properties"][section]["anyOf"]:
                if "items" in choice:
                    choice["items"]["$ref"] = f"#/{_DEFINITIONS}/{_PARTLY}element"
    by_kind = [
        {
            "if": {"properties": {"kind": {"const": kind}}, "required": ["kind"]},
            "then": {"$ref": f"#/{_DEFINITIONS}/{kind}"},
        }
        for kind in KINDS
    ]
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Case file of eppanalysis",
        "type": "object",
        "if": {"required": ["base"]},
        "then": {"anyOf": [{"$ref": f"#/{_DEFINITIONS}/{_PARTLY}{kind}"} for kind in KINDS]},
        "else": {"required": ["kind"], "properties": {"kind": {"enum": list(KINDS)}}, "allOf": by_kind},
        _DEFINITIONS: definitions,
    }


def _parts(*, partly: bool) -> dict[str, Any]:
    """Schemas of a linear block and of an element, each with the fields of its kind."""
    blocks = {}
    for kind, made in BLOCKS.items():
        given = {field.name for field in dataclasses.fields(made) if field.default is dataclasses.MISSING}
        fields = {name: _declared(about) for name, about in declared_fields(made).items()}
        blocks[kind] = _OfKind(fields, given & set(fields))
    elements: dict[str, _OfKind | None] = {}
    for kind, element in known_elements().items():
        # Modes, guards and resets of an element of one's own are for `eppanalysis check`.
        if kind == AUTOMATON:
            elements[kind] = None
            continue
        names = [*field_types(element), *[FILE] * bool(element.columns), *OF_ALL[1:]]
        given = {p.name for p in inspect.signature(element).parameters.values() if p.default is p.empty}
        # Columns may be in a file, and what is estimated be left out.
        by_sizes = [*element.estimate.sizes, element.estimate.field] if element.estimate else []
        elements[kind] = _OfKind(dict.fromkeys([*names, *by_sizes], True), given - {*element.columns, *by_sizes})
    return {
        "block": _one_of((KIND,), blocks, KINDS_OF_BLOCKS, partly=partly),
        "element": _one_of((KIND, ELEMENT), elements, KINDS_OF_ELEMENTS, partly=partly),
    }


class _OfKind(NamedTuple):
    """Schemas of the fields of a kind, and which of them it cannot be without."""

    fields: dict[str, Any]
    required: set[str]


def _declared(about: Declared) -> dict[str, Any]:
    said = about.about + f"; SI unit: {about.unit}" * bool(about.unit)
    return {"description": said, **({"enum": list(about.choices)} if about.choices else {})}


def _one_of(
    tags: Sequence[str],
    kinds: Mapping[str, _OfKind | None],
    words: Mapping[str, tuple[str, ...]],
    *,
    partly: bool,
) -> dict[str, Any]:
    """A table one of whose fields `tags` says which others there are; `partly` requires nothing."""
    choices = []
    for kind, found in kinds.items():
        # A word that several kinds may be meant by is for `eppanalysis check`.
        called = [word for word in other_kinds(kind, words) if len(words.get(word, ())) < 2]
        which = {"anyOf": [{"properties": {tag: {"enum": called}}, "required": [tag]} for tag in tags]}
        then: dict[str, Any] = {}
        if found is not None:
            others = other_words(kind)
            fields = {**found.fields, **{other: found.fields[ours] for other, ours in others.items()}}
            then = {"additionalProperties": False, "properties": {**dict.fromkeys(tags, True), **fields}}
            if found.required and not partly:
                names = {ours: [ours, *(o for o in others if others[o] == ours)] for ours in sorted(found.required)}
                then["allOf"] = [{"anyOf": [{"required": [name]} for name in also]} for also in names.values()]
        choices.append({"if": which, "then": then})
    named: dict[str, Any] = {"enum": [*kinds, *words]}
    whole = {"type": "object", "properties": dict.fromkeys(tags, named), "allOf": choices}
    return whole if partly else {**whole, "oneOf": [{"required": [tag]} for tag in tags]}


def _place(kind: str, part: str) -> str:
    return f"{kind}.{part}" if part else kind


def _moved(schema: Any, kind: str, *, partly: bool) -> Any:
    """A part of a schema whose references lead to the parts of its kind; `partly` requires nothing."""
    if isinstance(schema, list):
        return [_moved(inner, kind, partly=partly) for inner in schema]
    if not isinstance(schema, dict):
        return schema
    moved = {}
    for name, inner in schema.items():
        if name == "$ref":
            moved[name] = f"#/{_DEFINITIONS}/{_place(kind, inner.rpartition('/')[2])}"
        elif name == "discriminator":
            continue  # of another standard, with references of its own
        elif partly and name == "required" and isinstance(inner, list):
            continue
        else:
            # Where nothing is required, several of the choices may fit.
            key = "anyOf" if partly and name == "oneOf" else name
            moved[key] = _moved(inner, kind, partly=partly)
    return moved
