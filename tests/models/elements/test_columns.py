"""Automata in columns: the rows are those that a builder would list, and are made only where they are asked for."""

from __future__ import annotations

import pickle
from dataclasses import fields
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import eppanalysis as epp
from eppanalysis.errors import ModelError
from eppanalysis.methods.harmonic.elements import PeriodicElement
from eppanalysis.models.elements.columns import Columns
from eppanalysis.models.systems.hybrid import HybridSystem


def listed(map_: epp.PiecewiseLinear) -> epp.Automaton:
    """The automaton of a static map, written down mode by mode and guard by guard."""
    x, a, b = map_.breakpoints, map_.slopes, map_.intercepts
    build = epp.AutomatonBuilder()
    for i in range(a.size):
        build.mode(f"piece {i + 1}", from_input=a[i], constant=b[i])
    for i, edge in enumerate(x):
        left, right = a[i] * edge + b[i], a[i + 1] * edge + b[i + 1]
        over, under, past, slides = i + 1, i, (-1, -1), -1
        if abs(right - left) > 1e-12 * max(abs(left), abs(right)):
            up = 1.0 if right > left else -1.0
            slide = f"slides at breakpoint {i + 1}"
            between = 0.5 * (left + right)
            slides = build.mode(slide, constant=between, sticking=True, level=float(edge), jump=float(right - left))
            over = under = slides
            past = (i + 1, i)
            build.guard(f"leaves breakpoint {i + 1} upward", over, i + 1, on_output=up, constant=float(-up * right))
            build.guard(f"leaves breakpoint {i + 1} downward", over, i, on_output=-up, constant=float(up * left))
        rises = {"on_input": 1.0, "constant": float(-edge), "bypass": past[0], "on_threshold": slides}
        build.guard(f"rises through breakpoint {i + 1}", i, over, **rises)
        falls = {"on_input": -1.0, "constant": float(edge), "bypass": past[1], "on_threshold": slides}
        build.guard(f"falls through breakpoint {i + 1}", i + 1, under, **falls)
    return build.build(start_mode=a.size // 2)


def assert_same(one: Any, other: Any) -> None:
    """Two modes, or two guards, agree in every field to the last bit."""
    for field in fields(one):
        a, b = getattr(one, field.name), getattr(other, field.name)
        assert np.shape(a) == np.shape(b) and np.array_equal(a, b), field.name


numbers = st.integers(-4, 4).map(float)


@st.composite
def maps(draw: st.DrawFn) -> epp.PiecewiseLinear:
    """Pieces that jump, bend or go on at their breakpoints."""
    x = sorted(draw(st.sets(numbers, max_size=5)))
    some = st.lists(numbers, min_size=len(x) + 1, max_size=len(x) + 1)
    return epp.PiecewiseLinear(x, draw(some), draw(some))


@given(maps())
@settings(max_examples=60, deadline=None)
def test_a_static_map_has_the_modes_and_guards_of_a_list(map_: epp.PiecewiseLinear) -> None:
    found, expected = map_.automaton(), listed(map_)
    assert found.start_mode == expected.start_mode
    assert (len(found.modes), len(found.guards)) == (len(expected.modes), len(expected.guards))
    for one, other in zip([*found.modes, *found.guards], [*expected.modes, *expected.guards], strict=True):
        assert_same(one, other)


@given(maps())
@settings(max_examples=30, deadline=None)
def test_the_columns_of_a_list_are_those_of_the_map(map_: epp.PiecewiseLinear) -> None:
    found, expected = map_.automaton(), listed(map_)
    for one, other in ((found.mode_columns, expected.mode_columns), (found.guard_columns, expected.guard_columns)):
        assert one.keys() == other.keys()
        for name, column in one.items():
            assert column.dtype == other[name].dtype and np.array_equal(column, other[name]), name
    np.testing.assert_array_equal(found.by_mode, expected.by_mode)


def test_columns_are_a_sequence_of_rows() -> None:
    automaton = epp.Quantiser(0.5, 2).automaton()
    modes, guards = automaton.modes, automaton.guards
    assert [m.name for m in modes] == [f"piece {i}" for i in range(1, 6)] + [
        f"slides at breakpoint {i}" for i in range(1, 5)
    ]
    assert modes[-1].name == "slides at breakpoint 4" and [m.level for m in modes[-2:]] == [0.25, 0.75]
    assert isinstance(modes[0], epp.Mode) and isinstance(guards[0], epp.Guard) and isinstance(guards[0].mode, int)
    with pytest.raises(IndexError):
        modes[9]
    again = pickle.loads(pickle.dumps(automaton))
    assert_same(again.guards[5], guards[5])


def test_guards_of_each_mode_stand_together() -> None:
    automaton = epp.Play(1.0).automaton()
    modes = [automaton.guards[i].mode for i in automaton.by_mode]
    assert modes == sorted(modes) and automaton.first_of_mode.tolist() == [0, 2, 3, 4]
    assert automaton.followed.tolist() == [False, True, True]
    assert [g.name for g in automaton.guards_of(0)] == ["meets the upper side", "meets the lower side"]
    alone = epp.Sine(1.0).automaton()  # without guards
    assert alone.by_mode.size == 0 and alone.guard_columns["memory_from_input"].shape == (0, 0, 1)


def test_columns_of_a_wrong_shape_are_refused() -> None:
    q = epp.Quantiser(0.5, 2).automaton()
    assert isinstance(q.modes, Columns)
    flat = Columns(epp.Mode, q.modes.name, {**q.mode_columns, "constant": np.zeros((9, 2))})
    with pytest.raises(ModelError, match=r"constant of 'all' has shape \(2,\); expected \(1,\)"):
        epp.Automaton(1, 1, 0, flat, q.guards)
    assert isinstance(q.guards, Columns)
    astray = Columns(epp.Guard, q.guards.name, {**q.guard_columns, "target": q.guard_columns["target"] + 5})
    with pytest.raises(ModelError, match="expected the number of a mode, 0 to 8"):
        epp.Automaton(1, 1, 0, q.modes, astray)


def test_only_rows_that_are_met_are_made(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 2048 levels a motion over five of them makes no more rows than over five of 40."""
    made: list[int] = []
    one = Columns.__getitem__
    monkeypatch.setattr(Columns, "__getitem__", lambda self, i: made.append(1) or one(self, i))
    counts = []
    for levels in (40, 2048):
        made.clear()
        quantiser = epp.Quantiser(1.0, levels)
        loop = epp.LureSystem.from_tf(([5.6], [1, 3, 2, 0]), quantiser, x0=[0.4, 0.6, 0.2])
        HybridSystem.from_lure(loop)
        epp.simulate(loop, t_end=20.0)
        wave = np.array([[0.1, -2.2j, 0.3]])
        PeriodicElement(quantiser, ("free",)).regime(wave, 1.0)
        counts.append(len(made))
    assert counts[0] == counts[1] < 40
