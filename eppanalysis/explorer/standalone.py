"""The page as one HTML file that works without a server: its pictures as they are, which can still be zoomed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from bokeh.document import Document
from bokeh.embed import file_html
from bokeh.events import DocumentReady
from bokeh.models import CustomJS
from bokeh.resources import INLINE

from eppanalysis.explorer.figures import DRAGGED
from eppanalysis.explorer.looks import COLOURS, LOOKS

#: Width of a picture [px]; a curve that is drawn wider looks flat.
_WIDEST = 860
_TEMPLATE = """
{% block preamble %}<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">{% endblock %}
{% block postamble %}<style>{{ colours }} main { padding: 0.6rem 0.8rem; }</style>{% endblock %}
{% block contents %}<main><h1>{{ title | e }}</h1>
{% for text in sentences %}<p{% if loop.first %} class="verdict"{% endif %}>{{ text | e }}</p>
{% endfor %}{{ super() }}</main>{% endblock %}
"""


def standalone(doc: Document, heading: str, sentences: Sequence[str], pictures: Sequence[str]) -> str:
    """The page of now as one file.

    Parameters
    ----------
    doc : bokeh.document.Document
        Of the page; it is copied and stays as it is.
    sentences : sequence of str
        What the page says above its pictures, the verdict first.
    pictures : sequence of str
        Names of the pictures.

    Returns
    -------
    str
        HTML that holds all that it needs.
    """
    # Models belong to one document, and the page goes on with its own.
    copy = Document.from_json(doc.to_json())
    shown: list[Any] = [model for name in pictures if (model := copy.get_model_by_name(name)) is not None]
    copy.clear()
    for picture in shown:
        picture.max_width = _WIDEST
        picture.title.text = _kept(picture.title.text)
        for item in (item for legend in picture.legend for item in legend.items):
            item.label = {"value": item.label.value.removesuffix(DRAGGED)}  # there is nobody to drag it for
        copy.add_root(picture)
    copy.js_on_event(DocumentReady, CustomJS(code=LOOKS))
    variables = {"colours": COLOURS, "sentences": [_kept(text) for text in sentences if text]}
    return file_html(copy, INLINE, title=heading, template=_TEMPLATE, template_variables=variables)


def _kept(text: str) -> str:
    """What is still being computed will not be in a file."""
    what, _, state = text.partition(": ")
    return f"{what}: not yet known when this page was saved" if state.endswith("...") else text
