"""Frequency responses in files: every way to write one is the same response; what is wrong is said with its line."""

import numpy as np
import pytest
from typer.testing import CliRunner

import eppanalysis as epp
from eppanalysis.cli.commands import app

OMEGA = np.geomspace(1.0, 50.0, 40)
VALUE = 2e-3 / (1.0 + 0.3j * OMEGA)
SHIPPED = "frequency_response.csv"


def written(path, header, *columns, separator=","):
    rows = [separator.join(f"{v:.15g}" for v in row) for row in zip(*columns, strict=True)]
    path.write_text("\n".join([header, *rows]))
    return path


@pytest.mark.parametrize(
    ("header", "columns", "separator"),
    [
        ("frequency [Hz],magnitude [mm/N],phase [deg]",
         (OMEGA / (2 * np.pi), 1e3 * np.abs(VALUE), np.degrees(np.angle(VALUE))), ","),
        ("Frequency [rad/s];Magnitude [dB];Phase [rad]", (OMEGA, 20 * np.log10(np.abs(VALUE)), np.angle(VALUE)), ";"),
        ("real [m/N]\timaginary [m/N]\tfrequency [Hz]", (VALUE.real, VALUE.imag, OMEGA / (2 * np.pi)), "\t"),
        ("frequency [kHz],real,imaginary", (OMEGA / (2e3 * np.pi), VALUE.real, VALUE.imag), ","),
        ("Frequency (rad/s),Real (mm/N),Imaginary (mm/N)", (OMEGA, 1e3 * VALUE.real, 1e3 * VALUE.imag), ","),
    ],
)  # fmt: skip
def test_units_and_forms(tmp_path, header, columns, separator):
    response = epp.read_response(written(tmp_path / "g.csv", header, *columns, separator=separator))
    assert np.allclose(response.omega, OMEGA, rtol=1e-12)
    assert np.allclose(response.value, VALUE, rtol=1e-12)
    assert response.name == "g.csv"


def test_decimal_commas_beside_semicolons(tmp_path):
    path = written(tmp_path / "g.csv", "frequency [rad/s];real;imaginary", OMEGA, VALUE.real, VALUE.imag, separator=";")
    path.write_text(path.read_text().replace(".", ","))
    assert np.allclose(epp.read_response(path).value, VALUE, rtol=1e-12)


def test_order_of_rows_deviation_and_static_gain(tmp_path):
    omega = np.append(OMEGA, 0.0)
    value = 2e-3 / (1.0 + 0.3j * omega)
    order = np.random.default_rng(1).permutation(omega.size)
    columns = (omega[order], value.real[order], value.imag[order], 0.1 * (1.0 + omega[order]))
    path = written(tmp_path / "g.csv", "frequency [rad/s],real,imaginary,deviation [%]", *columns)
    response = epp.read_response(path)
    assert response.static_gain == pytest.approx(2e-3)
    assert np.allclose(response.deviation, 1e-3 * (1.0 + OMEGA), rtol=1e-12)
    assert np.isinf(epp.read_response(path, static_gain=np.inf).static_gain)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "a header such as 'frequency"),
        ("time,magnitude,phase\n1,2,3", "one of frequency"),
        ("frequency,magnitude,phase [deg]\n1,2,3", "frequency .Hz."),
        ("frequency [m],magnitude,phase [deg]\n1,2,3", "an angular velocity"),
        ("frequency [Hz],magnitude,phase\n1,2,3", "phase .deg."),
        ("frequency [Hz],magnitude,real\n1,2,3", "either magnitude and phase"),
        ("frequency [Hz],magnitude\n1,2", "either magnitude and phase"),
        ("frequency [Hz],frequency [Hz],real,imaginary\n1,1,2,3", "each column once"),
        ("frequency [Hz],real [m],imaginary [mm]\n1,2,3", "unit of the real part"),
        ("frequency [Hz],real [parsecs],imaginary [parsecs\n1,2,3", "one of frequency"),
        ("frequency [Hz],real,imaginary\n1,2", "line 2 is '2 cells long'"),
        ("frequency [Hz],real,imaginary\n1,2,x", "line 2, imaginary is 'x'"),
        ("frequency [Hz],real,imaginary\n1,2,nan", "finite"),
        ("frequency [Hz],real,imaginary\n1,2,3", "8 or more"),
        ("frequency [Hz],real,imaginary,deviation [m]\n1,2,3,1", "deviation"),
        (
            "frequency [Hz],magnitude,phase [deg]\n1,-3.5,0",
            "magnitude is '-3.5'; expected none below zero, or decibels",
        ),
        ("frequency [rad/s],real,imaginary" + "\n1,2,3" * 8, "omega is 1 rad/s after 1;"),
    ],
)
def test_refuses(tmp_path, text, said):
    path = tmp_path / "g.csv"
    path.write_text(text)
    with pytest.raises(epp.EppError, match=said):
        epp.read_response(path)


def test_refuses_what_is_no_file(tmp_path):
    with pytest.raises(epp.CaseError, match="can be read"):
        epp.read_response(tmp_path / "nowhere.csv")
    with pytest.raises(epp.CaseError, match="can be read"):
        epp.read_response(tmp_path)
    (tmp_path / "g.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(epp.CaseError, match="UTF-8"):
        epp.read_response(tmp_path / "g.csv")


def test_command_takes_a_file_for_the_linear_part():
    said = CliRunner().invoke(app, ["predict", "relay_deadzone", "--response", SHIPPED])
    assert said.exit_code == 0, said.output
    assert "The describing function predicts 2 limit cycles" in said.output
    # The data are those of 200/(s (s + 2) (s + 5)) with 1 % noise: amplitude by hand from its gain 20/7 at sqrt(10).
    gain = 20.0 / 7.0
    stable = 4.0 * gain / np.pi * np.sqrt(0.5 + 0.5 * np.sqrt(1.0 - (0.5 * np.pi / gain) ** 2))
    found = epp.predict_limit_cycles(epp.MeasuredLoop(epp.read_response(SHIPPED), epp.RelayDeadZone(threshold=1.0)))
    low, high = found[1].intervals["amplitude"]
    assert low < stable < high
    assert f"{2.0 * low:.4g} to {2.0 * high:.4g}" in said.output  # peak to peak


def test_command_refuses_responses_of_too_few_paths():
    said = CliRunner().invoke(app, ["predict", "fig8a_original", "--response", SHIPPED])
    assert said.exit_code == 2
    assert "4 and 4, as the elements" in " ".join(said.output.split())


def test_paths_have_columns_of_their_own(tmp_path):
    omega = np.append(0.0, OMEGA)
    lag, slow = 2.0 / (1.0 + 0.3j * omega), 5.0 / (1.0 + 2.0j * omega)
    header = "frequency [rad/s],real 2/1,imaginary 2/1,magnitude 1/2 [dB],phase 1/2 [rad],deviation [%],deviation 1/2"
    columns = (lag.real, lag.imag, 20 * np.log10(np.abs(slow)), np.angle(slow), 0 * omega + 1.0, 0 * omega + 0.02)
    matrix = epp.read_response(written(tmp_path / "g.csv", header, omega, *columns))
    assert matrix.shape == (2, 2)
    assert np.allclose(matrix.static_gain, [[0.0, 5.0], [2.0, 0.0]])
    assert matrix.paths[0][0] is None
    assert np.allclose(matrix.paths[1][0].value, lag[1:], rtol=1e-12)
    assert np.allclose(matrix.paths[0][1].value, slow[1:], rtol=1e-12)
    assert [matrix.paths[i][1 - i].deviation[0] for i in (0, 1)] == pytest.approx([0.02, 0.01])
    control = pytest.importorskip("control")
    data = np.zeros((2, 2, len(omega)), complex)
    data[1, 0], data[0, 1] = lag, slow
    same = epp.MeasuredMatrix.from_control(control.frd(data, omega), deviation=0.01)
    assert np.allclose(same.static_gain, matrix.static_gain)
    assert np.allclose(same.at(OMEGA[3:5]), matrix.at(OMEGA[3:5]), rtol=1e-3)
    assert matrix.band == pytest.approx((OMEGA[0], OMEGA[-1]))


@pytest.mark.parametrize(
    ("header", "said"),
    [
        ("frequency [Hz],real 1/1,imaginary", "path such as 2/1"),
        ("frequency [Hz],real 0/1,imaginary 0/1", "one of frequency"),
        ("frequency [Hz],real 1/1,imaginary 1/2", "either magnitude and phase"),
        ("frequency [Hz],real 2/1,imaginary 2/1,real 2/1", "each column once"),
    ],
)
def test_refuses_paths_that_are_none(tmp_path, header, said):
    with pytest.raises(epp.EppError, match=said):
        epp.read_response(written(tmp_path / "g.csv", header, *[OMEGA] * (1 + header.count(","))))
