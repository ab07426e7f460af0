"""Sampled controllers: runs against the exact zero-order-hold map, delays, rates that coincide, refusals."""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings, strategies as st

import eppanalysis as epp
from eppanalysis.models.elements import ControllerMemory

RNG = np.random.default_rng


def held_map(A: np.ndarray, B: np.ndarray, time: float) -> tuple[np.ndarray, np.ndarray]:
    """Exact map of a linear plant over a time with its inputs held."""
    n, m = B.shape
    M = np.zeros((n + m, n + m))
    M[:n, :n], M[:n, n:] = A, B
    E = scipy.linalg.expm(M * time)
    return E[:n, :n], E[:n, n:]


def by_hand(A, B, C, controller, x, n_samples):
    """Outputs of the plant at the samples of a controller with its delay, by the exact map."""
    K = [np.atleast_2d(np.asarray(getattr(controller, k), float)) for k in "ABCD"]
    T, tau = controller.sample_time, controller.delay
    first, second = held_map(A, B, tau), held_map(A, B, T - tau)
    state, old, out = np.asarray(controller.x0, float), np.zeros(B.shape[1]), []
    for _ in range(n_samples):
        u = C @ x
        out.append(u)
        y = K[2] @ state + K[3] @ u
        state = K[0] @ state + K[1] @ u
        x = second[0] @ (first[0] @ x + first[1] @ old) + second[1] @ y
        old = y
    return np.array(out)


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    sizes=st.tuples(*[st.integers(1, 3)] * 4),
    late=st.sampled_from([0.0, 0.25, 0.613, 1.0]),
)
def test_a_linear_loop_is_the_exact_map_from_sample_to_sample(seed, sizes, late) -> None:
    rng, (n, k, m, p) = RNG(seed), sizes
    A = rng.normal(size=(n, n)) - 2.0 * np.eye(n)
    B, C = rng.normal(size=(n, p)), rng.normal(size=(m, n))
    Ad = rng.normal(size=(k, k)) * 0.4
    T = float(rng.uniform(0.02, 0.3))
    controller = epp.SampledController(
        Ad, rng.normal(size=(k, m)), rng.normal(size=(p, k)), 0.3 * rng.normal(size=(p, m)), T, late * T,
        x0=rng.normal(size=k),
    )  # fmt: skip
    x0 = rng.normal(size=n)
    loop = epp.LureSystem.build(A, B, C, [controller], x0=x0, element_names=["controller"])
    expected = by_hand(A, B, C, controller, x0, 60)
    run = epp.simulate(loop, t_end=59 * T, t_eval=T * np.arange(60) * (1 - 1e-16))
    size = np.abs(expected).max()
    np.testing.assert_allclose(run.signals["controller_input"], expected[:, 0], atol=1e-11 * size, rtol=0)


def test_a_nonlinear_plant_agrees_with_an_integrator_sample_by_sample() -> None:
    from scipy.integrate import solve_ivp

    T, state, x, held = 0.05, 0.0, np.array([1.0, 0.0]), 0.0
    law = epp.SampledController([[1.0]], [[0.02]], [[1.0]], [[1.5]], T, delay=0.02)
    loop = epp.LureSystem.build(
        [[0.0, 1.0], [0.0, -0.4]], [[0.0, 0.0], [-1.0, -1.0]], [[1.0, 0.0], [1.0, 0.0]], [epp.Cube(1.0), law],
        x0=x, element_names=["spring", "law"],
    )  # fmt: skip
    times, expected = T * np.arange(101), []

    def rate(_, x, u):
        return [x[1], -0.4 * x[1] - x[0] ** 3 - u]

    for _ in times:
        expected.append(x[0])
        y, new = state + 1.5 * x[0], state + 0.02 * x[0]
        for u, span in ((held, 0.02), (y, 0.03)):
            x = solve_ivp(rate, (0.0, span), x, args=(u,), rtol=1e-12, atol=1e-13).y[:, -1]
        state, held = new, y
    run = epp.simulate(loop, t_end=float(times[-1]), t_eval=times)
    np.testing.assert_allclose(run.signals["law_input"], expected, atol=1e-10, rtol=0)


def test_the_first_sample_comes_at_its_offset_and_what_was_held_before_is_y0() -> None:
    law = epp.SampledController([], [], [], [[-1.0]], 0.5, delay=0.1, offset=0.2, y0=[3.0])
    loop = epp.LureSystem.build([[0.0]], [[1.0]], [[1.0]], [law], x0=[1.0], element_names=["law"])
    run = epp.simulate(loop, t_end=1.0, t_eval=[0.0, 0.2, 0.299, 0.301, 0.7, 0.799, 0.801])
    first = 1.0 + 0.2 * 3.0
    second = first + 0.1 * 3.0 - 0.4 * first
    np.testing.assert_allclose(run.signals["law_output"], [3.0, 3.0, 3.0, -first, -first, -first, -second], rtol=1e-13)
    assert run.events == ()  # samples are no switches


@pytest.mark.slow
def test_samples_do_not_drift_in_a_million() -> None:
    T = 0.001  # no binary fraction
    counter = epp.SampledController([[1.0]], [[1.0]], [[1.0]], [[0.0]], T)
    loop = epp.LureSystem.build(
        [[0.0, 1.0], [-1.0, 0.0]], [[0.0], [0.0]], [[1.0, 0.0]], [counter], x0=[1.0, 0.0], element_names=["sum"]
    )
    run = epp.simulate(loop, t_end=1000.0, t_eval=[1000.0 - 0.5 * T])
    t = T * np.arange(999_999)
    # A sum of a million samples of a cosine: 1e-9 s beside the right instant in the mean would be seen.
    assert run.n_events == 1_000_000
    assert run.signals["sum_output"][0] == pytest.approx(math.fsum(np.cos(t)), abs=2e-7)


def test_rates_that_coincide_run_along_the_signal_whatever_the_order_of_the_elements() -> None:
    A, C = np.array([[-0.3]]), np.array([[1.0], [0.0]])
    outer = epp.SampledController([[1.0]], [[0.1]], [[1.0]], [[2.0]], 0.3)
    inner = epp.SampledController([], [], [], [[0.7]], 0.1)
    D = np.array([[0.0, 0.0], [1.0, 0.0]])
    B = np.array([[0.0, -1.0]])
    run = {}
    for order in ([0, 1], [1, 0]):
        loop = epp.LureSystem.build(
            A, B[:, order], C[order], [[outer, inner][i] for i in order], D=D[np.ix_(order, order)], x0=[1.0],
            element_names=[["outer", "inner"][i] for i in order],
        )  # fmt: skip
        run[order[0]] = epp.simulate(loop, t_end=60.0, t_eval=0.1 * np.arange(600)).signals["outer_input"]
    x, state, y, expected = 1.0, 0.0, 0.0, []
    E, F = held_map(A, np.ones((1, 1)), 0.1)
    for k in range(600):
        expected.append(x)
        if k % 3 == 0:
            y, state = state + 2.0 * x, state + 0.1 * x
        x = float(E[0, 0] * x - F[0, 0] * 0.7 * y)
    np.testing.assert_allclose(run[0], expected, atol=1e-12)
    np.testing.assert_allclose(run[0], run[1], atol=1e-14)


@pytest.mark.parametrize("place", [[0, 1], [1, 0]])
def test_an_integrator_that_is_renewed_last_stops_where_the_output_saturates(place) -> None:
    Kp, Ki, Kaw, T, limit = 2.0, 0.3, 0.4, 0.1, 0.5
    # inputs: error, saturated output; outputs: command
    law = epp.SampledController([[1.0 - Kaw]], [[Ki * T - Kaw * Kp, Kaw]], [[1.0]], [[Kp, 0.0]], T, state_last=True)
    clip = epp.Saturation(-limit, limit)
    parts = [("law", law, [[-1.0], [0.0]]), ("clip", clip, [[0.0]])]
    names, elements, rows = zip(*(parts[i] for i in place), strict=True)
    inputs_of = [name for name, _, _ in (parts[i] for i in place) for _ in range(2 if name == "law" else 1)]
    D, at = np.zeros((3, 2)), inputs_of.index("law")
    D[at + 1, names.index("clip")] = 1.0
    D[inputs_of.index("clip"), names.index("law")] = 1.0
    B = np.zeros((1, 2))
    B[0, names.index("clip")] = 1.0
    loop = epp.LureSystem.build([[-0.2]], B, np.vstack(rows), elements, D=D, x0=[-3.0], element_names=names)
    E, F = held_map(np.array([[-0.2]]), np.ones((1, 1)), T)
    x, state, expected = -3.0, 0.0, []
    for _ in range(150):
        y = state + Kp * -x
        u = min(max(y, -limit), limit)
        expected.append(y)
        state = state + Ki * T * -x + Kaw * (u - y)
        x = float(E[0, 0] * x + F[0, 0] * u)
    run = epp.simulate(loop, t_end=15.0, t_eval=T * np.arange(150) + 0.5 * T)
    np.testing.assert_allclose(run.signals["law_output"], expected, atol=1e-12)
    assert max(expected) > 2.0 * limit


def test_a_run_goes_on_from_what_the_controller_remembers() -> None:
    law = epp.SampledController([[0.9]], [[0.2]], [[1.0]], [[0.5]], 0.1, delay=0.03)
    memory = ControllerMemory((0.4,), (0.7,), 0.08, (0.9,), 0.01)
    loop = epp.LureSystem.build([[-1.0]], [[-1.0]], [[1.0]], [law], x0=[1.0], memory=[memory], element_names=["law"])
    run = epp.simulate(loop, t_end=0.2, t_eval=[0.005, 0.05, 0.1, 0.12, 0.15])
    x = 1.0
    for u, span in ((0.7, 0.01), (0.9, 0.07)):
        E, F = held_map(np.array([[-1.0]]), np.ones((1, 1)), span)
        x = float(E[0, 0] * x - F[0, 0] * u)
    y = 0.4 + 0.5 * x
    np.testing.assert_allclose(run.signals["law_output"], [0.7, 0.9, 0.9, y, y], rtol=1e-13)


def test_its_map_in_time_is_that_of_its_automaton() -> None:
    law = epp.SampledController([[0.9]], [[0.2, 0.0]], [[1.0]], [[0.5, 1.0]], 0.1, delay=0.03)
    w, memory = law.output([1.0, 2.0, 0.0])
    assert (w, memory.computed, memory.ready) == (0.0, (2.5,), 0.03)
    w, memory = law.output([1.0, 2.0, 0.05], memory)
    assert w == 2.5 and memory.due == 0.1


def test_the_response_is_that_of_the_first_harmonic_of_a_run() -> None:
    law = epp.SampledController([[0.8]], [[1.0]], [[0.3]], [[0.5]], 0.1, delay=0.04)
    omega = 2.0 * np.pi / 3.7 / math.sqrt(2.0)  # so that the samples come at all phases of the sine
    loop = epp.LureSystem.build(
        [[-1.0]], [[0.0]], [[0.0]], [law], D_input=[[1.0]], input_names=["u"], element_names=["law"]
    )
    t = np.arange(0.0, 2000.0, 0.0137)
    run = epp.simulate(loop, epp.inputs.Sine(1.0, omega / (2.0 * np.pi)), t_end=2000.0, t_eval=t)
    late = t > 20.0
    basis = np.column_stack([np.sin(omega * t[late]), np.cos(omega * t[late])])
    b, a = np.linalg.lstsq(basis, run.signals["law_output"][late], rcond=None)[0]
    assert complex(b, a) == pytest.approx(complex(law.response(omega)[0, 0]), rel=2e-3)
    mean, gain = law.describing_function(1.0, 2.0, omega)
    assert gain == pytest.approx(law.response(omega)[0, 0]) and mean == pytest.approx(2.0 * (0.3 / 0.2 + 0.5))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"sample_time": 0.0}, "sample_time"),
        ({"sample_time": math.nan}, "sample_time"),
        ({"delay": 0.11}, "delay"),
        ({"delay": -0.1}, "delay"),
        ({"offset": -1.0}, "offset"),
        ({"D": [[1.0, 2.0]]}, "B has shape"),
        ({"A": [[1.0, 0.0]]}, "A has shape"),
        ({"C": [[math.nan]]}, "C has shape"),
        ({"x0": [1.0, 2.0]}, "x0"),
        ({"state_last": True, "delay": 0.05}, "dead time of the loop"),
    ],
)
def test_what_does_not_fit_is_refused(change, message) -> None:
    given = {"A": [[1.0]], "B": [[1.0]], "C": [[1.0]], "D": [[1.0]], "sample_time": 0.1}
    with pytest.raises(epp.ModelError, match=message):
        epp.SampledController(**given | change)


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(st.integers(1, 40), st.integers(1, 40)), min_size=1, max_size=4), st.floats(1e-4, 10.0))
def test_commensurate_controllers_count_in_one_tick(ratios, unit) -> None:
    laws = [epp.SampledController([], [], [], [[1.0]], unit * a / b) for a, b in ratios]
    loop = epp.LureSystem.build([[0.0]], np.ones((1, len(laws))), np.ones((len(laws), 1)), laws)
    counts = [e.counted(e.sample_time) for e in loop.elements]
    assert len({e.unit for e in loop.elements}) == 1 and all(c == round(c) >= 1 for c in counts)
    assert loop.A.shape == (2, 2)  # one clock for all
    np.testing.assert_allclose(np.array(counts) * loop.elements[0].unit, [e.sample_time for e in laws], rtol=1e-12)
