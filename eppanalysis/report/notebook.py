"""From cases to a notebook, and its execution in a kernel of its own."""

from __future__ import annotations

import ast
import asyncio
import contextlib
import html
import os
import re
import sys
import tempfile
import threading
from collections.abc import Coroutine, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from typing import TYPE_CHECKING, Any

from eppanalysis.cases import Case, case as shipped, shipped_cases
from eppanalysis.cases.files import PLAIN_NAME
from eppanalysis.errors import EppError
from eppanalysis.models.systems.inputs import Recorded
from eppanalysis.progress import Progress
from eppanalysis.report.sections import LADDER, OVERVIEW, SECTIONS, SETUP

if TYPE_CHECKING:
    from nbformat import NotebookNode

#: A section that takes longer than this hangs [s]: that of an elbow under gravity takes most of a minute of a
#: processor, and a busy machine may have a tenth of one to give.
LONGEST_CELL = 3600
#: A kernel that has not answered after this will not [s].
_LONGEST_START = 120
_LONGEST_SOCKET_FOLDER = 55


def make_notebook(cases: Sequence[Case], *, full: bool = False) -> NotebookNode:
    """The notebook of some cases, not yet executed."""
    from nbformat import v4

    title = cases[0].title if len(cases) == 1 else f"{len(cases)} cases"
    given = _markdown(v4, f"# {plain(title)}")
    if len(cases) == 1:
        cells = [given, _code(v4, f"{SETUP}\n\ncase = {_reading(cases[0])}\n{LADDER}")]
    else:
        listed = "\n".join(["cases = [", *(f"    {_reading(case)}," for case in cases), "]"])
        cells = [given, _code(v4, f"{SETUP}\n\n{listed}"), _markdown(v4, "## Overview"), _code(v4, OVERVIEW)]
    for number, case in enumerate(cases):
        if len(cases) > 1:
            cells.append(_markdown(v4, f"# {plain(case.title)}\n\nCase {plain(case.name)}."))
            cells.append(_code(v4, f"case, ladder = cases[{number}], ladders[{number}]"))
        for section in SECTIONS:
            code = section.cell(case, full=full)
            if code:
                cells += [_markdown(v4, f"## {section.title}\n\n{section.text}"), _code(v4, code, section.title)]
    for number, cell in enumerate(cells):
        cell["id"] = f"cell-{number}"  # the same notebook from the same cases
    kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
    return v4.new_notebook(cells=cells, metadata={"kernelspec": kernel, "title": title})


def execute(notebook: NotebookNode, what: str, progress: Progress | None = None) -> NotebookNode:
    """The notebook with its outputs.

    Raises
    ------
    EppError
        If a cell fails, takes too long, or the kernel dies; in one sentence that names the section.
    """
    from nbclient import NotebookClient
    from nbclient.exceptions import CellControlSignal, DeadKernelError

    headings = _headings(notebook)

    def begin(cell: Any, cell_index: int) -> None:
        if progress is not None:
            progress(cell_index, len(notebook.cells), headings[cell_index])

    with _kernel_manager() as (manager, folder):
        client = NotebookClient(notebook, km=manager, timeout=LONGEST_CELL, on_cell_start=begin)
        try:
            return _in_thread(_execute_in(client, manager, folder))
        except (CellControlSignal, DeadKernelError, TimeoutError, RuntimeError) as error:
            raise EppError(_sentence(error, notebook, headings, what)) from error


async def _execute_in(client: Any, manager: Any, folder: str) -> NotebookNode:
    """Execute in a kernel that lives as long as this, however it ends."""
    try:
        await manager.start_kernel(cwd=folder)
        client.kc = manager.client()
        client.kc.start_channels()
        await client.kc.wait_for_ready(timeout=_LONGEST_START)
        client.kc.allow_stdin = False
        return await client.async_execute(cleanup_kc=False)
    finally:
        if client.kc is not None:
            client.kc.stop_channels()
        if manager.has_kernel:
            await manager.shutdown_kernel(now=True)


def _in_thread(work: Coroutine[Any, Any, NotebookNode]) -> NotebookNode:
    """Work away from the main thread, so that an interrupt from the keyboard cancels it and stays one."""
    begun: Future[tuple[asyncio.AbstractEventLoop, asyncio.Task[Any]]] = Future()

    async def task() -> NotebookNode:
        begun.set_result((asyncio.get_running_loop(), asyncio.ensure_future(work)))
        return await begun.result()[1]

    with ThreadPoolExecutor(1) as pool:
        running = pool.submit(asyncio.run, task())
        try:
            return running.result()
        except KeyboardInterrupt:
            loop, begun_work = begun.result()
            # The thread of a channel that is only just being made finds its sockets closed, and says so.
            said, threading.excepthook = threading.excepthook, lambda _: None
            try:
                with contextlib.suppress(RuntimeError):  # it has ended just now
                    loop.call_soon_threadsafe(begun_work.cancel)
                wait([running])
            finally:
                threading.excepthook = said
            raise


def _sentence(error: Exception, notebook: NotebookNode, headings: Sequence[str], what: str) -> str:
    """What failed, from the first error that a cell holds."""
    for cell, heading in zip(notebook.cells, headings, strict=True):
        for output in cell.get("outputs", ()):
            if output.get("output_type") == "error":
                reason = f"{output.get('ename')}: {output.get('evalue')}".split("\n")[0][:300]
                return f"{what}: not written, because section {heading!r} failed ({reason}); expected it to run."
    reason = str(error).strip().split("\n")[0][:300] or type(error).__name__
    return f"{what}: not written, because a section did not end ({reason}); expected each within {LONGEST_CELL} s."


def _headings(notebook: NotebookNode) -> list[str]:
    """For each cell the heading above it; where there are several cases, in front of it which."""
    found, case, section = [], "", ""
    for cell in notebook.cells:
        if cell.cell_type == "markdown" and cell.source.startswith("#"):
            mark, _, text = cell.source.split("\n")[0].partition(" ")
            case, section = (html.unescape(text), "") if mark == "#" else (case, html.unescape(text))
        found.append((case, section))
    several = len({case for case, _ in found}) > 1
    return [f"{case}: {section}" if several and section else section or case for case, section in found]


@contextlib.contextmanager
def _kernel_manager() -> Iterator[tuple[Any, str]]:
    """A kernel of this very interpreter, with folders of its own: no start-up files of the user, no history."""
    from jupyter_client.kernelspec import KernelSpec, KernelSpecManager
    from jupyter_client.manager import AsyncKernelManager

    class OwnSpec(KernelSpecManager):
        def get_kernel_spec(self, kernel_name: str) -> KernelSpec:
            argv = [
                sys.executable,
                "-m",
                "ipykernel_launcher",
                "-f",
                "{connection_file}",
                "--HistoryManager.enabled=False",
            ]
            return KernelSpec(argv=argv, display_name="Python 3", language="python")

    with tempfile.TemporaryDirectory(prefix="eppanalysis-report-", ignore_cleanup_errors=True) as folder:
        own = {"IPYTHONDIR": folder, "JUPYTER_RUNTIME_DIR": folder, "JUPYTER_PLATFORM_DIRS": "1"}
        with _environment({**own, "PYDEVD_DISABLE_FILE_VALIDATION": "1"}):
            # Sockets in the folder are open to this user only; their paths must be short.
            local = os.name == "posix" and len(folder) < _LONGEST_SOCKET_FOLDER
            place = {"transport": "ipc", "ip": os.path.join(folder, "kernel")} if local else {}
            yield AsyncKernelManager(kernel_name="python3", kernel_spec_manager=OwnSpec(), **place), folder


@contextlib.contextmanager
def _environment(values: dict[str, str]) -> Iterator[None]:
    """Variables of the environment, for the kernel that inherits them, and back."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def plain(text: str) -> str:
    """A text of a case as Markdown that shows it and nothing else: no markup, no HTML, no formulas, one line."""
    escaped = html.escape(" ".join(text.split()), quote=False)
    return re.sub(r"([\\`*_{}\[\]()#+!|~$:@^-])", lambda m: f"&#{ord(m.group())};", escaped)


def _reading(case: Case) -> str:
    """The call that gives the case: its name where it ships as it is, else the whole text of its file."""
    if case.name in shipped_cases() and shipped(case.name).to_toml() == case.to_toml():
        return f'epp.case("{case.name}")'
    name = re.sub(r"[^A-Za-z0-9_.-]", "_", case.name)[:100]
    if not PLAIN_NAME.fullmatch(name):
        name = "case"
    folder = f", folder={str(case.folder.resolve())!r}" if isinstance(case.input, Recorded) else ""
    return f'epp.case_from_text({literal(case.to_toml())}, name="{name}"{folder})'


def literal(text: str) -> str:
    """A text as a readable Python literal over several lines."""
    lines = text.replace("\\", "\\\\").replace('"""', '\\"\\"\\"')
    found = f'"""\\\n{lines}"""'
    try:
        same = ast.literal_eval(found) == text
    except (SyntaxError, ValueError):
        same = False
    return found if same else repr(text)


def _markdown(v4: Any, text: str) -> Any:
    return v4.new_markdown_cell(text)


def _code(v4: Any, text: str, shows: str = "") -> Any:
    """A code cell that knows what its pictures show, for readers who cannot see them."""
    return v4.new_code_cell(text, metadata={"alt": shows} if shows else {})
