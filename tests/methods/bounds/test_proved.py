"""Bounds with what is proved on both sides of them, each at a value of its own."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from typer.testing import CliRunner

import eppanalysis as epp
from eppanalysis.cli.commands import app

pytest.importorskip("flint")
GAIN, THRESHOLD = "loop.gain", "relay_dead_zone.threshold"


@pytest.fixture(scope="module")
def valve() -> epp.Case:
    """1/(s(s+1)^2(0.05s+1)) behind a relay with dead zone; its linear limit is a gain of 1.8223 thresholds."""
    loop = epp.LureSystem.from_tf(([1.0], [0.05, 1.1, 2.05, 1.0, 0.0]), epp.RelayDeadZone(level=1.0, threshold=1.0))
    return epp.Case.from_system(loop, name="valve")


@pytest.fixture(scope="module")
def bounds(valve) -> epp.DesignBounds:
    return epp.design_bounds(valve, THRESHOLD, GAIN, at=[1.0], within=(1.0, 8.0), starts=20, prove=True)


@pytest.mark.slow
def test_the_bound_lies_between_what_is_proved(bounds) -> None:
    (cell,) = bounds
    assert cell.proved.free < cell.exact < cell.proved.cycle
    # Popov's criterion holds up to the linear limit of the sector; the cycle is proved next to the bound.
    assert 1.36 <= cell.proved.free < 1.8223
    assert cell.proved.cycle == pytest.approx(cell.exact, rel=2e-3)
    assert cell.proved.gap == pytest.approx((cell.proved.cycle - cell.proved.free) / cell.exact)
    assert "1 of 1 bound proved on both sides" in str(bounds)
    assert bounds.to_frame()["proved_cycle"].tolist() == [cell.proved.cycle]
    assert bounds.to_dataset()["proved_free"].values.tolist() == [cell.proved.free]


def test_the_files_hold_for_the_values_they_name(bounds, valve, tmp_path) -> None:
    paths = bounds.write_certificates(tmp_path / "proofs")
    assert [path.name for path in paths] == [f"{THRESHOLD}=1.json", f"{THRESHOLD}=1-cycle.json"]
    values = bounds[0].proved.free, bounds[0].proved.cycle
    said = [epp.check_certificate(path, valve.with_values({GAIN: v})) for path, v in zip(paths, values, strict=True)]
    assert all(check.accepted and check.about for check in said)
    between = bounds[0].proved.free_from, 0.5 * (bounds[0].proved.free_from + bounds[0].proved.free)
    assert between[0] == 1.0 and "1 with one proof for all values on the free side" in str(bounds)
    assert all(epp.check_certificate(paths[0], valve.with_values({GAIN: v})).about for v in between)
    assert "no periodic motion but rest" in str(said[0]) and "has a limit cycle" in str(said[1])
    swapped = [
        epp.check_certificate(path, valve.with_values({GAIN: v})) for path, v in zip(paths, values[::-1], strict=True)
    ]
    assert all(check.accepted and check.about is False for check in swapped)
    assert epp.certify(valve.with_values({GAIN: bounds[0].proved.free}), "absence").proved
    assert not epp.certify(valve.with_values({GAIN: bounds[0].exact}), "absence").proved


def test_the_picture_shows_both(bounds) -> None:
    labels = [text.get_text() for text in bounds.plot().get_legend().get_texts()]
    assert {"proved free of limit cycles", "cycle proved"} <= set(labels)


def test_what_cannot_be_proved_is_said(monkeypatch, valve, tmp_path) -> None:
    from eppanalysis.methods.bounds import proved

    monkeypatch.setattr(proved, "_DISTANCES", (0.01,))  # nearer than the criteria reach
    (cell,) = found = epp.design_bounds(valve, THRESHOLD, GAIN, at=[1.0], within=(1.0, 8.0), starts=20, prove=True)
    assert math.isnan(cell.proved.free) and math.isfinite(cell.proved.cycle)
    assert "0 of 1 bound proved on both sides" in str(found) and "Absence of cycles is not proved." in str(found)
    assert [path.name for path in found.write_certificates(tmp_path)] == [f"{THRESHOLD}=1-cycle.json"]
    with pytest.raises(epp.EppError, match="no certificate to write"):
        replace(found, cells=(replace(cell, proved=None),)).write_certificates("nowhere")


def test_bounds_that_are_not_of_any_cycle_are_refused(valve) -> None:
    for other in ({"allow": "x 0.5"}, {"exact": False}, {"verify": False}):
        with pytest.raises(epp.EppError, match="prove is given for bounds that have no proof; expected"):
            epp.design_bounds(valve, THRESHOLD, GAIN, at=[1.0], within=(1.0, 8.0), prove=True, **other)


def test_a_guide_tells_what_is_proved_and_writes_the_same_files(bounds, valve, tmp_path, monkeypatch) -> None:
    asked = {}
    monkeypatch.setattr("eppanalysis.guides.guideline.design_bounds", lambda *_, **how: asked.update(how) or bounds)
    guide = epp.design_guide(valve, [1.0], over=THRESHOLD, limit=GAIN, within=(1.0, 8.0), starts=20, prove=True)
    row = guide.to_frame().iloc[0]
    assert asked["prove"] and row["proved free at"] == bounds[0].proved.free
    assert row["proved to oscillate at"] == bounds[0].proved.cycle
    assert row["these apart [%]"] == pytest.approx(100.0 * bounds[0].proved.gap)
    assert [p.name for p in guide.write_certificates(tmp_path)] == [f"{THRESHOLD}=1.json", f"{THRESHOLD}=1-cycle.json"]


def test_command(bounds, valve, tmp_path, monkeypatch) -> None:
    asked = {}
    monkeypatch.setattr(
        "eppanalysis.methods.bounds.design.design_bounds", lambda *_, **how: asked.update(how) or bounds
    )
    path = tmp_path / "valve.toml"
    path.write_text(valve.to_toml(), encoding="utf-8")
    said = CliRunner().invoke(
        app,
        [
            *("bounds", str(path), "--over", THRESHOLD, "--limit", GAIN, "--from", "1", "--points", "1"),
            *("--within", "1..8", "--starts", "20", "--certificates", str(tmp_path / "proofs")),
        ],
    )
    assert said.exit_code == 0, said.output
    assert asked["prove"] and asked["starts"] == 20
    assert "proved free" in said.output and "apart" in said.output
    assert [p.suffix for p in (tmp_path / "proofs").iterdir()] == [".json"] * 2
