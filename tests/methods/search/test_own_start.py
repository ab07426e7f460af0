"""The run that a loop makes by itself, from rest at zero, is one of those of its search."""

from __future__ import annotations

import pytest

import eppanalysis as epp
from tests.shared import mostly_slow


def _tripping(band: float, trip: float, far: float) -> epp.AutomatonElement:
    """A relay with hysteresis that is switched off for good beyond `trip`; its farthest threshold does nothing.

    With three inputs it has no describing function.
    """
    build = epp.AutomatonBuilder(n_inputs=3)
    high, low = build.mode("high", constant=1.0), build.mode("low", constant=-1.0)
    off, away = (build.mode(name, from_input=[1.0, 0.0, 0.0]) for name in ("off", "away"))
    build.guard("down", high, low, on_input=[-1.0, 0.0, 0.0], constant=-band)
    build.guard("up", low, high, on_input=[1.0, 0.0, 0.0], constant=-band)
    for sign in (1.0, -1.0):
        for mode in (high, low):
            build.guard("trips", mode, off, on_input=[sign, 0.0, 0.0], constant=-trip)
        build.guard("goes away", off, away, on_input=[sign, 0.0, 0.0], constant=-far)
    return epp.AutomatonElement(build.build(low))


@pytest.mark.parametrize(
    ("band", "trip", "far"),
    mostly_slow([(0.01, 0.02, 100.0), (0.1, 0.15, 50.0), (1e-3, 2e-3, 7.0)], [(0.1, 0.15, 50.0)]),
)
def test_what_the_own_run_ends_on_is_found_though_no_other_start_leads_there(band, trip, far):
    loop = epp.LureSystem.build([[0.0]], [[-1.0]], [[1.0], [0.0], [0.0]], [_tripping(band, trip, far)], x0=[0.0])
    run = epp.simulate(loop, t_end=40.0 * band)
    # Closed form: to and fro between the thresholds, at rate one.
    assert run.limit_cycle is not None and run.limit_cycle.period == pytest.approx(4.0 * band, rel=1e-9)
    found = epp.find_limit_cycles(loop)
    assert [c.period for c in found.stable] == [pytest.approx(4.0 * band, rel=1e-9)]
    assert found.settles and str(found).startswith("Can oscillate")


@pytest.mark.parametrize(("gap", "back"), [(1.0, 1.0), (2.0, 1.0), (1.0, 1e-3)])
def test_a_rest_that_one_side_alone_leaves_is_told_with_what_a_play_holds_there(gap: float, back: float) -> None:
    """A play before an integrator that is fed back with the wrong sign, begun where the gap ends: inside it rests.

    At gap/2 its output is from zero on, whatever it was before. Further in it stays at zero, and so does the rate.
    """

    def loop(x0: float) -> epp.LureSystem:
        return epp.LureSystem.build(
            [[0.0]], [[1.0]], [[back]], [epp.Play(gap)], constant_input=[gap / 2.0], memory=[-0.2], x0=[x0]
        )

    assert epp.simulate(loop(0.0), t_end=50.0).status.name == "SETTLED"
    found = epp.find_limit_cycles(loop(0.0))
    assert found.settles and found.diverges and not len(found)
    assert str(found).endswith("some starts settle at rest and some grow without bound.")
