"""People who differ: a body scaled to a stature, a mass, segment lengths and a strength.

Method (docs/reference/bodies.md): lengths of segments are shares of the stature (Drillis and
Contini 1966), masses of segments shares of the body mass (Winter 2009, de Leva 1996), so both scale
with the whole. A segment of length factor s and mass factor f is scaled alike in all directions:
places in it by s, masses by f, inertias by f s^2. A muscle's length range and a tendon's rest
length scale with its path (as OpenSim's scale tool does), so its fibres work in the same part of
their range.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.base.errors import unknown_name
from sim2vr_harness.users.bodies.body import DEVICES, Body, BodyPlan, muscle_peak_force
from sim2vr_harness.users.bodies.meshes import change_mesh_geoms, rescale_meshes
from sim2vr_harness.users.bodies.mirror import mirror, swapped
from sim2vr_harness.users.bodies.options import BodyOptions, JointOptions, Physique
from sim2vr_harness.users.bodies.rules import Motor

FloatArray = NDArray[np.float64]

_LEAST_LENGTH_M = 1e-3

_SLIDE = mujoco.mjtJoint.mjJNT_SLIDE
_JOINT_EQUALITY = mujoco.mjtEq.mjEQ_JOINT
_MUSCLE = mujoco.mjtGain.mjGAIN_MUSCLE


@dataclass(frozen=True)
class Segment:
    """A part of the body whose length is that from one body or site to another."""

    bodies: tuple[str, ...]
    start: str
    end: str


@dataclass(frozen=True)
class Anatomy:
    """Anatomy of the persons whose body was measured; None: unknown, so no scaling by it."""

    stature_m: float | None = None
    mass_kg: float | None = None
    segments: Mapping[str, Segment] = field(default_factory=dict)


def resize(spec: mujoco.MjSpec, person: Physique, anatomy: Anatomy) -> None:
    """Scales the body to the person, in place; devices keep their size and weight.

    Joints keep their ranges, stiffness, damping and armature; muscles their peak force, which
    `strength` sets.

    Raises:
        ValueError: the anatomy does not say what is needed, or the body has a part that cannot be
            scaled.
    """
    if not (
        person.stature_m or person.mass_kg or person.segment_lengths_m or person.segment_factors
    ):
        return
    model = spec.compile()
    for i in range(model.neq):
        if model.eq_type[i] != _JOINT_EQUALITY:
            kind = mujoco.mjtEq(int(model.eq_type[i])).name.removeprefix("mjEQ_").lower()
            raise ValueError(
                f"person: got a body with the equality {model.equality(i).name!r} ({kind}), "
                "expected couplings of joints only"
            )
    if model.nflex:
        raise ValueError("person: got a body with a flex, expected rigid parts only")
    whole, mass = _whole(person, anatomy)
    lengths = np.full(model.nbody, whole)
    for name, length_m in person.segment_lengths_m.items():
        if name not in anatomy.segments:
            raise unknown_name("person.segment_lengths_m", name, anatomy.segments)
        segment = anatomy.segments[name]
        own = segment_length(model, segment)
        if own < _LEAST_LENGTH_M:
            raise ValueError(
                f"anatomy.segments.{name}: got {segment.start!r} and {segment.end!r} in one place, "
                "expected two ends with a length between them"
            )
        if not own / 3.0 <= length_m <= own * 3.0:
            raise ValueError(
                f"person.segment_lengths_m.{name}: got {length_m} m, expected a third to three "
                f"times the body's own {own:.3f} m"
            )
        lengths[[model.body(body).id for body in segment.bodies]] = length_m / own
    for name, factor in person.segment_factors.items():
        if name not in anatomy.segments:
            raise unknown_name("person.segment_factors", name, anatomy.segments)
        lengths[[model.body(body).id for body in anatomy.segments[name].bodies]] = whole * factor
    worn = [model.body(name).id for name in DEVICES if _has_body(model, name)]
    masses = np.full(model.nbody, mass)
    lengths[worn] = masses[worn] = 1.0
    _scale(spec, model, lengths, masses, whole)


def strengthen(spec: mujoco.MjSpec, strength: float) -> None:
    """Multiplies peak forces of muscles, and gains and limits of other actuators, in place."""
    if strength == 1.0:
        return
    model = spec.compile()
    for i in range(model.nu):
        if model.actuator_gaintype[i] == _MUSCLE:
            force = strength * muscle_peak_force(model, i)
            model.actuator_gainprm[i, 2] = force
            if model.actuator_biastype[i] == mujoco.mjtBias.mjBIAS_MUSCLE:
                model.actuator_biasprm[i, 2] = force
        else:
            model.actuator_gainprm[i] *= strength
            model.actuator_biasprm[i] *= strength
        model.actuator_forcerange[i] *= strength
    spec.copy_back(model)


def change_joints(spec: mujoco.MjSpec, joints: Mapping[str, JointOptions]) -> None:
    """Sets what joints have beside bones and muscles, in place.

    Raises:
        ValueError: a joint that the body does not have.
    """
    known = {joint.name: joint for joint in spec.joints}
    for name, options in joints.items():
        if name not in known:
            raise unknown_name("person.joints", name, tuple(known))
        joint = known[name]
        if options.armature is not None:
            joint.armature = options.armature
        if options.damping is not None:
            joint.damping = [options.damping, 0.0, 0.0]
        if options.stiffness is not None:
            joint.stiffness = [options.stiffness, 0.0, 0.0]


def segment_length(model: mujoco.MjModel, segment: Segment) -> float:
    """Length of a segment in m, in the model's reference posture."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    ends = (_place(model, data, name) for name in (segment.start, segment.end))
    return float(np.linalg.norm(np.subtract(*ends)))


def _place(model: mujoco.MjModel, data: mujoco.MjData, name: str) -> FloatArray:
    return np.array(data.body(name).xpos if _has_body(model, name) else data.site(name).xpos)


def _has_body(model: mujoco.MjModel, name: str) -> bool:
    return mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name) >= 0


def _whole(person: Physique, anatomy: Anatomy) -> tuple[float, float]:
    """Factors on the lengths and on the mass of the whole body."""
    for wanted, own, name in (
        (person.stature_m, anatomy.stature_m, "stature_m"),
        (person.mass_kg, anatomy.mass_kg, "mass_kg"),
    ):
        if wanted is not None and own is None:
            raise ValueError(
                f"person.{name}: got {wanted} for a body that does not say its own, expected "
                f"'{name}' in its anatomy"
            )
    length = 1.0
    if person.stature_m is not None and anatomy.stature_m is not None:
        length = person.stature_m / anatomy.stature_m
    if person.mass_kg is not None and anatomy.mass_kg is not None:
        return length, person.mass_kg / anatomy.mass_kg
    return length, length**2


def _scale(
    spec: mujoco.MjSpec,
    model: mujoco.MjModel,
    lengths: FloatArray,
    masses: FloatArray,
    whole: float,
) -> None:
    """Scales by (nbody,) factors on lengths and masses; `whole` places the body in the world."""
    before = _tendon_lengths(model)
    for i in range(model.nu):  # a force that MuJoCo derives from the inertia would change with it
        if model.actuator_gaintype[i] == _MUSCLE:
            force = muscle_peak_force(model, i)
            model.actuator_gainprm[i, 2] = force
            if model.actuator_biastype[i] == mujoco.mjtBias.mjBIAS_MUSCLE:
                model.actuator_biasprm[i, 2] = force
    holder = np.where(model.body_parentid == 0, whole, lengths[model.body_parentid])
    lengths = lengths.copy()
    lengths[0] = 1.0  # what stands in the room stays
    holder[0] = 1.0
    model.body_pos[:] *= holder[:, None]
    moving = np.arange(model.nbody) > 0
    model.body_ipos[moving] *= lengths[moving, None]
    model.body_mass[moving] *= masses[moving]
    model.body_inertia[moving] *= (masses * lengths**2)[moving, None]
    model.jnt_pos[:] *= lengths[model.jnt_bodyid][:, None]
    model.site_pos[:] *= lengths[model.site_bodyid][:, None]
    model.cam_pos[:] *= lengths[model.cam_bodyid][:, None]
    model.light_pos[:] *= lengths[model.light_bodyid][:, None]
    shapes = np.flatnonzero(model.geom_type != mujoco.mjtGeom.mjGEOM_MESH)
    factor = lengths[model.geom_bodyid[shapes]][:, None]
    model.geom_pos[shapes] *= factor
    model.geom_size[shapes] *= factor
    shown = change_mesh_geoms(model, lambda body, pose: (pose[0] * lengths[body], pose[1]))
    # Ranges, references and couplings of slides carry lengths.
    slides_factor = np.where(model.jnt_type == _SLIDE, lengths[model.jnt_bodyid], 1.0)
    model.jnt_range[:] *= slides_factor[:, None]
    for joint in np.flatnonzero(model.jnt_type == _SLIDE).tolist():
        address = model.jnt_qposadr[joint]
        model.qpos0[address] *= slides_factor[joint]
        model.qpos_spring[address] *= slides_factor[joint]
    for slides_i in range(model.neq):
        driver = int(model.eq_obj2id[slides_i])
        of_driver = slides_factor[driver] if driver >= 0 else 1.0
        of_dependent = slides_factor[model.eq_obj1id[slides_i]]
        model.eq_data[slides_i, :5] *= of_dependent / of_driver ** np.arange(5)
    for slides_i in np.flatnonzero(model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT).tolist():
        model.actuator_lengthrange[slides_i] *= slides_factor[model.actuator_trnid[slides_i, 0]]
    # Rest lengths, limits and length ranges follow the path's length in the reference posture.
    after = _tendon_lengths(model)
    tendons_factor = np.divide(after, before, out=np.ones_like(after), where=before > 0)
    model.tendon_lengthspring[:] *= tendons_factor[:, None]
    model.tendon_range[:] *= tendons_factor[:, None]
    for tendons_i in np.flatnonzero(model.actuator_trntype == mujoco.mjtTrn.mjTRN_TENDON).tolist():
        model.actuator_lengthrange[tendons_i] *= tendons_factor[model.actuator_trnid[tendons_i, 0]]
    spec.copy_back(model)
    rescale_meshes(spec, model, shown, lambda body: (float(lengths[body]),) * 3)


def _tendon_lengths(model: mujoco.MjModel) -> FloatArray:
    data = mujoco.MjData(model)
    data.qpos[:] = model.qpos0
    mujoco.mj_fwdPosition(model, data)
    return np.array(data.ten_length)


def tailored_body(
    plan: BodyPlan,
    build: Callable[[bool], mujoco.MjSpec],
    options: BodyOptions,
    anatomy: Anatomy,
) -> Body:
    """Build the body for the person of `options`.

    Args:
        plan: roles of the body's parts, before mirroring.
        build: returns a new specification of the body as it was measured, with or without visual
            shapes, including devices.
        options: the person and the start state of episodes.
        anatomy: anatomy of the persons whose body was measured.

    Raises:
        ValueError: the body cannot be scaled to the person, or lacks the posture.
    """
    person = options.person
    mirrored = person.handedness is not None and person.handedness != _own_hand(plan)

    def made(appearance: bool) -> mujoco.MjSpec:
        spec = build(appearance)
        resize(spec, person, anatomy)
        strengthen(spec, person.strength)
        change_joints(spec, person.joints)
        if mirrored:
            mirror(spec)
        return spec

    if mirrored:
        plan = replace(
            plan,
            devices=tuple(swapped(name) for name in plan.devices),
            end_effectors=tuple(swapped(name) for name in plan.end_effectors),
        )
    stature_m = person.stature_m or anatomy.stature_m
    plan = replace(plan, ipd_m=person.ipd_m or plan.ipd_m, stature_m=stature_m)
    # The body's own way to begin, changed by what `reset` sets; joints left out stay.
    reset = options.reset
    rule = plan.reset_rule
    if reset.posture is not None and reset.posture not in plan.postures:
        raise unknown_name("reset.posture", reset.posture, plan.postures)
    named = {} if reset.posture is None else plan.postures[reset.posture]
    if posture := {**named, **reset.angles}:
        # Far from 0 the dependent joints cannot start there: the couplings would yank the arm.
        rule = replace(rule, posture={**rule.posture, **posture}, fit_couplings=True)
    if reset.position_range is not None:
        rule = replace(rule, position_range=reset.position_range)
    if reset.velocity_range is not None:
        rule = replace(rule, velocity_range=reset.velocity_range)
    if reset.activation_range is not None:
        rule = replace(rule, activation_range=reset.activation_range)
    if reset.hold:
        motors = (g.actuators for g in plan.actuator_groups if g.rule == Motor.name)
        rule = replace(rule, held=tuple(name for names in motors for name in names))
    plan = replace(plan, reset_rule=rule)
    return Body(plan, made, options.appearance)


def _own_hand(plan: BodyPlan) -> str:
    """The hand that a body plays with: the right one, if it wears a controller there."""
    only_left = "controller_left" in plan.devices and "controller_right" not in plan.devices
    return "left" if only_left else "right"
