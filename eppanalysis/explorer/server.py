"""The server of the page: this machine only, no files, one page for every tab."""

from __future__ import annotations

import signal
import socket
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bokeh.application import Application
from bokeh.application.handlers.function import FunctionHandler
from bokeh.server.server import Server
from jinja2 import Environment

from eppanalysis.case import Case
from eppanalysis.errors import EppError
from eppanalysis.explorer import quick
from eppanalysis.explorer.page import Page
from eppanalysis.explorer.slow import Workshop

if TYPE_CHECKING:
    from bokeh.document import Document

#: The loopback address: nothing outside this machine reaches it.
ADDRESS = "127.0.0.1"
_LARGEST_MESSAGE = 1_000_000
_TEMPLATE = Path(__file__).with_name("page.html")


def free_port(port: int) -> int:
    """The port if nothing uses it, or any free one for 0.

    Raises
    ------
    EppError
        If it is in use or not a port.
    """
    if not 0 <= port <= 65535:
        raise EppError(f"--port {port}: is no port; expected a number from 0 to 65535.")
    with socket.socket() as trial:
        trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            trial.bind((ADDRESS, port))
        except OSError as error:
            raise EppError(
                f"--port {port}: cannot be used ({error.strerror}); expected a free one; 0 takes any."
            ) from error
        return int(trial.getsockname()[1])


def serve(case: Case, port: int, ready: Callable[[str], None]) -> None:
    """Serve the page until interrupted.

    Parameters
    ----------
    case : Case
    port : int
        0 for any.
    ready : callable
        Called with the address of the page when it can be opened.

    Raises
    ------
    EppError
        If the port cannot be used, or the case cannot be run.
    """
    port = free_port(port)
    quick.compute(case, quick.shown_signal(case), {})  # compiles what every move needs, and refuses what cannot run
    workshop = Workshop()
    threads = ThreadPoolExecutor(2, thread_name_prefix="explorer")

    def make(doc: Document) -> None:
        page = Page(doc, case, threads, workshop)
        doc.on_session_destroyed(lambda context: page.close())
        doc.title = f"{case.name} - eppanalysis"
        doc.template = _template()
        doc.template_variables.update(
            heading=case.title,
            sliders=[widget.name for widget in page.widgets.values()],
            pictures=[picture.figure.name for picture in page.pictures],
        )

    server = Server(
        {"/": Application(FunctionHandler(make))},
        address=ADDRESS,
        port=port,
        websocket_max_message_size=_LARGEST_MESSAGE,
        allow_websocket_origin=[f"{ADDRESS}:{port}", f"localhost:{port}"],
    )
    signal.signal(signal.SIGTERM, lambda *_: server.io_loop.add_callback_from_signal(server.io_loop.stop))
    try:
        server.start()
        ready(f"http://{ADDRESS}:{port}/")
        server.io_loop.start()
    finally:
        server.stop()
        workshop.close()
        threads.shutdown(wait=False, cancel_futures=True)


def _template() -> Any:
    """The page's template; Bokeh's own one is what it extends."""
    return Environment(autoescape=False).from_string(_TEMPLATE.read_text(encoding="utf-8"))
