"""Records that are no response of an elbow are refused: noise of any colour and size, wrong units, wrong gains."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.cases import shipped_cases_folder
from eppanalysis.identify.columns import Role
from eppanalysis.identify.plausible import moves
from eppanalysis.identify.response import Channel
from tests.reference.benches import Bench, step_response

FIT = ("drive.inertia", "drive.coulomb_friction", "controller.delay")


@pytest.fixture(scope="module")
def bench() -> Bench:
    return step_response(6, t_end=1.0)


pytestmark = pytest.mark.usefixtures("few_draws")


def refusal(bench: Bench, folder, *, header: tuple[str, ...] | None = None, **columns) -> str:
    """The sentence with which a bench is refused whose columns are others."""
    rows = bench.rows.copy()
    for name, values in columns.items():
        rows[:, ("time", "angle", "force").index(name)] = values
    path = replace(bench, rows=rows, header=header or bench.header).write(folder / "step.csv")
    known = {k: {"value": v, "tolerance": "2 %", "mark": "measured"} for k, v in bench.setting.items()}
    with pytest.raises(epp.EppError) as caught:
        epp.identify(epp.case("fig8a_original").with_values(known), step=path, fit=FIT)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize(
    ("size", "which"),
    [(0.02, "angle"), (0.5, "angle"), (0.5, "force"), (5.0, "angle"), (0.02, "both"), (5.0, "both"), (50.0, "both")],
)
def test_noise_is_no_response(bench, tmp_path, size, which) -> None:
    rng, n = np.random.default_rng(4), len(bench.rows)
    noise = {"angle": 17.0 + size * rng.normal(size=n), "force": 2.5 + 0.01 * size * rng.normal(size=n)}
    said = refusal(bench, tmp_path, **{k: v for k, v in noise.items() if which in (k, "both")})
    assert f"its {'angle' if which == 'both' else which} is noise alone" in said
    assert "expected the response to the step" in said


@pytest.mark.parametrize("seed", [1, 2])
def test_wander_of_the_size_of_a_response_is_none(bench, tmp_path, seed) -> None:
    """A sensor that wanders moves as far as an elbow; the fit that it ends in explains next to nothing."""
    rng, n = np.random.default_rng(seed), len(bench.rows)
    walk = {name: np.cumsum(rng.normal(size=n)) for name in ("angle", "force")}
    rms = {name: np.std(bench.rows[:, i]) for i, name in ((1, "angle"), (2, "force"))}
    late = {name: rms[name] * (w[::-1] - w.mean()) / np.std(w) for name, w in walk.items()}
    alone = replace(bench, header=bench.header[:2], rows=bench.rows[:, :2])
    said = refusal(alone, tmp_path, angle=17.0 + late["angle"] - np.ptp(late["angle"]) * np.linspace(0, 3, n) ** 2)
    assert "expected" in said


@pytest.mark.parametrize(
    ("name", "factor", "words"),
    [
        ("angle", np.degrees(1.0), "as with degrees taken for radians"),
        ("angle", np.radians(1.0), "as with radians taken for degrees"),
        ("force", 4.4482216152605, "as with newtons taken for pounds"),
        ("force", 1 / 4.4482216152605, "as with pounds taken for newtons"),
        ("force", np.degrees(1.0), "times as far as that of the case"),
        ("angle", 1000.0, "times as far as that of the case"),
    ],
)
def test_another_unit_or_gain_is_said(bench, tmp_path, name, factor, words) -> None:
    column = bench.rows[:, ("time", "angle", "force").index(name)]
    said = refusal(bench, tmp_path, **{name: factor * column})
    assert words in said and f"its {name} moves" in said and "expected the same units" in said


def test_degrees_called_radians_are_refused_in_both_tests_of_the_angle(bench, tmp_path) -> None:
    header = tuple(h.replace("[deg]", "[rad]") for h in bench.header)
    assert "degrees taken for radians" in refusal(bench, tmp_path, header=header)
    cycling = (shipped_cases_folder() / "measured" / "backlash_cycling.csv").read_text()
    (tmp_path / "cycling.csv").write_text(cycling.replace("[deg]", "[rad]", 1))
    with pytest.raises(epp.EppError, match=r"its angle makes the cable .* as with degrees taken for radians"):
        epp.identify(epp.case("elbow"), backlash=tmp_path / "cycling.csv")


@pytest.mark.slow
def test_a_fit_that_leaves_more_than_noise_is_none_to_rely_on(tmp_path) -> None:
    """An oscillation with no elbow behind it, as large as a response: residuals many times the noise are a status."""
    t = np.arange(-0.02, 1.0, 0.002)
    angle = np.where(t > 0, 55.0 * (1 - np.exp(-t / 0.1)) + 4.0 * np.sin(20.0 * t), 0.0)
    rows = np.column_stack([t, 17.0 + angle + 0.02 * np.random.default_rng(1).normal(size=t.size)])
    path = Bench(("time [s]", "angle [deg]"), rows, {}).write(tmp_path / "other.csv")
    fit = epp.identify(epp.case("fig8a_original"), step=path, fit=("drive.inertia", "drive.coulomb_friction")).fits[0]
    assert fit.status is epp.Status.NOT_CONVERGED
    assert any("times the noise of the record" in note for note in fit.notes)


@pytest.mark.parametrize("n", [60, 500, 20000])
def test_noise_alone_does_not_move_and_a_small_step_in_long_noise_does(n) -> None:
    rng = np.random.default_rng(n)
    drift = np.column_stack([np.ones(n), np.linspace(-0.5, 0.5, n)])
    live = np.ones(n, bool)
    step_of = np.where(np.arange(n) > n // 3, 1.0, 0.0)
    shown = [
        moves(Channel(Role.ANGLE, size * step_of + 3.0 * drift[:, 1] + rng.normal(size=n), drift, 1.0, live))
        for size in (*[0.0] * 300, *[16.0 / np.sqrt(n / 20)] * 20)
    ]
    assert not any(shown[:300]) and all(shown[300:])
