"""A sweep whose workers are jobs of a queueing system: the one that runs each job as a process of this machine."""

from __future__ import annotations

import subprocess
import sys
from importlib.util import find_spec

import pytest

import eppanalysis as epp
from eppanalysis.errors import EppError

if find_spec("dask_jobqueue") is None:
    pytest.skip("queues are a part of the installation that is missing here", allow_module_level=True)
# In a process of its own: what queues leave to the collector is not this suite's.
PROGRAM = """
import dask
import eppanalysis as epp

if __name__ == "__main__":
    dask.config.set({"jobqueue.local": {"cores": 1, "memory": "1GiB", "processes": 1}})
    case = epp.case("fig8a_original").with_values({"run.t_end": "0.3 s"})
    axes = {"bands.range": "1:5:6:lbf", "lock_pin.backlash": "0:3:8:deg"}
    there = epp.sweep(case, axes, scheduler="local", workers=2, progress=False)
    print(there.identical(epp.sweep(case, axes, progress=False)))
"""


@pytest.mark.slow
def test_jobs_give_the_same_bits(tmp_path) -> None:
    path = tmp_path / "program.py"
    path.write_text(PROGRAM, encoding="utf-8")
    done = subprocess.run([sys.executable, path], capture_output=True, text=True, check=True, timeout=300)
    assert done.stdout.split() == ["True"]


def test_a_queue_that_nobody_has_described_is_one_sentence() -> None:
    with pytest.raises(EppError, match=r"'slurm' is not described; expected cores, .*jobqueue\.slurm in"):
        epp.sweep(epp.case("fig8a_original"), {"bands.range": ["2 lbf"]}, scheduler="slurm", progress=False)
