"""Absence of cycles of the elbow with a small gap: each step of the proof on an orbit, and changed files."""

from __future__ import annotations

import copy
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

import eppanalysis as epp
from eppanalysis.methods.certificates import check_elbow
from eppanalysis.methods.certificates.check_elbow import Refused
from eppanalysis.methods.certificates.elbow.find import find, gained, rational_elbow
from eppanalysis.methods.certificates.registry import sealed

N = 8192


def row_1(backlash: str, profile_range: str = "2.5 lbf") -> epp.Case:
    return epp.case("fig8a_original").with_values({"lock_pin.backlash": backlash, "bands.range": profile_range})


@pytest.fixture(scope="module")
def document() -> dict[str, Any]:
    found = find(rational_elbow(row_1("0.065 deg").to_system(), np.zeros(1)))
    assert isinstance(found, dict)
    return found


class Orbit:
    """A limit cycle of row 1 over one period, and the signals of the proof, each by its own definition."""

    def __init__(self, loop: dict[str, Any], evidence: dict[str, Any]) -> None:
        v = self.v = {name: float(Fraction(loop[name])) for name in check_elbow.NAMES}
        case = row_1("2.5 deg")
        self.period = 0.11143840595440
        run = epp.simulate(case, t_end=3.2, t_eval=np.r_[0.0, 3.0 + self.period * np.arange(N) / N])
        theta, drive, self.pull, self.contact, self.speed, self.arm_speed = (
            run.signals[name][1:]
            for name in ("theta", "drive_angle", "sensor_force", "pin_torque", "drive_speed", "theta_dot")
        )
        self.omega = 2.0 * np.pi / self.period * np.fft.fftfreq(N, 1.0 / N)
        self.s = s = 1j * self.omega
        k, c = v["contact_stiffness"], v["contact_damping"]
        self.gap = np.clip(drive - theta, -v["backlash"] / 2, v["backlash"] / 2)
        dent = drive - theta - self.gap
        late = v["delay"] ** 2 * s**2 + 6.0 * v["delay"] * s + 12.0
        self.turn = (late.conj() / late / (1.0 + v["lag"] * s)).conj()
        self.i = self.filtered(self.speed, 1.0 / (1.0 + v["lag"] * s))
        self.seen = self.filtered(self.speed, self.turn)
        with np.errstate(invalid="ignore", divide="ignore"):
            self.ahead = drive + self.filtered(self.speed, np.where(s == 0, 0, (self.turn - 1.0) / s))
        one_sided = [self.filtered(np.maximum(x, 0.0), 1.0 / (k + c * s)) for x in (self.contact, -self.contact)]
        self.sides = [(zeta, zeta - np.maximum(x, 0.0)) for zeta, x in zip(one_sided, (dent, -dent), strict=True)]
        self.rates = [self.filtered(zeta, s) for zeta in one_sided]
        self.rho = self.sides[0][1] - self.sides[1][1]
        self.z = self.rates[0] - self.rates[1]
        self.q = self.filtered(v["radius"] * self.pull, s / (k + c * s))
        self.y = self.ahead - theta
        self.gain = v["cable_stiffness"] * v["radius"] * v["torque"] / (v["max"] - v["high"])
        self.torque = np.interp(
            self.pull, [v[x] for x in ("slack", "low", "high", "max")], np.array([-1, 0, 0, 1]) * v["torque"]
        )
        self.lost = self.mean(self.contact * (self.speed - self.arm_speed))

    def filtered(self, x: np.ndarray, response: Any) -> np.ndarray:
        return np.fft.ifft(np.fft.fft(x) * response).real

    def mean(self, x: np.ndarray) -> float:
        return float(np.mean(x))


@pytest.fixture(scope="module")
def orbit(document: dict[str, Any]) -> Orbit:
    loop = rational_elbow(row_1("2.5 deg").to_system(), np.zeros(1))
    return Orbit(loop, document["evidence"])


@pytest.mark.slow
def test_the_balance_of_power_holds_on_an_orbit(orbit: Orbit) -> None:
    v = orbit.v
    supplied = orbit.mean(orbit.torque * orbit.seen)
    spent = v["back_emf"] * orbit.mean(orbit.i**2) + v["friction"] * orbit.mean(abs(orbit.speed)) + orbit.lost
    spent += v["viscous"] * orbit.mean(orbit.arm_speed**2)
    assert supplied == pytest.approx(spent, rel=1e-3)


def test_the_contact_loses_what_its_two_sides_say(orbit: Orbit) -> None:
    k, c = orbit.v["contact_stiffness"], orbit.v["contact_damping"]
    # Up to what sampling every 14 us does to a force that jumps.
    assert all(np.min(rho) > -2e-3 * np.max(zeta) for zeta, rho in orbit.sides)
    rates = sum(orbit.mean(rate**2) for rate in orbit.rates)
    slow = sum(orbit.mean(rho**2) for _, rho in orbit.sides)
    assert orbit.lost * 1.001 >= c * rates
    assert orbit.lost * 1.001 >= 0.75 * k**2 / c * slow
    assert 2.001 * rates >= orbit.mean(orbit.z**2)


def shaped(orbit: Orbit, document: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """What i, z, rho and q add to the distance of the angles, and what the gap does, by the filters of the proof."""
    v, s, e = orbit.v, orbit.s, document["evidence"]
    k, c, mass = v["contact_stiffness"], v["contact_damping"], v["viscous"] + v["inertia"] * s
    n, d = (np.polynomial.polynomial.polyval(s, [float(Fraction(x)) for x in e[name]]) for name in "nd")
    with np.errstate(invalid="ignore", divide="ignore"):
        ahead = np.where(s == 0, 0.0, (orbit.turn - 1.0) / s) * (1.0 + v["lag"] * s)
        second = np.where(s == 0, 0.0, (1.0 - (mass * s + c * s + k) * n / (k * d)) / s)
    first = ahead + mass * (1.0 + v["lag"] * s) * n / (k * d)
    third = mass * s * n / (k * d) - 1.0
    made = orbit.filtered(orbit.i, first) + orbit.filtered(orbit.z, second) + orbit.filtered(orbit.rho, third)
    return made + orbit.filtered(orbit.q, second + mass * n / (k * d) + c / k), orbit.filtered(orbit.gap, -third)


def test_the_distance_of_the_two_angles_is_that_of_the_filters(orbit: Orbit, document: dict[str, Any]) -> None:
    linear, across = shaped(orbit, document)
    made = linear + across - orbit.v["radius"] * orbit.pull / orbit.v["contact_stiffness"]
    assert np.max(abs(made - orbit.y)) < 2e-3 * np.max(abs(orbit.y))


def test_the_drive_gains_no_more_than_the_proof_allows(orbit: Orbit, document: dict[str, Any]) -> None:
    linear, across = shaped(orbit, document)
    mu, press = float(Fraction(document["evidence"]["mu"])), orbit.v["radius"] * orbit.v["max"] / 1000.0 / 2.0
    gained = orbit.mean(orbit.torque * orbit.seen)
    allowed = (
        orbit.mean(linear * orbit.seen) / 2.0 + mu / 4.0 * orbit.mean(orbit.i**2) + orbit.mean(linear**2) / 4.0 / mu
    )
    allowed += (np.max(abs(across)) + press) * orbit.mean(abs(orbit.seen))
    assert 0.0 < gained <= orbit.gain * allowed
    assert orbit.mean(orbit.seen**2) == pytest.approx(orbit.mean(orbit.i**2), rel=1e-9)


def test_the_polynomial_is_that_of_the_responses(document: dict[str, Any]) -> None:
    """The checker's, in rationals, against complex numbers at a few frequencies; the forearm's friction adds 1e-3."""
    v = {name: Fraction(document["loop"][name]) for name in check_elbow.NAMES}
    e = {name: [*map(Fraction, x)] if isinstance(x, list) else Fraction(x) for name, x in document["evidence"].items()}
    polynomial, _, full, late, lag = check_elbow.share(v, e)
    limit = 4 * e["mu"] / check_elbow.slope_and_pull(v)[0]
    whole = check_elbow.times(*map(check_elbow.size, (full, lag, late)), limit)
    for omega in (1.0, 30.0, 120.0, 150.0, 400.0, 3000.0):
        left, of = (float(sum(c * Fraction(omega) ** (2 * i) for i, c in enumerate(p))) for p in (polynomial, whole))
        assert 1.0 - left / of == pytest.approx(float(gained(document, np.array([omega]))[0]), abs=2e-3)


def test_means_of_impulse_responses_are_those_of_quadrature() -> None:
    """1/(s + 1) less twice 1/(2 - s) to the other side, and a swing: bounds from above, and near."""
    two = [[Fraction(x) for x in p] for p in ([0, -3], [2, 1, -1])]
    assert float(check_elbow.mean_size(*two)) == pytest.approx(2.0, rel=1e-6)
    swing = [[Fraction(1)], [Fraction(1), Fraction(1, 5), Fraction(1)]]
    root = np.sqrt(0.99)
    exact = 1.0 / np.tanh(np.pi * 0.1 / root / 2.0)
    assert exact <= float(check_elbow.mean_size(*swing).upper()) <= 1.01 * exact


@pytest.mark.parametrize(
    ("profile_range", "least"), [("2.5 lbf", 0.065), pytest.param("5 lbf", 0.14, marks=pytest.mark.slow)]
)
def test_a_small_gap_is_proved_and_a_larger_one_is_not(profile_range: str, least: float) -> None:
    proved = epp.certify(row_1(f"{least} deg", profile_range), "absence")
    assert proved.proved and "for any gap up to" in str(proved)
    assert 0.2 < np.max(proved.plot().lines[0].get_ydata()) < 1.0
    refused = epp.certify(row_1("2.5 deg", profile_range), "absence")
    assert not refused.proved and "this one has 2.5" in str(refused)


def test_no_gap_with_a_known_cycle_is_proved() -> None:
    """Row 1 just above its fold at 0.97859 deg, and row 3."""
    for case in (row_1("0.98 deg"), epp.case("gain_brings_it_back")):
        assert not epp.certify(case, "absence").proved


def test_bands_below_a_tension_of_zero_are_not_covered() -> None:
    """A profile as wide as 8 lbf about 2.5 lbf gives the full voltage at no tension of the cable."""
    refused = epp.certify(row_1("0.06 deg", "8 lbf"), "absence")
    assert not refused.proved and "bands that lie at tensions of zero and more" in str(refused)


def test_a_drive_on_a_running_belt_is_not_covered() -> None:
    """Twenty times the friction lets a gap of 0.98 deg be proved; where a belt runs under it, it stops no motion."""
    still = row_1("0.98 deg").to_system()
    elements = (*still.elements[:-1], epp.Friction(20.0 * still.elements[-1].coulomb))
    still = replace(still, elements=elements, x0=np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]))
    belt = replace(still, constant_input=np.array([0.0, 0.0, 0.0, 0.0, 1000.0]))
    assert epp.certify(still, "absence").proved and epp.simulate(still, t_end=5.0).limit_cycle is None
    assert epp.simulate(belt, t_end=5.0).limit_cycle is not None
    refused = epp.certify(belt, "absence")
    assert not refused.proved and "a constant acts on the elbow elsewhere than at its cable" in str(refused)
    pulled = replace(still, constant_state=np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    assert not epp.certify(pulled, "absence").proved


@pytest.mark.parametrize("name", ["elbow", "upright", "robot_servo", "sat_plus_backlash"])
def test_other_loops_of_several_elements_are_not_covered(name: str) -> None:
    found = epp.certify(epp.case(name), "absence")
    assert not found.proved and found.message.startswith("Not covered")


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (("loop", "backlash"), "1/500"),
        (("loop", "friction"), "1/4"),
        (("loop", "delay"), "1/100"),
        (("loop", "back_emf"), "2"),
        (("loop", "contact_damping"), "1/2"),
        (("loop", "inertia"), "1/10"),
        (("loop", "max"), "14"),
        (("loop", "viscous"), "0"),
        (("evidence", "mu"), "1/1000"),
        (("evidence", "sigma"), "1"),
        (("evidence", "n", 0), "2"),
        (("evidence", "n", 1), "1"),
        (("evidence", "d", 4), "0"),
        (("claim", "backlash"), "1"),
        (("statement",), "all is well"),
    ],
)
def test_changed_certificates_are_refused(document: dict[str, Any], place: tuple[Any, ...], value: str) -> None:
    assert check_elbow.verify(document) == document["claim"]
    changed = copy.deepcopy(document)
    part = changed
    for name in place[:-1]:
        part = part[name]
    part[place[-1]] = value
    with pytest.raises(Refused):
        check_elbow.verify(changed)
    with pytest.raises(Refused):
        check_elbow.verify(sealed(changed))
