"""Branches and bounds of loops with an integral that nothing reads: two angles whose difference alone is read."""

from __future__ import annotations

import numpy as np
import pytest

import eppanalysis as epp

OVER = ("rock.static", 5000.0, 4000.0)


def drill(seed: int | None) -> epp.Case:
    """A table under control of speed turns a bit through a long shaft, in absolute angles, turned or not."""
    loop = epp.Diagram(
        parts={
            "table": epp.blocks.Inertia(inertia=2122.0, damping=425.0),
            "bit": epp.blocks.Inertia(inertia=374.0, damping=20.0),
            "string": epp.blocks.Shaft(stiffness=473.0, damping=23.2),
            "control": epp.blocks.Gain(gain=5000.0),
            "rock": epp.Friction(coulomb=3000.0, static=5000.0),
            "speed": epp.blocks.Constant(value=2.0),
        },
        connect=[
            *("speed - table.speed -> control", "control - string -> table", "string - rock -> bit"),
            *("table.angle - bit.angle -> string.twist", "table.speed - bit.speed -> string.rate", "bit.speed -> rock"),
        ],
        signals={"bit": "bit.speed", "twist": "table.angle - bit.angle", "angle": "table.angle"},
    ).to_system()
    if seed is not None:
        Q = np.linalg.qr(np.random.default_rng(seed).normal(size=(4, 4)))[0]
        loop = loop.in_coordinates(Q.T, Q)
    return epp.Case.from_system(loop, t_end=300.0)


def twisted() -> epp.Case:
    """The same with the twist as a state, and no angle."""
    A = [[-5448.2 / 2122.0, 23.2 / 2122.0, -473.0 / 2122.0], [23.2 / 374.0, -43.2 / 374.0, 473.0 / 374.0], [1, -1, 0]]
    rock = epp.Friction(coulomb=3000.0, static=5000.0)
    loop = epp.LureSystem.build(
        A, [[0], [-1.0 / 374.0], [0]], [[0, 1, 0]], [rock], element_names=["rock"],
        constant_state=[10000.0 / 2122.0, 0, 0],
    )  # fmt: skip
    return epp.Case.from_system(loop, t_end=300.0)


@pytest.mark.parametrize("seed", [None, 2])
def test_a_branch_in_absolute_angles_is_that_in_their_difference(seed):
    """No orbit closed, for an angle that nothing reads goes on for ever."""
    case = drill(seed)
    known, found = (epp.continue_branch(one, *OVER, n_others=0, max_step=0.2) for one in (twisted(), case))
    assert str(found) == str(known) and found.ends == known.ends
    for key, own in (("period", "period"), ("multiplier", "multiplier"), ("rock_input", "bit")):
        np.testing.assert_allclose(found.points[own][[0, -1]], known.points[key][[0, -1]], rtol=1e-4, atol=1e-9)
    np.testing.assert_allclose(found.points["period"][[0, -1]], known.points["period"][[0, -1]], rtol=1e-8)
    # The swing of an angle is that beside what it gains, as everywhere.
    run = epp.simulate(case.with_values({"rock.static": found.points["value"][-1]})).limit_cycle
    assert found.points["angle"][-1] == pytest.approx(run.peak_to_peak["angle"], rel=1e-5)


@pytest.mark.slow
def test_a_curve_of_folds_in_absolute_angles_is_that_in_their_difference():
    """The loop changed its structure from value to value."""
    asked = "rock.static", "rock.coulomb", (3000.0, 6000.0), (2800.0, 2820.0)
    known, found = (epp.continue_folds(case, *asked, n_points=3) for case in (twisted(), drill(2)))
    np.testing.assert_allclose(found.values, known.values, rtol=1e-8)


@pytest.mark.slow
def test_a_bound_in_absolute_angles_is_that_in_their_difference():
    values = []
    for case, signal in ((twisted(), "rock_input"), (drill(None), "bit")):
        options = {"at": [3000.0], "within": (3000.0, 6000.0), "verify": False, "allow": f"{signal} 5"}
        values.append(epp.design_bounds(case, "rock.coulomb", "rock.static", **options)[0].exact)
    assert values[1] == pytest.approx(values[0], rel=1e-8)


@pytest.mark.slow
def test_a_design_in_absolute_angles_is_that_in_their_difference():
    """Nothing but its range limited it, for no cycle closed."""
    tune, options = {"rock.static": (3000.0, 6000.0)}, {"maximise": "rock.static", "verify": False}
    known = epp.design(twisted(), tune, allow="rock_input 5", **options).optimum
    found = epp.design(drill(2), tune, allow="bit 5", **options).optimum
    assert found.at["rock.static"] == pytest.approx(known.at["rock.static"], rel=1e-8) and known.at["rock.static"] < 5e3


@pytest.mark.slow
def test_a_guideline_in_absolute_angles_is_that_in_their_difference():
    """It did not say from where on the motion from rest oscillates, for that cycle did not close."""
    rows = []
    for case in (twisted(), drill(None)):
        options = {"over": "rock.coulomb", "limit": "rock.static", "within": (3000.0, 6000.0), "starts": 1}
        rows += epp.design_guide(case, [3000.0], **options).rows
    assert rows[1].cell.exact == pytest.approx(rows[0].cell.exact, rel=1e-8)
    assert rows[1].from_rest == pytest.approx(rows[0].from_rest, rel=1e-8)
