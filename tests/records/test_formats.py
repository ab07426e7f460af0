"""One record in every format: the same arrays, verdict and identified numbers; what is damaged is one sentence."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import eppanalysis as epp
from eppanalysis.cli.commands import app
from eppanalysis.diagnose.record import record_of
from tests.records.writers import FORMATS

pytestmark = pytest.mark.slow  # the extra "records"
CASE = "two_mass_damped_shaft"
#: Formats of files, and those that a truncated file leaves whole.
FILES = [name for name, (ending, *_) in FORMATS.items() if ending and name not in ("CSV", "rosbag2")]


@pytest.fixture(scope="module")
def shaft() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, twist [rad] and torque [N*m] of the limit cycle of a shipped case."""
    t = np.round(np.linspace(0.0, 2.0, 1001), 6)
    run = epp.simulate(epp.case(CASE), t_end=12.0, t_eval=10.0 + t)
    return t, run.signals["twist"], run.signals["torque"]


def written(name: str, folder: Path, signals: Any) -> tuple[Any, dict[str, tuple[str, str]]]:
    ending, write, columns = FORMATS[name]
    return write(folder / f"record.{ending}", *signals), columns


@pytest.mark.parametrize("name", FORMATS)
def test_a_record_is_the_same_in_every_format(name, shaft, tmp_path):
    t, twist, torque = shaft
    given, columns = written(name, tmp_path, shaft)
    found = record_of(given, epp.case(CASE).to_system().signals.units_by_name(), columns)
    begin = 1e-9 * float(np.round(1e9 * (found.time[0] - t[0])))  # a bag's time counts from its first message
    assert np.allclose(found.time - begin, t, rtol=0.0, atol=1e-9)
    assert np.allclose(found.signals["twist"], twist, rtol=1e-12, atol=0.0)
    # Counts of an MF4 channel are millionths.
    assert np.allclose(found.signals["torque"], torque, rtol=1e-12, atol=0.5e-6 if name == "MF4" else 0.0)


@pytest.mark.parametrize("name", FORMATS)
def test_the_verdict_is_the_same_from_every_format(name, shaft, tmp_path, monkeypatch):
    module = import_module("eppanalysis.diagnose")
    monkeypatch.setattr(module, "candidates_of", _once(module.candidates_of))
    t, twist, torque = shaft
    want = epp.diagnose(epp.case(CASE), {"time": t, "twist": twist, "torque": torque})
    given, columns = written(name, tmp_path, shaft)
    found = epp.diagnose(epp.case(CASE), given, columns=columns)
    assert found.verdict == want.verdict and found.names == want.names
    # Rounding of the signals moves the fit by a hundred-thousandth of its standard deviation.
    off = abs(found.oscillation.omega / want.oscillation.omega - 1.0)
    assert off < 1e-4 * want.oscillation.omega_error


_KEPT: dict[Any, Any] = {}


def _once(search: Any) -> Any:
    """Candidates are the same for every record of a loop."""

    def kept(system: Any, at: Any, steps: int) -> Any:
        if system.name not in _KEPT:
            _KEPT[system.name] = search(system, at, steps)
        return _KEPT[system.name]

    return kept


@pytest.mark.parametrize("name", FILES)
def test_bytes_that_are_wrong_are_one_sentence_or_change_nothing_but_numbers(name, shaft, tmp_path):
    """Some bytes of each file, most of them near its beginning; libraries in C must not be led out of their memory."""
    given, columns = written(name, tmp_path, tuple(signal[:200] for signal in shaft))
    units = epp.case(CASE).to_system().signals.units_by_name()
    whole, rng = given.read_bytes(), np.random.default_rng(7)
    for _ in range(20):
        damaged = bytearray(whole)
        for at in rng.integers(0, min(len(whole), 3000), rng.integers(1, 8)):
            damaged[at] = rng.integers(0, 256)
        given.write_bytes(damaged)
        try:
            found = record_of(given, units, columns)
        except epp.EppError as refused:
            assert "expected" in str(refused) and "\n" not in str(refused)
        else:
            assert np.all(np.isfinite(found.time)) and np.all(np.diff(found.time) > 0.0)


@pytest.mark.parametrize("name", FILES)
def test_a_damaged_file_is_one_sentence(name, shaft, tmp_path):
    given, columns = written(name, tmp_path, shaft)
    whole = given.read_bytes()
    options = [f"--signal={signal}={own}" for signal, (own, _) in columns.items()]
    # Of a flight whose log was cut the rest is a record, where it has enough rows.
    cut = whole[:1000] if name == "ULog" else whole[: len(whole) // 3]
    for damage in (b"", cut, b"\x93" * 3000, whole[:200] + b"\xff" * 2000):
        given.write_bytes(damage)
        ran = CliRunner().invoke(app, ["diagnose", CASE, str(given), *options])
        assert ran.exit_code == 2 and isinstance(ran.exception, SystemExit), (damage[:20], ran.output, ran.exception)
        said = " ".join(ran.output.split())
        assert given.name in said.replace(" ", "") and "expected" in said and "Traceback" not in said
