"""Bounds with an amplitude that is allowed: published amplitudes, scaling laws, searches and runs on both sides."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.cli.bounds import bounds_columns, sentences
from eppanalysis.methods.bounds.balanced import BoundProblem
from eppanalysis.methods.bounds.elasticity import size_elasticities
from eppanalysis.methods.bounds.exact import ExactBound
from eppanalysis.methods.bounds.result import BoundCell, Finding, Turn
from eppanalysis.methods.bounds.sizes.allowed import Allowed, Measure
from eppanalysis.methods.bounds.sizes.bound import Scan, bound_of_size, scan
from tests import made_bounds
from tests.shared import said_above

#: Amplitude of the cycle of `backlash_servo` at its gap of 2, as published with the case.
AMPLITUDE = 1.959706261794195


@pytest.fixture(scope="module")
def servo() -> epp.Case:
    return epp.case("backlash_servo")


@pytest.fixture(scope="module")
def by_gap(servo: epp.Case) -> epp.DesignBounds:
    """All cycles scale with the gap, so that without an allowed size nothing bounds it."""
    return epp.design_bounds(servo, "loop.gain", "play.gap", at=[1.0], within=(0.2, 1.0), allow="x 1.5", starts=40)


def test_a_gap_is_bounded_by_the_published_amplitude(by_gap: epp.DesignBounds) -> None:
    (cell,) = by_gap
    assert cell.exact == pytest.approx(2.0 * 1.5 / (2.0 * AMPLITUDE), rel=1e-9)
    assert cell.kind is Turn.SIZE and cell.sign == 1.0
    assert cell.size == pytest.approx(1.5, rel=1e-9)
    # First order: the same law with its own amplitude, as the case has it.
    assert cell.first_order == pytest.approx(1.5 / 2.020632276959861, rel=1e-5)


def test_it_is_verified_on_both_sides(by_gap: epp.DesignBounds) -> None:
    (cell,) = by_gap
    assert cell.verified, cell.message
    assert cell.n_settled == cell.n_runs == 40 and cell.n_cycles == 0
    assert cell.other_orbit is not None and cell.other_orbit.stable
    # A cycle a per cent larger: the law again.
    assert cell.other_orbit.peak_to_peak["x"] == pytest.approx(1.01 * 1.5, rel=1e-8)


def test_the_elasticity_obeys_the_scaling_law(by_gap: epp.DesignBounds) -> None:
    assert by_gap[0].elasticities["allowed"] == pytest.approx(1.0, rel=1e-6)


def bound_from(case: epp.Case, limit: str, within: tuple[float, float], allow: str) -> ExactBound:
    """The bound next to the low end of a range, from the cycles at its high end."""
    question = BoundProblem(case, limit, *within)
    allowed = Allowed.read(case.to_system(), allow)
    cycles = tuple(c for c in epp.find_limit_cycles(question.case_at(within[1])) if allowed.exceeded_by(c))
    found = bound_of_size(question, allowed, Scan(Finding.BOUND, 1.0, within[0], within[1], cycles))
    return found


@pytest.mark.slow
def test_the_bound_on_a_gain_is_where_searches_say(servo: epp.Case) -> None:
    found = bound_from(servo, "loop.gain", (0.5, 1.5), "x 4 peak to peak")
    assert found.kind is Turn.SIZE and found.point is not None
    sizes = []
    for factor in (0.99, 1.0, 1.01):
        there = servo.with_values({"loop.gain": factor * found.value})
        sizes.append(max(c.peak_to_peak["x"] for c in epp.find_limit_cycles(there).stable))
    assert sizes[0] < 4.0 < sizes[2]
    assert sizes[1] == pytest.approx(4.0, rel=1e-8)
    known = size_elasticities(BoundProblem(servo, "loop.gain", 0.5, 1.5), found.point, Allowed("x", 4.0))
    slope = math.log(1.01 / 0.99) / math.log(sizes[2] / sizes[0])
    assert known["allowed"] == pytest.approx(slope, rel=2e-3)
    # All sizes are proportional to the gap: the bound feels the ratio of both only.
    assert known["play.gap"] == pytest.approx(-known["allowed"], rel=1e-10)


@pytest.mark.slow
def test_within_a_band_the_bound_is_where_the_cycle_comes_into_it(servo: epp.Case) -> None:
    """The frequency of the cycle grows with the gain: at a gain of 1.1 it enters a band that begins with it."""
    (entering,) = epp.find_limit_cycles(servo.with_values({"loop.gain": 1.1})).stable
    low = entering.frequency
    band = f"within {low:.15g} Hz..{2 * low:.15g} Hz"
    found = bound_from(servo, "loop.gain", (0.5, 1.5), f"x 0.5 {band}")
    assert found.kind is Turn.SIZE and found.point is not None and found.value == pytest.approx(1.1, rel=1e-8)
    allowed = Allowed.read(servo.to_system(), f"x 0.5 {band}")
    assert not allowed.exceeded_by(replace(entering, period=1.001 * entering.period))
    assert allowed.exceeded_by(replace(entering, period=0.999 * entering.period))
    known = size_elasticities(BoundProblem(servo, "loop.gain", 0.5, 1.5), found.point, allowed)
    # Frequencies feel neither what is allowed nor the play, with which the sizes scale.
    assert known["allowed"] == 0.0 and known["play.gap"] == pytest.approx(0.0, abs=1e-10)
    # In the band the size counts as without it.
    wide = f"within {0.1 * low:.15g} Hz..{10 * low:.15g} Hz"
    all_ = [bound_from(servo, "loop.gain", (0.5, 1.5), f"x 4{end}").value for end in ("", f" {wide}")]
    assert all_[1] == pytest.approx(all_[0], rel=1e-12)


def test_rms_about_the_mean_against_a_run(servo: epp.Case) -> None:
    assert Allowed.read(servo.to_system(), "x 0.4 rms").measure is Measure.RMS
    found = bound_from(servo, "play.gap", (0.1, 2.0), "x 0.4 rms")
    there = servo.with_values({"play.gap": found.value}).to_system()
    assert found.cycle is not None
    period = found.cycle.period
    times = np.linspace(150.0, 150.0 + period, 4001)
    wave = epp.simulate(there, t_end=float(times[-1]) + 0.01, t_eval=times).signals["x"][:-1]
    # The trapezoid rule over a period: its error is of the order of a step squared.
    assert float(np.std(wave)) == pytest.approx(0.4, rel=1e-5)


def test_where_the_cycle_is_too_large_at_birth_the_fold_is_the_bound() -> None:
    case = made_bounds.wheelchair()
    found = bound_from(case, "loop.gain", (0.6, 1.0), "play_input 0.01")
    assert found.kind is Turn.FOLD and found.value == pytest.approx(made_bounds.GAIN, rel=1e-6)
    assert found.cycle is not None
    size = found.cycle.peak_to_peak["play_input"]
    cell = BoundCell(0.012, Finding.BOUND, exact=found.value, kind=found.kind, orbit=found.cycle, size=size)
    assert size > 0.01
    told = cell.active(Allowed("play_input", 0.01))
    assert "is born with play_input" in told and "more than is allowed (play_input 0.01 peak to peak)" in told


def test_an_unstable_cycle_is_not_counted() -> None:
    """At the fold the stable cycle has 0.0345; above it the unstable one is smaller, and only the stable one counts."""
    case = made_bounds.wheelchair()
    unstable, stable = epp.find_limit_cycles(case)
    assert stable.stable and not unstable.stable
    allowed = Allowed.read(case.to_system(), "play_input 0.01")
    assert allowed.exceeded_by(stable) and not allowed.exceeded_by(unstable)
    assert unstable.peak_to_peak["play_input"] > 0.01


def test_what_is_allowed_is_named_everywhere(servo: epp.Case, by_gap: epp.DesignBounds) -> None:
    plain = by_gap.to_dict()
    assert plain["allowed"] == {"signal": "x", "size": 1.5, "measure": "peak to peak", "unit": "", "band": None}
    assert plain["cells"][0]["kind"] == "allowed size" and plain["provenance"]["settings"]["allowed"]["size"] == 1.5
    told = " ".join(sentences(servo, by_gap))
    assert "Allowed is a stable limit cycle up to x 1.5 peak to peak." in told
    assert "reaches the allowed size" in told
    assert " ".join(said_above(by_gap.plot().figure)).startswith(by_gap.headline())
    assert "allowed size" in str(epp.table(by_gap))
    assert "active" in bounds_columns(by_gap).columns


@pytest.mark.parametrize(
    ("sizes", "done", "finding", "words"),
    [
        ([1, 1, 1], True, "none", "nothing bounds it there"),
        ([1, 1, 1], False, "unsure", "left runs undecided at 0.1, "),
        ([2, 1, 2], False, "unsure", "at 0.1, 4; of the others, runs were left undecided at "),
        ([2, 2, 2], True, "always", "none of them is safe"),
        ([2, 1, 2], True, "between", "give a narrower range"),
        ([1, 2, 1], True, "bound", "There is none at 4 either."),
    ],
)
def test_what_a_scan_says(
    servo: epp.Case, monkeypatch: pytest.MonkeyPatch, sizes: list[float], done: bool, finding: str, words: str
) -> None:
    """Sizes at the low end of the range, in its middle and at its high end, as a search might have them."""
    question = BoundProblem(servo, "play.gap", 0.1, 4.0)
    allowed = Allowed("x", 1.5)
    cycle = epp.predict_limit_cycles(servo)[1]

    def seen(_: BoundProblem, asked: Allowed, value: float) -> tuple[float, tuple[epp.LimitCycle, ...], bool]:
        size = sizes[0 if value < 0.11 else 2 if value > 3.9 else 1]
        return value, tuple(c for c in [replace(cycle, peak_to_peak={"x": size})] if asked.exceeded_by(c)), done

    monkeypatch.setattr("eppanalysis.methods.bounds.sizes.bound._seen_at", seen)
    found = scan(question, allowed)
    assert found.finding == finding and words in found.note
    assert finding == "bound" or "x 1.5 peak to peak" in found.note


@pytest.mark.parametrize(
    ("allow", "words"),
    [
        ("theta 3 deg", "the loop has no signal 'theta'"),
        ("x", "no signal with a size"),
        ("x 3 deg", "x is '3 deg'; expected a plain number"),
        ("x -1", "expected a positive size"),
        ("x 1 rms rms", "x is '1 rms'"),
        ("x 1 within 2 Hz", "the band is '2 Hz'"),
        ("x 1 within 3 Hz..2 Hz", "expected a low and a higher frequency"),
        ("x 1 within 1 m..2 m", "the band is '1 m..2 m'"),
    ],
)
def test_what_cannot_be_allowed_is_refused_in_a_sentence(servo: epp.Case, allow: str, words: str) -> None:
    with pytest.raises(epp.EppError, match=words):
        epp.design_bounds(servo, "loop.gain", "play.gap", at=[1.0], allow=allow)


def test_units_are_those_of_the_signal() -> None:
    system = epp.case("fig8a_original").to_system()
    assert Allowed.read(system, "theta 0.3 deg").size == pytest.approx(math.radians(0.3))
    assert str(Allowed.read(system, "theta 0.3 deg rms")) == "theta 0.3 deg rms"
    with pytest.raises(epp.EppError, match="an angle"):
        Allowed.read(system, "theta 3 mm")


def test_sizes_need_exact_orbits(servo: epp.Case) -> None:
    with pytest.raises(epp.EppError, match="expected exact orbits"):
        epp.design_bounds(servo, "loop.gain", "play.gap", at=[1.0], allow="x 1.5", exact=False)
