"""A loop with sampled controllers as one of continuous time: each controller in the mean over where its samples fall.

What a controller makes of a sine is, in the mean over where the samples fall on it, its response at that frequency
times hold and delay. The loop that is closed by such responses is linear and known exactly at every frequency; for
means, poles and coordinates it has a rational form besides (bilinear transform of the controller, Pade approximation
of hold and delay as one dead time), exact towards low frequencies. What the samples fold back from beyond half their
rate is left out of both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from eppanalysis.arguments import floats
from eppanalysis.errors import ModelError
from eppanalysis.models.elements.dynamic.sampled import ControllerMemory, SampledController
from eppanalysis.models.systems.cuts import Cuts
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.sampled.strobe import clock_in, is_sampled
from eppanalysis.models.systems.signals import SignalMap

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class AveragedSystem(LureSystem):
    """The loop in its rational form, with responses that are exact in the mean over the phases of the samples.

    Attributes
    ----------
    sampled : LureSystem
        The loop that it stands for.
    """

    sampled: LureSystem | None = None

    @property
    def origin(self) -> LureSystem:
        """The loop that it stands for."""
        return self if self.sampled is None else self.sampled

    @property
    def slowest(self) -> float:
        """Longest time between two samples of a controller [s]."""
        return max(c.sample_time for c in self.layout.controllers)

    @cached_property
    def layout(self) -> Places:
        """Where its parts stand in the loop that it stands for."""
        return Places.of(self.origin)

    def frequency_response(self, omega: ArrayLike) -> ComplexArray:
        """Response from the elements' outputs to their inputs, controllers with hold and delay closed around them."""
        p, w = self.layout, self._positive(omega)
        G = self.origin.frequency_response(w)
        S = p.closing(G, p.responses(w)[0])[0]
        return np.asarray(_at(G, p.z, p.w) + _at(G, p.z, p.held) @ S @ _at(G, p.read, p.w), complex)

    def signal_response(self, omega: ArrayLike) -> ComplexArray:
        """Response from the elements' outputs to the named signals."""
        p, w = self.layout, self._positive(omega)
        G, Y = self.origin.frequency_response(w), self.origin.signal_response(w)
        S = p.closing(G, p.responses(w)[0])[0]
        return np.asarray(Y[..., p.w] + Y[..., p.held] @ S @ _at(G, p.read, p.w), complex)

    def frequency_response_and_slope(self, omega: ArrayLike) -> tuple[ComplexArray, ComplexArray]:
        """:meth:`frequency_response` and its derivative by `omega`."""
        p, w = self.layout, self._positive(omega)
        G, dG = self.origin.frequency_response_and_slope(w)
        K, dK = p.responses(w)
        S, before, behind = p.closing(G, K)
        # Of S = K (I - G K)^-1, with behind = (I - K G)^-1 and before = (I - G K)^-1.
        dS = behind @ (dK + K @ _at(dG, p.read, p.held) @ K) @ before
        through, into = _at(G, p.z, p.held), _at(G, p.read, p.w)
        slope = (
            _at(dG, p.z, p.w)
            + _at(dG, p.z, p.held) @ S @ into
            + through @ dS @ into
            + through @ S @ _at(dG, p.read, p.w)
        )
        return _at(G, p.z, p.w) + through @ S @ into, slope

    def response_at(self, s: ArrayLike) -> ComplexArray:
        """:meth:`frequency_response` at any complex s but zero."""
        p, G = self.layout, self.origin.response_at(s)
        K = p.side_by_side([c.response_at(s) for c in p.controllers])
        S = p.closing(G, K)[0]
        return np.asarray(_at(G, p.z, p.w) + _at(G, p.z, p.held) @ S @ _at(G, p.read, p.w), complex)

    def _positive(self, omega: ArrayLike) -> Array:
        """Frequencies; zero, where integrators have no response, as one next to it."""
        w = floats(omega, "frequency_response: omega")
        return np.where(w == 0.0, 1e-12 / max(c.sample_time for c in self.layout.controllers), w)

    def started(self, state: Array, memory: tuple) -> tuple[Array, tuple]:
        """State and memory of the loop that it stands for at a state of its own, with a sample to come at once."""
        p, n = self.layout, len(self.layout.plant)
        x = np.zeros(len(self.origin.A))
        x[p.plant] = state[:n]
        rest, at, out = iter(memory), n, []
        for e in self.origin.elements:
            if not isinstance(e, SampledController):
                out.append(next(rest, None))
                continue
            _, _, C_k = realised(e, np.zeros(e.n_outputs))
            own = state[at : at + C_k.shape[1]]
            at += C_k.shape[1]
            out.append(ControllerMemory(tuple(own[: len(np.asarray(e.x0))].tolist()), tuple((C_k @ own).tolist()), 0.0))
        return x, tuple(out)


@dataclass(frozen=True, eq=False)
class Places:
    """Where controllers and other elements stand in a loop.

    Attributes
    ----------
    controllers : tuple of SampledController
    plant : int array
        States but the clock.
    z, w : int arrays
        Inputs and outputs of the other elements.
    read, held : int arrays
        What the controllers read (not the clock), and their outputs.
    """

    controllers: tuple[SampledController, ...]
    plant: NDArray[np.intp]
    z: NDArray[np.intp]
    w: NDArray[np.intp]
    read: NDArray[np.intp]
    held: NDArray[np.intp]

    @classmethod
    def of(cls, system: LureSystem) -> Places:
        """Those of a loop."""
        z: list[int] = []
        w: list[int] = []
        read: list[int] = []
        held: list[int] = []
        clocks: set[int] = set()
        for e, zs, ws in zip(system.elements, system.input_slices, system.output_slices, strict=True):
            if isinstance(e, SampledController):
                read += range(zs.start, zs.stop - 1)
                held += range(ws.start, ws.stop)
                clocks.add(clock_in(system.C[zs.stop - 1]))
            else:
                z += range(zs.start, zs.stop)
                w += range(ws.start, ws.stop)
        plant = np.setdiff1d(np.arange(len(system.A)), sorted(clocks))
        chosen = tuple(e for e in system.elements if isinstance(e, SampledController))
        return cls(chosen, plant, *(np.array(p, np.intp) for p in (z, w, read, held)))

    def responses(self, omega: Array) -> tuple[ComplexArray, ComplexArray]:
        """Responses of all controllers and their derivatives by the frequency, shape (..., held, read)."""
        both = [c.response_and_slope(omega) for c in self.controllers]
        return self.side_by_side([k for k, _ in both]), self.side_by_side([dk for _, dk in both])

    def side_by_side(self, responses: Sequence[ComplexArray]) -> ComplexArray:
        """What each controller makes of what it reads, as one response of shape (..., held, read)."""
        K, i, j = np.zeros((*responses[0].shape[:-2], self.held.size, self.read.size), complex), 0, 0
        for k in responses:
            p, m = k.shape[-2:]
            K[..., i : i + p, j : j + m] = k
            i, j = i + p, j + m
        return K

    def closing(self, G: ComplexArray, K: ComplexArray) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        """From what the others bring to what is read, to what is held: ``K before``, and ``behind K`` alike."""
        around = _at(G, self.read, self.held)
        before = np.linalg.inv(np.eye(self.read.size) - around @ K)
        behind = np.linalg.inv(np.eye(self.held.size) - K @ around)
        return np.asarray(K @ before, complex), np.asarray(before, complex), np.asarray(behind, complex)


def _at(G: NDArray, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> NDArray:
    return G[..., rows[:, None], columns]


def realised(controller: SampledController, dead_time: Array) -> tuple[Array, Array, Array]:
    """A controller in continuous time, strictly proper: bilinear transform, and hold and delay as a dead time.

    Raises
    ------
    ModelError
        If it has a pole at z = -1.
    """
    A, B, C, D = (np.asarray(getattr(controller, name), float) for name in "ABCD")
    n, p, T = len(A) if A.size else 0, controller.n_outputs, controller.sample_time
    turn = np.eye(n) + A.reshape(n, n)
    if n and np.linalg.cond(turn) > 1e12:
        raise ModelError(
            "SampledController", "A with an eigenvalue of -1", "none there, for predictions in continuous time"
        )
    back = np.linalg.inv(turn) if n else turn
    A_c, B_c = 2.0 / T * back @ (A.reshape(n, n) - np.eye(n)), 2.0 / T * back @ B
    C_c, D_c = 2.0 * C @ back, D - C @ back @ B
    # Hold and delay are late by half a sample and the delay: as a dead time t in Pade's form of one zero and two poles,
    # (1 - ts/3)/(1 + 2ts/3 + (ts)^2/6), through which nothing goes straight.
    theta = 0.5 * T + controller.delay + dead_time
    late = scipy.linalg.block_diag(*(np.array([[0.0, 1.0], [-6.0 / t**2, -4.0 / t]]) for t in theta))
    drive = np.zeros((2 * p, p))
    drive[1::2] = np.diag(6.0 / theta**2)
    out = np.zeros((p, 2 * p))
    out[:, 0::2], out[:, 1::2] = np.eye(p), np.diag(-theta / 3.0)
    A_k = np.block([[A_c, np.zeros((n, 2 * p))], [drive @ C_c, late]])
    return A_k, np.vstack([B_c, drive @ D_c]), np.hstack([np.zeros((p, n)), out])


def _cuts(places: Cuts, p: Places, B_k: Array, C_k: Array) -> Cuts:
    """The places of a loop where its controllers are linear blocks."""
    return Cuts(
        places.names,
        B=np.vstack([places.B[p.plant], B_k @ places.E[p.read]]),
        E=places.E[p.z],
        C=np.hstack([places.C[:, p.plant], places.D[:, p.held] @ C_k]),
        D=places.D[:, p.w],
        F=places.F,
        delays=places.delays,
    )


def averaged(system: LureSystem) -> LureSystem:
    """The loop in continuous time that stands for one with sampled controllers; a loop without any as it is.

    Raises
    ------
    ModelError
        If a controller has a pole at z = -1, or what it reads comes straight from an element with dead time.
    """
    if not is_sampled(system.elements):
        return system
    p = Places.of(system)
    late = p.w[system.delays[p.w] > 0.0]
    if np.any(_at(system.D, p.read, late)):
        raise ModelError(
            f"{system.name}: a sampled controller reads the output of an element with dead time; expected a linear "
            "block between, for predictions."
        )
    dead = np.split(system.delays[p.held], np.cumsum([c.n_outputs for c in p.controllers])[:-1])
    parts = [realised(c, d) for c, d in zip(p.controllers, dead, strict=True)]
    A_k, B_k, C_k = (scipy.linalg.block_diag(*blocks) for blocks in zip(*parts, strict=True))
    n, k = len(p.plant), len(A_k)
    # Rows on plant states, controllers, outputs of the others, external inputs and one.
    read = np.hstack([
        _at(system.C, p.read, p.plant), _at(system.D, p.read, p.held) @ C_k, _at(system.D, p.read, p.w),
        system.D_input[p.read], system.constant_input[p.read, None],
    ])  # fmt: skip
    plant = np.hstack([
        _at(system.A, p.plant, p.plant), _at(system.B, p.plant, p.held) @ C_k, _at(system.B, p.plant, p.w),
        system.B_input[p.plant], system.constant_state[p.plant, None],
    ])  # fmt: skip
    own = B_k @ read
    own[:, n : n + k] += A_k
    rate, nw, nv = np.vstack([plant, own]), len(p.w), len(system.v0)
    s = system.signals
    others = [i for i, e in enumerate(system.elements) if not isinstance(e, SampledController)]
    values = {f.name: getattr(system, f.name) for f in fields(LureSystem)}
    return AveragedSystem(**values | {
        "A": rate[:, : n + k], "B": rate[:, n + k : n + k + nw], "B_input": rate[:, -nv - 1 : -1],
        "constant_state": rate[:, -1],
        "C": np.hstack([_at(system.C, p.z, p.plant), _at(system.D, p.z, p.held) @ C_k]),
        "D": _at(system.D, p.z, p.w), "D_input": system.D_input[p.z], "constant_input": system.constant_input[p.z],
        "elements": tuple(system.elements[i] for i in others),
        "element_names": tuple(system.element_names[i] for i in others),
        "memory": tuple(system.memory[i] for i in others),
        "delays": system.delays[p.w],
        "signals": SignalMap(
            s.names, np.hstack([s.C[:, p.plant], s.D[:, p.held] @ C_k]), s.D[:, p.w], s.D_input, s.constant, s.units
        ),
        "x0": np.concatenate([system.x0[p.plant], np.zeros(k)]),
        "state_names": (*(system.state_names[i] for i in p.plant), *(f"controller_{i}" for i in range(k))),
        "principal": others.index(system.principal) if system.principal in others else 0,
        "cuts": _cuts(system.places, p, B_k, C_k),
        "sampled": system,
    })  # fmt: skip
