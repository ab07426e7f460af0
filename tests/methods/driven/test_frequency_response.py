"""Responses over frequency and amplitude: folds against closed forms and integrators, linear loops, python-control."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import eppanalysis as epp
from eppanalysis.errors import EppError, ModelError
from tests import driven_loops
from tests.coordinates import rescaled, rotated
from tests.driven_loops import TURN, duffing


@pytest.fixture(scope="module")
def saturated():
    return driven_loops.saturated()


@pytest.fixture(scope="module")
def jump(saturated):
    return epp.frequency_response(saturated, output="mass", amplitude=0.5, frequencies=(0.7 / TURN, 1.0 / TURN))


def swept(omegas, start):
    """Half the peak-to-peak of the saturated loop at a row of frequencies, each begun where the last one ended."""
    y, found = np.array(start), []
    for w in omegas:

        def rate(t, y, w=w):
            return [y[1], np.clip(0.5 * np.sin(w * t) - y[0], -1.0, 1.0) - 0.2 * y[1]]

        way = {"rtol": 1e-8, "atol": 1e-10, "max_step": TURN / w / 20}
        y = solve_ivp(rate, (0.0, 25 * TURN / w), y, **way).y[:, -1]
        x = solve_ivp(rate, (0.0, TURN / w), y, dense_output=True, **way).sol(np.linspace(0.0, TURN / w, 4001))[0]
        found.append(0.5 * np.ptp(x))
    return np.array(found)


def at(response, omega):
    """Half peak-to-peaks of all points that a response has at a frequency, lowest first."""
    (branch,) = response.branches
    w, size, found = TURN * branch.frequency, 0.5 * branch.peak_to_peak, []
    for k in np.flatnonzero((w[:-1] - omega) * (w[1:] - omega) <= 0):
        found.append(float(np.interp(omega, *zip(*sorted([(w[k], size[k]), (w[k + 1], size[k + 1])]), strict=True))))
    return sorted(found)


def test_the_branch_goes_through_both_folds_and_is_unstable_between_them(jump):
    (branch,) = jump.branches
    assert jump.status.ok and [s.kind for s in branch.special] == ["fold", "fold"]
    first, second = (s.index for s in branch.special)
    assert np.all(branch.stable[:first]) and np.all(branch.stable[second + 1 :])
    assert not np.any(branch.stable[first : second + 1])
    assert len(branch.parts()) == 3
    # Interpolated between points that are 1 % apart.
    assert at(jump, 0.88) == pytest.approx([1.501], abs=1e-3)
    assert [a for a in at(jump, 0.80) if not 1.7 < a < 1.8] == pytest.approx([1.269, 1.821], abs=2e-3)


@pytest.mark.slow
def test_a_slow_sweep_of_an_independent_integrator_jumps_just_at_the_folds(jump, saturated):
    down, up = (TURN * s.frequency for s in jump.folds)
    rising = swept([up - 0.02, up - 0.002, up + 0.003], [0.0, 0.0])
    assert rising[0] < 1.40 and rising[1] < 1.48 and rising[2] > 1.6
    falling = swept([0.85, 0.80, down + 0.002, down - 0.003], [0.0, -1.4])
    assert falling[2] > 1.9 and falling[3] < 1.2


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_folds_are_the_same_in_turned_states_and_other_units(seed, jump, saturated):
    wanted = [s.frequency for s in jump.folds]
    for system in (rotated(saturated, seed), rescaled(saturated, 1.0, 1.0, seed)):
        found = epp.frequency_response(system, output="mass", amplitude=0.5, frequencies=(0.7 / TURN, 1.0 / TURN))
        assert [s.frequency for s in found.folds] == pytest.approx(wanted, rel=1e-11)
        assert found.status.ok and [b.ends for b in found.branches] == [b.ends for b in jump.branches]


def test_at_a_fold_a_multiplier_is_one(jump):
    (branch,) = jump.branches
    for special in branch.special:
        assert branch.multiplier[special.index] == pytest.approx(1.0, abs=1e-6)
        assert branch.frequency[special.index] == special.frequency
        sides = branch.frequency[special.index - 1 : special.index + 2]
        assert special.frequency in (sides.min(), sides.max())


def test_first_order_is_its_own_closed_form_and_near_the_exact_branch():
    response = epp.frequency_response(duffing(), output="mass", amplitude=0.3, frequencies=(0.15, 0.26), max_step=0.06)
    for branch in response.first_order:
        w, a = TURN * branch.frequency, 0.5 * branch.peak_to_peak
        left = ((1 - w**2 + 0.75 * a**2) ** 2 + (0.2 * w) ** 2) * a**2
        assert left == pytest.approx(np.full(w.size, 0.09), rel=1e-6)
    assert len(response.folds) == 2
    # Folds of first order: where w^2 = 1 + 3/4 a^2 - d^2/2 -+ sqrt(F^2/a^2 - d^2 (1 + 3/4 a^2) + d^4/4) turns. The
    # third harmonic, which first order leaves out, moves the upper one by 1.1 per cent.
    a = np.linspace(0.3, 1.3, 100_001)
    root = (0.3 / a) ** 2 - 0.04 * (1 + 0.75 * a**2) + 0.0004
    a, root = a[root >= 0], np.sqrt(root[root >= 0])
    squares = 1 + 0.75 * a**2 - 0.02
    folds = [np.sqrt((squares + root).min()), np.sqrt((squares - root).max())]
    assert [TURN * s.frequency for s in response.folds] == pytest.approx(folds, rel=0.015)


def test_a_linear_range_gives_the_frequency_response_everywhere(saturated):
    # Below its limits the saturation is a gain of one: x = force/(s^2 + 0.2 s + 1).
    response = epp.frequency_response(saturated, output="mass", amplitude=0.1, frequencies=(0.1, 0.25))
    (branch,) = response.branches
    s = 2j * np.pi * branch.frequency
    assert np.max(np.abs(branch.response * (s * s + 0.2 * s + 1.0) - 1.0)) < 1e-8
    (first,) = response.first_order
    s = 2j * np.pi * first.frequency
    assert np.max(np.abs(first.response * (s * s + 0.2 * s + 1.0) - 1.0)) < 1e-8
    data = response.to_control()
    assert data.eval(data.omega[7]) == pytest.approx(branch.response[7], rel=1e-12)
    assert data.input_labels == ["force"] and data.output_labels == ["mass"]


def test_over_the_amplitude_the_branch_folds_where_it_does_over_the_frequency(jump, saturated):
    fold = jump.folds[0]
    response = epp.amplitude_response(saturated, output="mass", frequency=fold.frequency, amplitudes=(0.2, 1.2))
    assert min(abs(s.amplitude / 0.5 - 1.0) for s in response.folds) < 1e-6
    with pytest.raises(EppError, match="runs over the amplitude"):
        response.to_control()


def test_results_are_plain_tables_and_pictures(jump):
    table = jump.to_frame()
    exact = table[table.method == "exact orbit"]
    assert list(exact.frequency) == list(jump.branches[0].frequency)
    assert exact.stable.astype(bool).sum() == jump.branches[0].stable.sum()
    assert jump.to_dict()["branches"][0]["special"][0]["kind"] == "fold"
    assert "jumps at 0.1229 Hz and 0.1325 Hz" in str(jump)
    upper, lower = jump.plot().figure.axes
    labels = [t.get_text() for t in upper.get_legend().get_texts()]
    assert labels == ["DF", "stable", "unstable", "fold"]
    assert lower.get_xlabel() == "frequency of force [Hz]"
    with pytest.raises(EppError, match="has 3 values in places; expected the part"):
        jump.to_control()
    assert jump.to_control(2).omega[0] == pytest.approx(TURN * jump.folds[0].frequency, rel=1e-12)


def test_bad_ranges_and_names_are_refused(saturated):
    with pytest.raises(EppError, match="expected two different positive numbers"):
        epp.frequency_response(saturated, amplitude=0.5, frequencies=(0.0, 1.0))
    with pytest.raises(ModelError, match="has no signal 'mas'; expected did you mean 'mass'"):
        epp.frequency_response(saturated, output="mas", amplitude=0.5, frequencies=(0.1, 1.0))


def test_a_pair_of_mirror_images_leaves_the_symmetric_response_at_one_frequency():
    system = epp.Diagram(
        parts={
            "relay": epp.RelayDeadZone(threshold=0.2),
            "plant": epp.blocks.TransferFunction(num=[1.0], den=[1.0, 1.0, 0.0]),
        },
        connect=["force - plant -> relay", "relay -> plant"],
        inputs=["force"],
    ).to_system()
    # A step of the default length from one of them, just below that frequency, ends on the symmetric one above it.
    response = epp.frequency_response(system, output="plant", amplitude=1.0, frequencies=(0.115, 0.12))
    points = [s for b in response.branches for s in b.special]
    assert [s.kind for s in points] == ["branch point", "branch point"] and not response.folds
    assert points[0].frequency == pytest.approx(points[1].frequency, rel=1e-6)
    folded, symmetric = response.branches
    # The branch of the pair goes up to the point and back down, the symmetric one straight through the range.
    assert folded.frequency.max() == pytest.approx(points[0].frequency, rel=1e-9)
    assert folded.frequency[[0, -1]] == pytest.approx([0.115, 0.115])
    assert np.sort(symmetric.frequency[[0, -1]]) == pytest.approx([0.115, 0.12])
    below = epp.forced_response(system, amplitude=1.0, frequency=0.999 * points[0].frequency, most_periods=1)
    above = epp.forced_response(system, amplitude=1.0, frequency=1.001 * points[0].frequency, most_periods=1)
    assert all(abs(r.cycle.mean["plant"]) > 1e-4 for r in below.stable)
    assert [abs(r.cycle.mean["plant"]) < 1e-9 for r in above.stable] == [True]
