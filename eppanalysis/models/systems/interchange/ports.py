"""Names of what goes into the elements of a loop and comes out of them, and its linear part with these names.

A loop here is a LureSystem, which is in a layer above this module.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from eppanalysis.models.elements.base import Nonlinearity
from eppanalysis.models.systems.signals import SignalMap

if TYPE_CHECKING:
    import control


def linear_part(loop: Any) -> control.StateSpace:
    """See :meth:`LureSystem.to_control`."""
    import control

    behind, driven = _behind(loop)
    before, feeding = _before(loop, driven)
    s = loop.signals
    shown = [i for i in range(len(s.names)) if i not in driven]
    unnamed = [k for k, i in enumerate(feeding) if i is None]
    C = np.vstack([s.C[shown], loop.C[unnamed]])
    D = np.vstack([np.hstack([s.D, s.D_input])[shown], np.hstack([loop.D, loop.D_input])[unnamed]])
    names = {
        "inputs": [*behind, *loop.input_names],
        "outputs": [*(s.names[i] for i in shown), *(before[k] for k in unnamed)],
        "states": loop.state_names,
    }
    names = {what: _without_points(given) for what, given in names.items()}
    step = [loop.time_step] if loop.time_step else []
    return control.ss(loop.A, np.hstack([loop.B, loop.B_input]), C, D, *step, name=loop.name, **names)


def connections(loop: Any) -> dict[tuple[str, ...], Nonlinearity]:
    """See :attr:`LureSystem.connections`."""
    behind, driven = _behind(loop)
    before = _before(loop, driven)[0]
    before, behind = _without_points(before), _without_points(behind)
    places = zip(loop.elements, loop.input_slices, loop.output_slices, strict=True)
    return {(*before[zs], *behind[ws]): element for element, zs, ws in places}


def _behind(loop: Any) -> tuple[list[str], list[int | None]]:
    """Names of what the elements give, and the signals that these are."""
    s, nw = loop.signals, loop.B.shape[1]
    outputs = SignalMap((), np.zeros((nw, len(loop.A))), np.eye(nw), np.zeros((nw, s.D_input.shape[1])), np.zeros(nw))
    driven = _found(s, outputs, [i for i, name in enumerate(s.names) if name not in loop.input_names])
    return _called(s, driven, _numbered(loop.element_names, loop.output_slices, "output"), loop.input_names), driven


def _before(loop: Any, driven: Sequence[int | None]) -> tuple[list[str], list[int | None]]:
    """Names of what the elements take, and the signals that these are."""
    s = loop.signals
    inputs = SignalMap((), loop.C, loop.D, loop.D_input, loop.constant_input)
    feeding = _found(s, inputs, [i for i in range(len(s.names)) if i not in driven])
    return _called(s, feeding, _numbered(loop.element_names, loop.input_slices, "input"), s.names), feeding


def _found(signals: SignalMap, rows: SignalMap, among: Sequence[int]) -> list[int | None]:
    """The signal that each row is; None where it is none, or one that another row is already."""
    found: list[int | None] = []
    for k in range(len(rows.C)):
        found.append(next((i for i in among if i not in found and _alike(signals, i, rows, k)), None))
    return found


def _alike(signals: SignalMap, i: int, rows: SignalMap, k: int) -> bool:
    parts = ("C", "D", "D_input", "constant")
    return all(np.array_equal(getattr(signals, part)[i], getattr(rows, part)[k]) for part in parts)


def _called(signals: SignalMap, found: Sequence[int | None], new: Sequence[str], taken: Sequence[str]) -> list[str]:
    """Names of the signals found, and new ones, which nothing else has, in the places of the others."""
    used = {signals.names[i] for i in found if i is not None}.union(taken)
    names = []
    for i, name in zip(found, new, strict=True):
        while i is None and name in used:
            name += "_"
        names.append(name if i is None else signals.names[i])
        used.add(names[-1])
    return names


def _numbered(labels: Sequence[str], places: Sequence[slice], what: str) -> list[str]:
    """A name for each input or output of the elements."""
    counts = [place.stop - place.start for place in places]
    return [
        f"{label}_{what}{k + 1 if n > 1 else ''}" for label, n in zip(labels, counts, strict=True) for k in range(n)
    ]


def _without_points(names: Sequence[str]) -> list[str]:
    return [name.replace(".", "_") for name in names]
