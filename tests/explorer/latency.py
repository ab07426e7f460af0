"""From a slider's move to the changed picture on the screen, in a real browser: ``python -m tests.explorer.latency``.

A real key moves the slider; the clock runs from the key's own time stamp to the frame after the one in which the pixels
of the picture have changed. Moves come while nothing else is computed, and again as fast as they are answered.
"""

from __future__ import annotations

import argparse
import statistics
import sys

from tests.explorer.browser import open_page, pause, press, running_browser, running_explorer

FIELDS = ("lock_pin.backlash", "bands.range", "cable.stiffness", "forearm.prehensor_mass", "controller.delay")


def measure(page, picture: str = "step", rounds: int = 8, between: float = 0.2, fields=FIELDS) -> list[float]:
    """Times [ms] of `rounds` moves of every slider."""
    found = []
    for field in fields:
        for i in range(rounds):
            page.evaluate("(name) => { window.watching = watch(name, 5000); }", picture)
            press(page, field, "ArrowLeft" if i % 2 else "ArrowRight")
            took = page.evaluate("() => window.watching")
            if took is not None:
                found.append(float(took))
            pause(between)
    return found


def percentile(values: list[float], share: float) -> float:
    """The value that a share of all does not exceed."""
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=20, help="moves of every slider [20]")
    parser.add_argument("--case", default="fig8a_original")
    parser.add_argument("--fields", nargs="+", default=FIELDS, help="sliders that are moved [some of an elbow]")
    parser.add_argument("--settle", type=float, default=30.0, help="seconds before the first move [30]")
    options = parser.parse_args()
    with running_explorer(options.case) as (address, _), running_browser() as browser:
        page = open_page(browser, address)
        pause(options.settle)  # the slow pictures of the beginning
        for picture in ("step", "nyquist"):
            times = measure(page, picture, options.rounds, fields=options.fields)
            line = f"{picture}: {len(times)} moves, median {statistics.median(times):.0f} ms, "
            sys.stdout.write(line + f"95th percentile {percentile(times, 0.95):.0f} ms, longest {max(times):.0f} ms\n")


if __name__ == "__main__":
    main()
