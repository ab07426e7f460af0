"""What tests of identification share: few draws."""

from __future__ import annotations

import pytest

from eppanalysis.identify import sampling, step, surface


@pytest.fixture
def few_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    """Enough to see what happens, not to rely on intervals."""
    for place, name, least in (
        (step, "STARTS", 30), (step, "KEPT_STARTS", (4, 2, 1, 1, 1)), (step, "ROUNDS", 1), (surface, "ROUNDS", 2),
        (sampling, "CHAINS", 10), (sampling, "BEFORE", 10), (sampling, "TURNS", 10), (sampling, "_PLACES", 16),
        (sampling, "_TURNS", 6),
    ):  # fmt: skip
        monkeypatch.setattr(place, name, least)
