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
    ],
)  # fmt: skip
def test_units_and_forms(tmp_path, header, columns, separator):
    response = epp.read_response(written(tmp_path / "g.csv", header, *columns, separator=separator))
    assert np.allclose(response.omega, OMEGA, rtol=1e-12)
    assert np.allclose(response.value, VALUE, rtol=1e-12)
    assert response.name == "g.csv"


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
        ("", "a table"),
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
        ("frequency [Hz],real,imaginary\n1,2,x", "line 2 is 'x'"),
        ("frequency [Hz],real,imaginary\n1,2,nan", "finite"),
        ("frequency [Hz],real,imaginary\n1,2,3", "8 or more"),
        ("frequency [Hz],real,imaginary,deviation [m]\n1,2,3,1", "deviation"),
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
    assert "2 limit cycles predicted" in said.output
    # The data are those of 200/(s (s + 2) (s + 5)) with 1 % noise: amplitude by hand from its gain 20/7 at sqrt(10).
    gain = 20.0 / 7.0
    stable = 4.0 * gain / np.pi * np.sqrt(0.5 + 0.5 * np.sqrt(1.0 - (0.5 * np.pi / gain) ** 2))
    found = epp.predict_limit_cycles(epp.MeasuredLoop(epp.read_response(SHIPPED), epp.RelayDeadZone(threshold=1.0)))
    low, high = found[1].intervals["amplitude"]
    assert low < stable < high
    assert f"{low:.4g} to {high:.4g}" in said.output


def test_command_refuses_cases_with_several_elements():
    said = CliRunner().invoke(app, ["predict", "fig8a_original", "--response", SHIPPED])
    assert said.exit_code == 2
    assert "expected one" in said.output
