"""Several tests of this folder ask about one loop: which cycles it has at a value is sought once in a process."""

from __future__ import annotations

import pytest

from eppanalysis.methods.bounds import balanced
from tests import made_bounds


@pytest.fixture(autouse=True)
def seen_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(balanced, "_seen_at", made_bounds.seen_at)
