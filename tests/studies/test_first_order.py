"""The stored study of first order: some of its loops are done again, and what the documentation says is checked."""

from __future__ import annotations

import numpy as np
import pytest

from studies import first_order as study

pytestmark = pytest.mark.slow


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


def test_what_the_page_says():
    rows = study.read()
    real = [r for r in rows if r.exists]
    far = [r for r in real if r.ratio >= 2.0 and r.element != "relay"]
    assert np.median([r.error_frequency for r in far]) < 2e-3
    assert np.quantile([r.error_peak_to_peak for r in far], 0.95) < 0.1
    play = [r for r in rows if r.element == "play"]
    invented = [r for r in play if not r.exists]
    assert 0.15 < len(invented) / len(play) < 0.3
    assert min(r.estimate for r in invented) > 0.5
    wrong = [r for r in real if str(r.stable) != r.exact_stable]
    assert len(wrong) < 0.02 * len(real)
    assert all(r.estimate > 0.5 for r in rows if not r.exists)
    # Of a quantiser's many cycles the exact search may list the neighbour only.
    missed = [r for r in real if r.estimate < r.error]
    assert sum(r.element == "quantiser" and r.error > 100.0 * r.estimate for r in missed) >= len(missed) - 5
