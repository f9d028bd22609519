"""An editable MuJoCo specification of a body, from its tables alone.

Model: MoBL ARMS dynamic upper limb model (Saul et al. 2015), with the parameters that its MuJoCo
conversion has in the User-in-the-Box reference. There are no meshes and no contacts: muscles are
spatial tendons through points fixed to the bones (no wrapping surfaces), exactly as in the
reference, and VR devices are rigid child bodies of the body that wears or holds them.
"""

from collections.abc import Sequence
from typing import Any

import mujoco

from sim2vr_harness.users.bodies.devices import attach_device
from sim2vr_harness.users.bodies.tables import DeviceRow, ModelTables, MuscleRow

_HINGE, _SLIDE = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
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
        attach_device(bodies[wearer], device, device.pos, device.quat_wxyz)
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
        actuator.gainprm = _force_curve(muscle["active"], row)
        actuator.biasprm = _force_curve(muscle["passive"], row)
        actuator.lengthrange = row.length_range
        actuator.ctrllimited = True
        actuator.ctrlrange = [0.0, 1.0]


def _force_curve(curve: dict[str, Any], row: MuscleRow) -> list[float]:
    """MuJoCo's muscle parameters: range0 range1 F0 scale lmin lmax vmax fpmax fvmax."""
    shape = [curve[key] for key in ("scale", "lmin", "lmax", "vmax", "fpmax", "fvmax")]
    return _padded([*curve["range"], row.peak_force, *shape])


def _padded(values: list[float]) -> list[float]:
    return values + [0.0] * (_PARAMETER_COUNT - len(values))
