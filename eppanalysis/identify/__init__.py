"""Measured data to parameters: a response of any case, an elbow's weight tray and backlash cycling; and a case of them.

Every test is a record, in a file or in memory. What one of them identifies the next one takes as known, within its
tolerance.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from eppanalysis.arguments import checked
from eppanalysis.cases import Case, Parameter
from eppanalysis.errors import EppError
from eppanalysis.identify.columns import ELBOW, ROLES, Layout, Role
from eppanalysis.identify.estimate import BenchFit, Estimate, Residual, brief_estimates, estimates_frame
from eppanalysis.progress import Progress
from eppanalysis.readable import count, listed
from eppanalysis.records.formats import Given
from eppanalysis.records.reading import Recording, read_recording, read_signals
from eppanalysis.results import Result
from eppanalysis.units import rounded

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

__all__ = ["BenchFit", "Estimate", "Identification", "Residual", "identify"]

#: Columns by name and unit where the name is not the role, as ``--signal`` gives them.
Choices = Mapping[str, tuple[str, str]]


@dataclass(frozen=True, eq=False, repr=False)
class Identification(Result):
    """What tests identified of a case.

    Attributes
    ----------
    case : Case
        The one that was given, with every identified parameter marked "measured", with its tolerance.
    fits : tuple of BenchFit
        One for each test, in the order in which they were used.
    """

    case: Case
    fits: tuple[BenchFit, ...]

    in_json = "limited_by fits provenance"

    def __getitem__(self, name: str) -> Estimate:
        """The last estimate of a parameter."""
        for fit in reversed(self.fits):
            for estimate in fit.estimates:
                if estimate.name == name:
                    return estimate
        raise KeyError(name)

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """The last estimate of every parameter."""
        return tuple({e.name: e for fit in self.fits for e in fit.estimates}.values())

    @property
    def limited_by(self) -> str:
        """The parameter that the data identify least, relative to its size."""
        return max(self.estimates, key=lambda e: (not e.identified, e.relative_width)).name

    def __str__(self) -> str:
        """How many parameters are identified, from which tests, and which of them limits the rest."""
        known = sum(estimate.identified for estimate in self.estimates)
        tests = listed([fit.bench for fit in self.fits])
        worst = next(fit for fit in reversed(self.fits) if any(e.name == self.limited_by for e in fit.estimates))
        worse = replace(worst, estimates=(self[self.limited_by],))
        return (
            f"{known} of {count(len(self.estimates), 'parameter')} of {self.case.name} identified from {tests}. "
            f"{worse.limit_sentence()}"
        )

    def to_frame(self) -> pandas.DataFrame:
        """The last estimate of every parameter, one a row, each in its SI unit."""
        return estimates_frame(self.estimates)

    def in_brief(self) -> pandas.DataFrame:
        """The estimates in the units that people use for them."""
        return brief_estimates(self.estimates)

    @checked
    def plot(self, ax: Axes | None = None) -> Axes:
        """The intervals of all parameters, relative to their values."""
        return self.drawn("plot_intervals", ax)

    def to_toml(self) -> str:
        """The case as the TOML text of a file."""
        return self.case.to_toml()


def identify(
    case: Case,
    *,
    tray: Given | None = None,
    backlash: Given | None = None,
    step: Given | None = None,
    columns: Choices | None = None,
    wrap: float = math.pi,
    press: float = 0.0,
    fit: Sequence[str] | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> Identification:
    """Identify parameters of a case from a recorded response, those of an elbow from its other bench tests too.

    Parameters
    ----------
    case : Case
        What is known; what the tests do not identify stays as it is there.
    tray : path, mapping of str to array, DataFrame, Dataset or DataArray, optional
        Weight-tray test: columns force, voltage and, where there is one, time. A file, of any format of
        :doc:`/howto/records`, that the working folder does not have is looked for in that of the case.
    backlash : path, mapping of str to array, DataFrame, Dataset or DataArray, optional
        Backlash cycling: columns angle, force and, where there are any, time and torque (of the hand).
    step : path, mapping of str to array, DataFrame, Dataset or DataArray, optional
        Recorded response. Of an elbow columns time, angle and, where there are any, force and harness (its motion); of
        another case in continuous time columns time, one or more of its signals, and external inputs that were
        recorded, by their names.
    columns : mapping of str to (str, str), optional
        Name and unit of a role whose column has another name.
    wrap : float
        Angle psi at which the pulley was loaded in the weight-tray test [rad].
    press : float
        Largest torque with which the hand may have pressed in backlash cycling without recorded torque [N*m].
    fit : sequence of str, optional
        Fields that the response is to identify; of an elbow drive inertia and friction, lag and delay by default.
    seed : int
        Of the starts of the step response's fit.
    progress : callable, optional
        Called with what is done, of how much, and in words what is being done.

    Returns
    -------
    Identification
        The case with what the tests tell, and a fit for each test.

    Raises
    ------
    EppError
        If a file is not a table of numbers, or its data cannot identify the parameters.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> from eppanalysis.cases import shipped_cases_folder
    >>> tray = shipped_cases_folder() / "measured" / "weight_tray.csv"
    >>> found = epp.identify(epp.case("elbow"), tray=tray)
    >>> found["pulley.friction"].low < 0.05 < found["pulley.friction"].high
    True
    >>> found.case.parameters["sensor.gain"].mark
    'measured'
    """
    tray, backlash, step = (_beside(case, path) for path in (tray, backlash, step))
    if tray is None and backlash is None and step is None:
        elbow = "tray, backlash or step: a weight tray, backlash cycling or step response"
        expected = elbow if case.kind == "elbow" else "step: a recorded response"
        raise EppError(f"identify: no measured file is given; expected {expected}.")
    if tray is not None or backlash is not None:
        case.elbow_parameters  # noqa: B018  (refuses others)
    fits: list[BenchFit] = []
    found = case
    if tray is not None:
        from eppanalysis.identify.tray import fit_tray

        recording = read_recording(
            tray, (Role.FORCE, Role.VOLTAGE), (Role.TIME,), columns, units=ROLES, progress=progress
        )
        fits.append(fit_tray(recording, wrap=wrap))
        found = with_estimates(found, fits[-1])
    if backlash is not None:
        from eppanalysis.identify.backlash import fit_backlash

        recording = read_recording(
            backlash, (Role.ANGLE, Role.FORCE), (Role.TIME, Role.TORQUE), columns, units=ROLES, progress=progress
        )
        fits.append(fit_backlash(recording, found, press=press))
        found = with_estimates(found, fits[-1])
    if step is not None:
        from eppanalysis.identify.response import layout_of
        from eppanalysis.identify.step import fit_step

        recording = _read_response(step, layout_of(found), columns, progress)
        fits.append(fit_step(recording, found, fit, seed=seed, progress=progress))
        found = with_estimates(found, fits[-1])
    return Identification(_titled(found, fits), tuple(fits), provenance=fits[-1].provenance)


def _read_response(given: Given, layout: Layout, columns: Choices | None, progress: Progress | None) -> Recording:
    """The recorded response of a case: of an elbow its angle at least, of others any of their signals."""
    if layout is ELBOW:
        needed, optional = (Role.TIME, Role.ANGLE), (Role.FORCE, Role.HARNESS)
        return read_recording(given, needed, optional, columns, units=ROLES, progress=progress)
    return read_signals(given, tuple(layout.signals), layout.units, columns, progress=progress)


def _beside(case: Case, given: Given | None) -> Given | None:
    """A file of the working folder; where that has none of this name, the one in the case's own folder."""
    if not isinstance(given, str | Path) or Path(given).exists():
        return given
    own = case.folder / given
    # A case from elsewhere must not read outside its folder, by a link either.
    inside = own.resolve().is_relative_to(case.folder.resolve())
    return own if inside and own.exists() else given


def with_estimates(case: Case, fit: BenchFit) -> Case:
    """The case with what a bench test identified, marked "measured" and with tolerances."""
    values = {}
    for estimate in fit.estimates:
        section, dot, _ = estimate.name.partition(".")
        field = estimate.name in case.parameters or (dot and " " not in section)
        if not field or not (estimate.identified or estimate.kept):
            continue
        note = f"{fit.bench}, {Path(fit.source).name}" + (f"; {estimate.note}" if estimate.note else "")
        unit = case.unit(estimate.name)
        tolerance = None if estimate.tolerance is None else rounded(estimate.tolerance, *unit)
        values[estimate.name] = Parameter(rounded(estimate.value, *unit), *unit, "measured", note, tolerance)
    return case.with_values(values, fit.source) if values else case


def _titled(case: Case, fits: Sequence[BenchFit]) -> Case:
    names = ", ".join(Path(fit.source).name for fit in fits)
    return case.with_values({"title": f"{case.title}; identified from {names}"[:2000]}, "identify")
