"""What sampled controllers cannot be part of: motions of which they see fewer than two samples a turn."""

from __future__ import annotations

import pytest

import eppanalysis as epp


def resonance(sample_time: float) -> epp.LureSystem:
    """A relay with hysteresis behind a sampled gain, before a resonance at 1 rad/s."""
    return epp.Diagram(
        parts={
            "law": epp.blocks.Gain(gain=1.0, sample_time=sample_time),
            "relay": epp.HysteresisRelay(-0.001, 0.001),
            "plant": epp.blocks.TransferFunction(num=[1.0], den=[1.0, 0.2, 1.0]),
        },
        connect=["-plant -> law", "law -> relay", "relay -> plant"],
    ).to_system()


@pytest.mark.parametrize("sample_time", [0.5, 3.0, 5.0, 10.0, 20.0])
def test_no_cycle_through_a_sampler_has_fewer_than_two_samples_a_turn(sample_time) -> None:
    cycles = epp.predict_limit_cycles(resonance(sample_time))
    assert all(cycle.period >= 2.0 * sample_time for cycle in cycles)
    assert bool(cycles) or sample_time > 3.0


def test_a_fast_cycle_beside_a_slow_controller_stays() -> None:
    # The relay keeps its own loop swinging; what the controller holds hardly moves its input.
    parts = {
        "relay": epp.HysteresisRelay(-0.1, 0.1),
        "plant": epp.blocks.TransferFunction(num=[1.0], den=[1.0, 3.0, 3.0, 1.0]),
    }
    slow = {"law": epp.blocks.Gain(gain=0.01, sample_time=50.0)}
    alone = epp.Diagram(parts=parts, connect=["-plant -> relay", "relay -> plant"]).to_system()
    both = epp.Diagram(
        parts=parts | slow, connect=["-plant - law -> relay", "relay -> plant", "plant -> law"]
    ).to_system()
    (own,), (cycle,) = epp.predict_limit_cycles(alone), epp.predict_limit_cycles(both)
    assert cycle.period == pytest.approx(own.period, rel=1e-3) and cycle.period < 50.0
    assert cycle.may_not_exist and not own.may_not_exist
