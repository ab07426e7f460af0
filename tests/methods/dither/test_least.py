"""The least dither: of first order against closed forms, of runs against runs made here without its machinery."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.special import ellipe

import eppanalysis as epp
from eppanalysis.methods.dither.runs import Start

#: 1/(s (s + 1)(s + 2)): its gain where it turns the phase by 180 degrees, at sqrt(2) rad/s, is 1/6.
GAIN, DITHER = 1.0 / 6.0, 4.0


def relay() -> epp.LureSystem:
    return epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Relay())


@pytest.fixture(scope="module")
def found() -> epp.Dither:
    return epp.dither(relay(), frequency=DITHER)


def left_by_steps(amplitudes: np.ndarray, periods: int = 400, n: int = 100) -> np.ndarray:
    """Swing of x once a period of the dither, over the last 60 of its periods, by a run that knows no events.

    The relay is asked a hundred times a period and held between. The dither sets in on the cycle, after 160 periods.
    """
    h = 1.0 / (DITHER * n)
    A = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, -2.0, -3.0]])
    whole = expm(h * np.block([[A, np.array([[0.0], [0.0], [1.0]])], [np.zeros((1, 4))]]))
    x, seen = np.tile([[0.2], [0.0], [0.0]], amplitudes.size), []
    for k in range(periods * n):
        ride = amplitudes * (k > 160 * n) * np.sin(2.0 * np.pi * k / n)
        x = whole[:3, :3] @ x + whole[:3, 3:] * np.sign(ride - x[0])
        if k % n == n - 1:
            seen.append(x[0])
    return np.ptp(np.array(seen)[-60:], axis=0)


def test_first_order_is_the_closed_form(found: epp.Dither) -> None:
    """The cycle goes where the greatest equivalent gain, by elliptic integrals of the slow amplitude, is critical."""
    ratio = np.linspace(1.0, 1.5, 20_001)
    greatest = float(np.max(8.0 / (np.pi**2 * ratio) * ellipe(1.0 / ratio**2)))
    assert found.first_order == pytest.approx(greatest * GAIN, rel=1e-3)
    # The point of rest is stable under less than that: there a cycle lives beside it.
    assert found.first_order > 1.2 * 2.0 * GAIN / np.pi


def test_runs_settle_it_on_both_sides(found: epp.Dither) -> None:
    assert found.status.ok and found.stays < found.amplitude <= 1.02 * found.stays * (1 + 1e-12)
    assert found.amplitude == pytest.approx(found.first_order, rel=0.1)
    gone = {run.amplitude for run in found.runs if run.gone} - {run.amplitude for run in found.runs if not run.gone}
    assert min(gone) == found.amplitude and {run.start for run in found.runs if run.amplitude in gone} == set(Start)


def test_an_independent_run_has_the_cycle_on_one_side_alone(found: epp.Dither) -> None:
    stays, goes = left_by_steps(np.array([0.9 * found.stays, 1.2 * found.amplitude]))
    assert stays > 0.5 * found.size and goes < 0.05 * found.size


def test_marks_of_runs_are_seen_whole_at_the_edge_of_the_picture(found: epp.Dither) -> None:
    """What is gone stands at zero, on the frame."""
    marks = [line for line in found.plot().get_lines() if str(line.get_label()).startswith("run: ")]
    assert any(0.0 <= min(line.get_ydata()) < 1.0 for line in marks)
    assert not any(line.get_clip_on() for line in marks)


def test_it_says_what_it_found_and_what_it_did_not_look_at(found: epp.Dither) -> None:
    text = str(found)
    assert "The least dither that removes the limit cycle has amplitude 0." in text
    assert "a sine of 4 Hz at the input of relay" in text
    assert "other starts were not tried" in text
    slow = replace(found, returned=0.2)
    assert "The loop returns 20 % of the dither" in str(slow)
    frame = found.to_frame()
    assert list(frame.columns) == ["amplitude", "start", "left", "periods", "gone"] and len(frame) == len(found.runs)
    assert len(found.plot().figure.axes) == 2
    none = replace(found, amplitude=float("nan"), stays=0.5)
    assert str(none).startswith("No amplitude tried removes the limit cycle")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"frequency": -1.0}, "frequency is -1.0; expected a positive number"),
        ({"frequency": 0.3}, "expected 5 times that of the limit cycle"),
        ({"tolerance": 0.0}, "tolerance is 0.0"),
        ({"element": "valve"}, "no element 'valve'"),
        ({"wave": "square"}, "wave"),
    ],
)
def test_bad_questions_are_refused_in_a_sentence(change: dict[str, object], words: str) -> None:
    with pytest.raises(epp.EppError, match=words):
        epp.dither(relay(), **{"frequency": DITHER, **change})


def test_a_loop_without_a_cycle_is_refused() -> None:
    calm = epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Saturation())
    with pytest.raises(epp.EppError, match="no stable limit cycle"):
        epp.dither(calm, frequency=DITHER)
