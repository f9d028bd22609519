"""Whether a hand can flick: what wrists of people are judged by."""

import math
from pathlib import Path

import mujoco
import numpy as np
import pytest

from sim2vr_harness.envs.config import body_of
from sim2vr_harness.runs.config import load_config
from sim2vr_harness.users import Body, Physique, load_body
from sim2vr_harness.users.bodies.options import JointOptions
from sim2vr_harness.users.people import PeopleSettings, Population

CONFIGS = Path(__file__).resolve().parents[3] / "configs"
WRIST = ("flexion", "deviation", "pro_sup")
LOOSE = JointOptions(armature=0.0, damping=0.03)


def loose(*names: str) -> Body:
    physique = Physique(joints=dict.fromkeys(names, LOOSE))
    return load_body("mobl_arms_wrist", person=physique)


def passive(body: Body, joint: str) -> tuple[float, float, float]:
    """Armature, damping and stiffness."""
    model = body.physics_model
    row = model.joint(joint)
    dof = row.dofadr[0]
    return (
        float(model.dof_armature[dof]),
        float(np.ravel(model.dof_damping[dof])[0]),
        float(np.ravel(model.jnt_stiffness[row.id])[0]),
    )


def inertia(body: Body, joint: str) -> float:
    """About the joint's axis with all other joints held, arms hanging, kg m^2."""
    model = body.physics_model
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    dof = model.joint(joint).dofadr[0]
    unit = np.zeros(model.nv)
    unit[dof] = 1.0
    moved = np.zeros(model.nv)
    mujoco.mj_mulM(model, data, moved, unit)
    return float(moved[dof])


def fastest(body: Body, muscles: tuple[str, ...], joint: str) -> float:
    """The joint's highest speed in half a second of these muscles at full activation, deg/s."""
    model = body.physics_model
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
    body = load_body("mobl_arms_wrist")
    for joint in WRIST:
        assert passive(body, joint) == (0.1, 0.5, 2.0)
        assert inertia(body, joint) - 0.1 < 0.01
    assert 0.005 < inertia(body, "flexion") - 0.1 < 0.01


def test_only_what_is_named_changes() -> None:
    published, body = load_body("mobl_arms_wrist"), loose("flexion")
    assert passive(body, "flexion") == (0.0, 0.03, 2.0)
    for joint in published.independent_joints:
        if joint != "flexion":
            assert passive(body, joint) == passive(published, joint)
    assert inertia(body, "flexion") == pytest.approx(inertia(published, "flexion") - 0.1)


def test_a_loose_wrist_flicks() -> None:
    extensors = ("ECRL", "ECRB")
    assert fastest(load_body("mobl_arms_wrist"), extensors, "flexion") < 350.0
    assert fastest(loose(*WRIST), extensors, "flexion") > 500.0


def test_a_stranger_s_body_has_joints_too() -> None:
    file = CONFIGS.parent / "docs" / "examples" / "own_body" / "body.yaml"
    joint = load_body(file).independent_joints[0]
    options = JointOptions(armature=0.07, damping=0.8, stiffness=3.0)
    body = load_body(file, person=Physique(joints={joint: options}))
    assert passive(body, joint) == (0.07, 0.8, 3.0)


def test_left_handers_and_people_keep_them() -> None:
    physique = Physique(joints={"flexion": LOOSE})
    left = load_body("mobl_arms_wrist", person=physique.model_copy(update={"handedness": "left"}))
    assert passive(left, "flexion") == (0.0, 0.03, 2.0)
    people = Population(PeopleSettings(), physique)
    somebody = load_body("mobl_arms_wrist", person=people.physique(people.number(3)))
    assert passive(somebody, "flexion") == (0.0, 0.03, 2.0)


def test_a_joint_that_is_not_there_is_named() -> None:
    with pytest.raises(ValueError, match=r"person.joints: got 'flexon'.*did you mean 'flexion'"):
        loose("flexon")


def test_people_of_whacamole_have_light_hands() -> None:
    """Both rules' configurations; one setting away from the published body."""
    for name in ("whacamole_people", "whacamole_people_unconstrained"):
        file = CONFIGS / f"{name}.yaml"
        body = body_of(load_config(file).env.user)
        assert [passive(body, joint) for joint in WRIST] == [(0.0, 0.03, 2.0)] * 3
        config = load_config(file, ["env.user.person.joints={}"])
        assert passive(body_of(config.env.user), "flexion") == (0.1, 0.5, 2.0)
        assert passive(body, "elv_angle") == passive(load_body("mobl_arms_wrist"), "elv_angle")


def test_a_configuration_sets_them() -> None:
    key = "env.user.person.joints"
    given = [f"{key}.flexion.armature=0", f"{key}.flexion.damping=0.04"]
    config = load_config(CONFIGS / "pointing_people.yaml", given)
    assert passive(body_of(config.env.user), "flexion") == (0.0, 0.04, 2.0)
    published = body_of(load_config(CONFIGS / "pointing_people.yaml").env.user)
    assert passive(published, "flexion") == (0.1, 0.5, 2.0)
