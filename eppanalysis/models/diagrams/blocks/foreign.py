"""Linear systems of python-control, scipy and sympy as blocks of a diagram."""

from __future__ import annotations

from typing import Any

from eppanalysis.models.diagrams.blocks.control import Block, StateSpaceBlock
from eppanalysis.models.diagrams.wiring import NAME
from eppanalysis.models.elements.base import Nonlinearity
from eppanalysis.models.elements.foreign import as_element, is_element
from eppanalysis.models.systems.linear import as_state_space, state_space_of


def as_part(given: Any) -> Block | Nonlinearity:
    """A block or an element as it is, or what another package has, as one of ours.

    Parameters
    ----------
    given : Block, Nonlinearity, or a system of python-control, scipy.signal or sympy
        Signals of a state space of python-control keep names that a port can have.

    Raises
    ------
    ModelError
        If it is none of them, or improper.

    Examples
    --------
    >>> import control
    >>> as_part(control.saturation_nonlinearity(2.0))
    Saturation(lower=-2.0, upper=2.0, slope=1.0)
    >>> motor = control.ss(-1.0, 1.0, 1.0, 0.0, inputs="voltage", outputs="speed")
    >>> as_part(motor).inputs, as_part(motor).outputs
    (('voltage',), ('speed',))
    """
    if isinstance(given, Block):
        return given
    if is_element(given):
        return as_element(given)
    found = state_space_of(given) if hasattr(given, "A") else as_state_space(given)
    matrices: dict[str, Any] = {name: getattr(found, name).tolist() for name in "ABCD"}
    return StateSpaceBlock(
        **matrices,
        input_names=_plain(given, "input_labels"),
        output_names=_plain(given, "output_labels"),
        sample_time=found.time_step,
    )


def _plain(given: Any, what: str) -> list[str] | None:
    """Names of signals, where ports can have all of them."""
    names = list(getattr(given, what, ()))
    return names if names and all(map(NAME.fullmatch, names)) else None
