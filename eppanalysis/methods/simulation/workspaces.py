"""The engine's workspaces, which a thread keeps from run to run."""

from __future__ import annotations

import threading
from typing import Any, NamedTuple

from eppanalysis.engine.tables import Model
from eppanalysis.engine.workspace import EventBuffer, make_event_buffer, make_workspaces
from eppanalysis.models.systems.hybrid import HybridSystem

#: Workspaces that a thread keeps.
_STRUCTURES = 4


class _Kept(NamedTuple):
    """Workspaces, and the model and step whose mode combinations they hold."""

    structure: tuple[Any, ...]
    model: Model
    base: float
    workspaces: tuple[Any, Any, Any]


class _Own(threading.local):
    """What a thread keeps from run to run, because to make it costs as much as a short run.

    All runs of one model find its mode combinations compiled, and models of one structure follow each other in the same
    workspaces; those of the last few structures are kept, as the period of a cycle is run once more without the inputs'
    breakpoints. What a run gives does not depend on the runs before it.
    """

    def __init__(self) -> None:
        self.kept: dict[tuple[Any, ...], _Kept] = {}
        self.last: _Kept | None = None  # of those kept, whose workspaces were given out last
        self.sizes, self.events = (0, 0, 0), make_event_buffer(0, 0, 0, 0)

    def workspaces(self, hybrid: HybridSystem, base: float) -> tuple[Any, Any, Any]:
        """Workspaces for a model, emptied where they hold mode combinations of another model or for another step."""
        model = hybrid.model
        if self.last is not None and self.last.model is model and self.last.base == base:
            return self.last.workspaces
        known = next((k for k in self.kept.values() if k.model is model), None)
        structure = _structure(model) if known is None else known.structure
        kept = self.kept.pop(structure, None)
        workspaces = make_workspaces(model) if kept is None else kept.workspaces
        if kept is not None and (kept.model is not model or kept.base != base):
            workspaces[0].count[0] = 0
        self.last = self.kept[structure] = _Kept(structure, model, base, workspaces)
        while len(self.kept) > _STRUCTURES:
            del self.kept[next(iter(self.kept))]
        return workspaces

    def buffer(self, hybrid: HybridSystem, keep: int) -> EventBuffer:
        """A buffer for so many events, the beginning of the longest one so far."""
        sizes = hybrid.x0.size, hybrid.H0.size, hybrid.modes0.size
        if sizes != self.sizes or len(self.events.t) < keep:
            self.sizes, self.events = sizes, make_event_buffer(keep, *sizes)
        return EventBuffer(*[a[:keep] for a in self.events])


def _structure(model: Model) -> tuple[Any, ...]:
    """What the sizes of its workspaces follow from."""
    of = model.mode_first, model.guard_first, model.smooth_kind
    return (*[a.shape for a in model], *[a.tobytes() for a in of])


of_thread = _Own()
