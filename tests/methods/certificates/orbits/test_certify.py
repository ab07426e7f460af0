"""Certified orbits against closed forms of the period, an integrator that knows no events, and orbits that are none."""

from __future__ import annotations

import json
import math
import time
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq

import eppanalysis as epp
from eppanalysis.errors import EppError
from eppanalysis.methods.certificates.orbits.axes import OwnAxes
from eppanalysis.methods.certificates.orbits.certify import certified
from eppanalysis.methods.certificates.orbits.path import ExactPath
from eppanalysis.methods.certificates.orbits.shooting import Shooting
from eppanalysis.methods.orbits.exact import start_of, steady_hybrid
from eppanalysis.methods.orbits.guess import Guess, make_guess
from eppanalysis.methods.orbits.orbit import solve
from eppanalysis.methods.orbits.shooting import orbits_near
from eppanalysis.models.systems.subject import standing
from eppanalysis.results import LimitCycle, Status
from tests.coordinates import in_coordinates, orthogonal, rescaled
from tests.random_loops import random_loop

flint = pytest.importorskip("flint")
arb, ctx, fmpq = flint.arb, flint.ctx, flint.fmpq
tf = epp.LureSystem.from_tf

#: States on the orbits of the elbow, rounded: from here they are closed anew. Name, stable, period, state, memory.
ELBOWS = {
    "row 1": ("fig8a_original", True, 0.11143840595, [1.07672208857, -1.59535106532, 1.05490547292, -1.01184361578,
              -3.04599200703, -8.52635516511, 0.636443321161], (None,) * 4),
    "row 1, unstable": ("fig8a_original", False, 0.19293213305, [1.04773184884, -0.147080264789, 1.0360221883, 0.0,
                        0.3, 0.531508997986, 0.0595703535156], (None,) * 4),
    "row 3": ("gain_brings_it_back", True, 0.06557291019, [1.03517387989, -1.01064504492, 1.04682690045,
              0.0236405884194, 9.00323102202, 15.3867446366, 1.25987496054], (None,) * 4),
    "row 4": ("fig6a_original_pulley", True, 0.07575997747, [1.02739896436, 8.23571200396e-15, 1.03900211375,
              0.0344086042345, 10.9570164859, 15.9999951925, 1.37906647904e-05],
              (0.0004036273859656667, None, None, None)),
}  # fmt: skip


def elbow_cycle(name: str) -> tuple[epp.Case, LimitCycle]:
    case, stable, period, state, memory = ELBOWS[name]
    return epp.case(case), LimitCycle(
        "exact orbit", Status.CONVERGED, period, {}, {}, {}, stable, state=np.array(state), memory=memory
    )


def near(period: float, state: list[float], *memory: float | None) -> LimitCycle:
    """A cycle of which a state is known, from which it is closed."""
    return LimitCycle("exact orbit", Status.CONVERGED, period, {}, {}, {}, state=np.array(state), memory=memory)


def run_of(loop: epp.LureSystem) -> LimitCycle:
    """The exact cycle that a run of a loop ends on."""
    cycle = epp.simulate(loop, t_end=60.0).limit_cycle
    assert cycle is not None
    return epp.exact_orbit(loop, cycle)


def hysteresis(h: float) -> tuple[epp.LureSystem, LimitCycle]:
    """A relay with thresholds +-h on 1/(s + 1), and its cycle."""
    loop = tf(([1.0], [1.0, 1.0]), epp.HysteresisRelay(lower=-h, upper=h))
    return loop, near(2.0 * math.log((1.0 + h) / (1.0 - h)), [0.0], 1.0)


def servo(gain: float, period: float, *state: float) -> tuple[epp.LureSystem, LimitCycle]:
    """k/(s (s + 1)(0.2 s + 1)) with play, and its cycle near a state at which the play holds the last number."""
    return tf(([gain], [0.2, 1.2, 1.0, 0.0]), epp.Play(gap=1.0)), near(period, list(state[:3]), state[3])


#: Just above the onset of cycles, and well above it.
ONSET = (2.08, 16.204285195, 0.0951022314728, 0.0, -12.1726327878, 0.0860897268197)
ABOVE = (3.0, 4.727498523166, 0.451988663518, 4.31118440931, -6.85743977513, 0.976211095495)


def orbit_of(loop: epp.LureSystem | epp.Case, cycle: LimitCycle):
    system, at = standing(loop, cycle.operating_point, "certify_orbit")
    hybrid = steady_hybrid(system, at)
    return hybrid, next(orbits_near(hybrid, *start_of(hybrid, cycle), cycle.period))


def assert_proved(found: epp.CertifiedOrbit, stability: epp.OrbitStability) -> None:
    assert found.status is epp.Proof.PROVED and found.proved, str(found)
    assert found.stability is stability, str(found)
    assert 0.0 < found.radius <= 1e-9 < found.unique_within or found.radius <= 1e-12


@settings(max_examples=8, deadline=None)
@given(percent=st.integers(5, 90))
def test_relay_with_hysteresis_has_the_period_of_the_textbook(percent: int) -> None:
    """On 1/(s + 1) with thresholds +-h the period is 2 ln((1 + h)/(1 - h)), with h the decimal and not its float."""
    found = epp.certify_orbit(*hysteresis(percent / 100))
    assert_proved(found, epp.OrbitStability.STABLE)
    with ctx.workprec(300):
        exact = 2 * (arb(fmpq(100 + percent, 100 - percent))).log()
        assert arb(found.period_ball).contains(exact)
        assert arb(found.period_ball).rad() < 1e-30
    # The multiplier of this loop is zero: one state, and the section leaves none of it.
    np.testing.assert_allclose(np.abs(found.multipliers), 0.0, atol=1e-12)


def test_relay_on_a_triple_lag_has_the_period_of_the_closed_form() -> None:
    """Half a period tau of an ideal relay on 1/(s + 1)^3 solves f''(-1) = 0 for f(p) = tanh(p tau/2)/p."""
    loop = tf(([1.0], [1.0, 3.0, 3.0, 1.0]), epp.Relay())
    found = epp.certify_orbit(loop, run_of(loop))
    assert_proved(found, epp.OrbitStability.STABLE)

    def balance(period):
        p = flint.arb_series([-1, 1], prec=3)
        e = (p * (period / 2)).exp()
        return ((e - 1) / (e + 1) / p)[2]

    with ctx.workprec(300):
        ball = arb(found.period_ball)
        assert ball.rad() < 1e-30
        assert balance(ball.lower()) * balance(ball.upper()) < 0


def test_relay_on_an_integrator_with_lag_has_the_period_of_the_closed_form() -> None:
    """On 1/(s (s + 1)) with thresholds +-h half a period tau solves tau/2 - tanh(tau/2) = h."""
    loop = tf(([1.0], [1.0, 1.0, 0.0]), epp.HysteresisRelay(lower=-0.3, upper=0.3))
    found = epp.certify_orbit(loop, run_of(loop))
    assert_proved(found, epp.OrbitStability.STABLE)
    with ctx.workprec(300):
        ball = arb(found.period_ball)

        def balance(period):
            return period / 4 - (period / 4).tanh() - arb(fmpq(3, 10))

        assert balance(ball.lower()) < 0 < balance(ball.upper())


@pytest.mark.parametrize(
    ("element", "plant", "law"),
    [
        (epp.Saturation(-1.0, 1.0), ([20.0], [1.0, 3.0, 3.0, 1.0]), lambda x: np.clip(x, -1.0, 1.0)),
        (
            epp.DeadZoneSaturation(dead_zone=0.5, slope=1.0, limit=1.0),
            ([24.0], [1.0, 3.0, 3.0, 1.0]),
            lambda x: np.sign(x) * np.clip(np.abs(x) - 0.5, 0.0, 1.0),
        ),
    ],
)
def test_saturation_and_dead_zone_come_back_after_the_period(element, plant, law) -> None:
    """An integrator that knows no events comes back to the certified state after the certified period."""
    loop = tf(plant, element)
    for guess in epp.predict_limit_cycles(loop):
        cycle = epp.exact_orbit(loop, guess)
        found = epp.certify_orbit(loop, cycle)
        assert_proved(found, epp.OrbitStability.STABLE if cycle.stable else epp.OrbitStability.ONE_OUTSIDE)

        def rate(_, x):
            return loop.A @ x + loop.B[:, 0] * law(loop.C[0] @ x)

        steps = {"rtol": 1e-11, "atol": 1e-13, "max_step": found.period / 400}
        run = solve_ivp(rate, (0.0, found.period), found.state, method="DOP853", **steps)
        np.testing.assert_allclose(run.y[:, -1], found.state, atol=1e-6 * np.abs(run.y).max())


def test_play_servo_just_above_the_onset_of_cycles() -> None:
    """The servo k/(s (s + 1)(0.2 s + 1)) with play has cycles from k = 2.077624 on."""
    loop, cycle = servo(*ONSET)
    epp.certify_orbit(loop, cycle)
    begun = time.process_time()
    found = epp.certify_orbit(loop, cycle)
    assert time.process_time() - begun <= 0.2
    assert_proved(found, epp.OrbitStability.STABLE)
    assert len(found.events) == 4
    np.testing.assert_allclose(found.period, cycle.period, rtol=1e-9)


@pytest.mark.parametrize("name", ["row 1", *(pytest.param(n, marks=pytest.mark.slow) for n in [*ELBOWS][1:])])
def test_elbow(name: str) -> None:
    case, cycle = elbow_cycle(name)
    begun = time.process_time()
    found = epp.certify_orbit(case, cycle)
    assert time.process_time() - begun <= 3.0
    assert_proved(found, epp.OrbitStability.STABLE if cycle.stable else epp.OrbitStability.ONE_OUTSIDE)
    np.testing.assert_allclose(found.period, cycle.period, rtol=1e-9)
    # The float orbit's own multipliers lie in the discs, but for its rounding.
    _, orbit = orbit_of(case, cycle)
    for value in orbit.multipliers:
        assert np.min(np.abs(found.multipliers - value) - found.multiplier_radii) < 1e-7
    assert np.sum(np.abs(orbit.multipliers) > 1.0) == np.sum(np.abs(found.multipliers) > 1.0)


@pytest.mark.slow
def test_a_cycle_beside_a_run_that_comes_to_rest_is_proved() -> None:
    """Row 1 at a range of 3.6 lbf: its own run, a step of the harness, settles."""
    case = epp.case("fig8a_original").with_values({"bands.range": "3.6 lbf", "lock_pin.backlash": "2.5 deg"})
    assert epp.simulate(case).status is Status.SETTLED
    state = [1.0460649052, -0.742574316394, 1.03975349964, 0.0, 0.3, 0.728620907665, 0.200844123652]
    found = epp.certify_orbit(case, near(0.1574948802659, state, *(None,) * 4))
    assert_proved(found, epp.OrbitStability.STABLE)
    assert found.period == pytest.approx(0.1574948802659, rel=1e-11)


def closes(orbit) -> bool:
    """Whether the shooting equations of a sequence have exactly one solution near, by Krawczyk's test alone."""
    axes = OwnAxes.states(ExactPath.of(orbit), orbit)
    with ctx.workprec(128):
        return bool(Shooting(axes, orbit).enclose().radius < 1e-9)


#: Arcs of row 1 behind which so many events of the drive's friction are left out.
LEFT_OUT = {"never sticks": [(5, 4), (16, 4)], "stays stuck": [(6, 2), (17, 2)], "stays stuck once": [(17, 2)]}


@pytest.mark.parametrize("which", LEFT_OUT)
def test_ghosts_of_the_elbow_are_refused(which: str) -> None:
    """With events left out the equations of row 1 close, at 0.108 s to 0.113 s; only the guards tell."""
    hybrid, orbit = orbit_of(*elbow_cycle("row 1"))
    sequence, p, tau = orbit.arcs.event_sequence, orbit.arcs.n_arcs, orbit.tau.copy()
    guards, gone = sequence.guards.copy(), set()
    for arc, count in LEFT_OUT[which]:
        behind = [(arc + k) % p for k in range(1, count + 1)]
        assert {hybrid.element_names[hybrid.model.guard_element[guards[b]]] for b in [arc, *behind[:-1]]} == {
            "drive_friction"
        }
        tau[arc] += orbit.tau[behind].sum()
        guards[arc] = sequence.guards[behind[-1]]
        gone |= set(behind)
    keep = [a for a in range(p) if a not in gone]
    ghost = solve(hybrid, make_guess(hybrid, sequence.modes[keep], guards[keep], orbit.starts[:-1][keep], tau[keep]))
    assert ghost.residual < 1e-9 and abs(ghost.period / orbit.period - 1.0) > 1e-3
    assert closes(ghost)
    found = certified(ghost)
    assert found.status is epp.Proof.VIOLATED and not found.proved
    assert "drive_friction" in found.message and math.isnan(found.period)


def test_ghosts_of_a_relay_are_refused() -> None:
    """On a resonant plant the half periods that close the equations are many; all but one pass the threshold before."""
    loop = tf(([1.0], [1.0, 0.2, 1.0]), epp.HysteresisRelay(lower=-0.9, upper=0.9))
    cycle = run_of(loop)
    hybrid, orbit = orbit_of(loop, cycle)
    A, b, c, one = loop.A, loop.B[:, 0], loop.C[0], np.eye(2)

    def begin(tau: float) -> np.ndarray:
        """Where the relay goes low on a symmetric motion of half a period tau."""
        flow = expm(A * tau)
        return np.linalg.solve(one + flow, np.linalg.solve(A, (flow - one) @ b))

    times = np.linspace(0.5, 25.0, 2000)
    miss = np.array([c @ begin(t) + 0.9 for t in times])
    guesses = times[:-1][(miss[:-1] * miss[1:] < 0.0) & (np.abs(miss[:-1] - miss[1:]) < 0.5)]
    sequence, first = orbit.arcs.event_sequence, int(orbit.arcs.event_sequence.modes[0, 0])
    statuses = []
    for tau in guesses:
        y = orbit.y.copy()
        y[:2] = begin(tau) if first == 0 else -begin(tau)
        found = solve(hybrid, Guess(sequence, y, np.array([tau, tau])))
        if found.residual < 1e-9 and closes(found):
            proved = certified(found).status
            statuses.append(proved)
            if abs(found.period / cycle.period - 1.0) < 1e-9:
                assert proved is epp.Proof.PROVED
            elif found.period > 1.01 * cycle.period:
                # The level is kept beyond the first time that the motion reaches the threshold.
                assert proved is epp.Proof.VIOLATED
    assert epp.Proof.PROVED in statuses and statuses.count(epp.Proof.VIOLATED) >= 3


@pytest.mark.parametrize("clearance", [1e-10, -1e-10])
def test_a_threshold_just_above_the_peak_is_not_met_and_one_just_below_is(clearance: float) -> None:
    """Position of 1/(s (s + 1)) under a relay; a dead zone that watches it, its edge next to the peak."""

    def watched(edge: float) -> epp.LureSystem:
        elements = [epp.HysteresisRelay(lower=-0.3, upper=0.3), epp.DeadZone(lower=-edge, upper=edge)]
        B, C = [[0.0, 0.0], [-1.0, 0.0]], [[1.0, 0.0], [1.0, 0.0]]
        return epp.LureSystem.build([[0.0, 1.0], [0.0, -1.0]], B, C, elements)

    half = 2.0 * brentq(lambda u: u - math.tanh(u) - 0.3, 0.1, 5.0)
    speed = math.tanh(half / 2.0)  # at the threshold; from there on the relay brakes: v = (speed + 1) exp(-t) - 1
    peak = 0.3 + speed - math.log(1.0 + speed)
    _, orbit = orbit_of(watched(10.0), near(2.0 * half, [0.3, speed], -1.0, None))
    hybrid = steady_hybrid(watched(peak * (1.0 + clearance)))
    found = certified(solve(hybrid, Guess(orbit.arcs.event_sequence, orbit.y, orbit.tau)))
    assert found.status is (epp.Proof.PROVED if clearance > 0.0 else epp.Proof.VIOLATED)
    if clearance < 0.0:
        assert "dead_zone" in found.message


def test_a_wrong_period_is_not_proved() -> None:
    loop, cycle = hysteresis(0.5)
    found = epp.certify_orbit(loop, replace(cycle, period=2.5))
    assert found.status is epp.Proof.NOT_DECIDED and "does not return" in str(found)


@pytest.mark.parametrize("seed", [None, 1])
def test_an_angle_that_goes_on_is_told_as_why_an_orbit_is_not_proved(seed: int | None) -> None:
    """A motor whose speed is under control of a relay, with its angle among the states, turned or not."""
    A, B, C = [[0.0, 1.0, 0.0], [0.0, -1.0, 1.0], [0.0, 0.0, -1.0]], [[0.0], [0.0], [-1.0]], [[0.0, 1.0, 0.0]]
    relay = epp.HysteresisRelay(lower=-0.3, upper=0.3)
    loop = epp.LureSystem.build(A, B, C, [relay], constant_state=[0.0, 0.0, 0.3])
    if seed is not None:
        Q = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
        loop = loop.in_coordinates(Q.T, Q)
    (cycle,) = epp.find_limit_cycles(loop).cycles
    found = epp.certify_orbit(loop, cycle)
    assert found.status is epp.Proof.NOT_DECIDED and "an unobservable integral" in str(found)


@pytest.mark.parametrize("name", ["play", "relay"])
def test_other_coordinates_and_units_leave_the_statement(name: str) -> None:
    if name == "play":
        loop, cycle = servo(*ABOVE)
        cycles = [cycle]
    else:
        loop = tf(([5.0], [1.0, 2.0, 1.0, 0.0]), epp.RelayDeadZone(threshold=1.0))
        cycles = [epp.exact_orbit(loop, guess) for guess in epp.predict_limit_cycles(loop)]
        assert [c.stable for c in cycles] == [False, True]
    for cycle in cycles:
        wanted = epp.certify_orbit(loop, cycle)
        T = orthogonal(3, 4) @ np.diag([1.0, 30.0, 0.02])
        turned = epp.certify_orbit(in_coordinates(loop, T), replace(cycle, state=T @ cycle.state))
        unit = 10.0 ** np.random.default_rng(3).uniform(-6.0, 6.0, 3)
        state, held = 1e-6 * unit * cycle.state, tuple(None if m is None else 1e-6 * m for m in cycle.memory)
        scaled = epp.certify_orbit(
            rescaled(loop, 1e6, 1e-6, 3), replace(cycle, state=state, memory=held, period=1e6 * cycle.period)
        )
        for found, factor in ((turned, 1.0), (scaled, 1e6)):
            assert_proved(found, wanted.stability)
            # A periodic orbit may begin at any of its events.
            assert found.events in [wanted.events[k:] + wanted.events[:k] for k in range(len(wanted.events))]
            np.testing.assert_allclose(found.period / factor, wanted.period, rtol=1e-11)
            # The m multipliers of one loop are those of the other; the discs hold both.
            away = np.abs(np.abs(found.multipliers) - np.abs(wanted.multipliers))
            assert np.all(away <= found.multiplier_radii + wanted.multiplier_radii + 1e-9)


def test_elbow_in_other_coordinates() -> None:
    case, cycle = elbow_cycle("row 1")
    T = orthogonal(7, 2)
    system, at = standing(case, None, "certify_orbit")
    cycle = replace(cycle, state=T @ cycle.state, operating_point=at)
    found = epp.certify_orbit(in_coordinates(system, T), cycle)
    assert_proved(found, epp.OrbitStability.STABLE)


def test_two_relays_on_one_signal_switch_at_one_instant() -> None:
    """Relays of levels 0.125 and 0.875 behind one input are one of level 1, with the same period."""
    half = epp.HysteresisRelay(lower=-0.5, upper=0.5, low=-0.125, high=0.125)
    rest = epp.HysteresisRelay(lower=-0.5, upper=0.5, low=-0.875, high=0.875)
    loop = epp.LureSystem.build([[-1.0]], [[-1.0, -1.0]], [[1.0], [1.0]], [half, rest])
    found = epp.certify_orbit(loop, near(2.0 * math.log(3.0), [0.0], 0.125, 0.875))
    assert_proved(found, epp.OrbitStability.STABLE)
    assert len(found.events) == 4
    with ctx.workprec(300):
        assert arb(found.period_ball).contains(2 * arb(3).log())


@pytest.mark.parametrize("seed", [16, 204, 219, 353])
def test_loops_at_random_are_never_called_no_motion(seed: int) -> None:
    """Relays that slide for no time, play and pulleys: what the engine closes is proved, or undecided with a reason."""
    loop = random_loop(seed)
    cycle = epp.exact_orbit(loop, epp.simulate(loop, t_end=200.0).limit_cycle)
    found = epp.certify_orbit(loop, cycle)
    if seed == 16:  # its second element slides all the time
        assert found.status is epp.Proof.NOT_DECIDED and "level" in found.message
    else:
        assert found.proved and abs(found.period / cycle.period - 1.0) < 1e-9
        assert found.stability in (epp.OrbitStability.STABLE, epp.OrbitStability.NOT_DECIDED)
        assert (found.stability is epp.OrbitStability.STABLE) == (not found.stability_message)


def test_one_of_many_cycles_has_no_stability() -> None:
    """What a play holds while its input stays in the gap shifts the motion: each value has a cycle of its own."""
    relay, play = epp.HysteresisRelay(lower=-0.5, upper=0.5), epp.Play(gap=10.0)
    loop = epp.LureSystem.build(
        [[-1.0]], [[-1.0, 0.1]], [[1.0], [1.0]], [relay, play], x0=[0.4], memory=[1.0, 0.25], name="idle play"
    )
    run = epp.simulate(loop, t_end=30.0)
    found = epp.certify_orbit(loop, run.limit_cycle)
    assert found.proved and found.stability is epp.OrbitStability.NOT_DECIDED
    assert "one of many" in found.stability_message


def test_a_centre_is_not_decided() -> None:
    """Every amplitude within a dead zone's slope has a cycle: there is no single one to prove."""
    loop = tf(([1.0], [1.0, 0.0, 0.0]), epp.DeadZone(lower=-1.0, upper=1.0, slope=1.0), x0=[0.0, 4.0])
    run = epp.simulate(loop, t_end=200.0)
    if run.limit_cycle is None:
        pytest.skip("the run of a centre is not called a cycle")
    hybrid, orbit = orbit_of(loop, run.limit_cycle)
    found = certified(orbit)
    assert found.status is epp.Proof.NOT_DECIDED and "Krawczyk" in found.message


@pytest.mark.parametrize(
    ("loop", "why"),
    [
        (tf(([1.0], [1.0, 1.0]), epp.HysteresisRelay(-0.5, 0.5), delay=0.5), "dead time of 0.5 s"),
        (tf(([5.0], [1.0, 2.0, 1.0, 0.0]), epp.Tanh(level=1.0)), "smooth"),
    ],
)
def test_what_is_not_covered_is_refused(loop: epp.LureSystem, why: str) -> None:
    cycle = LimitCycle("exact orbit", Status.CONVERGED, 1.0, {}, {}, {}, state=np.zeros(loop.A.shape[0]))
    with pytest.raises(EppError, match=why):
        epp.certify_orbit(loop, cycle)


def test_without_flint_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    loop, cycle = hysteresis(0.5)
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    with pytest.raises(EppError, match="pip install"):
        epp.certify_orbit(loop, cycle)


def test_what_is_returned_is_plain_and_can_be_checked_again() -> None:
    loop, cycle = hysteresis(0.1)
    before = ctx.prec
    found = epp.certify_orbit(loop, cycle)
    assert ctx.prec == before
    assert all(isinstance(v, str) for v in found.evidence.values())
    assert json.loads(json.dumps(found.to_dict()))["status"] == "proved"
    assert found.to_frame().shape == (1, 3) and found.plot() is not None
    assert "proved to lie inside" in str(found)
    assert epp.table(found).content.row_count == 6
    # From the evidence alone: the times of both arcs add up to the period, and the thresholds are the decimals given.
    with ctx.workprec(200):
        pairs = [text.split("*2^") for text in json.loads(found.evidence["durations"])]
        halves = [fmpq(int(m)) * fmpq(2) ** int(e) for m, e in pairs]
        exact = 2 * arb(fmpq(11, 9)).log()
        assert abs(arb(sum(halves)) - exact) < 1e-30
    assert json.loads(found.evidence["tables"])["guard_0"] == ["-1/10", "-1/10"]
