"""Forward and inverse kinematics: MuJoCo's own is the reference."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
import torch

from sim2vr_harness.client.frames import aim_direction
from sim2vr_harness.users import Body, BodyPlan, SpecBody, load_body
from sim2vr_harness.users.bodies.options import Physique
from sim2vr_harness.users.kinematics.forward import Linkage, Point
from sim2vr_harness.users.kinematics.forward_torch import Chains
from sim2vr_harness.users.kinematics.inverse import solve

GRIP = Point("controller_right")
AIM = (0.5, 0.0, -float(np.sqrt(0.75)))


def slider() -> Body:
    """A slide, a hinge beside its link's origin, and a follower of a follower's follower."""

    def build(_appearance: bool) -> mujoco.MjSpec:
        return mujoco.MjSpec.from_string("""
            <mujoco><compiler angle="radian"/><worldbody>
              <body pos="0.1 0 1" euler="0.3 0.2 0.1"><geom size=".01"/>
                <joint name="rail" type="slide" axis="0.6 0 0.8" range="-.2 .2" limited="true"/>
                <body pos="0 .1 0" euler="0.2 0 0"><geom size=".01" pos=".2 0 0"/>
                  <joint name="a" axis="0 0 1" pos=".05 .02 0" range="-1 1" limited="true"/>
                  <body pos=".2 0 0"><geom size=".01" pos=".1 0 0"/><joint name="b" axis="0 1 0"/>
                    <body pos=".2 0 .1"><geom size=".01" pos=".1 0 0"/>
                      <joint name="c" axis="1 0 0" ref="0.1"/>
                      <site name="tip" pos=".1 .2 .3" euler="0.1 0.5 0.3"/>
            </body></body></body></body></worldbody>
            <equality><joint joint1="b" joint2="a" polycoef="0.1 0.5 0.2 0 0"/>
              <joint joint1="c" joint2="b" polycoef="0 -0.7 0.3 0.1 0"/></equality></mujoco>""")

    return SpecBody(BodyPlan("slider", (), (), ("tip",), 0.002), build)


def sized(stature_m: float, **factors: float) -> Body:
    person = Physique(stature_m=stature_m, segment_factors=factors)
    return load_body("mobl_arms_wrist", person=person, torso=True, appearance=False)


@pytest.fixture(scope="module")
def bodies() -> list[Body]:
    return [sized(1.52, upper_arm=0.95), sized(1.70), sized(1.93, forearm=1.06)]


def drawn(linkage: Linkage, count: int) -> np.ndarray:
    low, high = linkage.limits.T
    return low + np.random.default_rng(1).random((count, len(low))) * (high - low)


def by_mujoco(body: Body, site: str, joints: tuple[str, ...], q: np.ndarray) -> np.ndarray:
    """(B, 4, 4) transforms of a site in postures (B, J), the other joints at 0."""
    data, found = mujoco.MjData(body.physics_model), np.tile(np.eye(4), (len(q), 1, 1))
    angles = np.clip(np.zeros((len(q), len(body.independent_joints))), *body.joint_ranges.T)
    angles[:, [body.independent_joints.index(joint) for joint in joints]] = q
    for transform, qpos in zip(found, body.coupled_qpos(angles), strict=True):
        data.qpos[:] = qpos
        mujoco.mj_kinematics(body.physics_model, data)
        transform[:3, :3] = data.site(site).xmat.reshape(3, 3)
        transform[:3, 3] = data.site(site).xpos
    return found


@pytest.mark.parametrize(
    ("name", "site"),
    [
        ("mobl_arms_wrist", "controller_right"),
        ("mobl_arms_bimanual", "controller_left"),
        ("slider", "tip"),
    ],
)
def test_places_turns_and_slopes_are_mujoco_s(name: str, site: str) -> None:
    """Of 600 postures, which are more than are computed at once."""
    torso = name == "mobl_arms_bimanual"
    body = slider() if name == "slider" else load_body(name, appearance=False, torso=torso)
    offset = np.array([0.1, -0.2, 0.05])
    linkage = Linkage(body, Point(site, tuple(offset.tolist())))
    q = drawn(linkage, 600)
    expected = by_mujoco(body, site, linkage.joints, q)
    places, slopes = linkage.place_and_slope(q)
    tips = expected[:, :3, 3] + expected[:, :3, :3] @ offset
    np.testing.assert_allclose(places, tips, atol=1e-12)
    np.testing.assert_allclose(linkage.place(q), tips, atol=1e-12)
    for k, step in enumerate(1e-6 * np.eye(q.shape[1])):
        numeric = (linkage.place(q + step) - linkage.place(q - step)) / 2e-6
        np.testing.assert_allclose(slopes[:, :, k], numeric, atol=1e-7)
    angles = np.clip(np.zeros((600, len(body.independent_joints))), *body.joint_ranges.T)
    angles[:, [body.independent_joints.index(joint) for joint in linkage.joints]] = q
    found = Chains(body, (site,))(torch.tensor(angles, dtype=torch.float32))[:, 0]
    np.testing.assert_allclose(found.numpy(), expected, atol=2e-6)


def test_rows_of_many_bodies_are_each_body_s_own_and_a_ray_ends_at_its_length(
    bodies: list[Body],
) -> None:
    linkages = [Linkage(body, GRIP) for body in bodies]
    rows, q = np.array([2, 0, 1, 1, 0]), drawn(linkages[0], 5)
    found = Linkage.stacked(linkages).take(rows).place(q)
    ray = Linkage.stacked(linkages, AIM).take(rows)
    assert ray.joints == (*linkages[0].joints, "ray")
    lengths = np.array([0.0, 1.0, 2.5, 40.0, 0.3])
    ends = ray.place(np.concatenate([q, lengths[:, None]], axis=1))
    quat = np.empty(4)
    for i, row in enumerate(rows):
        (grip,) = by_mujoco(bodies[row], "controller_right", ray.joints[:-1], q[i : i + 1])
        np.testing.assert_allclose(found[i], grip[:3, 3], atol=1e-9)
        mujoco.mju_mat2Quat(quat, grip[:3, :3].ravel())
        along = lengths[i] * aim_direction(quat)
        np.testing.assert_allclose(ends[i], grip[:3, 3] + along, atol=1e-8)
    with pytest.raises(ValueError, match="expected other sizes only"):
        Linkage.stacked([linkages[0], Linkage(load_body("mobl_arms_wrist"), GRIP)])


def test_solving_many_bodies_is_solving_each(bodies: list[Body]) -> None:
    linkages = [Linkage(body, GRIP) for body in bodies]
    places = np.array([[0.45, -0.2, 1.1], [0.5, 0.0, 1.2], [0.4, -0.3, 1.5]])
    starts = np.tile(linkages[0].rest, (3, 1))
    _, together = solve(Linkage.stacked(linkages), places, starts)
    alone = [
        solve(linkage, places[i : i + 1], starts[:1])[1][0] for i, linkage in enumerate(linkages)
    ]
    np.testing.assert_allclose(together, alone, atol=1e-4)


def test_the_arm_s_lengths_are_those_of_the_tables() -> None:
    """Of facts/mobl_arms/wrist/bodies.csv, in the zero posture, where all frames are parallel."""
    body = load_body("mobl_arms_wrist", appearance=False)
    hand, elbow, shoulder = (Linkage(body, Point(p)) for p in ("hand", "ulna", "humerus"))
    assert hand.joints == body.independent_joints
    ulna = np.array([0.0061, -0.2904, -0.0123])
    rest = [[0.0004, -0.011503, 0.019999], [0.018, -0.242, 0.025], [0.003992, -0.015054, 0.002327]]
    straight = np.linalg.norm(ulna + np.sum(rest, axis=0))
    assert straight == pytest.approx(0.5608, abs=1e-4)
    zero = np.zeros((1, 7))
    joint = shoulder.place(np.zeros((1, len(shoulder.joints))))
    assert np.linalg.norm(hand.place(zero) - joint) == pytest.approx(straight)
    # The upper arm is as long in every posture; nothing of the arm is longer than its parts.
    q = drawn(hand, 200)
    joints = shoulder.place(q[:, [hand.joints.index(j) for j in shoulder.joints]])
    elbows = elbow.place(q[:, [hand.joints.index(j) for j in elbow.joints]])
    np.testing.assert_allclose(np.linalg.norm(elbows - joints, axis=1), np.linalg.norm(ulna))
    longest = np.linalg.norm(ulna) + np.linalg.norm(rest, axis=1).sum()
    assert np.linalg.norm(hand.place(q) - joints, axis=1).max() < longest


def test_the_reference_s_sweep() -> None:
    """SIM2VR's sample of 100 x 100 angles of two joints, elbow straight, spans these, m.

    Its controller is the device without OpenXR's offset, in the hand's frame.
    """
    body = load_body("mobl_arms_wrist", appearance=False)
    linkage = Linkage(body, Point("hand", (0.0452676, -0.0473227, -0.0165982)))
    q = np.repeat(linkage.rest[None], 10_000, axis=0)
    q[:, linkage.joints.index("elbow_flexion")] = linkage.limits[
        linkage.joints.index("elbow_flexion"), 0
    ]
    swept = [linkage.joints.index(joint) for joint in ("elv_angle", "shoulder_elv")]
    ranges = [np.linspace(*linkage.limits[column], 100) for column in swept]
    q[:, swept] = np.stack(np.meshgrid(*ranges, indexing="ij"), axis=-1).reshape(-1, 2)
    points = linkage.place(q)
    reference = [[-0.652, -0.771, 0.384], [0.568, 0.194, 1.660]]
    np.testing.assert_allclose([points.min(axis=0), points.max(axis=0)], reference, atol=0.015)
