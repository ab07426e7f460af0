"""Sweeps: every cell equals a run of its own, to the last bit whatever the scheduler and the chunks."""

from __future__ import annotations

import json

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.errors import EppError
from eppanalysis.methods.simulation.batch import HybridStack, simulate_batch
from eppanalysis.results import Status
from eppanalysis.sweep import LatinHypercube, Sobol, schedule, sweep
from eppanalysis.sweep.analyses import FAILED, STATUS_CODE, STATUS_NAMES
from eppanalysis.sweep.axes import make_design
from eppanalysis.sweep.cells import Builder, hybrid_of, make_builder

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
            assert float(cell["peak_to_peak"]) == pytest.approx(run.limit_cycle.peak_to_peak["theta"], rel=1e-5)
            assert float(cell["mean"]) == pytest.approx(run.limit_cycle.mean["theta"], rel=1e-6)


def test_the_dataset_says_what_it_is(found) -> None:
    assert found["peak_to_peak"].dims == tuple(AXES)
    assert found["peak_to_peak"].attrs["units"] == "rad"
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
    assert found["peak_to_peak"].values.tobytes() == result.peak_to_peak["theta"].tobytes()


def test_failing_cells_are_statuses_with_a_sentence() -> None:
    axes = {"forearm.inertia": [0.0465, -1.0, 0.03], "lock_pin.backlash": "0:3:12:deg", "pulley.friction": [0.0, 0.05]}
    found = sweep(SHORT, axes, progress=False)
    wrong = found.isel({"forearm.inertia": 1})
    assert set(status_of(wrong)) == {"failed"}
    assert set(np.unique(wrong["message"].values.astype(object))) == {
        "sweep: forearm.inertia is '-1 kg*m^2'; expected a positive number."
    }
    assert np.all(np.isnan(wrong["peak_to_peak"].values))
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
    stable = [c for c in epp.predict_limit_cycles(CASE) if c.stable]
    assert float(cell["predicted_frequency"]) == pytest.approx(stable[-1].frequency, rel=1e-12)
    assert float(cell["predicted_peak_to_peak_sensor_force"]) == pytest.approx(
        stable[-1].peak_to_peak["sensor_force"], rel=1e-12
    )
    assert float(cell["first_order_error_frequency"]) == pytest.approx(
        float(cell["predicted_frequency"] / cell["frequency"]) - 1.0
    )
    assert found["peak_to_peak_sensor_force"].attrs["units"] == "N"
    assert np.isnan(found["first_order_error_peak_to_peak"].values[0])


RELAY = epp.case("relay_deadzone")


@pytest.fixture(scope="module")
def relays():
    return sweep(RELAY, {"relay_dead_zone.threshold": [1.0, 4.0]}, run="all", progress=False)


def test_every_analysis_says_what_its_own_call_says(relays) -> None:
    """The relay with dead zone 1 has a stable and an unstable cycle beside rest, that with dead zone 4 has none."""
    search = epp.find_limit_cycles(RELAY.to_system())
    (stable,) = search.stable
    assert relays["exact_outcome"].values.tolist() == [2, 1]
    assert relays["exact_stability"].values.tolist() == [2, 1]
    assert relays["exact_unstable_cycles"].values.tolist() == [1, 0]
    assert relays["exact_frequency"].values[0] == stable.frequency
    assert relays["exact_peak_to_peak"].values[0] == stable.peak_to_peak["x"]
    assert relays["exact_multiplier"].values[0] == pytest.approx(np.abs(stable.multipliers).max())
    assert 0 < relays["exact_multiplier"].values[0] < 1
    assert relays["predicted_outcome"].values.tolist() == [2, 1]
    for name in (
        "exact_frequency",
        "exact_multiplier",
        "predicted_frequency",
        "trigger",
        "first_order_error_frequency",
    ):
        assert np.isnan(relays[name].values[1]), name


def test_what_is_proved_of_cells_is_a_map_of_three_colours(monkeypatch) -> None:
    """The servo's cycles begin at a gain of 2.0776, and its frequency criterion ends at 0.83."""
    pytest.importorskip("flint")
    loop = epp.LureSystem.from_tf(([1.0], [0.2, 1.2, 1.0, 0.0]), epp.Play(gap=1.0))
    axes = {"loop.gain": [0.5, 1.5, 2.5], "play.gap": [2.0]}
    sectors = "eppanalysis.methods.certificates.play.find.find"
    monkeypatch.setattr(sectors, lambda *_: "no function was sought.")
    found = sweep(epp.Case.from_system(loop, name="servo"), axes, run="certify", progress=False)
    assert found["proved"].values.tolist() == [[1], [0], [2]]
    statuses = found["status"].attrs["flag_meanings"].split()
    assert [statuses[i] for i in found["status"].values[:, 0]] == ["converged", "incomplete", "converged"]
    shown = epp.plot_design_map(found).axes[0]
    words = [text.get_text() for text in shown.get_legend().get_texts()]
    assert words == ["undecided", "proved free", "proved to oscillate"]
    assert len({patch.get_facecolor() for patch in shown.get_legend().get_patches()}) == 3


def test_a_trigger_of_the_size_found_starts_the_cycle_and_a_smaller_one_does_not(relays) -> None:
    assert relays["trigger_outcome"].values.tolist() == [2, 1]
    trigger = float(relays["trigger"].values[0])
    assert trigger == min(relays["trigger_up"].values[0], relays["trigger_down"].values[0])
    for factor, outcome in ((0.999, 1), (1.001, 2)):
        case = RELAY.with_values({"loop.initial_state": [factor * trigger, 0.0, 0.0], "run.t_end": 300.0})
        found = sweep(case, {"relay_dead_zone.threshold": [1.0]}, progress=False)
        assert found["outcome"].values.tolist() == [outcome]


def test_a_trigger_of_the_elbow_is_a_step_of_its_harness() -> None:
    found = sweep(CASE, {"lock_pin.backlash": ["2.5 deg"]}, run="trigger", progress=False)
    assert found["trigger"].attrs["units"] == "m"
    trigger = float(found["trigger_up"].values[0])
    for factor, outcome in ((0.99, 1), (1.01, 2)):
        step = sweep(CASE, {"harness.step": [factor * trigger]}, progress=False)
        assert step["outcome"].values.tolist() == [outcome]


def test_first_order_is_judged_by_exact_cycles_where_there_is_no_run(relays) -> None:
    found = sweep(RELAY, {"relay_dead_zone.threshold": [1.0]}, run=("predict", "cycles"), progress=False)
    error = found["predicted_frequency"] / found["exact_frequency"] - 1.0
    assert float(found["first_order_error_frequency"][0]) == float(error[0])
    assert "exact cycle" in found["first_order_error_frequency"].attrs["long_name"]
    assert "the run" in relays["first_order_error_frequency"].attrs["long_name"]


def test_the_run_time_is_an_axis_too() -> None:
    axes = {"run.t_end": ["0.6 s", 6.0], "lock_pin.backlash": "0:3:9:deg"}
    found = sweep(CASE, axes, chunk=7, progress=False)
    for i, t_end in enumerate((0.6, 6.0)):
        alone = sweep(CASE.with_values({"run.t_end": t_end}), {"lock_pin.backlash": "0:3:9:deg"}, progress=False)
        for name in alone.data_vars:
            assert found[name].values[i].tobytes() == alone[name].values.tobytes(), name
    assert found["run.t_end"].attrs["units"] == "s"


def test_fields_of_the_input_are_axes() -> None:
    case = SHORT.with_values({"run.input": {"kind": "ramp", "rate": "20 mm/s", "stop": "1 s"}})
    found = sweep(case, {"run.input.rate": "10:20:2:mm/s", "run.input.stop": ["0.2 s", "0.4 s"]}, progress=False)
    assert found["run.input.rate"].attrs["readable_units"] == "mm/s"
    single = case.with_values({"run.input.rate": 0.02, "run.input.stop": 0.2})
    run = epp.simulate(single.to_system(), single.input, single.t_end, t_eval=[0.0])
    assert int(found["events"][1, 0]) == len(run.events)


@pytest.mark.slow
def test_predictions_and_orbits_from_processes_have_the_same_bits() -> None:
    axes = {"relay_dead_zone.threshold": "0.8:1.2:2"}
    run = ("predict", "cycles", "trigger")
    here = sweep(RELAY, axes, run=run, chunk=2, progress=False)
    assert here.identical(sweep(RELAY, axes, run=run, chunk=1, scheduler="processes", workers=2, progress=False))


def test_exact_orbits() -> None:
    cases = [c for c in map(epp.case, epp.shipped_cases()) if c.kind == "loop" and c.parameters and c.expected.exact]
    case = next(c for c in cases if len(c.expected.exact) == 1 and not c.to_system().time_step)
    name = next(iter(case.parameters))
    found = sweep(case, {name: [case.value(name)]}, run="cycles", progress=False)
    assert found["exact_stable_cycles"].values.tolist() == [1]
    wanted = case.expected.exact[0].omega / (2 * np.pi)
    assert float(found["exact_frequency"][0]) == pytest.approx(wanted, rel=1e-6)


def test_without_dask_and_zarr_it_is_one_sentence(monkeypatch) -> None:
    import importlib.util

    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name in ("dask", "zarr") else find(name))
    with pytest.raises(EppError, match=r"sweep needs dask, zarr; expected .*\[sweep\]"):
        sweep(SHORT, AXES, progress=False)
    with pytest.raises(EppError, match="sweep needs zarr"):
        epp.open_sweep("map.zarr")


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
        ({"run": ()}, "names no analysis"),
        ({"signals": "wind"}, "there is no signal 'wind'"),
        ({"scheduler": "magic"}, "address of a Dask scheduler"),
        ({"scheduler": "tcp://127.0.0.1:9"}, "no Dask scheduler answers"),
        ({"workers": 0}, "workers is 0"),
        ({"chunk": 0}, "chunk is 0"),
    ],
)
def test_what_is_wrong_is_one_sentence(monkeypatch, arguments, words) -> None:
    monkeypatch.setattr(schedule, "_PATIENCE", "1s")
    with pytest.raises(EppError, match=words):
        sweep(SHORT, LatinHypercube({"bands.range": "1:5:lbf"}, 2), progress=False, **arguments)
