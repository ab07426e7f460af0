"""Loops with sampled controllers for margins: from sample to sample, where that is exact.

Cut at a port of a controller, a loop whose controllers are all executed together is one in discrete time, exactly:
between two samples everything else is linear and what is held stands still. Cut elsewhere it is no loop that the same
sine comes back in; there the controllers are taken in the mean over where their samples fall (see `averaged`).
"""

from __future__ import annotations

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from eppanalysis.models.systems.cuts import Cuts
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.sampled.averaged import Places

Array = NDArray[np.float64]


def from_sample_to_sample(system: LureSystem, gains: Array) -> LureSystem | None:
    """The loop in discrete time, cut at what its controllers read and put out; None where that is not exact.

    Parameters
    ----------
    system : LureSystem
    gains : array, shape (nw, nz)
        ``w = gains @ z`` for all elements but the controllers.
    """
    p = Places.of(system)
    times = {(c.sample_time, c.delay, c.offset) for c in p.controllers}
    # Controllers that are executed at other times have no common sample from which to which the loop could be taken.
    if len(times) > 1 or np.any(system.delays > 0) or any(c.state_last for c in p.controllers):
        return None
    step, late, _ = times.pop()
    x_x, x_h, r_x, r_h = _between_samples(system, gains, p)
    n, k = x_h.shape
    # What is held has no rate of its own, so that one exponential carries it and the plant.
    generator = np.vstack([np.hstack([x_x, x_h]), np.zeros((k, n + k))])
    before, behind = scipy.linalg.expm(generator * late), scipy.linalg.expm(generator * (step - late))
    A_d, B_d, C_d, D_d = (
        scipy.linalg.block_diag(*(np.asarray(getattr(c, name)) for c in p.controllers)) for name in "ABCD"
    )
    # States: plant, controllers, what is held until the new outputs are ready; then disturbances of u and of y.
    m, n_d = len(r_x), len(A_d)
    read = np.hstack([r_x, np.zeros((m, n_d)), r_h, np.eye(m), np.zeros((m, k))])
    own = np.hstack([np.zeros((n_d, n)), np.eye(n_d), np.zeros((n_d, k + m + k))])
    computed = C_d @ own + D_d @ read
    put_out = computed + np.hstack([np.zeros((k, n + n_d + k + m)), np.eye(k)])
    at_delay = np.hstack([before[:n, :n], np.zeros((n, n_d)), before[:n, n:], np.zeros((n, m + k))])
    following = np.vstack([behind[:n, :n] @ at_delay + behind[:n, n:] @ put_out, A_d @ own + B_d @ read, put_out])
    used = np.arange(n + n_d + (k if late or np.any(r_h) else 0))
    back = np.vstack([read, computed])
    back[:m, n + n_d + k : n + n_d + k + m] -= np.eye(m)
    ports = _ports(system, p)
    chosen = np.flatnonzero([bool(name) for name in ports])
    into = n + n_d + k + chosen
    cuts = Cuts(
        tuple(ports[i] for i in chosen),
        B=following[np.ix_(used, into)],
        E=np.zeros((0, len(chosen))),
        C=back[np.ix_(chosen, used)],
        D=np.zeros((len(chosen), 0)),
        F=np.array([back[i, j] for i, j in zip(chosen, into, strict=True)]),
    )
    return LureSystem.build(
        following[np.ix_(used, used)], np.zeros((len(used), 0)), np.zeros((0, len(used))), [],
        time_step=step, cuts=cuts, name=system.name,
    )  # fmt: skip


def _between_samples(system: LureSystem, gains: Array, p: Places) -> tuple[Array, Array, Array, Array]:
    """Rate of the plant and what the controllers read, on the plant's state and on what is held."""
    K = gains[np.ix_(p.w, p.z)]
    C, D, B = system.C, system.D, system.B
    S = np.linalg.inv(np.eye(p.z.size) - D[np.ix_(p.z, p.w)] @ K)
    w_x, w_h = K @ S @ C[np.ix_(p.z, p.plant)], K @ S @ D[np.ix_(p.z, p.held)]
    B_w, D_w = B[np.ix_(p.plant, p.w)], D[np.ix_(p.read, p.w)]
    return (
        system.A[np.ix_(p.plant, p.plant)] + B_w @ w_x,
        B[np.ix_(p.plant, p.held)] + B_w @ w_h,
        C[np.ix_(p.read, p.plant)] + D_w @ w_x,
        D[np.ix_(p.read, p.held)] + D_w @ w_h,
    )


def _ports(system: LureSystem, p: Places) -> list[str]:
    """Names of the places that are just what a controller reads (first) or puts out; empty for those without."""
    places = system.places
    found = [""] * (p.read.size + p.held.size)
    for i, name in enumerate(places.names):
        for k, row in enumerate(p.read):
            if not np.any(places.B[:, i]) and np.array_equal(places.E[:, i], np.eye(len(system.C))[row]):
                found[k] = found[k] or name
        for k, column in enumerate(p.held, start=p.read.size):
            unit = np.eye(system.B.shape[1])[column]
            if not np.any(places.C[i]) and np.array_equal(places.D[i], unit):
                found[k] = found[k] or name
    return found
