"""Next steps: commands that run as they are printed, of a case that a file holds or that ships; else in Python."""

from __future__ import annotations

import os
import re
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from eppanalysis.cases.files import GROUPS, Missing
from eppanalysis.cases.model import Case
from eppanalysis.cases.values.toml import toml_value
from eppanalysis.cases.variation import takes
from eppanalysis.errors import EppError
from eppanalysis.methods.bounds.numbers import why_no_bounds
from eppanalysis.methods.bounds.searched import why_by_search
from eppanalysis.readable import DIGITS, quantity

#: What no shell reads as anything but itself, and what it does not within double quotes.
_PLAIN, _QUOTED = re.compile(r"[\w@%+=:,./°-]+", re.ASCII), re.compile(r"[^\"$`\\!\n]*")
#: Fields that nothing is computed from.
_SAID = ("mark", "note", "title", "expected")
#: Most digits that a number may have.
_MOST = 17
#: A run that came to no end is to be so many times as long.
_LONGER = 10


def called(case: Case, *, carried: bool = False) -> tuple[str, ...]:
    """The words by which the command line finds a case: a file, or the name of one that ships, and what was set in it.

    Parameters
    ----------
    carried : bool
        Whether the words go into a file that is read elsewhere: they then name no folder of this machine, but a file
        by its way from the working folder.

    Returns
    -------
    tuple of str
        Empty where neither leads to the case: it was made in Python, its file has changed, or lies outside the working
        folder where the words are carried.

    Examples
    --------
    >>> from eppanalysis.cases import case
    >>> called(case("fig8a_original").with_values({"lock_pin.backlash": "0.5 deg"}))
    ('fig8a_original', '--set', 'lock_pin.backlash=0.5 deg')
    """
    for name, base in _bases(case):
        if carried and os.path.isabs(name):
            name = _from_here(name)
        if not name:
            continue
        settings = tuple(_settings(base, case))
        try:
            made = base.with_values({field: value for field, value in settings}, "--set") if settings else base
        except EppError:
            continue
        if _computed(made._raw.data) == _computed(case._raw.data):
            return (name, *(word for field, value in settings for word in ("--set", f"{field}={_typed(value)}")))
    return ()


def _from_here(path: str) -> str:
    """The way to a file from the working folder; empty where it lies outside."""
    try:
        way = os.path.relpath(os.path.realpath(path))
    except ValueError:  # on another drive
        return ""
    if way.split(os.sep)[0] == os.pardir:
        return ""
    return os.path.join(os.curdir, way) if way.startswith("-") or way in GROUPS else way  # else an option, or several


def _computed(held: Any) -> Any:
    """What a case holds, without what nothing is computed from: marks, notes, titles and expectations."""
    if isinstance(held, Mapping):
        left = {name: _computed(value) for name, value in held.items() if name not in _SAID}
        return left["value"] if set(left) == {"value"} else left
    return [_computed(value) for value in held] if isinstance(held, list) else held


def _bases(case: Case) -> Iterator[tuple[str, Case]]:
    """Cases that the command line has and that this one may have been made of, by their names on it."""
    from eppanalysis.cases import case as shipped, read_case, shipped_cases

    if case.name in shipped_cases():
        yield case.name, shipped(case.name)
    if os.path.isfile(case.source):
        try:
            yield case.source, read_case(case.source)
        except EppError:
            return


def _settings(base: Case, case: Case) -> Iterator[tuple[str, Any]]:
    """Parts that another case lacks, and fields that are not as they are there, with what is in them."""
    added = [
        f"{section}.{name}"
        for section in ("blocks", "elements")
        for name in case._raw.data.get(section, ())
        if name not in base._raw.data.get(section, ())
    ]
    of_added = {name.partition(".")[2] for name in added}
    given = [name for name in case.parameters if name.partition(".")[0] not in of_added]
    for name in dict.fromkeys([*added, *given, *case.fields_of_run()]):
        held, there = case.held(name), base.held(name)
        if held != there and not isinstance(held, Missing):
            yield name, held


def _typed(value: Any) -> str:
    """A value as ``--set`` takes it."""
    return toml_value(value) if isinstance(value, bool | dict) else str(value)


@dataclass(frozen=True)
class Commands:
    """Next steps with a case.

    Attributes
    ----------
    case : Case
    words : tuple of str
        By which the command line finds the case; empty where only Python has it.
    """

    case: Case
    words: tuple[str, ...]

    @classmethod
    def of(cls, case: Case, *, carried: bool = False) -> Commands:
        """By what the command line calls the case; see :func:`called`."""
        return cls(case, called(case, carried=carried))

    @cached_property
    def over(self) -> list[str]:
        """The parameters of the case that a picture may run over, the most telling first."""
        from eppanalysis.cases import variation_of

        return variation_of(self.case).over()

    def bounds(self, limit: str, over: str = "", *options: str) -> str:
        """How far a parameter may go at the case's own value of another; empty where there is none, or no bound.

        Examples
        --------
        >>> from eppanalysis.cases import case
        >>> Commands.of(case("wheelchair")).bounds("loop.gain", "play.gap")
        'eppanalysis bounds wheelchair --over play.gap --from "12 mm" --points 1 --limit loop.gain'
        """
        over = over or self.beside(limit)
        if not over:
            return ""
        system = self.case.to_system()
        if not why_by_search(system) and why_no_bounds(system):
            return ""
        at = self.typed(over)
        if not self.words:
            return f"epp.design_bounds(case, {over!r}, {limit!r}, at=[{at!r}])"
        return self.command("bounds", "--over", over, "--from", at, "--points", "1", "--limit", limit, *options)

    def largest(self, name: str) -> str:
        """The largest value of a parameter without a limit cycle, up to twice its own."""
        own = self.case.value(name)
        low, high = (self.typed(name, share * own) for share in (0.05, 2.0))
        if not self.words:
            return f"epp.design(case, {{{name!r}: ({low!r}, {high!r})}}, maximise={name!r})"
        return self.command("design", "--maximise", name, "--tune", f"{name} {low}..{high}")

    def typed(self, name: str, value: float | None = None) -> str:
        """A value of a parameter as one types it, its own by default: with as few digits as bring it back."""
        value = self.case.value(name) if value is None else value
        texts = (self.case.text(name, value, digits) for digits in range(DIGITS, _MOST + 1))
        return next((text for text in texts if self.case.si(name, text) == value), self.case.text(name, value, _MOST))

    def longer(self, reached: float) -> str:
        """A run ten times as long as one that came to no end by a time [s]."""
        t_end = quantity(_LONGER * reached, "s")
        if not self.words:
            return f'epp.simulate(case.with_values({{"run.t_end": {t_end!r}}}))'
        words = list(self.words)
        for i in [i for i, word in enumerate(words) if word.startswith("run.t_end=")]:
            del words[i - 1 : i + 1]  # of the run that was too short, with its --set
        return command("simulate", *words, "--set", f"run.t_end={t_end}")

    def cycles(self) -> str:
        """The search for all limit cycles."""
        return self.command("cycles") if self.words else "epp.find_limit_cycles(case)"

    def remedies(self) -> str:
        """Why it oscillates, and what ends it."""
        return self.command("cycles", "--remedies") if self.words else "epp.remedies(case)"

    def sweep(self, axes: Mapping[str, str]) -> str:
        """A map over axes, as sweeps take them."""
        if not self.words:
            return f"epp.sweep(case, {dict(axes)!r})"
        asked = [word for name, values in axes.items() for word in ("--axis", f"{name}={values}")]
        return self.command("sweep", *asked, "-o", "map.png")

    def command(self, verb: str, *options: str) -> str:
        """A command of the case, as a shell takes it; empty where the command line has no name for the case."""
        return command(verb, *self.words, *options) if self.words else ""

    def beside(self, limit: str) -> str:
        """A parameter that may stay where it is while another is bounded, the most telling first; empty for none."""
        from eppanalysis.cases import variation_of

        names = dict.fromkeys([*variation_of(self.case).beside(limit), *self.case.parameters])
        return next((n for n in names if n != limit and self._stays(n, limit)), "")

    def _stays(self, name: str, limit: str) -> bool:
        """Whether a parameter is a number that a file may hold, and none that another one takes the place of."""
        value = self.case.value(name)
        if isinstance(value, bool) or not takes(self.case, name, value):
            return False
        moved = self.case.with_values({name: value}).with_values({limit: 1.01 * self.case.value(limit)})
        return name in moved.parameters and moved.value(name) == value


def command(verb: str, *words: str) -> str:
    """A command as a shell takes it.

    Examples
    --------
    >>> command("simulate", "my servo.toml", "--set", "run.t_end=5 s")
    'eppanalysis simulate "my servo.toml" --set "run.t_end=5 s"'
    """
    return " ".join(["eppanalysis", verb, *map(_word, words)])


def _word(word: str) -> str:
    if _PLAIN.fullmatch(word):
        return word
    if not word.isprintable():  # spelled out, as shells read it, so that no terminal obeys it
        return "$'" + "".join(map(_spelled, word)) + "'"
    return f'"{word}"' if _QUOTED.fullmatch(word) else shlex.quote(word)


def _spelled(sign: str) -> str:
    """A sign within ``$'...'``."""
    if sign.isprintable():
        return f"\\{sign}" if sign in "\\'" else sign
    return "".join(f"\\{byte:03o}" for byte in os.fsencode(sign))


def commands_in(texts: Sequence[str]) -> list[str]:
    """The commands in texts: each is at the end of a line."""
    found = re.finditer(r"\beppanalysis (?=[a-z]+ )[^\n]*$", "\n".join(texts), re.MULTILINE)
    return [match.group() for match in found]
