"""One sweep on many machines without a scheduler: each computes its share in a store of its own, one joins them.

The blocks of a sweep are dealt out in turn, so that shares are alike wherever cells are slow. The first of eight shares
of `map.zarr` is `map.1-of-8.zarr` beside it. A share that is interrupted goes on where it was, as any store does, and
joining takes over what is finished, as often as it is called: what array jobs need, and machines that can be taken
away.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

from eppanalysis.errors import ArgumentError, EppError
from eppanalysis.sweep.store import Bounds, ZarrStore, all_bounds


class Shard(NamedTuple):
    """Share number `number` of `of_all`, from 1 on."""

    number: int
    of_all: int

    @classmethod
    def parse(cls, text: str | tuple[int, int]) -> Shard:
        """A share as it is written, "3/8".

        Raises
        ------
        EppError
            If it is none.
        """
        parts = re.fullmatch(r"(\d+)/(\d+)", text) if isinstance(text, str) else None
        given = tuple(map(int, parts.groups())) if parts else text
        if isinstance(given, tuple) and len(given) == 2 and all(type(k) is int for k in given):
            number, of_all = given
            if 1 <= number <= of_all:
                return cls(number, of_all)
        raise ArgumentError("shard", f" is {text!r}; expected one of so many, as in '3/8'.", "sweep")

    def path(self, store: Path) -> Path:
        """The share's store, beside that of the whole sweep."""
        return store.with_name(f"{store.stem}.{self.number}-of-{self.of_all}{store.suffix}")

    def blocks(self, kept: ZarrStore) -> list[Bounds]:
        """Its blocks, finished or not."""
        return list(all_bounds(kept.design.shape, kept.blocks))[self.number - 1 :: self.of_all]


def shares_of(store: Path) -> list[Path]:
    """The shares of a sweep that lie beside its store."""
    named = re.compile(re.escape(store.stem) + r"\.\d+-of-\d+" + re.escape(store.suffix))
    return sorted(path for path in store.absolute().parent.iterdir() if named.fullmatch(path.name))


def join(kept: ZarrStore) -> None:
    """Take over what is finished in the shares beside a store.

    Raises
    ------
    EppError
        If there are none, or one is of another sweep.
    """
    shares = shares_of(kept.path)
    if not shares:
        raise EppError(
            f"{kept.path}: has no shares beside it; expected some, as in {Shard(1, 8).path(kept.path).name}."
        )
    for share in shares:
        kept.take_over(share)
