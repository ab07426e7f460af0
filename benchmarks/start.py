"""What a fresh process costs: its start, commands, and peak memory of maps of different sizes."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Sequence
from typing import Any

TARGET_WARM, TARGET_MEMORY = 2.0, 300.0
#: Commands on a shipped case, with what each may take [s].
COMMANDS = {"predict relay_hyst_servo": 1.0, "simulate relay_hyst_servo": 0.8, "cycles relay_hyst_servo": 1.0}

FIRST_SIMULATION = """
import eppanalysis as epp
case = epp.case("fig8a_original")
epp.simulate(case.to_system(), case.input, t_end=case.t_end)
"""
PEAK = """
import json
from benchmarks.maps import peak_memory
print(json.dumps(peak_memory({side})))
"""


def fresh(code: str) -> tuple[float, str]:
    """Seconds of a Python process that runs `code`, and its output."""
    begin = time.perf_counter()
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return time.perf_counter() - begin, done.stdout


def _command(words: str, target: float, turns: int) -> dict[str, Any]:
    """Median time of a command in a process of its own, behind a first one that reads files."""
    code = f"import sys; from eppanalysis.cli import main; sys.argv[1:] = {words.split()!r}; main()"
    seconds = [fresh(code)[0] for _ in range(turns + 1)]
    middle = sorted(seconds[1:])[turns // 2]
    return {"words": words, "seconds": middle, "target": target, "met": middle < target}


def run(turns: int = 5, sides: Sequence[int] = (10, 20, 40)) -> dict[str, Any]:
    """Times of fresh processes, and memory of maps of `sides` squared cells."""
    fresh(FIRST_SIMULATION)  # reads files
    warm = sorted(fresh(FIRST_SIMULATION)[0] for _ in range(turns))[turns // 2]
    commands = [_command(words, target, turns) for words, target in COMMANDS.items()]
    bare = sorted(fresh("import eppanalysis")[0] for _ in range(turns))[turns // 2]
    memory = [json.loads(fresh(PEAK.format(side=side))[1]) for side in sides]
    largest = max(m["peak"] for m in memory)
    return {
        "warm": {"seconds": warm, "target": TARGET_WARM, "met": warm < TARGET_WARM},
        "import": {"seconds": bare},
        "commands": commands,
        "memory": {"cells": memory, "target": TARGET_MEMORY, "met": largest < TARGET_MEMORY},
    }
