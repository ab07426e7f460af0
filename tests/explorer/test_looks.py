"""How pictures of the page look in a real browser, pixel by pixel."""

from __future__ import annotations

import io
import math

import numpy as np
import pytest
from PIL import Image

from tests.explorer.browser import find_chromium, open_page, pause, running_browser, running_explorer, wait

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(find_chromium() is None, reason="no Chromium or Chrome is installed"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
]


def test_by_night_no_white_line_stays_at_the_edges_of_pictures():
    """Of a picture that begins between two pixels the edge is mixed with what was painted there before."""
    with running_explorer(slow_pictures=False) as (address, _), running_browser() as browser:
        page = open_page(browser, address, color_scheme="dark")
        wait(page, "[model('nyquist').background_fill_color].some((c) => (c.value ?? c) === '#16181c')")
        pause(0.5)
        place = "deep(root('nyquist'), '.bk-Figure')[0].getBoundingClientRect()"
        left, top = (math.floor(page.evaluate(f"{place}.{side}")) for side in ("left", "top"))
        shown = np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB")).astype(int)
    edges = shown[top + 60 : top + 200, left - 2 : left + 4], shown[top - 2 : top + 4, left + 5 : left + 60]
    assert all(np.all(np.abs(edge - (22, 24, 28)) < 12) for edge in edges)
