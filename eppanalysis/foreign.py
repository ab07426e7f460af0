"""Systems of python-control where a loop, a block or an element was expected: the line that makes one of them."""

from __future__ import annotations

from typing import Any


def line_for(given: Any) -> str:
    """What makes a loop or an element of a system of python-control or scipy; empty for anything else.

    Examples
    --------
    >>> import control
    >>> line_for(control.tf(1, [1, 1]))
    'a loop of it, such as LureSystem.from_tf(system, Saturation(-1, 1))'
    """
    module = type(given).__module__
    if not module.startswith(("control.", "scipy.signal.")):
        return ""
    if hasattr(given, "frdata"):
        response = "MeasuredMatrix" if given.ninputs * given.noutputs > 1 else "MeasuredResponse"
        return f"MeasuredLoop({response}.from_control(data), Saturation(-1, 1))"
    if hasattr(given, "lb") or hasattr(given, "b"):
        return "a loop with it, such as LureSystem.from_tf(plant, element)"
    if hasattr(given, "updfcn") and not hasattr(given, "A") and not hasattr(given, "syslist"):
        if given.nstates:
            return "linear systems and elements: a function with states is neither"
        return "the element that the function is, such as Saturation(-1, 1), or its points as PiecewiseLinear"
    inputs, outputs = (list(getattr(given, name, ())) for name in ("input_labels", "output_labels"))
    if len(inputs) > 1 or len(outputs) > 1 or hasattr(given, "syslist"):
        at = f"({outputs[0]!r}, {inputs[0]!r})" if inputs and outputs else "(output, input)"
        return f"a loop of it, such as from_control(system, {{{at}: Saturation(-1, 1)}})"
    return "a loop of it, such as LureSystem.from_tf(system, Saturation(-1, 1))"
