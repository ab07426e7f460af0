"""Progress: how much of how much, rate and time left, on a terminal and in a notebook; nothing in a pipe."""

from __future__ import annotations

import threading

import pytest
import rich.console

from eppanalysis.progress import progress_bar, steps


def test_nothing_is_shown_in_a_pipe(capfd) -> None:
    with progress_bar("cells", 10, unit="cells") as report:
        assert report is None
        steps(report, 10)(10)
    assert capfd.readouterr() == ("", "")


def test_a_terminal_shows_cells_and_rate(capfd, monkeypatch) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    with progress_bar("cells", 40, 10, unit="cells", keep=True) as report:
        advance = steps(report, 40, 10)
        for _ in range(3):
            advance(10)
    shown = capfd.readouterr().err
    assert "40/40" in shown and "cells/s" in shown


def test_a_terminal_shows_what_is_being_done(capfd, monkeypatch) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    with progress_bar("cycles") as report:
        report(3, None, "3 runs, 1 cycle")
    shown = capfd.readouterr().err
    assert "3 runs, 1 cycle" in shown and "/s" not in shown


def test_what_is_finished_shows_nothing(capfd, monkeypatch) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    with progress_bar("cells", 40, 40):
        pass
    assert capfd.readouterr().err == ""


def test_steps_add_up_from_any_thread() -> None:
    told: list[int] = []
    advance = steps(lambda done, of, doing: told.append(done), 200)
    threads = [threading.Thread(target=lambda: [advance(1) for _ in range(50)]) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert told == list(range(1, 201))


def test_a_notebook_has_one_line_that_ends_complete(monkeypatch) -> None:
    shell = pytest.importorskip("IPython.display")
    lines: list[str] = []

    class Handle:
        def update(self, data, raw):
            assert raw
            lines.append(data["text/plain"])

    monkeypatch.setattr(shell, "display", lambda data, **_: lines.append(data["text/plain"]) or Handle())
    monkeypatch.setattr(rich.console, "_is_jupyter", lambda: True)
    with progress_bar("cells", 30, 10, unit="cells") as report:
        worker = threading.Thread(target=steps(report, 30, 10), args=(20,))
        worker.start()
        worker.join()
    assert "10/30" in lines[0]
    assert "30/30" in lines[-1]
    assert all("\n" not in line for line in lines)
