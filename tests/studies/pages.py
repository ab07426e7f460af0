"""Faults of built pages: ``python -m tests.studies.pages HTML`` after ``sphinx-build``.

Dead internal links and pictures without a text in their place are read from the files. A browser sees formulas and rows
of tables that do not render, what is wider than the screen, must be scrolled sideways or is torn (at 420 and at 1400
pixels), and texts with too little contrast (WCAG 2 AA, light and dark), on every page, those of the interface too.
"""

from __future__ import annotations

import os
import sys
from collections import defaultdict
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from tests.explorer.browser import running_browser

WIDTHS = 420, 1400
THEMES = "light", "dark"
#: Pages that Sphinx makes by itself, from sources that are checked elsewhere.
MADE = "genindex.html", "py-modindex.html", "search.html"

#: Formulas that are shown as their source, or as an error.
BROKEN = """
() => [...document.querySelectorAll('mjx-merror, .math:not(:has(mjx-container))')]
  .map((node) => node.textContent.slice(0, 60))
"""

#: Rows of a table that are shown as their source.
TORN = """
() => [...document.querySelectorAll('article p')].map((node) => node.textContent.trim())
  .filter((text) => /^\\|.*\\|.*\\|$/s.test(text)).map((text) => text.slice(0, 60))
"""

#: Names in code that go on in the next line, and emphasis that began or ended in the middle of a bracket.
BROKEN_UP = """
() => [
  ...[...document.querySelectorAll('code .pre')].filter((node) => node.getClientRects().length > 1
    && new Set([...node.getClientRects()].map((box) => Math.round(box.top))).size > 1),
  ...[...document.querySelectorAll('article em')].filter((node) =>
    node.textContent.split('(').length !== node.textContent.split(')').length),
].map((node) => node.textContent.slice(0, 60))
"""

#: What sticks out of the page, and is neither in a box that scrolls nor out of sight.
WIDE = """
() => {
  const width = document.documentElement.clientWidth;
  const hidden = (node) => {
    for (let here = node; here && here !== document.body; here = here.parentElement) {
      const style = getComputedStyle(here);
      if (['auto', 'scroll', 'hidden', 'clip'].includes(style.overflowX) && here !== node) return true;
      if (style.position === 'fixed' || style.visibility === 'hidden') return true;
    }
    return false;
  };
  const name = (node) => node.tagName.toLowerCase() + (node.className && node.className.trim
    ? '.' + node.className.trim().split(/\\s+/).join('.') : '');
  const whole = document.documentElement.scrollWidth;
  const parts = [...document.querySelectorAll('article *')].filter((node) => {
    const box = node.getBoundingClientRect();
    return box.width > 0 && box.right > width + 1 && !hidden(node);
  }).slice(0, 3).map((node) => `${name(node)} to ${Math.round(node.getBoundingClientRect().right)} px`);
  return whole > width + 1 && !parts.length ? [`the page, ${whole} px`] : parts;
}
"""

#: What has to be scrolled sideways inside its box: on a phone a table may, if a shadow says so.
SIDEWAYS = """
() => [...document.querySelectorAll('article, article *')].filter((node) => {
  const style = getComputedStyle(node);
  const table = node.querySelector('table') && innerWidth < 1000 && style.backgroundImage !== 'none';
  return ['auto', 'scroll'].includes(style.overflowX) && node.scrollWidth > node.clientWidth + 1
    && node.checkVisibility() && !table;
}).map((node) => `${node.scrollWidth} px in ${node.clientWidth}: `
  + (node.querySelector('mjx-assistive-mml') || node).textContent.trim().slice(0, 50))
"""

#: Texts whose colour is too near to that behind them.
PALE = """
() => {
  const pen = document.createElement('canvas').getContext('2d', {willReadFrequently: true});
  const colour = (text) => {
    pen.clearRect(0, 0, 1, 1); pen.fillStyle = text; pen.fillRect(0, 0, 1, 1);
    const [r, g, b, a] = pen.getImageData(0, 0, 1, 1).data;
    return [r, g, b, a / 255];
  };
  const over = (top, below) => top.slice(0, 3).map((c, i) => c * top[3] + below[i] * (1 - top[3]));
  const luminance = (rgb) => {
    const [r, g, b] = rgb.map((c) => (c / 255 <= 0.04045 ? c / 255 / 12.92 : ((c / 255 + 0.055) / 1.055) ** 2.4));
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const behind = (node) => {
    const layers = [];
    for (let here = node; here; here = here.parentElement) layers.push(colour(getComputedStyle(here).backgroundColor));
    return layers.reverse().reduce((below, layer) => over(layer, below), [255, 255, 255]);
  };
  const found = new Set();
  const walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let text = walk.nextNode(); text; text = walk.nextNode()) {
    const node = text.parentElement;
    if (!text.data.trim() || !node.checkVisibility({checkOpacity: true, checkVisibilityCSS: true})) continue;
    if (node.closest('.headerlink, .visually-hidden, script, style, [aria-hidden=true], mjx-container')) continue;
    if (!node.getClientRects().length) continue;
    const style = getComputedStyle(node);
    const back = behind(node);
    const [light, dark] = [luminance(over(colour(style.color), back)), luminance(back)].sort((a, b) => b - a);
    const ratio = (light + 0.05) / (dark + 0.05);
    const size = parseFloat(style.fontSize);
    const large = size >= 24 || (size >= 18.66 && parseInt(style.fontWeight) >= 700);
    if (ratio < (large ? 3 : 4.5) - 0.005)
      found.add(`${node.tagName}.${node.className} ${ratio.toFixed(2)}, as in "${text.data.trim().slice(0, 24)}"`);
  }
  return [...found];
}
"""


class Page(HTMLParser):
    """What a file points to, what can be pointed to in it, and pictures without a text."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.places: set[str] = set()
        self.silent: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        named = {name: value or "" for name, value in attrs}
        self.places.update(named[key] for key in ("id", "name") if key in named)
        self.links += [named[key] for key in ("href", "src") if named.get(key)]
        if tag == "img" and (not named.get("alt", "").strip() or named["alt"].strip() in named.get("src", "")):
            self.silent.append(named.get("src", "")[:60])


def pages_of(folder: Path) -> dict[Path, Page]:
    """All pages that are built from sources of the documentation."""
    return {
        path: Page(path.read_text(encoding="utf-8"))
        for path in sorted(folder.rglob("*.html"))
        if path.name not in MADE and "_modules" not in path.parts and "_static" not in path.parts
    }


def read_faults(folder: Path) -> Iterator[tuple[str, str]]:
    """Dead links and silent pictures, with their page."""
    pages = pages_of(folder)
    for path, page in pages.items():
        name = str(path.relative_to(folder))
        yield from ((name, f"dead link {link}") for link in dict.fromkeys(page.links) if is_dead(link, path, pages))
        yield from ((name, f"picture without a text: {source}") for source in page.silent)


def is_dead(link: str, path: Path, pages: dict[Path, Page]) -> bool:
    """Whether a link of a page leads to no file of the site, or to no place in it."""
    parts = urlsplit(link)
    if parts.scheme or parts.netloc:
        return False
    target = Path(os.path.normpath(path.parent / unquote(parts.path))) if parts.path else path
    if not target.exists():
        return True
    if not parts.fragment or target.suffix != ".html":
        return False
    there = pages.get(target) or Page(target.read_text(encoding="utf-8"))
    return unquote(parts.fragment) not in there.places


def seen_faults(browser: Any, address: str) -> Iterator[str]:
    """What a browser sees on one page."""
    tab = browser.new_page(viewport={"width": WIDTHS[-1], "height": 900})
    tab.goto(address)
    if tab.query_selector(".math"):
        tab.wait_for_function("window.MathJax && MathJax.startup && MathJax.startup.promise", timeout=20_000)
        tab.evaluate("() => MathJax.startup.promise")
        yield from (f"broken formula: {text}" for text in tab.evaluate(BROKEN))
    yield from (f"torn table: {text}" for text in tab.evaluate(TORN))
    for width in WIDTHS:
        tab.set_viewport_size({"width": width, "height": 900})
        for theme in THEMES:
            tab.evaluate("(theme) => { document.body.dataset.theme = theme; }", theme)
            yield from (f"little contrast, {theme}, {width} px: {text}" for text in tab.evaluate(PALE))
        yield from (f"wider than {width} px: {text}" for text in tab.evaluate(WIDE))
        yield from (f"scrolled sideways at {width} px: {text}" for text in tab.evaluate(SIDEWAYS))
        yield from (f"torn at {width} px: {text}" for text in tab.evaluate(BROKEN_UP))
    tab.close()


def faults(folder: Path) -> dict[str, list[str]]:
    """All faults, each with the pages that have it."""
    found: dict[str, list[str]] = defaultdict(list)
    for page, fault in read_faults(folder):
        found[fault].append(page)
    with running_browser() as browser:
        for path in pages_of(folder):
            for fault in seen_faults(browser, path.resolve().as_uri()):
                found[fault].append(str(path.relative_to(folder)))
    return dict(found)


def main(folder: str) -> int:
    """Write them down; one if there are any."""
    found = faults(Path(folder))
    for fault, pages in found.items():
        more = f" and {len(pages) - 3} more" if len(pages) > 3 else ""
        sys.stdout.write(f"{fault}\n    on {', '.join(pages[:3])}{more}\n")
    sys.stdout.write(f"{len(found)} faults\n")
    return bool(found)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
