"""Round trip on the command line: a bench with noise, identified, predicted; against the bench's own integrator."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from eppanalysis.cli.commands import app
from tests.benches import base_case
from tests.reference.benches import FIELDS, nominal, simulate_reference, step_response

pytestmark = pytest.mark.slow

runner = CliRunner()


def run(*arguments: object) -> str:
    result = runner.invoke(app, [str(a) for a in arguments])
    assert result.exit_code == 0, result.output
    return result.stdout


def stable(text: str) -> list[dict]:
    """The stable cycles of one case, from ``--json``."""
    return [c for c in json.loads(text)["cases"][0]["result"]["cycles"] if c["stable"]]


@pytest.mark.parametrize("seed", [10])
def test_simulate_identify_predict(tmp_path, seed):
    import xarray as xr

    bench = step_response(seed, t_end=1.5)
    true = simulate_reference(nominal(**{FIELDS[k]: v for k, v in bench.truth.items()}), t_end=4.0, rtol=1e-9)
    assert true.verdict == "oscillate"
    known, found, spread = (tmp_path / name for name in ("known.toml", "found.toml", "spread.nc"))
    known.write_text(base_case(bench, "step").to_toml(), encoding="utf-8")
    measured = bench.write(tmp_path / "step.csv")
    assert "Limited by" in run("identify", known, "--step", measured, "-o", found)

    # What the tolerances of the identified case leave of the cycle is the reported uncertainty.
    run("sweep", found, "--design", "tolerances", "--n", 48, "--seed", 1, "-o", spread)
    with xr.open_dataset(spread) as cells:
        frequency, peak_to_peak = cells["frequency"].values, cells["peak_to_peak"].values
    assert frequency.min() <= 1.0 / true.period <= frequency.max()
    assert peak_to_peak.min() <= true.peak_to_peak <= peak_to_peak.max()
    assert np.ptp(frequency) < 0.05 / true.period and np.ptp(peak_to_peak) < 0.1 * true.peak_to_peak

    (exact,) = stable(run("cycles", found, "--json"))
    assert exact["frequency"] == pytest.approx(1.0 / true.period, rel=0.01)
    assert exact["peak_to_peak"]["theta"] == pytest.approx(true.peak_to_peak, rel=0.03)
    assert frequency.min() <= exact["frequency"] <= frequency.max()
    assert peak_to_peak.min() <= exact["peak_to_peak"]["theta"] <= peak_to_peak.max()

    # First order is as far off as it says itself; the peak-to-peak is closer than that.
    (predicted,) = stable(run("predict", found, "--json"))
    assert abs(predicted["frequency"] * true.period - 1.0) <= predicted["error_estimate"]
    assert predicted["frequency"] * true.period == pytest.approx(1.0, abs=0.25)
    assert predicted["peak_to_peak"]["theta"] == pytest.approx(true.peak_to_peak, rel=0.15)
