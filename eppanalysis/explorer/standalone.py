"""The page as one HTML file that works without a server: its pictures as they are, which can still be zoomed."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import Any

from bokeh.document import Document
from bokeh.embed import file_html
from bokeh.models.widgets import Div
from bokeh.resources import INLINE

from eppanalysis.explorer.figures import DRAGGED

#: Width of a picture [px]; a curve that is drawn wider looks flat.
_WIDEST = 860


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
    texts = [html.escape(text) for text in sentences if text]
    said = [f"<h1>{html.escape(heading)}</h1>", *(f"<p><strong>{text}</strong></p>" for text in texts[:1])]
    said += [f"<p>{text}</p>" for text in texts[1:]]
    copy.add_root(Div(text="".join(said), sizing_mode="stretch_width"))
    for picture in shown:
        picture.max_width = _WIDEST
        for item in (item for legend in picture.legend for item in legend.items):
            item.label = {"value": item.label.value.removesuffix(DRAGGED)}  # there is nobody to drag it for
        copy.add_root(picture)
    return file_html(copy, INLINE, title=heading)
