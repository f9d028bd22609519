"""Bodies made of someone's MJCF, as a YAML file describes them (`description.py`)."""

import fnmatch
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import mujoco
import numpy as np

from sim2vr_harness.users import appearance as looks
from sim2vr_harness.users.bodies.body import (
    DEVICES,
    ActuatorGroup,
    Body,
    EffortInputs,
    ResetRule,
    held,
)
from sim2vr_harness.users.bodies.description import (
    ActuatorsDescription,
    BodyDescription,
    read_description,
)
from sim2vr_harness.users.bodies.devices import attach_device
from sim2vr_harness.users.bodies.locking import Lock, lock_joints
from sim2vr_harness.users.bodies.meshes import compose
from sim2vr_harness.users.bodies.options import LEAST_STEP_S, MOST_STEP_S, BodyOptions
from sim2vr_harness.users.bodies.person import Anatomy, Segment
from sim2vr_harness.users.bodies.posture import idle_actuators, still_legs
from sim2vr_harness.users.bodies.reading import check_finite, compiled, read_model
from sim2vr_harness.users.bodies.rules import usual_rule
from sim2vr_harness.users.bodies.spec_body import MEAN_IPD_M, BodyPlan
from sim2vr_harness.users.bodies.tables import load_device_rows
from sim2vr_harness.users.bodies.tailored import tailored_body
from sim2vr_harness.users.name_errors import unknown_name

DESCRIPTIONS = Path(str(resources.files("sim2vr_harness.users").joinpath("data", "described")))
"""Folder of the descriptions that ship with the package."""


def described_body(file: Path, options: BodyOptions) -> Body:
    """Makes the body that a YAML file describes.

    Raises:
        ValueError: the file, the model or what one says of the other cannot be used; names the
            file and the key.
    """
    description = read_description(file)
    if options.torso:
        raise ValueError(
            f"{file}: torso: got true, expected false: trunk and neck are what the MJCF has"
        )
    try:
        return _Described(description, file, options).body()
    except ValueError as error:
        text = str(error)
        raise ValueError(text if text.startswith(str(file)) else f"{file}: {text}") from error


@dataclass(frozen=True)
class _Parts:
    """Names of the model's parts, as they are in the MJCF."""

    joints: tuple[str, ...]
    bodies: tuple[str, ...]
    sites: tuple[str, ...]
    actuators: tuple[str, ...]


class _Described:
    def __init__(self, description: BodyDescription, file: Path, options: BodyOptions) -> None:
        self._file = file
        self._description = description
        self._options = options
        self._source = read_model(description, file)
        model = compiled(self._source)
        check_finite(model)
        self._own_step = float(model.opt.timestep)
        self._parts = _Parts(
            *(
                tuple(getattr(model, kind)(i).name for i in range(count))
                for kind, count in (
                    ("joint", model.njnt),
                    ("body", model.nbody),
                    ("site", model.nsite),
                    ("actuator", model.nu),
                )
            )
        )
        posture, yaw = self._description.posture, math.radians(self._description.place.yaw_deg)
        left = np.array([math.sin(yaw), math.cos(yaw), 0.0])  # turned by yaw it is along y
        self._legs = still_legs(model, posture, left) if posture else None
        wanted = self._description.actuators
        idle = idle_actuators(model, self._legs.locks, self._parts.actuators) if self._legs else ()
        groups: list[ActuatorGroup] = []
        for group in wanted or (ActuatorsDescription(names=("*",)),):
            for name in _found("actuators", group.names, self._parts.actuators):
                if name in idle:
                    continue
                rule = group.rule or usual_rule(model, model.actuator(name).id)
                if groups and groups[-1].rule == rule:
                    groups[-1] = ActuatorGroup(rule, (*groups[-1].actuators, name))
                else:
                    groups.append(ActuatorGroup(rule, (name,)))
        if not groups:
            raise ValueError(
                "actuators: got none in the model that moves a joint, expected at least one"
            )
        self._groups = tuple(groups)
        self._locked = self._locked_joints(model)
        wearable = tuple(
            worn_name for worn_name in DEVICES if worn_name in self._description.devices
        )
        worn = wearable if self._options.devices is None else self._options.devices
        for worn_name in worn:
            _known("device", worn_name, wearable)
        self._devices = worn
        for name in self._devices:
            self._check_device(name)
        for segment in description.anatomy.segments.values():
            for body in segment.bodies:
                _known("anatomy.segments", body, self._parts.bodies)
            for end in (segment.start, segment.end):
                _known("anatomy.segments", end, (*self._parts.bodies, *self._parts.sites))

    def body(self) -> Body:
        """Makes the body."""
        description = self._description
        joints = [name for name in self._parts.joints if name not in self._locked]
        observed = description.observed_joints
        effectors = description.end_effectors
        if effectors is None:
            effectors = held(self._devices) or ("headset",)
        for name in effectors:
            _known("end_effectors", name, (*self._parts.sites, *self._devices))
        lifting = description.effort.lifting
        step = self._options.timestep_s or description.timestep_s or self._own_step
        if not LEAST_STEP_S <= step <= MOST_STEP_S:
            raise ValueError(
                f"timestep_s: got the MJCF's own, {step:g}, expected a number from "
                f"{LEAST_STEP_S:g} to {MOST_STEP_S:g} (s)"
            )
        used = [name for group in self._groups for name in group.actuators]
        plan = BodyPlan(
            name=description.name or self._file.stem,
            devices=self._devices,
            actuator_groups=self._groups,
            end_effectors=effectors,
            timestep=step,
            observed_joints=None
            if observed is None
            else _found("observed_joints", observed, joints),
            reset_rule=ResetRule(**description.reset.model_dump()),
            effort_inputs=EffortInputs(
                lifting=_found("effort.lifting", lifting, used),
                peak_forces=dict(description.effort.peak_forces),
            ),
            ipd_m=description.ipd_m or MEAN_IPD_M,
        )
        table = description.anatomy
        segments = {n: Segment(s.bodies, s.start, s.end) for n, s in table.segments.items()}
        anatomy = Anatomy(table.stature_m, table.mass_kg, segments)
        return tailored_body(plan, self._build, self._options, anatomy)

    def _build(self, appearance: bool) -> mujoco.MjSpec:
        spec = self._source.copy()
        # Takes away what no one uses: other actuators and their tendons, sensors, keyframes.
        used = {name for group in self._groups for name in group.actuators}
        idle = [actuator for actuator in spec.actuators if actuator.name not in used]
        targets = {actuator.target for actuator in idle}
        kept = {actuator.target for actuator in spec.actuators if actuator.name in used}
        for element in [*spec.sensors, *spec.keys, *idle]:
            spec.delete(element)
        for tendon in list(spec.tendons):
            passive = not (np.any(tendon.stiffness) or np.any(tendon.damping))
            if tendon.name in targets - kept and passive and not _coupled(spec, tendon.name):
                spec.delete(tendon)
        lock_joints(spec, self._locked)
        self._place(spec)
        rows = load_device_rows()
        model = compiled(spec)
        for attach_name in self._devices:
            device = self._description.devices[attach_name]  # type: ignore[index]
            pose = np.array(device.pos_m), _unit(device.quat_wxyz)
            if device.site is not None:
                site = model.site(device.site)
                parent = spec.body(model.body(int(site.bodyid[0])).name)
                pose = compose((np.array(site.pos), np.array(site.quat)), pose)
            else:
                parent = spec.body(device.body)
            if attach_name == "headset":
                half = math.radians(self._options.skull_rotation_deg) / 2.0
                down = np.array([math.cos(half), 0.0, math.sin(half), 0.0])
                pose = compose(pose, (np.zeros(3), down))
            attach_device(
                parent, rows[attach_name], pose[0].tolist(), pose[1].tolist(), device.weight
            )
        # A diverged state must stay visible to the caller: no silent reset to the start pose.
        flags = mujoco.mjtDisableBit.mjDSBL_AUTORESET
        if not self._description.contacts:
            flags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        spec.option.disableflags = int(spec.option.disableflags) | int(flags)
        if appearance:
            # Draws the devices, and a room where the model has none.
            if not any(geom.type == mujoco.mjtGeom.mjGEOM_PLANE for geom in spec.geoms):
                looks.draw_room(spec)
            else:
                looks.picture_settings(spec)
            for camera in list(spec.cameras):
                if camera.name in looks.CAMERAS:
                    spec.delete(camera)
            looks.add_cameras(spec)
            looks.draw_devices(spec, self._devices)
        else:
            spec.discard_visual()
        return spec

    # --- what the description says -----------------------------------------------------------

    def _locked_joints(self, model: mujoco.MjModel) -> dict[str, Lock]:
        locked: dict[str, Lock] = dict(self._legs.locks) if self._legs else {}
        for pattern, angle in self._description.locked_joints.items():
            for name in _found("locked_joints", [pattern], self._parts.joints):
                locked[name] = angle
        joint = int(mujoco.mjtTrn.mjTRN_JOINT)
        for name in (name for group in self._groups for name in group.actuators):
            actuator = model.actuator(name)
            moved = model.joint(int(actuator.trnid[0])).name if actuator.trntype == joint else None
            if moved in locked:
                raise ValueError(
                    f"locked_joints: got {moved!r}, which the actuator {name!r} moves; expected "
                    "another joint, or actuators without it"
                )
        return locked

    def _check_device(self, name: str) -> None:
        device = self._description.devices[name]  # type: ignore[index]
        if device.site is not None:
            _known(f"devices.{name}.site", device.site, self._parts.sites)
        else:
            _known(f"devices.{name}.body", device.body or "", self._parts.bodies)
        for kind, known in (("body", self._parts.bodies), ("site", self._parts.sites)):
            if name in known:
                raise ValueError(
                    f"devices.{name}: got a model with a {kind} of that name already, expected "
                    f"the name free: rename the model's {kind}, or place the device by it"
                )

    # --- what is made of it ------------------------------------------------------------------

    def _place(self, spec: mujoco.MjSpec) -> None:
        place = self._description.place
        half = math.radians(place.yaw_deg) / 2.0
        whole = np.array(place.pos_m), np.array([math.cos(half), 0.0, 0.0, math.sin(half)])
        if not (any(place.pos_m) or place.yaw_deg or self._legs):
            return
        model = compiled(spec)
        if self._legs:
            model.body_pos[model.body(self._legs.root).id, 2] -= self._legs.lowered_m
        for poses, holders in (
            ((model.body_pos, model.body_quat), model.body_parentid),
            ((model.site_pos, model.site_quat), model.site_bodyid),
        ):
            for i in np.flatnonzero(holders == 0).tolist():
                if holders is model.body_parentid and i == 0:
                    continue
                own = np.array(poses[0][i]), np.array(poses[1][i])
                poses[0][i], poses[1][i] = compose(whole, own)
        spec.copy_back(model)


def _coupled(spec: mujoco.MjSpec, tendon: str) -> bool:
    kind = mujoco.mjtEq.mjEQ_TENDON
    return any(e.type == kind and tendon in (e.name1, e.name2) for e in spec.equalities)


def _found(field: str, patterns: Iterable[str], known: Iterable[str]) -> tuple[str, ...]:
    """The names that patterns stand for, in the patterns' order, each once."""
    names = list(known)
    found: dict[str, None] = {}
    for pattern in patterns:
        matches = [name for name in names if fnmatch.fnmatchcase(name, pattern)]
        if not matches:
            raise ValueError(unknown_name(field, pattern, names))
        found |= dict.fromkeys(matches)
    return tuple(found)


def _known(field: str, name: str, known: Iterable[str] | Mapping[str, object]) -> None:
    names = tuple(known)
    if name not in names:
        raise ValueError(unknown_name(field, name, names))


def _unit(quaternion: Iterable[float]) -> np.ndarray:
    values = np.array(tuple(quaternion))
    return values / np.linalg.norm(values)
