"""Every body there is, by name or by the file that describes it."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from sim2vr_harness.base.errors import unknown_name
from sim2vr_harness.base.notices import noticed
from sim2vr_harness.users import appearance as looks
from sim2vr_harness.users.bodies.body import ActuatorGroup, Body, BodyPlan, EffortInputs
from sim2vr_harness.users.bodies.described import DESCRIPTIONS, described_body
from sim2vr_harness.users.bodies.description import read_description
from sim2vr_harness.users.bodies.mirror import mirror, swapped
from sim2vr_harness.users.bodies.options import BodyOptions, Physique, ResetOptions
from sim2vr_harness.users.bodies.packages import is_known
from sim2vr_harness.users.bodies.person import Anatomy, Segment, tailored_body
from sim2vr_harness.users.bodies.tables import (
    BodyRow,
    DeviceRow,
    JointRow,
    ModelTables,
    Row,
    Vector,
    load_device_rows,
    load_model_tables,
    load_settings,
    load_torso_tables,
)

_HINGE, _SLIDE = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
_FORCE_CURVE = ("scale", "lmin", "lmax", "vmax", "fpmax", "fvmax")
_PARAMETER_COUNT = 10  # length of MuJoCo's gainprm, biasprm and dynprm


def build_spec(
    tables: ModelTables,
    devices: Sequence[tuple[DeviceRow, str]],
    skull_rotation_wxyz: Sequence[float] | None,
) -> mujoco.MjSpec:
    """Returns a fresh specification of the user with the given devices attached.

    Args:
        tables: the user model.
        devices: VR hardware and the bodies that wear it; each gets a body `<name>` and a site
            `<name>` at its OpenXR pose.
        skull_rotation_wxyz: orientation of the skull in the thorax frame, or None to keep the
            table's. This is how a head without joints looks down.
    """
    spec = mujoco.MjSpec()
    spec.modelname = "sim2vr_user"
    settings = tables.settings
    option = spec.option
    option.timestep = settings["timestep_s"]
    option.gravity = settings["gravity_mps2"]
    option.iterations = settings["solver_iterations"]
    option.tolerance = settings["solver_tolerance"]
    option.ls_iterations = settings["line_search_iterations"]
    option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    option.cone = mujoco.mjtCone.mjCONE_PYRAMIDAL
    # Everything drawn is massless and must never push: collisions are off for the whole model.
    # A diverged state must stay visible to the caller: no silent reset to the start pose.
    option.disableflags = int(
        mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_AUTORESET
    )
    spec.compiler.degree = False
    # Length ranges are given; without this the compiler would replace them by simulated ones.
    spec.compiler.LRopt.mode = mujoco.mjtLRMode.mjLRMODE_NONE
    bodies: dict[str, mujoco.MjsBody] = {"world": spec.worldbody}
    for row in tables.bodies:
        turned = row.name == "skull" and skull_rotation_wxyz is not None
        bodies[row.name] = bodies[row.parent].add_body(
            name=row.name,
            pos=row.pos,
            quat=skull_rotation_wxyz if turned else row.quat_wxyz,
            mass=row.mass,
            ipos=row.com,
            iquat=row.inertia_quat_wxyz,
            inertia=row.inertia,
            explicitinertial=True,
        )
    _add_joints(spec, bodies, tables)
    if tables.muscles:
        _add_muscles(spec, bodies, tables)
    # Adds position servos: torque = kp (target - angle) - kd speed.
    for motors_row in tables.motors:
        actuator = spec.add_actuator(name=motors_row.name)
        actuator.trntype = mujoco.mjtTrn.mjTRN_JOINT
        actuator.target = motors_row.joint
        actuator.gaintype = mujoco.mjtGain.mjGAIN_FIXED
        actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
        actuator.gainprm = _padded([motors_row.kp])
        actuator.biasprm = _padded([0.0, -motors_row.kp, -motors_row.kd])
        actuator.ctrllimited = True
        actuator.ctrlrange = motors_row.limits
        if motors_row.torques is not None:
            actuator.forcelimited = True
            actuator.forcerange = motors_row.torques
    for tip in tables.settings.get("sites", ()):
        bodies[tip["body"]].add_site(
            name=tip["name"], pos=tip["pos_m"], quat=tip["quat_wxyz"], size=[0.004] * 3, group=4
        )
    for device, wearer in devices:
        device.attach(bodies[wearer], device.pos, device.quat_wxyz)
    return spec


def _add_joints(
    spec: mujoco.MjSpec, bodies: dict[str, mujoco.MjsBody], tables: ModelTables
) -> None:
    limit = tables.settings["joint_limit"]
    for row in tables.joints:
        joint = bodies[row.body].add_joint(
            name=row.name,
            type=_SLIDE if row.kind == "slide" else _HINGE,
            pos=row.pos,
            axis=row.axis,
            armature=row.armature,
        )
        # MuJoCo 4 allows a cubic spring and damper; the linear term is the first entry.
        joint.stiffness = [row.stiffness, 0.0, 0.0]
        joint.damping = [row.damping, 0.0, 0.0]
        joint.limited = row.limits is not None
        if row.limits is not None:
            joint.range = row.limits
        joint.solref_limit = limit["solref"]
        joint.solimp_limit = limit["solimp"]
    for coupling in tables.couplings:
        equality = spec.add_equality(
            name=f"{coupling.dependent}_coupling",
            type=mujoco.mjtEq.mjEQ_JOINT,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
            name1=coupling.dependent,
            name2=coupling.driver,
        )
        equality.data = [*coupling.coefficients, *([0.0] * (len(equality.data) - 5))]
        equality.solref = tables.settings["coupling_solref"]
        equality.solimp = coupling.solimp


def _add_muscles(
    spec: mujoco.MjSpec, bodies: dict[str, mujoco.MjsBody], tables: ModelTables
) -> None:
    for point in tables.points:
        bodies[point.body].add_site(name=point.name, pos=point.pos, size=[0.003] * 3, group=4)
    muscle = tables.settings["muscle"]
    for row in tables.muscles:
        tendon = spec.add_tendon(name=f"{row.name}_tendon", width=0.003)
        for point_name in row.path:
            tendon.wrap_site(point_name)
        actuator = spec.add_actuator(name=row.name)
        actuator.trntype = mujoco.mjtTrn.mjTRN_TENDON
        actuator.target = tendon.name
        actuator.dyntype = mujoco.mjtDyn.mjDYN_MUSCLE
        actuator.gaintype = mujoco.mjtGain.mjGAIN_MUSCLE
        actuator.biastype = mujoco.mjtBias.mjBIAS_MUSCLE
        actuator.dynprm = _padded([muscle["activation_tau_s"], muscle["deactivation_tau_s"]])
        # MuJoCo's muscle parameters: range0 range1 F0 scale lmin lmax vmax fpmax fvmax.
        actuator.gainprm, actuator.biasprm = (
            _padded([*curve["range"], row.peak_force, *(curve[key] for key in _FORCE_CURVE)])
            for curve in (muscle["active"], muscle["passive"])
        )
        actuator.lengthrange = row.length_range
        actuator.ctrllimited = True
        actuator.ctrlrange = [0.0, 1.0]


def _padded(values: list[float]) -> list[float]:
    return values + [0.0] * (_PARAMETER_COUNT - len(values))


_SHARED = ("world", "thorax", "skull")


def both_arms(
    one: ModelTables, held: DeviceRow, settings: Mapping[str, Any]
) -> tuple[ModelTables, DeviceRow]:
    """Returns the tables of a body with two arms, and the device in the other hand.

    Args:
        one: the body with a right arm.
        held: the controller in its right hand.
        settings: what the new body's model.json says; the rest is the old one's.
    """
    left = _mirrored(one, held)
    arms = [_arm("_r", one, None), _arm("_l", one, left)]
    shared_joints = tuple(row for row in one.joints if row.body in _SHARED)
    fixed = {row.name for row in shared_joints}
    anatomy = one.settings["anatomy"]
    segments = {
        name: {
            "bodies": [f"{body}{side}" for body in row["bodies"] for side in ("_r", "_l")],
            "start": f"{row['start']}_r",
            "end": f"{row['end']}_r",
        }
        for name, row in anatomy["segments"].items()
    }
    lifting = [f"{name}{side}" for side in ("_r", "_l") for name in one.settings["lifting"]]
    tables = ModelTables(
        bodies=(
            *(row for row in one.bodies if row.name in _SHARED),
            *(row for arm in arms for row in arm.bodies),
        ),
        joints=(*shared_joints, *(row for arm in arms for row in arm.joints)),
        couplings=(
            *(row for row in one.couplings if row.dependent in fixed),
            *(row for arm in arms for row in arm.couplings),
        ),
        muscles=tuple(row for arm in arms for row in arm.muscles),
        motors=(),
        points=tuple(row for arm in arms for row in arm.points),
        bones=(
            *(row for row in one.bones if row.body in _SHARED),
            *(row for arm in arms for row in arm.bones),
        ),
        settings={
            **one.settings,
            "sites": [row for arm in arms for row in arm.settings["sites"]],
            "anatomy": {**anatomy, "segments": segments},
            "lifting": lifting,
            **settings,
        },
    )
    hand_name = swapped(held.name)
    body = left.body(hand_name)
    flip = np.array([1.0, -1.0, 1.0])  # devices' frames have y to the left
    low, high = np.array(held.box_min) * flip, np.array(held.box_max) * flip
    other_hand = DeviceRow(
        name=hand_name,
        pos=_numbers(body.pos),
        quat_wxyz=_numbers(body.quat),
        mass=held.mass,
        com=_numbers(body.ipos),
        inertia_quat_wxyz=_numbers(body.iquat),
        inertia=_numbers(body.inertia),
        openxr_offset=_numbers(left.site(hand_name).pos),
        box_min=_numbers(np.minimum(low, high)),
        box_max=_numbers(np.maximum(low, high)),
    )
    return tables, other_hand


def _arm(side: str, one: ModelTables, model: mujoco.MjModel | None) -> ModelTables:
    """One arm's rows, renamed; `model` is the mirrored body, None: as the tables have it."""

    def named(name: str) -> str:
        return name if name in _SHARED else name + side

    def renamed(row: Row, *names: str, **changed: Any) -> Row:
        return replace(row, **{name: named(getattr(row, name)) for name in names}, **changed)

    def place(site: str, own: Vector) -> Vector:
        return own if model is None else _numbers(model.site(site).pos)

    def site(row: Mapping[str, Any]) -> dict[str, Any]:
        pos, quat = tuple(row["pos_m"]), tuple(row["quat_wxyz"])
        if model is not None:
            pos, quat = (
                _numbers(model.site(row["name"]).pos),
                _numbers(model.site(row["name"]).quat),
            )
        names = {key: named(row[key]) for key in ("name", "body")}
        return {**names, "pos_m": pos, "quat_wxyz": quat}

    bodies = [row for row in one.bodies if row.name not in _SHARED]
    joints = [row for row in one.joints if row.body not in _SHARED]
    if model is not None:
        bodies = [_body(row, model) for row in bodies]
        joints = [replace(row, axis=_numbers(model.joint(row.name).axis)) for row in joints]
    fixed = {row.name for row in one.joints if row.body in _SHARED}
    return ModelTables(
        bodies=tuple(renamed(row, "name", "parent") for row in bodies),
        joints=tuple(renamed(row, "name", "body") for row in joints),
        couplings=tuple(
            renamed(row, "dependent", "driver")
            for row in one.couplings
            if row.dependent not in fixed
        ),
        muscles=tuple(
            renamed(row, "name", path=tuple(map(named, row.path))) for row in one.muscles
        ),
        motors=(),
        points=tuple(
            renamed(row, "name", "body", pos=place(row.name, row.pos)) for row in one.points
        ),
        bones=tuple(
            renamed(
                row,
                "name",
                "body",
                end1=place(f"{row.name} end1", row.end1),
                end2=place(f"{row.name} end2", row.end2),
            )
            for row in one.bones
            if row.body not in _SHARED
        ),
        settings={"sites": [site(row) for row in one.settings["sites"]]},
    )


def _mirrored(one: ModelTables, held: DeviceRow) -> mujoco.MjModel:
    """The left-hander, with sites where the bones end."""
    spec = build_spec(one, [(held, one.settings["devices"][held.name])], None)
    for row in one.bones:
        for end in ("end1", "end2"):
            spec.body(row.body).add_site(name=f"{row.name} {end}", pos=getattr(row, end))
    mirror(spec)
    return spec.compile()


def _body(row: BodyRow, model: mujoco.MjModel) -> BodyRow:
    body = model.body(row.name)
    return replace(
        row,
        pos=_numbers(body.pos),
        quat_wxyz=_numbers(body.quat),
        com=_numbers(body.ipos),
        inertia_quat_wxyz=_numbers(body.iquat),
        inertia=_numbers(body.inertia),
    )


def _numbers(values: Any) -> Vector:
    return tuple(np.asarray(values, dtype=np.float64).tolist())


TORSO_MOTORS: tuple[str, ...] = tuple(row.name for row in load_torso_tables().motors)
"""The six motors, in the order of their actions."""

NOD = "neck_flexion"
"""The hinge that tips the head forward."""

_ROTATIONS_UNDONE = ("clavphant", "scapphant")
_TURNS_WITH_ELV_ANGLE = "humphant"
_NEXT_TO_NOTHING_KGM2 = 1e-3  # as the models' other massless bodies


def with_torso(tables: ModelTables) -> ModelTables:
    """Returns the tables of the same body with a trunk and a neck that move.

    Thorax and skull get masses of trunk and head; the joints that held the thorax go.
    """
    torso = load_torso_tables()
    new = {row.name: row for row in torso.bodies}
    thorax = next(row for row in tables.bodies if row.name == "thorax")
    pelvis = replace(new["pelvis"], pos=thorax.pos, quat_wxyz=thorax.quat_wxyz)
    held = {row.name for row in tables.joints if row.body == "thorax"}

    def body(row: BodyRow) -> BodyRow:
        if row.name in new:
            row = replace(new[row.name], parent=row.parent, pos=row.pos, quat_wxyz=row.quat_wxyz)
        if _stem(row.name) in (*_ROTATIONS_UNDONE, _TURNS_WITH_ELV_ANGLE):
            row = replace(row, inertia=(_NEXT_TO_NOTHING_KGM2,) * 3)
        return row

    def joint(row: JointRow) -> JointRow:
        # elv_angle has the inertia of the body that only it turns.
        if _stem(row.name) != "elv_angle":
            return row
        return replace(row, armature=row.armature + 1.0 - _NEXT_TO_NOTHING_KGM2)

    return replace(
        tables,
        bodies=(pelvis, *(body(row) for row in tables.bodies)),
        joints=(*torso.joints, *(joint(row) for row in tables.joints if row.name not in held)),
        couplings=tuple(row for row in tables.couplings if row.dependent not in held),
        motors=(*tables.motors, *torso.motors),
    )


def _stem(name: str) -> str:
    return name.removesuffix("_r").removesuffix("_l")


def table_body(options: BodyOptions) -> Body:
    """Makes the body whose tables are in the package folder `data/<name>`.

    Raises:
        ValueError: a device that the body cannot wear, or a person that it cannot be.
    """
    tables, known = _tables(options.name)
    if options.torso:
        tables = with_torso(tables)
    settings = tables.settings
    wearable = tuple(settings["devices"])
    worn = wearable if options.devices is None else options.devices
    for name in worn:
        if name not in wearable:
            raise unknown_name("device", name, wearable)
    devices = [(known[name], settings["devices"][name]) for name in worn]
    # A neck looks down by itself.
    skull = None if options.torso else _pitched_down(options.skull_rotation_deg)

    def build(appearance: bool) -> mujoco.MjSpec:
        spec = build_spec(tables, devices, skull)
        if appearance:
            looks.dress(spec, tables, worn)
        return spec

    own_step: float = settings["timestep_s"]
    plan = BodyPlan(
        name=options.name,
        devices=worn,
        actuator_groups=_groups(tables),
        end_effectors=tuple(
            name for name in settings["end_effectors"] if name in worn or name not in wearable
        ),
        timestep=own_step if options.timestep_s is None else options.timestep_s,
        postures=settings.get("postures", {}),
        effort_inputs=EffortInputs(lifting=tuple(settings.get("lifting", ()))),
        stance="seated",
    )
    if options.torso:
        # Has the trunk begin upright and stay so, until its motors get other targets.
        posture = {**plan.reset_rule.posture, NOD: math.radians(options.skull_rotation_deg)}
        plan = replace(
            plan,
            reset_rule=replace(plan.reset_rule, posture=posture, held=TORSO_MOTORS),
            effort_inputs=replace(plan.effort_inputs, loads=TORSO_MOTORS),
            nod=NOD,
        )
    table = settings["anatomy"]
    segments = {
        name: Segment(tuple(row["bodies"]), row["start"], row["end"])
        for name, row in table["segments"].items()
    }
    anatomy = Anatomy(table["stature_m"], table["mass_kg"], segments)
    return tailored_body(plan, build, options, anatomy)


def _tables(name: str) -> tuple[ModelTables, dict[str, DeviceRow]]:
    """A body's tables, and the devices as it holds them."""
    known = load_device_rows()
    settings = load_settings(name)
    if "both_arms_of" not in settings:
        return load_model_tables(name), known
    one = load_model_tables(settings["both_arms_of"])
    tables, left = both_arms(one, known["controller_right"], settings)
    return tables, {**known, left.name: left}


def _groups(tables: ModelTables) -> tuple[ActuatorGroup, ...]:
    """Motors first, then muscles, as in the reference."""
    groups = (
        ActuatorGroup("motor", tuple(motor.name for motor in tables.motors)),
        ActuatorGroup("muscle", tuple(muscle.name for muscle in tables.muscles)),
    )
    return tuple(group for group in groups if group.actuators)


def _pitched_down(degrees: float) -> tuple[float, float, float, float] | None:
    """Rotation of the skull (thorax frame: y up, x forward, z right) that looks down."""
    if degrees == 0.0:
        return None
    half = math.radians(degrees) / 2.0
    return (math.cos(half), 0.0, 0.0, -math.sin(half))


_TABLES = ("mobl_arms_wrist", "mobl_arms_bimanual", "mobl_arms_bimanual_motor")
"""Bodies whose tables are in the package."""


def list_bodies() -> tuple[str, ...]:
    """Returns the names that `load_body` accepts; it also takes a YAML file."""
    return tuple(sorted({*_TABLES, *(file.stem for file in DESCRIPTIONS.glob("*.yaml"))}))


def installed_bodies() -> tuple[str, ...]:
    """Return those of `list_bodies` whose model is there: some need a package of others."""
    needed = {
        name: read_description(DESCRIPTIONS / f"{name}.yaml").package
        for name in list_bodies()
        if name not in _TABLES
    }
    return tuple(
        name
        for name in list_bodies()
        if (package := needed.get(name)) is None or find_spec(package) is not None
    )


def load_body(
    name: str | Path,
    *,
    skull_rotation_deg: float = 10.0,
    devices: Sequence[str] | None = None,
    person: Physique | None = None,
    appearance: bool = True,
    timestep_s: float | None = None,
    torso: bool = False,
    reset: ResetOptions | None = None,
) -> Body:
    """Loads a body.

    Args:
        name: one of `list_bodies()`, or a body's YAML file (docs/reference/bodies.md).
            "mobl_arms_wrist" is the right arm with 7 independent joints and 32 muscles (Saul et
            al. 2015), the SIM2VR paper's Whac-A-Mole user; "mobl_arms_bimanual_motor" has both
            arms and 14 motors, the SIM2VR paper's Beats user; "mobl_arms_bimanual" the first one's
            arm on both sides, 64 muscles.
        skull_rotation_deg: how far the head, and with it the headset, looks down, degrees; with a
            torso at the start only, as the neck moves.
        devices: names of the devices to wear, of those that the body can; None for all of them.
        person: stature, mass, segment lengths, strength and handedness; None for the body as it is.
        appearance: whether the model has drawn (massless, contact-free) shapes, lights, cameras.
        timestep_s: physics step; None takes the body's own (2 ms). At 5 ms a user step costs less
            than half and ends within a millimetre (median, random controls) of where it would.
        torso: whether trunk and neck move, by six motors more.
        reset: how episodes begin, where that differs from the body's own way.

    Raises:
        ValueError: an unknown body, device or part of one, or an option that it cannot have.
    """
    options = BodyOptions(
        name=str(name),
        skull_rotation_deg=skull_rotation_deg,
        devices=None if devices is None else tuple(devices),
        person=person or Physique(),
        appearance=appearance,
        timestep_s=timestep_s,
        torso=torso,
        reset=reset or ResetOptions(),
    )
    if options.name in _TABLES:
        return table_body(options)
    if not is_file(name) and options.name not in list_bodies():
        raise unknown_name("user model", options.name, list_bodies())
    file = Path(name) if is_file(name) else DESCRIPTIONS / f"{options.name}.yaml"
    with noticed(f"Loading the body {options.name}; one with 400 muscles takes half a minute."):
        return described_body(file, options)


def foreign_package(name: str | Path) -> str | None:
    """Return the Python package that loading a body would import and that no one vouches for.

    None where there is none. A file that cannot be read has none: loading it says what is wrong.
    """
    if str(name) in _TABLES or not is_file(name):
        return None
    try:
        description = read_description(Path(name))
    except ValueError:
        return None
    package = description.package if description.model is not None else None
    return None if package is None or is_known(package) else package


def is_file(name: str | Path) -> bool:
    """Return True if a body's name is that of a file."""
    return Path(name).suffix.lower() in (".yaml", ".yml")
