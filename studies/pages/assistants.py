"""What assistants read first, made from help and pages: ``python -m studies.pages.assistants``.

``docs/SKILL.md`` says when and how to use the program, ``docs/llms.txt`` which pages there are. Both are under version
control; a test compares them with the code.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

from eppanalysis.cli.mcp import instructions, tools
from studies import DOCS

SKILL, LLMS = DOCS / "SKILL.md", DOCS / "llms.txt"
#: Groups of the index that an assistant needs, and single pages beside them.
_GROUPS = ("Start", "Enter a loop", "Analyse", "Design", "Measure and share")
_REFERENCE = ("reference/cli", "reference/json")
_GROUP = re.compile(r":caption: (.*)\n\n((?:[\w/]+\n)+)")
#: How far the first clause of a help text and of a title goes.
_CLAUSE, _WORDS = re.compile(r"[^.:;(]*?(?=[.:;(]|, with|$)"), re.compile(r"[^:,?]*")


def skill() -> str:
    """The skill: its description, and a line for each command from the help."""
    lines = [f"- `{name}`: {_CLAUSE.match(tool.description)[0].strip()}" for name, tool in tools().items()]
    about, shared = instructions().split(". ", 1)
    return f"""\
---
name: eppanalysis
description: {about}. Use it when a loop hunts, chatters or may oscillate.
---

{shared}

```
eppanalysis COMMAND CASE... [--set FIELD=VALUE]... [--json] [-o FILE]
```

The first sentence of an answer is the verdict. As tools: `eppanalysis mcp FOLDER`. Begin with `new` and `check`.

{chr(10).join(lines)}
"""


def llms() -> str:
    """The pages by their titles, in the groups of the index."""
    index = (DOCS / "index.md").read_text(encoding="utf-8")
    groups = {name: pages.split() for name, pages in _GROUP.findall(index) if name in _GROUPS}
    sections = [_section(name, pages) for name, pages in {**groups, "Reference": _REFERENCE}.items()]
    about = instructions().split(". ", 1)[0]
    return "\n".join([f"# eppanalysis\n\n> {about}.\n", *sections])


def _section(name: str, pages: Iterable[str]) -> str:
    return f"## {name}\n\n" + "".join(f"- [{_title(page)}]({page}.html)\n" for page in pages)


def _title(page: str) -> str:
    """The title of a page, without what follows a colon."""
    title = re.search(r"^# (.*)$", (DOCS / f"{page}.md").read_text(encoding="utf-8"), re.MULTILINE)[1]
    return _WORDS.match(title)[0]


if __name__ == "__main__":
    SKILL.write_text(skill(), encoding="utf-8")
    LLMS.write_text(llms(), encoding="utf-8")
