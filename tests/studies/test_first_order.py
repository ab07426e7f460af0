"""The stored study of first order: some of its loops are done again, and what the documentation says is checked."""

from __future__ import annotations

import re

import numpy as np
import pytest

from studies import DOCS, first_order as study, first_order_tables as tables

PAGE = (DOCS / "how_we_know.md").read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("element", ["relay", "saturation", "dead zone", "play", "jump and follow", "preload"])
def test_stored_rows_come_out_again(element):
    stored = [r for r in study.read() if r.element == element and r.number in (0, 1)]
    again = [r for number in (0, 1) for r in study.rows_of(element, number)]
    assert len(again) == len(stored)
    for old, new in zip(stored, again, strict=True):
        assert (new.poles, new.relative_degree, new.stable, new.exact_stable) == (
            old.poles,
            old.relative_degree,
            old.stable,
            old.exact_stable,
        )
        for name in ("ratio", "omega", "estimate", "error_frequency", "error_peak_to_peak"):
            assert getattr(new, name) == pytest.approx(getattr(old, name), rel=1e-3, abs=1e-9, nan_ok=True)


def test_there_are_enough_loops_and_the_estimate_covers_them():
    rows = study.read()
    assert len({(r.element, r.number) for r in rows}) >= 500
    real = [r for r in rows if r.exists]
    assert np.mean([r.estimate >= r.error for r in real]) >= 0.95
    # It is an estimate and no bound out of reach: in the median it is within a third of the error.
    assert np.median([r.estimate / r.error for r in real]) < 4 / 3


def share(values, quantile):
    """A quantile in per cent."""
    return 100.0 * float(np.quantile(values, quantile))


def test_what_the_page_says():
    rows = study.read()
    real = [r for r in rows if r.exists]
    far = [r for r in real if r.ratio >= 2.0 and r.element != "relay"]
    frequency, size = ([getattr(r, f"error_{of}") for r in far] for of in ("frequency", "peak_to_peak"))
    assert "within 0.2 % in frequency and 1 % in size" in PAGE
    assert share(frequency, 0.5) < 0.2 and share(size, 0.5) < 1.0
    assert re.search(r"within\s+3 % and 10 %", PAGE)
    assert share(frequency, 0.95) < 3.0 and share(size, 0.95) < 10.0
    near = [r.error_frequency for r in real if r.ratio < 1.5 and r.element != "relay"]
    assert share(near, 0.9) > float(re.search(r"one cycle in ten is off by more than (\d+) %", PAGE)[1])
    fall = [r.error_frequency for r in real if r.relative_degree >= 2]
    assert share(fall, 0.5) < 0.5 and share(fall, 0.9) < 6.0
    assert f"all {len(real)} cycles that exist have an exact one of the predicted stability" in PAGE
    assert all(str(r.stable) == r.exact_stable for r in real)
    assert all(r.estimate > 0.5 for r in rows if not r.exists)
    # Of a quantiser's many cycles the exact search may list the neighbour only.
    missed = [r for r in real if r.estimate < r.error]
    assert sum(r.element == "quantiser" and r.error > 100.0 * r.estimate for r in missed) >= len(missed) - 5


def test_what_the_page_says_of_play():
    play = [r for r in study.read() if r.element == "play"]
    invented = [r for r in play if not r.exists]
    unstable = sum(not r.stable for r in invented)
    assert f"{len(invented)} of {len(play)} predicted cycles do not exist, {unstable} of them unstable" in PAGE
    assert max(r.ratio for r in invented) < 3.1
    assert "estimates exceed 900 %" in PAGE and min(r.estimate for r in invented) > 9.0


def test_groups_by_amplitude_hold_what_their_names_say():
    rows = [r for r in study.read() if r.element != "relay"]
    _, lines = tables.by_ratio()
    for name, cycles, *_ in lines:
        low, high = map(float, name.replace("\N{NO-BREAK SPACE}", " ").split(" to "))
        assert int(cycles) == sum(low <= r.ratio < high for r in rows), name
    assert f"and {len(rows) - sum(int(line[1]) for line in lines)} cycles outside" in PAGE
