"""Forward and inverse kinematics: MuJoCo's own is the reference."""

from contextlib import closing

import mujoco
import numpy as np
import pytest
import torch

from sim2vr_harness.client.frames import aim_direction, position_to_mujoco
from sim2vr_harness.envs import AppConfig, EnvConfig, Simulation, VisionConfig
from sim2vr_harness.users import Body, BodyPlan, load_body
from sim2vr_harness.users.bodies.options import Physique
from sim2vr_harness.users.kinematics.forward import Linkage, Point
from sim2vr_harness.users.kinematics.forward_torch import Chains
from sim2vr_harness.users.kinematics.inverse import bounded_least_squares
from sim2vr_harness.users.kinematics.posture_controller import PostureController

SECONDS = 2.5


def played(place_m: tuple[float, ...], *, by_ray: bool) -> list[tuple[float, float]]:
    """Return the distance (m) and the angle (degrees) in every user step, from the devices."""
    app = AppConfig(game="sample", renderer="null")
    env = EnvConfig(app=app, vision=VisionConfig(width=16, height=16))
    with closing(Simulation(env, 1)) as simulation:
        simulation.reset(seeds=[1])
        users, place = simulation.users, position_to_mujoco(place_m)
        controller = PostureController(simulation.body)
        start = controller.angles(users.qpos[0])
        wanted = {"aim_at": place} if by_ray else {"place": place}
        found = controller.find(start, **wanted)
        steps = []
        for _ in range(int(SECONDS * 20)):
            action = controller.towards(users.qpos[0], users.qvel[0], users.act[0], found.angles)
            assert (np.abs(action) <= 1.0).all()
            simulation.step(action[None])
            (position,), (quat,) = users.device_poses("controller_right")
            gap = place - position
            along = float(aim_direction(quat) @ gap / np.linalg.norm(gap))
            steps.append((float(np.linalg.norm(gap)), float(np.degrees(np.arccos(along)))))
    return steps


def test_the_hand_settles_within_a_centimetre_and_the_ray_within_a_degree() -> None:
    """A degree is 2.6 cm at 1.5 m: a third of the half width of a key of 16 cm."""
    gaps = [gap for gap, _ in played((0.3, 1.0, 0.35), by_ray=False)]
    assert gaps[0] > 0.3 and max(gaps[-10:]) < 0.01
    angles = [angle for _, angle in played((-0.8, 1.0, 1.0), by_ray=True)]
    assert angles[0] > 45.0 and max(angles[-10:]) < 1.0


def test_places_out_of_reach_and_of_a_tool() -> None:
    """The arm is shorter than 1 m, so of 2 m ahead more than 1 m remains."""
    body = load_body("mobl_arms_wrist")
    controller = PostureController(body)
    start, place = np.zeros(len(body.independent_joints)), np.array([0.4, -0.15, 0.9])
    assert controller.find(start, place=np.array([2.0, 0.0, 1.0])).gap_m > 1.0
    assert controller.find(start, place=place).gap_m < 0.005
    found = controller.find(start, place=place, tip_m=(0.1, 0.0, 0.0))
    assert found.gap_m < 0.005
    # Without the tool the same posture has the device 10 cm from there.
    (device,) = by_mujoco(body, "controller_right", body.independent_joints, found.angles[None])
    assert np.linalg.norm(device[:3, 3] - place) == pytest.approx(0.1, abs=0.006)


def test_the_least_activations_hold_a_posture() -> None:
    """With them what stood still hardly accelerates; without, the arm falls."""
    body = load_body("mobl_arms_wrist")
    data = mujoco.MjData(body.physics_model)
    posture = np.zeros(len(body.independent_joints))
    posture[body.independent_joints.index("elbow_flexion")] = np.pi / 2.0
    data.qpos[:] = body.coupled_qpos(posture)
    held = PostureController(body).holding(data.qpos)
    assert held.min() >= 0.0 and held.max() <= 1.0
    fastest = []
    for activations in (np.zeros_like(held), held):
        data.act[:] = activations
        mujoco.mj_forward(body.physics_model, data)
        fastest.append(np.abs(data.qacc[body.qvel_independent]).max())
    assert fastest[0] > 10.0
    assert fastest[1] < 0.1 * fastest[0]
    assert np.square(held).mean() < 0.1


def test_bounded_least_squares_meet_the_conditions_of_the_optimum() -> None:
    rng = np.random.default_rng(3)
    for _ in range(50):
        matrix = np.concatenate([rng.normal(size=(6, 12)), 0.1 * np.eye(12)])
        target, high = rng.normal(size=18), np.where(rng.random(12) < 0.2, np.inf, 0.5)
        x = bounded_least_squares(matrix, target, high)
        downhill = matrix.T @ (target - matrix @ x)
        assert (downhill[x < 1e-9] < 1e-6).all()
        assert (downhill[x > high - 1e-9] > -1e-6).all()
        assert np.abs(downhill[(x >= 1e-9) & (x <= high - 1e-9)]).max(initial=0.0) < 1e-6


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

    return Body(BodyPlan("slider", (), (), ("tip",), 0.002), build)


def sized(stature_m: float, **factors: float) -> Body:
    person = Physique(stature_m=stature_m, segment_factors=factors)
    return load_body("mobl_arms_wrist", person=person, torso=True, appearance=False)


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


def test_rows_of_many_bodies_are_each_body_s_own_and_a_ray_ends_at_its_length() -> None:
    bodies = [sized(1.52, upper_arm=0.95), sized(1.70), sized(1.93, forearm=1.06)]
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
