"""What is computed when it is looked at: once, and for other processes before."""

from __future__ import annotations

import pickle

from eppanalysis.results.deferred import Deferred


def test_it_is_computed_once_and_when_it_is_looked_at() -> None:
    made: list[int] = []
    values = Deferred(lambda: made.append(1) or {"gap": 2.0})
    assert not made
    assert values["gap"] == 2.0 and dict(values) == {"gap": 2.0} and len(values) == 1
    assert made == [1]


def test_another_process_gets_plain_values() -> None:
    copy = pickle.loads(pickle.dumps(Deferred(lambda: {"gap": 2.0})))
    assert type(copy) is dict and copy == {"gap": 2.0}
