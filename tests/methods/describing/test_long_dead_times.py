"""However long a dead time is a prediction ends, and says which cycles it leaves open."""

from __future__ import annotations

import time

import numpy as np
import pytest
from scipy.optimize import brentq

import eppanalysis as epp
from eppanalysis.results import Status
from tests.shared import mostly_slow


def modes(late: float, n: int) -> list[float]:
    """The slowest frequencies [rad/s] at which 5 exp(-s late)/(s (s + 1)^2) is real and negative."""

    def turned(w: float) -> float:
        return 0.5 * np.pi + 2.0 * np.arctan(w) + w * late

    return [brentq(lambda w, k=k: turned(w) - (2 * k + 1) * np.pi, 1e-12, 10.0) for k in range(n)]


@pytest.mark.parametrize("late", mostly_slow([10.0, 3600.0, 1e4], [10.0]))
def test_the_slowest_cycles_are_told_and_what_is_open_is_said(late: float) -> None:
    """At each mode a relay of threshold and level one has two amplitudes, roots of a quadratic."""
    begun = time.process_time()
    found = epp.predict_limit_cycles(
        epp.LureSystem.from_tf(([5.0], [1.0, 2.0, 1.0, 0.0]), epp.RelayDeadZone(1.0), delay=late)
    )
    assert time.process_time() - begun < 20.0
    frequencies = sorted({round(c.omega * late, 6) for c in found})
    assert frequencies == pytest.approx([w * late for w in modes(late, len(frequencies))], abs=2e-6)
    for cycle in found:
        a, w = cycle.amplitude("x"), cycle.omega
        share = (np.pi * w * (1.0 + w * w) / 20.0) ** 2  # gain 4/(pi a) sqrt(1 - 1/a^2) = w (1 + w^2)/5, squared
        root = np.sqrt(1.0 - 4.0 * share)
        squares = [2.0 / (1.0 + root), (1.0 + root) / (2.0 * share)]
        assert min(abs(a / np.sqrt(square) - 1.0) for square in squares) < 1e-6
    assert found.status is (Status.CONVERGED if late == 10.0 else Status.INCOMPLETE)
    assert ("are open, because the dead time" in found.search) is (late > 10.0)


def test_a_plant_that_is_fast_beside_its_dead_time_is_searched_as_far_as_is_said() -> None:
    """20/(1e-4 s + 1) behind 100 s: the gain suffices up to 2e5 rad/s, where the phase has turned 3e6 times."""
    found = epp.predict_limit_cycles(epp.LureSystem.from_tf(([20.0], [1e-4, 1.0]), epp.Saturation(), delay=100.0))
    assert found.status is Status.INCOMPLETE and "Faster cycles than 1.27 Hz are open, because" in found.search
    slowest = np.sort([c.omega for c in found])[:3]
    assert slowest == pytest.approx(np.array([1.0, 3.0, 5.0]) * np.pi / 100.0, rel=1e-5)


def test_a_delay_of_many_samples_leaves_open_what_it_leaves_out() -> None:
    """Between half the sample rate and rest a delay of 1e5 samples turns the phase 5e4 times."""
    loop = epp.LureSystem.build([[0.9]], [[0.1]], [[-20.0]], [epp.Saturation()], time_step=0.01, delays=[1e3])
    found = epp.predict_limit_cycles(loop)
    assert found.status is Status.INCOMPLETE and "are open, because" in found.search and len(found) > 10


def test_a_run_with_more_samples_on_their_way_than_a_matrix_holds_is_refused() -> None:
    loop = epp.LureSystem.build([[0.9]], [[0.1]], [[-20.0]], [epp.Saturation()], time_step=0.01, delays=[1e3])
    for analysis in (epp.simulate, epp.find_limit_cycles):
        with pytest.raises(epp.EppError, match="its dead times hold 100000 samples.*expected at most 4000"):
            analysis(loop, **({"t_end": 1.0} if analysis is epp.simulate else {}))


@pytest.mark.slow
def test_a_search_goes_on_where_a_run_has_more_switches_than_its_history_holds() -> None:
    loop = epp.LureSystem.from_tf(([20.0], [1e-4, 1.0]), epp.Saturation(), delay=100.0)
    begun = time.process_time()
    found = epp.find_limit_cycles(loop)
    assert time.process_time() - begun < 60.0
    assert found.status is Status.UNDECIDED and "no orbit was closed for the cycles predicted" in str(found)
