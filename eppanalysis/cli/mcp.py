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
from functools import cached_property
from pathlib import Path
from subprocess import DEVNULL
from tempfile import TemporaryFile
from types import NoneType
from typing import TYPE_CHECKING, Annotated, Any, get_args, get_type_hints

import typer

from eppanalysis.errors import CaseError, EppError, did_you_mean, require_packages

if TYPE_CHECKING:
    from anyio.abc import Process
    from pydantic import BaseModel

#: What is no tool: servers, and models of other programs, whose readers open what these name wherever it is.
_NO_TOOLS = ("explore", "mcp", "import")
#: What leads to other machines, and what the server decides.
_NOT_OFFERED = ("scheduler", "shard", "merge", "as_json")
#: Whole numbers that say nothing of the work.
_NO_WORK = ("seed", "workers", "chunk")
#: How long a command that has to end may put away its files [s].
_GRACE = 1.0


def mcp(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Where all files lie.", show_default=False)],
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
    """A command of the program as a tool."""

    name: str
    command: Any  # as typer makes it

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
        return {name: get_args(hint)[0] if NoneType in get_args(hint) else hint for name, hint in hints.items()}

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
            default = ... if defaults[p.name].default is inspect.Parameter.empty else defaults[p.name].default
            about = (p.help or "").replace("\\[", "[")  # as typer wants a bracket that is none of its markup
            fields[p.name] = (self._hints[p.name], Field(default, alias=_word(p), description=about))
        return create_model(self.name, __config__=ConfigDict(extra="forbid", coerce_numbers_to_str=True), **fields)

    def checked(self, arguments: Mapping[str, Any]) -> dict[str, Any]:
        """The arguments that are given, as plain values by their names in Python.

        Raises
        ------
        EppError
            If one is missing, is not known, or has another type.
        """
        from pydantic import ValidationError

        if "\\u0000" in json.dumps(arguments):
            raise EppError(f"{self.name}: an argument holds a zero byte; expected text.")
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
            if p.metavar == "CASE" or Path in (self._hints[p.name], *get_args(self._hints[p.name])):
                yield from _listed(given.get(p.name))

    def command_line(self, given: Mapping[str, Any]) -> list[str]:
        """The words of the command, with which it prints JSON where it can."""
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
        return [*options, "--", *words]

    @property
    def less(self) -> str:
        """What makes a call shorter: the numbers of the command."""
        counts = [_word(p) for p in self._parameters if self._hints[p.name] is int and p.name not in _NO_WORK]
        return f"smaller {', '.join(counts)}" if counts else "fewer cases, or shorter runs"


def tools() -> dict[str, Tool]:
    """The commands that an assistant is offered, by their names."""
    from typer.main import get_command

    from eppanalysis.cli.commands import app

    every: Mapping[str, Any] = get_command(app).commands  # type: ignore[attr-defined]  # of a group
    return {name: Tool(name, command) for name, command in every.items() if name not in _NO_TOOLS}


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
    """Files of a folder that a path means (``run_{case}.png`` for many), and those that are called after it.

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
        raise EppError(f"{text}: leads out of the folder {folder}; expected a path below it, not a link out of it.")
    return found


def _when_written(folder: Path, texts: Sequence[str]) -> dict[Path, int]:
    """When the files of paths were last changed, of a folder anything in it."""
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
    """Whether a call failed, and its texts: the verdict, the data, the files written."""
    given = tool.checked(arguments)
    line, paths = tool.command_line(given), list(tool.paths(given))
    before = _when_written(folder, paths)
    code, printed, said = await _run(line, folder, budget)
    if code is None:
        ended = f"{tool.name}: was ended after {budget:g} s, the budget of a call"
        raise EppError(f"{ended}; expected {tool.less}, or a larger --budget.")
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
    said = [case["verdict"] if len(cases) == 1 else f"{case['name']}: {case['verdict']}" for case in cases]
    data = json.dumps(document, separators=(",", ":"), ensure_ascii=False)
    return ["\n".join(said), data] if cases else []  # where none is left, each of them was refused


def _sentences(name: str, code: int, said: str) -> str:
    """What a command that failed says; of one that broke down the last line alone."""
    lines = said.strip().splitlines() or [f"ended with code {code}"]
    if "Traceback (most recent call last):" in said or code not in (1, 2):
        return f"{name}: broke down ({lines[-1].strip()}); expected an answer. Please report it."
    return "\n".join(lines)


async def _run(line: Sequence[str], folder: Path, budget: float) -> tuple[int | None, str, str]:
    """Exit code, output and messages of a command; no code where its time was over."""
    import anyio

    # No module is taken from the folder, whatever is called like one there.
    environment = {**os.environ, "PYTHONSAFEPATH": "1", "PYTHONIOENCODING": "utf-8"}
    command = [sys.executable, "-m", "eppanalysis", *line]
    with TemporaryFile() as output, TemporaryFile() as messages:
        files: dict[str, Any] = {"stdin": DEVNULL, "stdout": output, "stderr": messages}
        process = await anyio.open_process(command, cwd=folder, env=environment, start_new_session=True, **files)
        try:
            with anyio.move_on_after(budget):
                await process.wait()
        finally:
            code = process.returncode
            if code is None:
                await _end(process)
        for file in (output, messages):
            file.seek(0)
        return code, output.read().decode(errors="replace"), messages.read().decode(errors="replace")


async def _end(process: Process) -> None:
    """End a process with all that it has started, at first so that it can put away its files."""
    import anyio

    with anyio.CancelScope(shield=True):
        for number in (signal.SIGTERM, getattr(signal, "SIGKILL", signal.SIGTERM)):
            with suppress(ProcessLookupError), anyio.move_on_after(_GRACE):
                os.killpg(process.pid, number) if hasattr(os, "killpg") else process.send_signal(number)
                await process.wait()
