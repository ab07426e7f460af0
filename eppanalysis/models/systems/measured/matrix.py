"""Measured frequency responses from several inputs to several outputs: one response for each path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from eppanalysis.arguments import checked, checked_class, floats
from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.errors import ModelError
from eppanalysis.models.systems.measured.curve import Cubics
from eppanalysis.models.systems.measured.response import MeasuredResponse, reach
from eppanalysis.readable import count
from eppanalysis.shown import Shown, frame_of

if TYPE_CHECKING:
    import control
    import pandas

    from eppanalysis.plotting import Axes


@checked_class
@dataclass(frozen=True, eq=False, repr=False)
class MeasuredMatrix(Shown):
    """Measured frequency responses of a linear part with several inputs and outputs.

    Each path has its own points, standard deviation and static gain. The matrix is known where all its paths are.

    Parameters
    ----------
    paths : sequence of sequence of MeasuredResponse or None
        In a row for each output its responses to the inputs; None where an input does not come through.
    name : str
        What results call it.

    Raises
    ------
    ModelError
        If rows differ in length, there is no path, or the paths have no frequencies in common.

    Examples
    --------
    >>> import numpy as np
    >>> import eppanalysis as epp
    >>> omega = np.geomspace(0.1, 10.0, 101)
    >>> lag = epp.MeasuredResponse(omega, 1.0 / (1.0 + 1j * omega))
    >>> epp.MeasuredMatrix([[None, lag], [lag, None]]).at(1.0).round(3).tolist()
    [[0j, (0.5-0.5j)], [(0.5-0.5j), 0j]]
    """

    paths: Sequence[Sequence[MeasuredResponse | None]]
    name: str = "responses"

    def __post_init__(self) -> None:
        paths = tuple(tuple(row) for row in self.paths)
        object.__setattr__(self, "paths", paths)
        if len({len(row) for row in paths}) != 1 or not self.known:
            shown = [len(row) for row in paths]
            raise ModelError("MeasuredMatrix: paths", f"rows of {shown}", "rows of one length, with a response in them")
        low, high = self.band
        if not low < high:
            raise ModelError("MeasuredMatrix: paths", f"known from {low:.4g} to {high:.4g} rad/s", "a common band")

    @classmethod
    @checked
    def from_control(
        cls,
        data: control.FrequencyResponseData,
        deviation: float | None = None,
        static_gain: Any = None,
        unstable_poles: int = 0,
        name: str = "responses",
    ) -> MeasuredMatrix:
        """From python-control's frequency response data; a path that is zero throughout counts as absent.

        Parameters
        ----------
        data : control.FrequencyResponseData
            A point at frequency zero is the static gain where that is not given.
        deviation : float, optional
            Of every path, as in :class:`MeasuredResponse`.
        static_gain : array_like, shape (p, q), optional
            Of each path; not a number where it is not known.
        unstable_poles : int
            Of every path, as in :class:`MeasuredResponse`.
        name : str
            What results call it.

        Returns
        -------
        MeasuredMatrix

        Raises
        ------
        ModelError
            If it is something else, or the points of a path are refused.
        """
        if not (hasattr(data, "omega") and hasattr(data, "frdata")):
            raise ModelError(f"from_control: the data are a {type(data).__name__}", expected="FrequencyResponseData")
        omega, values = np.asarray(data.omega, float), np.asarray(data.frdata, complex)
        gains = np.full(values.shape[:2], np.nan) if static_gain is None else np.asarray(static_gain, float)
        if gains.shape != values.shape[:2]:
            raise ModelError("from_control: static_gain has shape", gains.shape, f"{values.shape[:2]}")
        rest = omega == 0.0
        if static_gain is None and np.any(rest):
            gains = values[:, :, rest][:, :, 0].real

        def path(i: int, j: int) -> MeasuredResponse | None:
            if not np.any(values[i, j]):
                return None
            gain = None if np.isnan(gains[i, j]) else float(gains[i, j])
            label = f"{name} {i + 1}/{j + 1}"
            return MeasuredResponse(omega[~rest], values[i, j, ~rest], deviation, gain, unstable_poles, label)

        return cls([[path(i, j) for j in range(values.shape[1])] for i in range(values.shape[0])], name)

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of outputs and inputs."""
        return len(self.paths), len(self.paths[0])

    @cached_property
    def known(self) -> tuple[tuple[int, int, MeasuredResponse], ...]:
        """Each path that there is, with its output and its input."""
        return tuple((i, j, r) for i, row in enumerate(self.paths) for j, r in enumerate(row) if r is not None)

    @property
    def band(self) -> tuple[float, float]:
        """Lowest and highest frequency [rad/s] at which all paths are measured."""
        bands = [r.band for _, _, r in self.known]
        return max(low for low, _ in bands), min(high for _, high in bands)

    @property
    def static_gain(self) -> Array:
        """Of each path, shape (p, q): zero where there is none, not a number where it is not known."""
        out = np.zeros(self.shape)
        for i, j, r in self.known:
            out[i, j] = np.nan if r.static_gain is None else r.static_gain
        return out

    def at(self, omega: Any) -> ComplexArray:
        """Responses at frequencies [rad/s], shape (..., p, q); not a number outside the data."""
        return self.with_slope(omega)[0]

    def with_slope(self, omega: Any) -> tuple[ComplexArray, ComplexArray]:
        """Responses at frequencies [rad/s], shape (..., p, q), and their derivatives by them."""
        omega = floats(omega, "MeasuredMatrix: omega")
        G, dG = np.zeros((2, *omega.shape, *self.shape), complex)
        i, j, paths = zip(*self.known, strict=True)
        inside = np.stack([r.knows(omega) for r in paths], -1)
        for out, of in zip((G, dG), self._cubics.at(omega), strict=True):
            out[..., i, j] = np.where(inside, of, np.nan)
        return G, dG

    @cached_property
    def _cubics(self) -> Cubics:
        """The curves of all paths."""
        return Cubics.of([r.curve for _, _, r in self.known])

    def __str__(self) -> str:
        """How many paths were measured, and where all of them are known."""
        paths = f"{len(self.known)} of {count(self.shape[0] * self.shape[1], 'path')}"
        ports = " and ".join(count(n, what) for n, what in zip(self.shape, ("output", "input"), strict=True))
        return f"Frequency responses of {paths} between {ports}, all known {reach(self)}."

    @property
    def subject(self) -> str:  # type: ignore[override]  # its own name
        """What results call it."""
        return self.name

    def facts(self) -> dict[str, Any]:
        """What is known of each path beside its points."""
        return {f"output {i + 1}, input {j + 1}": {"name": r.name, **r.facts()} for i, j, r in self.known}

    def to_frame(self) -> pandas.DataFrame:
        """One row a measured frequency of each path: its output and its input, counted from 1, and the response."""
        import pandas

        parts = [(i + 1, j + 1, r.to_frame()) for i, j, r in self.known]
        rows = [part.assign(output=i, input=j) for i, j, part in parts]
        columns = ["output", "input", *max((part.columns for _, _, part in parts), key=len)]
        table = pandas.concat(rows, ignore_index=True).reindex(columns=columns)
        return frame_of(table.to_dict("records"), parts[0][2].attrs["units"])

    def in_brief(self) -> pandas.DataFrame:
        """One row a path: where it is measured."""
        rows = [
            {"output": i + 1, "input": j + 1, "points": r.curve.log_omega.size, "from_omega": low, "to_omega": high}
            for i, j, r in self.known
            for low, high in (r.band,)
        ]
        return frame_of(rows, {"from_omega": "rad/s", "to_omega": "rad/s"})

    @checked
    def plot(self, ax: Axes | None = None) -> Axes:
        """Bode diagram of all paths; the magnitudes alone in given axes."""
        return self.drawn("plot_matrix", ax)
