"""Motions so large that rounding hides what their elements do are no limit cycles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import eppanalysis as epp


def oscillator(element, see: list[float], spring: float = 1.0) -> epp.LureSystem:
    """x'' = -spring x - element(see (x, x'))."""
    return epp.LureSystem.build([[0.0, 1.0], [-spring, 0.0]], [[0.0], [-1.0]], [see], [element], name=str(element))


#: No motion of these is periodic beyond a size of about one, for their work in a period has one sign.
NO_CYCLES = {
    "Coulomb's friction": oscillator(epp.Friction(1.0, 1.0), [0.0, 1.0]),
    "friction that falls": oscillator(epp.Friction(1.0, 1.0, 3.0), [0.0, 1.0]),
    "saturated damping": oscillator(epp.Saturation(-1.0, 1.0), [0.0, 1.0]),
    "play in the spring": oscillator(epp.Play(1.0), [1.0, 0.0], 0.0),
}


@pytest.mark.parametrize("name", NO_CYCLES)
def test_the_size_of_a_start_makes_no_limit_cycle(name: str) -> None:
    for size in 10.0 ** np.arange(1, 17, 3):
        run = epp.simulate(replace(NO_CYCLES[name], x0=np.array([size, 0.0])), t_end=60.0, t_eval=[0.0])
        assert run.limit_cycle is None, size
    assert "less than rounding" in str(run) and run.to_dict()["message"] == run.note


def test_a_motion_whose_element_is_felt_stays_a_limit_cycle() -> None:
    """A relay beside a spring takes nothing from a motion: it comes back after 4 arccos(1/(1 + size)) s."""
    loop = oscillator(epp.Relay(), [1.0, 0.0])
    for size in (1.0, 1e3, 1e6):
        run = epp.simulate(replace(loop, x0=np.array([size, 0.0])), t_end=60.0, t_eval=[0.0])
        assert run.limit_cycle.period == pytest.approx(4.0 * np.arccos(1.0 / (1.0 + size)), rel=1e-12)


@pytest.mark.parametrize("speed", [1e6, 1e18])
def test_on_a_belt_too_fast_for_its_friction_to_be_felt_no_orbit_closes(speed: float) -> None:
    """Friction that falls with the speed makes every motion grow that does not stick; here by less than rounding."""
    system = replace(epp.case("belt_leine").to_system(), constant_input=np.array([-speed]))
    for size in (1.0, 0.1 * speed):
        run = epp.simulate(replace(system, x0=np.array([size, 0.0])), t_end=60.0, t_eval=[0.0])
        assert run.limit_cycle is None


#: Behind a dead time of one radian these take from a motion, or add to it, in each period what their sign says; the
#: saturation's output moves while it is under way, the relay's only jumps.
LATE = {"relay": epp.Relay(), "saturation": epp.Saturation(-1.0, 1.0)}


@pytest.mark.parametrize("name", LATE)
def test_behind_a_dead_time_no_orbit_closes_whose_element_is_beneath_rounding(name: str) -> None:
    loop = replace(oscillator(LATE[name], [1.0, 0.0]), delays=np.array([1.0]))
    for size in 10.0 ** np.arange(3, 19, 3):
        run = epp.simulate(replace(loop, x0=np.array([0.3 * size, size])), t_end=60.0, t_eval=[0.0])
        assert run.limit_cycle is None, size


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e6])
def test_what_decays_without_end_does_not_swing_when_it_is_rounding(unit: float) -> None:
    """Two springs that meet at zero: by one ratio a turn down to the last digits, and at rest behind that."""
    springs = epp.PiecewiseLinear([0.0], [2.27, 1.63], [0.0, 0.0])
    loop = epp.LureSystem.from_tf(([0.953], [1.0, 0.225, 0.0]), springs)
    for t_end in (400.0, 1000.0):
        run = epp.simulate(replace(loop, x0=unit * loop.x0), t_end=t_end, t_eval=[0.0])
        assert run.status is epp.Status.SETTLED and run.limit_cycle is None
