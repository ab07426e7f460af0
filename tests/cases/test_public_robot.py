"""The SO-101 arm, as docs/howto/robot_joint.md reads it.

EPP_SO101 is the folder Simulation/SO101 of https://github.com/TheRobotStudio/SO-ARM100 (fda892c), with meshes or not.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest

import eppanalysis as epp

pytest.importorskip("mujoco")
FOLDER = os.environ.get("EPP_SO101", "")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not FOLDER, reason="EPP_SO101 names no folder Simulation/SO101 of TheRobotStudio/SO-ARM100"),
]


def test_the_joint_of_either_model_is_one(tmp_path: Path) -> None:
    """The link's inertia is what MuJoCo's inverse dynamics give for a unit acceleration at rest, without gravity."""
    (tmp_path / "servo.toml").write_text('kp = "17.8 N*m/rad"')
    cases = [
        epp.from_robot(Path(FOLDER) / f"so101_new_calib.{kind}", "shoulder_pan", actuator=tmp_path / "servo.toml")
        for kind in ("urdf", "xml")
    ]
    for case in cases:
        assert case.value("link_inertia") == pytest.approx(0.015286, rel=1e-4)
    _, described = cases
    assert [described.value(n) for n in ("armature", "damping", "frictionloss")] == [0.028, 0.6, 0.052]
