"""Certified orbits that samples or a sine tell the time, against runs of other integrators and closed forms."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from typer.testing import CliRunner

import eppanalysis as epp
from eppanalysis.cli.commands import app
from eppanalysis.methods.certificates.orbits.certify import certified
from eppanalysis.methods.certificates.orbits.timed import Sinusoid, driven_motion, locked_motion
from eppanalysis.methods.certificates.registry import sealed
from eppanalysis.methods.orbits.exact import steady_hybrid
from eppanalysis.methods.simulation.in_samples import InSamples
from eppanalysis.models.systems.subject import standing
from tests.driven_loops import saturated
from tests.sampled_relay import patterns, sampled_relay

flint = pytest.importorskip("flint")
STABLE, ONE_OUTSIDE = epp.OrbitStability.STABLE, epp.OrbitStability.ONE_OUTSIDE
LAGS = [[-1.0, 0.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, -1.0]]


def relay_behind(*controllers: epp.SampledController, h: float = 0.1) -> epp.LureSystem:
    """Three lags, read by controllers one behind the other, and a relay with hysteresis behind them."""
    k = len(controllers)
    B, C, D = np.zeros((3, k + 1)), np.zeros((k + 1, 3)), np.zeros((k + 1, k + 1))
    B[0, k], C[0, 2], D[np.arange(1, k + 1), np.arange(k)] = -1.0, 1.0, 1.0
    names = [*(f"reader {i}" for i in range(k)), "relay"]
    elements = [*controllers, epp.HysteresisRelay(-h, h)]
    return epp.LureSystem.build(LAGS, B, C, elements, D=D, x0=[1.0, 0.0, 0.0], element_names=names, name="sampled")


def reader(T: float, gain: float = 1.0, **more: Any) -> epp.SampledController:
    return epp.SampledController([], [], [], [[gain]], sample_time=T, **more)


def dead_zone(dead: float) -> epp.Case:
    return sampled_relay().with_values({"dead": dead})


def assert_locked(found: epp.CertifiedOrbit, samples: int, T: str) -> None:
    """Proved, with a period that holds so many samples, and nothing else within 1e-30."""
    assert found.proved, str(found)
    with flint.ctx.workprec(256):
        ball = flint.arb(found.period_ball)
        p, _, q = T.partition("/")
        assert ball.contains(samples * flint.fmpq(int(p), int(q or 1))) and ball.rad() < 1e-30


def test_a_relay_behind_a_sampler_is_locked_to_the_samples() -> None:
    """A disturbance moves no switch, so that all multipliers are those of the lags; other code comes round, too."""
    loop, T = relay_behind(reader(0.2)), 0.2
    counts = []
    for cycle in epp.find_limit_cycles(loop):
        found = epp.certify_orbit(loop, cycle)
        n = round(cycle.period / T)
        assert_locked(found, n, "1/5")
        assert found.stability is STABLE
        np.testing.assert_allclose(np.abs(found.multipliers[:3]), math.exp(-n * T), rtol=1e-4)
        counts.append(n)
        # From sample to sample in closed form: from the state proved, in the mode in which the file has the relay.
        relay = {0: -1.0, 1: 1.0}[found.document["loop"]["course"]["modes"][0][1]]
        A = np.block([[np.array(LAGS), np.array([[-1.0], [0.0], [0.0]])], [np.zeros((1, 4))]])
        x, seen = found.state[:3], []
        flow = [expm(A * T * share) for share in np.linspace(0.0, 1.0, 41)]
        for _ in range(n):
            relay = 1.0 if x[2] > 0.1 else -1.0 if x[2] < -0.1 else relay
            path = np.array([(M @ np.append(x, relay))[:3] for M in flow])
            seen.append(path[:, 2])
            x = path[-1]
        np.testing.assert_allclose(x, found.state[:3], atol=1e-12)
        np.testing.assert_allclose(np.ptp(np.array(seen)), cycle.peak_to_peak["reader 0_input"], rtol=1e-4)
    assert counts == [24, 26]


#: Elements with a field, and their outputs, which a relay with hysteresis keeps.
LAWS = (
    (lambda r: epp.HysteresisRelay(-r, r), lambda z, r, w: math.copysign(1.0, z) if abs(z) > r else w),
    (lambda r: epp.RelayDeadZone(threshold=r), lambda z, r, _: math.copysign(1.0, z) if abs(z) > r else 0.0),
    (lambda r: epp.DeadZoneSaturation(r, 2.0, 1.0), lambda z, r, _: np.clip(2.0 * (z - np.clip(z, -r, r)), -1.0, 1.0)),
)


def random_sampled(seed: int) -> tuple[epp.LureSystem, float, float, Any]:
    """Two to four lags in a chain, a sampler, an element: the loop, its sample time, field and law."""
    rng = np.random.default_rng(seed)
    n, (make, law) = int(rng.integers(2, 5)), LAWS[seed % len(LAWS)]
    A = np.diag(-np.round(rng.uniform(0.3, 3.0, n), 2)) + np.diag(np.ones(n - 1), -1)
    T, r = float(rng.choice([0.2, 0.25, 0.5, 1 / 3])), float(np.round(rng.uniform(0.05, 0.6), 2))
    B, C = np.zeros((n, 2)), np.zeros((2, n))
    B[0, 1], C[0, -1] = -np.round(rng.uniform(5.0, 40.0), 1), 1.0
    D = [[0.0, 0.0], [1.0, 0.0]]
    return epp.LureSystem.build(A, B, C, [reader(T), make(r)], D=D, x0=np.ones(n)), T, r, law


@pytest.mark.parametrize("seed", [*range(6), *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(6, 40))])
def test_loops_at_random_come_round_as_proved(seed: int) -> None:
    """From sample to sample by matrix exponentials: round after the period proved, and not before."""
    loop, T, r, law = random_sampled(seed)
    cycle = epp.simulate(loop, t_end=200.0 * T + 60.0).limit_cycle
    exact = None if cycle is None else epp.exact_orbit(loop, cycle)
    if exact is None or not exact.status.ok:
        return
    found, n = epp.certify_orbit(loop, exact), len(loop.A) - 1
    assert found.proved, str(found)
    flow = expm(np.block([[loop.A[:n, :n], loop.B[:n, 1:2]], [np.zeros((1, n + 1))]]) * T)
    x, w, path = found.state[:n], (-1.0, 1.0, 0.0)[found.document["loop"]["course"]["modes"][0][1] % 3], []
    for _ in range(round(found.period / T)):
        w = law(float(x[-1]), r, w)
        x = (flow @ np.append(x, w))[:n]
        path.append(np.max(np.abs(x - found.state[:n])))
    assert path[-1] < 1e-9 * np.abs(found.state).max() < 1e-6 < min(path[:-1])


@pytest.mark.parametrize(
    ("controllers", "T"),
    [
        ((reader(0.2, delay=0.05),), "1/5"),
        ((reader(0.2), reader(0.3)), "3/5"),
        ((reader(0.25, offset=0.1), reader(0.25, offset=0.2)), "1/4"),
        ((reader(0.2), reader(0.2)), "1/5"),
        ((epp.SampledController([[0.5]], [[0.5]], [[1.0]], [[0.0]], sample_time=0.2, state_last=True),), "1/5"),
        ((epp.SampledController([[0.5]], [[0.5]], [[1.0]], [[0.2]], sample_time=0.2, delay=0.2),), "1/5"),
    ],
)
def test_controllers_of_all_kinds_lock(controllers: tuple[epp.SampledController, ...], T: str, tmp_path: Path) -> None:
    """With a delay, of several sample times and offsets, at one instant, and with states that are renewed last."""
    loop = relay_behind(*controllers)
    p, _, q = T.partition("/")
    run = epp.simulate(loop, t_end=60.0).limit_cycle
    assert run is not None
    found = epp.certify_orbit(loop, epp.exact_orbit(loop, run))
    assert_locked(found, round(run.period * int(q) / int(p)), T)
    assert epp.check_certificate(found.write(tmp_path / "orbit.json"), loop).about is True


def test_a_loop_whose_samples_come_otherwise_is_another(tmp_path: Path) -> None:
    """Arcs of one order of two samplers are none of the loop with the other order, of which the arcs are as good."""
    loop, other = (relay_behind(reader(0.2), reader(0.2, offset=offset)) for offset in (0.05, 0.15))
    run = epp.simulate(loop, t_end=60.0).limit_cycle
    assert run is not None
    cycle = epp.exact_orbit(loop, run)
    found = epp.certify_orbit(loop, cycle)
    path = found.write(tmp_path / "orbit.json")
    assert epp.check_certificate(path, loop).about is True
    assert epp.check_certificate(path, other).about is False
    refused = epp.certify_orbit(other, cycle)
    assert refused.status is epp.Proof.NOT_DECIDED and "at other times" in refused.message


def test_samples_at_one_instant_are_taken_along_the_signal() -> None:
    """Where the second reader were first, which reads what the first one holds, the loop would have another cycle."""
    loop, other = relay_behind(reader(0.2), reader(0.2)), relay_behind(reader(0.2, offset=1e-4), reader(0.2))
    run = epp.simulate(other, t_end=60.0).limit_cycle
    assert run is not None
    system, at = standing(other, None, "certify_orbit")
    motion = locked_motion(system, epp.exact_orbit(other, run), at)
    assert motion is not None and certified(motion).proved
    # The same events in the same order, the second one of each pair at once, in the loop where both samples are.
    y, n = motion.y.copy(), motion.hybrid.x0.size
    y[[n + 1, n + 3]] = 1.0
    course = replace(motion.course, at_once=motion.tau < 1e-3)
    found = certified(replace(motion, hybrid=steady_hybrid(loop, at), y=y, course=course))
    assert not found.proved and "due at one instant" in found.message


def test_what_a_sample_leaves_on_a_threshold_is_not_decided() -> None:
    """A dead zone whose edge the held signal 1 meets exactly, on which the rule of its element decides, not a guard."""
    sign = epp.SampledController([[-1.0]], [[0.0]], [[1.0]], [[0.0]], sample_time=0.5, x0=[1.0], y0=[-1.0])
    for edge, proved in ((0.75, True), (1.0, False), (1.25, True)):
        edges = epp.DeadZone(lower=-edge, upper=edge)
        loop = epp.LureSystem.build([[-1.0]], [[1.0, 1.0]], [[0.0], [0.0]], [sign, edges], D=[[0.0, 0.0], [1.0, 0.0]])
        cycle = epp.simulate(loop, t_end=60.0).limit_cycle
        assert cycle is not None
        found = epp.certify_orbit(loop, epp.exact_orbit(loop, cycle))
        assert found.proved is proved, str(found)
        assert proved or "stays exactly at zero" in found.message


@pytest.mark.slow
def test_the_converter_cycles_beside_others(tmp_path: Path) -> None:
    """The law's integrator keeps what it began with: for each of its values there is a cycle, of 55 samples."""
    case = epp.case("buck_converter")
    cycle = next(c for c in epp.find_limit_cycles(case) if round(c.period / 4e-6) == 55)
    found = epp.certify_orbit(case, cycle)
    assert_locked(found, 55, "1/250000")
    assert found.stability is epp.OrbitStability.NOT_DECIDED and "one of many" in found.stability_message
    assert epp.check_certificate(found.write(tmp_path / "orbit.json"), case).about is True


@pytest.mark.parametrize("dead", [pytest.param(0.1, marks=pytest.mark.slow), 0.16, 0.18])
def test_a_dead_zone_behind_a_sampler(dead: float, tmp_path: Path) -> None:
    """What is proved are patterns of the relay that the closed form has at that dead zone."""
    case, known = dead_zone(dead), {p.samples for p in patterns(0.5, 12) if p.low < dead < p.high}
    cycles = list(epp.find_limit_cycles(case))
    assert cycles
    for cycle in cycles:
        n = round(cycle.period / 0.5)
        found = epp.certify_orbit(case, cycle)
        assert_locked(found, n, "1/2")
        assert found.stability is STABLE and n in known
        path = found.write(tmp_path / "orbit.json")
    assert epp.check_certificate(path, case).about is True
    assert epp.check_certificate(path, dead_zone(dead + 0.001)).about is False


def test_beyond_the_border_nothing_is_proved() -> None:
    """A cycle ends where a sample meets the threshold: just before it is proved, and just beyond, in the events and
    the numbers that it had, it is not.
    """
    system, at = standing(dead_zone(0.18), None, "certify_orbit")
    for cycle in epp.find_limit_cycles(system):
        (own,) = (p for p in patterns(0.5, 12) if p.samples == round(cycle.period / 0.5) and p.low < 0.18 < p.high)
        motion = locked_motion(system, cycle, at)
        assert motion is not None
        for edge in (own.low, own.high):
            inward = math.copysign(1e-9, 0.18 - edge)
            for dead, there in ((edge + inward, True), (edge - inward, False)):
                # As rationals of few digits, so that the numbers of the loop are those of the closed form.
                beside = dead_zone(float(f"{dead:.12g}"))
                found = certified(replace(motion, hybrid=steady_hybrid(beside.to_system(), at)))
                assert found.proved is there, (edge, dead, str(found))


def test_a_loop_in_discrete_time_locks(tmp_path: Path) -> None:
    """From the state proved the difference equation comes round, and not before."""
    plant = epp.blocks.TransferFunction(num=[1.2], den=[1.0, -1.0, 0.25], sample_time=0.5, start=[0.1, 0.1])
    parts = {"relay": epp.RelayDeadZone(threshold=1.0), "plant": plant}
    case = epp.Case.from_system(epp.Diagram(parts, ["-plant -> relay", "relay -> plant"], name="digital"))
    loop = case.to_system()
    cycles = list(epp.find_limit_cycles(case))
    assert cycles
    for cycle in cycles:
        found = epp.certify_orbit(case, cycle)
        n = round(cycle.period / 0.5)
        assert_locked(found, n, "1/2")
        assert epp.check_certificate(found.write(tmp_path / "orbit.json"), case).about is True
        path = [found.state]
        for _ in range(n):
            seen = float(loop.C[0] @ path[-1])
            path.append(loop.A @ path[-1] + loop.B[:, 0] * (math.copysign(1.0, seen) if abs(seen) > 1.0 else 0.0))
        gaps = np.max(np.abs(np.array(path[1:]) - path[0]), axis=1)
        assert gaps[-1] < 1e-12 < 0.01 < gaps[:-1].min()
        np.testing.assert_allclose(np.ptp(np.array(path) @ loop.C[0]), cycle.peak_to_peak["plant"], rtol=1e-9)


@pytest.mark.parametrize(
    "name", ["kp05_ki02", pytest.param("kp02_ki02", marks=pytest.mark.slow), pytest.param("", marks=pytest.mark.slow)]
)
def test_play_under_a_sampled_pi_controller(name: str, tmp_path: Path) -> None:
    """Its input jumps from sample to sample: it is pushed, lets go and is met by jumps alone. Iterated directly."""
    case = epp.case("_".join(["backlash_discrete_pi", name]).rstrip("_"))
    loop, periods = case.to_system(), []
    half = 0.5 * float(loop.elements[0].gap)
    for cycle in epp.find_limit_cycles(case):
        found, n = epp.certify_orbit(case, cycle), round(cycle.period)
        assert_locked(found, n, "1")
        assert found.stability is (STABLE if cycle.stable else ONE_OUTSIDE)
        assert epp.check_certificate(found.write(tmp_path / "orbit.json"), case).about is True
        x, path = found.state, []
        # Pushed up or down where the period begins, and further on by its law.
        w = float(loop.C[0] @ x) + half * {1: -1.0, 2: 1.0}[found.document["loop"]["course"]["modes"][0][1]]
        for _ in range(n):
            z = float(loop.C[0] @ x)
            w = min(max(w, z - half), z + half)
            x = loop.A @ x + loop.B[:, 0] * w
            path.append(np.max(np.abs(x - found.state)))
        assert path[-1] < 1e-12 < 0.01 < min(path[:-1])
        periods.append(float(n))
    assert set(periods) == {exact.period for exact in case.expected.exact}


def test_play_that_lets_go_at_another_sample_is_refused() -> None:
    """One sample earlier its input is still pushed on, and one later it would have let go before."""
    case = epp.case("backlash_discrete_pi_kp05_ki02")
    system, at = standing(case, None, "certify_orbit")
    form = InSamples.at(system, at)
    motion = locked_motion(form.system, form.from_user(epp.find_limit_cycles(case)[0]), at)
    assert motion is not None and certified(motion).proved
    course, p = motion.course, len(motion.tau)
    release = next(k for k in range(1, p - 1) if "lets go" in motion.hybrid.guard_name(int(course.guards[k])))
    for first, second in ((release - 1, release), (release, release + 1)):
        order = list(range(p))
        order[first], order[second] = second, first
        guards, modes, tau = course.guards[order], course.modes.copy(), motion.tau.copy()
        play = 0 if second == release else 2
        modes[second, 1] = play if second == release else course.modes[release, 1]
        tau[[release, release + 1]] = tau[[release + 1, release]]
        at_once = tau < 1e-9
        other = replace(motion, tau=tau, course=replace(course, guards=guards, modes=modes, at_once=at_once))
        assert not certified(other).proved


def test_a_jump_that_reaches_play_by_way_of_a_switch_is_not_covered() -> None:
    elements = [reader(0.2), epp.HysteresisRelay(-0.1, 0.1), epp.Play(gap=0.3)]
    B, C, D = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))
    B[0, 2], C[0, 2], D[1, 0], D[2, 1] = -1.0, 1.0, 1.0, 1.0
    loop = epp.LureSystem.build(LAGS, B, C, elements, D=D, x0=[1.0, 0.0, 0.0])
    run = epp.simulate(loop, t_end=60.0).limit_cycle
    assert run is not None
    found = epp.certify_orbit(loop, epp.exact_orbit(loop, run))
    assert found.status is epp.Proof.NOT_DECIDED and "no effect of a jump" in found.message


def under(loop: epp.LureSystem, amplitude: float, omega: float) -> list[epp.PeriodicResponse]:
    return list(epp.forced_response(loop, amplitude=amplitude, frequency=omega / (2 * math.pi), most_periods=1))


def assert_driven(found: epp.CertifiedOrbit, omega: str, stability: epp.OrbitStability) -> None:
    assert found.proved and found.stability is stability, str(found)
    with flint.ctx.workprec(256):
        ball = flint.arb(found.period_ball)
        p, _, q = omega.partition("/")
        assert ball.contains(2 * flint.arb.pi() / flint.fmpq(int(p), int(q or 1))) and ball.rad() < 1e-30


def test_all_three_responses_of_a_jump_resonance(tmp_path: Path) -> None:
    """The middle one is unstable; an integrator that knows no events comes round on each."""
    loop = saturated()
    responses = under(loop, 0.5, 0.8)
    found = [epp.certify_orbit(loop, response) for response in responses]
    for one, stability in zip(found, (STABLE, ONE_OUTSIDE, STABLE), strict=True):
        assert_driven(one, "4/5", stability)
        assert "under a sine of 0.5 and 0.8 rad/s at force, a periodic response" in str(one)
        said = epp.check_certificate(one.write(tmp_path / "orbit.json"), loop)
        assert said.about is True and "diagram under a sine of 0.5 and 0.8 rad/s at force has a periodic" in str(said)

        def rate(t: float, x: np.ndarray) -> np.ndarray:
            seen = 0.5 * math.sin(0.8 * t) + loop.C[0] @ x
            return loop.A @ x + loop.B[:, 0] * np.clip(seen, -1.0, 1.0)

        run = solve_ivp(rate, (0.0, one.period), one.state, method="DOP853", rtol=1e-11, atol=1e-13, max_step=0.02)
        np.testing.assert_allclose(run.y[:, -1], one.state, atol=1e-7)
    sizes = [float(np.max(np.abs(response.cycle.multipliers))) for response in responses]
    np.testing.assert_allclose([np.abs(one.multipliers).max() for one in found], sizes, rtol=1e-6)


@pytest.mark.parametrize(("omega", "beyond"), [(0.83, 0.834), (0.78, 0.77)])
def test_beyond_a_fold_nothing_is_proved(omega: float, beyond: float) -> None:
    """Three responses between 0.7722 and 0.8325 rad/s; two of them are gone beyond, and are not proved there."""
    loop = saturated()
    kept = []
    for response in under(loop, 0.5, omega):
        assert epp.certify_orbit(loop, response).proved
        there = replace(response, cycle=replace(response.cycle, period=2 * math.pi / beyond))
        at = response.cycle.operating_point
        own = driven_motion(loop, response, Sinusoid("force", 0.5, omega), at)
        assert own is not None
        sinusoid = Sinusoid("force", 0.5, beyond)
        forced = certified(replace(own, hybrid=sinusoid.hybrid(loop, at)), sinusoid)
        found = [epp.certify_orbit(loop, there), forced]
        kept += [round(float(one.state[-1]), 6) for one in found if one.proved]
    # What is proved is the one response that there is.
    (only,) = under(loop, 0.5, beyond)
    alone = round(float(epp.certify_orbit(loop, only).state[-1]), 6)
    assert set(kept) <= {alone}


@pytest.mark.parametrize(("omega", "friction"), [("2", 0.2), ("3/4", 0.3)])
def test_friction_under_a_sine_has_the_amplitude_of_den_hartog(omega: str, friction: float) -> None:
    """Forced vibrations with Coulomb friction that never stop, in closed form (Den Hartog 1931)."""
    w, push = float(Fraction(omega)), epp.Relay(low=-friction, high=friction)
    A, B, C = [[0.0, 1.0], [-1.0, 0.0]], [[0.0], [-1.0]], [[0.0, 1.0]]
    loop = epp.LureSystem.build(A, B, C, [push], B_input=[[0.0], [1.0]], input_names=["force"])
    (response,) = under(loop, 1.0, w)
    found = epp.certify_orbit(loop, response)
    assert_driven(found, omega, STABLE)
    x, t, places = found.state, 0.0, []
    sign = math.copysign(1.0, x[1])

    def rate(t: float, x: np.ndarray) -> list[float]:
        return [x[1], -x[0] - sign * friction + math.sin(w * t)]

    def turns(t: float, x: np.ndarray) -> float:
        return sign * x[1] + (1.0 if t < begun + 1e-3 else 0.0)

    turns.terminal = True  # type: ignore[attr-defined]
    while t < found.period - 1e-9:
        begun = t
        run = solve_ivp(
            rate, (t, found.period), x, events=turns, method="DOP853", rtol=1e-12, atol=1e-14, max_step=0.02
        )
        t, x, sign = run.t[-1], run.y[:, -1], -sign
        places.append(abs(x[0]))
    np.testing.assert_allclose(x, found.state, atol=1e-8)
    V, U = 1.0 / (1.0 - w**2), math.sin(math.pi / w) / (w * (1.0 + math.cos(math.pi / w)))
    np.testing.assert_allclose(places[:2], math.sqrt(V**2 - (friction * U) ** 2), rtol=1e-8)


def test_a_relay_that_a_sine_entrains_and_play_under_one() -> None:
    relay = epp.Diagram(
        {"relay": epp.Relay(), "plant": epp.blocks.TransferFunction(num=[1.0], den=[1.0, 3.0, 2.0, 0.0])},
        ["command - plant -> relay", "relay -> plant"], inputs=["command"], name="entrained",
    )  # fmt: skip
    servo = epp.Diagram(
        {"play": epp.Play(gap=0.5), "plant": epp.blocks.TransferFunction(num=[1.0], den=[0.2, 1.2, 1.0, 0.0])},
        ["command - play -> plant", "plant -> play"], inputs=["command"], name="servo",
    )  # fmt: skip
    for diagram, amplitude, omega in ((relay, 0.3, 1.5), (servo, 1.0, 0.6)):
        loop = diagram.to_system()
        (response,) = under(loop, amplitude, omega)
        assert_driven(epp.certify_orbit(loop, response), {1.5: "3/2", 0.6: "3/5"}[omega], STABLE)


def test_a_file_under_another_sine_is_about_another_loop(tmp_path: Path) -> None:
    loop = saturated()
    document = dict(epp.certify_orbit(loop, under(loop, 0.5, 0.8)[2]).document)
    path = tmp_path / "orbit.json"

    def about(drive: list[str]) -> bool | None:
        changed = json.loads(json.dumps(document))
        changed["loop"]["course"]["drive"] = drive
        path.write_text(json.dumps(sealed(changed)))
        return epp.check_certificate(path, loop).about

    assert about(["force", "1/2", "4/5"]) is True
    for other in (["force", "1/2", "5/6"], ["force", "1/3", "4/5"], ["begin", "1/2", "4/5"], []):
        assert about(other) is False


def test_samples_and_a_sine_together_are_not_covered() -> None:
    parts = {
        "reader": reader(0.5),
        "limit": epp.Saturation(-1.0, 1.0),
        "lag": epp.blocks.TransferFunction(num=[1.0], den=[1.0, 1.0]),
    }
    wires = ["command - lag -> reader", "reader -> limit", "limit -> lag"]
    loop = epp.Diagram(parts, wires, inputs=["command"]).to_system()
    (response,) = epp.forced_response(loop, amplitude=0.5, frequency=0.2, most_periods=1)
    found = epp.certify_orbit(loop, response)
    assert found.status is epp.Proof.NOT_DECIDED and "Samples" in found.message


def test_the_command_checks_a_file_of_a_locked_cycle(tmp_path: Path) -> None:
    case = dead_zone(0.16)
    file = str(epp.certify_orbit(case, epp.find_limit_cycles(case)[0]).write(tmp_path / "orbit.json"))
    (tmp_path / "case.toml").write_text(case.to_toml())
    own = str(tmp_path / "case.toml")
    ended = CliRunner().invoke(app, ["certify", own, "--check", file])
    assert ended.exit_code == 0 and "has a limit cycle of 5 s" in ended.output
    ended = CliRunner().invoke(app, ["certify", own, "--set", "dead=0.17", "--check", file])
    assert ended.exit_code == 1 and "not about" in ended.output
