"""A ring of odd elements, or one element with a bias, in rational numbers, as certificates of its roots state it."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.methods.certificates import check_balance
from eppanalysis.methods.certificates.numbers import NotCovered
from eppanalysis.methods.certificates.rational import forced, rational_link, require_no_bias
from eppanalysis.models.systems.lure import LureSystem


def rational_ring(system: LureSystem, inputs: Array) -> tuple[dict[str, Any], float]:
    """A ring, or one element with a bias, as certificates state it, and how far its coefficients are off, relatively.

    Parameters
    ----------
    inputs : array, shape (nv,)
        Where the external inputs are held.

    Raises
    ------
    NotCovered
        If the elements are no ring, one of them is not covered, or several have a bias.
    """
    if system.time_step is not None:
        raise NotCovered("rings and biases in discrete time have no certificate of roots.")
    order = order_of(system)
    links, off = [], 0.0
    for k, here in enumerate(order):
        link, moved = rational_link(_between(system, here, order[(k + 1) % len(order)]))
        kind = link["element"]["kind"]
        if kind not in check_balance.ELEMENTS:
            raise NotCovered(f"a {kind.replace('_', ' ')} has no certificate in a ring or with a bias.")
        if len(order) > 1 and kind not in check_balance.ODD:
            raise NotCovered("an element of the ring is not odd, and rings with a bias have no certificate.")
        links.append(link)
        off = max(off, moved)
    means: list[Fraction] = []
    if len(order) > 1:
        require_no_bias(system, inputs)
    else:
        means = _means(system, links[0], inputs)
    return {"ring": links, "means": [str(x) for x in means]}, off


def _means(system: LureSystem, link: dict[str, Any], inputs: Array) -> list[Fraction]:
    """Balance of the means: the factors of the bias and of the mean output, and their sum."""
    polynomials = ([Fraction(c) for c in link[name]] for name in ("den", "num"))
    on_bias, on_mean = (c[-1] for c in polynomials)
    if not (on_bias or on_mean):
        raise NotCovered("the linear part hides a mode at zero, so the means have no unique balance.")
    return [on_bias, on_mean, forced(system, inputs)]


def order_of(system: LureSystem) -> list[int]:
    """The elements in the order of the ring, from one with memory on: next to where it lets go the balance is steep."""
    names = ", ".join(system.element_names) or "none"
    refusal = f"certificates of roots cover one element, or a ring of odd ones; here are: {names}."
    if not system.elements or any((e.n_inputs, e.n_outputs) != (1, 1) for e in system.elements):
        raise NotCovered(refusal)
    n = len(system.elements)
    follows = [[i for i in range(n) if system.D[i, j] or _states(system, j, i).any()] for j in range(n)]
    order = [next((i for i, e in enumerate(system.elements) if e.output(0.0)[1] is not None), 0)]
    while len(order) < n and len(follows[order[-1]]) == 1:
        order.append(follows[order[-1]][0])
    if sorted(order) != list(range(n)) or (n > 1 and follows[order[-1]] != order[:1]):
        raise NotCovered(refusal)
    return order


def _states(system: LureSystem, source: int, end: int) -> Array:
    """States through which the output of an element reaches the input of another, shape (n,) of bool."""
    linked = system.A != 0
    reached, seen = system.B[:, source] != 0, system.C[end] != 0
    for _ in range(len(system.A)):
        reached, seen = reached | (linked @ reached), seen | (linked.T @ seen)
    return reached & seen


def _between(system: LureSystem, here: int, after: int) -> LureSystem:
    """An element and the linear part from its output to the input of the one behind it."""
    if len(system.elements) == 1:
        return system
    kept = np.flatnonzero(_states(system, here, after))
    part = LureSystem.build(
        system.A[np.ix_(kept, kept)],
        system.B[kept][:, [here]],
        system.C[[after]][:, kept],
        [system.elements[here]],
        delays=system.delays[[here]],
        time_step=system.time_step,
    )
    # The element acts on the one behind it, not on itself.
    return replace(part, D=system.D[[after]][:, [here]])
