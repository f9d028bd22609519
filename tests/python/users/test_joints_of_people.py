"""Whether a hand can flick: what wrists of people are judged by."""

import math
from pathlib import Path

import mujoco
import numpy as np

from python.users.bodies import body
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.runs.config import load_config
from sim2vr_harness.users import Body, Physique
from sim2vr_harness.users.bodies.options import JointOptions

CONFIGS = Path(__file__).resolve().parents[3] / "configs"
WRIST = ("flexion", "deviation", "pro_sup")
LOOSE = JointOptions(armature=0.0, damping=0.03)


def loose(*names: str) -> Body:
    return body(person=Physique(joints=dict.fromkeys(names, LOOSE)))


def passive(user: Body, joint: str) -> tuple[float, float, float]:
    """Armature, damping and stiffness."""
    model = user.physics_model
    row = model.joint(joint)
    dof = row.dofadr[0]
    return (
        float(model.dof_armature[dof]),
        float(np.ravel(model.dof_damping[dof])[0]),
        float(np.ravel(model.jnt_stiffness[row.id])[0]),
    )


def inertia(user: Body, joint: str) -> float:
    """About the joint's axis with all other joints held, arms hanging, kg m^2."""
    model = user.physics_model
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    dof = model.joint(joint).dofadr[0]
    unit = np.zeros(model.nv)
    unit[dof] = 1.0
    moved = np.zeros(model.nv)
    mujoco.mj_mulM(model, data, moved, unit)
    return float(moved[dof])


def fastest(user: Body, muscles: tuple[str, ...], joint: str) -> float:
    """The joint's highest speed in half a second of these muscles at full activation, deg/s."""
    model = user.physics_model
    data = mujoco.MjData(model)
    for name in muscles:
        i = model.actuator(name).id
        data.ctrl[i] = data.act[model.actuator_actadr[i]] = 1.0
    dof = model.joint(joint).dofadr[0]
    speeds = []
    for _ in range(round(0.5 / model.opt.timestep)):
        mujoco.mj_step(model, data)
        speeds.append(abs(data.qvel[dof]))
    return math.degrees(max(speeds))


def test_the_published_hand_is_heavy() -> None:
    """A hand of 0.58 kg 5.5 cm from the axis and a controller of 0.13 kg at 4 cm: 0.002 kg m^2.

    Their own inertias make it 0.008. The published joint has 0.1 more, and 0.5 Nms/rad.
    """
    for joint in WRIST:
        assert passive(body(), joint) == (0.1, 0.5, 2.0)
        assert inertia(body(), joint) - 0.1 < 0.01
    assert 0.005 < inertia(body(), "flexion") - 0.1 < 0.01


def test_a_loose_wrist_flicks() -> None:
    extensors = ("ECRL", "ECRB")
    assert fastest(body(), extensors, "flexion") < 350.0
    assert fastest(loose(*WRIST), extensors, "flexion") > 500.0


def test_a_configuration_sets_them_and_nothing_else() -> None:
    key = "env.user.person.joints"
    given = [f"{key}.flexion.armature=0", f"{key}.flexion.damping=0.04"]
    config = load_config(CONFIGS / "pointing_people.yaml", given)
    changed = ResolvedEnv(config.env).body
    assert passive(changed, "flexion") == (0.0, 0.04, 2.0)
    assert passive(changed, "deviation") == (0.1, 0.5, 2.0)
