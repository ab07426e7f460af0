"""The verb, the files, and the small programs that check them in processes of their own."""

from __future__ import annotations

import ast
import json
import math
import re
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.methods.certificates.registry import STATEMENTS, Statement, sealed
from eppanalysis.methods.certificates.result import sentence
from eppanalysis.results import LimitCycle, Status

CHECKERS = sorted({statement.program for statement in STATEMENTS.values()})


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A certificate of each statement."""
    limited = epp.LureSystem.from_tf(([5.9], [1.0, 3.0, 2.0, 0.0]), epp.Saturation(), name="limited")
    slack = epp.LureSystem.from_tf(([1.5], [0.2, 1.2, 1.0, 0.0]), epp.Play(gap=1.0), name="slack")
    relay = epp.LureSystem.from_tf(([1.0], [1.0, 1.0]), epp.HysteresisRelay(lower=-0.5, upper=0.5), name="relay")
    cycle = LimitCycle(
        "exact orbit", Status.CONVERGED, 2.0 * math.log(3.0), {}, {}, {}, state=np.zeros(1), memory=(1.0,)
    )
    made = {
        "roots": epp.certify(epp.case("relay_deadzone")),
        "absence": epp.certify(limited, "absence"),
        "absence_with_play": epp.certify(slack, "absence", sectors=4),
        "orbit": epp.certify_orbit(relay, cycle),
        "elbow": epp.certify(epp.case("fig8a_original").with_values({"lock_pin.backlash": "0.06 deg"}), "absence"),
    }
    folder = tmp_path_factory.mktemp("certificates")
    return {name: found.write(folder / f"{name}.json") for name, found in made.items()}


@pytest.mark.parametrize("statement", STATEMENTS.values(), ids=lambda s: s.checker)
def test_checkers_know_the_statement_that_the_registry_hands_them(statement: Statement) -> None:
    assert f'STATEMENT = "{statement.text}"' in statement.program.read_text()


@pytest.mark.parametrize("program", CHECKERS, ids=lambda p: p.stem)
def test_checkers_are_small_and_stand_alone(program: Path) -> None:
    text = program.read_text()
    assert len(text.splitlines()) <= 430
    imports = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Import | ast.ImportFrom)]
    names = {a.name for node in imports if isinstance(node, ast.Import) for a in node.names}
    names |= {node.module for node in imports if isinstance(node, ast.ImportFrom)}
    assert names <= {"fractions", "json", "flint", "sys"}


@pytest.fixture(scope="module")
def all_files(files: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """And those that take seconds to find."""
    pulses = epp.LureSystem.from_tf(([3.2], [1.0, 2.0, 1.0, 0.0]), epp.RelayDeadZone(threshold=1.0))
    made = {"balance": epp.certify(epp.case("relay_biased_fopdt")), "cycles": epp.certify(pulses, "cycles")}
    folder = tmp_path_factory.mktemp("certificates")
    return files | {name: found.write(folder / f"{name}.json") for name, found in made.items()}


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(STATEMENTS))
def test_a_fresh_process_accepts_what_was_written(all_files: dict[str, Path], name: str) -> None:
    """And loads no package that computes in floating point."""
    program, files = STATEMENTS[name].program, all_files
    code = (
        f"import runpy, sys; runpy.run_path({str(program)!r}, run_name='__main__'); "
        "print([m for m in ('numpy', 'scipy', 'eppanalysis', 'sympy', 'cvxpy') if m in sys.modules])"
    )
    run = subprocess.run(
        [sys.executable, "-I", "-c", code], check=False, input=files[name].read_text(), capture_output=True, text=True
    )
    assert run.returncode == 0, run.stderr
    said, loaded = run.stdout.splitlines()
    assert json.loads(said)["accepted"] is True and loaded == "[]"


def test_the_check_says_what_is_proved(files: dict[str, Path]) -> None:
    roots, absence, with_play, orbit, elbow = (epp.check_certificate(files[name]) for name in files)
    assert roots.accepted and "the describing function has exactly 2 roots for the loop in the file" in str(roots)
    assert absence.accepted and "the loop in the file has no periodic motion but rest" in str(absence)
    assert with_play.accepted and "for any gap (a function that falls, quadratic in 8 sectors)" in str(with_play)
    assert orbit.accepted and "arcs in the file: they close to a limit cycle of 2.197 s with 2 events" in str(orbit)
    assert elbow.accepted and "no periodic motion but rest, for any gap up to 0.06 deg" in str(elbow)
    assert roots.to_dict()["accepted"] is True


@pytest.mark.parametrize("name", ["roots", "absence", "absence_with_play", "orbit", "elbow"])
def test_every_changed_digit_of_a_file_is_seen(files: dict[str, Path], name: str, tmp_path: Path) -> None:
    """One digit in twelve of all, in one process of the checker's own functions."""
    import importlib

    checker = importlib.import_module(f"eppanalysis.methods.certificates.{STATEMENTS[name].checker}")
    text = files[name].read_text()
    checker.verify(json.loads(text))
    places = [i for i, letter in enumerate(text) if letter.isdigit()]
    for i in places[::12]:
        changed = text[:i] + str((int(text[i]) + 1) % 10) + text[i + 1 :]
        try:
            document = json.loads(changed)
        except ValueError:
            continue  # a leading zero is no number
        with pytest.raises((checker.Refused, ArithmeticError, LookupError, TypeError, ValueError)):
            checker.verify(document)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "no certificate"),
        ("[1, 2]", "no certificate"),
        ('{"statement": "the moon is round"}', "no checker for the statement 'the moon is round'"),
        ('{"statement": "no periodic motion but rest"}', "refused"),
        ('{"statement": "all roots of the describing-function balance in a box", "digest": 1, "loop": 3}', "changed"),
    ],
)
def test_what_is_no_certificate_is_refused_in_a_sentence(tmp_path: Path, text: str, why: str) -> None:
    path = tmp_path / "file.json"
    path.write_text(text)
    found = epp.check_certificate(path)
    assert not found.accepted and why in found.message and "Traceback" not in found.message


def test_roots_without_a_bias_are_said_to_be_without_one() -> None:
    """A relay before an unstable pole: cycles about another mean are no roots of the balance that is decided."""
    loop = epp.LureSystem.from_tf(
        ([0.844], [0.603, -0.999999512776, 0.09841844, -0.163216]),
        epp.HysteresisRelay(lower=-0.201, upper=0.201, low=-1.32, high=1.32),
    )
    about = [cycle.elements["hysteresis_relay"]["bias"] for cycle in epp.predict_limit_cycles(loop)]
    found = epp.certify(loop)
    assert len(about) == 4 and np.count_nonzero(about) == 2
    assert len(found.roots) == 2 and str(found).endswith("rad/s and no bias.")


@pytest.mark.parametrize("exponent", [400, -400])
def test_numbers_beyond_floats_are_written_out(tmp_path: Path, exponent: int) -> None:
    """A box that ends there is no box without end, and a proof of such a loop no traceback."""
    there = f"1{'0' * exponent}" if exponent > 0 else f"1/1{'0' * -exponent}"
    nothing = {"slope": "0", "bends": [], "jumps": [], "kind": "odd_pieces"}
    loop = {"num": ["1"], "den": ["1", "1"], "delay": "0", "time_step": None, "element": nothing}
    amplitude = sorted(["1", there], key=Fraction)
    document = {
        "statement": STATEMENTS["roots"].text,
        "loop": loop,
        "box": {"amplitude": amplitude, "frequency": ["1", "2"]},
        "claim": {"roots": 0, "undecided": 0},
        "evidence": {"roots": [], "cover": ["."]},
    }
    (path := tmp_path / "file.json").write_text(json.dumps(sealed(document)))
    found = epp.check_certificate(path)
    assert found.accepted and f"1e{exponent:+}" in found.message.replace("1.000e", "1e"), found.message


@pytest.mark.parametrize("exponent", [400, -400])
def test_a_multiplier_a_gap_and_a_period_beyond_floats_are_written_out(exponent: int) -> None:
    there = f"1{'0' * exponent}" if exponent > 0 else f"1/1{'0' * -exponent}"
    claims = [
        ("absence", {"sector": ["0", "1"], "multiplier": there}),
        ("elbow", {"backlash": there}),
        ("orbit", {"period": [there, there], "events": 2, "box": there}),
    ]
    for name, claim in claims:
        loop = {"element": {"kind": "odd_pieces"}}
        text = sentence({"statement": STATEMENTS[name].text, "claim": claim, "loop": loop})
        assert re.search(rf"e[{'-+'[exponent > 0]}](39|40)\d\b", text), text


def test_errors_are_sentences(tmp_path: Path) -> None:
    loop = epp.case("relay_deadzone").to_system()
    with pytest.raises(epp.EppError, match="did you mean 'roots'"):
        epp.certify(loop, "root")
    with pytest.raises(epp.EppError, match="box is given for 'absence'"):
        epp.certify(loop, "absence", box={"omega": (1.0, 2.0)})
    with pytest.raises(epp.EppError, match="expected the file of a certificate"):
        epp.check_certificate(tmp_path / "nothing.json")
    nothing = epp.certify(loop, "absence")
    with pytest.raises(epp.EppError, match="no certificate to write"):
        nothing.write(tmp_path / "none.json")
    with pytest.raises(epp.EppError, match="no picture"):
        nothing.plot()


def test_without_flint_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    import importlib.util

    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(epp.EppError, match=r"eppanalysis\[proof\]"):
        epp.certify(epp.case("relay_deadzone"))


def test_results_are_plain_data_and_draw() -> None:
    found = epp.certify(epp.case("relay_deadzone"))
    data = json.loads(json.dumps(found.to_dict()))
    assert data["status"] == "converged" and data["proved"] is True and len(data["roots"]) == 2
    assert data["document"]["digest"] == found.document["digest"]
    assert data["provenance"]["tolerances"]["coefficients"] < 1e-13
    axes = found.plot().figure.axes[0]
    assert len(axes.collections[0].get_paths()) == sum(
        len(c.replace("a", "").replace("w", "")) for c in found.document["evidence"]["cover"]
    )
    limited = epp.LureSystem.from_tf(([5.9], [1.0, 3.0, 2.0, 0.0]), epp.Saturation())
    curve, line = epp.certify(limited, "absence").plot().figure.axes[0].lines[:2]
    # Popov: the curve stays to the right of the line x = -1/k + r y.
    rate = float((line.get_xdata()[1] - line.get_xdata()[0]) / (line.get_ydata()[1] - line.get_ydata()[0]))
    assert ((curve.get_xdata() + 1.0) > rate * curve.get_ydata()).all()


def test_the_state_space_is_read_as_the_numbers_that_it_stands_for() -> None:
    """In turned coordinates the coefficients are those of the transfer function, and an integrator stays one."""
    plain = epp.LureSystem.from_tf(([5.9], [1.0, 3.0, 2.0, 0.0]), epp.Saturation())
    Q = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    for loop in (plain, plain.in_coordinates(Q, Q.T)):
        document = epp.certify(loop).document
        assert document["loop"]["num"] == ["59/10"] and document["loop"]["den"] == ["1", "3", "2", "0"]
