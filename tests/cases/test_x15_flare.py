"""The X-15's landing flare as a diagram: its cycles, its linear limit, and the fold below which there is no cycle."""

import math

import control
import pytest

import eppanalysis as epp

CASE = "x15_flare"
#: Gain at which both cycles meet, by shooting in independent code.
FOLD = 1.0517


def test_the_two_exact_cycles():
    cycles = sorted(epp.find_limit_cycles(epp.case(CASE)), key=lambda cycle: -cycle.omega)
    known = [(3.08351, 4.3351, False), (2.33003, 15.4590, True)]
    for cycle, (omega, degrees, stable) in zip(cycles, known, strict=True):
        assert cycle.omega == pytest.approx(omega, rel=2e-6)
        assert math.degrees(cycle.peak_to_peak["theta"] / 2.0) == pytest.approx(degrees, rel=2e-5)
        assert cycle.stable is stable


def test_the_linear_limit_is_that_of_python_control():
    case = epp.case(CASE)
    found = epp.margins(case)
    assert found.at == "gain.out"
    limit = case.value("Kp") * found.gain_margin
    airframe = control.tf([3.476, 3.1708072, 0.0896237936], [1, 0.8608, 5.3159942, 0.108928, 0.0529])
    assert limit == pytest.approx(2.2280, abs=5e-5)
    assert limit == pytest.approx(control.margin(airframe * control.tf([25], [1, 25]))[0], rel=1e-9)


def test_the_branch_over_the_gain_turns_at_the_fold():
    branch = epp.continue_branch(epp.case(CASE), "Kp", 1.5, 1.0)
    assert branch.status is epp.Status.CONVERGED
    (fold,) = branch.folds
    assert fold.value == pytest.approx(FOLD, abs=5e-5)


@pytest.mark.slow
@pytest.mark.parametrize(("over", "at"), [("bandwidth", "25 rad/s"), ("rate", "15 deg/s")])
def test_bounds_on_the_gain_find_the_fold_by_themselves(over, at):
    """Amplitudes scale with the rate limit, so the fold is the same at any."""
    (cell,) = epp.design_bounds(epp.case(CASE), over=over, limit="Kp", at=[at], verify=False)
    assert cell.exact == pytest.approx(FOLD, abs=5e-5)


@pytest.mark.slow
@pytest.mark.parametrize("gain", [1.04, 1.06])
def test_either_side_of_the_fold_is_as_it_says(gain):
    search = epp.find_limit_cycles(epp.case(CASE).with_values({"Kp": gain}))
    assert len(search) == (0 if gain < FOLD else 2)
