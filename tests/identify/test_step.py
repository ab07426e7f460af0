"""Step responses from an independent integrator: parameters found, uncertainty honest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.identify.step import DEFAULT
from eppanalysis.results import Status
from tests.reference.benches import Bench, step_response

FAST = ("drive.inertia", "drive.coulomb_friction", "controller.delay")


def base(bench: Bench, tolerance: str = "2 %") -> epp.Case:
    known = {k: {"value": v, "tolerance": tolerance, "mark": "measured"} for k, v in bench.setting.items()}
    return epp.case("fig8a_original").with_values(known)


@pytest.fixture(scope="module")
def oscillating(tmp_path_factory):
    """A bench on a limit cycle, and what was identified from it."""
    bench = step_response(3, t_end=1.5)
    path = bench.write(tmp_path_factory.mktemp("step") / "step.csv")
    return bench, epp.identify(base(bench), step=path)


@pytest.mark.slow
def test_drive_and_timing_are_found(oscillating):
    bench, found = oscillating
    fit = found.fits[0]
    assert fit.status is Status.CONVERGED
    inside = [fit[name].low <= bench.truth[name] <= fit[name].high for name in DEFAULT]
    assert sum(inside) >= 3  # 95 % each, and correlated
    for name in DEFAULT:
        assert fit[name].value == pytest.approx(bench.truth[name], rel=0.25)
    assert abs(fit.residuals["angle"].autocorrelation) < 0.3  # nothing but noise is left


@pytest.mark.slow
def test_what_was_known_becomes_sharper(oscillating):
    bench, found = oscillating
    for name, value in bench.setting.items():
        assert found[name].tolerance < 0.02 * value
        assert found.case.parameters[name].mark == "measured"


@pytest.mark.slow
def test_prediction_from_the_identified_case_is_that_from_the_true_one(oscillating):
    bench, found = oscillating
    truth = epp.case("fig8a_original").with_values(dict(bench.truth))
    pair = [epp.predict_limit_cycles(c) for c in (truth, found.case)]
    assert len(pair[0]) == len(pair[1])
    for a, b in zip(*pair, strict=True):
        assert b.frequency == pytest.approx(a.frequency, rel=0.02)
        assert b.amplitude("theta") == pytest.approx(a.amplitude("theta"), rel=0.05)


@pytest.mark.slow
def test_a_response_that_settles_identifies_the_drive_too(tmp_path, few_draws):
    bench = step_response(
        6, known={"lock_pin.backlash": np.radians(0.3), "drive.electrical_time_constant": 1e-3}, t_end=1.0
    )
    fit = epp.identify(base(bench), step=bench.write(tmp_path / "s.csv"), fit=FAST).fits[0]
    for name in FAST[:2]:
        assert fit[name].low * 0.98 <= bench.truth[name] <= fit[name].high * 1.02


@pytest.mark.slow
def test_what_a_coarse_record_cannot_identify_is_named(tmp_path, few_draws):
    """Sixty rows a second of the angle alone: a millisecond of lag is not distinguished from a millisecond of delay."""
    bench = step_response(8, force=False, rate=60.0, t_end=1.5)
    found = epp.identify(base(bench), step=bench.write(tmp_path / "s.csv"))
    fit = found.fits[0]
    unknown = {e.name: e for e in fit.unidentified}
    assert {"drive.electrical_time_constant", "controller.delay"} & set(unknown)
    assert fit.limited_by in unknown
    held = [e for e in unknown.values() if not e.kept]
    assert held
    for estimate in held:
        assert "the data do not identify it" in estimate.note
        assert found.case.parameters[estimate.name].mark == "assumed"


def still(tmp_path, rows: int = 400):
    rng = np.random.default_rng(1)
    t = np.arange(rows) * 0.002
    table = np.column_stack([t, 10.0 + 0.05 * rng.normal(size=rows), np.zeros(rows)])
    return Bench(("time [s]", "angle [deg]", "harness [mm]"), table, {}).write(tmp_path / "still.csv")


def test_a_forearm_that_never_moves_identifies_nothing(tmp_path, few_draws):
    with pytest.raises(epp.EppError, match=r"cannot identify drive.inertia or controller.delay; expected a motion"):
        epp.identify(epp.case("fig8a_original"), step=still(tmp_path), fit=("drive.inertia", "controller.delay"))


@pytest.mark.slow
def test_recorded_motion_of_the_harness_is_used(tmp_path, few_draws):
    """A pull of the harness at even speed, recorded beside the angle."""
    case = epp.case("fig8b_reduced_backlash").with_values({"drive.inertia": 0.036})
    ramp = epp.inputs.Ramp(0.1, start=0.1, stop=0.3)
    t = np.arange(0.0, 1.2, 0.002)
    run = epp.simulate(case.to_system(), ramp, t_end=1.2, t_eval=t)
    theta = np.degrees(run.signals["theta"]) + 0.02 * np.random.default_rng(2).normal(size=t.size)
    rows = np.column_stack([t, theta, 1e3 * ramp.value(t)])
    path = Bench(("time [s]", "angle [deg]", "harness [mm]"), rows, {}).write(tmp_path / "pull.csv")
    base_case = epp.case("fig8b_reduced_backlash")
    found = epp.identify(base_case, step=path, fit=("drive.inertia",))["drive.inertia"]
    assert found.value == pytest.approx(0.036, rel=0.05)
    assert found.identified


@pytest.mark.parametrize(
    ("fit", "expected"),
    [
        (("drive.inertja",), "did you mean 'drive.inertia'"),
        (("drive.inertia", "drive.inertia"), "given twice"),
        (("sensor.bits",), "expected a parameter that has a value"),
    ],
)
def test_wrong_fields_to_fit_are_one_sentence(tmp_path, fit, expected):
    with pytest.raises(epp.EppError, match=expected):
        epp.identify(epp.case("fig8a_original"), step=still(tmp_path), fit=fit)


def test_records_that_end_before_the_step_or_are_short_are_refused(tmp_path):
    bench = step_response(6, t_end=0.3)
    early = replace(bench, rows=np.column_stack([bench.rows[:, 0] - 10.0, bench.rows[:, 1:]]))
    with pytest.raises(epp.EppError, match="expected times after the step at 0 s"):
        epp.identify(base(bench), step=early.write(tmp_path / "early.csv"))
    short = replace(bench, rows=bench.rows[:30])
    with pytest.raises(epp.EppError, match="30 rows cannot identify 6 parameters"):
        epp.identify(base(bench), step=short.write(tmp_path / "short.csv"))
