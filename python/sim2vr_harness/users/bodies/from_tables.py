"""Bodies that are rebuilt from tables: one arm or both, on a trunk that stands still or moves."""

import math
from dataclasses import replace

import mujoco

from sim2vr_harness.users import appearance as looks
from sim2vr_harness.users.bodies.body import ActuatorGroup, Body, EffortInputs
from sim2vr_harness.users.bodies.both_arms import both_arms
from sim2vr_harness.users.bodies.options import BodyOptions
from sim2vr_harness.users.bodies.person import Anatomy, Segment
from sim2vr_harness.users.bodies.spec_body import BodyPlan
from sim2vr_harness.users.bodies.table_spec import build_spec
from sim2vr_harness.users.bodies.tables import (
    DeviceRow,
    ModelTables,
    load_device_rows,
    load_model_tables,
    load_settings,
)
from sim2vr_harness.users.bodies.tailored import tailored_body
from sim2vr_harness.users.bodies.torso import NOD, TORSO_MOTORS, with_torso
from sim2vr_harness.users.name_errors import unknown_name


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
            raise ValueError(unknown_name("device", name, wearable))
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
