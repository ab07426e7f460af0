"""Why a case oscillates and what ends it: each remedy is what the printed command shows, and no more is said."""

from __future__ import annotations

import json
import shlex

import pytest
from typer.testing import CliRunner

import eppanalysis as epp
from eppanalysis.cli.commands import app


def _ran(command: str):
    """What a command prints as JSON."""
    program, *words = shlex.split(command)
    assert program == "eppanalysis"
    done = CliRunner().invoke(app, [*words, "--json"])
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout)["cases"][0]["result"]


@pytest.mark.parametrize(
    ("name", "cause", "fields"),
    [
        ("pid_hunting", "friction sticks, and integral action ends the sticking", {"friction.static"}),
        ("sat_khalil710", "the loop is unstable with a gain in place of saturation", {"loop.gain"}),
        pytest.param(
            "azimuth_servo", "the loop has no state of rest: encoder", {"elements.dead_band"}, marks=pytest.mark.slow
        ),
        pytest.param("x15_flare", "of rate limit: with a gain in its place", {"Kp"}, marks=pytest.mark.slow),
        pytest.param("light_forearm", "of bands and lock pin", {"lock_pin.backlash"}, marks=pytest.mark.slow),
    ],
)
def test_each_remedy_is_what_its_command_shows(name, cause, fields):
    found = epp.remedies(epp.case(name))
    assert str(found).startswith(f"Oscillates because {cause}") and str(found).endswith("(tested).")
    assert fields <= {remedy.field for remedy in found.remedies}
    for remedy in found.remedies:
        shown = _ran(remedy.command)
        assert shown["status"] == "converged" and not any(cycle["stable"] for cycle in shown["cycles"])
        assert shown["settles"]
        if remedy.own is not None:
            own = epp.case(name).value(remedy.field)
            typed = epp.case(name).si(remedy.field, _last(remedy.command))
            assert remedy.own == own != remedy.value == pytest.approx(typed)


def _last(command: str) -> str:
    return shlex.split(command)[-1].partition("=")[2]


def test_a_dead_band_is_put_in_before_the_controller_that_hunts():
    """Narrower than it swings; the search is asked again with the file written out, not by the command."""
    case = epp.case("pid_hunting")
    first = epp.remedies(case).remedies[0]
    assert (first.field, first.own) == ("elements.dead_band", None)
    assert str(first) == f"a dead band of ±{1e3 * first.value:.2g} mm before controller"
    text = case.to_toml().replace(
        '"-mass.position -> controller"',
        '"-mass.position -> band", "band -> controller"',
    )
    assert "band -> controller" in text
    text += f'[elements.band]\nkind = "dead_zone"\nlower = -{first.value:.2g}\nupper = {first.value:.2g}\n'
    assert not epp.find_limit_cycles(epp.case_from_text(text)).stable and epp.find_limit_cycles(case).stable


@pytest.mark.slow
def test_of_two_causes_each_of_which_does_alone_both_are_named():
    """A valve with backlash and stiction: smooth only one of them, and the level still swings."""
    found = epp.remedies(epp.case("level_valve"))
    assert found.causes == ("of linkage and stem: with gains in place of both no limit cycle is found",)
    assert not found.remedies and "lead before controller" in found.tried
    assert str(found).endswith("and no part put in (lead before controller and low pass before controller).")


def test_what_no_single_value_ends_is_told_with_what_was_tried():
    """A relay with hysteresis switches at any gain, and its loop has no other value to change."""
    found = epp.remedies(epp.case("relay_hyst_servo"))
    assert not found.remedies and found.tried == ("loop.gain",) and not found.ended
    assert str(found) == (
        "Oscillates because hysteresis relay switches, and no run comes to rest; no change of one value ends it (loop "
        "gain, from 0.1 to 10 times its value)."
    )


def test_a_loop_made_in_python_is_told_in_python():
    loop = epp.LureSystem.from_tf(([10.0], [1.0, 3.0, 2.0, 0.0]), epp.Saturation())
    found = epp.remedies(loop)
    case = epp.Case.from_system(loop)
    assert found.remedies and epp.find_limit_cycles(loop).stable
    for remedy in found.remedies:
        made = eval(remedy.command, {"epp": epp, "case": case})
        assert made.settles and not made.stable


def test_a_loop_at_rest_has_nothing_to_end():
    case = epp.case("pid_hunting").with_values({"friction.static": 1.0})
    found = epp.remedies(case)
    assert found.cycle is None and str(found) == "No stable limit cycle was found: there is nothing to end."


def test_the_command_cycles_tells_where_to_ask_and_answers():
    shown = CliRunner().invoke(app, ["cycles", "pid_hunting"]).stdout
    command = shown.strip().splitlines()[-1].partition(": ")[2]
    assert command == "eppanalysis cycles pid_hunting --remedies"
    assert {r["field"] for r in _ran(command)["remedies"]["remedies"]} >= {"elements.dead_band", "friction.static"}


@pytest.mark.slow
def test_a_bound_that_is_nowhere_says_why():
    asked = "bounds quantised_sensor_ct --over quantiser.step --limit loop.gain --points 1 --from 1 --within 0.9..1.2"
    shown = CliRunner().invoke(app, [*asked.split(), "--no-verify"]).stdout
    assert "At quantiser.step 1 it oscillates because of quantiser: with a gain in its place" in shown
