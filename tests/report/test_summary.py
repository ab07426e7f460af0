"""The first page of a report: what it says of a loop that oscillates, and of one that rests."""

from __future__ import annotations

import ast
import math
import re
from dataclasses import replace
from types import SimpleNamespace

import pytest

import eppanalysis as epp
from eppanalysis.cases import variation_of
from eppanalysis.cases.command_line import Commands
from eppanalysis.report import sections, summary
from eppanalysis.report.advice import Found, printed
from tests.made_bounds import GAIN, wheelchair
from tests.shared import conveyor, mostly_slow


def test_a_loop_that_oscillates_is_told_how_far_its_parameter_must_go():
    case = wheelchair()
    run = epp.simulate(case)
    branch = epp.continue_branch(case, "loop.gain", start=1.0, stop=0.6)
    page = epp.first_page(case, run, branch=branch)
    assert page.verdict == f"Oscillates: {run.limit_cycle.size_of(case.expected.signal)}."
    # The fold is at 0.84625...: one per cent to the safe side, rounded down; the same number in both, as in a manual.
    assert 0.99 * GAIN > 0.83 and GAIN > 0.84625
    number = "0.83 (exact 0.8462)"
    assert page.numbers[2] == ("loop gain at which the oscillation ends", number, "fold of its exact branch")
    assert page.advice.startswith(f"Bring the loop gain from 1 under {number}: there this oscillation does not exist.")
    assert dict(page.known)["Proved"].startswith("Nothing: no proof was requested, or none covers")
    assert page.picture.startswith(b"\x89PNG") and 'class="numbers"' in page._repr_html_()


def test_of_a_driven_loop_it_is_said_that_proofs_are_of_held_inputs():
    case = epp.case("fig8a_original")
    sine = {"kind": "sine", "amplitude": "2 mm", "frequency": "1 Hz"}
    case = case.with_values({"run.input": sine, "run.t_end": "2 s"})
    said = dict(epp.first_page(case, epp.simulate(case)).known)["Proved"]
    assert said.endswith("Proofs are of inputs that are held; here harness_position is a sine.")


def test_a_loop_that_rests_is_told_what_was_not_looked_at():
    case = wheelchair().with_values({"loop.gain": 0.5})
    page = epp.first_page(case, epp.simulate(case))
    assert page.verdict == "Comes to rest from its own start; other starts were not tried."
    assert page.advice == "Nothing, at these values." and page.numbers[0][0] == "at rest from"
    assert page.numbers[1][0].endswith(" at rest")


@pytest.mark.parametrize(
    ("gain", "words"), [(0.5, "no periodic motion but rest"), (0.84, "Nothing: no sentence here"), (1.0, "exists")]
)
def test_the_page_says_which_sentence_is_a_theorem(gain, words):
    pytest.importorskip("flint")
    case = wheelchair().with_values({"loop.gain": gain})
    run = epp.simulate(case)
    loop = epp.LureSystem.from_tf(([gain], [1.0, 2.0, 2.0, 1.0]), epp.Saturation(), name="limited")
    proof = epp.certify_orbit(case, run.limit_cycle) if run.limit_cycle else epp.certify(loop, "absence")
    if words.startswith("Nothing"):
        proof = epp.certify(case, "absence")
    said = dict(epp.first_page(case, run, proof=proof).known)["Proved"]
    assert words in said
    assert said.endswith("This sentence is a theorem, all others here are computed.") == proof.proved


def test_a_proof_that_was_refused_is_not_advised():
    case = epp.case("fig8b_reduced_backlash")
    run, cycles = epp.simulate(case), epp.find_limit_cycles(case)
    refused = epp.certify(epp.case("stiction_deadband_none"), "absence")
    assert not refused.proved and not len(cycles)
    for proof in (refused, None):
        advice = epp.first_page(case, run, cycles=cycles, proof=proof).advice
        assert advice == "Nothing, at these values. The search is thorough and no proof."


def test_a_run_that_is_too_short_does_not_take_back_what_the_search_found():
    case = epp.case("sat_khalil710").with_values({"run.t_end": "1 s"})
    run, cycles = epp.simulate(case), epp.find_limit_cycles(case)
    page = epp.first_page(case, run, cycles=cycles)
    assert run.status is epp.Status.UNDECIDED and cycles.headline().startswith("Oscillates")
    assert page.verdict == f"{cycles.headline()}. Its own run was on none of them by its end, after 1 s."
    assert dict(page.known)["Searched"].startswith(cycles.headline())
    assert [value.split()[-1] for _, value, _ in page.numbers[1:]] == ["Hz", "s"]
    largest = 'design sat_khalil710 --set "run.t_end=1 s" --maximise loop.gain --tune "loop.gain 0.05..2"'
    assert page.advice.splitlines() == [
        f"Compute how far a parameter must go: eppanalysis {largest}",
        'Why it oscillates, and what ends it: eppanalysis cycles sat_khalil710 --set "run.t_end=1 s" --remedies',
    ]


def test_what_a_search_left_open_is_no_all_clear():
    case = epp.case("virtual_spring")
    run, cycles = epp.simulate(case), epp.find_limit_cycles(epp.case("fig8b_reduced_backlash"))
    opened = replace(cycles, left_open=("1 run neither settled nor repeated itself",))
    assert opened.left_open and not cycles.left_open and not len(cycles)
    sure, unsure = (epp.first_page(case, run, cycles=search).advice for search in (cycles, opened))
    assert sure.startswith("Nothing, at these values. The search is thorough")
    longer = f'eppanalysis simulate virtual_spring --set "run.t_end={10 * case.t_end:g} s"'
    assert unsure == (f"Nothing from its own start; other starts are undecided. Simulate for longer: {longer}")


@pytest.mark.parametrize(
    ("name", "samples"), [("azimuth_servo", 40_000), ("virtual_spring", 80_000), ("wheelchair", 0)]
)
def test_runs_of_a_map_go_through_two_million_samples_at_most_and_a_coarse_map_says_what_it_is(name, samples):
    """Four times the run of 10 s at 1 kHz a cell, and of 20 s, would take minutes on the usual grid."""
    code = sections._map(epp.case(name))
    axes = ast.literal_eval(code.partition("axes = ")[2].partition("\n")[0])
    along = [int(text.split(":")[2]) for text in axes.values()]
    assert math.prod(along) * samples <= 2e6 and min(along) >= 5
    assert (f"The map has {along[0]} by {along[1]} cells" in code) == (along != [9, 9]) == (samples > 0)


def test_a_run_that_is_undecided_is_no_all_clear_either():
    case = wheelchair().with_values({"loop.gain": 0.5, "run.t_end": "0.5 s"})
    run, cycles = epp.simulate(case), epp.find_limit_cycles(epp.case("fig8b_reduced_backlash"))
    assert run.status is epp.Status.UNDECIDED and not len(cycles) and not cycles.left_open
    page = epp.first_page(case, run, cycles=cycles)
    known = "No start of the search oscillates; its own run is not at rest by its end, and may creep on. "
    longer = 'eppanalysis simulate wheelchair --set loop.gain=0.5 --set "run.t_end=5 s"'  # one value, the longer
    assert page.advice == f"{known}Simulate for longer: {longer}"


def test_a_run_beside_an_unstable_cycle_alone_is_no_oscillation_to_end():
    case = wheelchair()
    unstable = SimpleNamespace(stable=(), __len__=lambda: 1)
    run = SimpleNamespace(limit_cycle=None, status=epp.Status.UNDECIDED)
    for branch in (None, epp.continue_branch(case, "loop.gain", start=1.0, stop=0.9)):
        said = Found(Commands.of(case), run, unstable, branch, None, None).advice()
        assert said.startswith("Change the loop until its own run settles")


def test_a_proof_that_is_refused_says_why():
    case = epp.case("virtual_spring")
    with pytest.raises(epp.EppError) as refused:
        epp.certify(case, "absence")
    page = epp.first_page(case, epp.simulate(case), proof=refused.value)
    said = dict(page.known)["Proved"].lower()
    assert said.startswith("nothing: no sentence here is a theorem.") and str(refused.value).lower() in said
    assert "certify" not in page.advice


def test_a_branch_of_other_cycles_is_no_end_of_the_oscillation(tmp_path):
    """It was advised to keep the gain above where a branch ends that does not come to the loop's own gain, 3."""
    case = conveyor(tmp_path)
    run, cycles = epp.simulate(case), epp.find_limit_cycles(case)
    branch = epp.continue_branch(case, "pid.kp", start=0.75, stop=2.0)
    assert run.status.name == "SETTLED" and cycles.stable and branch.points["value"].max() == pytest.approx(2.0)
    page = epp.first_page(case, run, None, cycles, branch)
    assert page.numbers[2][0] == "period of the oscillation"
    assert "Keep" not in page.advice and page.advice.startswith("Compute how far a parameter must go: ")


def test_a_report_follows_the_cycle_that_the_search_found(tmp_path):
    case = conveyor(tmp_path)
    code = sections._FOLLOW.format(name="pid.kp", near="3 N*m/rad", far="12 N*m/rad", stop="0.75 N*m/rad")
    here = {"epp": epp, "case": case, "run": epp.simulate(case), "cycles": epp.find_limit_cycles(case)}
    exec(code, here)
    values = here["branch"].points["value"]
    assert values[0] == 3.0 and here["branch"].points["period"][0] == pytest.approx(here["cycles"][-1].period, rel=1e-9)


@pytest.mark.parametrize(
    ("name", "parameter"), mostly_slow([("elbow", "lock_pin.backlash"), ("x15_flare", "Kp")], [("x15_flare", "Kp")])
)
def test_beyond_the_limit_that_is_advised_the_branch_has_no_cycle(name, parameter):
    """The elbow's branch turns three times: its oscillation went on under the fold that was advised."""
    case = epp.case(name)
    start, _, stop = (case.text(parameter, value) for value in variation_of(case).branch(parameter))
    branch = epp.continue_branch(case, parameter, start=start, stop=stop)
    end = summary._nearest_end(case, branch)
    kept, exact = re.fullmatch(r"under (.*) \(exact (.*)\)", printed(case, branch, end)).groups()
    safe, near = case.si(parameter, kept), case.si(parameter, exact)
    assert safe < near < branch.points["value"].min() and near < end.value < 1.001 * near and end.value < 1.04 * safe
