"""The stored table of gains: each is that of a proof, which is made again here."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import eppanalysis as epp
from studies.proved_gains import LOOPS, RESULT, ProvedGains, servo, table

ROWS = [[cell.strip() for cell in line.split("|")[1:-1]] for line in RESULT.read_text("utf-8").splitlines()[2:]]
SECOND = "k/(s(s+1))"


def test_the_table_has_a_row_for_each_loop_and_two_per_cent_at_most() -> None:
    assert [row[0] for row in ROWS] == list(LOOPS)
    for name, free, cycle, gap, *_ in ROWS:
        apart = 2.0 * (float(cycle) - float(free)) / (float(cycle) + float(free))
        assert 0.0 < apart < 0.02 and gap == f"{100.0 * apart:.2f} %", name
    assert "| k | 1 | 1.01 | 1.00 % | 96 | 7 |" in table((ProvedGains("k", 1.0, 1.01, 96, 7.0),))


@pytest.mark.parametrize(
    "row", [pytest.param(row, id=row[0], marks=() if row[0] == SECOND else pytest.mark.slow) for row in ROWS]
)
def test_both_gains_are_proved_again_and_neither_statement_at_the_other(row: list[str], tmp_path) -> None:
    pytest.importorskip("clarabel")
    name, free, cycle = row[0], servo(row[0], float(row[1])), servo(row[0], float(row[2]))
    proof = epp.certify(free, "absence")
    assert proof.proved and epp.check_certificate(proof.write(tmp_path / "free.json")).accepted, name
    run = epp.simulate(replace(cycle, x0=np.full(cycle.A.shape[0], 30.0)), t_end=2000.0)
    orbit = epp.certify_orbit(cycle, epp.exact_orbit(cycle, run.limit_cycle))
    assert orbit.proved and epp.check_certificate(orbit.write(tmp_path / "cycle.json")).accepted
    assert orbit.period == pytest.approx(float(row[5]), rel=1e-3)
    assert not epp.certify(cycle, "absence", sectors=10).proved
