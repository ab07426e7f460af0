"""1,500 calls of everything public with one wrong argument each (``pytest tests/stress/test_arguments.py``)."""

from __future__ import annotations

import resource
from collections import Counter
from pathlib import Path

import pytest

from tests.wrong_arguments import calls, outcome

N_CALLS, SEED = 1500, 20050901
#: Address space of the process beyond which an allocation fails: a wrong count must not eat the machine's memory.
_ROOM = 8 << 30


@pytest.mark.filterwarnings("ignore")
def test_wrong_arguments_end_in_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (_ROOM, before[1]))
    try:
        ends = {str(call): outcome(call) for call in calls(SEED)[:N_CALLS]}
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)
    kinds = Counter(ends.values())
    tracebacks = {call: end for call, end in ends.items() if end not in ("refused", "answers", "at work")}
    assert not tracebacks, tracebacks
    assert kinds["refused"] > N_CALLS // 2
