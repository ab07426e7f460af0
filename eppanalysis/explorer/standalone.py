"""The page as one HTML file that works without a server: its pictures as they are, which can still be zoomed."""

from __future__ import annotations

import html
from collections.abc import Sequence

from bokeh.document import Document
from bokeh.embed import file_html
from bokeh.models.widgets import Div
from bokeh.resources import INLINE


def standalone(doc: Document, heading: str, sentences: Sequence[str], pictures: Sequence[str]) -> str:
    """The page of now as one file.

    Parameters
    ----------
    doc : bokeh.document.Document
        Of the page; it is copied and stays as it is.
    heading : str
    sentences : sequence of str
        What the page says above its pictures.
    pictures : sequence of str
        Names of the pictures.

    Returns
    -------
    str
        HTML that holds all that it needs.
    """
    # Models belong to one document, and the page goes on with its own.
    copy = Document.from_json(doc.to_json())
    shown = [model for name in pictures if (model := copy.get_model_by_name(name)) is not None]
    copy.clear()
    said = [f"<h1>{html.escape(heading)}</h1>", *(f"<p>{html.escape(text)}</p>" for text in sentences if text)]
    copy.add_root(Div(text="".join(said), sizing_mode="stretch_width"))
    for picture in shown:
        copy.add_root(picture)
    return file_html(copy, INLINE, title=heading)
