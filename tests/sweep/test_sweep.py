"""Sweeps: every cell equals a run of its own, to the last bit whatever the scheduler and the chunks."""

from __future__ import annotations

import json

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.errors import EppError
from eppanalysis.methods.batch import HybridStack, simulate_batch
from eppanalysis.results import Status
from eppanalysis.sweep import LatinHypercube, Sobol, sweep
from eppanalysis.sweep.axes import make_design
from eppanalysis.sweep.cells import Builder, hybrid_of, make_builder
from eppanalysis.sweep.verbs import FAILED, STATUS_CODE, STATUS_NAMES

CASE = epp.case("fig8a_original")
AXES = {"bands.range": "1:5:4:lbf", "lock_pin.backlash": "0:3:9:deg"}
SHORT = CASE.with_values({"run.t_end": "0.6 s"})


def status_of(dataset) -> list[str]:
    return [STATUS_NAMES[int(code)] for code in dataset["status"].values.ravel()]


@pytest.fixture(scope="module")
def found():
    return sweep(CASE, AXES, progress=False)


def test_cells_equal_single_runs(found) -> None:
    for i, j in ((0, 3), (0, 8), (1, 4), (3, 8)):
        values = {name: found[name].values[k] for name, k in zip(AXES, (i, j), strict=True)}
        case = CASE.with_values(values)
        run = epp.simulate(case.to_system(), case.input, 6.0, t_eval=[0.0])
        cell = found.isel({"bands.range": i, "lock_pin.backlash": j})
        assert int(cell["status"]) == STATUS_CODE[run.status]
        assert int(cell["outcome"]) == {Status.SETTLED: 1, Status.LIMIT_CYCLE: 2}[run.status]
        assert int(cell["events"]) == len(run.events)
        if run.limit_cycle is not None:
            assert float(cell["frequency"]) == pytest.approx(run.limit_cycle.frequency, rel=1e-9)
            assert float(cell["amplitude"]) == pytest.approx(run.limit_cycle.peak_to_peak["theta"] / 2, rel=1e-5)
            assert float(cell["mean"]) == pytest.approx(run.limit_cycle.mean["theta"], rel=1e-6)


def test_the_dataset_says_what_it_is(found) -> None:
    assert found["amplitude"].dims == tuple(AXES)
    assert found["amplitude"].attrs["units"] == "rad"
    assert found["frequency"].attrs["units"] == "Hz"
    assert found["bands.range"].attrs["units"] == "N"
    assert found["status"].attrs["flag_meanings"].split() == list(STATUS_NAMES)
    assert len(found["status"].attrs["flag_values"]) == len(STATUS_NAMES)
    assert json.loads(found["status"].attrs["sentences"])["settled"] == Status.SETTLED.value
    provenance = json.loads(found.attrs["provenance"])
    assert provenance["case"]["sha256"] == CASE.provenance()["sha256"]
    assert provenance["settings"]["t_end"] == 6.0


def test_cells_put_together_equal_cells_made_in_full() -> None:
    axes = {"pulley.friction": [0.0, 0.0526, 0.1], "lock_pin.backlash": "0:3:9:deg", "cable.stiffness": [1e3, 7e3, 5e3]}
    design = make_design(CASE, axes)
    builder = make_builder(CASE, design)
    assert builder.classes[0].tolist() == [0, 1, 1]  # without and with friction
    assert builder.parts
    places = np.indices(design.shape).reshape(3, -1).T
    joined, full = builder.stacks(places), Builder(CASE, design).stacks(places)
    assert joined[1] == full[1] == {}
    for (rows, stack), (other_rows, other) in zip(joined[0], full[0], strict=True):
        assert np.array_equal(rows, other_rows)
        for name, a, b in zip(stack.model._fields, stack.model, other.model, strict=True):
            assert a.tobytes() == b.tobytes(), name
        assert stack.x0.tobytes() == other.x0.tobytes()
        assert stack.time_scale.tobytes() == other.time_scale.tobytes()


@pytest.mark.parametrize(("workers", "chunk"), [(1, 1), (2, 5), (3, 1000)])
def test_threads_and_chunks_change_no_bit(found, workers, chunk) -> None:
    assert found.identical(sweep(CASE, AXES, workers=workers, chunk=chunk, progress=False))


def test_the_batch_kernel_gives_the_same_bits(found) -> None:
    design = make_design(CASE, AXES)
    cells = [hybrid_of(CASE.with_values(design.at(place))) for place in np.ndindex(design.shape)]
    result = simulate_batch(HybridStack.of(cells, CASE.to_system().signals.names), 6.0)
    assert found["frequency"].values.tobytes() == (1.0 / result.period).tobytes()
    assert found["amplitude"].values.tobytes() == (0.5 * result.peak_to_peak["theta"]).tobytes()


def test_failing_cells_are_statuses_with_a_sentence() -> None:
    axes = {"forearm.inertia": [0.0465, -1.0, 0.03], "lock_pin.backlash": "0:3:12:deg", "pulley.friction": [0.0, 0.05]}
    found = sweep(SHORT, axes, progress=False)
    wrong = found.isel({"forearm.inertia": 1})
    assert set(status_of(wrong)) == {"failed"}
    assert set(np.unique(wrong["message"].values.astype(object))) == {
        "sweep: forearm.inertia is -1.0; expected a positive number."
    }
    assert np.all(np.isnan(wrong["amplitude"].values))
    right = found.isel({"forearm.inertia": [0, 2]})
    assert FAILED not in right["status"].values
    alone = sweep(SHORT, axes | {"forearm.inertia": [0.0465, 0.03]}, progress=False)
    assert right["events"].equals(alone["events"])


def test_cells_that_fail_only_together_fail_alone() -> None:
    """The parking width must be below the range: neither axis is wrong by itself."""
    axes = {"bands.parking_width": "0.2:3:8:lbf", "bands.range": "1:4:7:lbf"}
    found = sweep(SHORT, axes, progress=False)
    width, reach = np.meshgrid(found["bands.parking_width"], found["bands.range"], indexing="ij")
    assert np.array_equal(found["status"].values == FAILED, width >= reach)


def test_predictions_beside_runs() -> None:
    axes = {"lock_pin.backlash": ["0.5 deg", "2.5 deg"]}
    found = sweep(CASE, axes, run=("simulate", "predict"), signals="all", progress=False)
    assert found["outcome"].values.tolist() == [1, 2]
    cell = found.isel({"lock_pin.backlash": 1})
    stable = [c for c in epp.predict_limit_cycles(CASE.to_system(), CASE.final_input()) if c.stable]
    assert float(cell["predicted_frequency"]) == pytest.approx(stable[-1].frequency, rel=1e-12)
    assert float(cell["predicted_amplitude_sensor_force"]) == pytest.approx(
        stable[-1].peak_to_peak["sensor_force"] / 2, rel=1e-12
    )
    assert float(cell["first_order_error_frequency"]) == pytest.approx(
        float(cell["predicted_frequency"] / cell["frequency"]) - 1.0
    )
    assert found["amplitude_sensor_force"].attrs["units"] == "N"
    assert np.isnan(found["first_order_error_amplitude"].values[0])


def test_exact_orbits() -> None:
    cases = [c for c in map(epp.case, epp.shipped_cases()) if c.kind == "loop" and c.parameters and c.expected.exact]
    case = next(c for c in cases if len(c.expected.exact) == 1 and not c.to_system().time_step)
    name = next(iter(case.parameters))
    found = sweep(case, {name: [case.value(name)]}, run="cycles", progress=False)
    assert found["exact_stable_cycles"].values.tolist() == [1]
    wanted = case.expected.exact[0].omega / (2 * np.pi)
    assert float(found["exact_frequency"][0]) == pytest.approx(wanted, rel=1e-6)


def test_samples_have_a_coordinate_for_every_parameter() -> None:
    found = sweep(SHORT, Sobol({"bands.range": "1:5:lbf", "pulley.friction": (0.0, 0.1)}, 8), chunk=3, progress=False)
    assert found["status"].dims == ("sample",)
    assert found["pulley.friction"].dims == ("sample",)
    other = sweep(SHORT, Sobol({"bands.range": "1:5:lbf", "pulley.friction": (0.0, 0.1)}, 8), chunk=8, progress=False)
    assert found.identical(other)


def test_one_cell() -> None:
    assert sweep(SHORT, {"lock_pin.backlash": "1 deg", "bands.range": "2 lbf"}, progress=False)["status"].shape == (
        1,
        1,
    )


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"run": "dance"}, "one or several of simulate, predict, cycles"),
        ({"run": ()}, "names no verb"),
        ({"signals": "wind"}, "there is no signal 'wind'"),
        ({"scheduler": "magic"}, "address of a Dask scheduler"),
        ({"scheduler": "tcp://127.0.0.1:9"}, "no Dask scheduler answers"),
        ({"workers": 0}, "workers is 0"),
        ({"chunk": 0}, "chunk is 0"),
    ],
)
def test_what_is_wrong_is_one_sentence(arguments, words) -> None:
    import dask
    import distributed  # its settings must be there before one of them is changed

    assert distributed.__version__
    with dask.config.set({"distributed.comm.timeouts.connect": "1s"}), pytest.raises(EppError, match=words):
        sweep(SHORT, LatinHypercube({"bands.range": "1:5:lbf"}, 2), progress=False, **arguments)
