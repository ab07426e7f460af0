"""Every command that a report of a shipped case may print runs; half an hour: pytest tests/stress/test_commands.py."""

from __future__ import annotations

from pathlib import Path

import pytest

import eppanalysis as epp
from tests.report.test_commands import CASES, run_all


@pytest.mark.parametrize("name", CASES)
def test_commands_of_a_shipped_case_run(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    run_all(epp.case(name))
