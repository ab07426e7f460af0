"""A loop with sampled controllers as one of continuous time: each controller in the mean over where its samples fall.

What a controller makes of a sine is, in the mean over where the samples fall on it, its response at that frequency
times hold and delay. The loop that is closed by such responses is linear and known exactly at every frequency; for
means, poles and coordinates it has a rational form besides (bilinear transform of the controller, Padé approximation
of hold and delay as one dead time), exact towards low frequencies. A controller that reads straight what another one
holds finds it at the ages that their clocks give (see `ages`). What the samples fold back from beyond half their rate
is left out of both.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from eppanalysis.arguments import floats
from eppanalysis.arrays import Array, BoolArray, ComplexArray
from eppanalysis.errors import ModelError
from eppanalysis.models.elements.dynamic.sampled import ControllerMemory, SampledController
from eppanalysis.models.systems.cuts import Cuts
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.sampled.places import Places, at
from eppanalysis.models.systems.sampled.rational import Forms, Reads
from eppanalysis.models.systems.sampled.strobe import is_sampled

#: Two samples a turn, up to rounding, as an angle from sample to sample; share of an input that may change.
_HALF_RATE, _LITTLE = np.pi * (1.0 + 1e-9), 0.01


@dataclass(frozen=True, eq=False)
class AveragedSystem(LureSystem):
    """The loop in its rational form, with responses that are exact in the mean over the phases of the samples.

    Attributes
    ----------
    sampled : LureSystem
        The loop that it replaces.
    """

    sampled: LureSystem | None = None

    @property
    def origin(self) -> LureSystem:
        """The loop that it replaces."""
        return self if self.sampled is None else self.sampled

    @property
    def slowest(self) -> float:
        """Longest time between two samples of a controller [s]."""
        return max(c.sample_time for c in self.layout.controllers)

    @cached_property
    def layout(self) -> Places:
        """Places of its parts in the loop that it replaces."""
        return Places.of(self.origin)

    def frequency_response(self, omega: ArrayLike) -> ComplexArray:
        """Response from the elements' outputs to their inputs, controllers with hold and delay closed around them."""
        p, w = self.layout, self._positive(omega)
        G = self.origin.frequency_response(w) + p.aged(w)[0]
        S = p.closing(G, p.responses(w)[0])[0]
        return np.asarray(at(G, p.z, p.w) + at(G, p.z, p.held) @ S @ at(G, p.read, p.w), complex)

    def signal_response(self, omega: ArrayLike) -> ComplexArray:
        """Response from the elements' outputs to the named signals."""
        p, w = self.layout, self._positive(omega)
        G, Y = self.origin.frequency_response(w) + p.aged(w)[0], self.origin.signal_response(w)
        S = p.closing(G, p.responses(w)[0])[0]
        return np.asarray(Y[..., p.w] + Y[..., p.held] @ S @ at(G, p.read, p.w), complex)

    def frequency_response_and_slope(self, omega: ArrayLike) -> tuple[ComplexArray, ComplexArray]:
        """:meth:`frequency_response` and its derivative by `omega`."""
        p, w = self.layout, self._positive(omega)
        G, dG = map(np.add, self.origin.frequency_response_and_slope(w), p.aged(w))
        K, dK = p.responses(w)
        S, before, behind = p.closing(G, K)
        # Of S = K (I - G K)^-1, with behind = (I - K G)^-1 and before = (I - G K)^-1.
        dS = behind @ (dK + K @ at(dG, p.read, p.held) @ K) @ before
        through, into = at(G, p.z, p.held), at(G, p.read, p.w)
        slope = (
            at(dG, p.z, p.w) + at(dG, p.z, p.held) @ S @ into + through @ dS @ into + through @ S @ at(dG, p.read, p.w)
        )
        return at(G, p.z, p.w) + through @ S @ into, slope

    def takes(self, omega: float, outputs: ComplexArray) -> bool:
        """Whether a motion of the elements' outputs can be: what has fewer than two samples a turn must not make it.

        Such a controller reads and holds a slower motion in its place. Where the others give all but a little of the
        inputs without it, it may be as it likes.
        """
        p, w = self.layout, np.array([omega])
        heard = [omega * c.sample_time <= _HALF_RATE for c in p.controllers]
        if all(heard):
            return True
        G = self.origin.frequency_response(w) + p.aged(w)[0]
        responses = [c.response_and_slope(w)[0] * ok for c, ok in zip(p.controllers, heard, strict=True)]
        S = p.closing(G, p.side_by_side(responses))[0]
        alone = (at(G, p.z, p.w) + at(G, p.z, p.held) @ S @ at(G, p.read, p.w))[0] @ outputs
        inputs = self.frequency_response(w)[0] @ outputs
        return bool(np.linalg.norm(inputs - alone) <= _LITTLE * np.linalg.norm(inputs))

    def response_at(self, s: ArrayLike) -> ComplexArray:
        """:meth:`frequency_response` at any complex s but zero."""
        p, G = self.layout, self.origin.response_at(s) + self.layout.aged(-1j * np.asarray(s))[0]
        K = p.side_by_side([c.response_at(s) for c in p.controllers])
        S = p.closing(G, K)[0]
        return np.asarray(at(G, p.z, p.w) + at(G, p.z, p.held) @ S @ at(G, p.read, p.w), complex)

    def _positive(self, omega: ArrayLike) -> Array:
        """Frequencies; zero, where integrators have no response, as one next to it."""
        w = floats(omega, "frequency_response: omega")
        return np.where(w == 0.0, 1e-12 / max(c.sample_time for c in self.layout.controllers), w)

    def started(self, state: Array, memory: tuple) -> tuple[Array, tuple]:
        """State and memory of the loop that it replaces at a state of its own; the first sample comes at once."""
        p, n = self.layout, len(self.layout.plant)
        earliest = min(c.offset for c in p.controllers)
        x = np.zeros(len(self.origin.A))
        x[p.plant] = state[:n]
        rest, forms, first, out = iter(memory), iter(Forms.of(p).each), n, []
        for e in self.origin.elements:
            if not isinstance(e, SampledController):
                out.append(next(rest, None))
                continue
            form = next(forms)
            own = state[first : first + len(form.A)]
            first += len(form.A)
            held = tuple((form.C[: e.n_outputs] @ own).tolist())
            out.append(ControllerMemory(tuple(own[: len(np.asarray(e.x0))].tolist()), held, e.offset - earliest))
        return x, tuple(out)


def averaged(system: LureSystem) -> LureSystem:
    """The loop in continuous time that replaces one with sampled controllers; a loop without any as it is.

    Raises
    ------
    ModelError
        If a controller has a pole at z = -1, or what it reads comes straight from an element with dead time.
    """
    if not is_sampled(system.elements):
        return system
    p = Places.of(system)
    late = p.w[system.delays[p.w] > 0.0]
    if np.any(at(system.D, p.read, late)):
        raise ModelError(
            f"{system.name}: a sampled controller reads the output of an element with dead time; expected a linear "
            "block between, for predictions."
        )
    forms = Forms.of(p)
    read, C_k = Reads.of(p, forms), forms.whole.C[forms.held]
    n, k = len(p.plant), C_k.shape[1]
    # Rows on plant states, controllers, outputs of the others, external inputs and one.
    plant = np.hstack([
        at(system.A, p.plant, p.plant), at(system.B, p.plant, p.held) @ C_k, at(system.B, p.plant, p.w),
        system.B_input[p.plant], system.constant_state[p.plant, None],
    ])  # fmt: skip
    own = forms.whole.B @ read.rows
    own[:, n : n + k] += forms.whole.A
    rate, nw, nv = np.vstack([plant, own]), len(p.w), len(system.v0)
    s = system.signals
    others = [i for i, e in enumerate(system.elements) if not isinstance(e, SampledController)]
    values = {f.name: getattr(system, f.name) for f in fields(LureSystem)}
    return AveragedSystem(**values | {
        "A": rate[:, : n + k], "B": rate[:, n + k : n + k + nw], "B_input": rate[:, -nv - 1 : -1],
        "constant_state": rate[:, -1],
        "C": np.hstack([at(system.C, p.z, p.plant), at(system.D, p.z, p.held) @ C_k]),
        "D": at(system.D, p.z, p.w), "D_input": system.D_input[p.z], "constant_input": system.constant_input[p.z],
        "elements": tuple(system.elements[i] for i in others),
        "element_names": tuple(system.element_names[i] for i in others),
        "memory": tuple(system.memory[i] for i in others),
        "delays": system.delays[p.w],
        "signals": replace(s, C=np.hstack([s.C[:, p.plant], s.D[:, p.held] @ C_k]), D=s.D[:, p.w]),
        "x0": np.concatenate([system.x0[p.plant], np.zeros(k)]),
        "state_names": (*(system.state_names[i] for i in p.plant), *(f"controller_{i}" for i in range(k))),
        "principal": others.index(system.principal) if system.principal in others else 0,
        "cuts": _cuts(p, forms, read),
        "sampled": system,
    })  # fmt: skip


def _cuts(p: Places, forms: Forms, read: Reads) -> Cuts:
    """The places of a loop where its controllers are linear blocks.

    Cut at a controller's output it is cut before that is held, and cut where a controller reads, at its samples: what
    is late there is late by hold or age wherever it goes to.
    """
    places, whole, C_k = p.system.places, forms.whole, forms.whole.C[forms.held]
    n = len(p.plant) + C_k.shape[1]
    sent, taken = _sent(p), _taken(p)
    out, E = np.zeros((p.held.size, len(places.names))), places.E.copy()
    for i, (j, share) in sent.items():
        out[j, i] = share
        E[:, i] -= share * p.system.D[:, p.held[j]]
    kept = ~np.any(out, axis=0)
    into = read.solved @ (E[p.read] + read.gains @ whole.D_out[forms.aged] @ out)
    rows, F = np.hstack([places.C[:, p.plant], places.D[:, p.held] @ C_k, places.D[:, p.w]]), places.F.copy()
    on_read = read.rows[:, : rows.shape[1]]
    for i, (j, _) in sent.items():
        rows[i], F[i] = whole.D_now[j] @ on_read, whole.D_now[j] @ into[:, i]
        rows[i, len(p.plant) : n] += whole.C_now[j]
    for i, j in taken.items():
        # What one controller puts out and another one reads alone is cut at the first.
        if i not in sent:
            rows[i], F[i] = on_read[j], into[j, i] - 1.0
    return Cuts(
        places.names,
        B=np.vstack([places.B[p.plant] * kept, whole.B @ into + whole.B_out @ out]),
        E=E[p.z],
        C=rows[:, :n],
        D=rows[:, n:],
        F=F,
        delays=places.delays * kept,
    )


def _sent(p: Places) -> dict[int, tuple[int, float]]:
    """Places where all is what a controller puts out (by number among what is held), and whether it is held there.

    What blocks of one controller hand on to one another is not (see `Network.within`): it is read in the same sample.
    """
    s, places, found = p.system, p.system.places, {}
    owner = np.repeat(np.arange(len(p.controllers)), [c.n_outputs for c in p.controllers])
    reader = np.repeat(np.arange(len(p.controllers)), [c.n_inputs - 1 for c in p.controllers])
    for i in np.flatnonzero(_is_unit(places.D.T) & ~np.any(places.C, axis=1)):
        w = int(np.argmax(places.D[i]))
        for j, share in ((j, share) for j in np.flatnonzero(p.held == w) for share in (0.0, 1.0)):
            within = places.E[:, i] - share * s.D[:, w]
            within[p.read[reader == owner[j]]] = 0.0
            if not np.any(within) and np.array_equal(places.B[:, i], share * s.B[:, w]):
                found[int(i)] = int(j), share
    return found


def _taken(p: Places) -> dict[int, int]:
    """Places that are all that a controller reads at an input (by number among what is read)."""
    s, places = p.system, p.system.places
    found: dict[int, int] = {}
    for i in np.flatnonzero(_is_unit(places.E) & ~np.any(places.B, axis=0)):
        z = int(np.argmax(places.E[:, i]))
        if np.array_equal(places.C[i], s.C[z]) and np.array_equal(places.D[i], s.D[z]):
            found |= {int(i): int(j) for j in np.flatnonzero(p.read == z)}
    return found


def _is_unit(columns: Array) -> BoolArray:
    """Which columns are those of a unit matrix."""
    return (np.count_nonzero(columns, axis=0) == 1) & np.any(columns == 1.0, axis=0)
