"""Proofs about loops with one element, and the check of their files in a process of its own."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from eppanalysis.errors import ArgumentError, EppError, did_you_mean, require_packages, shown, visible
from eppanalysis.methods.certificates.numbers import NotCovered
from eppanalysis.methods.certificates.registry import STATEMENTS, Claim, Statement, of_text
from eppanalysis.methods.certificates.result import Certificate, Check, enclosure, sentence
from eppanalysis.methods.certificates.stated import another, another_loop, stated_box, stated_loop
from eppanalysis.models.systems.lure import LureSystem
from eppanalysis.models.systems.operating import OperatingPoint
from eppanalysis.models.systems.subject import CaseLike, PointLike, facts_of, require_case, standing
from eppanalysis.readable import listed
from eppanalysis.results import Status
from eppanalysis.results.provenance import Provenance

#: Longest time that a checker may take [s].
_PATIENCE = 600.0
_MOST_SECTORS = 200
#: A gain that is small.
_SMALL = 1e-6
#: Absence of cycles is no stability: said where all motions may grow.
_GROWS = " While the play moves, {}: motions that do not rest may grow without bound."
#: Why roots are not decided beside an undamped pole.
_ALONE = (
    " At {} rad/s the linear part has a pole without damping: where the element's output is zero, it swings there at "
    "any amplitude."
)


def certify(
    loop: LureSystem | CaseLike,
    statement: str = "roots",
    *,
    box: Mapping[str, tuple[float, float]] | None = None,
    within: Mapping[str, tuple[object, object]] | None = None,
    sectors: int = 48,
    operating_point: PointLike | None = None,
) -> Certificate:
    """Prove a statement about a loop, by balls and rational numbers, and have it checked.

    Parameters
    ----------
    loop : LureSystem or Case
        With one element of one input and output without a bias (play may have one), and a linear part that is rational
        but for dead time, in continuous or discrete time. "roots" also takes, in continuous time, one piecewise-linear
        element, play or relay with hysteresis with a bias, and rings of odd ones of these.
    statement : str, optional
        "roots": all roots of the balance ``1 + N(A) G(j omega) = 0`` in a box, none missed. "absence": no periodic
        motion but rest; for a memoryless element in a sector by the circle criterion or Popov's (in discrete time by
        the first alone), for any memoryless element where ``Re j omega G(j omega)`` has one sign, and for a relay with
        dead zone around ``k/(s(s+p)(s+q))`` by cells of its return map; for play, whatever its gap and the constant
        inputs, by ``Re G(j omega) > -1``, or by a function that falls along every motion where G is of order 2, or of
        order 3 with one zero at most, with real poles; and for the elbow on its side with a ball-bearing pulley and so
        small a gap that the drive's friction outweighs it. "cycles": these are all limit cycles, with periods and
        stability, and nothing else is periodic but rest; for a relay with dead zone around ``k/(s(s+p)(s+q))``.
    box : mapping of str to (float, float), optional
        Of "roots": "amplitude" at the element's input (of a ring, the first one with memory, or the first), "omega"
        [rad/s] and, where there is one, "bias", from and to; by default 1024 times beyond all scales of the loop and
        the cycles that :func:`predict_limit_cycles` lists (to one turn of its dead time, to half of its sampling
        frequency).
    within : mapping of str to (quantity, quantity), optional
        Of "absence", for a case: up to three parameters and their ranges, from and to. Along each of them the
        coefficients of the linear part run along straight lines, as they do with gains, the element keeps to the sector
        of one, or is play with any gap, and dead time may change at will. By sectors one parameter may change the
        numerator, and none else but the gap. One file then holds for all values.
    sectors : int, optional
        Of "absence" with play: most sectors of a quarter plane in which the function is quadratic, 2 to 200; more of
        them come nearer to the exact onset of cycles.
    operating_point : OperatingPoint or mapping of str to float, optional
        Where the external inputs are held, or some of them by name [SI]; by default that of the case or loop.

    Returns
    -------
    Certificate
        With status INCOMPLETE and a sentence where the loop is not covered, or nothing is decided.

    Raises
    ------
    EppError
        If `loop` is neither a case nor a loop, the statement, a side of the box or a parameter is not known, `sectors`
        is out of range, or python-flint or (for play) clarabel is missing, which the extra "proof" installs.

    Notes
    -----
    The describing function is an approximation: roots of its balance are proved, not limit cycles. Absence is proved of
    the loop itself (Popov 1961, in the form of Garber 1967 for periodic motions; piecewise quadratic functions are from
    Johansson and Rantzer 1998). The derivations are on the pages "Certificates" and "No limit cycle with play" of the
    theory.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> servo = epp.LureSystem.from_tf(
    ...     ([2.3758], [0.2, 1.2, 1.0, 0.0]), epp.Play(gap=2.0), name="servo"
    ... )
    >>> found = epp.certify(servo)
    >>> print(found)
    Proved: the describing function has exactly 2 roots for servo; for amplitudes
    0.0009766 to 2119, 0.0007325 to 5120 rad/s and no bias.
    >>> [f"{root.amplitude[0]:.6f}" for root in found.roots]
    ['1.485175', '1.490930']
    >>> limited = epp.LureSystem.from_tf(
    ...     ([5.99], [1.0, 3.0, 2.0, 0.0]), epp.Saturation(), name="limited"
    ... )
    >>> print(epp.certify(limited, "absence"))
    Proved: limited has no periodic motion but rest (sector 0 to 1;
    Popov's criterion with a multiplier of 1.5 s).
    >>> slack = epp.LureSystem.from_tf(
    ...     ([2.0], [0.2, 1.2, 1.0, 0.0]), epp.Play(gap=0.1), name="slack"
    ... )
    >>> print(epp.certify(slack, "absence"))
    Proved: slack has no periodic motion but rest, for any gap (a function that
    falls, quadratic in 8 sectors).
    >>> relay = epp.LureSystem.from_tf(
    ...     ([5.0], [1.0, 2.0, 1.0, 0.0]),
    ...     epp.RelayDeadZone(threshold=1.0),
    ...     name="relay",
    ... )
    >>> print(epp.certify(relay, "cycles"))
    Proved: relay has exactly 2 limit cycles, of 6.328 s (stable) and
    of 8.255 s (unstable), and no other periodic motion but rest (its return map
    in 1228 cells).
    """
    claim = _claim_of(statement)
    if not 2 <= sectors <= _MOST_SECTORS:
        raise ArgumentError("sectors", f" is {sectors}; expected 2 to {_MOST_SECTORS}.", "certify")
    if box is not None and claim is not Claim.ROOTS:
        raise ArgumentError(
            "box", f" is given for {statement!r}, which is proved of all amplitudes; expected no box.", "certify"
        )
    if within is not None and (claim is not Claim.ABSENCE or not 1 <= len(within) <= 3):
        raise ArgumentError("within", " is of absence; expected one to three parameters and their ranges.", "certify")
    require_packages("certify", "proof", "flint")
    system, at = standing(loop, operating_point, "certify")
    case = facts_of(loop)
    settings = {"system": system.name, "statement": claim.value, "input": dict(at.inputs), "within": dict(within or {})}
    try:
        if within is None:
            stated, off = stated_loop(claim, system, at)
            seen: list[dict[str, Any]] = []
        else:
            stated, off, seen = stated_box(require_case(loop, "certify"), within, operating_point)
        made_by = Provenance("certificate", settings, {"coefficients": off}, case=case)
        made = partial(Certificate, claim, provenance=made_by, operating_point=at)
        if claim is Claim.ROOTS:
            return _roots(system, stated, box, at, made)
        if claim is Claim.CYCLES:
            return _cycles(system, stated, made)
        return _absence(system.name, stated, sectors, within or {}, seen, made)
    except NotCovered as error:
        made_by = Provenance("certificate", settings, case=case)
        message = f"Not covered: {error}"
        return Certificate(claim, Status.INCOMPLETE, message, provenance=made_by, operating_point=at)


def proof_of_absence(case: CaseLike) -> tuple[Certificate | None, str]:
    """The proof that a case has no periodic motion but rest, or None and why there is none."""
    try:
        found = certify(case, "absence")
    except EppError as error:
        return None, str(error)
    return found if found.proved else None, found.message


def _roots(
    system: LureSystem, stated: dict[str, Any], box: Any, at: OperatingPoint, made: Callable[..., Certificate]
) -> Certificate:
    """The certificate of all roots in a box, checked."""
    from eppanalysis.methods.certificates.roots import find as roots
    from eppanalysis.methods.certificates.roots.box import box_of

    document = roots.find(stated, box_of(system, stated, box, at))
    _accepted(document)
    left = roots.undecided(document)
    alone = [] if system.time_step else roots.undamped(stated)
    alone = [omega for omega in alone if any(leaf[2] <= omega <= leaf[3] for leaf in left)]
    return made(
        Status.INCOMPLETE if left else Status.CONVERGED,
        sentence(document, system.name) + (_ALONE.format(f"{float(alone[0]):.4g}") if alone else ""),
        document,
        tuple(enclosure(root["enclosure"]) for root in document["evidence"]["roots"]),
        tuple(enclosure([str(x) for x in leaf]) for leaf in left),
    )


def _absence(
    name: str,
    stated: dict[str, Any],
    sectors: int,
    within: Mapping[str, tuple[object, object]],
    seen: Sequence[Mapping[str, Any]],
    made: Callable[..., Certificate],
) -> Certificate:
    """The certificate of absence, checked and held against loops of its range, or why there is none."""
    from eppanalysis.methods.certificates import absence

    document = absence.find(stated, sectors)
    if isinstance(document, str):
        return made(Status.INCOMPLETE, f"Not decided: {document}")
    _accepted(document)
    if any(another(document, loop) for loop in seen):
        return made(Status.INCOMPLETE, "Not decided: what was proved holds for one element of the range alone.")
    values = listed([f"{parameter} from {low} to {high}" for parameter, (low, high) in within.items()])
    return made(
        Status.CONVERGED, sentence(document, name, f" with {values}" * bool(within)) + _growth(stated), document
    )


def _cycles(system: LureSystem, stated: dict[str, Any], made: Callable[..., Certificate]) -> Certificate:
    """The certificate of all limit cycles, checked, or why there is none."""
    from eppanalysis.methods.certificates.cells.find import find

    document = find(stated, cycles=True)
    if document == "":
        raise NotCovered("lists of cycles are proved for a relay with dead zone around k/(s(s + p)(s + q)), p, q > 0.")
    if isinstance(document, str):
        return made(Status.INCOMPLETE, f"Not decided: the list of cycles is not proved complete{document}.")
    _accepted(document)
    return made(Status.CONVERGED, sentence(document, system.name), document)


def _growth(stated: Mapping[str, Any]) -> str:
    """A sentence where the linear loops of a moving play are not stable; empty where they are."""
    if stated.get("element", {}).get("kind") != "play":
        return ""
    nums, dens = (
        [np.array([float(Fraction(c)) for c in row]) for row in rows] for rows in (stated["num"], stated["den"])
    )
    late, step = stated["delay"], stated["time_step"]
    if step is not None:
        dens = [np.append(den, np.zeros(round(Fraction(late) / Fraction(step)))) for den in dens]
    elif late != "0":
        # Where Re L > -1 no root crosses the axis as the gain grows: the loops of a small one are as stable.
        nums = [_SMALL * num for num in nums]
    roots = [np.roots(np.polyadd(*pair)) for pair in zip(nums, dens, strict=True)]
    grows = [bool(np.max(z.real if step is None else np.abs(z) - 1.0) >= 0.0) for z in roots]
    which = "the loop is not stable" if all(grows) else "some of the loops are not stable"
    return _GROWS.format(which) if any(grows) else ""


def _accepted(document: Mapping[str, Any]) -> None:
    """Have a certificate checked as it was found; what is refused is proved by nothing."""
    checker = of_text(document["statement"]).functions()
    try:
        checker.verify(document)
    except checker.Refused as error:
        raise EppError(f"certify: the checker refuses the certificate ({error}); nothing is proved.") from error


def check_certificate(
    path: str | Path, loop: LureSystem | CaseLike | None = None, *, operating_point: PointLike | None = None
) -> Check:
    """Check the file of a certificate in a fresh process that loads its checker alone.

    Parameters
    ----------
    path : str or Path
        The file that a proof was written to.
    loop : LureSystem or Case, optional
        The loop that the file should speak of. Without one the file is checked for itself: whose loop it states, it
        cannot prove.
    operating_point : OperatingPoint or mapping of str to float, optional
        Where the external inputs of `loop` are held, or some of them by name [SI]; by default that of the case or loop.

    Returns
    -------
    Check
        Whether the file proves what it claims, and what that is, or why it is refused; and whether it is about `loop`.

    Raises
    ------
    EppError
        If there is no such file, python-flint is missing, `loop` is neither a case nor a loop, or the checker takes
        longer than ten minutes.

    Examples
    --------
    >>> import tempfile
    >>> import eppanalysis as epp
    >>> folder = tempfile.TemporaryDirectory()
    >>> case = epp.case("relay_deadzone")
    >>> file = epp.certify(case).write(f"{folder.name}/roots.json")
    >>> epp.check_certificate(file).accepted
    True
    >>> check = epp.check_certificate(file, epp.case("backlash_servo"))
    >>> check.accepted, check.about
    (True, False)
    >>> folder.cleanup()
    """
    require_packages("check_certificate", "proof", "flint")
    path = Path(path)
    subject = None if loop is None else standing(loop, operating_point, "check_certificate")
    # Which of the checkers is meant is in the file: the one that takes the longest files reads it first.
    checker = max((statement.functions() for statement in STATEMENTS.values()), key=lambda known: known.LENGTH)
    text = _text(path, checker.LENGTH + 1)
    try:
        document = checker.read(text)
        named = str(document["statement"])
    except (checker.Refused, ValueError, LookupError, TypeError) as error:
        why = f": {error}" if isinstance(error, checker.Refused) else ", which is JSON with a statement"
        return Check(False, "", f"{path}: refused: no certificate{why}.")
    try:
        known = of_text(named)
    except LookupError:
        return Check(False, named, f"{path}: refused: there is no checker for the statement {shown(named)}.")
    why_not = _refusal(path, text, known)
    if why_not:
        return Check(False, named, f"{path}: refused: {why_not}.")
    if subject is None:
        return Check(True, named, sentence(document))
    system, at = subject
    other = another_loop(document, system, at)
    if other:
        return Check(True, named, f"{path}: not about {system.name}: {other}. {sentence(document)}", about=False)
    return Check(True, named, sentence(document, system.name), about=True)


def _refusal(path: Path, text: str, known: Statement) -> str:
    """Why the checker of a statement refuses a file; empty where it accepts it."""
    try:
        # Isolated (-I): neither this package nor the folder lends the checker
        # anything (docs/theory/proofs.md, What "proved" means).
        run = subprocess.run(
            [sys.executable, "-I", str(known.program)],
            input=text,
            capture_output=True,
            check=False,
            encoding="utf-8",
            timeout=_PATIENCE,
        )
    except subprocess.TimeoutExpired as error:
        raise EppError(f"{path}: its checker has not ended after {_PATIENCE:.0f} s.") from error
    said = _answer(run.stdout)
    if run.returncode == 0 and said.get("accepted") is True:
        return ""
    return visible(said.get("why") or (run.stderr.strip().splitlines() or ["the checker gave no answer"])[-1])


def _answer(text: str) -> Mapping[str, Any]:
    """What a checker has printed; nothing where it is no answer."""
    try:
        said = json.loads(text)
    except ValueError:
        return {}
    return said if isinstance(said, dict) else {}


def _text(path: Path, length: int) -> str:
    """So many characters of a file at most."""
    try:
        if path.exists() and not path.is_file():  # a pipe may wait, and a device write, without end
            raise ValueError(f"is {'a folder' if path.is_dir() else 'not a file'}")
        with path.open(encoding="utf-8") as file:
            return file.read(length)
    except (OSError, ValueError) as error:
        why = "is no text" if isinstance(error, UnicodeDecodeError) else getattr(error, "strerror", None) or error
        raise EppError(f"{path}: {why}; expected the file of a certificate.") from error


def _claim_of(statement: str) -> Claim:
    """The statement that is meant."""
    if statement not in list(Claim):
        known = did_you_mean(statement, [claim.value for claim in Claim])
        raise ArgumentError("statement", f" is {statement!r}; expected {known}.", "certify")
    return Claim(statement)
