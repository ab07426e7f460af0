"""Where cycles of the DF begin, over other parameters: the nonlinear programme, carried from place to place."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from eppanalysis.errors import EppError, ModelError
from eppanalysis.methods.bounds.balanced import BoundProblem, spread, steady_loop
from eppanalysis.methods.bounds.elasticity import harmonic_slopes
from eppanalysis.methods.bounds.fold import Cycle, Fold, Programmes, extreme
from eppanalysis.methods.describing.predict import predicted_cycles
from eppanalysis.methods.harmonic.loop import inputs_of

Place = tuple[float, ...]

#: Values of the range at which the DF is evaluated, and the reach of the programme from there.
N_SCAN, _FAR = 9, 0.7


@dataclass(eq=False)
class Programme:
    """The least value of the bounded parameter of all cycles of the DF, as a nonlinear programme, over places."""

    here: Callable[[Place], BoundProblem]  # the question at a place
    widths: dict[str, float]  # the parameters that run, and how far each does [SI]
    sign: float  # {1, -1}: 1 where the parameter is to be large
    written: Programmes = field(default_factory=Programmes)
    folds: dict[Place, Fold | None] = field(default_factory=dict)  # what was computed already
    #: From what a place nearby begins, with the number of the loop's states.
    known: dict[Place, tuple[int, Fold]] = field(default_factory=dict)

    def bound(self, place: Place) -> Fold | None:
        """The programme's solution at a place; None where it has none within the range."""
        if place not in self.folds:
            self.folds[place] = self._bound(place)
        return self.folds[place]

    def slopes(self, place: Place, fold: Fold, names: Mapping[str, float]) -> dict[str, float]:
        """Derivative of a solution at a place by parameters, from the multipliers."""
        return harmonic_slopes(self.here(place), self.written, fold, names)

    def _bound(self, place: Place) -> Fold | None:
        here = self.here(place)
        n_states = here.case_at(here.high).to_system().A.shape[0]
        # The unknowns of a loop with another number of states do not fit this one's equations.
        known = {at: fold for at, (n, fold) in self.known.items() if n == n_states}
        try:
            model = here.model()
            if known:
                near = min(known, key=lambda at: distance(self.widths, at, place))
                found = extreme(model, self.written, known[near], self.sign)
                if found is not None and not found.at_end:
                    self.known[place] = n_states, found
                    return found
            folds = [extreme(model, self.written, start, self.sign, _FAR) for start in self._starts(here)]
        except EppError:
            return None
        inside = [f for f in folds if f is not None and not f.at_end]
        least = min(inside, key=lambda f: self.sign * f.cycle.value, default=None)
        if least is not None:
            self.known[place] = n_states, least
        return least

    def _starts(self, here: BoundProblem) -> list[Cycle]:
        """The cycles of the DF at the first value, from the safe end on, that has any."""
        safe, wanted = here.ends(self.sign)
        for value in spread(safe, wanted, N_SCAN)[1:]:
            case = here.case_at(value)
            try:
                cycles = predicted_cycles(case)
            except ModelError:  # an element without a describing function
                return []
            if cycles:
                loop = steady_loop(case)
                return [Cycle(value, inputs_of(loop, c)[:, :2], c.omega) for c in cycles]
        return []


def distance(widths: Mapping[str, float], one: Place, other: Place) -> float:
    """Between two places, in shares of how far each parameter runs."""
    return float(np.hypot.reduce([(a - b) / w for a, b, w in zip(one, other, widths.values(), strict=True)]))
