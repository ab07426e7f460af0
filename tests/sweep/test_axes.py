"""What a sweep runs over: grids, zipped axes and samples come out in SI units; what is wrong is one sentence."""

from __future__ import annotations

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.errors import EppError
from eppanalysis.sweep import LatinHypercube, Sobol, Tolerances, Zipped
from eppanalysis.sweep.axes import make_design

LBF = 4.4482216152605  # N, exact by definition of pound and standard gravity
CASE = epp.case("fig8a_original")


def test_a_range_and_a_list_are_in_si_units() -> None:
    design = make_design(CASE, {"bands.range": "1:5:5:lbf", "lock_pin.backlash": ["1 deg", 0.02]})
    assert design.shape == (5, 2)
    np.testing.assert_allclose(design.dimensions[0].values["bands.range"], LBF * np.arange(1, 6), rtol=1e-15)
    np.testing.assert_allclose(design.dimensions[1].values["lock_pin.backlash"], [np.pi / 180, 0.02], rtol=1e-15)
    assert design.at((4, 1)) == {"bands.range": pytest.approx(5 * LBF), "lock_pin.backlash": 0.02}


def test_one_value_is_an_axis() -> None:
    assert make_design(CASE, {"lock_pin.backlash": "2 deg"}).shape == (1,)
    assert make_design(CASE, {"lock_pin.backlash": "2:2:1:deg"}).shape == (1,)
    assert make_design(CASE, {"lock_pin.backlash": 0.01, "bands.range": ["1 lbf"]}).shape == (1, 1)


def test_counts_and_flags_stay_what_they_are() -> None:
    design = make_design(CASE, {"sensor.bits": "8:12:3", "forearm.upright": [False, True]})
    assert design.dimensions[0].given["sensor.bits"] == (8, 10, 12)
    assert all(type(v) is int for v in design.dimensions[0].given["sensor.bits"])
    assert design.dimensions[1].given["forearm.upright"] == (False, True)


def test_zipped_axes_move_together() -> None:
    design = make_design(CASE, Zipped({"bands.range": "1:3:3:lbf", "lock_pin.backlash": ["1 deg", "2 deg", "3 deg"]}))
    assert design.shape == (3,)
    assert design.at((2,))["bands.range"] == pytest.approx(3 * LBF)
    assert design.at((2,))["lock_pin.backlash"] == pytest.approx(np.pi / 60)


def test_latin_hypercube_has_one_point_in_every_slice_and_a_seed() -> None:
    ranges = {"bands.range": "1:5:lbf", "lock_pin.backlash": ("0 deg", "3 deg")}
    first, again, other = (make_design(CASE, LatinHypercube(ranges, 20, seed)).dimensions[0] for seed in (1, 1, 2))
    share = (first.values["bands.range"] / LBF - 1.0) / 4.0
    assert sorted(np.floor(20 * share)) == list(range(20))
    assert first.given == again.given
    assert first.given != other.given


def test_sobol_halves_are_balanced() -> None:
    found = make_design(CASE, Sobol({"lock_pin.backlash": "0:1:rad", "pulley.friction": (0.0, 1.0)}, 64, 3))
    for values in found.dimensions[0].values.values():
        assert np.sum(values < 0.5) == 32


@pytest.mark.parametrize("distribution", ["uniform", "normal"])
def test_tolerances_are_sampled_within_themselves(distribution) -> None:
    case = CASE.with_values(
        {"lock_pin.backlash": {"value": "2 deg", "tolerance": "10 %"}, "bands.range": {"value": 10.0, "tolerance": 1.0}}
    )
    values = make_design(case, Tolerances(500, 5, distribution=distribution)).dimensions[0].values
    assert set(values) == {"lock_pin.backlash", "bands.range"}
    deviation = values["bands.range"] - 10.0
    assert np.abs(deviation).max() <= 1.0
    # Standard deviations in closed form: 1/sqrt(3), and of a normal distribution cut at three sigma.
    expected = 3**-0.5 if distribution == "uniform" else 0.98658 / 3.0
    assert deviation.std() == pytest.approx(expected, rel=0.01)
    assert abs(np.corrcoef(*values.values())[0, 1]) < 0.15


@pytest.mark.parametrize(
    ("axes", "words"),
    [
        ({}, "no axis"),
        ({"bands.range": []}, "bands.range is empty"),
        ({"bands.range": "1:5:0:lbf"}, "bands.range is empty"),
        ({"bands.range": "1:5:4:deg"}, "a force"),
        ({"bands.range": ["2 lbf", "2 mm"]}, "a force"),
        ({"bands.range": "1:5"}, "start:stop:count:unit"),
        ({"bands.range": "1:5:2.5:lbf"}, "start:stop:count:unit"),
        ({"bands.rnge": "1:5:4:lbf"}, "did you mean 'bands.range'"),
        ({"bands.range": "1:5:999999999:lbf"}, "at most"),
        ({"forearm.upright": ["perhaps"]}, "expected"),
        (Zipped({"bands.range": "1:5:4:lbf", "lock_pin.backlash": "1:2:3:deg"}), "one length"),
        (Zipped({}), "one length"),
        (LatinHypercube({"bands.range": "5:1:lbf"}, 4), "lower end first"),
        (LatinHypercube({"bands.range": "1:5:lbf"}, 0), "0 cells"),
        (LatinHypercube({}, 4), "no parameter"),
        (Sobol({"bands.range": "1:5:lbf"}, 100), "power of two, such as 128"),
        (Sobol({"bands.range": ("1 lbf",)}, 4), "low:high:unit"),
        (Tolerances(10, names=["lock_pin.backlash"]), "no tolerance"),
        (Tolerances(10), "has a tolerance"),
        ("bands.range", "axes by parameter"),
    ],
)
def test_what_is_wrong_is_one_sentence(axes, words) -> None:
    with pytest.raises(EppError) as caught:
        make_design(CASE, axes)
    text = str(caught.value)
    assert words in text
    assert text.endswith((".", "?"))
    assert "\n" not in text
