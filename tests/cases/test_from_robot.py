"""A robot's joint as a loop, against MuJoCo itself: mass matrix, gravity, motions, and cycles below own controllers."""

from __future__ import annotations

import math
import re
import shlex
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import eppanalysis as epp
from eppanalysis.cli.commands import app

mujoco = pytest.importorskip("mujoco")
pytestmark = pytest.mark.slow

#: Three links, none of whose axes are parallel.
CHAIN = """<mujoco model="chain"><compiler angle="radian" autolimits="true"/>
<default><joint armature="0.002" damping="0.1"/></default>
<worldbody><body name="one" pos="0 0 0.2"><joint name="base" axis="0 0 1"/>
<inertial pos="0.02 0.01 0.05" mass="1.1" diaginertia="0.004 0.005 0.003"/>
<body name="two" pos="0.05 0 0.1"><joint name="shoulder" axis="0 1 0.2" range="-2 2"/>
<inertial pos="0.15 0.02 0.01" mass="0.8" diaginertia="0.001 0.006 0.006"/>
<body name="three" pos="0.3 0 0"><joint name="elbow" axis="0.1 1 0" armature="0.01"/>
<inertial pos="0.1 -0.02 0.03" mass="0.5" diaginertia="0.0008 0.003 0.003"/></body></body></body></worldbody>
<actuator><position joint="base" kp="50"/><position joint="shoulder" kp="80" kv="4" forcerange="-20 20"/>
<position joint="elbow" kp="30" dampratio="1"/></actuator>
<keyframe><key name="home" qpos="0.3 -0.7 1.1"/></keyframe></mujoco>"""

#: The same two links twice: about the axis y, then x forward; the lengths are those of neither's default.
PLANAR = """<mujoco><compiler angle="radian" autolimits="true"/>
<worldbody><body name="upper"><joint name="shoulder" axis="0 1 0" damping="0.2" range="-2 2" actuatorfrcrange="-9 9"/>
<inertial pos="0.11 0 0" mass="0.9" diaginertia="0.001 0.004 0.004"/>
<body name="fore" pos="0.25 0 0"><joint name="elbow" axis="0 1 0" frictionloss="0.03" range="-2 2"
actuatorfrcrange="-5 5"/><inertial pos="0.08 0 0" mass="0.4" diaginertia="0.001 0.002 0.002"/></body></body></worldbody>
</mujoco>"""
URDF = """<robot name="arm"><link name="base"/>
<link name="upper"><inertial><origin xyz="0.11 0 0"/><mass value="0.9"/>
<inertia ixx="0.001" iyy="0.004" izz="0.004" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="fore"><inertial><origin xyz="0.08 0 0"/><mass value="0.4"/>
<inertia ixx="0.001" iyy="0.002" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial>
<visual><geometry><mesh filename="package://arm/not_there.stl"/></geometry></visual></link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" effort="9" velocity="3"/><dynamics damping="0.2"/></joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0.25 0 0"/>
<axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="5" velocity="3"/><dynamics friction="0.03"/></joint></robot>"""
TIP = (
    """<inertial><mass value="0.1"/><inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial>"""
)
#: A slide with a spring beside its bearing, which carries a pendulum that stands.
CART = """<mujoco><compiler angle="radian" autolimits="true"/><worldbody>
<body><joint name="cart" type="slide" axis="1 0 0" stiffness="40" springref="0.1" damping="3"/>
<inertial pos="0 0 0" mass="2" diaginertia="0.01 0.01 0.01"/>
<body pos="0 0 0.1"><joint name="pole" axis="0 1 0"/><inertial pos="0 0 0.4" mass="0.3" diaginertia="0.01 0.01 0.01"/>
</body></body></worldbody>
<actuator><motor joint="cart" gear="20" ctrlrange="-1 2"/><velocity joint="pole" kv="0.5"/></actuator></mujoco>"""


def written(folder: Path, text: str, name: str = "robot.xml") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def at_rest(path: Path, pose: dict[str, float]):
    """MuJoCo's model and data of a file, by its own loader."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    for name, position in pose.items():
        data.joint(name).qpos[:] = position
    mujoco.mj_forward(model, data)
    return model, data


def mass_matrix(model, data) -> np.ndarray:
    found = np.zeros((model.nv, model.nv))
    try:
        mujoco.mj_fullM(model, data, found)
    except TypeError:  # before its version 4
        mujoco.mj_fullM(model, found, data.qM)
    return found


def inertia(case: epp.Case) -> float:
    return sum(case.value(name) for name in ("armature", "link_inertia") if name in case.parameters)


@pytest.mark.parametrize("joint", ["base", "shoulder", "elbow"])
@pytest.mark.parametrize("pose", [{}, {"shoulder": 0.9, "elbow": -1.3}, {"base": 2.0, "shoulder": -1.9, "elbow": 0.4}])
def test_inertia_is_the_entry_of_the_mass_matrix(tmp_path, joint, pose):
    path = written(tmp_path, CHAIN)
    case = epp.from_robot(path, joint, pose=pose)
    model, data = at_rest(path, pose)
    i = model.joint(joint).dofadr[0]
    assert inertia(case) == pytest.approx(mass_matrix(model, data)[i, i], rel=1e-9)
    assert case.value("armature") == pytest.approx(0.01 if joint == "elbow" else 0.002, rel=1e-12)


def test_a_keyframe_is_a_pose_and_a_pose_goes_on_from_it(tmp_path):
    path = written(tmp_path, CHAIN)
    keyed = epp.from_robot(path, "shoulder", keyframe="home", pose={"elbow": "90 deg"})
    typed = epp.from_robot(path, "shoulder", pose={"base": 0.3, "shoulder": -0.7, "elbow": math.pi / 2})
    assert inertia(keyed) == pytest.approx(inertia(typed), rel=1e-12)
    assert keyed.value("load_force") == pytest.approx(typed.value("load_force"), rel=1e-12)


def test_urdf_and_mjcf_of_one_arm_agree_with_each_other_and_the_textbook(tmp_path):
    """The mass matrix of two links in a plane is a closed form; a mesh that is not there is not needed."""
    gains = written(tmp_path, 'kp = "20 N*m/rad"\nkd = 1', "gains.toml")
    pose = {"shoulder": 0.3, "elbow": "-50 deg"}
    mjcf, urdf = (
        epp.from_robot(written(tmp_path, text, name), "shoulder", pose=pose, actuator=gains)
        for text, name in ((PLANAR, "arm.xml"), (URDF, "arm.urdf"))
    )
    shared = set(mjcf.parameters)
    assert shared == set(urdf.parameters) >= {"damping", "force_limit", "gravity_stiffness", "load_force"}
    for name in shared:
        assert urdf.value(name) == pytest.approx(mjcf.value(name), rel=1e-9)
    swing = 0.4 * (0.25**2 + 0.08**2 + 2 * 0.25 * 0.08 * math.cos(math.radians(50.0)))
    assert inertia(mjcf) == pytest.approx(0.004 + 0.9 * 0.11**2 + 0.002 + swing, rel=1e-9)
    assert mjcf.value("force_limit") == 9.0
    elbow = epp.from_robot(tmp_path / "arm.urdf", "elbow", actuator=gains)
    assert elbow.value("frictionloss") == pytest.approx(0.03, rel=1e-9) and elbow.value("force_limit") == 5.0


@pytest.mark.parametrize(("joint", "pose"), [("shoulder", {"elbow": 0.5}), ("elbow", {"shoulder": -0.4}), ("base", {})])
def test_gravity_is_the_slope_of_its_torque_by_differences(tmp_path, joint, pose):
    path = written(tmp_path, CHAIN)
    case = epp.from_robot(path, joint, pose=pose)
    step, torques = 1e-4, []
    for move in (-step, 0.0, step):
        model, data = at_rest(path, pose | {joint: pose.get(joint, 0.0) + move})
        torques.append(data.qfrc_bias[model.joint(joint).dofadr[0]])
    found = [case.value(name) if name in case.parameters else 0.0 for name in ("gravity_stiffness", "load_force")]
    assert found == pytest.approx([(torques[2] - torques[0]) / (2 * step), -torques[1]], rel=1e-7, abs=1e-9)
    assert (joint == "base") == ("gravity_stiffness" not in case.parameters)  # its axis is upright


def test_a_slide_and_a_pole_that_stands(tmp_path):
    path = written(tmp_path, CART)
    gains = written(tmp_path, "kp = 3.0", "gains.toml")
    cart, pole = (epp.from_robot(path, name, actuator=gains) for name in ("cart", "pole"))
    assert cart.value("link_inertia") == pytest.approx(2.3, rel=1e-12)
    assert cart.value("load_force") == pytest.approx(40 * 0.1, rel=1e-12)  # of the spring
    assert [cart.value(n) for n in ("gear", "command_limit", "least_command")] == [20.0, 2.0, -1.0]
    assert cart.parameters["stiffness"].unit == "N/m" and pole.parameters["kp"].unit == "N*m/rad"
    assert pole.value("gravity_stiffness") == pytest.approx(-0.3 * 9.81 * 0.4, rel=1e-12)
    assert pole.value("kd") == 0.5 and "load_force" not in pole.parameters


def test_gains_with_a_damping_ratio_and_units_of_the_actuator(tmp_path):
    path = written(tmp_path, CHAIN)
    model, _ = at_rest(path, {})
    case = epp.from_robot(path, "elbow")
    assert case.value("kp") == 30.0
    assert case.value("kd") == pytest.approx(-model.actuator_biasprm[2, 2], rel=1e-12) and case.value("kd") > 0.0


@pytest.mark.parametrize(("pose", "gravity", "error"), [({"elbow": 0.5}, 0, 1e-8), ({"shoulder": -1.4}, -9.81, 3e-4)])
def test_a_small_step_is_mujocos(tmp_path, pose, gravity, error):
    """Position loop, damping, spring and gravity; armatures of 1e9 hold the others, and gravity bends with the sag."""
    held = CHAIN.replace('<joint armature="0.002"', f'<option gravity="0 0 {gravity}"/><joint armature="1e9"')
    held = held.replace("<default><option", "<option").replace('"/><joint', '"/><default><joint', 1)
    held = held.replace('name="shoulder"', 'name="shoulder" armature="0.002" stiffness="3" springref="0.02"')
    path, start = written(tmp_path, held.replace('armature="0.01"', "")), pose.get("shoulder", 0.0)
    case = epp.from_robot(path, "shoulder", pose=pose)
    model, data = at_rest(path, pose)
    model.opt.timestep, model.opt.integrator = 2e-4, mujoco.mjtIntegrator.mjINT_RK4
    data.ctrl[1] = start + 0.002
    place, positions = model.joint("shoulder").qposadr[0], []
    for _ in range(4000):
        mujoco.mj_step(model, data)
        positions.append(data.qpos[place] - start)
    run = epp.simulate(case.with_values({"run.input.size": "0.002 rad", "run.t_end": "0.8 s"}))
    ours = np.interp(4e-4 * np.arange(1, 2001), run.t, run.signals["joint"])
    assert np.diff(run.t).max() < 4.001e-4  # nothing is interpolated
    assert np.abs(ours - positions[1::2]).max() < error * np.ptp(positions)


#: A motor on a joint with an upright axis; what controls it is the tests' own.
MOTOR = """<mujoco><compiler angle="radian"/><option gravity="0 0 0" integrator="RK4" timestep="0.0002"/><worldbody>
<body><joint name="joint" axis="0 0 1" armature="0.01" damping="0.05" stiffness="2"/>
<inertial pos="0.1 0 0" mass="0.5" diaginertia="0.003 0.003 0.005"/></body></worldbody>
<actuator><motor joint="joint" gear="2" ctrlrange="-LIMIT LIMIT"/></actuator></mujoco>"""


def hunted(path: Path, kp: float, ki: float, setpoint: float, every: int, step: float = 0.0) -> tuple[float, float]:
    """Period and peak to peak of MuJoCo's joint below a PI controller that is executed every so many time steps."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data, integral, positions = mujoco.MjData(model), 0.0, []
    sample = every * model.opt.timestep
    for _ in range(round(40.0 / sample)):
        position = data.qpos[0]
        measured = step * math.floor(position / step + 0.5) if step else position
        error = 2.0 * (setpoint - measured)  # as the actuator's travel, by its gear
        integral += ki * sample * error
        data.ctrl[0] = kp * error + integral
        positions.append(position)
        mujoco.mj_step(model, data, every)
    return cycle_of(np.array(positions[len(positions) // 2 :]), sample)


def cycle_of(positions: np.ndarray, sample: float) -> tuple[float, float]:
    middle = (positions.max() + positions.min()) / 2
    upward = np.flatnonzero((positions[:-1] < middle) & (positions[1:] >= middle))
    assert len(upward) > 10
    return float(np.diff(upward).mean()) * sample, float(np.ptp(positions))


@pytest.mark.parametrize("place", [4.5, 4.3])
def test_hunting_across_a_step_of_the_encoder_is_mujocos(tmp_path, place):
    """Sampled integral action seeks a position that lies between two steps, as in MuJoCo, where the test controls."""
    path = written(tmp_path, MOTOR.replace("LIMIT", "0.5"))
    gains = written(tmp_path, 'kp = 0.1\nki = 0.6\nencoder_step = "360/256 deg"', "gains.toml")
    step = 2 * math.pi / 256
    case = epp.from_robot(path, "joint", actuator=gains, sample_time="5 ms")
    run = epp.simulate(case.with_values({"run.input.size": f"{place * step} rad", "run.t_end": "30 s"}))
    period, size = hunted(path, 0.1, 0.6, place * step, 25, step)
    assert run.limit_cycle.period == pytest.approx(period, rel=1e-6)
    assert run.limit_cycle.peak_to_peak["joint"] == pytest.approx(size, rel=1e-3)


def test_a_limited_force_makes_the_cycle_that_mujoco_makes(tmp_path):
    """Too much integral action, limited; in MuJoCo it acts every time step, and is continuous here."""
    path = written(tmp_path, MOTOR.replace("LIMIT", "0.05"))
    case = epp.from_robot(path, "joint", actuator=written(tmp_path, "kp = 0.1\nki = 2", "gains.toml"))
    (cycle,) = epp.find_limit_cycles(case.with_values({"run.input.size": "0.01 rad"}))
    period, size = hunted(path, 0.1, 2.0, 0.01, 1)
    assert cycle.stable
    assert (cycle.period, cycle.peak_to_peak["joint"]) == pytest.approx((period, size), rel=2e-3)


def test_backlash_hunts_as_two_bodies_of_mujoco_do(tmp_path):
    """Rotor and link are two bodies there, and the teeth a force that the test applies."""
    body = '<body><joint axis="0 0 1" damping="{}"/><inertial pos="0 0 0" mass="1" diaginertia="{}"/></body>'
    both = body.format(0.3, "0.01 0.01 0.01") + body.format(0.0, "0.02 0.02 0.02")
    option = '<option gravity="0 0 0" timestep="1e-4"/>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco>{option}<worldbody>{both}</worldbody></mujoco>")
    data, integral, setpoint, half, positions = mujoco.MjData(model), 0.0, math.radians(5.0), math.radians(1.0), []
    for _ in range(160_000):
        (rotor, link), rate = data.qpos, data.qvel[0] - data.qvel[1]
        twist = rotor - link
        pressed = max(0.0, math.copysign(100.0 * (abs(twist) - half), 1) * (abs(twist) > half))
        push = math.copysign(1.0, twist) * max(0.0, pressed + 0.2 * rate * math.copysign(1.0, twist) * (pressed > 0.0))
        integral += 6.0 * 1e-4 * (setpoint - link)
        data.qfrc_applied[:] = 4.0 * (setpoint - link) + integral - push, push
        positions.append(link)
        mujoco.mj_step(model, data)
    period, size = cycle_of(np.array(positions[80_000:]), 1e-4)
    one = MOTOR.replace('damping="0.05" stiffness="2"', 'damping="0.3"').replace('pos="0.1 0 0"', 'pos="0 0 0"')
    one = one.replace("0.003 0.003 0.005", "0.02 0.02 0.02").replace(' gear="2" ctrlrange="-LIMIT LIMIT"', "")
    teeth = 'kp = 4\nki = 6\nbacklash = "2 deg"\ncontact_stiffness = 100\ncontact_damping = 0.2'
    case = epp.from_robot(written(tmp_path, one), "joint", actuator=written(tmp_path, teeth, "teeth.toml"))
    (cycle,) = epp.find_limit_cycles(case)
    assert cycle.stable
    assert (cycle.period, cycle.peak_to_peak["joint"]) == pytest.approx((period, size), rel=2e-3)


def command(*words: object) -> tuple[int, str]:
    found = CliRunner().invoke(app, [*map(str, words)])
    return found.exit_code, found.stdout + found.stderr


def test_the_file_that_is_written_is_checked_and_analysed_and_says_its_sources(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    written(tmp_path, CHAIN)
    motor = 'armature = { value = "0.004 kg*m^2", mark = "data sheet", note = "page 3" }\nfrictionloss = "50 mN*m"'
    written(tmp_path, f"{motor}\nki = 60", "motor.toml")
    options = ["--actuator", "motor.toml", "--encoder", "360/256 deg", "--sample-time", "10 ms", "--keyframe", "home"]
    code, said = command(
        "import", "joint", "robot.xml", "shoulder", *options, "--pose", "elbow=90deg", "-o", "out.toml"
    )
    assert code == 0 and said.splitlines()[0] == (
        "out.toml: Joint shoulder of robot.xml at home, elbow 90deg, without its stops at -2 and 2 rad"
    )
    steps = [line.split()[1:] for line in said.splitlines() if line.startswith("  eppanalysis ")]
    assert [step for step, _ in steps] == ["check", "margins", "simulate", "cycles"]
    for step in steps[:3]:
        code, said = command(*step)
        assert code == 0, said
    case = epp.read_case("out.toml")
    notes = {name: case.parameters[name].note for name in case.parameters if "." not in name}
    assert all(notes.values())
    assert notes["kd"] == "robot.xml, actuator 1, kv" and notes["damping"] == "robot.xml, joint shoulder, damping"
    assert notes["armature"] == "motor.toml, armature: page 3" and case.parameters["armature"].mark == "data sheet"
    assert case.value("frictionloss") == 0.05 and case.value("encoder_step") == 2 * math.pi / 256
    model, data = at_rest(Path("robot.xml"), {"base": 0.3, "shoulder": -0.7, "elbow": math.pi / 2})
    expected = mass_matrix(model, data)[1, 1] - 0.002 + 0.004  # the rotor of the model is replaced
    assert inertia(case) == pytest.approx(expected, rel=1e-9)
    assert command("import", "joint", "robot.xml", "shoulder", "-o", "out.toml")[0] == 0
    assert command("cycles", "out.toml")[0] == 0


OTHERS = """<mujoco><worldbody><body><freejoint name="base"/><geom size="0.1"/>
<body><joint name="ball" type="ball"/><geom size="0.1"/></body>
<body><joint name="pulled" axis="0 1 0"/><geom size="0.1" pos="0.2 0 0"/></body>
<body><joint name="tied" axis="0 1 0"/><geom size="0.1" pos="0.2 0 0"/></body>
<body><joint name="twice" axis="0 1 0"/><geom size="0.1" pos="0.2 0 0"/></body>
<body><joint name="flesh" axis="0 1 0"/><geom size="0.1" pos="0.2 0 0"/></body>
<body><joint name="slow" axis="0 1 0"/><geom size="0.1" pos="0.2 0 0"/></body>
<body><joint name="bare" axis="0 1 0"/><geom size="0.1" pos="0.2 0 0"/></body></body></worldbody>
<tendon><fixed name="belt"><joint joint="pulled" coef="2"/><joint joint="bare" coef="0"/></fixed></tendon>
<equality><joint name="mimic" joint1="tied" joint2="flesh"/></equality>
<actuator><motor name="a" joint="twice"/><position name="b" joint="twice"/><muscle name="m" joint="slow"
lengthrange="0 1"/></actuator></mujoco>"""


@pytest.mark.parametrize(
    ("joint", "options", "sentence"),
    [
        ("base", [], "is a free joint; expected a hinge or a slide, which have one coordinate."),
        ("ball", [], "is a ball joint; expected a hinge or a slide, which have one coordinate."),
        ("pulled", [], "is coupled by tendon belt; expected one that moves alone."),
        ("tied", [], "is coupled by constraint mimic; expected one that moves alone."),
        ("twice", [], "has 2 actuators, a, b; expected one."),
        ("slow", [], "gaintype muscle, biastype muscle, dyntype muscle; expected an affine one without delay"),
        ("bare", [], "has no position loop; expected an actuator with kp, or kp in an actuator file."),
        ("bar", [], "joint is 'bar'; expected a joint of the model: did you mean 'bare'?"),
        ("bare", ["--pose", "bare=3 mm"], "pose.bare is '3 mm'; expected an angle such as '2.5 deg'."),
        ("bare", ["--pose", "ball=3"], "joint ball is a ball joint"),
        ("bare", ["--pose", "bare"], "--pose bare: lacks a field, '=' or a value; expected JOINT=POSITION."),
        ("bare", ["--encoder", "-1 deg"], "encoder_step is '-1 deg'; expected"),
        ("bare", ["--keyframe", "home"], "keyframe is 'home'; expected a keyframe of the model"),
        ("bare", ["--actuator", "a.toml"], "a.toml: stiffnes is 3; expected a field of an actuator: did you mean"),
        ("bare", ["--actuator", "b.toml"], "b.toml: kp is '3 V'; expected"),
        ("bare", ["--actuator", "c.toml"], "has backlash only; expected backlash with contact_stiffness, on a hinge"),
        ("bare", ["--actuator", "none.toml"], "none.toml is missing; expected"),
    ],
)
def test_what_is_no_loop_is_refused_in_a_sentence_and_nothing_is_written(
    tmp_path, monkeypatch, joint, options, sentence
):
    monkeypatch.chdir(tmp_path)
    written(tmp_path, OTHERS)
    for name, text in (("a", "stiffnes = 3"), ("b", 'kp = "3 V"'), ("c", 'kp = 2\nbacklash = "1 deg"\narmature = 1')):
        written(tmp_path, text, f"{name}.toml")
    before = sorted(tmp_path.iterdir())
    code, said = command("import", "joint", "robot.xml", joint, *options, "-o", "out.toml")
    assert code == 2 and sentence in said and len(said.splitlines()) == 1
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize(
    "text", ["<mujoco><worldbody><joint/></worldbody></mujoco>", "kind = 1", "<robot><link/></robot>", "", "\0"]
)
def test_what_mujoco_does_not_read_is_refused_in_a_sentence(tmp_path, monkeypatch, text):
    monkeypatch.chdir(tmp_path)
    written(tmp_path, text)
    code, said = command("import", "joint", "robot.xml", "bare")
    assert code == 2 and "robot.xml: MuJoCo does not read it" in said and len(said.splitlines()) == 1
    assert sorted(tmp_path.iterdir()) == [tmp_path / "robot.xml"]


def test_forces_that_are_not_linear_are_refused(tmp_path):
    fluid = written(tmp_path, CHAIN.replace("<default>", '<option density="1000" viscosity="0.1"/><default>'))
    with pytest.raises(epp.EppError, match="joint shoulder has a damping that is not linear; expected"):
        epp.from_robot(fluid, "shoulder")


def test_what_mujoco_warns_of_is_remarked_and_no_file_of_its_own_appears(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    loose = '<joint name="loose" type="planar"><parent link="fore"/><child link="tip"/><mimic joint="elbow"/></joint>'
    written(tmp_path, URDF.replace("</robot>", f'{loose}<link name="tip">{TIP}</link></robot>'))
    case = epp.from_robot("robot.xml", "shoulder", actuator=written(tmp_path, "kp = 9", "gains.toml"))
    assert case.remarks and all("MuJoCo warns: <mimic> on joint 'loose'" in remark for remark in case.remarks)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["gains.toml", "robot.xml"]
    code, said = command("import", "joint", "robot.xml", "shoulder", "--actuator", "gains.toml", "-o", "out.toml")
    assert code == 0 and case.remarks[0] in said


def test_the_page_shows_what_its_commands_print(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    page = (Path(__file__).parents[2] / "docs" / "howto" / "robot_joint.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```(\w+)\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    shown = {kind: text for kind, text in blocks}
    written(tmp_path, shown["xml"], "arm.xml")
    written(tmp_path, shown["toml"], "servo.toml")
    for line in shown["bash"].splitlines():
        code, said = command(*shlex.split(line)[1:])
        assert code == 0
    assert shown["text"].strip() in said
    known: dict[str, object] = {"epp": epp}
    assignment, expression = shown["python"].splitlines()
    exec(assignment, known)
    said, _, expected = expression.partition("  # ")
    assert eval(said, known) == eval(expected)


def test_without_mujoco_a_sentence_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setattr("eppanalysis.errors.util.find_spec", lambda name: None)
    with pytest.raises(epp.EppError, match=r"from_robot needs mujoco; expected what .* 'eppanalysis\[robot\]'"):
        epp.from_robot(written(tmp_path, CHAIN), "base")
