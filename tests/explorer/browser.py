"""A running explorer and a real browser without a window, for tests and for measurements."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

PROGRAMS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
_QUIET = ("--disable-gpu", "--disable-background-networking", "--disable-component-update", "--disable-sync")

#: The command line, but of a page that waits for ever before it begins with the slow pictures.
_FAST_ALONE = """
import eppanalysis.explorer.page as page
from eppanalysis.cli import main
page._CALM = 10**9
main()
"""

#: Finds things behind the shadow roots that Bokeh puts them in, and measures from a key to the picture it changes.
HELPERS = """
window.deep = (node, selector) => {
  const found = [];
  const walk = (here) => {
    if (here.matches && here.matches(selector)) found.push(here);
    if (here.shadowRoot) walk(here.shadowRoot);
    for (const child of here.children || []) walk(child);
  };
  walk(node);
  return found;
};
window.model = (name) => Bokeh.documents[0].get_model_by_name(name);
window.root = (name) => document.querySelector(`[data-root-id="${model(name).id}"]`);
window.slider = (field) => Bokeh.documents[0].roots().find((r) => r.tags && r.tags[0] === field);
window.pixels = (name) => {
  const small = document.createElement('canvas');
  [small.width, small.height] = [160, 80];
  const pen = small.getContext('2d', {willReadFrequently: true});
  for (const canvas of deep(root(name), 'canvas')) pen.drawImage(canvas, 0, 0, 160, 80);
  return pen.getImageData(0, 0, 160, 80).data.join();
};
window.watch = (name, limit) => new Promise((resolve) => {
  const before = pixels(name);
  let start = null;
  const begin = (event) => { start = event.timeStamp; window.removeEventListener('keydown', begin, true); };
  window.addEventListener('keydown', begin, true);
  const look = () => {
    const now = performance.now();
    if (start !== null && pixels(name) !== before) requestAnimationFrame(() => resolve(performance.now() - start));
    else if (start !== null && now - start > limit) resolve(null);
    else requestAnimationFrame(look);
  };
  requestAnimationFrame(look);
});
null;
"""


def find_chromium() -> str | None:
    """A Chromium that is installed."""
    return next((found for found in map(shutil.which, PROGRAMS) if found), None)


@contextmanager
def running_explorer(
    case: str = "fig8a_original", *options: str, slow_pictures: bool = True
) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """Address and process of an explorer; ended as Ctrl-C would.

    Without its slow pictures a page leaves the processor to what a test is about: every new value asks for seconds of
    work on exact cycles, branch and map. What the explorer says on its error stream is in the process' `said`.
    """
    program = ["-m", "eppanalysis"] if slow_pictures else ["-c", _FAST_ALONE]
    call = [sys.executable, *program, "explore", case, "--port", "0", "--no-browser", *options]
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    with tempfile.TemporaryFile("w+") as said:
        process = subprocess.Popen(call, stdout=subprocess.PIPE, stderr=said, text=True, env=environment)
        process.said = said
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            found = re.match(r"http://127\.0\.0\.1:\d+/[\w-]{20,}/", line)
            if not found:
                process.wait(10)
                said.seek(0)
                raise RuntimeError(f"no explorer: {line}{said.read()}")
            yield found.group(), process
        finally:
            process.send_signal(signal.SIGINT)
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            if process.stdout is not None:
                process.stdout.close()


@contextmanager
def running_browser():
    """A Chromium without a window."""
    from playwright.sync_api import sync_playwright

    arguments = [*_QUIET, *(["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else [])]
    with sync_playwright() as engine:
        browser = engine.chromium.launch(executable_path=find_chromium(), args=arguments)
        try:
            yield browser
        finally:
            browser.close()


def open_page(browser, address: str, width: int = 1200, height: int = 900, **options: str):
    """A tab with the page, when its first pictures are there; what it asks for elsewhere is written down."""
    page = browser.new_page(viewport={"width": width, "height": height}, **options)
    page.set_default_timeout(240_000)
    page.asked = []
    page.on("request", lambda request: page.asked.append(request.url))
    page.goto(address)
    page.wait_for_function("window.Bokeh && Bokeh.documents.length && Bokeh.documents[0].is_idle")
    page.evaluate(HELPERS)
    page.wait_for_function("model('step').renderers[0].data_source.data.time?.[0]?.length > 100")
    page.wait_for_function("['step', 'nyquist'].every((name) => !model(name) || root(name))")
    return page


def press(page, field: str, key: str = "ArrowRight", times: int = 1) -> None:
    """Move a slider by real keys."""
    page.evaluate(
        "(f) => deep(document.querySelector(`[data-root-id=\"${slider(f).id}\"]`), '.noUi-handle')[0].focus()", field
    )
    for _ in range(times):
        page.keyboard.press(key)


def wait(page, condition: str, seconds: float = 240.0) -> None:
    """Until a condition holds."""
    page.wait_for_function(condition, timeout=1000 * seconds)


def save(folder: Path, download) -> bytes:
    """What the browser was given."""
    target = folder / download.suggested_filename
    download.save_as(target)
    return target.read_bytes()


def pause(seconds: float) -> None:
    """Let time pass as a reader does between two moves."""
    time.sleep(seconds)
