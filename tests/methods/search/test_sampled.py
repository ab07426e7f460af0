"""Triggers and basins of sampled loops, by runs, against the map from sample to sample."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg

import eppanalysis as epp
from tests.sampled_relay import sampled_relay
from tests.shared import cycles_of, mostly_slow

DEAD, T = 0.16, 0.5


PLANT = epp.blocks.ZeroPoleGain(poles=[-1.0, -1.0, -1.0]).state_space()


def rests(state: np.ndarray, held: float = 0.0) -> bool:
    """Whether the map from sample to sample comes to rest: disturbed behind a sample, with the relay's output held."""
    M = np.zeros((4, 4))
    M[:3, :3], M[:3, 3] = PLANT.A, PLANT.B[:, 0]
    X = scipy.linalg.expm(M * T)
    x = X[:3, :3] @ state + X[:3, 3] * held
    for _ in range(200):
        x = X[:3, :3] @ x + X[:3, 3] * relay(x)
    return bool(np.abs(x).max() < 1e-6)


def relay(x: np.ndarray) -> float:
    y = float(PLANT.C[0] @ x)
    return -float(np.sign(y)) if abs(y) > DEAD else 0.0


@pytest.fixture(scope="module")
def case() -> epp.Case:
    return sampled_relay()


@pytest.fixture(scope="module")
def found(case: epp.Case) -> epp.CycleSearch:
    return epp.find_limit_cycles(case)


@pytest.mark.parametrize("place", mostly_slow([0, 1, 2], [0]))
def test_the_smallest_disturbance_is_that_of_the_map(case: epp.Case, found: epp.CycleSearch, place: int) -> None:
    up, down = epp.trigger(case, cycles=found, states=[f"plant_{place + 1}"])
    for hit in (up, down):
        state = np.eye(3)[place]
        assert rests(hit.settles * state) and not rests(hit.starts * state)
        assert abs(hit.starts / hit.settles - 1.0) < 2e-7
        assert "disturbed just after a sample" in str(hit) and hit.not_covered in str(hit)
        assert hit.to_dict()["not_covered"] == hit.not_covered
        shown = " ".join(" ".join(t.get_text() for t in hit.plot().texts).split())
        assert "disturbed just after a sample" in shown


def test_runs_end_where_the_map_ends(case: epp.Case) -> None:
    system = case.to_system()
    plant = [i for i, name in enumerate(system.state_names) if name.startswith("plant")]
    starts = np.zeros((24, system.x0.size))
    starts[:, plant] = np.random.default_rng(7).uniform(-3.0, 3.0, (24, 3)) * [1.0, 1.0, 0.3]
    ends = [epp.simulate(replace(system, x0=start), t_end=300.0).status for start in starts]
    # The first sample is taken at once.
    wanted = [rests(start[plant], relay(start[plant])) for start in starts]
    assert 3 < sum(wanted) < 21
    assert [end is epp.Status.SETTLED for end in ends] == wanted
    assert set(ends) == {epp.Status.SETTLED, epp.Status.LIMIT_CYCLE}


def patterns_of_relay(x: np.ndarray, T: float) -> list[str]:
    """What a relay on 1/(s^2 + s) does at the samples of the cycles that runs from states x end on, one for each."""
    M = np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 1.0], [0.0, 0.0, 0.0]])
    X, path, given = scipy.linalg.expm(M * T), [], []
    for _ in range(600):
        given.append(np.where(x[:, 0] >= 0.0, -1.0, 1.0))
        path.append(x)
        x = x @ X[:2, :2].T + given[-1][:, None] * X[:2, 2]
    away = np.abs(np.array(path[-100:]) - x).max(axis=2) < 1e-9
    marks = ["".join("-+"[int(u[k] > 0)] for u in given) for k in range(len(x))]
    turns = [mark[-n:] for mark, n in zip(marks, np.argmax(away[::-1], axis=0) + 1, strict=True)]
    return [min(turn[k:] + turn[:k] for k in range(len(turn))) for turn in turns]


@pytest.mark.slow
def test_each_continuum_of_a_sampled_relay_is_listed_once() -> None:
    """The integrator keeps where the motion lies: each pattern of the relay is a continuum of cycles."""
    T = 0.5
    reader = epp.SampledController([], [], [], [[1.0]], T)
    loop = epp.LureSystem.build(
        [[0.0, 1.0], [0.0, -1.0]], [[0.0, 0.0], [0.0, -1.0]], [[1.0, 0.0], [0.0, 0.0]], [reader, epp.Relay()],
        D=[[0.0, 0.0], [1.0, 0.0]], x0=[1.0, 0.0],
    )  # fmt: skip
    found = epp.find_limit_cycles(loop)
    listed = patterns_of_relay(np.array([c.state[:2] for c in found]), T)
    rng = np.random.default_rng(1)
    starts = np.exp(rng.uniform(-5.0, 1.0, (2000, 1))) * rng.normal(size=(2000, 2))
    met = Counter(patterns_of_relay(starts, T))
    assert [round(c.period / T) for c in found] == [len(mark) for mark in listed]
    assert len(set(listed)) == len(listed) == found.n_continua and all(c.stable for c in found)
    assert {mark for mark, n in met.items() if n > 10} <= set(listed)
    assert 22 in map(len, listed)


@pytest.mark.slow
def test_a_cycle_on_a_threshold_is_the_border_of_a_continuum():
    """The integrator of the converter counts in whole steps: one cycle ends a sample on a level of its modulator."""
    found = cycles_of("buck_converter")
    closed = [cycle for cycle in found if cycle.method == "exact orbit"]
    assert len(closed) == found.n_continua == len(found) and found.status.ok
    samples = Counter(round(cycle.period / 4e-6) for cycle in closed)
    assert {28, 55, 82} <= set(samples) and max(samples.values()) <= 2
    for n in (n for n, times in samples.items() if times == 2):  # the two are mirror images
        one, other = (cycle.mean["voltage"] for cycle in closed if round(cycle.period / 4e-6) == n)
        assert one == pytest.approx(-other, rel=1e-6)
    for cycle in closed:
        assert cycle.stable and cycle.residual < 1e-13
        assert np.min(np.abs(cycle.multipliers - 1.0)) < 1e-8


@pytest.mark.slow
def test_the_search_of_the_azimuth_servo_comes_to_all_three_cycles() -> None:
    """Its cycles are those of the same servo without samples, of which an independent study found three."""
    found = cycles_of("azimuth_servo")
    assert sorted(c.period for c in found) == pytest.approx([12.63, 19.76, 26.89465], rel=1e-3)
    assert all(c.note.startswith("not locked to the samples") for c in found)
    # Its integral moves by whole steps of the encoder in a turn: attempts to close that took all the work of runs.
    assert found.provenance.statistics["work"] < 9.6e6 and "stopped early" not in found.search


@pytest.mark.slow
def test_starts_reach_cycles_where_a_controller_stands_before_the_element() -> None:
    """Nothing but the controller's own output tells where the relay switches: the states have no size of their own."""
    T = 0.5
    M = scipy.linalg.expm(T * np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 1.0], [0.0, 0.0, 0.0]]))
    gain = epp.SampledController([], [], [], [[1.0]], T)
    loop = epp.LureSystem.build(
        [[0.0, 1.0], [0.0, -1.0]], [[0.0, 0.0], [0.0, 1.0]], [[-1.0, 0.0], [0.0, 0.0]],
        [gain, epp.RelayDeadZone(0.02, 1.0)], D=[[0.0, 0.0], [1.0, 0.0]],
    )  # fmt: skip
    found = epp.find_limit_cycles(loop, predicted=[])
    assert found.stable
    # By hand from many states: each cycle that runs end on has as many samples as one that is listed.
    x = np.random.default_rng(3).normal(size=(200, 2))
    path = []
    for _ in range(900):
        w = np.sign(-x[:, 0]) * (np.abs(x[:, 0]) >= 0.02)
        path.append(x)
        x = x @ M[:2, :2].T + w[:, None] * M[:2, 2]
    last = np.array(path[-200:])
    back = np.abs(last[:-1] - last[-1]).max(axis=2)[::-1] < 1e-9
    moving = np.ptp(last, axis=0).max(axis=1) > 1e-6
    turns = Counter((np.argmax(back, axis=0) + 1)[moving & back.any(axis=0)].tolist())
    assert turns and {n for n, times in turns.items() if times >= 10} <= {round(c.period / T) for c in found}


@pytest.mark.slow
def test_a_motion_that_beats_with_the_samples_is_as_large_as_it_becomes() -> None:
    """A double integrator with a resonance under a sampled relay: two of its motions never close, and beat."""
    T, level = 0.3, 0.05
    A = np.array([[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0], [0.0, 0.0, -1.0, -0.2]])
    B, read = np.array([[0.0], [0.0], [0.0], [1.0]]), np.array([-1.0, -2.0, 0.0, 0.0])
    reader = epp.SampledController([], [], [], [[1.0]], T)
    loop = epp.LureSystem.build(
        A, np.hstack([0.0 * B, B]), np.vstack([read, 0.0 * read]), [reader, epp.HysteresisRelay(-level, level)],
        D=[[0.0, 0.0], [1.0, 0.0]], x0=[1.0, 0.0, 0.0, 0.0], element_names=["reader", "relay"],
    )  # fmt: skip
    parts = 10
    held = scipy.linalg.expm(np.block([[A, B], [np.zeros((1, 5))]]) * T / parts)

    def size_later(cycle: epp.LimitCycle) -> float:
        """Of the motion from the cycle's state on, after 6000 s."""
        x, u, seen = cycle.state[:4].copy(), 0.0, []
        put_out = cycle.memory[0].output[0]  # the relay acts on this until the next sample
        for _ in range(20_000):
            u = 1.0 if put_out > level else -1.0 if put_out < -level else u or cycle.memory[1]
            for _ in range(parts):
                x = held[:4, :4] @ x + held[:4, 4] * u
                seen.append(read @ x)
            put_out = seen[-1]
        return float(np.ptp(seen[-20_000:]))

    for cycle in epp.find_limit_cycles(loop):
        if cycle.stable is not False:
            assert cycle.peak_to_peak["reader_input"] == pytest.approx(size_later(cycle), rel=0.03)


@pytest.mark.slow
def test_what_creeps_to_another_size_is_no_cycle() -> None:
    """A double integrator with a resonance under a sampled relay whose sizes creep by a ten-thousandth in a turn."""
    T, gain, level, out = 0.46239, 1.3146, 0.3463, 0.8068
    plant = epp.LureSystem.from_tf(([0.00707, 0.0273, 0.0153], [1.0, 0.362, 0.2516, 0.0, 0.0]), epp.Relay())
    A, B, C = plant.A, plant.B, plant.C
    relay = epp.HysteresisRelay(-level, level, -out, out)
    loop = epp.LureSystem.build(
        A, np.hstack([B, 0.0 * B]), np.vstack([0.0 * C, C]), [relay, epp.SampledController([], [], [], [[gain]], T)],
        D=[[0.0, 1.0], [0.0, 0.0]],
    )  # fmt: skip
    held = scipy.linalg.expm(np.block([[A, B], [np.zeros((1, 5))]]) * T)
    sizes = []
    for cycle in epp.find_limit_cycles(loop).stable:
        x, u, seen = cycle.state[:4].copy(), float(cycle.memory[0]), []
        for _ in range(400_000):
            v = gain * float((C @ x)[0])
            u = out if v > level else -out if v < -level else u
            x = held[:4, :4] @ x + held[:4, 4] * u
            seen.append(v)
        sizes.append((cycle.peak_to_peak["hysteresis_relay_input"], float(np.ptp(seen[-5000:]))))
    assert all(abs(np.log(size / later)) < 0.2 for size, later in sizes), sizes


def test_the_state_of_rest_has_a_clock_at_zero() -> None:
    """It is the state in which a run begins to rest: the clock told how long the run was that had come there."""
    parts = {
        "reader": epp.SampledController([], [], [], [[0.5]], 0.2),
        "limit": epp.Saturation(-1.0, 1.0),
        "lag": epp.blocks.TransferFunction(num=[1.0], den=[1.0, 1.0]),
    }
    loop = epp.Diagram(parts=parts, connect=["lag -> reader", "reader -> limit", "-limit -> lag"]).to_system()
    found = epp.find_limit_cycles(loop)
    assert found.settles and len(found) == 0
    assert found.rest_state == pytest.approx(np.zeros(len(loop.A)), abs=1e-9)


@pytest.mark.parametrize("offsets", [(0.1, 0.2), (0.2, 0.1)])
def test_cycles_keep_the_offsets_of_two_controllers(offsets):
    """Samples of one rate never come nearer to each other: of a cycle, too, the time between them is that given."""

    def held(offset):
        return epp.SampledController([], np.zeros((0, 1)), np.zeros((1, 0)), [[1.0]], sample_time=0.25, offset=offset)

    loop = epp.Diagram(
        parts={
            "sensor": held(offsets[0]),
            "relay": epp.RelayDeadZone(threshold=0.1, level=1.0),
            "actuator": held(offsets[1]),
            "plant": epp.blocks.TransferFunction(num=[5.0], den=[1.0, 1.0, 0.0], start=[0.3, -0.2]),
        },
        connect=["-plant -> sensor", "sensor -> relay", "relay -> actuator", "actuator -> plant"],
    ).to_system()
    cycles = epp.find_limit_cycles(loop).cycles
    due = np.array([[cycle.memory[k].due for k in (0, 2)] for cycle in cycles])
    assert len(due) > 3
    np.testing.assert_allclose((due[:, 1] - due[:, 0]) % 0.25, (offsets[1] - offsets[0]) % 0.25, atol=1e-12)
