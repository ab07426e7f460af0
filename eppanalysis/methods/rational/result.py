"""What a rational model is: a state space, its poles, and how far it lies off the data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from eppanalysis.arguments import checked
from eppanalysis.arrays import Array, ComplexArray
from eppanalysis.models.elements.base import Nonlinearity
from eppanalysis.models.systems.linear import StateSpace
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.results import Result, Status, require_converged
from eppanalysis.shown import frame_of

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes


@dataclass(frozen=True, eq=False, repr=False)
class RationalModel(Result):
    """Stable rational model of a measured frequency response.

    Attributes
    ----------
    status : Status
        NOT_CONVERGED where it does not meet the data.
    system : StateSpace
        The model without its dead time.
    poles : complex array
        Integrators included [rad/s].
    integrators : int
        Number of poles at zero.
    delay : float
        Dead time that belongs to it [s].
    misfit, typical_misfit : float
        Largest, and root mean square, of the distance to the data over their magnitude.
    omega, measured, fitted : array, complex array, complex array, shape (m,)
        Frequencies [rad/s], data and model at them, dead time included.
    """

    status: Status
    system: StateSpace
    poles: ComplexArray
    integrators: int
    delay: float
    misfit: float
    typical_misfit: float
    omega: Array
    measured: ComplexArray
    fitted: ComplexArray

    in_json = "status message=status.value poles integrators delay misfit typical_misfit provenance"

    @checked
    def loop(self, element: Nonlinearity, feedback: int = -1, name: str = "loop") -> LureSystem:
        """The loop of the model and an element, for everything that needs states.

        Raises
        ------
        NotConverged
            If the model does not meet the data.
        ModelError
            If the element has several inputs or outputs, or `feedback` is neither -1 nor 1.
        """
        require_converged(self.status, "rational model")
        return LureSystem.from_tf(self.system, element, delay=self.delay, feedback=feedback, name=name)

    def __str__(self) -> str:
        """Order and misfit."""
        what = f"Rational model with {len(self.poles)} poles, {self.integrators} of them at zero"
        late = f", and a dead time of {self.delay:.4g} s" if self.delay else ""
        fits = f"off the data by {100.0 * self.misfit:.2g} % at most, {100.0 * self.typical_misfit:.2g} % typically"
        ends = "" if self.status.ok else ": it does not meet them (unstable poles or a dead time in them?)"
        return f"{what}{late}; {fits}{ends}."

    def to_frame(self) -> pandas.DataFrame:
        """One row a measured frequency: data and model."""
        rows = [
            {"omega": w, "measured": data, "fitted": model}
            for w, data, model in zip(self.omega, self.measured, self.fitted, strict=True)
        ]
        return frame_of(rows, {"omega": "rad/s"})

    def in_brief(self) -> pandas.DataFrame:
        """Order and misfit."""
        row = {"poles": len(self.poles), "integrators": self.integrators, "delay": self.delay}
        return frame_of([row | {"misfit": self.misfit, "typical_misfit": self.typical_misfit}], {"delay": "s"})

    @checked
    def plot(self, ax: Axes | None = None) -> Axes:
        """Bode diagram of data and model."""
        return self.drawn("plot_rational", ax)
