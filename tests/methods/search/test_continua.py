"""Cycles that are one of a continuum: which of them are there, and that a neutral one is not called unstable."""

from __future__ import annotations

import numpy as np
import pytest

import eppanalysis as epp

#: Half width of the band and change of speed at each pulse of a jet.
BAND, KICK = 0.5, 1.0
#: A sigma-delta modulator of second order: reference over input, and feedbacks into both integrators.
SHARE, FEEDBACK = 0.05, (2.24, 4.48)


def _jet(speed: float) -> epp.LureSystem:
    build = epp.AutomatonBuilder()
    idle = build.mode("idle")
    for sign, name in ((1.0, "up"), (-1.0, "down")):
        build.guard(name, idle, idle, on_input=sign, constant=-BAND, impulse=KICK / BAND)
    valve = epp.AutomatonElement(build.build(idle))
    return epp.LureSystem.build([[0.0, 1.0], [0.0, 0.0]], [[0.0], [-1.0]], [[1.0, 0.0]], [valve], x0=[0.0, speed])


@pytest.mark.slow
@pytest.mark.xfail(
    strict=True,
    reason="a continuum is shown by the one member that a run came to; one motion that carries its family gives the "
    "range of period and size",
)
@pytest.mark.parametrize("speed", [0.3, 0.05])
def test_a_continuum_is_told_by_the_range_of_its_periods(speed):
    # Closed form: a speed v at one edge and KICK - v at the other, 0 < v < KICK; fastest at half the kick.
    fastest = 4.0 * (2.0 * BAND) / KICK
    found = epp.find_limit_cycles(_jet(speed))
    assert found.n_continua == 1
    told = " ".join([str(found), *(c.note for c in found)])
    assert f"{fastest:g} s" in told or f"{1.0 / fastest:g} Hz" in told


def _modulator() -> epp.LureSystem:
    return epp.LureSystem.build(
        [[1.0, 0.0], [1.0, 1.0]], [[-FEEDBACK[0]], [-FEEDBACK[1]]], [[0.0, 1.0]], [epp.Relay()],
        constant_state=[SHARE * FEEDBACK[0], 0.0], x0=[1e-12, 1e-12], time_step=2.5e-7,
    )  # fmt: skip


def _iterated(state: np.ndarray, n: int) -> np.ndarray:
    """The modulator by its own equations, n samples on; shape (n + 1, 2)."""
    rows = np.empty((n + 1, 2))
    a, b = state
    for k in range(n + 1):
        rows[k] = a, b
        bit = 1.0 if b > 0.0 else -1.0
        a, b = a + SHARE * FEEDBACK[0] - FEEDBACK[0] * bit, b + a - FEEDBACK[1] * bit
    return rows


@pytest.mark.slow
def test_a_modulator_that_cycles_for_ever_is_neutral():
    found = epp.find_limit_cycles(_modulator())
    assert len(found) and "none of them stable" not in str(found) and str(found).startswith("Neutral limit cycles")
    for cycle in found:
        n = round(cycle.period / 2.5e-7)
        motion = _iterated(cycle.state, 8 * n)
        assert motion[n] == pytest.approx(motion[0], abs=1e-9)
        # What a disturbance leaves grows by as much each turn: no multiplier is beyond one.
        beside = _iterated(cycle.state + [1e-7, 0.0], 8 * n) - motion
        away = np.diff(np.abs(beside[::n]).max(axis=1)[1:])
        assert away == pytest.approx(away[0], rel=1e-6) and away[0] > 0.0
        assert cycle.stable is None and "neutral" in cycle.stability_criterion


_FOLLOWING = """
kind = "diagram"
title = "An element that follows its input all round a cycle"
connect = ["-plant -> relay", "relay -> lag", {wires}]
[blocks]
lag = {{ kind = "transfer_function", num = [1], den = [1, 1] }}
plant = {{ kind = "transfer_function", num = [4], den = [1, 2, 1], start = [0.5, 0] }}
[elements]
relay = {{ element = "hysteresis_relay", lower = -0.1, upper = 0.1 }}
{element}
[run]
t_end = "100 s"
"""


def test_a_rate_limit_that_is_never_met_changes_nothing():
    free = _FOLLOWING.format(wires='"lag -> plant"', element="")
    limiter = 'limiter = { element = "rate_limiter", rate = 100.0 }'
    limited = _FOLLOWING.format(wires='"lag -> limiter", "limiter -> plant"', element=limiter)
    cases = [epp.case_from_text(text, "loop") for text in (free, limited)]
    cycle, other = (epp.exact_orbit(case, epp.simulate(case).limit_cycle) for case in cases)
    assert other.period == pytest.approx(cycle.period, rel=1e-12) and "continuum" not in other.stability_criterion
    assert cycle.multipliers is not None and other.multipliers is not None
    n = cycle.multipliers.size
    assert other.multipliers[:n] == pytest.approx(cycle.multipliers, abs=1e-9) and not other.multipliers[n:].any()
