"""What tests of identification share: few draws."""

from __future__ import annotations

import pytest

from tests.shared import draw_few


@pytest.fixture
def few_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    """Enough to see what happens, not to rely on intervals."""
    draw_few(monkeypatch)
