"""Every cycle of every shipped case goes on from its state and its memory.

Not collected by default: ``pytest tests/stress/check_restarts.py``, about two minutes.
"""

from __future__ import annotations

import pytest

import eppanalysis as epp
from tests.restarts import check_restart, cycles_of


@pytest.mark.parametrize("name", epp.shipped_cases())
def test_shipped_cycles_go_on_from_state_and_memory(name: str) -> None:
    system, value, cycles = cycles_of(name)
    for cycle in cycles:
        check_restart(system, value, cycle)
