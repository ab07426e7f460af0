"""One JSON schema of all case files, for editors that complete and check them while they are written."""

from __future__ import annotations

from typing import Any

from eppanalysis.cases.model import KINDS, json_schema

_DEFINITIONS = "$defs"
#: What a file that inherits may leave out is for the file that it inherits from to say.
_PARTLY = "partly_"


def case_schema() -> dict[str, Any]:
    """JSON schema (draft 2020-12) of a case file of any kind; of one that inherits every part may be left out.

    It knows fields, types and choices. Units, ranges and what parts mean together are checked by ``eppanalysis check``.

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
