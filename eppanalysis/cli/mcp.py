"""The command ``eppanalysis mcp``: the other commands as tools of an assistant, by the Model Context Protocol.

A tool is a command: what it takes follows from the function of the command. A call runs the command in the folder, in a
process that is ended with its budget of time. Paths lead below the folder, or nowhere.
"""

from __future__ import annotations

import glob
import inspect
import json
import os
import re
import signal
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from types import NoneType
from typing import TYPE_CHECKING, Annotated, Any, get_args, get_type_hints

import typer

from eppanalysis.errors import CaseError, EppError, did_you_mean, require_packages

if TYPE_CHECKING:
    from anyio.abc import ByteReceiveStream, Process
    from pydantic import BaseModel

#: Commands that serve someone themselves.
_SERVERS = ("explore", "mcp")
#: What leads to other machines, and what the server decides.
_NOT_OFFERED = ("scheduler", "shard", "merge", "as_json")
#: How long a command that has to end may put away its files [s].
_GRACE = 1.0


def mcp(
    folder: Annotated[
        Path,
        typer.Argument(metavar="FOLDER", help="Where all files lie that are read and written.", show_default=False),
    ],
    budget: Annotated[float, typer.Option("--budget", metavar="SECONDS", help="Longest time of a call.")] = 60.0,
) -> None:
    """Offer the commands to an assistant as tools (Model Context Protocol), on standard input and output."""
    require_packages("mcp", "mcp", "mcp")
    if not folder.is_dir():
        raise EppError(f"{folder}: is no folder; expected an existing one.")
    if not budget > 0.0:
        raise EppError(f"--budget {budget:g}: is no time; expected a positive number of seconds.")
    import anyio

    anyio.run(_serve, folder.resolve(), budget)


@dataclass(frozen=True)
class Tool:
    """A command of the program as a tool.

    Attributes
    ----------
    name : str
    command : Any
        As typer makes it.
    """

    name: str
    command: Any

    @property
    def description(self) -> str:
        """What the command says of itself."""
        return inspect.cleandoc(self.command.help or "")

    @property
    def schema(self) -> dict[str, Any]:
        """JSON schema of the arguments."""
        return self._model.model_json_schema()

    @cached_property
    def _hints(self) -> dict[str, Any]:
        """Types of the arguments by their names in Python; that there may be none, the default says."""
        hints = get_type_hints(self.command.callback)
        return {
            name: next((t for t in get_args(hint) if NoneType in get_args(hint)), hint) for name, hint in hints.items()
        }

    @cached_property
    def _parameters(self) -> list[Any]:
        return [p for p in self.command.params if p.name in self._hints and p.name not in _NOT_OFFERED]

    @cached_property
    def _model(self) -> type[BaseModel]:
        """The arguments as a model, which has the schema and refuses what does not fit it."""
        from pydantic import ConfigDict, Field, create_model

        defaults = inspect.signature(self.command.callback).parameters
        fields: dict[str, Any] = {}
        for p in self._parameters:
            default = defaults[p.name].default
            about = (p.help or "").replace("\\[", "[")  # as typer wants a bracket that is none of its markup
            fields[p.name] = (
                self._hints[p.name],
                Field(... if default is inspect.Parameter.empty else default, alias=_word(p), description=about),
            )
        return create_model(self.name, __config__=ConfigDict(extra="forbid", coerce_numbers_to_str=True), **fields)

    def checked(self, arguments: Mapping[str, Any]) -> dict[str, Any]:
        """The arguments that are given, as plain values by their names in Python.

        Raises
        ------
        EppError
            If one is missing, is not known, or has another type.
        """
        from pydantic import ValidationError

        try:
            given = self._model.model_validate({k: v for k, v in arguments.items() if v is not None})
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            name, said = ".".join(map(str, first["loc"])), first["msg"].removeprefix("Input should be ")
            if first["type"] == "missing":
                raise EppError(f"{self.name}: {name} is missing; expected a value.") from None
            if first["type"] == "extra_forbidden":
                said = did_you_mean(name, map(_word, self._parameters))
            raise CaseError(self.name, name, first["input"], said) from None
        return given.model_dump(mode="json", exclude_unset=True)

    def paths(self, given: Mapping[str, Any]) -> Iterator[str]:
        """What leads to files: arguments of that type, and cases, each of which is the name of one or a file."""
        for p in self._parameters:
            if p.name in given and (
                Path in (self._hints[p.name], *get_args(self._hints[p.name])) or p.metavar == "CASE"
            ):
                yield from _listed(given[p.name])

    def command_line(self, given: Mapping[str, Any]) -> list[str]:
        """The words of the command; of a command that prints JSON those with which it does.

        Raises
        ------
        EppError
            If a text holds what no word can hold.
        """
        options, words = [self.name], list[str]()
        # A certificate that is checked has a verdict and no data.
        if any(p.name == "as_json" for p in self.command.params) and "check" not in given:
            options.append("--json")
        for p in self._parameters:
            value = given.get(p.name)
            if p.param_type_name == "argument":
                words += map(str, _listed(value))
            elif isinstance(value, bool):
                options += p.opts[:1] if value else p.secondary_opts[:1]
            else:
                options += [f"{p.opts[-1]}={one}" for one in _listed(value)]
        if "\0" in "".join([*options, *words]):
            raise EppError(f"{self.name}: an argument holds a zero byte; expected text.")
        return [*options, "--", *words]

    def too_long(self, budget: float) -> str:
        """What a call that was ended says, with the numbers that make it shorter."""
        counts = [
            _word(p) for p in self._parameters if self._hints[p.name] is int and p.name not in ("seed", "workers")
        ]
        less = f"smaller {', '.join(counts)}" if counts else "fewer cases, or shorter runs"
        return (
            f"{self.name}: was ended after {budget:g} s, the budget of a call; expected {less}, or a larger --budget."
        )


def tools() -> dict[str, Tool]:
    """The commands that an assistant is offered, by their names."""
    from typer.main import get_command

    from eppanalysis.cli.commands import app

    every: Mapping[str, Any] = get_command(app).commands  # type: ignore[attr-defined]  # of a group
    return {name: Tool(name, command) for name, command in every.items() if name not in _SERVERS}


def instructions() -> str:
    """What the program is for, and what all tools share, in the words of the help."""
    from eppanalysis.cli.commands import app

    return f"{app.info.help} A case is a TOML file, or the name of a shipped one (tool cases). Data are in SI units."


def _word(parameter: Any) -> str:
    """What a tool calls an argument: the option, or the argument's own name."""
    return parameter.opts[-1].lstrip("-").replace("-", "_")


def _listed(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [] if value is None else [value]


def places(folder: Path, text: str) -> list[Path]:
    """Files of a folder that a path stands for, and those beside it that are called after it.

    Parameters
    ----------
    folder : Path
        Without links in it.
    text : str
        A name in braces, as in ``run_{case}.png``, stands for anything.

    Raises
    ------
    EppError
        If one of them, or what lies below it, is outside the folder, by a link too.
    """
    path = folder / text
    name = re.sub(r"\{\w+\}", "*", glob.escape(path.name))
    try:
        found = [path] if path.is_dir() else [path, *path.parent.glob(name), *path.parent.glob(f"{name}.*")]
        # A file that a case names lies in the folder of the case.
        reached = path.rglob("*") if path.is_dir() else [path.parent]
        outside = not all(place.resolve().is_relative_to(folder) for place in (*found, *reached))
    except (OSError, RuntimeError, ValueError):  # a link to itself, a name that no file can have
        outside = True
    if outside:
        raise EppError(
            f"{text}: leads out of the folder {folder}; expected a path below it, without links that lead out."
        )
    return found


def _when_written(folder: Path, texts: Sequence[str]) -> dict[Path, int]:
    """When what paths stand for was last changed, of a folder anything in it."""
    there = [path for text in texts for path in places(folder, text) if path.exists()]
    return {path: max(place.lstat().st_mtime_ns for place in (path, *path.rglob("*"))) for path in there}


async def _serve(folder: Path, budget: float) -> None:
    """Answer on standard input and output until the input ends."""
    import anyio
    from mcp import types
    from mcp.server.lowlevel import Server
    from mcp.server.stdio import stdio_server

    from eppanalysis import __version__
    from eppanalysis.workers import cores

    known, processes = tools(), anyio.CapacityLimiter(cores())

    async def listing(context: Any, request: Any) -> types.ListToolsResult:
        made = [types.Tool(name=t.name, description=t.description, input_schema=t.schema) for t in known.values()]
        return types.ListToolsResult(tools=made)

    async def call(context: Any, request: types.CallToolRequestParams) -> types.CallToolResult:
        try:
            if request.name not in known:
                raise EppError(f"{request.name}: is no tool; expected {did_you_mean(request.name, known)}.")
            async with processes:
                failed, texts = await _answer(known[request.name], request.arguments or {}, folder, budget)
        except EppError as error:
            failed, texts = True, [str(error)]
        content = [types.TextContent(type="text", text=text) for text in texts if text]
        return types.CallToolResult(content=list(content), is_error=failed)

    server = Server(
        "eppanalysis",
        version=__version__,
        instructions=f"{instructions()} Files lie below {folder}. A call takes {budget:g} s at most.",
        on_list_tools=listing,
        on_call_tool=call,
    )
    async with stdio_server() as (requests, answers):
        await server.run(requests, answers, server.create_initialization_options())


async def _answer(tool: Tool, arguments: Mapping[str, Any], folder: Path, budget: float) -> tuple[bool, list[str]]:
    """Whether a call failed, and its texts: the verdict, the data, the files written.

    Raises
    ------
    EppError
        If an argument is refused, or the time is over.
    """
    given = tool.checked(arguments)
    line, paths = tool.command_line(given), list(tool.paths(given))
    before = _when_written(folder, paths)
    ended = await _run(line, folder, budget)
    if ended is None:
        raise EppError(tool.too_long(budget))
    code, printed, said = ended
    texts = _verdict_first(printed) if code == 0 else [_sentences(tool.name, code, said), *_verdict_first(printed)]
    after = _when_written(folder, paths)
    written = sorted(str(path.relative_to(folder)) for path in after if after[path] != before.get(path))
    return code != 0, [*texts, "\n".join(f"written: {path}" for path in written)]


def _verdict_first(printed: str) -> list[str]:
    """The sentences of a document, and the document; another text begins with its sentence."""
    try:
        document = json.loads(printed)
        cases = document["cases"]
    except (ValueError, KeyError):
        return [printed.strip()]
    if not cases:  # each of them is refused, as the messages say
        return []
    said = [case["verdict"] if len(cases) == 1 else f"{case['name']}: {case['verdict']}" for case in cases]
    return ["\n".join(said), json.dumps(document, separators=(",", ":"), ensure_ascii=False)]


def _sentences(name: str, code: int, said: str) -> str:
    """What a command that failed says; of one that broke down the last line alone."""
    lines = said.strip().splitlines() or [f"ended with code {code}"]
    if "Traceback (most recent call last):" in said or code not in (1, 2):
        return f"{name}: broke down ({lines[-1].strip()}); expected an answer. Please report it."
    return "\n".join(lines)


async def _run(line: Sequence[str], folder: Path, budget: float) -> tuple[int, str, str] | None:
    """Exit code, output and messages of a command; None where its time was over."""
    import subprocess

    import anyio

    # No module is taken from the folder, whatever is called like one there.
    environment = {**os.environ, "PYTHONSAFEPATH": "1", "PYTHONIOENCODING": "utf-8"}
    process = await anyio.open_process(
        [sys.executable, "-m", "eppanalysis", *line],
        stdin=subprocess.DEVNULL,
        cwd=folder,
        env=environment,
        start_new_session=True,
    )
    output, messages = bytearray(), bytearray()
    try:
        with anyio.move_on_after(budget) as time:
            async with anyio.create_task_group() as readers:
                readers.start_soon(_read, process.stdout, output)
                readers.start_soon(_read, process.stderr, messages)
            await process.wait()
    finally:
        with anyio.CancelScope(shield=True):
            if process.returncode is None:
                await _end(process)
            await process.aclose()
    if time.cancelled_caught:
        return None
    return process.returncode or 0, output.decode(errors="replace"), messages.decode(errors="replace")


async def _read(stream: ByteReceiveStream | None, into: bytearray) -> None:
    if stream is not None:
        async for part in stream:
            into += part


async def _end(process: Process) -> None:
    """End a process with all that it has started, at first so that it can put away its files."""
    import anyio

    for number, patience in ((signal.SIGTERM, _GRACE), (getattr(signal, "SIGKILL", signal.SIGTERM), None)):
        with suppress(ProcessLookupError):
            send = partial(os.killpg, process.pid) if hasattr(os, "killpg") else process.send_signal
            send(number)
        with anyio.move_on_after(patience or 10.0 * _GRACE):
            await process.wait()
