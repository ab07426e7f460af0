"""The check of an element: rules with known faults, shipped elements without, and energies against areas of loops."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest

import eppanalysis as epp
from tests.models.elements.test_elements import SHIPPED, lag_behind
from tests.shared import mostly_slow


def kinds(element: epp.Nonlinearity) -> set[str]:
    return {finding.kind for finding in epp.check_element(element, amplitudes=[2.0]).findings}


def made(*guards: dict[str, Any], gains: tuple[float, ...] = (0.0, 1.0, 2.0)) -> epp.AutomatonElement:
    """Three modes with gains, and guards between them."""
    build = epp.AutomatonBuilder()
    for i, gain in enumerate(gains):
        build.mode(f"mode {i}", from_input=gain)
    for i, guard in enumerate(guards):
        build.guard(f"guard {i}", **guard)
    return epp.AutomatonElement(build.build())


@pytest.mark.parametrize("name", [
    "play", "hysteresis relay", "jump and follow", "backlash compensator with travel", "saturation", "relay",
    "friction",
])  # fmt: skip
def test_shipped_elements_are_deterministic_and_do_not_chatter(name: str) -> None:
    found = epp.check_element(SHIPPED[name], amplitudes=[5.0])
    assert found.deterministic and not found.can_chatter and not found.findings


def test_a_contact_with_a_damper_does_not_chatter_though_its_torque_jumps() -> None:
    found = epp.check_element(epp.LockPin(0.1, 10.0, 0.5, "classical"), amplitudes=[1.0])
    assert found.deterministic and not found.can_chatter


def test_a_compensator_that_jumps_at_each_reversal_can_chatter() -> None:
    found = epp.check_element(epp.BacklashCompensator(0.6), amplitudes=[1.0])
    assert found.can_chatter and found.deterministic
    assert "follow one another without a gap in mode 'leads up'" in str(found)


def test_two_guards_on_one_surface_overlap() -> None:
    to_one = {"mode": 0, "target": 1, "on_input": 2.0, "constant": -3.0}
    assert kinds(made(to_one, {"mode": 0, "target": 2, "on_input": 1.0, "constant": -1.5})) == {"overlap"}
    # The same event twice is not ambiguous.
    assert kinds(made(to_one, {**to_one, "on_input": 4.0, "constant": -6.0})) == set()


def test_two_guards_overlap_where_their_mode_is_entered_beyond_both() -> None:
    build = epp.AutomatonBuilder()
    begins, middle, far, farther = (build.mode(name, from_input=1.0) for name in ("begins", "middle", "far", "farther"))
    build.guard("begins", begins, middle, on_input=1.0, constant=2.0)
    build.guard("reaches 1", middle, far, on_input=1.0, constant=-1.0)
    build.guard("reaches 2", middle, farther, on_input=1.0, constant=-2.0)
    # A run may begin at any input; where it does not begin ahead of the middle, that is entered at -2 alone.
    anywhere = epp.check_element(epp.AutomatonElement(build.build(begins)), amplitudes=[0.5])
    assert not anywhere.deterministic and anywhere.findings[0].inputs[0] > 2.0
    assert kinds(epp.AutomatonElement(build.build(far))) == set()


def test_a_relay_without_a_gap_chatters_and_one_with_a_gap_does_not() -> None:
    def relay(gap: float) -> epp.AutomatonElement:
        return made(
            {"mode": 0, "target": 1, "on_input": 1.0}, {"mode": 1, "target": 0, "on_input": -1.0, "constant": -gap},
            gains=(0.0, 0.0),
        )  # fmt: skip

    build = epp.AutomatonBuilder()
    low, high = build.mode("low", constant=-1.0), build.mode("high", constant=1.0)
    build.guard("up", low, high, on_input=1.0)
    build.guard("down", high, low, on_input=-1.0)
    assert kinds(epp.AutomatonElement(build.build())) == {"chatter"}
    assert kinds(relay(0.0)) == set()  # nothing jumps
    for gap in (1e-6, 1e3):
        assert not epp.check_element(epp.HysteresisRelay(-gap, gap), amplitudes=[9.0 * gap]).can_chatter


def test_events_without_end_are_found_where_they_are() -> None:
    # Above 1 mode 0 leads to mode 1, which leads back above one half: at any input above 1 without end.
    found = epp.check_element(made(
        {"mode": 0, "target": 1, "on_input": 1.0, "constant": -1.0},
        {"mode": 1, "target": 0, "on_input": 1.0, "constant": -0.5},
    ), amplitudes=[0.4])  # fmt: skip
    endless = [f for f in found.findings if f.kind == "endless"]
    assert endless and found.deterministic is False and found.can_chatter and endless[0].inputs[0] > 0.5


@pytest.mark.parametrize(
    "name", mostly_slow(["play", "hysteresis relay", "falling hysteresis relay", "jump and follow"], ["play"])
)
def test_the_energy_is_the_area_that_a_slow_loop_encloses(name: str) -> None:
    element, size = SHIPPED[name], 2.9
    phase = np.linspace(0.0, 4.0 * np.pi, 40_001)
    x, memory, y = size * np.sin(phase), None, []
    for value in x:
        out, memory = element.output(float(value), memory)
        y.append(float(out))
    x, y = x[20_000:], np.array(y)[20_000:]
    area = float(np.sum((y[1:] + y[:-1]) / 2 * np.diff(x)))
    over_time = float(np.sum((x * y)[1:] + (x * y)[:-1]) / 2 * (phase[1] - phase[0]))
    found = epp.check_element(element, amplitudes=[size])
    # Of 20,000 steps, where a switch lies between two.
    assert found.over_way[0] == pytest.approx(area, abs=3e-3) and abs(area) > 0.5
    assert found.over_speed[0] == pytest.approx(over_time, abs=3e-3)
    assert (area < 0) == bool(found.gives_off_over_way.size)


def test_a_spring_with_a_damper_takes_up_what_its_damper_does() -> None:
    pin = epp.LockPin(0.0, 10.0, 0.5, "classical")
    found = epp.check_element(pin, amplitudes=[0.2, 0.4], omega=3.0)
    np.testing.assert_allclose(found.over_way, np.pi * 0.5 * 3.0 * found.amplitudes**2, rtol=1e-9)


def test_what_cannot_be_told_is_said() -> None:
    law = epp.CleggIntegrator(1.0).inside
    assert law is not None
    kicked = epp.check_element(epp.AutomatonElement(law.automaton()))
    assert not kicked.status.ok and kicked.amplitudes.size == 0 and "no describing function" in str(kicked)
    smooth = epp.AutomatonBuilder(smooth=(epp.Smooth("cube", np.ones(1)),))
    one, other = smooth.mode("one", from_smooth=1.0), smooth.mode("other", from_smooth=1.0)
    smooth.guard("over", one, other, on_output=1.0, constant=-1.0)
    undecided = epp.check_element(epp.AutomatonElement(smooth.build()), amplitudes=[0.5])
    assert undecided.deterministic is None and not undecided.status.ok and "not decided" in str(undecided)
    slow = epp.AutomatonBuilder(n_memory=1)
    below, above = slow.mode("below", from_memory=1.0), slow.mode("above", from_memory=1.0)
    slow.guard("rises", below, above, on_input=1.0, constant=-0.1, memory_from_memory=0.5, memory_constant=0.5)
    slow.guard("falls", above, below, on_input=-1.0, constant=-0.1)
    creeps = epp.check_element(epp.AutomatonElement(slow.build()), amplitudes=[0.05, 0.5])
    assert not creeps.status.ok and "does not answer with the period of a sine" in str(creeps)
    assert "at 1 of 2 amplitudes" in str(creeps)
    lagging = epp.check_element(lag_behind(epp.Saturation(), 1.0))
    assert lagging.status is epp.Status.INCOMPLETE and "linear states are not excited" in str(lagging)


@pytest.mark.parametrize("wrong", [{"amplitudes": [-1.0]}, {"omega": 0.0}, {"amplitudes": [[1.0]]}])
def test_arguments_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(epp.EppError, match="check_element: .*; expected"):
        epp.check_element(epp.Play(1.0), **wrong)


def test_the_picture_says_its_units_and_at_which_frequency() -> None:
    """What a rate limiter does to a sine depends on amplitude times frequency alone: one curve, on two scales."""
    slow, fast = (epp.check_element(epp.RateLimiter(rate=1.0), [2.0 / w, 4.0 / w], omega=w) for w in (1.0, 8.0))
    np.testing.assert_allclose(slow.gain, fast.gain)
    for found, said in ((slow, "1 rad/s"), (fast, "8 rad/s")):
        panels = found.plot().figure.axes
        assert len(panels) == 2
        for ax in panels:
            assert said in ax.get_xlabel() and "[" in ax.get_xlabel()
            assert "[" in ax.get_ylabel() + "".join(t.get_text() for t in ax.get_legend().get_texts())


def ring(n_modes: int, n_guards: int, constant: float) -> epp.AutomatonElement:
    """Modes in a ring whose guards all rise at one input, and others across it: ever more chains of events."""
    build = epp.AutomatonBuilder()
    for i in range(n_modes):
        build.mode(f"mode {i}", from_input=0.1 * i)
    for k in range(n_guards):
        far = 1 + (0 if k < n_modes else 7 * k % (n_modes - 1))
        build.guard(f"guard {k}", k % n_modes, (k + far) % n_modes, on_input=1.0, constant=constant)
    return epp.AutomatonElement(build.build())


@pytest.mark.slow
@pytest.mark.parametrize(("n_modes", "n_guards", "constant"), [(30, 40, 0.0), (60, 60, -1.0)])
def test_rules_with_ever_more_chains_of_events_are_given_up_in_time(
    n_modes: int, n_guards: int, constant: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By what is counted, not by a clock, a quarter of it here: a first finding stands, and the rest is undecided."""
    monkeypatch.setattr("eppanalysis.methods.elements.rules._MOST_PROGRAMS", 1000)
    begin = time.process_time()
    found = epp.check_element(ring(n_modes, n_guards, constant), amplitudes=[2.0])
    assert time.process_time() - begin < 15.0
    assert found.findings or not found.decided
    assert not found.deterministic or not found.decided


@pytest.mark.slow
def test_rules_whose_events_follow_one_another_in_a_thousand_modes_are_given_up() -> None:
    loop = epp.case("virtual_spring").to_system()
    encoder = loop.elements[loop.element_names.index("encoder")]
    assert not epp.check_element(encoder, amplitudes=[2.0]).decided
