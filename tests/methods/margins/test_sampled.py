"""Margins of loops with sampled controllers against python-control's discretised loops."""

import control
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import eppanalysis as epp

T = 0.01


def _loop(delay=0.0, unity=None):
    """PI controller at 100 Hz, a valve with slope one, and an oscillating plant of third order."""
    return epp.Diagram(
        parts={
            "controller": epp.blocks.TransferFunction(
                num=[1.3, -1.25], den=[1.0, -1.0], sample_time=T, computation_delay=delay
            ),
            "valve": unity or epp.Saturation(lower=-1.0, upper=1.0),
            "plant": epp.blocks.TransferFunction(num=[30.0], den=[1.0, 6.0, 40.0, 20.0]),
        },
        connect=["-plant -> controller", "controller -> valve", "valve -> plant"],
        margins_at="controller",
    ).to_system()


def _expected(late=0.0):
    """Of the loop in discrete time; a delay of a share of a sample by the modified hold, state by state."""
    plant = control.ss(control.tf([30.0], [1.0, 6.0, 40.0, 20.0]))
    if not late:
        discrete = control.sample_system(plant, T)
    else:
        n = 3
        both = np.block([[plant.A, plant.B], [np.zeros((1, n + 1))]])
        from scipy.linalg import expm

        first, last = expm(both * late), expm(both * (T - late))
        A = last[:n, :n] @ first[:n, :n]
        old, new = last[:n, :n] @ first[:n, n:], last[:n, n:]
        A_all = np.block([[A, old], [np.zeros((1, n + 1))]])
        discrete = control.ss(A_all, np.vstack([new, [[1.0]]]), np.hstack([plant.C, [[0.0]]]), 0.0, T)
    return control.stability_margins(discrete * control.tf([1.3, -1.25], [1.0, -1.0], T), method="frd")


@pytest.mark.parametrize("late", [0.0, 0.004])
@pytest.mark.parametrize("place", ["controller.out", "controller.in"])
def test_cut_at_the_controller_they_are_those_of_the_loop_in_discrete_time(late, place):
    found = epp.margins(_loop(late), place)
    gain, phase, _, at_phase, at_gain, _ = _expected(late)
    assert found.gain_margin == pytest.approx(gain, rel=1e-6)
    assert np.rad2deg(found.phase_margin) == pytest.approx(phase, rel=1e-6)
    assert (found.phase_crossover, found.gain_crossover) == pytest.approx((at_phase, at_gain), rel=1e-6)
    assert found.stable and any("exact from sample to sample" in line for line in found.rule)


def test_cut_elsewhere_they_are_near_and_say_how_near():
    parts = {
        "controller": epp.blocks.Gain(gain=1.3, sample_time=T),
        "plant": epp.blocks.TransferFunction(num=[30.0], den=[1.0, 6.0, 40.0, 20.0]),
        "filter": epp.blocks.LowPass(bandwidth=50.0),
        "valve": epp.Saturation(),
    }
    connect = ["-filter -> controller", "controller -> valve", "valve -> plant", "plant -> filter"]
    loop = epp.Diagram(parts=parts, connect=connect).to_system()
    exact, held, read, near = epp.margins(loop, ["controller", "plant.in", "filter", "plant"])
    share = (exact.gain_crossover * T) ** 2
    assert near.phase_margin == pytest.approx(exact.phase_margin, abs=share)
    assert near.phase_margin != pytest.approx(exact.phase_margin, rel=1e-9)
    assert any("in the mean" in line for line in near.rule) and "controller" in " ".join(near.rule)
    # In front of the plant is nothing but what the controller holds, and nothing but the controller reads the filter.
    for found in (held, read):
        assert found.gain_margin == pytest.approx(exact.gain_margin, rel=1e-12)
        assert found.phase_margin == pytest.approx(exact.phase_margin, rel=1e-12)


@settings(max_examples=15, deadline=None)
@given(gain=st.floats(1.0, 400.0))
def test_a_loop_is_stable_as_its_poles_in_discrete_time_are(gain):
    loop = _loop(unity=epp.PiecewiseLinear([], [gain], [0.0]))
    plant = control.sample_system(control.ss(control.tf([30.0], [1.0, 6.0, 40.0, 20.0])), T)
    poles = control.feedback(gain * plant * control.tf([1.3, -1.25], [1.0, -1.0], T)).poles()
    largest = float(np.abs(poles).max())
    if abs(largest - 1.0) > 1e-6:
        assert epp.margins(loop).stable is (largest < 1.0)


def test_the_servo_at_its_motor_command():
    """As python-control has it: 16.74 and 65.8 deg with proportional control, 16.33 and 55.8 deg with the integral."""
    case = epp.case("azimuth_servo")
    for changes, gain, phase in (
        ({"controller.kind": "gain", "controller.gain": "Kp"}, 16.74, 65.8),
        ({}, 16.33, 55.8),
    ):
        tables = _continuous(case, changes)
        found = epp.margins(epp.Case.from_tables(tables, name="servo"))
        assert found.at == "controller.out"
        assert found.gain_margin == pytest.approx(gain, abs=0.005)
        assert np.rad2deg(found.phase_margin) == pytest.approx(phase, abs=0.05)


def _continuous(case, changes):
    import tomllib

    tables = tomllib.loads(case.to_toml())
    controller = tables["blocks"]["controller"]
    controller.pop("sample_time")
    if changes:
        tables["blocks"]["controller"] = {"kind": "gain", "gain": "Kp"}
    return tables


def two_rates() -> epp.LureSystem:
    """A speed loop at 1 kHz around a current loop at 10 kHz, on two inertias behind a gear with play."""
    blocks = epp.blocks
    parts = {
        "speed": blocks.PI(kp=0.4, ti=0.05, sample_time=1e-3),
        "limit": epp.Saturation(lower=-10.0, upper=10.0),
        "current": blocks.PI(kp=4.0, ti=2e-3, sample_time=1e-4),
        "winding": blocks.TransferFunction(num=[1.0], den=[4e-3, 1.0]),
        "torque": blocks.Gain(gain=0.5),
        "emf": blocks.Gain(gain=0.5),
        "tacho": blocks.LowPass(bandwidth=2000.0),
        "motor": blocks.Inertia(inertia=1e-3, damping=1e-3),
        "load": blocks.Inertia(inertia=3e-3, damping=1e-3),
        "gear": epp.LockPin(gap=0.01, stiffness=300.0, damping=0.05),
    }
    connect = [
        *("setpoint - tacho -> speed", "speed -> limit", "limit - winding -> current", "current - emf -> winding"),
        *("winding -> torque", "torque - gear -> motor", "motor.speed -> emf, tacho", "gear -> load"),
        *("motor.angle - load.angle -> gear.twist", "motor.speed - load.speed -> gear.rate"),
    ]
    return epp.Diagram(parts=parts, connect=connect, inputs=["setpoint"]).to_system()


def test_with_two_rates_they_are_near_those_from_sample_to_sample_and_one_all_along_the_loop():
    """The angles are integrators that only the gear connects: units that left it out had lost what passes there.

    Ten steps of the inner loop are one of the outer, so that the loop cut at the outer controller is known exactly.
    """
    A = np.zeros((5, 5))  # current, twist, both speeds, tacho
    A[0, [0, 2]], A[1, [2, 3]], A[4, [2, 4]] = (-250.0, -125.0), (1.0, -1.0), (2000.0, -2000.0)
    A[2, :4], A[3, 1:4] = (500.0, -3e5, -51.0, 50.0), (1e5, 50.0 / 3.0, -51.0 / 3.0)
    plant = control.sample_system(control.ss(A, [[250.0], [0], [0], [0], [0]], np.eye(5), 0), 1e-4)
    step, into = np.zeros((6, 6)), np.zeros(6)
    # The output of the inner controller is 4.2 e + I, with I growing by 0.2 e.
    step[:5, :5], step[5, 0], step[5, 5], into[5] = plant.A, -0.2, 1.0, 0.2
    step[:5] += np.outer(plant.B, [-4.2, 0, 0, 0, 0, 1.0])
    into[:5] = 4.2 * plant.B[:, 0]
    ten = np.linalg.matrix_power(step, 10)
    held = sum(np.linalg.matrix_power(step, k) for k in range(10)) @ into
    outer = control.ss(ten, held[:, None], np.eye(6)[[4]], 0, 1e-3) * control.tf([0.408, -0.4], [1.0, -1.0], 1e-3)
    gain, phase, _, omega, _, _ = control.stability_margins(outer)
    loop = two_rates()
    *exact, near = epp.margins(loop, ["speed.out", "limit.out", "tacho.out", "tacho.in"])
    assert all(m.stable for m in (*exact, near)) and np.all(np.abs(control.feedback(outer, 1).poles()) < 1.0)
    for one in exact:
        assert one.gain_margin == pytest.approx(gain, rel=1e-9)
        assert np.rad2deg(one.phase_margin) == pytest.approx(phase, rel=1e-9)
    # In the mean over the phases they are near, and say so; the inner controller reads the outer one's hold as old as
    # it is at its samples, and not late by both holds.
    assert near.gain_margin == pytest.approx(gain, rel=(omega * 1e-3) ** 2 / 12.0)
    assert near.phase_margin == pytest.approx(np.deg2rad(phase), abs=(near.gain_crossover * 1e-3) ** 2 / 12.0)
    assert any(line.startswith("speed:") and "s)^2/12" in line for line in near.rule)


def cascade(limited=False, step=1e-3, late=0.0, turned=False) -> epp.Diagram:
    """A position controller at 1 kHz around a speed controller; a limit of the speed, far from its ends, between."""
    parts = {
        "position": epp.blocks.Gain(gain=20.0, sample_time=1e-3, computation_delay=late if step == 1e-3 else 0.0),
        "limit": epp.Saturation(lower=-1e3, upper=1e3),
        "speed": epp.blocks.PI(kp=2.0, ti=0.02, sample_time=step, computation_delay=late),
        "motor": epp.blocks.Motor(resistance=2.0, torque_constant=0.05, inertia=2e-5, ratio=50.0, damping=0.1),
        "friction": epp.Friction(coulomb=0.3),
    }
    connect = ["setpoint - motor.angle -> position", "speed -> motor.voltage", "-friction -> motor.torque"]
    connect += ["motor.speed -> friction", "position -> limit", "limit - motor.speed -> speed"]
    if not limited:
        del parts["limit"]
        connect[-2:] = ["position - motor.speed -> speed"]
    names = list(parts)[::-1] if turned else list(parts)
    return epp.Diagram(
        parts={name: parts[name] for name in names}, connect=connect[::-1] if turned else connect,
        inputs=["setpoint"], margins_at="position",
    )  # fmt: skip


def _cut_at_position(step, late) -> control.StateSpace:
    """What comes back to the position controller's output of what goes on from it, event by event."""
    from scipy.linalg import expm

    inertia, k = 0.05, 2.5
    both = np.zeros((3, 3))
    both[0, 1], both[1, 1:] = 1.0, (-(0.1 + k * k / 2.0) / inertia, k / 2.0 / inertia)
    # Rows of angle, speed, integral, voltage; columns the same and what goes on.
    now, last, computed, back = np.eye(4, 5), 0.0, np.zeros(5), np.zeros(5)
    n = round(1e-3 / step)
    for time, ready in sorted([(i * step, False) for i in range(n)] + [(i * step + late, True) for i in range(n)]):
        move = expm(both * (time - last))
        now[[0, 1, 3]], last = move @ now[[0, 1, 3]], time
        if ready:
            now[3] = computed
        else:
            back = -20.0 * now[0] if time == 0.0 else back
            error = np.eye(1, 5, 4)[0] - now[1]
            now[2] = now[2] + 2.0 * step / 0.02 * error
            computed = now[2] + 2.0 * error
    now[[0, 1, 3]] = expm(both * (1e-3 - last)) @ now[[0, 1, 3]]
    return control.ss(now[:, :4], now[:, 4:], -back[None, :4], -back[None, 4:], 1e-3)


@pytest.mark.parametrize("limited", [False, True])
@pytest.mark.parametrize(("step", "late"), [(1e-3, 0.0), (2.5e-4, 0.0), (2.5e-4, 1e-4), (1e-3, 2e-4)])
def test_a_controller_within_a_controller_has_the_margins_of_the_loop_from_sample_to_sample(step, late, limited):
    loop = cascade(limited, step, late).to_system()
    expected = _cut_at_position(step, late)
    cuts = ["position", "position.in"] + (["limit", "limit.in"] if limited else [])
    for found in epp.margins(loop, cuts):
        at_gain, at_phase = (expected(np.exp(1e-3j * w)) for w in (found.gain_crossover, found.phase_crossover))
        assert abs(at_gain) == pytest.approx(1.0, rel=1e-9)
        assert np.angle(-at_gain) == pytest.approx(found.phase_margin, rel=1e-9)
        assert at_phase == pytest.approx(-1.0 / found.gain_margin, rel=1e-9)


@pytest.mark.parametrize(("step", "late"), [(1e-3, 0.0), (2.5e-4, 0.0), (1e-3, 2e-4)])
def test_an_element_that_does_nothing_between_two_controllers_changes_no_run_whatever_the_order(step, late):
    times = np.linspace(0.0, 0.05, 201)
    runs = [
        epp.simulate(cascade(limited, step, late, turned).to_system(), epp.inputs.Step(0.01), t_end=0.05)
        for limited in (False, True)
        for turned in (False, True)
    ]
    angles = [np.interp(times, run.t, run.signals["motor_angle"]) for run in runs]
    assert np.ptp(angles[0]) > 1e-3
    assert all(np.allclose(angle, angles[0], rtol=0.0, atol=1e-15) for angle in angles)


def test_ports_of_blocks_that_are_executed_together_have_the_margins_that_they_have_apart():
    """One program is closed among its blocks; an element between them that does nothing makes wires of it."""
    together, apart = cascade().to_system(), cascade(limited=True).to_system()
    for place in ("position.out", "position.in", "speed.out", "speed.in", "motor.voltage"):
        one, other = epp.margins(together, place), epp.margins(apart, place)
        for name in ("gain_margin", "phase_margin", "disk_margin", "delay_margin"):
            assert getattr(one, name) == pytest.approx(getattr(other, name), rel=1e-9)


def test_what_stands_for_a_controller_is_said_below_the_gains_of_the_elements():
    text = str(epp.table(epp.margins(_loop())))
    assert "gain for valve" in text
    assert "gain for controller" not in text
    assert "controller: executed every 0.01 s, exact from sample to sample." in " ".join(text.split())


@pytest.mark.parametrize("limited", [False, True])
@pytest.mark.parametrize("dead", [0.0, 0.7e-3])
def test_in_the_mean_a_controller_reads_another_ones_hold_when_it_is_fresh(limited, dead):
    """Two controllers in one program, with dead time behind them, where nothing is exact from sample to sample.

    By hand: one hold for both, however the loop is cut.
    """
    blocks, step = epp.blocks, 1e-3
    parts = {
        "position": blocks.Gain(gain=20.0, sample_time=step),
        "speed": blocks.PI(kp=0.8, ti=0.05, sample_time=step),
        "wire": blocks.DeadTime(delay=dead + 1.1e-3),
        "motor": blocks.Inertia(inertia=0.01, damping=0.02),
    }
    connect = ["- motor.angle -> position", "speed -> wire", "wire -> motor"]
    if limited:
        parts["limit"] = epp.Saturation(lower=-1e3, upper=1e3)
        connect += ["position -> limit", "limit - motor.speed -> speed"]
    else:
        connect += ["position - motor.speed -> speed"]
    loop = epp.Diagram(parts=parts, connect=connect).to_system()

    def response(omega):
        z, s = np.exp(1j * omega * step), 1j * omega
        law = 0.8 * (1.0 + step / 0.05 * z / (z - 1.0))
        held = law * (1.0 - 1.0 / z) / (s * step) * np.exp(-s * (dead + 1.1e-3))
        return held * (20.0 / s + 1.0) / (0.01 * s + 0.02), held / (0.01 * s + 0.02), 20.0 / s

    both, inner, outer = (lambda w, k=k: response(w)[k] for k in range(3))
    expected = {"speed.out": both, "position.out": lambda w: outer(w) * inner(w) / (1.0 + inner(w))}
    for place, L in expected.items():
        found = epp.margins(loop, place)
        w = found.gain_crossover
        assert abs(L(w)) == pytest.approx(1.0, rel=(w * step) ** 2 / 12.0)
        assert found.phase_margin == pytest.approx(np.angle(-L(w)), abs=(w * step) ** 2 / 12.0)
