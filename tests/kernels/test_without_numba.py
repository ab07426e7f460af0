"""Kernels with numba switched off: the twins in plain numpy give the same bits."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]

_RUNS = """
import hashlib
import numpy as np
import eppanalysis as epp

play = epp.LureSystem.from_tf(([4.0], [1.0, 1.0, 1.0]), epp.Play(gap=0.5), delay=0.3)
relay = epp.LureSystem.from_tf(([1.0], [1.0, 3.0, 2.0, 0.0]), epp.Relay())
many = epp.LureSystem.build(
    2.0 * np.eye(18, k=-1) - np.eye(18), -np.eye(18)[:, :1], np.eye(18)[17:], [epp.Relay()], x0=np.ones(18)
)
case = epp.case("fig8a_original")
total = hashlib.sha256()
runs = ((play, None, 3.0), (relay, None, 20.0), (many, None, 9.0), (case.to_system(), case.input, 0.5))
for loop, motion, t_end in runs:
    run = epp.simulate(loop, motion, t_end=t_end, t_eval=np.linspace(0.0, t_end, 41))
    total.update(b"".join(v.tobytes() for v in run.signals.values()))
    total.update(repr([e.time for e in run.events]).encode())
digest = total.hexdigest()
"""


def test_the_engine_runs_without_numba_to_the_same_bits() -> None:
    here: dict[str, str] = {}
    exec(_RUNS, here)
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "NUMBA_DISABLE_JIT": "1"}
    code = [sys.executable, "-c", f"{_RUNS}print(digest)"]
    there = subprocess.run(code, capture_output=True, text=True, check=True, env=environment)
    assert there.stdout.strip() == here["digest"]
