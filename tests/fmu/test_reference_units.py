"""Reference units of the FMI standard: https://github.com/modelica/Reference-FMUs, built as its readme says.

EPP_REFERENCE_FMUS is the folder of the units that its build makes, of FMI 2 or 3. The same equations and numbers are
tested on units made here (`test_read.py`).
"""

from __future__ import annotations

import os
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

import eppanalysis as epp

pytest.importorskip("fmpy")
FOLDER = os.environ.get("EPP_REFERENCE_FMUS", "")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not FOLDER, reason="EPP_REFERENCE_FMUS names no folder of units of modelica/Reference-FMUs"),
]


def unit(name: str) -> Path:
    path = Path(FOLDER) / f"{name}.fmu"
    return path if path.exists() else pytest.skip(f"EPP_REFERENCE_FMUS has no {path.name}")


def test_matrices_of_state_space() -> None:
    """Those that it is given, to the last bit but one; and by default identities, with inputs of 1, 2, 3."""
    random = np.random.default_rng(0)
    A, B, C, D = (random.normal(size=(3, 3)) for _ in range(4))
    D[0, 0] = 0.0
    play = {("y[1]", "u[1]"): epp.Play(gap=0.1)}
    loop = epp.from_fmu(unit("StateSpace"), play, parameters={"A": A, "B": B, "C": C, "D": D})
    for found, expected in (
        (loop.A, A), (loop.B, B[:, :1]), (loop.B_input, B[:, 1:]), (loop.C, C[:1]), (loop.signals.C[:3], C),
        (loop.signals.D[:3], D[:, :1]), (loop.signals.D_input[:3], D[:, 1:]),
    ):  # fmt: skip
        np.testing.assert_allclose(found, expected, rtol=1e-11, atol=0.0)
    plain = epp.from_fmu(unit("StateSpace"), play, parameters={"D": np.zeros((3, 3))})
    np.testing.assert_array_equal(plain.A, np.eye(3))
    assert plain.input_names == ("u[2]", "u[3]") and plain.v0.tolist() == [2.0, 3.0]


def test_a_relay_around_state_space() -> None:
    """``1/(s (s + 1)(s + 2))`` under a relay, whose frequency is that at which Tsypkin's locus is real."""
    A, e, none = [[-3.0, -2.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], np.eye(3), np.zeros((3, 3))
    parameters = {"A": A, "B": np.outer(e[0], e[0]), "C": np.outer(e[0], -e[2]), "D": none}
    loop = epp.from_fmu(unit("StateSpace"), {("y[1]", "u[1]"): epp.Relay()}, parameters=parameters)
    (cycle,) = epp.find_limit_cycles(loop).stable
    odd = 2.0 * np.arange(200_000) + 1.0

    def locus(omega: float) -> float:
        s = 1j * odd * omega
        return float(np.sum((1.0 / (s * (s + 1.0) * (s + 2.0))).imag / odd))

    assert 2.0 * np.pi / cycle.period == pytest.approx(brentq(locus, 0.5, 3.0, xtol=1e-13), rel=1e-9)


def test_inputs_that_jump() -> None:
    """What goes straight through: each output is its input, the discrete one, too."""
    play = {("Float64_continuous_output", "Float64_continuous_input"): epp.Play(gap=0.1)}
    with pytest.raises(epp.ModelError, match="algebraic loop through Float64_continuous_input"):
        epp.from_fmu(unit("Feedthrough"), play)
    play = {("Float64_discrete_output", "Float64_continuous_input"): epp.Play(gap=0.1)}
    loop = epp.from_fmu(unit("Feedthrough"), play)
    outputs = ("Float64_continuous_output", "Float64_discrete_output")
    rows = [loop.signals.names.index(name) for name in outputs]
    through = np.hstack([loop.signals.D, loop.signals.D_input])[rows]
    columns = [("Float64_continuous_input", *loop.input_names).index(name.replace("out", "in")) for name in outputs]
    np.testing.assert_array_equal(through, np.eye(through.shape[1])[columns])


def test_units_without_inputs_make_no_loop() -> None:
    """Van der Pol's oscillator is linearised where it rests, Dahlquist's equation is linear; nothing drives either."""
    rest = re.escape("VanDerPol.fmu is not linear; it is linearised at rest (x0 = 0, x1 = 0).")
    with pytest.warns(UserWarning, match=rest), pytest.raises(epp.ModelError, match="has no input 'u'.* none"):
        epp.from_fmu(unit("VanDerPol"), {("x1", "u"): epp.Relay()})
    with pytest.raises(epp.ModelError, match="Dahlquist has no input 'u'; expected one of: none"):
        epp.from_fmu(unit("Dahlquist"), {("x", "u"): epp.Relay()})
