"""Describing functions of elements, of many points at a time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from eppanalysis.engine._engine import (
    describe_automaton,
    describe_clamped,
    describe_lock_pin,
    describe_map,
    describe_nordin_shaft,
    describe_rate_limit,
    describe_rate_limit_inside,
    describe_stiction_pulley,
)

__all__ = [
    "Rules",
    "describe_automaton",
    "describe_clamped",
    "describe_lock_pin",
    "describe_map",
    "describe_nordin_shaft",
    "describe_rate_limit",
    "describe_rate_limit_inside",
    "describe_stiction_pulley",
]


class Rules(NamedTuple):
    """Modes (leading axis m) and guards (g), inputs z, outputs w, memory values h, smooth functions s."""

    from_input: np.ndarray  # (m, w, z)
    from_memory: np.ndarray  # (m, w, h)
    from_smooth: np.ndarray  # (m, w, s)
    constant: np.ndarray  # (m, w)
    smooth_kind: np.ndarray  # (s,) int
    smooth_input: np.ndarray  # (s, z)
    smooth_constant: np.ndarray  # (s,)
    smooth_scale: np.ndarray  # (s,)
    guard_mode: np.ndarray  # (g,) int
    target: np.ndarray  # (g,) int: the mode beyond a sticking one
    on_input: np.ndarray  # (g, z)
    on_rate: np.ndarray  # (g, z)
    on_memory: np.ndarray  # (g, h)
    on_output: np.ndarray  # (g, w)
    guard_constant: np.ndarray  # (g,)
    memory_from_input: np.ndarray  # (g, h, z)
    memory_from_memory: np.ndarray  # (g, h, h)
    memory_constant: np.ndarray  # (g, h)
    start: np.ndarray  # (h,)
