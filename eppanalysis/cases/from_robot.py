"""The position loop of one joint of a robot as a case: what MuJoCo makes of its model (URDF, MJCF), with sources."""

from __future__ import annotations

import copy
import math
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from eppanalysis.cases.files import Missing, RawCase, read_raw
from eppanalysis.cases.model import Case, opened
from eppanalysis.cases.values.parameters import read
from eppanalysis.cases.values.quantities import Mark, Parameter, Quantity
from eppanalysis.cases.values.toml import plain_value
from eppanalysis.errors import CaseError, EppError, did_you_mean, require_packages, visible

#: Units of a joint that turns, and of one that slides.
_KINDS = ("position", "force", "stiffness", "damping", "integral", "inertia", "time", "ratio")
_UNITS = {
    "hinge": ("rad", "N*m", "N*m/rad", "N*m*s/rad", "N*m/(rad*s)", "kg*m^2", "s", ""),
    "slide": ("m", "N", "N/m", "N*s/m", "N/(m*s)", "kg", "s", ""),
}
#: What case files call the inertia, the force on it, its position; how positions are shown; a step of the set point.
_BODY = {"hinge": ("inertia", "torque", "angle", "deg", "5 deg"), "slide": ("mass", "force", "position", "mm", "5 mm")}
#: What an actuator file may hold. Of the actuator's own force and travel: kp, kd, ki, force_limit; others of the joint.
FIELDS = {
    "armature": "inertia", "damping": "damping", "frictionloss": "force", "gear": "ratio",
    "kp": "stiffness", "kd": "damping", "ki": "integral", "force_limit": "force",
    "encoder_step": "position", "sample_time": "time",
    "backlash": "position", "contact_stiffness": "stiffness", "contact_damping": "damping",
}  # fmt: skip
#: What MuJoCo says of an actuator, and the enumerations of its words.
_ACTUATOR = {"trntype": "mjtTrn", "gaintype": "mjtGain", "biastype": "mjtBias", "dyntype": "mjtDyn"}
_UNLIMITED, _MOST_LEVELS = (-math.inf, math.inf), 100_000


def from_robot(
    path: str | Path,
    joint: str,
    *,
    keyframe: str | None = None,
    pose: Mapping[str, Any] | None = None,
    actuator: str | Path | None = None,
    encoder: str | float | None = None,
    sample_time: str | float | None = None,
) -> Case:
    """The position loop of one joint of a robot, all others held, as a case with the source of each number.

    MuJoCo reads the model. Inertia is the joint's entry on the diagonal of its mass matrix at the pose, armature
    included; gravity is linearised there, and positions count from there. Damping, dry friction, spring, gear, gains
    and limits of the force are the joint's and its actuator's. Stops, contacts and other joints' motion are left out.

    Parameters
    ----------
    path : str or Path
        URDF or MJCF file.
    joint : str
        A hinge or a slide.
    keyframe : str, optional
        A pose of the model by its name; the reference pose by default.
    pose : mapping of str to str or float, optional
        Positions of joints, this one included, such as ``{"elbow": "90 deg"}``; plain numbers in rad or m.
    actuator : str or Path, optional
        TOML file with what the model lacks or has otherwise: armature, damping, frictionloss, gear, kp, kd, ki,
        force_limit, encoder_step, sample_time, backlash, contact_stiffness, contact_damping; armature to kd as in MJCF.
    encoder : str or float, optional
        Step of the measured position [rad or m], such as ``"360/4096 deg"``.
    sample_time : str or float, optional
        Time between two executions of the controller of the position [s]; continuous by default, as is that of speed.

    Returns
    -------
    Case

    Raises
    ------
    EppError
        If MuJoCo is missing or does not read the model; if the joint is not there, is free or a ball, is coupled by a
        tendon or a constraint, or has several actuators, one that is not affine, or no gain.

    Examples
    --------
    >>> import eppanalysis as epp
    >>> loop = epp.from_robot("arm.xml", "shoulder", encoder="360/4096 deg")
    Traceback (most recent call last):
    eppanalysis.errors.CaseError: arm.xml is missing;
    expected a robot model (URDF or MJCF).
    """
    path, name = Path(path), re.sub(r"\W+", "_", joint, flags=re.ASCII)
    if not path.is_file():
        raise CaseError(str(path), "", Missing(), "a robot model (URDF or MJCF)")
    require_packages("from_robot", "robot", "mujoco")
    options = {"encoder_step": encoder, "sample_time": sample_time}
    import mujoco

    said: list[str] = []
    mujoco.set_mju_user_warning(said.append)  # else it writes its warnings into a file of the current folder
    try:
        found = _Joint(path, joint, keyframe, pose or {})
        given = _given(found, actuator, {name: value for name, value in options.items() if value is not None})
        case = opened(RawCase(name, name, Path(), _Loop(found, given).tables()))
    finally:
        mujoco.set_mju_user_warning(None)
    return replace(case, _remarks=(*case.remarks, *(f"MuJoCo warns: {' '.join(text.split())}" for text in said)))


def _given(joint: _Joint, file: str | Path | None, options: Mapping[str, Any]) -> dict[str, Parameter]:
    """What an actuator file and options say; the note of each number is its source."""
    beside = RawCase("", "from_robot", Path(), dict(options))
    raw = beside if file is None else read_raw(Path(file), str(file))
    found = {}
    for name, value in {**raw.data, **options}.items():
        place, source = (beside, "option") if name in options else (raw, Path(raw.source).name)
        if name not in FIELDS:
            raise place.refused(name, f"a field of an actuator: {did_you_mean(name, FIELDS)}")
        above = 0.0 if name in ("gear", "force_limit") else None
        kind = Quantity(joint.unit(FIELDS[name]), above=above, at_least=0.0 if above is None else None)
        number = read(value, name, place, {}, kind).parameter
        found[name] = replace(number, note=": ".join(filter(None, (f"{source}, {name}", number.note))))
    return found


class _Drive(NamedTuple):
    """An actuator: a force of ``command - kp position - kv speed + offset`` within limits, of its own travel."""

    name: str = ""
    gear: float = 1.0
    kp: float = 0.0
    kv: float = 0.0
    offset: float = 0.0
    limits: tuple[float, float] = _UNLIMITED
    commands: tuple[float, float] = _UNLIMITED


class _Joint:
    """A joint that turns or slides, at rest at a pose, in SI units."""

    def __init__(self, path: Path, name: str, keyframe: str | None, pose: Mapping[str, Any]) -> None:
        self.path, self.name = path, name
        self.pose = ", ".join(filter(None, (keyframe, *(f"{other} {value}" for other, value in pose.items()))))
        self.model = m = _model(path)
        import mujoco

        self.mj, self.data = mujoco, mujoco.MjData(m)
        if keyframe is not None:
            mujoco.mj_resetDataKeyframe(m, self.data, self._index("keyframe", keyframe, m.nkey, m.key))
            self.data.qvel[:] = self.data.ctrl[:] = 0.0
        raw = RawCase("", "from_robot", Path(), {"pose": dict(pose)})
        for other, value in pose.items():
            index, kind = self._found(other)
            number = read(value, f"pose.{other}", raw, {}, Quantity(_UNITS[kind][0])).parameter
            self.data.qpos[m.jnt_qposadr[index]] = number.value
        self.index, self.kind = self._found(name)
        self.place, self.dof = int(m.jnt_qposadr[self.index]), int(m.jnt_dofadr[self.index])
        self.resting, self.moving = self._at(), self._at(speed=1.0)
        self._require_alone()

    def _index(self, what: str, name: str, count: int, get: Any) -> int:
        names = [get(i).name for i in range(count)]
        if not name or name not in names:
            expected = f"a {what} of the model: {did_you_mean(name, filter(None, names))}"
            raise CaseError(str(self.path), what, name, expected)
        return names.index(name)

    def _found(self, name: str) -> tuple[int, str]:
        """Number and kind of a joint."""
        index = self._index("joint", name, self.model.njnt, self.model.joint)
        kind = _word(self.mj.mjtJoint, self.model.jnt_type[index])
        if kind not in _UNITS:
            raise self.refused(f"is a {kind} joint", "a hinge or a slide, which have one coordinate", name)
        return index, kind

    def refused(self, said: str, expected: str, name: str = "") -> EppError:
        return EppError(f"{self.path}: joint {name or self.name} {said}; expected {expected}.")

    def unit(self, kind: str) -> str:
        return _UNITS[self.kind][_KINDS.index(kind)]

    def _at(self, *, position: float = 0.0, speed: float = 0.0) -> Any:
        """MuJoCo's data with the joint alone moved from its pose, and alone in motion."""
        data = copy.copy(self.data)
        data.qpos[self.place] += position
        data.qvel[self.dof] = speed
        self.mj.mj_forward(self.model, data)
        return data

    def _require_alone(self) -> None:
        """Refuse a joint that moves others by a tendon or a constraint."""
        m, moving = self.model, self.moving
        coupled = [f"tendon {m.tendon(tendon).name or tendon}" for tendon in np.flatnonzero(moving.ten_velocity)]
        for kind, number, speed in zip(moving.efc_type, moving.efc_id, moving.efc_vel, strict=True):
            if kind == self.mj.mjtConstraint.mjCNSTR_EQUALITY and abs(speed) > 1e-12:  # more than rounding
                coupled.append(f"constraint {m.eq(number).name or number}")
        if coupled:
            raise self.refused(f"is coupled by {coupled[0]}", "one that moves alone")

    def inertia(self) -> float:
        """Its entry on the diagonal of the mass matrix."""
        unit, column = np.eye(self.model.nv)[self.dof], np.zeros(self.model.nv)
        self.mj.mj_mulM(self.model, self.resting, column, unit)
        return float(column[self.dof])

    def with_actuators(self, field: str) -> float:
        """A number of the joint with those of its actuators, which newer versions have."""
        others = np.ravel(getattr(self.model, f"actuator_{field}", np.zeros(self.model.nu)))
        return float(getattr(self.model, f"dof_{field}")[self.dof] + others @ self.moving.actuator_velocity**2)

    def linear(self, what: str, slope: float, force: str, of: str) -> float:
        """The slope of a force, which must be in proportion to what it is of."""
        for size in (1.0, 2.0):
            given, moved = (float(getattr(data, force)[self.dof]) for data in (self.resting, self._at(**{of: size})))
            if not math.isclose(given - moved, size * slope, rel_tol=1e-9, abs_tol=1e-12):  # rounding
                raise self.refused(f"has a {what} that is not linear", "a force in proportion")
        return slope

    def gravity(self) -> tuple[float, float]:
        """Force of gravity against it at the pose, and the slope of that over its position.

        About an axis the torque of gravity is a sinusoid of the angle: its slope is its value a quarter turn on.
        """
        m, moved = self.model, (0.0, math.pi / 2)
        found = (float((d.qfrc_bias - d.qfrc_gravcomp)[self.dof]) for d in (self._at(position=x) for x in moved))
        weight = float(m.body_subtreemass[m.jnt_bodyid[self.index]]) * float(np.linalg.norm(m.opt.gravity))
        force, slope = (value if abs(value) > 1e-12 * weight else 0.0 for value in found)  # rounding at arms of a metre
        return force, slope if self.kind == "hinge" else 0.0

    def drive(self) -> _Drive:
        """Its actuator; without one there is no gain."""
        m, speeds = self.model, self.moving.actuator_velocity
        acting = np.flatnonzero(speeds)
        if not acting.size:
            return _Drive()
        a, names = int(acting[0]), [m.actuator(a).name or str(a) for a in acting]
        if acting.size > 1:
            raise self.refused(f"has {acting.size} actuators, {', '.join(names)}", "one")
        words = {at: _word(getattr(self.mj, of), getattr(m, f"actuator_{at}")[a]) for at, of in _ACTUATOR.items()}
        way, gain, bias, dynamics = words.values()
        offset, kp, kv = (float(p) for p in m.actuator_biasprm[a, :3] * (1, -1, -1) * (bias == "affine"))
        affine = bias in ("none", "affine") and (gain == "fixed" or not np.any(m.actuator_gainprm[a, 1:3]))
        late = dynamics != "none" or np.ravel(getattr(m, "actuator_delay", np.zeros(m.nu)))[a]
        # An actuator with a gain closes the loop itself: its command is the set point, which does not move.
        if not way.startswith("joint") or gain not in ("fixed", "affine") or not affine or (late and not kp):
            said = ", ".join(f"{at} {word}" for at, word in words.items())
            raise self.refused(f"has actuator {names[0]} of {said}", "an affine one without delay, on the joint")
        commands = _limited(m.actuator_ctrllimited[a] and not kp, m.actuator_gainprm[a, 0] * m.actuator_ctrlrange[a])
        limits = _limited(m.actuator_forcelimited[a], m.actuator_forcerange[a])
        return _Drive(names[0], float(speeds[a]), kp, kv, offset, limits, commands)


def _word(kinds: Any, value: int) -> str:
    """What MuJoCo calls a member of one of its enumerations."""
    return kinds(value).name.partition("_")[2].lower()


def _limited(is_limited: bool, ends: Any) -> tuple[float, float]:
    """A range, given either way round, or none."""
    return (float(min(ends)), float(max(ends))) if is_limited else _UNLIMITED


def _model(path: Path) -> Any:
    """MuJoCo's model of a file, without meshes of bodies whose inertia is given, as they need not be there."""
    import mujoco

    try:
        spec = mujoco.MjSpec.from_file(str(path))
        by_geoms = spec.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
        for geom in [g for g in spec.geoms if g.meshname and g.parent.explicitinertial and not by_geoms]:
            spec.delete(geom)
        used = {geom.meshname for geom in spec.geoms}
        for mesh in [mesh for mesh in spec.meshes if mesh.name not in used]:
            spec.delete(mesh)
        return spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        said = " ".join(str(error).split()).removesuffix(".")
        raise EppError(f"{path}: MuJoCo does not read it ({said}); expected a robot model (URDF or MJCF).") from None


class _Loop:
    """The sections of a case while they grow; signals are left sides of connections."""

    def __init__(self, joint: _Joint, given: Mapping[str, Parameter]) -> None:
        self.joint, self.given, self.connect = joint, given, list[str]()
        self.sections: dict[str, dict[str, Any]] = {"parameters": {}, "blocks": {}, "elements": {}}

    def tables(self) -> dict[str, Any]:
        joint, m = self.joint, self.joint.model
        title = f"Joint {joint.name} of {joint.path.name}{f' at {joint.pose}' if joint.pose else ''}"
        if m.jnt_limited[joint.index]:
            low, high = m.jnt_range[joint.index]
            title += f", without its stops at {low:g} and {high:g} {joint.unit('position')}"
        *_, position, shown, step = _BODY[joint.kind]
        self._body(self._drive(f"joint.{position}"), position)
        return {
            "kind": "diagram",
            "title": visible(title),
            "connect": self.connect,
            "inputs": {"setpoint": f"0 {joint.unit('position')}"},
            "margins_at": "controller",
            **{name: plain_value(section) for name, section in self.sections.items() if section},
            "signals": {"joint": {"of": f"joint.{position}", "unit": shown}},
            "run": {"t_end": "10 s", "input": {"kind": "step", "size": step}},
        }

    def _source(self, attribute: str, of: str = "") -> str:
        return visible(f"{self.joint.path.name}, {of or f'joint {self.joint.name}'}, {attribute}")

    def _number(self, name: str, value: float = 0.0, source: str = "", mark: Mark = "assumed", kind: str = "") -> str:
        """Name of a parameter with what is given, else the model's value; empty where that is zero."""
        unit = self.joint.unit(FIELDS.get(name, kind))
        found = self.given.get(name) or Parameter(value, unit, unit, mark, source)
        if found.value:
            self.sections["parameters"][name] = found
        return name if found.value else ""

    def _part(self, name: str, kind: str, **fields: Any) -> None:
        section = "elements" if kind in ("saturation", "quantiser", "friction", "lock_pin") else "blocks"
        self.sections[section][name] = {
            "kind": kind,
            **{field: value for field, value in fields.items() if value != ""},
        }

    def _through(self, signal: str, name: str, kind: str, **fields: Any) -> str:
        """A signal behind a part."""
        self._part(name, kind, **fields)
        self.connect.append(f"{signal} -> {name}")
        return name

    def _constant(self, name: str, value: float, source: str) -> str:
        """A constant force as the end of a sum, where it is not zero."""
        if number := self._number(f"{name}_force", value, source, "derived", "force"):
            self._part(name, "constant", value=number)
        return f" + {name}" if number else ""

    def _drive(self, position: str) -> str:
        """Controller and actuator; the force on the joint."""
        drive = self.joint.drive()
        who = f"actuator {drive.name}"
        kp = self._number("kp", drive.kp, self._source("kp", who), "tunable")
        kd = self._number("kd", drive.kv, self._source("kv", who), "tunable")
        ki, sample_time = self._number("ki"), self._number("sample_time")
        if not kp:
            raise self.joint.refused("has no position loop", "an actuator with kp, or kp in an actuator file")
        ratio = self.given.get("gear", Parameter(drive.gear)).value
        gear = self._number("gear", drive.gear, self._source("gear", who)) if ratio != 1.0 else ""
        kp, ki, kd = (f"{gear}*{gain}" if gear and gain else gain for gain in (kp, ki, kd))
        law, gains = ("pi", {"kp": kp, "ki": ki}) if ki else ("gain", {"gain": kp})
        measured = position
        if step := self._number("encoder_step"):  # half a turn or a metre to either side
            reach = math.pi if self.joint.kind == "hinge" else 1.0
            levels = min(math.ceil(reach / float(self.given[step].value)), _MOST_LEVELS)
            measured = self._through(position, "encoder", "quantiser", step=step, levels=levels)
        force = self._through(f"setpoint - {measured}", "controller", law, **gains, sample_time=sample_time)
        force = self._limited(force, "command", drive.commands, self._source("ctrlrange", who))
        if kd:  # of an inner loop, which is faster than the controller, and of a speed that is not in steps
            force += f" - {self._through('joint.speed', 'damper', 'gain', gain=kd)}"
        force += self._constant("offset", drive.offset, self._source("biasprm", who))
        force = self._limited(force, "force", *self._limits(drive, float(ratio)))
        return self._through(force, "transmission", "gain", gain=gear) if gear else force

    def _limits(self, drive: _Drive, gear: float) -> tuple[tuple[float, float], str]:
        """Limits of the actuator's force, which those of the joint may narrow, and their source."""
        if given := self.given.get("force_limit"):
            return (-float(given.value), float(given.value)), given.note
        m, i = self.joint.model, self.joint.index
        low, high = _limited(m.jnt_actfrclimited[i], m.jnt_actfrcrange[i] / gear)
        narrower = max(low, drive.limits[0]), min(high, drive.limits[1])
        who = f"actuator {drive.name}" if narrower == drive.limits else ""
        return narrower, self._source("forcerange" if who else "limit of its actuators", who)

    def _limited(self, signal: str, what: str, limits: tuple[float, float], source: str) -> str:
        """A signal within limits, where there are any."""
        if limits == _UNLIMITED:
            return signal
        low, high = limits
        upper = self._number(f"{what}_limit", high, source, kind="force") or "0"
        lower = f"-{upper}" if low == -high else self._number(f"least_{what}", low, source, kind="force") or "0"
        return self._through(signal, f"{what}_limiter", "saturation", lower=lower, upper=upper)

    def _body(self, force: str, position: str) -> None:
        """The mechanics: the joint, or rotor and link with backlash between them."""
        joint, m, source = self.joint, self.joint.model, self._source
        kind, port, *_ = _BODY[joint.kind]
        weight, slope = joint.gravity()
        armature, entry = joint.with_actuators("armature"), "entry in the mass matrix at the pose, less armature"
        spring = joint.linear("spring", float(m.jnt_stiffness[joint.index]), "qfrc_spring", "position")
        viscous = joint.linear("damping", joint.with_actuators("damping"), "qfrc_passive", "speed")
        rotor = self._number("armature", armature, source("armature"))
        link = self._number("link_inertia", joint.inertia() - armature, source(entry), "derived", "inertia")
        damping = self._number("damping", viscous, source("damping"))
        friction = self._number("frictionloss", float(m.dof_frictionloss[joint.dof]), source("frictionloss"))
        own = self._number("stiffness", spring, source("stiffness"), kind="stiffness")
        falls = self._number("gravity_stiffness", slope, source("slope of gravity at the pose"), "derived", "stiffness")
        stiffness = " + ".join(filter(None, (own, falls)))
        load = float(joint.resting.qfrc_spring[joint.dof]) - weight
        loads, driven = self._constant("load", load, source("gravity and spring at the pose")), "joint"
        if teeth := [name for name in ("backlash", "contact_stiffness", "contact_damping") if self._number(name)]:
            driven = "rotor"
            if not (teeth[:2] == ["backlash", "contact_stiffness"] and rotor and joint.kind == "hinge"):
                expected = "backlash with contact_stiffness, on a hinge with armature"
                raise joint.refused(f"has {', '.join(teeth)} only", expected)
            self._part("rotor", kind, **{kind: rotor}, damping=damping)
            self._part("joint", kind, **{kind: link}, stiffness=stiffness)
            self._part("gears", "lock_pin", gap=teeth[0], stiffness=teeth[1], damping=[*teeth, 0.0][2])
            ends = ((position, "twist"), ("speed", "rate"))
            self.connect += [f"rotor.{signal} - joint.{signal} -> gears.{end}" for signal, end in ends]
            self.connect.append(f"gears{loads} -> joint.{port}")
            loads = " - gears"
        else:
            whole = " + ".join(filter(None, (rotor, link)))
            self._part("joint", kind, **{kind: whole}, damping=damping, stiffness=stiffness)
        if friction:
            loads += f" - {self._through(f'{driven}.speed', 'friction', 'friction', coulomb=friction)}"
        self.connect.append(f"{force}{loads} -> {driven}.{port}")
