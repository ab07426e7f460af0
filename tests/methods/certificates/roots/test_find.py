"""Roots of the first-order balance that are proved: none missed, none invented, in any units, from a file."""

from __future__ import annotations

import json
from fractions import Fraction

import numpy as np
import pytest
from flint import arb, fmpq
from hypothesis import given, settings, strategies as st

import eppanalysis as epp
from eppanalysis.methods.certificates import check_roots
from eppanalysis.methods.certificates.check_roots import Gain, Refused
from eppanalysis.methods.certificates.rational import element_data
from eppanalysis.methods.certificates.registry import sealed
from eppanalysis.methods.certificates.roots import find as roots
from tests.shared import mostly_slow

ELEMENTS = (
    epp.Saturation(-0.7, 0.7, 1.3),
    epp.DeadZone(-0.4, 0.4, 2.0),
    epp.DeadZoneSaturation(dead_zone=0.3, slope=2.0, limit=0.9),
    epp.DeadZoneSaturation(dead_zone=0.0, slope=2.0, limit=0.9),
    epp.Relay(-1.5, 1.5),
    epp.RelayDeadZone(threshold=0.4, level=2.0),
    epp.Preload(level=0.5, slope=-1.5),
    epp.Coulomb(0.8),
    epp.ViscousCoulomb(coulomb=0.8, viscous=0.3),
    epp.Friction(coulomb=0.6, static=1.0),
    epp.Quantiser(step=0.3, levels=5),
    epp.BilinearSpring(lower=-0.4, upper=0.4, outer=3.0, inner=0.5),
    epp.PiecewiseLinear([-1.0, -0.4, 0.4, 1.0], [0.5, -0.2, 1.0, -0.2, 0.5], [-0.3, -0.48, 0.0, 0.48, 0.3]),
    epp.Play(gap=0.6),
    epp.JumpAndFollow(stick_band=0.9, slip_jump=0.4, slope=1.2),
    epp.JumpAndFollow(stick_band=0.5, slip_jump=0.9),
    epp.HysteresisRelay(-0.3, 0.3, -1.2, 1.2),
    epp.HysteresisRelayDeadZone(on=0.5, off=0.2, level=1.1),
    epp.Cube(0.7),
    epp.Drag(0.7),
)


def ball(gain: Gain, amplitude: float) -> tuple[complex, complex]:
    at = fmpq(*Fraction(amplitude).as_integer_ratio())
    N, slope = gain.over(at, at)
    assert N.real.rad() < 1e-20 and N.imag.rad() < 1e-20
    return complex(N), complex(slope)


@pytest.mark.parametrize("element", ELEMENTS, ids=lambda e: repr(e)[:40])
def test_gains_in_balls_are_the_describing_functions(element: epp.Nonlinearity) -> None:
    """Formulas of the checker, written from theory, against those of the elements, which quadrature confirms."""
    gain = Gain(element_data(element))
    rng = np.random.default_rng(3)
    for amplitude in np.concatenate([rng.uniform(0.01, 1.5, 20), rng.uniform(1.5, 50.0, 5)]):
        N, slope = ball(gain, amplitude)
        known = complex(element.describing_function(amplitude)[1])
        assert abs(N - known) < 1e-12 * abs(known) + 1e-14
        # The derivative by a central difference of balls, whose own error is of the order of the step squared.
        step = 1e-7 * amplitude
        if min(abs(amplitude - float(x.p) / float(x.q)) for x in [*gain.thresholds, fmpq(-1)]) > 1e-3:
            near = (ball(gain, amplitude + step)[0] - ball(gain, amplitude - step)[0]) / (2 * step)
            assert slope == pytest.approx(near, rel=1e-5, abs=1e-6)


@given(
    st.sampled_from(ELEMENTS), st.floats(0.0, 1.0), st.floats(0.001, 3.0), st.floats(0.0, 1.0), st.floats(0.05, 20.0)
)
@settings(max_examples=100, deadline=None)
def test_gains_over_intervals_hold_those_of_all_their_points(
    element: epp.Nonlinearity, place: float, width: float, inner: float, above: float
) -> None:
    gain = Gain(element_data(element))
    edges = [fmpq(1, 1000), *gain.thresholds, fmpq(1000)]
    piece = min(int(place * (len(edges) - 1)), len(edges) - 2)
    low = edges[piece] * fmpq(*(1 + Fraction(round(above * 1e3), 10**6)).as_integer_ratio())
    high = min(low * fmpq(*(1 + Fraction(width)).as_integer_ratio()), edges[piece + 1])
    if not low < high:
        return
    at = low + (high - low) * fmpq(*Fraction(inner).as_integer_ratio())
    whole, one = gain.over(low, high), gain.over(at, at)
    for wide, narrow in zip(whole, one, strict=True):
        for part in ("real", "imag"):
            outer, own = getattr(wide, part), getattr(narrow, part)
            assert not outer.is_finite() or not own.is_finite() or outer.overlaps(own)


def test_an_element_that_depends_on_the_frequency_is_not_covered() -> None:
    found = epp.certify(epp.case("rate_limited_aircraft"), "roots")
    assert not found.proved and "depends on the frequency" in found.message


def covered() -> list[str]:
    """Shipped loops with one element that is odd and stands at no bias."""
    names = []
    for name in epp.shipped_cases():
        system = epp.case(name).to_system()
        rated = any(e.of_frequency for e in system.elements)
        if len(system.elements) == 1 and not rated and not np.any(system.constant_state):
            names.append(name)
    left_out = {"relay_biased_fopdt", "sat_asymmetric", "two_mass_damped_shaft", "two_mass_damped_shaft_classical"}
    return [name for name in names if name not in left_out | {"belt_leine"}]


@pytest.mark.parametrize("name", mostly_slow(covered(), covered()[::6]))
def test_shipped_loops_are_decided(name: str) -> None:
    """Witness: the search of the prediction, which knows no balls."""
    case = epp.case(name)
    found = epp.certify(case)
    assert found.proved and not found.undecided and found.document["claim"]["undecided"] == 0
    predicted = epp.predict_limit_cycles(case)
    (label,) = case.to_system().element_names
    assert len(found.roots) == len(predicted)
    for root, cycle in zip(found.roots, predicted, strict=True):
        assert root.amplitude[0] == pytest.approx(cycle.elements[label]["amplitude"], rel=1e-9)
        assert root.omega[0] == pytest.approx(cycle.omega, rel=1e-9)
        assert root.amplitude[1] - root.amplitude[0] <= 1e-15 * root.amplitude[0]


def test_there_are_as_many_shipped_loops_as_are_known_to_be_covered() -> None:
    assert len(covered()) >= 20


def servo(gain: float, gap: float = 2.0, seconds: float = 1.0) -> epp.LureSystem:
    """k/(s (s + 1)(0.2 s + 1)) with play, in any unit of time."""
    den = [0.2 * seconds**3, 1.2 * seconds**2, seconds, 0.0]
    return epp.LureSystem.from_tf(([gain], den), epp.Play(gap=gap), name="servo")


@pytest.mark.slow
def test_two_roots_that_are_about_to_meet_are_told_apart_and_none_is_none() -> None:
    """Independent: least gain at which the balance has a root, by the phase of G alone (dense in amplitude)."""
    below, beyond = epp.certify(servo(2.375)), epp.certify(servo(2.3758))
    assert len(below.roots) == 0 and below.proved and len(beyond.roots) == 2 and beyond.proved
    # The fold is at 2.3757882677689...: ten digits on either side are no harder.
    assert [len(epp.certify(servo(k)).roots) for k in (2.3757882677, 2.3757882678)] == [0, 2]
    from scipy.optimize import brentq

    def gain(a: float) -> float:
        N = complex(epp.Play(gap=2.0).describing_function(a)[1])
        lag = -np.pi - np.angle(N)
        omega = brentq(lambda w: -np.pi / 2 - np.arctan(w) - np.arctan(0.2 * w) - lag, 1e-9, 1e4, xtol=1e-14)
        return abs(1j * omega * (1j * omega + 1) * (0.2j * omega + 1)) / abs(N)

    least = min(gain(a) for a in np.linspace(1.48, 1.496, 201))
    assert least == pytest.approx(2.3757882677, abs=1e-8)


@pytest.mark.parametrize("scale", mostly_slow([1e-6, 1e6], [1e6]))
def test_units_change_nothing(scale: float) -> None:
    base, wide = epp.certify(servo(2.4)), epp.certify(servo(2.4, gap=2.0 * scale))
    slow = epp.certify(servo(2.4, seconds=scale))
    assert wide.document["evidence"]["cover"] == base.document["evidence"]["cover"]
    assert wide.proved and slow.proved and len(slow.roots) == 2
    for one, other, third in zip(base.roots, wide.roots, slow.roots, strict=True):
        assert other.amplitude[0] == pytest.approx(scale * one.amplitude[0], rel=1e-14)
        assert other.omega[0] == pytest.approx(one.omega[0], rel=1e-14)
        assert third.amplitude[0] == pytest.approx(one.amplitude[0], rel=1e-10)


@given(st.integers(0, 10**6))
@settings(max_examples=12, deadline=None)
def test_roots_of_random_loops_balance_and_a_grid_finds_no_other(seed: int) -> None:
    """A grid of Newton's method on the elements' own describing functions finds no root that is not enclosed."""
    rng = np.random.default_rng(seed)
    element = ELEMENTS[rng.integers(len(ELEMENTS))]
    poles = -np.exp(rng.uniform(-1.0, 1.5, 3))
    num, den = [float(np.round(np.exp(rng.uniform(-1.0, 3.0)), 3))], np.round(np.poly(poles), 4)
    delay = float(np.round(rng.uniform(0.1, 1.0), 2)) if rng.random() < 0.3 else 0.0
    found = epp.certify(epp.LureSystem.from_tf((num, den), element, delay=delay))
    if not found.document or not found.proved:
        assert found.message.startswith("Not covered") or found.undecided
        return

    def balance(a: np.ndarray, w: np.ndarray) -> np.ndarray:
        s = 1j * w
        return 1 + element.describing_function(a)[1] * np.polyval(num, s) / np.polyval(den, s) * np.exp(-s * delay)

    for root in found.roots:
        assert abs(balance(np.array(root.amplitude[0]), np.array(root.omega[0]))) < 1e-8
    (a, b), (c, d) = ([float(Fraction(x)) for x in found.document["box"][side]] for side in ("amplitude", "frequency"))
    place = np.meshgrid(np.geomspace(a, b, 50), np.geomspace(c, d, 50))
    x = np.log(np.stack([p.ravel() for p in place]))
    with np.errstate(all="ignore"):
        for _ in range(40):
            F = balance(np.exp(x[0]), np.exp(x[1]))
            Fa = (balance(np.exp(x[0] + 1e-6), np.exp(x[1])) - F) / 1e-6
            Fw = (balance(np.exp(x[0]), np.exp(x[1] + 1e-6)) - F) / 1e-6
            turn = (Fa * Fw.conj()).imag
            x = x - np.clip(np.stack([(F * Fw.conj()).imag / turn, -(F * Fa.conj()).imag / turn]), -0.5, 0.5)
        good = (np.abs(balance(np.exp(x[0]), np.exp(x[1]))) < 1e-10) & np.isfinite(x).all(0)
    for at, omega in zip(*np.exp(x[:, good]), strict=True):
        if a < at < b and c < omega < d:
            assert any(abs(r.amplitude[0] / at - 1) + abs(r.omega[0] / omega - 1) < 1e-5 for r in found.roots)


def test_what_is_undecided_is_shown() -> None:
    """On the border of stability every amplitude up to the limit is a root: no box there is proved."""
    found = epp.certify(epp.LureSystem.from_tf(([6.0], [1.0, 3.0, 2.0, 0.0]), epp.Saturation()))
    assert not found.proved and found.undecided and "nothing is decided" in found.message
    assert all(box.omega[0] <= np.sqrt(2.0) <= box.omega[1] and box.amplitude[1] <= 1.01 for box in found.undecided)
    assert check_roots.verify(found.document)["undecided"] == len(found.undecided)


def test_a_box_that_is_asked_for_is_the_box() -> None:
    found = epp.certify(servo(2.3758), box={"amplitude": (1.1, 1.488), "omega": (0.5, 1.0)})
    assert found.document["box"] == {"amplitude": ["11/10", "186/125"], "frequency": ["1/2", "1"]}
    assert len(found.roots) == 1
    with pytest.raises(epp.EppError, match="two ascending positive numbers"):
        epp.certify(servo(2.0), box={"amplitude": (2.0, 1.0)})
    with pytest.raises(epp.EppError, match="has a side 'bias'"):
        epp.certify(servo(2.0), box={"bias": (1.0, 2.0)})


def test_discrete_time_is_the_response_on_the_unit_circle() -> None:
    case = epp.case("backlash_discrete_pi")
    root = epp.certify(case).roots[0]
    system = case.to_system()
    response = complex(system.frequency_response(np.array([root.omega[0]]))[0, 0, 0])
    gain = complex(system.elements[0].describing_function(root.amplitude[0])[1])
    assert response * gain == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("belt_leine", "friction"),
        ("level_valve", "jump and follow"),
        ("two_mass_damped_shaft", "one element"),
        ("fig8a_original", "one element"),
    ],
)
def test_what_is_not_covered_says_so(name: str, why: str) -> None:
    found = epp.certify(epp.case(name))
    assert not found.proved and not found.document and not found.roots
    assert found.message.startswith("Not covered") and why in found.message


def tampered() -> list[tuple[str, dict]]:
    """Certificates that were changed, each with a digest of its own, so that the proof itself is looked at."""
    whole = epp.certify(servo(5.0)).document
    made = []

    def change(name: str, edit) -> None:
        copy = json.loads(json.dumps(whole))
        edit(copy)
        made.append((name, sealed(copy)))

    change("gain", lambda d: d["loop"].update(num=["25.0000000001"]))
    change("gap", lambda d: d["loop"]["element"].update(gap="3"))
    change("delay", lambda d: d["loop"].update(delay="1/10"))
    change("enclosure", lambda d: d["evidence"]["roots"][0]["enclosure"].__setitem__(1, "1035/1000"))
    change("region", lambda d: d["evidence"]["roots"][0]["region"].__setitem__(1, "20"))
    change("root left out", lambda d: d["evidence"]["roots"].pop())
    change("root left out, and out of the claim", _without_a_root)
    change("box removed", lambda d: d["evidence"]["cover"].__setitem__(1, d["evidence"]["cover"][1][:-1]))
    change("box inside removed", lambda d: d["evidence"]["cover"].__setitem__(1, _without_a_leaf(d)))
    change("part removed", lambda d: d["evidence"]["cover"].pop(0))
    change(
        "root called empty",
        lambda d: d["evidence"]["cover"].__setitem__(1, d["evidence"]["cover"][1].replace("r", ".")),
    )
    change("root twice", lambda d: d["evidence"]["roots"].append(d["evidence"]["roots"][0]))
    change("claim", lambda d: d["claim"].update(roots=1))
    change("undecided left out", lambda d: d["evidence"]["cover"].__setitem__(1, "?"))
    change("larger box", lambda d: d["box"].update(amplitude=["1/1000000", "1000000"]))
    change("box upside down", lambda d: d["box"].update(frequency=["10", "1"]))
    change("no statement of it", lambda d: d.update(statement="all is well"))
    return made


def _without_a_root(d: dict) -> None:
    d["evidence"]["roots"].pop()
    d["claim"]["roots"] = 1


def _without_a_leaf(d: dict) -> str:
    cover = d["evidence"]["cover"][1]
    return cover.replace(".", "", 1)


@pytest.mark.parametrize(("name", "document"), tampered(), ids=lambda x: x if isinstance(x, str) else "")
def test_changed_certificates_are_refused(name: str, document: dict) -> None:
    with pytest.raises((Refused, ValueError, LookupError)):
        check_roots.verify(document)


@pytest.mark.parametrize(
    "element",
    [
        {"kind": "hysteresis_relay_dead_zone", "on": "1", "off": "2", "level": "1"},
        {"kind": "play", "gap": "-1"},
        {"kind": "odd_pieces", "slope": "1", "bends": [["-1", "1"]], "jumps": []},
        {"kind": "tanh", "scale": "1"},
    ],
    ids=lambda e: e["kind"],
)
def test_elements_that_are_none_are_refused(element: dict) -> None:
    with pytest.raises(Refused):
        Gain(element)


def test_a_changed_file_is_refused_even_where_it_still_proves_something() -> None:
    document = json.loads(json.dumps(epp.certify(servo(2.0)).document))
    assert check_roots.verify(document) == {"roots": 0, "undecided": 0}
    document["loop"]["num"] = ["9"]
    with pytest.raises(Refused, match="changed"):
        check_roots.verify(document)


def test_intervals_are_cut_in_proportion() -> None:
    assert check_roots.middle(fmpq(1), fmpq(1024)) == 32
    assert check_roots.middle(fmpq(1), fmpq(3)) == 2
    assert check_roots.middle(fmpq(1, 10**6), fmpq(1024, 10**6)) == fmpq(32, 10**6)


def test_boxes_of_a_cover_fill_the_box() -> None:
    found = epp.certify(servo(5.0))
    a, b, c, d = (fmpq(*Fraction(x).as_integer_ratio()) for side in found.document["box"].values() for x in side)
    area = sum((x[1] - x[0]) * (x[3] - x[2]) for _, x in roots.all_leaves(found.document))
    assert area == (b - a) * (d - c)
    assert arb(area) > 0
