"""What people see of a case where it is printed, and where it is the last line of a notebook's cell."""

from __future__ import annotations

import html

from eppanalysis.cases.values.quantities import Parameter
from eppanalysis.readable import count, in_print
from eppanalysis.shown import html_row


class ShownCase:
    """A case as a line and as a table; its file, answers and system are no reading."""

    name: str
    title: str
    parameters: dict[str, Parameter]

    def __str__(self) -> str:
        """Its name and what it is about."""
        return f"{self.name}: {self.title}"

    def __repr__(self) -> str:
        """The same, and how many parameters it has."""
        return f"<Case {self}; {count(len(self.parameters), 'parameter')}>"

    def _repr_html_(self) -> str:
        """What it is about, and every parameter with where it comes from."""
        rows = "".join(html_row((name, in_print(p.with_tolerance), p.mark)) for name, p in self.parameters.items())
        return (
            f'<div class="eppanalysis"><p><strong>{html.escape(str(self))}</strong></p>'
            f"<table><tbody>{rows}</tbody></table></div>"
        )
