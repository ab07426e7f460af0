"""Tables of the pages on the paper: what it says, what the model says, how far apart they are."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

import eppanalysis as epp
from studies import GENERATED
from studies.pages.tables import markdown
from studies.paper import runs as made, sensitivity
from studies.paper.runs import DEGREE, LBF
from studies.paper.says import SAID

#: Weights that the tray is loaded with one by one [lbf]; how heavy the paper's were is not said.
TRAY_WEIGHTS = (0.02, 0.05, 0.1, 0.25)
AGREES, PARTLY, DIFFERS, NO_TEST = "agrees", "agrees in part", "differs", "no test"


@dataclass(frozen=True)
class Row:
    """One statement of the paper against the model.

    Attributes
    ----------
    key : str
        Of the statement.
    model, apart : str
        What the model says, and how far the two are apart.
    verdict : str
        AGREES, PARTLY, DIFFERS, or NO_TEST where the model's number was derived from the paper's.
    """

    key: str
    model: str
    apart: str
    verdict: str


def _verdict(holds: bool) -> str:
    return AGREES if holds else DIFFERS


def _percent(found: float, said: float) -> str:
    apart = f"{100 * (found / said - 1):+.1f} %"
    return "none" if float(apart.removesuffix(" %")) == 0 else apart


def _cycle(result: epp.Trajectory) -> str:
    """Outcome of a run with the numbers of its cycle."""
    steady = result.limit_cycle
    if steady is None:
        return made.outcome(result)
    return f"oscillates at {steady.frequency:.3g} Hz, {steady.peak_to_peak['theta'] / DEGREE:.3g}° peak to peak"


def steps_that_oscillate(name: str) -> int:
    """How many of the steps of a run of three still oscillate by a tenth of a degree at their end."""
    result, input_signal = made.run(name), epp.case(name).input
    ends = np.append(input_signal.times[1:], result.t[-1])
    count = 0
    for end, value in zip(ends, input_signal.values, strict=True):
        held = (result.t > end - 0.3) & (result.t < end)
        count += bool(value > 0 and np.ptp(result.signals["theta"][held]) > sensitivity.OSCILLATES)
    return count


# Figure by figure -----------------------------------------------------------------------------------------------------
def drive_rows() -> list[Row]:
    """Loaded speeds of the drive."""
    drive = epp.case("elbow").elbow_parameters.drive
    load, rows = SAID["load"].value, []
    for key, supply in (("loaded speed", drive.supply_voltage), ("own battery", SAID["battery"].value)):
        share = supply / drive.supply_voltage
        loss = (load + drive.coulomb_friction) / (share * drive.stall_torque)
        speed = share * drive.no_load_speed * (1.0 - loss) / DEGREE
        near = abs(speed / SAID[key].value - 1.0) < 0.1
        text = f"{speed:.4g} °/s, drive friction included"
        rows.append(
            Row(key, text, _percent(speed, SAID[key].value), NO_TEST if key == "loaded speed" else _verdict(near))
        )
    return rows


def tray_rows() -> list[Row]:
    """Figure 4."""
    case = epp.case("elbow")
    friction, kinetic = case.value("pulley.friction"), case.value("pulley.kinetic_ratio")
    static = made.tray(friction, 1.0)
    tests = [made.tray(friction, k, w * LBF) for k in (kinetic, 1.0) for w in TRAY_WEIGHTS]
    flats, tops = [t.flat / LBF for t in tests], [t.highest for t in tests]
    weights = f"weights of {min(TRAY_WEIGHTS):g} to {max(TRAY_WEIGHTS):g} lbf"
    bearing = made.tray(0.0, 1.0).highest
    return [
        Row(
            "tray full",
            f"{static.highest:.3g} V with static friction alone, {min(tops):.3g} to {max(tops):.3g} V with {weights}",
            f"{_percent(static.highest, SAID['tray full'].value)}; the friction coefficient was derived from it",
            NO_TEST,
        ),
        Row(
            "tray flat",
            f"constant for {min(flats):.2g} to {max(flats):.2g} lbf with {weights}",
            f"{100 * (1 - min(flats)):.0f} % below a pound at most",
            _verdict(min(flats) > 0.8 and max(flats) < 1.1),
        ),
        Row("tray bearing", f"{bearing:.3g} V", _percent(bearing, SAID["tray bearing"].value), AGREES),
    ]


def phase_rows() -> list[Row]:
    """Figure 5."""
    phase = made.paper_slip()
    case = epp.case("fig6a_original_pulley")
    _, low, high, _ = case.elbow_parameters.bands.thresholds
    harness, stuck = phase.held - phase.behind, phase.slips - phase.sticks
    period = made.run(case.name, t_end=6.0).limit_cycle.period
    stays = "still in flexion" if harness > high else "no longer in flexion"
    at_once = phase.held - phase.jump < low
    reverse, variants = sensitivity.slips_that_reverse()
    return [
        Row(
            "four phases",
            f"the pulley sticks for {1e3 * stuck:.3g} ms ({100 * stuck / period:.0f} % of a period) with the sensor at "
            f"{phase.held / LBF:.3g} lbf (flexion), while the harness side falls to {harness / LBF:.3g} lbf ({stays}); "
            f"at the slip the sensor force falls by {phase.jump / LBF:.2g} lbf, and it is in extension "
            f"{1e3 * (phase.extension - phase.slips):.3g} ms later",
            "same order of phases, but the slip alone does not turn flexion into extension: it lets the force go, and "
            f"the forearm's motion does the rest; so in {variants - reverse} of {variants} variations of what the "
            "paper leaves open",
            AGREES if at_once and harness <= high else PARTLY,
        )
    ]


def _steps_row(key: str, name: str, oscillates: bool, also: str = "") -> Row:
    count, result = steps_that_oscillate(name), made.run(name)
    says = f"{count} of 3 steps end in oscillation; {_cycle(result)}"
    return Row(key, says, also, _verdict(count == (3 if oscillates else 0)))


def pulley_rows() -> list[Row]:
    """Figure 6."""
    least = made.stable_limit(made.friction_branch())
    nominal = epp.case("elbow").value("pulley.friction")
    text = (
        f"the cycle exists above a friction coefficient of {least:.3g}, {100 * least / nominal:.0f} % of the original's"
    )
    return [
        _steps_row("original pulley", "fig6a_three_steps", True, text),
        _steps_row("ball bearing", "fig6b_three_steps", False, "the ball bearing has none in the model"),
    ]


@dataclass(frozen=True)
class Gap:
    """Equations (1) and (2) for a gap."""

    key: str
    gap: float
    excursion: float
    force: float


@cache
def gaps() -> tuple[Gap, ...]:
    """For the original and the modified lock pin."""
    found = []
    for key, name in (("large gap", "fig8a_original"), ("small gap", "fig8b_reduced_backlash")):
        p = epp.case(name).elbow_parameters
        excursion = p.pulley.radius * p.lock_pin.backlash
        found.append(Gap(key, p.lock_pin.backlash, excursion, p.cable.stiffness * excursion))
    return tuple(found)


def equations() -> str:
    """Equations (1) and (2) against the measured forces."""
    rows = [
        [
            f"{g.gap / DEGREE:.3g}°",
            f"{1e3 * g.excursion:.3f}",
            f"{g.force / LBF:.4g}",
            f"{SAID[g.key].value:g}",
            _percent(g.force / LBF, SAID[g.key].value),
            "nothing: K R was derived from it" if g.key == "large gap" else "that the cable is linear",
            SAID[g.key].place,
        ]
        for g in gaps()
    ]
    header = ["gap", "ΔX by (1) [mm]", "ΔF by (2) [lbf]", "measured [lbf]", "apart", "what it tests", "in the paper"]
    return markdown(header, rows)


def bands_touched(range_: float, change: float) -> int:
    """The most bands that an interval of force of this length reaches into [N]."""
    case = epp.case("elbow").with_values({"bands.range": range_})
    edges = np.array(case.elbow_parameters.bands.thresholds)
    starts = [*(edges - 1e-9), *(edges - change + 1e-9)]
    return max(1 + int(np.sum((edges >= s) & (edges <= s + change + 2e-9))) for s in starts)


def gap_rows() -> list[Row]:
    """Figure 7 beyond the equations."""
    large = gaps()[0].force
    share = 100 * large / (SAID["input range"].value * LBF)
    wide, narrow = (epp.case(n).value("bands.range") for n in ("fig8a_original", "fig6a_original_pulley"))
    pound = SAID["several bands"].value * LBF
    counts = bands_touched(wide, pound), bands_touched(narrow, pound)
    return [
        Row("quarter", f"{share:.3g} percent", _percent(share, SAID["quarter"].value), NO_TEST),
        Row(
            "several bands",
            f"up to {counts[0]} of 5 bands with a range of {wide / LBF:.3g} lbf, {counts[1]} with "
            f"{narrow / LBF:.3g} lbf",
            "",
            _verdict(min(counts) >= 2),
        ),
    ]


def backlash_rows() -> list[Row]:
    """Figure 8 and the gain."""
    least = made.stable_limit(made.gap_branch()) / DEGREE
    widest = made.stable_limit(made.gain_branch()) / LBF
    back = epp.case("gain_brings_it_back")
    gain = made.run("gain_brings_it_back")
    return [
        _steps_row("original gap", "fig8a_three_steps", True, f"the cycle exists above a gap of {least:.3g}°"),
        _steps_row("reduced gap", "fig8b_three_steps", False, f"{SAID['reduced gap'].value / least:.2g} of that gap"),
        Row(
            "gain",
            f"{_cycle(gain)}, with a range of {back.value('bands.range') / LBF:.3g} lbf",
            f"the cycle exists up to a range of {widest:.3g} lbf, so the case is close to the boundary; the paper "
            "gives no gain",
            _verdict(made.outcome(gain) == "oscillates"),
        ),
        Row("drift", "none: the cord does not creep", "not modelled", DIFFERS),
    ]


def claim_rows() -> list[Row]:
    """Stiffness, mass, the upright elbow, and both causes together."""
    nominal = epp.case("elbow")
    least = made.stable_limit(made.cable_branch()) / nominal.value("cable.stiffness")
    soft, light, upright = (made.run(n) for n in ("soft_cable", "light_forearm", "upright"))
    mass = made.mass_branch()
    lightest = made.stable_limit(mass)
    loose = made.run("upright", *made.ORIGINAL_ELBOW)
    clean = made.run("fig6b_ball_bearing", ("lock_pin.backlash", 0.0))
    other_way = made.run("light_forearm", ("harness.step", "-20 mm"))
    survives = lightest <= 1.001 * nominal.value("forearm.shell_inertia")
    return [
        Row(
            "stiffness",
            f"{made.outcome(soft)} with a quarter of the stiffness",
            f"no cycle below {100 * least:.0f} % of the nominal stiffness; the paper gives no number",
            _verdict(made.outcome(soft) == "settles"),
        ),
        Row(
            "mass",
            f"{made.outcome(light)} after a flexion step with 0.3 of the inertia, {made.outcome(other_way)} after an "
            "extension step",
            "fewer steps start the cycle, as the paper's word likelihood has it; "
            + ("it exists down to the bare forearm" if survives else f"it ends at {lightest:.3g} kg·m²"),
            _verdict(made.outcome(light) == "settles" and survives),
        ),
        Row(
            "upright",
            f"{made.outcome(upright)}; with backlash and friction {_cycle(loose)}",
            "",
            _verdict(made.outcome(upright) == "settles" and made.outcome(loose) == "oscillates"),
        ),
        Row(
            "both",
            f"without backlash and pulley friction {made.outcome(clean)} even with a range of 1 lbf",
            "",
            _verdict(made.outcome(clean) == "settles"),
        ),
    ]


def stop_rows() -> list[Row]:
    """Oscillations that stop."""
    case = epp.case("parking_stops_it")
    stopped = made.run(case.name, t_end=4.0)
    going = made.run(case.name, ("parking.dwell_time", 10.0), t_end=4.0)
    parks = next(e.time for e in reversed(stopped.events) if e.name == "parks")
    holds = made.outcome(stopped) == "settles" and made.outcome(going) == "oscillates"
    n = len(made.falls_through_parking(stopped))
    return [
        Row(
            "stops",
            f"with a dwell time of {1e3 * case.value('parking.dwell_time'):.4g} ms the elbow parks {parks:.3g} s after "
            f"the step, in fall {n} of the force through the parking band; without parking logic it goes on",
            "possible, but only with a shorter dwell time than that fall; the paper gives no time. On the cycle of "
            f"Figure 8(a) it would have to be below {1e3 * sensitivity.longest_fall():.2g} ms, whichever assumption "
            "is changed by up to half",
            PARTLY if holds else DIFFERS,
        )
    ]


GROUPS: dict[str, Callable[[], list[Row]]] = {
    "drive": drive_rows,
    "tray": tray_rows,
    "phases": phase_rows,
    "pulley": pulley_rows,
    "gap": gap_rows,
    "backlash": backlash_rows,
    "claims": claim_rows,
    "stops": stop_rows,
}


def rows_table(rows: Iterable[Row]) -> str:
    """Statements with their places."""
    header = ["what the paper says", "where", "the model", "how far apart", "verdict"]
    return markdown(
        header, ([SAID[r.key].text, SAID[r.key].place, r.model, r.apart or "–", f"**{r.verdict}**"] for r in rows)
    )


@cache
def all_rows() -> tuple[Row, ...]:
    """Every statement."""
    return tuple(row for make in GROUPS.values() for row in make())


def summary() -> str:
    """How many statements agree."""
    verdicts = [row.verdict for row in all_rows()]
    agree, partly, differ, untested = (verdicts.count(v) for v in (AGREES, PARTLY, DIFFERS, NO_TEST))
    return (
        f"Of {len(verdicts)} statements {agree} agree, {partly} agree in part, {differ} differ, and {untested} are no "
        "test.\n"
    )


def parking_limits() -> str:
    """The longest dwell time that would park each oscillation."""
    rows = []
    for name in ("fig8a_original", "fig6a_original_pulley", "gain_brings_it_back", "parking_stops_it"):
        result = made.run(name, ("parking.dwell_time", 10.0), t_end=6.0)
        falls = made.falls_through_parking(result)
        late = falls[falls[:, 0] > result.t[-1] - 1.0, 1]
        rows.append(
            [
                f"`{name}`",
                f"{1e3 * result.limit_cycle.period:.4g}",
                f"{1e3 * late.max():.3g}",
                f"{1e3 * falls[:, 1].max():.3g}",
            ]
        )
    header = ["case", "period [ms]", "fall through the parking band on the cycle [ms]", "longest in the run [ms]"]
    return markdown(header, rows)


# Assumptions ----------------------------------------------------------------------------------------------------------
def assumptions() -> str:
    """Parameters that the paper leaves open."""
    case, rows = epp.case("elbow"), []
    for name in sensitivity.assumed():
        p = case.parameters[name]
        note = p.note
        if name == "lock_pin.backlash":
            p, note = (
                epp.case("fig6a_original_pulley").parameters[name],
                "of the modified lock pin in Figure 6 and upright",
            )
        if name == sensitivity.RANGE:
            note = "of Figure 8; the paper gives about 1 lb for Figure 6 only"
        flips = [
            f"{i + 1} at {', '.join(at)}"
            for i, finding in enumerate(sensitivity.FINDINGS)
            if (at := flips_at(finding, name))
        ]
        rows.append([f"`{name}`", str(p).replace("*", "·").replace("^2", "²"), note or "–", "; ".join(flips) or "none"])
    return markdown(["parameter", "value", "what it is", "findings that flip"], rows)


def flips_at(finding: str, name: str) -> list[str]:
    """Changes of a parameter at which a finding no longer holds."""
    want = epp.case(finding).expected.outcome
    found = sensitivity.one_at_a_time(finding).get(name, ())
    return [
        f"{100 * (f - 1):+.0f} %" for f, word in zip(sensitivity.FACTORS, found, strict=bool(found)) if word != want
    ]


def together() -> str:
    """How often each finding holds when everything varies at once, and with pieces put in."""
    rows = []
    for i, finding in enumerate(sensitivity.FINDINGS):
        expected = epp.case(finding).expected
        shares = []
        for spread in sensitivity.SPREADS:
            found = sensitivity.all_at_once(finding, spread)
            shares.append(f"{found.count(str(expected.outcome))} of {len(found)}")
        rows.append([str(i + 1), f"`{finding}`", str(expected.outcome), expected.paper, *shares])
    header = ["", "finding", "must", "in the paper", *(f"holds within ±{100 * s:.0f} %" for s in sensitivity.SPREADS)]
    return markdown(header, rows)


def pieces() -> str:
    """Findings that flip when something is put in that the nominal model leaves out."""
    rows = []
    for number, piece in enumerate(sensitivity.PIECES):
        flips = [
            str(i + 1)
            for i, finding in enumerate(sensitivity.FINDINGS)
            if sensitivity.with_piece(finding, number) != epp.case(finding).expected.outcome
        ]
        rows.append([piece.text, ", ".join(flips) or "none"])
    return markdown(["put in", "findings that flip"], rows)


def make_all(folder: Path) -> None:
    """Write every table as a Markdown file."""
    texts = {f"paper_{name}": rows_table(make()) for name, make in GROUPS.items()}
    texts |= {
        "paper_all": rows_table(all_rows()),
        "paper_summary": summary(),
        "paper_equations": equations(),
        "paper_dwell": parking_limits(),
        "paper_assumptions": assumptions(),
        "paper_together": together(),
        "paper_pieces": pieces(),
    }
    for name, text in texts.items():
        (folder / f"{name}.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    GENERATED.mkdir(exist_ok=True)
    make_all(GENERATED)
