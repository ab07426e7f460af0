"""Places at which a loop can be cut: what a disturbance there does, and the signal that comes back to it."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from eppanalysis.arguments import checked_class, floats
from eppanalysis.arrays import Array
from eppanalysis.errors import ModelError, shown


@checked_class
@dataclass(frozen=True, eq=False)
class Cuts:
    """Named places of a loop, each with the disturbance ``d`` that is added there and the signal ``y`` before it.

    With the disturbance of one place the loop is ::

        dx/dt = ... + B d(t - delay)
        z = ... + E d
        y = C x + D w + F d

    Cut open there, ``u = y + d`` is what goes on from the place and no longer follows ``y``.

    Parameters
    ----------
    names : tuple of str
        Names of the k places, such as "controller.out".
    B : array, shape (n, k)
        From the disturbances to the state rate.
    E : array, shape (nz, k)
        From the disturbances straight to the inputs of the elements.
    C : array, shape (k, n)
        From the state to the signals.
    D : array, shape (k, nw)
        From the outputs of the elements straight to the signals.
    F : array, shape (k,), optional
        From each disturbance straight back to its own signal; zero by default.
    delays : array, shape (k,), optional
        Dead time of each disturbance on its way to the state rate [s]; zero by default.

    Raises
    ------
    ModelError
        If shapes do not fit, a number is not finite, a name occurs twice, a dead time is negative, or a signal follows
        its own disturbance with a gain of -1, so that the loop cut open there has no solution.

    Examples
    --------
    A force on a mass, cut where it acts:

    >>> from eppanalysis import Cuts
    >>> matrices = {"B": [[0.0], [2.0]], "E": [[0.0]], "C": [[-3.0, 0.0]], "D": [[1.0]]}
    >>> cuts = Cuts(("mass.force",), **matrices)
    >>> cuts.F.tolist(), cuts.number("mass.force")
    ([0.0], 0)
    """

    names: tuple[str, ...]
    B: Array
    E: Array
    C: Array
    D: Array
    F: Array = field(default_factory=lambda: np.zeros(0))
    delays: Array = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        k = len(self.names)
        object.__setattr__(self, "names", tuple(self.names))
        for name in ("B", "E", "C", "D", "F", "delays"):
            values = floats(getattr(self, name), f"Cuts: {name}", copy=True)
            if name in ("F", "delays") and not values.size:
                values = np.zeros(k)
            _check_shape(name, values, k)
            values.flags.writeable = False
            object.__setattr__(self, name, values)
        if len(set(self.names)) < k:
            raise ModelError("Cuts", list(self.names), "different names, one for each place", field="names")
        if np.any(self.delays < 0):
            raise ModelError("Cuts", self.delays.tolist(), "zero or positive numbers", field="delays")
        for name, straight in zip(self.names, self.F.tolist(), strict=True):
            if straight == -1.0:
                raise ModelError(f"Cuts: the loop cut open at {name} has no solution", expected="F other than -1")

    def called(self, name: str) -> str:
        """The whole name of a place: that of a part alone means its output."""
        return f"{name}.out" if f"{name}.out" in self.names else name

    @property
    def distinct(self) -> tuple[str, ...]:
        """Names of the places as people know them.

        That is without another name of one before ("gear.in1" behind "gear.twist"), and without the ports inside of a
        part that has one outside ("controller.in1" behind "controller.in").
        """
        found: dict[bytes, str] = {}
        for i, name in enumerate(self.names):
            if name[-1:].isdigit() and name.rstrip("0123456789") in self.names:
                continue
            found.setdefault(self._numbers(i), name)
        return tuple(found.values())

    def _numbers(self, i: int) -> bytes:
        """All numbers of a place; zeros of either sign are the same, as zero is added."""
        parts = (self.B[:, i], self.E[:, i], self.C[i], self.D[i], self.F[i], self.delays[i])
        return b"".join((np.asarray(part) + 0.0).tobytes() for part in parts)

    def others(self, name: str) -> tuple[str, ...]:
        """Names, as people know them, of the places that are not this one by another name."""
        here = self._numbers(self.number(name))
        return tuple(other for other in self.distinct if self._numbers(self.names.index(other)) != here)

    def number(self, name: str) -> int:
        """Number of a place; a name alone means its output.

        Raises
        ------
        ModelError
            If no place has this name.
        """
        name = self.called(name)
        if name not in self.names:
            raise unknown_place("The loop", name, self)
        return self.names.index(name)

    def in_coordinates(self, T: Array, inverse: Array) -> Cuts:
        """The same places of the loop with another state y, where ``x = T y`` and ``y = inverse x``."""
        return replace(self, B=inverse @ self.B, C=self.C @ T)

    def beside(self, others: Cuts, hidden: Collection[str] = ()) -> Cuts:
        """These places and those of the others whose names are new, but those of parts that are `hidden`."""
        new = [i for i, n in enumerate(others.names) if n not in self.names and n.rpartition(".")[0] not in hidden]
        return Cuts(
            (*self.names, *(others.names[i] for i in new)),
            B=np.hstack([self.B, others.B[:, new]]),
            E=np.hstack([self.E, others.E[:, new]]),
            C=np.vstack([self.C, others.C[new]]),
            D=np.vstack([self.D, others.D[new]]),
            F=np.concatenate([self.F, others.F[new]]),
            delays=np.concatenate([self.delays, others.delays[new]]),
        )

    def with_own_states(self, own: Mapping[str, Array], B: Array, closed: Array, y: Array) -> Cuts:
        """The places of a loop to which the elements' own states are appended: `own`, as `stacked` gives them.

        Parameters
        ----------
        own : mapping of str to array
        B : array, shape (n, ny)
            Of the loop: from the signals behind the elements to the state rate.
        closed : array, shape (nx, nx)
            What the signals before the elements are divided by, for what passes straight through the elements.
        y : array, shape (ny, n + own + nw)
            The signals behind the elements, as rows on the state and the outputs.

        Raises
        ------
        ModelError
            If a disturbance reaches the states of an element at once and the others with a dead time.
        """
        n, k = len(B), len(own["A"])
        x_d = np.linalg.solve(closed, self.E)
        y_d = own["D_yx"] @ x_d
        into = np.vstack([B @ y_d, own["B_x"] @ x_d])
        for name, late, column in zip(self.names, self.delays.tolist(), into.T, strict=True):
            if late and np.any(column):
                what = f"A disturbance at {name} reaches the state both with its dead time and without"
                raise ModelError(what, expected="a place without dead time before an element with states of its own")
        seen = np.hstack([self.C, np.zeros((len(self.names), y.shape[1] - n))]) + self.D @ y
        return replace(
            self,
            B=np.vstack([self.B, np.zeros((k, len(self.names)))]) + into,
            E=own["D_zx"] @ x_d,
            C=seen[:, : n + k],
            D=seen[:, n + k :],
            F=self.F + np.einsum("ij,ji->i", self.D, y_d),
        )

    def require(self, name: str, n: int, nz: int, nw: int) -> Cuts:
        """These places, if they fit a loop called `name` with n states and the elements' inputs and outputs.

        Raises
        ------
        ModelError
            If they do not.
        """
        k = len(self.names)
        for part, shape in {"B": (n, k), "E": (nz, k), "C": (k, n), "D": (k, nw)}.items():
            found = getattr(self, part).shape
            if found != shape:
                raise ModelError(f"{name}: {part} of the cuts has shape {found}", expected=f"shape {shape}")
        return self


def _check_shape(name: str, values: Array, k: int) -> None:
    """Whether numbers are finite and have as many rows or columns as there are places."""
    whole = {"B": 1, "E": 1}.get(name, 0)
    fits = values.ndim == (1 if name in ("F", "delays") else 2) and values.shape[whole] == k
    if not fits:
        raise ModelError(f"Cuts: {name} has shape {values.shape}", expected=f"one of each for {k} places", field=name)
    if not np.all(np.isfinite(values)):
        raise ModelError(f"Cuts: {name} holds a number that is not finite.", field=name)


def suggestion(name: str, known: Sequence[str]) -> str:
    """What may have been meant by the name of a place that is not known."""
    close = difflib.get_close_matches(str(name)[:200], known, n=1)
    return f"did you mean {close[0]!r}?" if close else f"its places are {', '.join(known) or 'none'}."


def port_names(label: str, what: str, count: int) -> list[str]:
    """Names of the inputs or outputs of an element: "gear.in" for one, "gear.in1", "gear.in2" for several."""
    return [f"{label}.{what}{'' if count == 1 else i + 1}" for i in range(count)]


def element_cuts(
    labels: Sequence[str], sizes: Sequence[tuple[int, int]], B: Array, C: Array, D: Array, delays: Array
) -> Cuts:
    """The inputs and outputs of all elements as places: "gear.in" before one, "gear.out" behind it.

    Parameters
    ----------
    labels : sequence of str
        Names of the elements.
    sizes : sequence of (int, int)
        Numbers of their inputs and outputs.
    B, C, D, delays : array
        Of the loop.
    """
    (nz, nw), n = D.shape, len(B)
    ins, outs = (
        [name for label, size in zip(labels, sizes, strict=True) for name in port_names(label, what, size[part])]
        for part, what in enumerate(("in", "out"))
    )
    return Cuts(
        (*ins, *outs),
        B=np.hstack([np.zeros((n, nz)), B]),
        E=np.hstack([np.eye(nz), D]),
        C=np.vstack([C, np.zeros((nw, n))]),
        D=np.vstack([D, np.eye(nw)]),
        delays=np.concatenate([np.zeros(nz), delays]),
    )


def unknown_place(who: str, name: object, cuts: Cuts) -> ModelError:
    """What is said of a place that a loop does not have."""
    said = f"{who} has no place {shown(name)} to be cut at; {suggestion(str(name), cuts.distinct)}"
    return ModelError(said, field="margins_at")


def require_places(name: str, given: Sequence[str], cuts: Cuts) -> None:
    """Refuse names of places that a loop called `name` does not have."""
    for place in given:
        if cuts.called(place) not in cuts.names:
            raise unknown_place(name, place, cuts)
