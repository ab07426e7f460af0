"""Progress: cells, rate and time left on a terminal and in a notebook, nothing in a pipe."""

from __future__ import annotations

import threading

import pytest
import rich.console
from eppanalysis.sweep.progress import progress


def test_nothing_is_shown_in_a_pipe(capfd) -> None:
    with progress(10, 0, True) as report:
        report(10)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("wanted", [True, False])
def test_a_terminal_shows_cells_and_rate(capfd, monkeypatch, wanted) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    with progress(40, 10, wanted) as report:
        for _ in range(3):
            report(10)
    shown = capfd.readouterr().err
    assert ("40/40" in shown) is wanted
    assert ("cells/s" in shown) is wanted


def test_a_finished_sweep_shows_nothing(capfd, monkeypatch) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    with progress(40, 40, True):
        pass
    assert capfd.readouterr().err == ""


def test_a_notebook_has_one_line_that_ends_complete(monkeypatch) -> None:
    shell = pytest.importorskip("IPython.display")
    lines: list[str] = []

    class Handle:
        def update(self, data, raw):
            assert raw
            lines.append(data["text/plain"])

    monkeypatch.setattr(shell, "display", lambda data, **_: lines.append(data["text/plain"]) or Handle())
    monkeypatch.setattr(rich.console, "_is_jupyter", lambda: True)
    with progress(30, 10, True) as report:
        worker = threading.Thread(target=report, args=(20,))
        worker.start()
        worker.join()
    assert "10/30" in lines[0]
    assert "30/30" in lines[-1]
    assert all("\n" not in line for line in lines)
