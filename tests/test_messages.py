"""Messages, pages and public docstrings in the words of a control engineer: docs/style.md."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator

import pytest

import eppanalysis as epp
from tests.messages import ROOT, Message, messages

#: Words that the style guide rules out, with what is written in their place.
RULED_OUT = {
    r"stands?|stood": "is, lies, belongs; rests",
    r"told": "known, decided, given",
    r"asked": "given, requested, sought",
    r"(comes?|came|coming) back": "returns",
    r"(is|are|was|were|be) said": "the number or the name itself",
    r"first[- ]order": "describing function",
}
#: Further ones of messages, where they do not mean the guards of an automaton or arithmetic.
OF_BASINS = {r"guard(s|ed|ing)?": "lies on the basin boundary", r"divid(e|es|ed|ing)": "lies on the basin boundary"}
#: Uses that mean the thing itself.
TERMS = {
    r"first-order (filter|lag|servo|reset)|first order and dead time": "a transfer function of order one",
    r"(the|a|its|no|of) guards?\b|: guards read": "a guard of an automaton, at which a mode ends",
    r"divides by 0": "arithmetic",
}
_TERM = re.compile("|".join(TERMS), re.IGNORECASE)
#: Pages of style and scripts for browsers.
NO_SENTENCES = re.compile(r"[{;] \w|</|=>")
LONGEST = 30
_SENTENCE = re.compile(r"(?<=[.;:!?])\s")
#: What is no prose of a page: code, within lines as well, formulas, and what is linked to.
NO_PROSE = re.compile(r"^```.*?^```|`[^`]*`|\$\$.*?\$\$|\$[^$]*\$", re.MULTILINE | re.DOTALL)


def _has(words: str, text: str) -> bool:
    return re.search(rf"\b({words})\b", _TERM.sub("", text), re.IGNORECASE) is not None


def _sentences(message: Message) -> list[str]:
    return [] if NO_SENTENCES.search(message.text) else _SENTENCE.split(message.text)


def _docstrings() -> Iterator[tuple[str, str]]:
    """Docstrings of the public names and of what the public classes have, without examples."""
    for name in (n for n in dir(epp) if not n.startswith("_")):
        thing = getattr(epp, name)
        members = vars(thing).items() if inspect.isclass(thing) else ()
        for called, one in [(name, thing), *((f"{name}.{m}", v) for m, v in members if not m.startswith("_"))]:
            text = inspect.getdoc(one) if called == name or callable(one) or isinstance(one, property) else None
            yield called, "\n".join(line for line in (text or "").splitlines() if not line.lstrip().startswith(">>>"))


@pytest.mark.parametrize("words", RULED_OUT | OF_BASINS)
def test_no_message_has_words_that_the_style_guide_rules_out(words):
    assert not [m for m in messages() if _has(words, m.text)], (RULED_OUT | OF_BASINS)[words]


def test_no_sentence_of_a_message_has_more_than_thirty_words():
    assert not [m for m in messages() for s in _sentences(m) if len(s.split()) > LONGEST]


def test_no_page_or_case_has_words_that_the_style_guide_rules_out():
    docs = ROOT / "docs"
    pages = [ROOT / "README.md", *docs.glob("*.md"), *docs.glob("[a-z]*/*.md"), *docs.glob("_static/*.md")]
    pages += (ROOT / "cases").glob("*.toml")
    prose = {page: NO_PROSE.sub("", page.read_text(encoding="utf-8")) for page in pages if page.name != "style.md"}
    assert not [(page.name, words) for page, text in prose.items() for words in RULED_OUT if _has(words, text)]


def test_no_public_docstring_has_words_that_the_style_guide_rules_out():
    assert not [(name, words) for name, text in _docstrings() for words in RULED_OUT if _has(words, text)]
