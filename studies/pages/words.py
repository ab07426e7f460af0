"""Other words for parts and their fields, as the pages on blocks and elements list them."""

from __future__ import annotations

from collections.abc import Container, Mapping

from eppanalysis.cases.words import other_kinds, other_words


def other_words_line(kind: str, words: Mapping[str, tuple[str, ...]], besides: Container[str] = ()) -> str:
    """One line with the other words for a kind and its fields, but for fields `besides`; empty where there are none."""
    said = [", ".join(f"`{word}`" for word in other_kinds(kind, words)[1:])]
    by_field: dict[str, list[str]] = {}
    for other, ours in other_words(kind).items():
        if ours not in besides:
            by_field.setdefault(ours, []).append(f"`{other}`")
    said += [f"`{ours}`: {', '.join(others)}" for ours, others in by_field.items()]
    found = "; ".join(filter(None, said))
    return f"Also {found}.\n\n" if found else ""
