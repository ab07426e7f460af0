"""Second-order sliding: what fast switches between two modes hold a motion to, and whether they die out.

Where a jump of an element's output acts on the second derivative of its input, as that of a relay before a motor does,
switches may come ever faster. In the limit the input s and its rate are zero, and the output has the mean that holds
them there. The swings about that shrink where the jump's effect on the third derivative opposes that on the second
(Anosov, Automation and Remote Control 20 (1959) 135; Johansson, Rantzer and Astrom, Automatica 35 (1999) 539;
docs/theory/exact_orbits.md, How a run ends).
"""

from __future__ import annotations

import numpy as np

from eppanalysis.arrays import Array, IntArray
from eppanalysis.methods.simulation.modes import ModeLaw, guards_of, law_of
from eppanalysis.models.systems.hybrid import HybridSystem

#: What is left of rates, gains and guards that vanish, relative to their terms: states in which nothing that is not
#: read is mixed are known to a tenth of it.
VANISHED = 1e-10
#: Turns are alike that differ by this share of what they gain or lose.
ALIKE = 0.01


def sliding_law(start: HybridSystem, modes: IntArray, guards: IntArray, y: Array) -> ModeLaw | None:
    """The law of motion that ever smaller swings between two modes come to; None where they do not shrink.

    Parameters
    ----------
    modes : array, shape (2, elements)
        Between which the loop switches.
    guards : array, shape (2,)
        Which of its guards ends each.
    y : array, shape (events, N)
        States, memory values and a 1 at the last switches.

    Returns
    -------
    ModeLaw or None
        Its guards are passed where no mean of the two outputs holds the input and its rate at zero.
    """
    one, other = (law_of(start, mode) for mode in modes)
    if one is None or other is None:
        return None
    g, opposite = (
        law.g[np.flatnonzero(guards_of(start, mode) == k)[0]]
        for law, mode, k in zip((one, other), modes, guards, strict=True)
    )
    n = len(one.F)
    jump = one.F - other.F
    b = jump @ y[-1]
    row_terms = np.abs(g[:n]) @ one.terms
    row = np.where(np.abs(g[:n] @ one.F) <= VANISHED * row_terms, 0.0, g[:n] @ one.F)  # the rate of the guard
    if not b.any() or not _is_opposite(g, opposite) or abs(g[:n] @ b) > VANISHED * (np.abs(g[:n]) @ np.abs(b)):
        return None
    A, noise = other.F[:, :n], VANISHED * (row_terms[:n] @ (other.terms[:, :n] @ np.abs(b)))
    gain, next_gain = row[:n] @ b, row[:n] @ (A @ b)
    if abs(gain) <= VANISHED * (row_terms[:n] @ np.abs(b)) or next_gain * np.sign(gain) >= -noise:
        return None
    d = (b @ jump) / (b @ b)
    second = row[:n] @ other.F  # the second derivative of the guard in the other mode
    there = y @ second
    here = there + gain * (y @ d)
    if np.any(here * there >= 0.0) or np.ptp(there) > ALIKE * min(np.abs(here).min(), np.abs(there).min()):
        return None
    share = -second / gain  # of the jump that holds the rate of the guard at zero
    put = np.eye(g.size)
    aside, rows = np.column_stack([A @ b / gain, -next_gain / gain**2 * b, b / gain]), np.vstack([g, g, row])
    put[:n] -= aside @ rows
    put[:n][np.abs(put[:n]) <= VANISHED * (np.abs(aside) @ np.abs(rows))] = 0.0
    F, terms = other.F + np.outer(b, share), other.terms + np.outer(np.abs(b), np.abs(share))
    # Beside the levels nothing moves: s and its rate are no chain of integrators, which rounding would set in motion.
    return ModeLaw(np.where(np.abs(F) <= VANISHED * terms, 0.0, F) @ put, terms, np.vstack([-share, share - d]), put)


def _is_opposite(g: Array, other: Array) -> bool:
    """Whether two guards are one function, passed in opposite directions."""
    return bool(np.all(np.abs(g + other) <= VANISHED * np.abs(g)))
