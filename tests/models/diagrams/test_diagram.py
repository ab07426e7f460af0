"""Diagrams against the equations of their ports, against python-control, and against themselves in another order."""

from dataclasses import replace

import control
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import eppanalysis as epp
from eppanalysis.models.diagrams.blocks import (
    PI,
    Constant,
    DeadTime,
    Gain,
    Integrator,
    StateSpaceBlock,
    TransferFunction,
)
from tests.shared import mostly_slow

OMEGA = np.geomspace(0.01, 100.0, 7)


def _random_block(rng, n, inputs, outputs, through):
    A, B, C = rng.normal(size=(n, n)) - 2 * np.eye(n), rng.normal(size=(n, inputs)), rng.normal(size=(outputs, n))
    D = 0.3 * rng.normal(size=(outputs, inputs)) if through else np.zeros((outputs, inputs))
    return StateSpaceBlock(A=A.tolist(), B=B.tolist(), C=C.tolist(), D=D.tolist())


def _random_diagram(seed):
    """Blocks with random wires between all ports, one element and one external input."""
    rng = np.random.default_rng(seed)
    blocks = {
        f"b{i}": _random_block(rng, int(rng.integers(0, 4)) or 1, *rng.integers(1, 3, size=2), rng.random() < 0.5)
        for i in range(int(rng.integers(1, 5)))
    }
    outputs = [f"{name}.{port}" for name, block in blocks.items() for port in block.outputs] + ["valve", "demand"]
    inputs = [f"{name}.{port}" for name, block in blocks.items() for port in block.inputs] + ["valve.in"]
    wires = {}
    for target in inputs:
        chosen = rng.choice(outputs, size=int(rng.integers(1, min(3, len(outputs)) + 1)), replace=False)
        if target == "valve.in":
            chosen = [name for name in chosen if name != "valve"] or outputs[:1]
        wires[target] = [(int(rng.choice([-1, 1])), str(name)) for name in chosen]
    return blocks, wires


def _connections(wires):
    def text(terms):
        return " ".join(f"{'-' if sign < 0 else '+'} {name}" for sign, name in terms).removeprefix("+ ")

    return [f"{text(terms)} -> {target}" for target, terms in wires.items()]


def _diagram(blocks, wires, order=None):
    parts = {**blocks, "valve": epp.Saturation(lower=-1.0, upper=1.0)}
    names = list(parts) if order is None else order
    return epp.Diagram(
        parts={name: parts[name] for name in names}, connect=_connections(wires), inputs=["demand"], name="random"
    )


def _in_frequency_domain(blocks, wires):
    """Response of the valve's input to its output and to the demand: all port equations solved at once."""
    targets = list(wires)
    outputs = [f"{name}.{port}" for name, block in blocks.items() for port in block.outputs]
    found = np.zeros((2, OMEGA.size), complex)
    for k, omega in enumerate(OMEGA):
        G = np.zeros((len(outputs), len(targets)), complex)
        for name, block in blocks.items():
            A, B, C, D = (np.atleast_2d(m) for m in (block.A, block.B, block.C, block.D))
            response = C @ np.linalg.solve(1j * omega * np.eye(len(A)) - A, B) + D
            rows = [outputs.index(f"{name}.{port}") for port in block.outputs]
            G[np.ix_(rows, [targets.index(f"{name}.{port}") for port in block.inputs])] = response
        W, from_outside = np.zeros((len(targets), len(outputs))), np.zeros((len(targets), 2))
        for i, terms in enumerate(wires.values()):
            for sign, source in terms:
                if source in outputs:
                    W[i, outputs.index(source)] += sign
                else:
                    from_outside[i, ("valve", "demand").index(source)] += sign
        u = np.linalg.solve(np.eye(len(targets)) - W @ G, from_outside)
        found[:, k] = u[targets.index("valve.in")]
    return found


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_loop_of_a_random_diagram_solves_the_equations_of_all_ports(seed):
    blocks, wires = _random_diagram(seed)
    try:
        loop = _diagram(blocks, wires).to_system()
    except epp.ModelError as error:
        assert "algebraic loop" in str(error)
        return
    resolvent = np.linalg.inv(1j * OMEGA[:, None, None] * np.eye(len(loop.A)) - loop.A)
    from_valve = (loop.C @ resolvent @ loop.B + loop.D)[:, 0, 0]
    from_demand = (loop.C @ resolvent @ loop.B_input + loop.D_input)[:, 0, 0]
    expected = _in_frequency_domain(blocks, wires)
    scale = 1.0 + np.abs(expected).max()
    np.testing.assert_allclose([from_valve, from_demand], expected, atol=1e-9 * scale)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), data=st.data())
def test_the_order_of_the_parts_and_connections_does_not_matter(seed, data):
    blocks, wires = _random_diagram(seed)
    order = data.draw(st.permutations([*blocks, "valve"]))
    turned = dict(data.draw(st.permutations(list(wires.items()))))
    try:
        one = _diagram(blocks, wires).to_system()
    except epp.ModelError:
        with pytest.raises(epp.ModelError):
            _diagram(blocks, turned, order).to_system()
        return
    other = _diagram(blocks, turned, order).to_system()
    first, second = (loop.frequency_response(OMEGA)[:, 0, 0] for loop in (one, other))
    np.testing.assert_allclose(first, second, rtol=1e-9, atol=1e-12)
    assert set(one.signals.names) == set(other.signals.names)


def _ring(**options):
    parts = {"valve": epp.Saturation(lower=-1.0, upper=1.0), "plant": TransferFunction(num=[1.0], den=[1.0, 1.0])}
    return {"parts": parts, "connect": ["demand - plant -> valve", "valve -> plant"], "inputs": ["demand"], **options}


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"connect": ["demand - plnt -> valve", "valve -> plant"]}, "did you mean 'plant'"),
        ({"connect": ["demand - plant -> valve", "valve -> plant.inn"]}, "did you mean 'plant.in'"),
        ({"connect": ["demand - plant -> valve"]}, "nothing drives plant.in"),
        ({"connect": ["demand -> valve", "plant -> valve", "valve -> plant"]}, "add the two in one sum"),
        ({"connect": ["demand plant -> valve", "valve -> plant"]}, "a signed sum of ports"),
        ({"connect": ["demand = valve", "valve -> plant"]}, "a connection such as"),
        ({"inputs": ["plant"]}, "different names"),
        ({"inputs": ["my demand"]}, "a plain name"),
        ({"units": {"plan": "m"}}, "a signal: did you mean 'plant'"),
        ({"memory": {"plant": 1.0}}, "an element: one of valve"),
        ({"signals": {"error": "demand - plat"}}, "did you mean 'plant'"),
    ],
)
def test_a_mistake_is_refused_with_what_was_expected(change, sentence):
    with pytest.raises(epp.ModelError, match=sentence.replace("(", r"\(").split(" '")[0]):
        epp.Diagram(**_ring(**change)).to_system()


def test_an_algebraic_loop_without_unique_answer_is_refused():
    parts = {"a": Gain(gain=2.0), "b": Gain(gain=0.5), "valve": epp.Saturation(lower=-1.0, upper=1.0)}
    with pytest.raises(epp.ModelError, match="algebraic loop through a, b has no unique answer"):
        epp.Diagram(parts=parts, connect=["b + valve -> a", "a -> b", "b -> valve"]).to_system()
    around = {"valve": epp.Saturation(lower=-1.0, upper=1.0), "gain": Gain(gain=2.0), "plant": Integrator()}
    wires = ["gain - plant -> valve", "valve -> gain", "valve -> plant"]
    with pytest.raises(epp.ModelError, match="algebraic loop through valve"):
        epp.Diagram(parts=around, connect=wires).to_system()


def test_an_algebraic_loop_with_one_answer_is_solved():
    """valve = sat(x - 0.5 valve): 2/3 of x inside the limits."""
    parts = {"valve": epp.Saturation(lower=-1.0, upper=1.0), "gain": Gain(gain=0.5), "plant": Integrator(start=[0.6])}
    loop = epp.Diagram(parts=parts, connect=["-plant - gain -> valve", "valve -> gain, plant"]).to_system()
    run = epp.simulate(loop, t_end=3.0)
    np.testing.assert_allclose(run.signals["plant"], 0.6 * np.exp(-2.0 / 3.0 * run.t), atol=1e-9)


def _late_rings(valve, tau=0.5):
    """The same ring with its dead time behind the plant, before it, in it, and with others before and in it."""
    plant = TransferFunction(num=[1.0], den=[1.0, 1.0], start=[0.3])
    late = TransferFunction(num=[1.0], den=[1.0, 1.0], start=[0.3], delay=tau)
    half = TransferFunction(num=[1.0], den=[1.0, 1.0], start=[0.3], delay=tau / 2)
    behind = {"valve": valve, "plant": plant, "wait": DeadTime(delay=tau)}
    bias = {"valve": valve, "gain": Gain(gain=1.0, delay=tau), "plant": plant}
    chain = {
        "gain": Gain(),
        "valve": valve,
        "rest": epp.PiecewiseLinear([], [1.0], [0.0]),
        "wait": DeadTime(delay=tau),
        "plant": plant,
    }
    in_two = {"valve": valve, "one": DeadTime(delay=tau / 4), "other": DeadTime(delay=tau / 4), "plant": half}
    return [
        (behind, ["-wait -> valve", "valve -> plant", "plant -> wait"]),
        (dict(reversed(behind.items())), ["-plant -> valve", "valve -> wait", "wait -> plant"]),
        ({"valve": valve, "plant": late}, ["-plant -> valve", "valve -> plant"]),
        (in_two, ["-plant -> valve", "valve -> one", "one -> other", "other -> plant"]),
        (in_two, ["-other -> valve", "valve -> plant", "plant -> one", "one -> other"]),
        # Before the element, which is late in its place: straight, and through the element behind it.
        (bias, ["-plant -> gain", "gain -> valve", "valve -> plant"]),
        (chain, ["-plant -> gain", "gain -> wait", "wait -> valve", "valve -> rest", "rest -> plant"]),
    ]


@pytest.mark.parametrize("number", mostly_slow(range(7), [1, 4]))
def test_dead_time_is_the_same_before_in_and_behind_a_block_with_states(number):
    relay = epp.HysteresisRelay(lower=-0.1, upper=0.1, low=-0.7, high=1.3)
    by_hand = epp.LureSystem.from_tf(([1.0], [1.0, 1.0]), relay, delay=0.5, x0=[0.3])
    expected = epp.find_limit_cycles(by_hand).cycles[0].period
    parts, connect = _late_rings(relay)[number]
    loop = epp.Diagram(parts=parts, connect=connect).to_system()
    assert len(loop.elements) == 1 + ("rest" in parts)
    assert epp.find_limit_cycles(loop).cycles[0].period == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("number", range(7))
def test_every_place_of_a_ring_with_dead_time_has_its_return_ratio(number):
    parts, connect = _late_rings(epp.Saturation(lower=-1.0, upper=1.0))[number]
    loop = epp.Diagram(parts=parts, connect=connect).to_system()
    cuts, expected = loop.places, -np.exp(-0.5j * OMEGA) / (1j * OMEGA + 1.0)
    assert {f"{name}.{port}" for name in parts for port in ("in", "out")} <= set(cuts.names)
    for k, name in enumerate(cuts.names):
        found = []
        for omega in OMEGA:
            resolvent = np.linalg.inv(1j * omega * np.eye(len(loop.A)) - loop.A)
            late, wait = np.exp(-1j * omega * loop.delays), np.exp(-1j * omega * cuts.delays[k])
            x_w, x_d = resolvent @ (loop.B * late), resolvent @ cuts.B[:, k] * wait
            w = np.linalg.solve(np.eye(len(late)) - loop.C @ x_w - loop.D, loop.C @ x_d + cuts.E[:, k])
            y = cuts.C[k] @ (x_w @ w + x_d) + cuts.D[k] @ w + cuts.F[k]
            found.append(y / (1.0 + y))
        np.testing.assert_allclose(found, expected, rtol=1e-10, err_msg=name)


@pytest.mark.parametrize("number", range(7))
def test_margins_are_the_same_at_every_place_of_a_ring_with_dead_time(number):
    parts, connect = _late_rings(epp.PiecewiseLinear([], [2.0], [0.0]))[number]
    loop = epp.Diagram(parts=parts, connect=connect).to_system()
    # 2 exp(-0.5 s)/(s + 1) has the gain one at sqrt(3).
    phase_margin = np.pi - np.arctan(np.sqrt(3.0)) - 0.5 * np.sqrt(3.0)
    for name in loop.places.names:
        assert epp.margins(loop, at=name).phase_margin == pytest.approx(phase_margin, rel=1e-9), name


def test_what_a_place_cannot_tell_beside_a_dead_time_is_none():
    """The plant reads a late signal and one that is not; a loop knows no place that carries both."""
    parts = {
        "valve": epp.Saturation(lower=-1.0, upper=1.0), "wait": DeadTime(delay=0.5),
        "plant": TransferFunction(num=[1.0], den=[1.0, 1.0]), "spring": Gain(gain=2.0),
    }  # fmt: skip
    connect = ["-plant -> valve, spring", "valve -> wait", "wait + spring -> plant"]
    loop = epp.Diagram(parts=parts, connect=connect).to_system()
    assert "plant.in" not in loop.places.names
    assert {"plant.out", "wait.in", "wait.out", "spring.in"} <= set(loop.places.names)


def test_signals_are_not_shown_on_the_wrong_side_of_a_dead_time():
    relay = epp.HysteresisRelay(lower=-0.1, upper=0.1, low=-0.7, high=1.3)
    rings = [epp.Diagram(parts=parts, connect=connect) for parts, connect in _late_rings(relay)[:2]]
    behind, before = (epp.simulate(ring.to_system(), t_end=4.0) for ring in rings)
    assert "plant" not in behind.signals and "wait" not in before.signals
    # Behind the plant the dead time shifts what starts there; the relay sees the same.
    np.testing.assert_allclose(behind.signals["wait"], -behind.signals["valve_in"], atol=1e-14)
    hidden = epp.Diagram(parts=rings[1].parts, connect=rings[1].connect, signals={"late": "wait"})
    with pytest.raises(epp.ModelError, match="dead time"):
        hidden.to_system()
    # A block that lets its late input through carries what no signal of a loop can.
    leads = {**rings[1].parts, "lead": TransferFunction(num=[1.0, 2.0], den=[1.0, 3.0])}
    connect = ["-plant -> valve", "valve -> wait", "wait -> lead", "lead -> plant"]
    assert "lead" not in epp.Diagram(parts=leads, connect=connect).to_system().signals.names


def test_a_named_signal_shows_what_a_dead_time_takes_in():
    """An oven at rest and a pipe to its sensor: what is in the oven comes out of the pipe some time later."""
    parts = {
        "heater": epp.Saturation(lower=0.0, upper=1.0),
        "oven": TransferFunction(num=[1.0], den=[1.0, 1.0]), "pipe": DeadTime(delay=0.5),
        "sensor": TransferFunction(num=[1.0], den=[0.3, 1.0]),
    }  # fmt: skip
    connect = ["demand - sensor -> heater", "heater -> oven", "oven -> pipe", "pipe -> sensor"]
    hidden, seen = (
        epp.Diagram(parts=parts, connect=connect, inputs=["demand"], signals=signals).to_system()
        for signals in ({}, {"inside": "oven"})
    )
    times = np.linspace(0.0, 8.0, 801)
    one, other = (epp.simulate(loop, epp.inputs.Step(0.5), t_end=8.0, t_eval=times) for loop in (hidden, seen))
    assert "oven" not in one.signals
    np.testing.assert_allclose(other.signals["sensor"], one.signals["sensor"], atol=1e-12)
    np.testing.assert_allclose(other.signals["inside"][:-50], one.signals["pipe"][50:], atol=1e-12)


def test_a_constant_is_an_input_that_is_held():
    parts = {"valve": epp.Saturation(lower=-1.0, upper=1.0), "plant": TransferFunction(num=[1.0, 3.0], den=[1.0, 1.0])}
    connect = ["-plant + bias -> valve", "valve - bias -> plant"]
    held = epp.Diagram(parts=parts, connect=connect, inputs={"bias": 0.7}).to_system()
    loop = epp.Diagram(parts={**parts, "bias": Constant(value=0.7)}, connect=connect).to_system()
    assert not loop.input_names
    np.testing.assert_allclose(loop.constant_state, held.B_input[:, 0] * 0.7)
    np.testing.assert_allclose(loop.constant_input, held.D_input[:, 0] * 0.7)
    one, other = (epp.simulate(system, t_eval=np.linspace(0.0, 3.0, 31), t_end=3.0) for system in (loop, held))
    for name in ("valve", "plant", "valve_in", "bias"):
        np.testing.assert_allclose(one.signals[name], other.signals[name], atol=1e-12)


def test_what_is_sampled_throughout_is_a_loop_in_discrete_time():
    """Against the recursion by hand; a gain without a sample time is as good as one with it."""
    parts = {
        "controller": PI(kp=0.8, ti=2.0, sample_time=0.5, discretisation="forward"), "gain": Gain(gain=0.5),
        "valve": epp.Saturation(lower=-0.5, upper=0.5),
        "plant": TransferFunction(num=[0.3], den=[1.0, -0.7], sample_time=0.5, start=[1.0]),
    }  # fmt: skip
    connect = ["demand - plant -> controller", "controller -> gain", "gain -> valve", "valve -> plant"]
    loop = epp.Diagram(parts=parts, connect=connect, inputs=["demand"]).to_system()
    assert loop.time_step == 0.5
    y, total, expected = 0.3, 0.0, []
    for _ in range(40):
        expected.append(y)
        u = float(np.clip(0.5 * (0.8 * (2.0 - y) + total), -0.5, 0.5))
        total += 0.4 * 0.5 * (2.0 - y)
        y = 0.7 * y + 0.3 * u
    run = epp.simulate(loop, epp.inputs.Constant(2.0), t_end=19.5)
    np.testing.assert_allclose(run.signals["plant"][:40], expected, atol=1e-12)


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: PI(kp=1.0, sample_time=0.1, delay=0.05), "computation_delay, or a dead_time"),
        (lambda: StateSpaceBlock(A=[[0.0]], B=[[1.0]], C=[[1.0]], input_names=["a", "b"]), "1 names"),
        (lambda: StateSpaceBlock(A=[[0.0]], B=[[1.0]], C=[[1.0]], state_names=["a", "b"]), "1 names"),
        (lambda: TransferFunction(num="Kp", den=[1.0]), "a list of numbers"),
        (lambda: Gain(gain="Kp"), "a finite number"),
        (lambda: epp.Diagram(**_ring(principal="plant")), "an element: one of valve"),
        (lambda: epp.Diagram(**_ring(parts={"valve": epp.Saturation(lower=-1.0, upper=1.0),
                                            "plant": Integrator(start=[1.0, 2.0])})).to_system(), "1 number, one"),
    ],
)  # fmt: skip
def test_what_does_not_fit_a_block_is_refused(make, sentence):
    with pytest.raises(epp.ModelError, match=sentence):
        make()


def test_elements_and_signals_that_are_made_up_have_names_of_their_own():
    """One for a dead time, one for two blocks that are sampled together, and the signal of a port."""
    saturation, plant = epp.Saturation(lower=-1.0, upper=1.0), TransferFunction(num=[1.0], den=[1.0, 1.0], delay=0.1)
    sampled = Gain(gain=2.0, sample_time=0.1)
    parts = {
        "a": sampled,
        "b": sampled,
        "a_b": saturation,
        "gain": Gain(),
        "plant": plant,
        "plant_in_delay": saturation,
    }
    connect = ["-plant -> a", "a -> b", "b -> a_b", "a_b -> plant_in_delay", "plant_in_delay -> gain", "gain -> plant"]
    loop = epp.Diagram(parts=parts, connect=connect, signals={"force": "gain"}).to_system()
    assert set(loop.element_names) == {"a_b", "plant_in_delay", "a_b_2", "plant_in_delay_2"}
    two = StateSpaceBlock(A=[[-1.0]], B=[[1.0]], C=[[1.0], [2.0]], output_names=["force", "way"])
    parts = {"a": two, "a_force": saturation}
    loop = epp.Diagram(parts=parts, connect=["-a.force -> a_force", "a_force -> a"]).to_system()
    assert loop.signals.names == ("a.force", "a_way", "a_force", "a_force_in")
    np.testing.assert_array_equal(loop.signals.C[:3, 0], [1.0, 2.0, 0.0])


def test_matrices_may_be_arrays_of_whole_numbers_and_states_have_names():
    block = StateSpaceBlock(
        A=-np.eye(2, dtype=int), B=np.ones((2, 1), int), C=np.eye(2, dtype=int), state_names=["a", "b"]
    )
    parts = {"valve": epp.Saturation(lower=-1.0, upper=1.0), "plant": block}
    loop = epp.Diagram(parts=parts, connect=["-plant.out1 - plant.out2 -> valve", "valve -> plant"]).to_system()
    assert loop.state_names == ("a", "b")


def test_dead_time_straight_on_an_element_is_refused():
    parts = {
        "relay": epp.HysteresisRelay(lower=-0.1, upper=0.1), "gain": Gain(gain=2.0, delay=0.1),
        "valve": epp.Saturation(lower=-1.0, upper=1.0), "plant": Integrator(),
    }  # fmt: skip
    connect = ["-plant -> relay", "relay -> gain", "gain - plant -> valve", "valve -> plant"]
    with pytest.raises(epp.ModelError, match="dead time of gain acts straight on valve; .* between gain and valve"):
        epp.Diagram(parts=parts, connect=connect).to_system()


@pytest.mark.parametrize("signals", [{"level": "tank"}, {"level": "tank", "drive": "valve"}])
def test_signals_that_hold_a_dead_time_in_place_are_named_and_without_them_it_may_stand(signals):
    lag = epp.blocks.TransferFunction(num=[1.0], den=[1.0, 1.0])
    parts = {"valve": epp.HysteresisRelay(lower=-0.1, upper=0.1), "tank": lag, "pipe": epp.blocks.DeadTime(delay=0.2)}
    drawn = {"parts": parts, "connect": ["goal - pipe -> valve", "valve -> tank", "tank -> pipe"], "inputs": ["goal"]}
    with pytest.raises(epp.ModelError, match="level is 'tank'; expected no signal level, .* between pipe and valve"):
        epp.Diagram(**drawn, signals=signals, units={"level": "m"}).to_system()
    named = {name: of for name, of in signals.items() if name != "level"}
    assert epp.Diagram(**drawn, signals=named).to_system().delays.tolist() == [0.2]


def test_signals_are_those_of_all_ports_and_those_that_are_named():
    diagram = epp.Diagram(**_ring(signals={"error": "demand - plant"}, units={"error": "rad"}))
    loop = diagram.to_system()
    assert loop.signals.names == ("error", "valve", "plant", "demand", "valve_in")
    run = epp.simulate(loop, t_end=2.0, input=epp.inputs.Step(0.5))
    np.testing.assert_allclose(run.signals["error"], run.signals["demand"] - run.signals["plant"], atol=1e-12)
    np.testing.assert_allclose(run.signals["plant"], 0.25 * (1 - np.exp(-2 * run.t)), atol=1e-9)


def test_a_controller_and_a_plant_make_the_loop_that_control_makes():
    controller = PI(kp=2.0, ti=0.5)
    plant = TransferFunction(num=[3.0], den=[1.0, 2.0, 0.0])
    parts = {"controller": controller, "valve": epp.Saturation(lower=-1.0, upper=1.0), "plant": plant}
    connect = ["-plant -> controller", "controller -> valve", "valve -> plant"]
    loop = epp.Diagram(parts=parts, connect=connect).to_system()
    expected = -(control.tf([3.0], [1.0, 2.0, 0.0]) * control.tf([2.0, 4.0], [1.0, 0.0]))(1j * OMEGA)
    np.testing.assert_allclose(loop.frequency_response(OMEGA)[:, 0, 0], expected, rtol=1e-12)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), slope=st.floats(-1.0, 1.0))
def test_every_port_is_a_place_to_cut_with_the_return_ratio_of_its_equations(seed, slope):
    """With u = y + d at a port and everything closed, u/d is the sensitivity, which the cut has to give too."""
    blocks, wires = _random_diagram(seed)
    try:
        loop = _diagram(blocks, wires).to_system()
    except epp.ModelError:
        return
    cuts = loop.places
    K = np.array([[slope]])
    for k, name in enumerate(cuts.names):
        part, port = name.split(".")
        opened = _opened(loop, cuts, k, K)
        expected = _return_ratio(blocks, wires, (part, port), slope)
        if opened is None or expected is None:
            continue
        np.testing.assert_allclose(opened, expected, atol=1e-7 * (1.0 + np.abs(expected).max()), err_msg=name)


def _opened(loop, cuts, k, K):
    """Response from u to y with the loop cut at place k and the element as a gain."""
    n = len(loop.A)
    b, e, c, dw, f = cuts.B[:, [k]], cuts.E[:, [k]], cuts.C[[k]], cuts.D[[k]], cuts.F[k]
    inverse = np.linalg.inv(np.eye(1) - loop.D @ K)
    z_x, z_d = inverse @ loop.C, inverse @ e
    A, B = loop.A + loop.B @ K @ z_x, b + loop.B @ K @ z_d
    C, D = c + dw @ K @ z_x, f + dw @ K @ z_d
    if abs(1.0 + D[0, 0]) < 1e-6:
        return None
    closed = np.array([(C @ np.linalg.solve(1j * w * np.eye(n) - A, B) + D)[0, 0] for w in OMEGA])
    return closed / (1.0 + closed)


def _return_ratio(blocks, wires, place, slope):
    """The same from the equations of all ports, in which the place's consumers see an independent u."""
    targets = list(wires)
    outputs = [f"{name}.{port}" for name, block in blocks.items() for port in block.outputs] + ["valve.out"]
    name = ".".join(place)
    found = []
    for omega in OMEGA:
        G = np.zeros((len(outputs), len(targets)), complex)
        G[-1, targets.index("valve.in")] = slope
        for block_name, block in blocks.items():
            A, B, C, D = (np.atleast_2d(m) for m in (block.A, block.B, block.C, block.D))
            response = C @ np.linalg.solve(1j * omega * np.eye(len(A)) - A, B) + D
            rows = [outputs.index(f"{block_name}.{port}") for port in block.outputs]
            G[np.ix_(rows, [targets.index(f"{block_name}.{port}") for port in block.inputs])] = response
        W = np.zeros((len(targets), len(outputs)))
        for i, terms in enumerate(wires.values()):
            for sign, source in terms:
                source = "valve.out" if source == "valve" else source
                if source in outputs:
                    W[i, outputs.index(source)] += sign
        opened, given = (W.copy(), np.zeros(len(targets))) if name in outputs else (W, np.zeros(len(targets)))
        if name in outputs:
            given = opened[:, outputs.index(name)].copy()
            opened[:, outputs.index(name)] = 0.0
            M = np.eye(len(targets)) - opened @ G
            if np.linalg.cond(M) > 1e8:
                return None
            found.append((G @ np.linalg.solve(M, given))[outputs.index(name)])
            continue
        i = targets.index(name)
        opened, given[i] = W @ G, 1.0
        row = opened[i].copy()
        opened[i] = 0.0
        M = np.eye(len(targets)) - opened
        if np.linalg.cond(M) > 1e8:
            return None
        found.append(row @ np.linalg.solve(M, given))
    return np.array(found)


def _with_dead_times(blocks, wires, seed):
    """Some of the blocks late, and dead times that stand alone, behind blocks and in front of the valve."""
    rng = np.random.default_rng(seed)
    late = {name: replace(block, delay=0.2 * int(rng.integers(0, 3))) for name, block in blocks.items()}
    wires = dict(wires)
    for i, target in enumerate(list(wires)):
        if rng.random() < 0.4:
            late[f"wait{i}"] = DeadTime(delay=0.3)
            wires |= {f"wait{i}.in": wires[target], target: [(int(rng.choice([-1, 1])), f"wait{i}.out")]}
    return late, wires


def _response_of_loop(loop, slope, omega, entry=None):
    """Signals and the given place over the demand, or over a disturbance at that place, in the closed linear loop."""
    cuts, n = loop.places, len(loop.A)
    K = np.diag([slope if name == "valve" else 1.0 for name in loop.element_names])
    resolvent = np.linalg.inv(1j * omega * np.eye(n) - loop.A)
    x_w = resolvent @ (loop.B * np.exp(-1j * omega * loop.delays))
    if entry is None:
        x_d, straight = resolvent @ loop.B_input[:, 0], loop.D_input[:, 0]
    else:
        x_d = resolvent @ cuts.B[:, entry] * np.exp(-1j * omega * cuts.delays[entry])
        straight = cuts.E[:, entry]
    w = K @ np.linalg.solve(np.eye(len(K)) - (loop.C @ x_w + loop.D) @ K, loop.C @ x_d + straight)
    if entry is not None:
        return cuts.C[entry] @ (x_w @ w + x_d) + cuts.D[entry] @ w + cuts.F[entry]
    return loop.signals.C @ (x_w @ w + x_d) + loop.signals.D @ w + loop.signals.D_input[:, 0]


def _response_of_ports(blocks, wires, slope, omega, place=None):
    """The same from the equations of all ports: outputs over the demand, or a place over a disturbance there."""
    targets = list(wires)
    outputs = [f"{name}.{port}" for name, block in blocks.items() for port in block.outputs] + ["valve.out"]
    G = np.zeros((len(outputs), len(targets)), complex)
    G[-1, targets.index("valve.in")] = slope
    for name, block in blocks.items():
        s = block.state_space()
        response = s.C @ np.linalg.solve(1j * omega * np.eye(len(s.A)) - s.A, s.B) + s.D
        rows = [outputs.index(f"{name}.{port}") for port in block.outputs]
        columns = [targets.index(f"{name}.{port}") for port in block.inputs]
        G[np.ix_(rows, columns)] = response * np.exp(-1j * omega * block.delay)
    W, given = np.zeros((len(targets), len(outputs))), np.zeros(len(targets))
    for i, terms in enumerate(wires.values()):
        for sign, source in terms:
            if source == "demand":
                given[i] += sign if place is None else 0.0
            else:
                W[i, outputs.index("valve.out" if source == "valve" else source)] += sign
    if place is not None:
        given = W[:, outputs.index(place)] if place in outputs else np.eye(len(targets))[targets.index(place)]
    M = np.eye(len(targets)) - W @ G
    u = np.linalg.solve(M, given.astype(complex))
    y = G @ u
    if place is None:
        return dict(zip(outputs, y, strict=True)), np.linalg.cond(M)
    return (y[outputs.index(place)] if place in outputs else u[targets.index(place)] - 1.0), np.linalg.cond(M)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), slope=st.floats(-1.0, 1.0))
def test_dead_times_anywhere_solve_the_equations_of_all_ports(seed, slope):
    """Every signal that is shown, and the sensitivity at every place that there is."""
    blocks, wires = _with_dead_times(*_random_diagram(seed), seed)
    try:
        loop = _diagram(blocks, wires).to_system()
    except epp.ModelError as error:
        assert "algebraic loop" in str(error) or "dead time" in str(error)
        return
    called = {f"{name}.{port}" if len(block.outputs) > 1 else name: f"{name}.{port}"
              for name, block in blocks.items() for port in block.outputs} | {"valve": "valve.out"}  # fmt: skip
    for omega in (0.3, 2.0, 9.0):
        expected, cond = _response_of_ports(blocks, wires, slope, omega)
        if cond > 1e8:
            return
        size = 1.0 + max(abs(value) for value in expected.values())
        for name, found in zip(loop.signals.names, _response_of_loop(loop, slope, omega), strict=True):
            port = called.get(name, called.get(name.replace("_", ".", 1)))
            if port is not None:
                assert found == pytest.approx(expected[port], abs=1e-8 * size), name
        for k, name in enumerate(loop.places.names):
            if name.partition(".")[0] in {*blocks, "valve"}:
                value, _ = _response_of_ports(blocks, wires, slope, omega, name)
                assert _response_of_loop(loop, slope, omega, k) == pytest.approx(value, abs=1e-8 * (1 + abs(value))), (
                    name
                )


def _two_blocks_at_one_rate(order):
    parts = {
        "filter": TransferFunction(num=[0.3, 0.0], den=[1.0, -0.7], sample_time=0.1),
        "controller": PI(kp=0.8, ti=1.0, sample_time=0.1, discretisation="forward"),
        "valve": epp.Saturation(lower=-0.5, upper=0.5),
        "plant": TransferFunction(num=[1.0], den=[1.0, 1.0], start=[0.0]),
    }
    connect = ["demand - filter -> controller", "controller -> valve", "valve -> plant", "plant -> filter"]
    return epp.Diagram(parts={name: parts[name] for name in order}, connect=connect, inputs=["demand"]).to_system()


@pytest.mark.parametrize(
    "order", [("filter", "controller", "valve", "plant"), ("plant", "valve", "controller", "filter")]
)
def test_blocks_of_one_rate_act_on_one_another_within_a_sample(order):
    """Against the recursion by hand, with the plant's own exact step."""
    step, pole = 0.1, float(np.exp(-0.1))
    y = filtered = total = 0.0
    expected = []
    for _ in range(60):
        expected.append(y)
        filtered = 0.7 * filtered + 0.3 * y
        error = 1.0 - filtered
        u = float(np.clip(0.8 * error + total, -0.5, 0.5))
        total += 0.8 / 1.0 * step * error
        y = pole * y + (1 - pole) * u
    loop = _two_blocks_at_one_rate(order)
    run = epp.simulate(loop, epp.inputs.Constant(1.0), t_eval=0.1 * np.arange(60), t_end=5.95)
    np.testing.assert_allclose(run.signals["plant"], expected, atol=1e-12)


def test_analyses_take_a_diagram_as_they_take_its_loop():
    diagram = epp.Diagram(**_ring(inputs={"demand": 0.2}))
    loop = diagram.to_system()
    times = np.linspace(0.0, 2.0, 21)
    one, other = (epp.simulate(given, t_end=2.0, t_eval=times) for given in (diagram, loop))
    assert np.array_equal(one.signals["plant"], other.signals["plant"])
    assert one.operating_point.inputs == {"demand": 0.2} == diagram.operating_point.inputs
    assert epp.margins(diagram).numbers() == epp.margins(loop).numbers()
    assert epp.predict_limit_cycles(diagram).cycles == ()
    with pytest.raises(epp.EppError, match=r"valve\.upper"):
        epp.continue_branch(diagram, "valve.uper", 1.0, 2.0)


def test_a_state_that_a_port_puts_out_has_its_name_and_its_unit():
    """No other has: the states of a transfer function are no signals, nor is a state its double."""
    loop = epp.case("robot_servo").to_system()
    assert loop.state_names == ("motor_angle", "motor_speed", "arm_angle", "arm_speed")
    assert [loop.signals.unit_of(x=row) for row in np.eye(4)] == ["rad", "rad/s"] * 2
    assert loop.signals.unit_of(v=np.ones(1)) == "rad" and loop.signals.unit_of(v=np.ones(1), one=1.0) == ""
    doubled = replace(loop.signals, C=2.0 * loop.signals.C)
    assert [doubled.unit_of(x=row) for row in np.eye(4)] == [""] * 4
    aircraft = epp.case("x15_flare").to_system()
    assert aircraft.state_names[1:] == ("pitch_1", "pitch_2", "pitch_3", "pitch_4")
    assert [aircraft.signals.unit_of(x=row) for row in np.eye(5)[1:]] == [""] * 4


def test_sentences_speak_of_a_signal_that_moves_wherever_constants_are_drawn() -> None:
    parts = {
        "setpoint": epp.blocks.Constant(value=5.0),
        "heater": epp.HysteresisRelay(-0.5, 0.5, 0.0, 10.0),
        "room": epp.blocks.TransferFunction(num=[1.0], den=[3.0, 1.0]),
    }
    loop = epp.Diagram(parts, ["setpoint - room -> heater", "heater -> room"]).to_system()
    assert loop.signals.names == ("heater", "room", "heater_in", "setpoint")
    assert str(epp.simulate(loop, t_end=50.0)).startswith("Oscillates: heater 10 peak to peak")


@pytest.mark.parametrize("made", [epp.blocks.PI, epp.blocks.PID])
def test_integral_part_with_an_input_of_its_own_is_the_sum_of_both_parts(made):
    given = {"kp": 2.0, "ti": 0.5} | ({"td": 0.3, "tf": 0.1} if made is epp.blocks.PID else {})
    parted = made(**given, integral_input="integral")
    assert parted.inputs == ("in", "integral") and made(**given).inputs == ("in",)
    s = 2.0j
    of = [
        b.C @ np.linalg.solve(s * np.eye(len(b.A)) - b.A, b.B) + b.D
        for b in (m.state_space() for m in (parted, made(**given)))
    ]
    assert of[0][0, 1] == pytest.approx(2.0 / 0.5 / s)
    assert of[0].sum() == pytest.approx(of[1][0, 0])
