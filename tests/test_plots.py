"""Pictures: what is drawn is what the result holds, and every axis has its unit."""

from __future__ import annotations

import sys
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure

from eppanalysis.errors import EppError
from eppanalysis.plots import plot_ladder, plot_limit_cycle, plot_nyquist, plot_trajectory
from eppanalysis.results import Status
from tests.synthetic import cycle, prediction, prediction_of_several, trajectory


def labels(figure):
    return [ax.get_ylabel() for ax in figure.axes]


def test_trajectory_has_one_panel_a_signal_with_its_unit():
    run = trajectory()
    figure = plot_trajectory(run)
    assert labels(figure) == ["theta [rad]", "voltage [V]"]
    assert figure.axes[-1].get_xlabel() == "time [s]"
    np.testing.assert_array_equal(figure.axes[0].lines[0].get_ydata(), run.signals["theta"])


@pytest.mark.parametrize("status", list(Status))
def test_trajectory_of_every_status_is_drawn_with_its_sentence(status):
    figure = trajectory(status).plot()
    figure.draw_without_rendering()
    assert figure.get_suptitle() == status.value


def test_chosen_signals_keep_their_order():
    assert labels(plot_trajectory(trajectory(), ["voltage"])) == ["voltage [V]"]


def test_unknown_signal_is_one_sentence():
    with pytest.raises(EppError, match="no signal 'thetta'; expected one of theta, voltage"):
        plot_trajectory(trajectory(), ["thetta"])


def test_cycle_without_waveform_is_drawn_from_its_harmonics():
    figure = plot_limit_cycle(cycle())
    time, theta = figure.axes[0].lines[0].get_data()
    np.testing.assert_allclose(theta, 0.8 + 0.05 * np.cos(4 * np.pi * np.asarray(time)), atol=1e-14)


def test_nyquist_marks_every_cycle_where_the_response_has_its_frequency():
    figure = plot_nyquist(prediction())
    ax = figure.axes[0]
    marks = [line for line in ax.lines if line.get_marker() == "o"]
    # At 1 rad/s the response is 5/(j (1 + j)^2) = -2.5, halfway along the locus and on the real axis.
    for mark in marks:
        np.testing.assert_allclose([mark.get_xdata()[0], mark.get_ydata()[0]], [-2.5, 0.0])
    assert [mark.get_markerfacecolor() for mark in marks] == ["none", "#009E73"]
    assert ax.get_xlim()[0] < -2.5 < ax.get_xlim()[1]


def test_several_elements_are_drawn_as_loop_gain_over_amplitude():
    ax = plot_nyquist(prediction_of_several()).axes[0]
    marks = [(line.get_xdata()[0], line.get_ydata()[0]) for line in ax.lines if line.get_marker() == "o"]
    np.testing.assert_allclose(marks, [(0.619061, 1.0), (1.512135, 1.0)])
    assert ax.get_xlabel() == "amplitude at the input of play"


def test_nyquist_without_cycles_says_so():
    assert "no limit cycles" in plot_nyquist(prediction(0)).axes[0].get_title()


def test_nyquist_draws_into_given_axes():
    figure = Figure()
    ax = figure.add_subplot()
    assert plot_nyquist(prediction(), ax) is figure
    assert ax.lines


def test_ladder_has_one_panel_a_quantity_and_one_mark_a_method():
    rows = [
        SimpleNamespace(method="describing function", quantities={"frequency": 2.1, "peak_to_peak theta": 0.1}),
        SimpleNamespace(method="simulation", quantities={"frequency": 2.0, "peak_to_peak theta": None}),
    ]
    units = {"frequency": "Hz", "peak_to_peak theta": "rad"}
    figure = plot_ladder(SimpleNamespace(rows=rows, units=units, verdict="They agree."))
    figure.draw_without_rendering()
    assert [ax.get_xlabel() for ax in figure.axes] == ["frequency [Hz]", "peak to peak theta [rad]"]
    assert [len(ax.lines) for ax in figure.axes] == [2, 1]
    assert figure.get_suptitle() == "They agree."


def test_pictures_leave_the_global_state_alone():
    plot_nyquist(prediction())
    pyplot = sys.modules.get("matplotlib.pyplot")
    assert pyplot is None or not pyplot.get_fignums()
