"""Tables of the page on what the paper leaves open."""

from __future__ import annotations

from pathlib import Path

import eppanalysis as epp
from studies import GENERATED
from studies.pages.tables import markdown
from studies.paper import sensitivity


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
    texts = {
        "paper_assumptions": assumptions(),
        "paper_together": together(),
        "paper_pieces": pieces(),
    }
    for name, text in texts.items():
        (folder / f"{name}.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    GENERATED.mkdir(exist_ok=True)
    make_all(GENERATED)
