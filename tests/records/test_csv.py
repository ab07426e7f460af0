"""CSV files as they come: every malformed one is a sentence with its place; long ones stay in bounded memory."""

from __future__ import annotations

import resource

import numpy as np
import pytest
from hypothesis import given, strategies as st

from eppanalysis.errors import CaseError
from eppanalysis.identify.columns import ROLES
from eppanalysis.records import reading
from eppanalysis.records.columns import parse_choice
from eppanalysis.records.reading import read_recording

HEADER = b"time [s],force [lbf],voltage [V]\n"
ROWS = b"".join(b"%d,%d,%.3f\n" % (i, i, 2 * i) for i in range(20))

#: What is wrong: the file, where the sentence points, what it expects.
BAD = {
    "empty": (b"", "is 'empty'", "a header"),
    "header only": (HEADER, "0 rows long", "8 or more complete rows"),
    "single row": (HEADER + b"0,1,2\n", "1 row long", "8 or more complete rows"),
    "binary": (bytes(range(256)) * 40, "binary", "UTF-8"),
    "zero bytes": (HEADER + ROWS + b"\0\0", "binary", "UTF-8"),
    "UTF-16": ("time [s],force [N]\n1,2\n".encode("utf-16"), "binary", "UTF-8"),
    "Latin-1": ("time [s],force [N],voltage [V],°\n0,1,2,3\n".encode("latin-1"), "not UTF-8", "UTF-8"),
    "NaN": (HEADER + ROWS + b"20,nan,3\n", "line 22, force is 'nan'", "leave the cell empty"),
    "infinity": (HEADER + ROWS + b"20,inf,3\n", "line 22, force is 'inf'", "a finite number"),
    "overflow": (HEADER + ROWS + b"20,1e400,3\n", "line 22, force is '1e400'", "a finite number"),
    "a text": (HEADER + ROWS + b"20,abc,3\n", "line 22, force is 'abc'", "a finite number"),
    "a formula": (HEADER + ROWS + b"20,=A1,3\n", "line 22, force is '=A1'", "a finite number"),
    "magnitude": (HEADER + ROWS + b"20,1e300,3\n", "line 22, force is '1e300'", "an ordinary magnitude"),
    "duplicate time": (HEADER + ROWS + b"19,1,3\n", "line 22, time is '19'", "not the same"),
    "time backwards": (HEADER + ROWS + b"3,1,3\n", "line 22, time is '3'", "it runs backwards"),
    "time missing": (HEADER + ROWS + b",1,3\n", "line 22, time is missing", "a time in every row"),
    "short row": (HEADER + ROWS + b"20,1\n", "line 22 is '2 cells long'", "3 cells"),
    "long row": (HEADER + ROWS + b"20,1,2,3\n", "line 22 is '4 cells long'", "3 cells"),
    "two commas": (HEADER.replace(b",", b";") + b"0;1,500,5;2\n" * 20, "line 2, force is '1,500,5'", "a finite number"),
    "point, comma": (
        HEADER.replace(b",", b";") + b"0;1.500,5;2\n" * 20,
        "line 2, force is '1.500,5'",
        "a finite number",
    ),
    "open quotation": (HEADER + ROWS + b'20,"1,2\n', "line 22", "quotation marks"),
    "holes": (HEADER + b"".join(b"%d,,\n" % i for i in range(40)), "40 of them with empty cells", "fewer than half"),
    "no header": (ROWS, "line 1 is '0,0,0.000'", "a header"),
    "missing column": (HEADER.replace(b"force", b"load") + ROWS, "line 1, force", "--signal force="),
    "no unit": (b"time [s],force,voltage [V]\n" + ROWS, "line 1, force is 'force'", "a unit with it"),
    "units mixed up": (b"time [s],force [V],voltage [lbf]\n" + ROWS, "line 1, force is 'force [V]'", "a force"),
    "a mass": (b"time [s],force [lb],voltage [V]\n" + ROWS, "line 1, force is 'force [lb]'", "write lbf"),
    "unknown unit": (b"time [s],force [parrot],voltage [V]\n" + ROWS, "'force [parrot]'", "a known unit"),
    "column twice": (b"force [N],force [lbf],voltage [V]\n" + ROWS, "at once", "one column"),
    "carriage returns": ((HEADER + ROWS).replace(b"\n", b"\r"), "line 1", "a line feed"),
    "one long line": (HEADER + b"1" * 300_000, "a line longer than", "one a line"),
}


def read(tmp_path, content: bytes, **options):
    path = tmp_path / "bench.csv"
    path.write_bytes(content)
    return read_recording(path, ("force", "voltage"), ("time",), units=ROLES, **options)


@pytest.mark.parametrize("name", BAD)
def test_malformed_files_are_one_sentence(tmp_path, name):
    content, found, expected = BAD[name]
    with pytest.raises(CaseError) as caught:
        read(tmp_path, content)
    sentence = str(caught.value)
    assert "bench.csv" in sentence
    assert found in sentence
    assert expected in sentence
    assert "\n" not in sentence
    assert len(sentence) < 500


@pytest.mark.parametrize("path", ["/dev/zero", ".", "no_such_file.csv"])
def test_what_is_no_file_is_one_sentence(path):
    with pytest.raises(CaseError, match="expected a CSV file"):
        read_recording(path, ("force",), units=ROLES)


@pytest.mark.parametrize(
    "content",
    [
        HEADER + ROWS,
        b"\xef\xbb\xbf" + HEADER + ROWS,
        (HEADER + ROWS).replace(b"\n", b"\r\n"),
        (HEADER + ROWS).replace(b",", b";"),
        (HEADER + ROWS).replace(b",", b"\t"),
        (HEADER + ROWS).replace(b",", b";").replace(b".", b","),
        (HEADER + ROWS).replace(b",", b"\t").replace(b".", b","),
        (HEADER + ROWS)
        .replace(b",", b'";"')
        .replace(b".", b",")
        .replace(b"\n", b'"\n')
        .replace(b"\n", b'\n"')[:-1]
        .replace(b"time", b'"time', 1),
        b"# bench 3\n# ball bearing\n" + HEADER + b"\n" + ROWS + b"\n\n",
        HEADER.replace(b"[lbf]", b"(lbf)") + b"".join(b'"%d","%d","%d"\n' % (i, i, 2 * i) for i in range(20)),
    ],
)
def test_harmless_variants_read_the_same(tmp_path, content):
    found = read(tmp_path, content)
    np.testing.assert_allclose(found["time"], np.arange(20.0))
    np.testing.assert_allclose(found["force"], 4.4482216152605 * np.arange(20.0), rtol=1e-15)
    np.testing.assert_allclose(found["voltage"], 2.0 * np.arange(20.0))


def test_empty_cells_are_missing_samples(tmp_path):
    found = read(tmp_path, HEADER + ROWS + b"20,,3\n21,4,\n22,4,5\n")
    assert (len(found), found.n_rows, found.n_holes) == (21, 23, 2)
    assert found.sentences() == ["2 of 23 rows have an empty cell and were left out."]
    found = read(tmp_path, HEADER + ROWS + b"20,,3\n21,4,4\n22,4,5\n")
    assert found.sentences() == ["1 of 23 rows has an empty cell and was left out."]


def test_columns_by_choice_and_unit(tmp_path):
    content = HEADER.replace(b"force [lbf]", b"F (lbf)").replace(b"voltage [V]", b"ADC1") + ROWS
    choices = dict(
        (role, (header, unit))
        for role, header, unit in (parse_choice(t, ROLES) for t in ("force=F (lbf)", "voltage=ADC1:mV"))
    )
    found = read(tmp_path, content, columns=choices)
    assert found["force"][1] == pytest.approx(4.4482216152605)
    assert found["voltage"][1] == pytest.approx(2e-3)


@pytest.mark.parametrize("text", ["load", "=x:N", "colour=x:N", "force="])
def test_wrong_choices_are_one_sentence(text):
    with pytest.raises(CaseError, match="--signal is"):
        parse_choice(text, ROLES)


@given(st.lists(st.integers(1, 3000), min_size=1, max_size=8), st.integers(1, 7))
def test_blocks_keep_every_row(lengths, width):
    """Whatever the pieces: counts and sums are those of all rows, but for a last block that is less than half full."""
    blocks = reading._Blocks(1, 64)
    rows = np.arange(float(sum(lengths)))[:, None] * width
    for piece in np.split(rows, np.cumsum(lengths)[:-1]):
        blocks.add(piece)
    out = blocks.rows()
    whole = len(rows) // blocks.block
    expected = rows[: whole * blocks.block].reshape(whole, blocks.block).mean(axis=1)
    np.testing.assert_allclose(out[:whole, 0], expected)
    assert len(out) <= 2 * 64 + 1
    assert len(out) - whole in (0, 1)


def test_long_files_stay_in_bounded_memory(tmp_path):
    path = tmp_path / "long.csv"
    piece = "".join(f"%d{i:04d},{i % 7},{i % 5}.25\n" for i in range(10_000))
    with path.open("w") as stream:
        stream.write("time [ms],force [N],voltage [V]\n")
        for k in range(1, 101):
            stream.write(piece.replace("%d", str(k)))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    found = read_recording(path, ("force", "voltage"), ("time",), units=ROLES)
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    assert found.n_rows == 1_000_000
    assert len(found) * found.block >= 1_000_000 - found.block
    assert found["voltage"].mean() == pytest.approx(2.25, abs=1e-3)
    assert grown < 100  # MB; the file itself is 16 MB, its numbers as objects would be several hundred


def test_a_late_fault_of_a_long_file_is_found_in_its_line(tmp_path):
    path = tmp_path / "long.csv"
    with path.open("w") as stream:
        stream.write("time [s],force [N],voltage [V]\n")
        stream.writelines(f"{i},1,2\n" for i in range(600_000))
        stream.write("600000,1,x\n")
    with pytest.raises(CaseError, match="line 600002, voltage is 'x'"):
        read_recording(path, ("force", "voltage"), ("time",), units=ROLES)
