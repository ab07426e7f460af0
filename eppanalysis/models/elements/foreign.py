"""Elements of python-control as ours (the other way is `Nonlinearity.to_control`)."""

from __future__ import annotations

from typing import Any

from eppanalysis.errors import ModelError
from eppanalysis.models.elements.base import Nonlinearity
from eppanalysis.models.elements.hysteresis import HysteresisRelay
from eppanalysis.models.elements.memory import Play
from eppanalysis.models.elements.static import Saturation


def as_element(what: Any) -> Nonlinearity:
    """An element as it is, or one of python-control's as ours.

    Parameters
    ----------
    what : Nonlinearity or control.DescribingFunctionNonlinearity
        ``control.saturation_nonlinearity``, ``friction_backlash_nonlinearity`` or ``relay_hysteresis_nonlinearity``.

    Raises
    ------
    ModelError
        If it is neither.

    Examples
    --------
    >>> import control
    >>> as_element(control.friction_backlash_nonlinearity(2.0))
    Play(gap=2.0)
    """
    if isinstance(what, Nonlinearity):
        return what
    kind = type(what).__name__ if type(what).__module__.startswith("control.") else ""
    if kind == "saturation_nonlinearity":
        return Saturation(lower=float(what.lb), upper=float(what.ub))
    if kind == "friction_backlash_nonlinearity":
        return Play(gap=float(what.b))
    if kind == "relay_hysteresis_nonlinearity":
        return HysteresisRelay(lower=-float(what.c), upper=float(what.c), low=-float(what.b), high=float(what.b))
    raise ModelError(f"A {type(what).__name__} is not a known element", expected="an element of eppanalysis")


def is_element(what: Any) -> bool:
    """Whether :func:`as_element` may take something; python-control need not be loaded for the answer."""
    return isinstance(what, Nonlinearity) or any(
        base.__name__ == "DescribingFunctionNonlinearity" for base in type(what).__mro__
    )
