"""What a design returns: the best values, what limits them, what that costs, and how they were confirmed."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from eppanalysis.arrays import Array
from eppanalysis.limits import Limit, Printed
from eppanalysis.methods.bounds.result import Turn
from eppanalysis.methods.bounds.sizes.allowed import Allowed
from eppanalysis.methods.design.goal import Kept, Sense
from eppanalysis.readable import percent, quantity, words
from eppanalysis.results import Brief, LimitCycle, Result, Status
from eppanalysis.shown import frame_of

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes

_NAN = float("nan")
#: Share of a range that is rounding.
_ROUNDING = 1e-9
#: What is said where neither a cycle nor what is kept limits the objective.
INSIDE = "The objective is best inside what is free of cycles"


@dataclass(frozen=True, eq=False, repr=False)
class Optimum(Brief):
    """The best values of the tuned parameters.

    Attributes
    ----------
    at : dict of str to float
        The tuned parameters where the active constraint just holds [SI]; empty where nothing is feasible.
    values : dict of str to float
        The same a margin to the safe side, where the tests were made: the design to be built [SI].
    objective : float
        The objective there [SI].
    kind : Turn
        What of the limit cycle limits it: a fold, a border collision, the allowed size; END: nothing but the range of
        the bounded parameter; UNKNOWN where `active` says what does.
    active : str
        The measure of the linearised loop that is just kept, or that the objective is best inside; else empty.
    at_end : str
        Ends of the ranges of the other parameters that limit it, too ("T is at the upper end of its range"); empty
        where the optimum lies inside.
    first_order : float
        The bounded parameter as the DF proposes it at these values of the others [SI]; nan where it proposes none.
    prices : dict of str to float
        Relative change of the optimum for a relative change of each parameter (and of what is "allowed").
    frequency : float
        Of the cycle at the active constraint [Hz].
    confirmed : bool
        No cycle (that is too large) a margin to the safe side, by the exact search and by runs; one a margin beyond.
    n_runs, n_settled, n_shrinking : int
        Runs of the test; those that came to rest (or to a cycle that is allowed); those that have not yet, but are
        smaller than the cycle and still shrink, as beside a fold many do for thousands of periods.
    n_machines : int
        Machines drawn from the tolerances, each run from a start of its own; all come to rest where it is confirmed.
    orbit : LimitCycle or None
        The exact orbit at the active constraint.
    off : dict of str to float
        The active corner of the tolerances: which parameters are off, -1 or 1 times theirs.
    evaluated : array, shape (k, 2)
        Values of the other parameter with the exact bound there, sorted [SI].
    message : str
        What is missing, or which constraint would have to give.
    """

    at: dict[str, float]
    values: dict[str, float] = field(default_factory=dict)
    objective: float = _NAN
    kind: Turn = Turn.UNKNOWN
    active: str = ""
    at_end: str = ""
    first_order: float = _NAN
    prices: dict[str, float] = field(default_factory=dict)
    frequency: float = _NAN
    confirmed: bool = False
    n_runs: int = 0
    n_settled: int = 0
    n_shrinking: int = 0
    n_machines: int = 0
    orbit: LimitCycle | None = None
    off: dict[str, float] = field(default_factory=dict)
    evaluated: Array = field(default_factory=lambda: np.zeros((0, 2)))
    message: str = ""

    in_json = (
        "at values objective kind active at_end describing_function=first_order prices frequency confirmed n_runs "
        "n_settled n_shrinking n_machines off evaluated message"
    )

    @property
    def feasible(self) -> bool:
        """Whether there is any design without a cycle (that is too large)."""
        return bool(self.at)


@dataclass(frozen=True, eq=False, repr=False)
class Design(Result):
    """The best design without a limit cycle, or with none above what is allowed.

    Attributes
    ----------
    case : str
        Name of the case.
    objective : str
        The parameter, or the measure of the linearised loop, that is maximised or minimised.
    goal : Sense
        The largest value of the objective, or the smallest.
    tune : dict of str to (float, float)
        Ranges of the tuned parameters [SI].
    optimum : Optimum
        The best values, what is active there, and whether tests on both sides confirm it.
    bounded : str
        The tuned parameter that cycles bound at each place of the others; by default the objective.
    kept : tuple of Kept
        Measures of the linearised loop kept at or above their values; a tracking error at or below its value.
    tolerances : dict of str to float
        Relative half-widths within which the optima hold.
    front_over : str
        Parameter of the front; empty without one.
    front : tuple of (float, Optimum)
        Its values [SI], and the optimum at each.
    front_own : float
        Its value in the case itself [SI], to which `optimum` belongs.
    margin : float
        How far inside the active constraint the design is tested, as a share of the bounded parameter's value there.
    allowed : Allowed or None
        The largest stable cycle that is allowed; None where no cycle is allowed.
    readable : dict of str to (str, float)
        The unit that people use for each parameter, and the factor from SI to it.
    units : dict of str to str
        Their SI units.
    not_covered : str
        What bounds that the search says do not cover, in a sentence; empty where they are exact.
    """

    case: str
    objective: str
    goal: Sense
    tune: dict[str, tuple[float, float]]
    optimum: Optimum
    bounded: str = ""
    kept: tuple[Kept, ...] = ()
    tolerances: dict[str, float] = field(default_factory=dict)
    front_over: str = ""
    front: tuple[tuple[float, Optimum], ...] = ()
    front_own: float = _NAN
    margin: float = _NAN
    allowed: Allowed | None = None
    readable: dict[str, tuple[str, float]] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    not_covered: str = ""

    in_json = (
        "objective goal tune bounded kept tolerances allowed margin not_covered status sentence optimum front_over "
        "front=_front provenance"
    )

    @property
    def values(self) -> dict[str, float]:
        """The design to be built [SI]: what `with_values` of the case takes."""
        return self.optimum.values

    @property
    def status(self) -> Status:
        """CONVERGED where all optima are confirmed (or none is feasible, for a reason), else UNDECIDED.

        INCOMPLETE where something is not covered alone.
        """
        all_of_them = [self.optimum, *(o for _, o in self.front)]
        if not all(o.confirmed or not o.feasible for o in all_of_them):
            return Status.UNDECIDED
        return Status.INCOMPLETE if self.not_covered else Status.CONVERGED

    def text(self, name: str, value: float) -> str:
        """A value of a parameter in the unit that people use."""
        return quantity(value, self.units.get(name, ""), shown=self.readable[name])

    def __str__(self) -> str:
        return self.sentence

    def to_frame(self) -> pandas.DataFrame:
        """One row a design: the optimum, and behind it those of the front, at its values [SI]."""
        rows = [self._row(self.optimum, self.front_own), *(self._row(found, value) for value, found in self.front)]
        return frame_of(rows, {**self.units, "first_order": self.units.get(self.limit, ""), "frequency": "Hz"})

    def in_brief(self) -> pandas.DataFrame:
        """The table without the column that says what is missing in each row."""
        return self.to_frame().drop(columns="message")

    @property
    def limit(self) -> str:
        """The parameter that cycles bound."""
        return self.bounded or self.objective

    def _row(self, found: Optimum, over: float = _NAN) -> dict[str, object]:
        return {
            **({self.front_over: over} if self.front_over else {}),
            **({} if self.objective in self.tune else {self.objective: found.objective}),
            **{name: found.at.get(name, _NAN) for name in self.tune},
            "first_order": found.first_order,
            "frequency": found.frequency,
            "active": found.active or str(found.kind) if found.feasible else "infeasible",
            "confirmed": found.confirmed,
            "message": found.message,
        }

    @property
    def sentence(self) -> str:
        """The optimum, what limits it, and whether that is confirmed."""
        best = self.optimum
        rule = "no limit cycle" if self.allowed is None else f"no stable limit cycle above {self.allowed}"
        if not best.feasible:
            return f"No design within these ranges has {rule}: {best.message}"
        others = ", ".join(f"{words(n)} {self.inside(best, n)}" for n in best.at if n != self.objective)
        where = f", at {others}" if others else ""
        kept = "".join(f" and a {k} {k.side}" for k in self.kept)
        value = self.inside(best, self.objective)
        told = f"The {self.goal} {words(self.objective)} with {rule}{kept} is {value}{where}. {self._limits(best)}"
        if best.at_end:
            told += f" {best.at_end}."
        told += self._outside(best)
        if len(self.tune) > 2:
            told += " The search climbed from the describing function's proposal; a better design is not excluded."
        return f"{told} {self._tests(best)} {self.not_covered}".rstrip()

    def inside(self, found: Optimum, name: str) -> str:
        """A tuned parameter or the objective at an optimum, rounded to the side on which there is no cycle."""
        at = found.at.get(name, found.objective)
        away = found.values.get(name, at) - at  # the design to be built is inside by the margin
        unit, factor = self.readable[name]
        up = away > 0 or (away == 0 and name == self.objective and self.goal is Sense.SMALLEST)
        if away == 0 and name != self.objective:
            return self.text(name, at)
        return Printed(unit, factor).computed(Limit(at, up))

    def value_of(self, found: Optimum) -> float:
        """The objective of an optimum [SI]."""
        return found.at.get(self.objective, found.objective)

    def _outside(self, best: Optimum) -> str:
        """That the margin takes the design out of a range in which it was to be, in a sentence."""
        for name, (low, high) in self.tune.items():
            value, slack = best.values.get(name, low), _ROUNDING * (high - low)
            if not low - slack <= value <= high + slack:
                design, *ends = (self.text(name, v) for v in (value, low, high))
                margin = f"{100 * self.margin:g} %"
                return f" A margin of {margin} takes {name} to {design}, out of its range of {ends[0]} to {ends[1]}."
        return ""

    def _limits(self, best: Optimum) -> str:
        if best.kind is Turn.END:
            return f"Only its own range limits it: {self.limit} is at the end of it."
        if best.kind is Turn.UNKNOWN:
            kept = best.active in map(str, self.kept)
            return f"The active constraint is the {best.active}." if kept else f"{INSIDE}."
        what = {
            Turn.FOLD: "a limit cycle that is born there (fold)",
            Turn.CORNER: "a limit cycle that is born there (border collision)",
            Turn.BREAK: "a limit cycle, which is not found beyond (end of the branch)",
            Turn.LINEAR: "an oscillation, as the loop ceases to be stable there (linear limit)",
            Turn.SIZE: "the stable limit cycle, which reaches the allowed size there",
            Turn.STABILITY: "a limit cycle that becomes stable there",
            Turn.SEARCH: "a limit cycle that is found beyond (by the search)",
        }[best.kind]
        told = f"Limited by {what}, at {best.frequency:.4g} Hz."
        off = [f"{n} {'+' if s > 0 else '-'}{percent(self.tolerances[n])}" for n, s in best.off.items() if s]
        own = self.tolerances.get(self.limit, 0.0)
        off += [f"{self.limit} itself off by {percent(own)}"] if own else []
        return f"{told} That is at the worst corner of the tolerances: {', '.join(off)}." if off else told

    def _tests(self, best: Optimum) -> str:
        if best.confirmed:
            if best.kind in (Turn.END, Turn.UNKNOWN):  # what limits it is no cycle, so that there is none beyond
                return "The exact search finds no such cycle there."
            slow = f", {best.n_shrinking} that are below the cycle's size and still shrink" if best.n_shrinking else ""
            runs = f"{best.n_settled} runs at rest{' or on what is allowed' if self.allowed else ''}{slow}"
            all_of_them = f" All of {best.n_machines} machines within the tolerances come to rest, too."
            told = f"Confirmed {100 * self.margin:g} % to both sides: no such orbit inside ({runs}), one beyond."
            return told + all_of_them * (best.n_machines > 0)
        return f"Not confirmed: {best.message}"

    def _front(self) -> list[dict[str, object]]:
        return [{"value": value, **o.to_dict()} for value, o in self.front]

    def plot(self, ax: Axes | None = None) -> Axes:
        """The objective over the other parameter with its optimum, or over the parameter of the front."""
        return self.drawn("plot_design", ax)
