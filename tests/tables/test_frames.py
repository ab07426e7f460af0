"""Results as tables: the same cells as HTML and as text, and texts of a case stay texts."""

from __future__ import annotations

import html
import re
from dataclasses import replace

import pytest

import eppanalysis as epp
from eppanalysis.cli.cycles import _show_cycles
from eppanalysis.errors import EppError
from eppanalysis.tables.console import ladder_table, rungs_table
from tests.synthetic import cycle, prediction, trajectory


def cells(table) -> list[str]:
    """Cells of the HTML, in reading order."""
    found = re.findall(r"<t[hd] [^>]*>(.*?)</t[hd]>", table._repr_html_(), re.DOTALL)
    return [html.unescape(text).strip() for text in found]


@pytest.mark.parametrize("what", [trajectory(), prediction(), [cycle()], epp.case("fig8a_original")])
def test_html_and_text_hold_the_same_words(what):
    table = epp.table(what)
    words = " ".join(cells(table)).split()
    assert words
    assert sorted(words) == sorted(re.sub("─+", "", str(table)).split())


def test_texts_of_a_case_are_escaped():
    case = epp.case("fig8a_original").with_values({"lock_pin.backlash": {"value": "1 deg", "note": "<b>&=1+1</b>"}})
    shown = epp.table(case)._repr_html_()
    assert "&lt;b&gt;&amp;=1+1&lt;/b&gt;" in shown and "<b>" not in shown


def test_triggers_are_in_units_that_people_read():
    triggers = [
        epp.Trigger("theta", 0.01, 0.0, 0.01, 0.02, unit="rad"),
        epp.Trigger("harness_position", float("nan"), 0.0, float("nan"), 0.03, unit="m"),
        epp.Trigger("x0", 0.2, 0.1, 0.2, 0.3),
    ]
    assert cells(epp.table(triggers))[3:] == [
        *("theta [deg]", "0.573", "1.146"),
        *("harness position [mm]", "nothing tried starts one", "30"),
        *("state x0 [SI unit]", "0.2", "0.3"),
    ]


def test_no_table_of_results_shows_a_name_as_it_is_typed():
    """Nor does one put the unit before what it is of."""
    ladder = epp.ladder(epp.case("backlash_servo_unseen"))
    renamed = {name: name + "_of_motor" for name in ("x", "y")}

    def rename(found):
        parts = {"mean": found.mean, "peak_to_peak": found.peak_to_peak, "waveform": found.waveform}
        changed = {part: {renamed[n]: value for n, value in values.items()} for part, values in parts.items()}
        return replace(found, **changed, units=dict.fromkeys(renamed.values(), "m"))

    tables = [
        epp.table([rename(ladder.run.limit_cycle)]),
        epp.table([epp.Trigger("x_of_motor", 1.0, 0.9, 1.1, 2.0, unit="m")]),
        epp.table(replace(ladder.run, status=epp.Status.SETTLED, limit_cycle=None, settled_at={"x_of_motor": 1.0})),
    ]
    for shown in map(str, tables):
        assert "x of motor" in shown and "_" not in shown, shown


def test_an_estimate_that_cannot_tell_is_explained_beside_the_table():
    wrong, small = (epp.table([replace(cycle(), error_estimate=share)]) for share in (2.6, 0.02))
    sentence = "the estimate does not give the size of the error"
    assert sentence in html.unescape(wrong._repr_html_())
    assert sentence in " ".join(str(wrong).split())
    assert sentence not in small._repr_html_() and "cannot say" not in str(small)


def test_errors_of_the_rungs_have_one_format():
    ladder = epp.ladder(epp.case("relay_ideal_khalil79"))
    (periods, sizes) = (rungs_table(ladder).columns[i] for i in (4, 5))
    shown = [text for column in (periods, sizes) for text in column.cells]
    assert all(text in ("exact", "-") or text.endswith(" %") for text in shown), shown
    assert "< 0.01 %" in shown and not any("e-" in text for text in shown), shown


def test_what_errors_are_taken_against_is_exact_and_no_other_error_is_none_at_all():
    """A run that ends on the exact cycle to the last digit was off by "0 %" from it."""
    ladder = epp.ladder(epp.case("relay_ideal_khalil79"))
    own = replace(ladder.rows[-1], errors={"period": 0.0, "peak-to-peak": 0.0})
    assert own.method == "simulation" and [own.error_of(name) for name in own.errors] == ["exact"] * 2
    assert replace(own, errors={"period": 1e-9, "peak-to-peak": 0.0}).error_of("peak-to-peak") == "< 0.01 %"
    whole = replace(ladder, rows=(*ladder.rows[:-1], own))
    assert whole.in_brief().set_index("method").loc["simulation", "error of period"] == "exact"


def test_many_unstable_cycles_of_the_search_alone_are_one_row():
    """Chaos has dozens; what other methods know, and what is stable, keeps its rows, and a few keep theirs."""
    ladder = epp.ladder(epp.case("relay_deadzone"))
    lone = next(row for row in ladder.rows if row.exact is not None and row.method == "exact orbit, unstable")
    known = len(rungs_table(ladder).rows)
    for n, rows in ((2, 2), (7, 1)):
        more = tuple(replace(lone, exact=100 + i) for i in range(n))
        shown = rungs_table(replace(ladder, rows=(*ladder.rows, *more)))
        assert len(shown.rows) == known + rows, n
    assert list(shown.columns[0].cells)[-1] == "7 more"


def test_nothing_found_is_said():
    assert cells(epp.table(())) == ["none"]


def test_provenance_says_how_long_a_run_is_in_words_and_with_its_unit():
    shown = cells(epp.table(epp.simulate(epp.case("backlash_servo"), t_end=60.0).provenance))
    assert "settings: length of the run" in shown and "60 s" in shown
    assert not [text for text in shown if "t end" in text or "_" in text.partition(":")[2]]


def test_provenance_leaves_the_parameters_to_their_own_table():
    shown = cells(epp.table(epp.case("fig8a_original").provenance()))
    assert "sha256" in shown and not any("backlash" in text for text in shown)


@pytest.mark.parametrize("what", ["a text", 3, [1, 2], object()])
def test_what_has_no_table_is_refused(what):
    with pytest.raises(EppError, match="table: there is none of"):
        epp.table(what)


def test_of_a_signal_that_stands_still_no_size_is_shown():
    """A setpoint of 5 deg had a peak to peak of 1e-13 deg, and its mean an error of -21 % of that."""
    ladder = epp.ladder(epp.case("relay_ideal_khalil79"))
    rounded = {"peak_to_peak": 1.7e-15, "fundamental": -1.0, "mean": -0.21}

    def still(cycle):
        return replace(cycle, peak_to_peak={**cycle.peak_to_peak, "y": 1.7e-15}, mean={**cycle.mean, "y": 0.087})

    rows = tuple(replace(row, cycle=row.cycle and still(row.cycle)) for row in ladder.rows)
    shown = ladder_table(replace(ladder, rows=rows, errors={**ladder.errors, "y": rounded}))
    row = list(shown.columns[0].cells).index("y peak to peak")
    spans = [list(column.cells)[row] for column in shown.columns[1:]]
    assert set(spans[:-1]) == {"0"} and spans[-1] == "-"


def test_sentences_below_a_table_stay_in_view_where_it_is_pushed_about():
    """On a phone a wide table has a window of its own: sentences as wide as it were cut off at the window's edge."""
    shown = epp.table(epp.predict_limit_cycles(epp.case("backlash_servo")))._repr_html_()
    caption = shown[shown.index("<caption") : shown.index("</caption>")]
    assert "may not exist: " in caption and "position: sticky; left: 0; max-width: min(46em, 90vw)" in caption


def test_what_is_to_be_known_of_a_cycle_is_told_with_it(capsys):
    """Of one whose turns differ by a fifth a size alone would be taken for exact."""
    case = epp.case("relay_hyst_servo")
    search, note = epp.find_limit_cycles(case), "not locked to the samples of 0.001 s: its states came back to 19 %"
    (cycle,) = search
    assert note not in str(epp.table([cycle]))
    noted = replace(cycle, note=note)
    assert " ".join(f"cycle 1: {note}".split()) in " ".join(str(epp.table([noted])).split())
    _show_cycles(case, replace(search, cycles=(noted,)))
    assert capsys.readouterr().out.rstrip().endswith(note)
