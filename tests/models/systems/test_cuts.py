"""Places at which a loop can be cut: what they are where nothing is said, and that they go with the loop."""

from dataclasses import replace

import numpy as np
import pytest

import eppanalysis as epp
from tests.coordinates import in_coordinates, orthogonal

OMEGA = np.geomspace(0.03, 30.0, 25)


def from_disturbance(system: epp.LureSystem, name: str, gains: np.ndarray) -> np.ndarray:
    """Response from the disturbance at a place to its signal, the elements being gains: the equations as they stand."""
    cuts, i = system.places, system.places.number(name)
    n, nz = len(system.A), len(system.C)
    found = []
    for w in OMEGA:
        late, own = np.exp(-1j * w * system.delays), np.exp(-1j * w * cuts.delays[i])
        left = np.block(
            [
                [1j * w * np.eye(n) - system.A, -(system.B * late) @ gains],
                [-system.C, np.eye(nz) - system.D @ gains],
            ]
        )
        right = np.concatenate([own * cuts.B[:, i], cuts.E[:, i]])
        found.append(np.concatenate([cuts.C[i], cuts.D[i] @ gains]) @ np.linalg.solve(left, right) + cuts.F[i])
    return np.array(found)


def opened(system: epp.LureSystem, name: str, gains: np.ndarray) -> np.ndarray:
    """Return ratio: what comes back to the place of one that is sent off from it, with the sign of a feedback of -1."""
    T = from_disturbance(system, name, gains)
    return -T / (1.0 + T)


class TestOfElements:
    def test_the_inputs_and_outputs_of_elements_are_places(self) -> None:
        elements = [epp.LockPin(0.1, 5.0, 0.2), epp.Saturation(-1.0, 1.0)]
        loop = epp.LureSystem.build(
            -np.eye(2), np.eye(2), np.ones((3, 2)), elements, element_names=["gear", "drive"], delays=[0.0, 0.3]
        )
        places = loop.places
        assert places.names == ("gear.in1", "gear.in2", "drive.in", "gear.out", "drive.out")
        assert places.delays.tolist() == [0.0, 0.0, 0.0, 0.0, 0.3]
        np.testing.assert_array_equal(places.B[:, 3:], loop.B)
        np.testing.assert_array_equal(places.C[:3], loop.C)

    @pytest.mark.parametrize("place", ["saturation.in", "saturation.out"])
    def test_around_a_single_loop_every_place_has_the_response_of_the_plant(self, place: str) -> None:
        loop = epp.LureSystem.from_tf(([4.0], [1.0, 2.0, 3.0]), epp.Saturation(-1.0, 1.0), delay=0.2)
        s = 1j * OMEGA
        plant = 4.0 / (s**2 + 2.0 * s + 3.0) * np.exp(-0.2 * s)
        np.testing.assert_allclose(opened(loop, place, np.eye(1)), plant, rtol=1e-12)

    def test_places_that_are_given_stand_before_them_and_hide_those_of_their_name(self) -> None:
        loop = epp.LureSystem.from_tf(([1.0], [1.0, 1.0]), epp.Saturation(-1.0, 1.0))
        cuts = epp.Cuts(("motor", "saturation.in"), B=[[1.0, 0.0]], E=[[0.0, 1.0]], C=[[0.0], [-1.0]], D=[[1.0], [0.0]])
        assert replace(loop, cuts=cuts).places.names == ("motor", "saturation.in", "saturation.out")


def servo(**options: object) -> epp.LureSystem:
    """A motor with a lag, driven through a saturation, with a place at its command and one at its speed."""
    A, B, C = [[0.0, 1.0, 0.0], [0.0, -1.0, 2.0], [-3.0, 0.0, -4.0]], [[0.0], [0.5], [1.0]], [[-1.0, 0.0, 0.2]]
    cuts = epp.Cuts(
        ("command", "speed"),
        B=[[0.0, 1.0], [2.0, -1.0], [0.0, 0.0]],
        E=[[0.2, 0.0]],
        C=[[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]],
        D=[[0.3], [0.0]],
        F=[0.1, 0.0],
        delays=[0.0, 0.05],
    )
    return epp.LureSystem.build(A, B, C, [epp.Saturation(-1.0, 1.0)], cuts=cuts, **options)


@pytest.mark.parametrize("name", ["command", "speed", "saturation.out"])
@pytest.mark.parametrize("seed", [1, 2])
def test_places_go_with_the_coordinates(name: str, seed: int) -> None:
    loop, T = servo(), orthogonal(3, seed)
    there = opened(loop, name, np.eye(1))
    np.testing.assert_allclose(opened(in_coordinates(loop, T), name, np.eye(1)), there, rtol=1e-11)
    np.testing.assert_allclose(opened(loop.in_coordinates(T.T, T), name, np.eye(1)), there, rtol=1e-11)
    np.testing.assert_allclose(opened(loop.with_integrators_apart[0], name, np.eye(1)), there, rtol=1e-11)


def test_places_go_with_the_states_that_elements_bring() -> None:
    # A saturation with a lead-lag before them that passes straight through, and a lag behind: as the element's own
    # states, and as blocks of the plant.
    plant, before, behind = ([1.0], [1.0, 3.0, 2.0]), epp.StateSpace([[-4.0]], [[1.0]], [[-3.0]], [[1.0]]), 0.5
    rules = epp.Saturation(-1.0, 1.0).automaton()
    own = epp.OwnStates(
        np.diag([-4.0, -1.0 / behind]),
        [[1.0, 0.0], [0.0, 1.0 / behind]],
        [[-3.0, 0.0], [0.0, 1.0]],
        [[1.0, 0.0], [0.0, 0.0]],
    )
    element = epp.AutomatonElement(rules, own)
    outside = epp.LureSystem.from_blocks([before, epp.Saturation(-1.0, 1.0), ([1.0], [behind, 1.0]), plant])
    A, b, c = np.array([[-3.0, -2.0], [1.0, 0.0]]), np.array([[1.0], [0.0]]), np.array([[0.0, -1.0]])
    cuts = epp.Cuts(
        ("before", "behind", "inside"),
        B=np.hstack([0.0 * b, b, A[:, :1]]),
        E=[[1.0, 0.0, 0.0]],
        C=np.vstack([c, 0.0 * c, [[1.0, 0.0]]]),
        D=[[0.0], [1.0], [0.0]],
    )
    loop = epp.LureSystem.build(A, b, c, [element], cuts=cuts)
    assert len(loop.A) == 4 and loop.places.names[:3] == ("before", "behind", "inside")
    ring = opened(outside, "saturation.out", np.eye(1))
    for name in ("before", "behind", "automaton.out"):
        np.testing.assert_allclose(opened(loop, name, np.eye(1)), ring, rtol=1e-11)
    # At the first state of the plant, s x = -3 u - 2 u/s + v, where v is what the element adds.
    s = 1j * OMEGA
    returned = ring * (s**2 + 3.0 * s + 2.0) / s**2
    np.testing.assert_allclose(opened(loop, "inside", np.eye(1)), 3.0 / s + 2.0 / s**2 + returned, rtol=1e-10)


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"names": ("a", "a")}, "names is .*; expected different names"),
        ({"B": [[1.0], [2.0]]}, "B has shape"),
        ({"B": [[1.0, np.nan]]}, "B holds a number that is not finite"),
        ({"F": [0.0, -1.0]}, "the loop cut open at b has no solution"),
        ({"delays": [0.0, -0.1]}, "delays is .*; expected zero or positive"),
    ],
)
def test_what_does_not_fit_is_refused(changed: dict, sentence: str) -> None:
    given = {"names": ("a", "b"), "B": [[1.0, 2.0]], "E": [[0.0, 0.0]], "C": [[1.0], [2.0]], "D": [[0.0], [0.0]]}
    with pytest.raises(epp.ModelError, match=sentence):
        epp.Cuts(**{**given, **changed})


def test_a_loop_refuses_places_that_are_not_its_own() -> None:
    cuts = epp.Cuts(("command",), B=[[1.0]], E=[[0.0]], C=[[1.0]], D=[[0.0]])
    with pytest.raises(epp.ModelError, match=r"B of the cuts has shape \(1, 1\); expected shape \(2, 1\)"):
        epp.LureSystem.build(-np.eye(2), [[1.0], [0.0]], [[1.0, 0.0]], [epp.Relay()], cuts=cuts)
    with pytest.raises(epp.ModelError, match=r"loop has no place 'comand' to be cut at; did you mean 'command'\?$"):
        servo(margins_at=["comand"])
    with pytest.raises(epp.ModelError, match=r"no place 'sped' to be cut at; did you mean 'speed'\?$"):
        servo().places.number("sped")
    assert servo(margins_at=["speed", "saturation.in"]).margins_at == ("speed", "saturation.in")


def test_a_place_of_two_names_is_listed_once() -> None:
    loop = epp.case("azimuth_servo").to_system()
    assert {"gear.twist", "gear.in1"} <= set(loop.places.names)
    assert "gear.twist" in loop.places.distinct and "gear.in1" not in loop.places.distinct
