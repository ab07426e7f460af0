"""The server of the page: this machine only, no files, one page for every tab, and nobody without its address.

Other programs and other users of the machine reach its loopback address too, and so does a page of any site in the
reader's own browser, under a name that its owner has led there. So the address has a token that is new at every start,
and a request that lacks it, or comes under another name, is refused before anything looks at it.
"""

from __future__ import annotations

import hmac
import logging
import secrets
import socket
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bokeh.application import Application
from bokeh.application.handlers.function import FunctionHandler
from bokeh.server.server import BaseServer
from bokeh.server.tornado import BokehTornado
from jinja2 import Environment
from tornado.httpserver import HTTPServer
from tornado.ioloop import IOLoop
from tornado.web import ErrorHandler

from eppanalysis.cases import Case
from eppanalysis.errors import EppError, visible
from eppanalysis.explorer import quick
from eppanalysis.explorer.looks import COLOURS
from eppanalysis.explorer.page import Page
from eppanalysis.explorer.slow import Workshop

if TYPE_CHECKING:
    from bokeh.document import Document
    from tornado.httputil import HTTPServerRequest

#: The loopback address: nothing outside this machine reaches it.
ADDRESS = "127.0.0.1"
_LARGEST_MESSAGE = 1_000_000
#: Random bytes of the token, and how long a line about a failed request may be.
_TOKEN_BYTES, _LONGEST_LINE = 24, 300
#: What the pictures are, for those who cannot see them.
_TITLES = {
    "step": "Picture: the run in time",
    "nyquist": "Picture: Nyquist curve of the loop",
    "branch": "Picture: limit cycles over a parameter",
    "map": "Picture: map of designs",
}
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
            colours=COLOURS,
            sliders=[widget.name for widget in page.widgets.values()],
            pictures=[picture.figure.name for picture in page.pictures],
            titles=_TITLES,
        )

    token = secrets.token_urlsafe(_TOKEN_BYTES)
    _log_in_lines()
    app = _Guarded(Application(FunctionHandler(make)), token, port)
    http = HTTPServer(app)
    http.listen(port, ADDRESS)
    server = BaseServer(IOLoop.current(), app, http)
    try:
        server.start()
        ready(f"http://{ADDRESS}:{port}/{token}/")
        server.io_loop.start()
    finally:
        server.stop()
        workshop.close()
        threads.shutdown(wait=False, cancel_futures=True)


class _Guarded(BokehTornado):
    """Bokeh's server behind a token and under its own names.

    Parameters
    ----------
    application : bokeh.application.Application
    token : str
        First part of every path.
    port : int
    """

    def __init__(self, application: Application, token: str, port: int) -> None:
        self._token, self._hosts = token, (f"{ADDRESS}:{port}", f"localhost:{port}")
        super().__init__(
            {"/": application},
            prefix=token,
            extra_websocket_origins=list(self._hosts),
            websocket_max_message_size_bytes=_LARGEST_MESSAGE,
            log_function=lambda handler: None,
        )

    def find_handler(self, request: HTTPServerRequest, **more: Any) -> Any:
        """What answers a request: a refusal unless it has the token and one of the names."""
        given = request.path.split("/")[1] if request.path.startswith("/") else ""
        # In a time that does not tell how much of the token is right.
        known = hmac.compare_digest(given.encode("utf-8", "replace"), self._token.encode())
        here = request.host.lower() in self._hosts
        if here and request.path == "/favicon.ico":  # browsers request it: there is none, which does no harm
            return self.get_handler_delegate(request, ErrorHandler, {"status_code": 404})
        if not known or not here:
            return self.get_handler_delegate(request, ErrorHandler, {"status_code": 403})
        return super().find_handler(request, **more)


class _Lines(logging.Handler):
    """What Bokeh and Tornado have to say, a line each: a request that makes no sense is no reason for a traceback."""

    def emit(self, record: logging.LogRecord) -> None:
        """Write the first line of a message and of its exception."""
        parts = [record.getMessage(), str(record.exc_info[1]) if record.exc_info else ""]
        line = ": ".join(part.splitlines()[0] for part in parts if part.strip())
        sys.stderr.write(f"explorer: {visible(line)[:_LONGEST_LINE]}\n")


def _log_in_lines() -> None:
    for name in ("bokeh", "tornado", "asyncio"):
        logger = logging.getLogger(name)
        logger.handlers, logger.propagate = [_Lines()], False
        logger.setLevel(logging.ERROR)


def _template() -> Any:
    """The page's template; Bokeh's own one is what it extends."""
    return Environment(autoescape=False).from_string(_TEMPLATE.read_text(encoding="utf-8"))
