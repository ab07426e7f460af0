"""What a prediction says of cycles that first order cannot see: it warns where they are, and nowhere else."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy import integrate, signal

import eppanalysis as epp
from eppanalysis.methods.describing.predict import predict_limit_cycles
from eppanalysis.methods.search.find import find_limit_cycles
from eppanalysis.results import Status
from tests.shared import mostly_slow
from tests.stress.first_order_loops import random_loop


def pid(integral: float, static: float, position: bool = True) -> epp.LureSystem:
    """A mass with friction under PID control of its position, or PI control of its speed alone."""
    A = [[0.0, 1.0, 0.0], [-10.0 if position else 0.0, -1.0, -integral], [1.0 if position else 0.0, 0.0, 0.0]]
    if not position:
        A[2] = [0.0, 1.0, 0.0]
    return epp.LureSystem.build(
        A, [[0], [-1], [0]], [[0, 1, 0]], [epp.Friction(coulomb=1.0, static=static)], x0=[0.1, 0, 0]
    )


def test_friction_that_hunts_under_integral_action_is_said():
    """With integral action, and more friction at rest than in motion, there is a stable cycle of stick and slip."""
    prediction = predict_limit_cycles(pid(5.0, 2.0))
    assert len(prediction) == 0 and len(find_limit_cycles(pid(5.0, 2.0)).stable) > 0
    assert "warnings" not in vars(prediction)  # looked for when first asked for, as they may take most of the time
    assert len(prediction.warnings) == 1 and "sticks" in prediction.warnings[0]
    assert prediction.to_dict()["warnings"] == list(prediction.warnings) and prediction.warnings[0] in str(prediction)


@pytest.mark.parametrize(
    "loop", [pid(0.0, 2.0), pid(5.0, 1.0), pid(5.0, 2.0, position=False)], ids=["PD", "no stiction", "speed control"]
)
def test_friction_that_stays_stuck_is_not(loop):
    assert predict_limit_cycles(loop).warnings == ()


def on_a_belt(speed: float, static: float) -> epp.LureSystem:
    """A mass on a spring and a damper, dragged by a belt through Coulomb friction with break-away."""
    A, C = [[0.0, 1.0], [-100.0, -0.2]], [[0.0, -1.0]]
    return epp.LureSystem.build(A, [[0.0], [1.0]], C, [epp.Friction(1.0, static)], constant_input=[speed])


@pytest.mark.parametrize(("speed", "static", "judders"), [(0.01, 2.0, True), (0.0, 2.0, False), (0.01, 1.0, False)])
def test_friction_on_what_moves_is_said_to_judder(speed, static, judders):
    """A mass that a belt takes along breaks loose and sticks again; not on one that stands, nor without stiction."""
    loop = on_a_belt(speed, static)
    assert [("drags" in w and "sticks" in w) for w in predict_limit_cycles(loop).warnings] == [True] * judders
    assert (epp.simulate(loop, t_end=100.0).limit_cycle is not None) == judders


def positioned(controller, friction: epp.Nonlinearity, belt: float = 0.0, stiffness: float = 0.8) -> epp.LureSystem:
    """A mass on a spring, positioned against friction with the ground or a belt by any controller."""
    parts = {
        "controller": controller,
        "mass": epp.blocks.Mass(mass=1.0, damping=0.2, stiffness=stiffness),
        "friction": friction,
        "ref": epp.blocks.Constant(value=1.0),
        "belt": epp.blocks.Constant(value=belt),
    }
    connect = [
        "ref - mass.position -> controller",
        "controller - friction -> mass.force",
        "mass.speed - belt -> friction",
    ]
    return epp.Diagram(parts=parts, connect=connect).to_system()


LIMITED = {
    "saturated PI": lambda: epp.AntiWindupPID(kp=5.0, ki=1.0, tracking_time=0.25, lower=-1.7, upper=1.7),
    "saturated PID": lambda: epp.AntiWindupPID(
        kp=5.0, ki=1.0, tracking_time=0.25, lower=-1.7, upper=1.7, kd=0.9, filter_time=0.02
    ),
    "clamped PI": lambda: epp.ClampedPID(kp=5.0, ki=1.0, lower=-1.7, upper=1.7),
    "clamped PID": lambda: epp.ClampedPID(kp=5.0, ki=1.0, lower=-1.7, upper=1.7, kd=0.9, filter_time=0.02),
}
STICKY = [epp.Friction(0.38, static=0.6), epp.StribeckFriction(0.38, 0.6, 0.1)]
#: Each law under one of the two frictions: what keeps the integrator and how the friction falls have nothing to do with
#: one another.
STUCK = list(zip(LIMITED, [*STICKY, *reversed(STICKY)], strict=True))


@pytest.mark.parametrize(("law", "friction"), mostly_slow(STUCK, STUCK[:1]))
def test_friction_hunts_under_a_limited_law_as_under_one_without_limits(law, friction):
    """What keeps an integrator at the limits does not act within them, where the friction sticks."""
    (plain,) = predict_limit_cycles(positioned(epp.blocks.PI(kp=5.0, ti=5.0), friction)).warnings
    (limited,) = predict_limit_cycles(positioned(LIMITED[law](), friction)).warnings
    assert limited == plain and "integral action ends the sticking" in limited
    assert predict_limit_cycles(positioned(LIMITED[law](), epp.Friction(0.38))).warnings == ()


def through_a_valve(controller, valve: epp.Nonlinearity, lag: float = 2.0) -> epp.LureSystem:
    """A flow behind a valve, held at a set point."""
    parts = {
        "controller": controller,
        "valve": valve,
        "flow": epp.blocks.TransferFunction(num=[1.0], den=[lag, 1.0]),
        "ref": epp.blocks.Constant(value=0.3),
    }
    return epp.Diagram(
        parts=parts, connect=["ref - flow -> controller", "controller -> valve", "valve -> flow"]
    ).to_system()


FLOW = {
    "PI": lambda: epp.blocks.PI(kp=0.8, ti=4.0),
    "saturated PI": lambda: epp.AntiWindupPID(kp=0.8, ki=0.2, tracking_time=4.0, lower=-1.0, upper=1.0),
    "clamped PI": lambda: epp.ClampedPID(kp=0.8, ki=0.2, lower=-1.0, upper=1.0),
}


@pytest.mark.parametrize(("law", "jump"), mostly_slow(product(FLOW, [0.03, 0.1]), [("saturated PI", 0.03)]))
def test_a_valve_that_slips_by_jumps_hunts_under_integral_action(law, jump):
    """A flow between two jumps of its valve: a stable cycle that first order does not have, and it says so."""
    loop = through_a_valve(FLOW[law](), epp.JumpAndFollow(stick_band=0.1, slip_jump=jump))
    prediction = predict_limit_cycles(loop)
    assert len(prediction) == 0 and len(find_limit_cycles(loop).stable) > 0
    assert len(prediction.warnings) == 1 and "valve moves in jumps after sticking" in prediction.warnings[0]


@pytest.mark.parametrize(
    ("law", "jump"),
    mostly_slow(product([*FLOW, "P"], [0.0, 0.03]), [("PI", 0.0), ("PI", 0.03), ("saturated PI", 0.03), ("P", 0.03)]),
)
def test_a_valve_that_follows_from_where_it_stuck_or_that_nothing_integrates_does_not(law, jump):
    """Without a jump any place is reached, and without integral action none need be."""
    controller = FLOW[law]() if law in FLOW else epp.blocks.Gain(gain=0.8)
    prediction = predict_limit_cycles(through_a_valve(controller, epp.JumpAndFollow(0.1, jump)))
    assert any("valve" in w for w in prediction.warnings) == (law != "P" and jump > 0)


def test_a_predicted_cycle_of_a_valve_is_not_warned_of():
    """Through a tank that integrates, too, first order has the stable cycle."""
    loop = epp.case("stiction_level_S5J2")
    prediction = predict_limit_cycles(loop.to_system())
    assert any(c.stable for c in prediction) and not any("jumps" in w for w in prediction.warnings)


@pytest.mark.parametrize("law", mostly_slow(["saturated PI", "clamped PI"], ["saturated PI"]))
def test_the_hunting_that_is_warned_of_is_there(law):
    assert epp.simulate(positioned(LIMITED[law](), STICKY[0]), t_end=600.0).limit_cycle is not None


@pytest.mark.parametrize(
    ("law", "friction"),
    mostly_slow([*STUCK, ("P", STICKY[0])], [STUCK[0], ("P", STICKY[0])]),
)
def test_friction_beside_elements_of_several_outputs_is_dragged_by_a_belt(law, friction):
    """One input and one balance an element, however many outputs it has."""
    controller = LIMITED[law]() if law in LIMITED else epp.blocks.Gain(gain=5.0)
    on_belt = predict_limit_cycles(positioned(controller, friction, belt=0.01)).warnings
    assert sum("sticks" in w for w in on_belt) == 1
    assert sum("sticks" in w for w in predict_limit_cycles(positioned(controller, friction)).warnings) == (law != "P")


def test_stick_slip_is_seen_through_the_rest_of_a_servo():
    """The same behind a gear with play and an encoder: what the other elements do does not hide the integrator."""
    a = [[0, 1, 0, 0, 0], [0, -62.5, 0, 0, 2500.0], [0, 0, 0, 1, 0], [0, 0, 0, -2.0, 0], [0, 0, 0, 0, 0]]
    b = [[0, 0, 0], [-20, 0, -1000.0], [0, 0, 0], [20, -20, 0], [0, 0, -1.0]]
    c = [[1, 0, -1, 0, 0], [0, 0, 0, 1, 0], [0, 0, 1, 0, 0]]

    def warnings(static: float, integral: float) -> tuple[str, ...]:
        scaled = [[v * (integral if i == 4 else 1.0) for v in row] for i, row in enumerate(b)]
        shaft = epp.DeadZone(-1e-3, 1e-3, 800.0)
        elements = [shaft, epp.Friction(0.5, static), epp.Quantiser(0.00153398, 40)]
        names = ["shaft", "load friction", "encoder"]
        return predict_limit_cycles(epp.LureSystem.build(a, scaled, c, elements, element_names=names)).warnings

    assert [w for w in warnings(0.7, 1.0) if "load friction sticks" in w]
    assert not [w for w in warnings(0.5, 1.0) if "sticks" in w]


def encoder(reference: float, proportional: float = 0.0, unit: float = 1.0, **more: object) -> epp.LureSystem:
    """A motor's position, or with no proportional action its speed, under integral action, read by an encoder."""
    if proportional:
        A = [[0.0, 1.0, 0.0], [0.0, -1.0, 2.0], [0.0, 0.0, 0.0]]
        B, C, constant = [[0.0], [-proportional], [-1.0]], [[1.0, 0.0, 0.0]], [0.0, proportional * reference, reference]
    else:
        A, B, C, constant = [[-1.0, 1.0], [0.0, 0.0]], [[0.0], [-1.0]], [[1.0, 0.0]], [0.0, reference]
    return epp.LureSystem.build(A, B, C, [epp.Quantiser(unit, 20)], constant_state=np.array(constant) * unit, **more)


@pytest.mark.parametrize(
    ("unit", "proportional"), mostly_slow(product([1e-6, 1.0, 1e6], [0.5, 1.0]), [(1.0, 0.5), (1e6, 1.0)])
)
def test_a_reference_between_the_levels_of_an_encoder_is_said_to_hunt(proportional, unit):
    """Integral action comes to rest only where the encoder gives just the reference, which no level does."""
    for level in (-2.0, 0.0, 3.0):
        assert predict_limit_cycles(encoder(level, proportional, unit)).warnings == ()
        between = predict_limit_cycles(encoder(level + 0.3, proportional, unit))
        assert len(between) == 0
        (warning,) = between.warnings
        assert "no state of rest" in warning and f"passes {(level + 0.5) * unit:.4g};" in warning


def test_what_is_said_to_hunt_does():
    """Dead time makes the cycle of the encoder's loop visible; at a level the same loop rests."""
    run = epp.simulate(encoder(0.3, 1.0, delays=[0.05]), t_end=60.0, max_events=4000)
    assert run.status is not Status.SETTLED
    assert epp.simulate(encoder(0.0, 1.0, delays=[0.05]), t_end=60.0, max_events=4000).status is Status.SETTLED


@pytest.mark.parametrize("factor", [1e-6, -1.0, 1e6])
def test_a_relay_that_switches_wherever_the_loop_would_stand_still_is_said_to_keep_it_moving(factor):
    """One-sided levels: the bias of the swing is larger than what a sine about it could switch at both thresholds."""

    def loop(width: float) -> epp.LureSystem:
        low, high = sorted([-0.5 * factor, 2.0 * factor])
        return epp.LureSystem.from_tf(([1.0], [1.0, 2.0, 1.0]), epp.HysteresisRelay(-width, width, low, high))

    predicted = predict_limit_cycles(loop(0.1 * abs(factor)))
    (warning,) = predicted.warnings
    assert len(predicted) == 0 and "no state of rest" in warning and "leaves each of its modes" in warning
    assert epp.simulate(loop(0.1 * abs(factor)), t_end=60.0).limit_cycle.period == pytest.approx(2.728, abs=1e-3)
    assert predict_limit_cycles(loop(0.6 * abs(factor))).warnings == ()
    assert epp.simulate(loop(0.6 * abs(factor)), t_end=60.0).status is Status.SETTLED


def test_a_stable_predicted_cycle_is_no_surprise_and_a_sliding_relay_rests():
    A = [[-1.0, 1.0, 0.0], [0.0, -1.0, 0.5], [0.0, 0.0, 0.0]]
    loop = epp.LureSystem.build(A, [[0], [0], [-1]], [[1, 0, 0]], [epp.Quantiser(1.0, 20)], constant_state=[0, 0, 0.3])
    prediction = predict_limit_cycles(loop)
    assert [c.stable for c in prediction] == [True] and prediction.warnings == ()
    sliding = epp.LureSystem.build([[0.0]], [[-1.0]], [[1.0]], [epp.Quantiser(1.0, 20)], constant_state=[0.3])
    assert predict_limit_cycles(sliding).warnings == ()


@pytest.mark.parametrize("gain", [3.3, 3.38])
def test_a_cycle_that_only_harmonics_make_is_said_with_its_frequency(gain):
    """Play in a servo just below the gain at which first order's two cycles meet and vanish."""
    loop = epp.LureSystem.from_tf(([gain], [1.0, 1.0, 0.0]), epp.Play(gap=2.0))
    prediction = predict_limit_cycles(loop)
    assert len(prediction) == 0
    (warning,) = prediction.warnings
    said = float(re.search(r"has it at ([\d.]+) Hz", warning).group(1))
    assert min(abs(c.frequency / said - 1.0) for c in find_limit_cycles(loop)) < 0.02


@pytest.mark.slow
def test_far_below_that_gain_there_is_nothing_to_say():
    loop = epp.LureSystem.from_tf(([1.5], [1.0, 1.0, 0.0]), epp.Play(gap=2.0))
    assert predict_limit_cycles(loop).warnings == () and len(find_limit_cycles(loop)) == 0


def test_ordinary_loops_are_not_warned_of():
    names = ("backlash_servo", "band_two_cycles", "relay_deadzone", "sat_khalil710", "stiction_deadband_none")
    assert [n for n in names if predict_limit_cycles(epp.case(n).to_system()).warnings] == []


@pytest.mark.parametrize("name", ["two_mass_damped_shaft", "two_mass_damped_shaft_classical"])
def test_an_element_of_two_inputs_and_outputs_is_asked_as_well(name):
    assert str(predict_limit_cycles(epp.case(name))).startswith("The describing function predicts 1 stable limit cycle")


def test_a_pair_of_cycles_between_the_levels_of_a_quantiser():
    """A random loop in which first order has none, by a tenth of a per cent of gain, and the exact search a pair."""
    loop = random_loop(24)
    prediction = predict_limit_cycles(loop)
    assert len(prediction) == 0 and len(find_limit_cycles(loop)) == 2 and len(prediction.warnings) == 1


@pytest.mark.parametrize("shift", [0.0, 0.3])
def test_a_quantiser_that_rounds_down_is_said_to_hunt_where_zero_is_an_edge(shift):
    """About zero it rests on one side of a jump alone, and behind three lags there is a cycle; beside it it rests."""
    A = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-0.45, -1.2, -1.5]]
    floor = epp.FloorQuantiser(step=1.0, levels=1)
    loop = epp.LureSystem.build(
        A, [[0.0], [0.0], [1.0]], [[-1.08, 0.0, 0.0]], [floor], constant_input=[shift], x0=[0.3, 0.0, 0.0]
    )
    run = epp.simulate(loop, t_end=100.0)
    assert (run.status is Status.LIMIT_CYCLE) == (shift == 0.0)
    prediction = predict_limit_cycles(loop)
    assert len(prediction) == 0 or shift
    assert any("can rest only on an edge" in w for w in prediction.warnings) == (shift == 0.0)


def test_a_rate_limiter_before_a_dead_time_has_a_state_of_rest():
    diagram = epp.Diagram(
        parts={"limiter": epp.RateLimiter(rate=1.0), "late": epp.blocks.DeadTime(delay=0.1),
               "plant": epp.blocks.TransferFunction(num=[0.5], den=[1.0, 1.0])},
        connect=["-plant -> limiter", "limiter -> late", "late -> plant"],
    )  # fmt: skip
    assert not any("no state of rest" in w for w in predict_limit_cycles(diagram.to_system()).warnings)


def test_a_satellite_that_drifts_between_its_thrusters_thresholds_is_said():
    """Its cycle in closed form: each pulse turns the speed about, so that it is half of the hysteresis in size."""
    on, off, thrust, lead = 0.1, 0.08, 0.05, 1.0
    loop = epp.LureSystem.from_tf(([lead, 1.0], [1.0, 0.0, 0.0]), epp.HysteresisRelayDeadZone(on, off, thrust))
    prediction, found = predict_limit_cycles(loop), find_limit_cycles(loop)
    assert len(prediction) == 0 and "drifts" in prediction.warnings[0]
    speed = (on - off) / (2.0 * lead)
    assert [c.period for c in found.stable] == pytest.approx([4.0 * ((on - lead * speed) / speed + speed / thrust)])


@pytest.mark.parametrize(
    "loop",
    [
        epp.LureSystem.from_tf(([1.0, 1.0], [1.0, 0.1, 0.0]), epp.HysteresisRelayDeadZone(0.1, 0.08, 0.05)),
        epp.LureSystem.from_tf(([1.0, 0.5], [1.0, 0.0, 0.0]), epp.HysteresisRelay(-0.1, 0.1)),
        epp.LureSystem.from_tf(([1.0, 1.0], [1.0, 0.0, 0.0]), epp.DeadZone(-0.1, 0.1)),
    ],
    ids=["drag", "never off", "a spring at either side"],
)
def test_a_loop_that_something_damps_or_drives_between_thresholds_is_not(loop):
    assert not any("drifts" in warning for warning in predict_limit_cycles(loop).warnings)


@pytest.mark.parametrize(
    ("coefficients", "sizes"),
    [
        # van der Pol's oscillator as x'' + x with a polynomial: 4 peak to peak.
        ((0.0, -0.2, 0.0, 0.2 / 3.0), "4"),
        # 0.2 - 0.45 A^2 + 0.075 A^4 = 0: A = 0.6953 and 2.3486.
        ((0.0, 0.2, 0.0, -0.6, 0.0, 0.12), "1.4 and 4.7"),
    ],
)
@pytest.mark.parametrize("turned", [False, True])
def test_cycles_where_the_linear_part_swings_undamped_by_itself_are_told(coefficients, sizes, turned) -> None:
    """There its response is infinite and the gain of the element zero: no crossing of the two curves shows them."""
    loop = epp.LureSystem.build(
        [[0.0, 1.0], [-1.0, 0.0]], [[-1.0], [0.0]], [[1.0, 0.0]], [epp.Polynomial(coefficients)]
    )
    if turned:
        Q = np.linalg.qr(np.random.default_rng(1).normal(size=(2, 2)))[0]
        loop = loop.in_coordinates(Q.T, Q)
    told = str(epp.predict_limit_cycles(loop))
    assert (
        f"at {1.0 / (2.0 * np.pi):.4g} Hz. The describing function has cycles of about {sizes} peak to peak there"
        in told
    )


def test_where_a_swing_is_damped_or_no_gain_passes_zero_nothing_is_told_of_it() -> None:
    for damping, coefficients in ((0.01, (0.0, -0.2, 0.0, 0.2 / 3.0)), (0.0, (0.0, 0.2, 0.0, 0.2 / 3.0))):
        loop = epp.LureSystem.build(
            [[-damping, 1.0], [-1.0, 0.0]], [[-1.0], [0.0]], [[1.0, 0.0]], [epp.Polynomial(coefficients)]
        )
        assert "undamped" not in str(epp.predict_limit_cycles(loop))


def swing(numerator, denominator, jump=(-1.0, 1.0), size=0.03) -> float:
    """Size of a swing over that of the one before, of an ideal relay's input that starts at zero: by scipy alone."""
    A, inlet, outlet, _ = signal.tf2ss(numerator, denominator)
    B, C = inlet[:, 0], -outlet[0]
    x, speeds = np.linalg.lstsq(np.stack([C, C @ A]), [0.0, size], rcond=None)[0], []
    for k in range(3):
        level = jump[1] if k % 2 == 0 else jump[0]

        def crosses(t, x, y):
            return C @ x

        crosses.terminal, crosses.direction = True, -1 if k % 2 == 0 else 1
        precision = {"rtol": 1e-10, "atol": 1e-13, "max_step": size / 3.0}
        run = integrate.solve_ivp(
            lambda t, x, y: A @ x + B * y, (0.0, 9.0), x, events=crosses, args=(level,), **precision
        )
        x = run.y[:, -1]
        speeds.append(abs(C @ (A @ x + B * level)))
    return speeds[2] / speeds[0]


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("element", [epp.Relay(), epp.Relay(-0.5, 1.0)])
@pytest.mark.parametrize(
    "plant", [([1.0], [1.0, 1.0, 0.0]), ([1.0, 2.0], [1.0, 3.0, 2.0, 0.0]), ([2.0], [1.0, 0.2, 4.0]),
              ([1.0, 4.0], [1.0, 3.0, 2.0, 0.0]), ([10.0], [1.0, 2.0, 1.0, 0.0])]
)  # fmt: skip
def test_small_swings_across_a_jump_are_said_to_die_out_where_they_do(plant, element, turned):
    """Held against the loop's own swings: with two poles more than zeros and damping each is smaller than the last."""
    loop = epp.LureSystem.from_tf(plant, element)
    if turned:
        Q = np.linalg.qr(np.random.default_rng(3).normal(size=(len(loop.A), len(loop.A))))[0]
        loop = loop.in_coordinates(Q.T, Q)
    told = predict_limit_cycles(loop)
    edge = float(element.breakpoints[0])
    levels = [float(s * edge + c) for s, c in zip(element.slopes, element.intercepts, strict=True)]
    dies_out = bool(swing(*plant, jump=levels) < 1.0)
    assert any("comes to rest there in ever faster switching" in w for w in told.warnings) is dies_out
    assert any("hunts across" in w for w in told.warnings) is (not dies_out and not len(told))


@pytest.mark.parametrize("turned", [False, pytest.param(True, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    "element",
    [epp.Relay(), epp.Saturation(), epp.Cube(1.0), epp.DeadZone(), epp.Preload(0.3, 1.0), epp.Relay(-0.5, 1.0)],
)
@pytest.mark.parametrize("plant", [([1.0], [1.0, 0.0, 0.0]), ([2.0], [1.0, 0.0, 1.0])])
def test_a_loop_that_nothing_damps_swings_at_every_size(plant, element, turned):
    """Nothing is predicted there, nor does it hunt: the balance holds everywhere, and runs keep the size they have."""
    loop = epp.LureSystem.from_tf(plant, element)
    if turned:
        Q = np.linalg.qr(np.random.default_rng(4).normal(size=(2, 2)))[0]
        loop = loop.in_coordinates(Q.T, Q)
    told = predict_limit_cycles(loop)
    assert len(told) == 0 and len(told.warnings) == 1 and "Nothing damps the loop" in told.warnings[0]
    assert "margin" not in str(told)
    for size in (2.0, 3.0):
        cycle = epp.simulate(replace(loop, x0=size * loop.x0), t_end=100.0).limit_cycle
        first = epp.simulate(replace(loop, x0=size * loop.x0), t_end=40.0, t_eval=np.linspace(0.0, 40.0, 8001)).signals[
            "x"
        ]
        assert cycle is None or cycle.peak_to_peak["x"] == pytest.approx(np.ptp(first), rel=1e-3)
    lossy = epp.LureSystem.from_tf((plant[0], [1.0, 1e-3, plant[1][2]]), element)
    assert not any("Nothing damps" in w for w in predict_limit_cycles(lossy).warnings)


def test_a_loop_without_damping_is_not_said_to_swing_where_an_element_delays_or_pushes_away():
    for loop in (
        epp.LureSystem.from_tf(([1.0], [1.0, 0.0, 0.0]), epp.Play(gap=1.0)),
        epp.LureSystem.from_tf(([1.0], [1.0, 0.0, 0.0]), epp.Saturation(), feedback=1),
    ):
        assert not any("Nothing damps" in w for w in predict_limit_cycles(loop).warnings)


def under_load(element: epp.Nonlinearity, load: float) -> epp.LureSystem:
    """A drive in proportional control of its position, against a constant load."""
    return epp.Diagram(
        parts={
            "drive": element,
            "gain": epp.blocks.Gain(gain=3.0),
            "load": epp.blocks.Constant(value=load),
            "plant": epp.blocks.TransferFunction(num=[1.0], den=[1.0, 1.0, 0.0], start=[0.0, 0.5]),
        },
        connect=["-plant -> gain", "gain -> drive", "drive - load -> plant"],
    ).to_system()


@pytest.mark.parametrize(
    "element",
    [epp.Saturation(), pytest.param(epp.Tanh(1.0), marks=pytest.mark.slow), epp.Relay(), epp.RelayDeadZone(0.1),
     epp.Quantiser(0.1, 10), epp.HysteresisRelay(-0.1, 0.1), epp.DeadZoneSaturation(0.1, 1.0, 1.0)],
    ids=lambda e: e.kind,
)  # fmt: skip
def test_a_drive_that_is_weaker_than_its_load_drifts_away(element):
    """It gives 1 at most. With less to hold it is said to rest or to swing, and with more neither."""
    told = predict_limit_cycles(under_load(element, 1.5))
    (warning,) = told.warnings
    assert len(told) == 0 and warning.endswith("would have to give 1.5, and gives -1 to 1; the loop drifts away.")
    assert "margin" not in str(told)
    run = epp.simulate(under_load(element, 1.5), t_end=100.0)
    speed = np.diff(run.signals["plant"][-2:])[0] / np.diff(run.t[-2:])[0]
    # Of a curved element no mode says what is to come.
    goes_on = "neither settled" if isinstance(element, epp.Tanh) else "it grows without bound"
    assert speed == pytest.approx(-0.5, rel=1e-2) and goes_on in str(run)
    assert not any("drifts away" in w for w in predict_limit_cycles(under_load(element, 0.55)).warnings)


@pytest.mark.parametrize("element", [epp.Saturation(), epp.RelayDeadZone(0.1), epp.DeadZoneSaturation(0.1, 1.0, 1.0)])
def test_a_search_does_not_take_an_even_drift_for_rest(element):
    found = find_limit_cycles(under_load(element, 1.5))
    assert len(found) == 0 and "grow without bound" in str(found) and "rest" not in str(found)


@pytest.mark.parametrize(
    ("between", "setpoint", "rests"),
    [(epp.Quantiser(0.1, 1000), 20.0, False), (epp.Saturation(-100.0, 100.0), 20.0, False),
     (epp.Saturation(-100.0, 19.8), 20.0, True), (epp.Quantiser(0.1, 1000), 45.0, True)],
    ids=["coarse thermometer", "thermometer", "thermometer that ends before the threshold", "weak heater"],
)  # fmt: skip
def test_a_thermostat_behind_another_element_is_said_to_have_no_state_of_rest(between, setpoint, rests):
    """Its heater of 0 or 40 degrees would leave it at rest on or off only where a threshold is beyond reach."""
    parts = {"thermostat": epp.HysteresisRelay(-0.5, 0.5, 0.0, 40.0), "thermometer": between}
    room = {"room": epp.blocks.TransferFunction(num=[1.0], den=[50.0, 1.0])}
    loop = epp.Diagram(
        parts=parts | room,
        connect=["setpoint - thermometer -> thermostat", "thermostat -> room", "room -> thermometer"],
        inputs={"setpoint": setpoint},
    ).to_system()
    told = predict_limit_cycles(loop)
    assert any("thermostat leaves each of its modes" in w for w in told.warnings) is not rests
    assert epp.simulate(loop, t_end=2000.0).status is (Status.SETTLED if rests else Status.LIMIT_CYCLE)


def test_friction_that_holds_more_at_rest_than_in_motion_is_not_said_to_be_too_weak():
    """1.5 is more than it gives while it slips, and less than it holds."""
    held = epp.LureSystem.build([[-1.0]], [[-1.0]], [[1.0]], [epp.Friction(1.0, 2.0)], constant_state=[1.5])
    free = epp.LureSystem.build([[0.0]], [[-1.0]], [[1.0]], [epp.Friction(1.0, 2.0)], constant_state=[1.5], x0=[0.0])
    for loop in (held, free):
        assert not any("drifts away" in w for w in predict_limit_cycles(loop).warnings)
    assert epp.simulate(free, t_end=10.0).status is Status.SETTLED


def sampled_servo(element: epp.Nonlinearity, lag: float, gain: float) -> epp.LureSystem:
    """A motor with a lag, in samples, under proportional control of its position, executed once a sample."""
    A, B = np.array([[0.0, 1.0], [0.0, -1.0 / lag]]), np.array([[0.0], [gain / lag]])
    A, B = signal.cont2discrete((A, B, np.eye(2), np.zeros((2, 1))), 1.0)[:2]
    return epp.LureSystem.build(A, B, [[-1.0, 0.0]], [element], time_step=1.0, x0=[0.3, 0.0])


def turns_of_iteration(loop: epp.LureSystem) -> set[int]:
    """Samples after which iterations from a hundred starts repeat themselves, those that rest left out."""
    x = np.random.default_rng(1).normal(size=(100, 2)) * np.geomspace(0.3, 30.0, 100)[:, None]
    path = []
    for _ in range(3000):
        x = x @ loop.A.T + np.asarray(loop.elements[0].output((x @ loop.C.T)[:, 0])[0])[:, None] * loop.B.T
        path.append(x)
    tail = np.array(path[-400:])
    moving = tail[:, np.ptp(tail, axis=0).max(1) > 1e-9]
    same = [np.abs(moving[n:] - moving[:-n]).max((0, 2), initial=0.0) < 1e-9 for n in range(1, 60)]
    return {int(np.argmax([s[k] for s in same])) + 1 for k in range(moving.shape[1])} - {1}


@pytest.mark.parametrize("element", [epp.Quantiser(1.0, 20), epp.RelayDeadZone(0.5)], ids=["quantiser", "relay"])
@pytest.mark.parametrize(
    ("lag", "gain"),
    mostly_slow([(1.6, 1.0), (2.3, 0.9), (4.0, 0.95), (6.0, 1.0), (8.0, 0.2), (3.0, 0.2)], [(2.3, 0.9), (8.0, 0.2)]),
)
def test_cycles_that_lock_to_samples_are_warned_of(element, lag, gain):
    """First order has none there; where an iteration has some their numbers of samples are said, elsewhere nothing."""
    loop = sampled_servo(element, lag, gain)
    prediction, turns = predict_limit_cycles(loop), turns_of_iteration(loop)
    told = [re.search(r"of about (\d+)(?: to (\d+))? samples a turn", w) for w in prediction.warnings]
    known = {round(c.period) for c in prediction}
    if turns:
        said = {n for m in told if m for n in range(int(m[1]), int(m[2] or m[1]) + 1)}
        assert min(turns) in {n + k for n in said | known for k in (-1, 0, 1)}
    else:
        assert not any(told) and not known


def test_a_relay_that_locks_to_samples_has_that_in_its_error():
    loop = sampled_servo(epp.Relay(), 5.0, 0.2)
    (cycle,) = predict_limit_cycles(loop)
    turns = turns_of_iteration(loop)
    assert len(turns) > 2 and cycle.error_estimate > 2.0 / cycle.period


def tank(outflow: float, *thresholds: tuple[float, float]) -> epp.LureSystem:
    """A level that falls by an outflow, and pumps of 1 each that start and stop at levels of their own."""
    n = len(thresholds)
    pumps = [epp.HysteresisRelay(-stop, -start, 0.0, 1.0) for start, stop in thresholds]
    return epp.LureSystem.build([[0.0]], [[1.0] * n], [[-1.0]] * n, pumps, constant_state=[-outflow], x0=[0.5])


@pytest.mark.parametrize("outflow", [0.3, 0.7, 1.0, 1.3, 1.9, 2.0, 2.5])
def test_pumps_on_one_tank_have_no_state_of_rest_but_where_some_of_them_give_just_the_outflow(outflow):
    loop = tank(outflow, (0.4, 0.6), (0.2, 0.3))
    (warning,) = predict_limit_cycles(loop).warnings or ("",)
    run = epp.simulate(loop, t_end=60.0)
    assert ("no state of rest" in warning) is (run.status is Status.LIMIT_CYCLE)
    assert ("drifts away" in warning) is (outflow > 2.0)


def test_relays_to_whose_edge_the_loop_returns_are_not_said_to_keep_it_moving():
    """Beside a relay with a dead zone, an ideal one on a lag slides, and on two it switches ever faster."""
    for A in ([[-1.0, 1.0], [0.0, -0.5]], [[0.0, 1.0], [0.0, -1.0]]):
        for row in ([-1.0, 0.0], [-1.0, -0.1]):
            loop = epp.LureSystem.build(
                A, [[0, 0], [1, 0.5]], [row, row], [epp.Relay(), epp.RelayDeadZone(0.1)], x0=[0.3, 0]
            )
            assert not any("no state of rest" in w for w in predict_limit_cycles(loop).warnings)


def thrusters(elements: list[epp.Nonlinearity], push: list[float], disturbance: float = 0.0) -> epp.LureSystem:
    """A satellite under a law of angle and rate that several on-off elements execute together."""
    n = len(elements)
    return epp.LureSystem.build(
        [[0.0, 1.0], [0.0, 0.0]], [[0.0] * n, push], [[-1.0, -0.5]] * n, elements, constant_state=[0.0, disturbance]
    )


def test_thrusters_between_whose_thresholds_nothing_damps_are_said_to_drift():
    """Two sides as two elements, or a coarse and a fine pair, are as blind as one element of three levels."""
    ahead, back = epp.PiecewiseLinear([0.1], [0, 0], [0, 1]), epp.PiecewiseLinear([-0.1], [0, 0], [-1, 0])
    pairs = [epp.RelayDeadZone(0.5), epp.RelayDeadZone(0.1)]
    for loop in (thrusters([ahead, back], [1.0, 1.0]), thrusters(pairs, [1.0, 0.2])):
        assert any("it drifts" in w and " and " in w for w in predict_limit_cycles(loop).warnings)
    for loop in (
        thrusters([ahead, ahead], [1.0, 1.0]),
        thrusters([*pairs, epp.Saturation(-9.0, 9.0)], [1.0, 0.2, 1.0]),
    ):
        assert not any("it drifts" in w for w in predict_limit_cycles(loop).warnings)


def test_friction_that_does_not_act_on_its_own_input_does_not_stick() -> None:
    """What slides under it goes on at one speed, whatever the friction does: it was said to judder."""
    loop = epp.LureSystem.build(
        [[0.0, 0.0], [0.0, -2.6]], [[0.0], [-1.3]], [[4.0, 0.0]], [epp.Friction(0.49, static=1.7)], x0=[0.6, -2.0]
    )
    assert epp.predict_limit_cycles(loop).warnings == ()
