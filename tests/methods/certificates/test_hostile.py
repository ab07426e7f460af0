"""Checkers by themselves, as programs: whatever file they are handed, they end soon, and in a sentence."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

import eppanalysis as epp
from eppanalysis.methods.certificates.registry import STATEMENTS, Claim, of_text, sealed
from tests.shared import mostly_slow

pytest.importorskip("flint")
CHECKERS = sorted({statement.program for statement in STATEMENTS.values()})
#: Longest time that a refusal may take [s]; most are there at once, on a busy machine too.
PATIENCE = 60.0
FIRST_LAG = {"num": ["1"], "den": ["1", "3", "3", "1"], "delay": "0", "time_step": None}
DEEP = 100_000
#: The course of an orbit of one arc with one unknown.
COURSE = {
    "modes": [[0]],
    "guards": [0],
    "at_once": [False],
    "unknown": [0],
    "held": [],
    "basis": [["1"]],
    "drive": [],
}


def run(program: Path, text: str, *flags: str) -> tuple[int, dict[str, Any], float]:
    began = time.monotonic()
    found = subprocess.run(
        [sys.executable, *flags, str(program)],
        input=text,
        capture_output=True,
        check=False,
        text=True,
        timeout=PATIENCE,
    )
    assert "Traceback" not in found.stderr, found.stderr
    return found.returncode, json.loads(found.stdout), time.monotonic() - began


TEXTS = {
    "nothing": "",
    "a list": "[1, 2]",
    "lists without end": "[" * DEEP,
    "lists of great depth": "[" * 900 + "]" * 900,
    "names without end": '{"a":' * DEEP + "1" + "}" * DEEP,
    "a great power": '{"digest": 1e999999999}',
    "a great number": '{"digest": ' + "9" * 100_000 + "}",
    "no number": '{"digest": NaN}',
    "no bound": '{"digest": -Infinity}',
    "a name twice": '{"digest": 1, "digest": 2}',
    "half a letter": '{"digest": "\\ud800"}',
}


@pytest.mark.parametrize("program", mostly_slow(CHECKERS, CHECKERS[:1]), ids=lambda p: p.stem)
def test_texts_that_are_no_certificate_end_in_a_sentence(program: Path) -> None:
    for name, text in TEXTS.items():
        code, said, _ = run(program, text)
        assert code == 1 and said["accepted"] is False and said["why"], name


def roots(**changes: Any) -> dict[str, Any]:
    element = {"kind": "play", "gap": "1"}
    document = {
        "statement": STATEMENTS[Claim.ROOTS].text,
        "loop": {**FIRST_LAG, "element": element},
        "box": {"amplitude": ["1", "2"], "frequency": ["1", "2"]},
        "claim": {"roots": 0, "undecided": 0},
        "evidence": {"roots": [], "cover": ["."]},
    }
    return {**document, **changes}


def with_number(text: str) -> list[dict[str, Any]]:
    """Certificates of several kinds in which a number is written in a way."""
    loop = {**FIRST_LAG, "element": {"kind": "odd_pieces", "slope": "0", "bends": [], "jumps": [["1", text]]}}
    cells = {"claim": {"cells": 1, "cycles": []}, "evidence": {"cover": ".", "order": [0], "forms": []}}
    absence = {
        "claim": {"sector": ["0", "1"], "multiplier": "0"},
        "evidence": {"multiplier": "0", "polynomials": [[text]]},
    }
    return [
        roots(loop={**FIRST_LAG, "num": [text], "element": {"kind": "cube", "scale": text}}),
        {"statement": STATEMENTS["cycles"].text, "loop": loop, **cells},
        {"statement": "no periodic motion but rest", "loop": {**loop, "num": [["1"]], "den": [loop["den"]]}, **absence},
    ]


@pytest.mark.parametrize(
    "text",
    mostly_slow(
        ["1e999999999", "1/1e999999999", "9" * 5000, "1_000", "\u0661", "1/0", "nan", "--1", ""],
        ["1e999999999", "1_000", "1/0", "nan"],
    ),
)
def test_numbers_are_written_in_one_way(text: str) -> None:
    for document in with_number(text):
        code, said, took = run(of_text(document["statement"]).program, json.dumps(sealed(document)))
        assert code == 1 and not said["accepted"] and took < PATIENCE


@pytest.mark.parametrize("mark", mostly_slow(["?", "a", "w", "."], ["?"]))
def test_a_cover_of_millions_of_boxes_is_refused_at_once(mark: str) -> None:
    document = roots(evidence={"roots": [], "cover": [mark * 3_000_000]})
    ring = {"ring": [{n: x for n, x in document["loop"].items() if n != "time_step"}], "means": []}
    other = {**document, "statement": STATEMENTS["balance"].text, "loop": ring}
    element = {"kind": "odd_pieces", "slope": "0", "bends": [], "jumps": [["1", "1"]]}
    loop, claim = {**FIRST_LAG, "den": ["1", "2", "1", "0"], "element": element}, {"cells": 1, "cycles": []}
    cells = {"claim": claim, "evidence": {"cover": "v" * 3_000_000, "order": [0], "forms": []}}
    for part in (document, other, {"statement": STATEMENTS["cycles"].text, "loop": loop, **cells}):
        code, said, _ = run(of_text(part["statement"]).program, json.dumps(sealed(part)))
        assert code == 1 and "characters" in said["why"]


def tree(depth: int) -> str:
    """A cover of empty boxes, each cut in halves so many times."""
    return "aw"[depth % 2] + tree(depth - 1) * 2 if depth else "."


def test_an_element_of_many_bends_under_many_boxes_is_refused_at_once() -> None:
    bends = [[f"1/{k + 2}", "1"] for k in range(10_000)]
    element = {"kind": "odd_pieces", "slope": "0", "bends": bends, "jumps": []}
    loop = {**FIRST_LAG, "den": ["1", str(10**12)], "element": element}
    document = roots(loop=loop, evidence={"roots": [], "cover": [tree(13)]})
    ring = {"ring": [{n: x for n, x in loop.items() if n != "time_step"}], "means": []}
    for part in (document, {**document, "statement": STATEMENTS["balance"].text, "loop": ring}):
        code, said, _ = run(of_text(part["statement"]).program, json.dumps(sealed(part)))
        assert code == 1 and "a cover of more than" in said["why"]


def test_polynomials_of_many_digits_are_refused_at_once() -> None:
    """Each within what a number may have: their chain of remainders would take minutes."""
    row = [str(3**700 + k) for k in range(45)]
    element = {"kind": "odd_pieces", "slope": "0", "bends": [["1", "1"]], "jumps": []}
    document = {
        "statement": STATEMENTS[Claim.ABSENCE].text,
        "loop": {**FIRST_LAG, "num": [row], "den": [["1", *row]], "element": element},
        "claim": {"sector": ["0", "1"], "multiplier": "0"},
        "evidence": {"multiplier": "0", "polynomials": [row]},
    }
    code, said, _ = run(of_text(document["statement"]).program, json.dumps(sealed(document)))
    assert code == 1 and "a polynomial of more than" in said["why"]


def absence(**loop: Any) -> dict[str, Any]:
    """A file that claims the circle criterion for a sector from 0 to 1."""
    element = {"kind": "odd_pieces", "slope": "0", "bends": [["1", "1"]], "jumps": []}
    polynomials = [["1"]] * 3 ** (len(loop.get("num", "1")).bit_length() - 1)
    return {
        "statement": STATEMENTS[Claim.ABSENCE].text,
        "loop": {**FIRST_LAG, "num": [["1"]], "den": [["1", "1"]], "element": element, **loop},
        "claim": {"sector": ["0", "1"], "multiplier": "0"},
        "evidence": {"multiplier": "0", "polynomials": polynomials},
    }


def many(count: int, base: int) -> list[str]:
    """Fractions whose denominators have no factor in common, but for a few."""
    return [f"1/{base + 6 * k + 1}" for k in range(count)]


SAMPLED = {"time_step": "1", "delay": "60"}


@pytest.mark.parametrize(
    ("loop", "why"),
    [
        ({"num": [many(50, 10**16)] * 8, "den": [["1", *many(57, 10**16)]] * 8}, "polynomials of 8 corners with more"),
        (
            {"num": [["1"] * 40] * 8, "den": [["1"] * 50] * 8, **SAMPLED, "delay": "20"},
            "polynomials of 8 corners with more",
        ),
        ({"num": [many(50, 10**30)], "den": [["1", *many(57, 10**30)]], **SAMPLED}, "a polynomial of more than"),
        (
            {
                "element": {
                    "kind": "odd_pieces",
                    "slope": "0",
                    "bends": [[str(k), "1"] for k in range(6000)],
                    "jumps": [],
                }
            },
            "an element of more than 800 bends",
        ),
        (
            {
                "element": {
                    "kind": "odd_pieces",
                    "slope": "0",
                    "bends": [*map(list, zip(many(700, 10**29), many(700, 10**30), strict=True))],
                    "jumps": [],
                }
            },
            "an element of more than 800 bends, or 40000 characters",
        ),
    ],
)
def test_a_criterion_that_would_take_minutes_is_refused_in_seconds(loop: dict[str, Any], why: str) -> None:
    document = absence(**loop)
    code, said, _ = run(of_text(document["statement"]).program, json.dumps(sealed(document)))
    assert code == 1 and why in said["why"]


def test_an_elbow_of_many_digits_is_refused_at_once() -> None:
    """Each within what other checkers read: its chain of remainders would take minutes."""
    many_digits = f"{10**200 + 1}/{10**200}"
    document = {
        "statement": STATEMENTS["elbow"].text,
        "loop": dict.fromkeys(STATEMENTS["elbow"].functions().NAMES, many_digits),
        "claim": {"backlash": many_digits},
        "evidence": {"mu": "1", "sigma": "1/2", "n": ["1", "1", "1"], "d": ["1", "1", "1", "1", "1"]},
    }
    code, said, _ = run(of_text(document["statement"]).program, json.dumps(sealed(document)))
    assert code == 1 and "a number that is none" in said["why"]


@pytest.mark.parametrize("exponent", [6, 12, 300])
def test_a_slow_pole_ends_in_a_sentence(exponent: int) -> None:
    """In the units of the fast one a crossing comes after a time without end."""
    slow = f"1/{10**exponent}"
    den = ["1", str(1 + 10**exponent) + f"/{10**exponent}", slow, "0"]
    loop = {
        **FIRST_LAG,
        "den": den,
        "element": {"kind": "odd_pieces", "slope": "0", "bends": [], "jumps": [["1", "1"]]},
    }
    cells = {"claim": {"cells": 1, "cycles": []}, "evidence": {"cover": ".", "order": [0], "forms": []}}
    document = {"statement": STATEMENTS["cycles"].text, "loop": loop, **cells}
    code, said, _ = run(of_text(document["statement"]).program, json.dumps(sealed(document)))
    assert code == 1 and said["why"]


@pytest.mark.parametrize("rate", ["1000000000000", str(10**300)])
def test_arcs_of_endless_pieces_end_in_a_sentence(rate: str) -> None:
    """A state that turns round and round, and a guard that is nearly reached each time."""
    arc = {
        "rate": [["0", f"-{rate}", "0"], [rate, "0", "0"], ["0", "0", "0"]],
        "guards": [["0", "1", "-2"], ["1", "0", "-2"]],
        "on_rates": [False, False],
        "fired": 0,
        "jump": [["1", "0", "0"], ["0", "1", "0"], ["0", "0", "1"]],
        "levels": [],
        "at_once": False,
    }
    course = {**COURSE, "unknown": [0, 1], "basis": [["1", "0"], ["0", "1"]]}
    ones = {
        "solution": ["1", "0", "1"],
        "sizes": ["1", "1", "1"],
        "weights": ["1", "1"],
        "radius": "1/1000",
        "box": "1/10",
    }
    document = {
        "statement": STATEMENTS["orbit"].text,
        "loop": {"arcs": [arc], "course": course},
        "claim": {"events": 1, "period": ["1", "1"], "box": "1/10"},
        "evidence": ones,
    }
    code, said, _ = run(of_text(document["statement"]).program, json.dumps(sealed(document)))
    assert code == 1 and said["why"]


def test_arcs_of_many_pieces_and_states_end_in_a_sentence() -> None:
    """A ramp to its guard and back, beside states that decay, two of which turn ten thousand times as fast."""
    size, rate = 50, [[0] * 51 for _ in range(51)]
    rate[0][50] = 1
    for i in range(1, 50):
        rate[i][i] = -1
    rate[1][2], rate[2][1] = -10_000, 10_000
    eye = [[int(i == j) for j in range(51)] for i in range(51)]
    arc = {
        "rate": [[str(v) for v in row] for row in rate],
        "guards": [["1", *["0"] * 49, "-1"], [*["0"] * 49, "1", "-2"]],
        "on_rates": [False, False],
        "fired": 0,
        "jump": [["0"] * 51, *([str(v) for v in row] for row in eye[1:])],
        "levels": [],
        "at_once": False,
    }
    document = {
        "statement": STATEMENTS["orbit"].text,
        "loop": {"arcs": [arc], "course": COURSE},
        "claim": {"events": 1, "period": ["1", "1"], "box": "1/1000000000"},
        "evidence": {
            "solution": ["0"] * size + ["1"],
            "sizes": ["1"] * 51,
            "weights": ["1"] * size,
            "radius": "1/1000000000000",
            "box": "1/1000000000",
        },
    }
    code, said, _ = run(of_text(document["statement"]).program, json.dumps(sealed(document)))
    assert code == 1 and "products" in said["why"]


@pytest.mark.parametrize(("rows", "count"), [(2, 2000), (150, 2)])
def test_arcs_of_many_unknowns_are_refused_at_once(rows: int, count: int) -> None:
    ones = [[str(int(i == j)) for j in range(rows)] for i in range(rows)]
    arc = {
        "rate": [*ones[:-1], ["0"] * rows],
        "guards": [["1"] * rows],
        "on_rates": [False],
        "fired": 0,
        "jump": ones,
        "levels": [],
        "at_once": False,
    }
    document = {
        "statement": STATEMENTS["orbit"].text,
        "loop": {"arcs": [arc] * count, "course": COURSE},
        "claim": {"events": count, "period": ["1", "1"], "box": "1/10"},
        "evidence": {
            "solution": ["1"] * (rows * count),
            "sizes": ["1"] * rows,
            "weights": ["1"] * ((rows - 1) * count),
            "radius": "1/1000",
            "box": "1/10",
        },
    }
    code, said, _ = run(of_text(document["statement"]).program, json.dumps(sealed(document)))
    assert code == 1 and "unknowns" in said["why"]


def test_a_checker_runs_beside_files_with_the_names_of_the_standard_library(tmp_path: Path) -> None:
    """Without -I, from its own folder and from another, where the names of modules stand for something else."""
    document = json.dumps(sealed(roots(evidence={"roots": [], "cover": ["?"]}, claim={"roots": 0, "undecided": 1})))
    for name in ("numbers", "json", "fractions", "decimal", "re", "math", "operator", "enum", "typing"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('not this one')\n")
    for program in CHECKERS:
        own = Path(shutil.copy(program, tmp_path))
        for place in (own, program):
            code, said, _ = run(place, document if program.stem == "check_roots" else "{}")
            assert said["accepted"] is (program.stem == "check_roots") and code == (program.stem != "check_roots")


def test_the_text_of_a_refusal_obeys_no_terminal(tmp_path: Path) -> None:
    path = tmp_path / "file.json"
    document = roots()
    path.write_text(json.dumps(sealed({**document, "loop": {**document["loop"], "\x1b[2J": "1"}})))
    found = epp.check_certificate(path)
    assert not found.accepted and "not known" in found.message and "\x1b" not in found.message


def test_checkers_read_files_in_the_same_way() -> None:
    """What stands between the hostile and the proof is one text, copied."""

    def reader(program: Path) -> str:
        text = program.read_text()
        return text[text.index("class Refused") : text.index('    return document["loop"], document["claim"]')]

    assert len({reader(program) for program in CHECKERS}) == 1


def test_a_file_is_read_as_far_as_its_own_checker_reads(tmp_path: Path) -> None:
    """What decides which checker is meant refused long files that their checkers take."""
    path = tmp_path / "file.json"
    document = sealed(roots(evidence={"roots": [], "cover": ["?"]}, claim={"roots": 0, "undecided": 1}))
    path.write_text(json.dumps(document) + " " * 500_000)
    assert epp.check_certificate(path).accepted
    path.write_text(json.dumps(document) + " " * 3_000_000)
    assert "more than 2000000 characters" in epp.check_certificate(path).message


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes of this system")
def test_what_is_no_file_is_refused_at_once(tmp_path: Path) -> None:
    """A pipe without a writer waits, and a device that writes zeros filled the memory."""
    os.mkfifo(tmp_path / "pipe")
    for path, what in ((tmp_path / "pipe", "is not a file"), (tmp_path, "is a folder"), ("/dev/zero", "is not a file")):
        with pytest.raises(epp.EppError, match=f"{what}; expected the file of a certificate"):
            epp.check_certificate(path)
