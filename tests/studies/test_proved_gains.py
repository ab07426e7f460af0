"""The stored table of gains: each is that of a proof, which is made again here."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import eppanalysis as epp
from studies.proved_gains import LOOPS, RESULT, ProvedGains, proved_gains, servo, table

ROWS = [[cell.strip() for cell in line.split("|")[1:-1]] for line in RESULT.read_text("utf-8").splitlines()[2:]]
SECOND = "k/(s(s+1))"


def test_the_table_has_a_row_for_each_loop_and_two_per_cent_at_most() -> None:
    assert [row[0] for row in ROWS] == list(LOOPS)
    for name, range_, cycle, gap, *_ in ROWS:
        start, free = map(float, range_.split(" to "))
        assert start < 0.11 * float(cycle)
        apart = 2.0 * (float(cycle) - free) / (float(cycle) + free)
        assert 0.0 < apart < 0.02 and gap == f"{100.0 * apart:.2f} %", name
    assert "| k | 0.1 to 1 | 1.01 | 1.00 % | 96 | 7 |" in table((ProvedGains("k", 0.1, 1.0, 1.01, 96, 7.0),))


def followed(name: str, gain: float) -> epp.LimitCycle:
    """The cycle of a gain near its least one: only from cycles of larger gains do runs come to it."""
    start, memory = np.full(len(LOOPS[name][1]) - 1, 30.0), (0.0,)
    for share in (1.2, 1.1, 1.05, 1.02, 1.01, 1.005, 1.0):
        loop = servo(name, share * gain)
        run = epp.simulate(replace(loop, x0=start, memory=memory if share < 1.2 else loop.memory), t_end=2000.0)
        orbit = epp.exact_orbit(loop, run.limit_cycle)
        start, memory = orbit.state, orbit.memory
    return orbit


def test_both_gains_of_second_order_are_proved_from_files(tmp_path) -> None:
    pytest.importorskip("clarabel")
    name, range_, cycle, *_, period = next(row for row in ROWS if row[0] == SECOND)
    start, free = map(float, range_.split(" to "))
    proof = epp.certify(epp.Case.from_system(servo(name, 1.0)), "absence", within={"loop.gain": (start, free)})
    file = proof.write(tmp_path / "free.json")
    assert proof.proved and all(epp.check_certificate(file, servo(name, k)).about for k in (start, 0.5 * free, free))
    orbit = epp.certify_orbit(servo(name, float(cycle)), followed(name, float(cycle)))
    assert orbit.proved and epp.check_certificate(orbit.write(tmp_path / "cycle.json")).accepted
    assert orbit.period == pytest.approx(float(period), rel=1e-3)
    assert not epp.certify(servo(name, float(cycle)), "absence", sectors=10).proved


@pytest.mark.slow
@pytest.mark.parametrize("row", ROWS[::4], ids=lambda row: row[0])
def test_the_study_finds_the_gains_of_the_table_again(row: list[str]) -> None:
    pytest.importorskip("clarabel")
    made = table((proved_gains(row[0]),)).splitlines()[-1]
    assert [cell.strip() for cell in made.split("|")[1:5]] == row[:4]
