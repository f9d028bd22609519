from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.spatial.distance import pdist

from python.users.bodies import (
    OWN_ARM,
    body,
    placed,
    write_body,
)
from sim2vr_harness.users import Body, Physique, UserBatch, load_body

MIRROR = np.array([1.0, -1.0, 1.0])
BODIES = ["mobl_arms_wrist", OWN_ARM]


def _load(name: str | Path, **person: Any) -> Body:
    return body(name, person=Physique(**person))


def _length(user: Body, start: str, end: str) -> float:
    data = placed(user)
    return float(np.linalg.norm(data.body(start).xpos - data.body(end).xpos))


def _own_mass(body: Body) -> float:
    """Without devices, kg."""
    model = body.physics_model
    return float(model.body_mass.sum() - sum(model.body(d).mass[0] for d in body.devices))


@pytest.mark.parametrize("name", BODIES)
def test_the_same_person_is_the_same_body(name: str | Path) -> None:
    same = {"mobl_arms_wrist": (1.7, 78.4), OWN_ARM: (1.75, 75.0)}[name]
    plain = load_body(name, appearance=False).physics_model
    scaled = _load(name, stature_m=same[0], mass_kg=same[1]).physics_model
    for field in ("body_pos", "body_mass", "body_inertia", "site_pos", "actuator_lengthrange"):
        np.testing.assert_allclose(getattr(scaled, field), getattr(plain, field), atol=1e-15)


def test_stature_and_mass() -> None:
    """1.7 m and 78.4 kg to 1.87 m and 98 kg: lengths x 1.1, masses x 1.25, inertias x 1.5125."""
    plain, tall = _load("mobl_arms_wrist"), _load("mobl_arms_wrist", stature_m=1.87, mass_kg=98.0)
    # The elbow is (0.0061, -0.2904, -0.0123) m from the shoulder: 0.290724 m.
    assert _length(plain, "humerus", "ulna") == pytest.approx(0.290724, abs=1e-6)
    assert _length(tall, "humerus", "ulna") == pytest.approx(1.1 * 0.290724, abs=1e-6)
    assert _own_mass(tall) == pytest.approx(1.25 * _own_mass(plain), rel=1e-12)
    before, after = plain.physics_model, tall.physics_model
    arm = [before.body(name).id for name in ("humerus", "ulna", "radius", "hand")]
    inertia = after.body_inertia[arm] / before.body_inertia[arm]
    np.testing.assert_allclose(inertia, 1.25 * 1.1**2, rtol=1e-12)
    np.testing.assert_allclose(after.body_ipos[arm], 1.1 * before.body_ipos[arm], atol=1e-15)
    for device, mass in (("headset", 0.571), ("controller_right", 0.129)):
        assert after.body(device).mass[0] == mass
        np.testing.assert_array_equal(after.site(device).pos, before.site(device).pos)
        np.testing.assert_array_equal(after.body(device).inertia, before.body(device).inertia)
    # Only the body-mass index stays where no mass is given.
    assert _own_mass(_load("mobl_arms_wrist", stature_m=1.87)) == pytest.approx(
        1.21 * _own_mass(plain), rel=1e-12
    )


def _muscles_at_work(user: Body, activation: float) -> tuple[np.ndarray, np.ndarray]:
    """Forces of the muscles, and torques at the joints."""
    data = mujoco.MjData(user.physics_model)
    data.qpos[:] = user.coupled_qpos(np.array([0.4, 1.1, -0.3, 1.2, 0.2, 0.1, -0.2]))
    data.act[:] = activation
    mujoco.mj_forward(user.physics_model, data)
    return data.actuator_force.copy(), data.qfrc_actuator.copy()


def test_muscles_of_a_tall_body_work_as_before() -> None:
    """Paths are 1.1 times as long, and so are length ranges: same force, 1.1 times the torque."""
    tall = _load("mobl_arms_wrist", stature_m=1.87)
    (plain, torque), (forces, arms) = (_muscles_at_work(each, 1.0) for each in (body(), tall))
    assert np.abs(plain).max() > 500
    np.testing.assert_allclose(forces, plain, rtol=1e-9, atol=1e-7)
    np.testing.assert_allclose(arms, 1.1 * torque, rtol=1e-9, atol=1e-7)


DRAWER = """
<mujoco>
  <compiler angle="radian"/>
  <asset><mesh name="wedge" vertex="0 0 0  .1 0 0  0 .05 0  0 0 .2"/></asset>
  <worldbody>
    <body name="head" pos="0 0 1">
      <geom type="mesh" mesh="wedge" pos=".1 .2 .3" mass="1"/>
    </body>
    <body name="base" pos=".5 0 1">
      <joint name="turn" axis="0 0 1" range="-1 1" limited="true"/>
      <geom type="mesh" mesh="wedge" mass="1" quat=".9 .1 .3 .2"/>
      <body name="drawer" pos=".1 0 0">
        <joint name="pull" type="slide" axis="1 0 0" range="-.2 .4" limited="true" ref="0.1"/>
        <joint name="twist" axis="1 0 0"/>
        <geom size=".02" mass="1"/>
      </body>
    </body>
  </worldbody>
  <equality>
    <joint joint1="pull" joint2="turn" polycoef="0 .1 .02 0 0"/>
    <joint joint1="twist" joint2="pull" polycoef="0 3 5 0 0"/>
  </equality>
  <actuator><motor name="m" joint="turn" ctrlrange="-1 1"/></actuator>
</mujoco>"""
"""A drawer on a turning base, its travel and twist coupled to other joints."""


def test_lengths_of_slides_and_meshes(tmp_path: Path) -> None:
    segments = {"base": {"bodies": ["base", "drawer"], "start": "base", "end": "drawer"}}
    description = {
        "mjcf": "body.xml",
        "devices": {"headset": {"body": "head"}},
        "anatomy": {"stature_m": 2.0, "mass_kg": 80.0, "segments": segments},
    }
    file = write_body(tmp_path, DRAWER, description)
    plain = _load(file)
    large = _load(file, stature_m=2.2, segment_lengths_m={"base": 0.15})
    model = large.physics_model
    assert model.joint("turn").range.tolist() == [-1.0, 1.0]
    np.testing.assert_allclose(model.joint("pull").range, [-0.3, 0.6])
    # Dependent slide: coefficients x 1.5; driving slide: / 1.5^k.
    coefficients = {c.dependent: c.coefficients for c in large.couplings}
    q = np.array([0.7])
    before, after = plain.coupled_qpos(q), large.coupled_qpos(q)
    address = {n: model.joint(n).qposadr[0] for n in coefficients}
    assert after[address["pull"]] == pytest.approx(1.5 * before[address["pull"]])
    assert after[address["twist"]] == pytest.approx(before[address["twist"]])

    def edges(body: Body, of: str) -> np.ndarray:
        """Lengths between the corners of a part's mesh."""
        model = body.model
        mesh = model.mesh(int(model.geom_dataid[model.body_geomadr[model.body(of).id]]))
        first, count = mesh.vertadr[0], mesh.vertnum[0]
        return np.sort(pdist(model.mesh_vert[first : first + count]))

    drawn = load_body(file)
    tall = load_body(file, person=Physique(stature_m=2.2, segment_lengths_m={"base": 0.15}))
    np.testing.assert_allclose(edges(tall, "head"), 1.1 * edges(drawn, "head"), atol=1e-6)
    np.testing.assert_allclose(edges(tall, "base"), 1.5 * edges(drawn, "base"), atol=1e-6)


def test_strength_scales_the_isometric_force() -> None:
    strong = _load("mobl_arms_wrist", strength=1.5)
    np.testing.assert_allclose(
        _muscles_at_work(strong, 0.8)[0], 1.5 * _muscles_at_work(body(), 0.8)[0], rtol=1e-12
    )
    assert strong.peak_forces[0] == pytest.approx(1.5 * 1218.9)
    weak = _load(OWN_ARM, strength=0.5)
    assert weak.peak_forces.tolist() == [20.0, 20.0, 300.0, 300.0, 75.0, 75.0]
    assert weak.physics_model.actuator("shoulder_flexion_motor").gainprm[0] == 30.0


@pytest.mark.parametrize("name", BODIES)
def test_a_left_hander_moves_like_the_mirror_image(name: str | Path) -> None:
    right, left = _load(name), _load(name, handedness="left")
    assert left.devices == ("headset", "controller_left")
    batches = [UserBatch(body, 2, threads=1, effort="neural") for body in (right, left)]
    rng = np.random.default_rng(2)
    for _ in range(30):
        action = rng.uniform(-1, 1, (2, right.action_size))
        for batch in batches:
            batch.step(action)
        a, b = batches
        np.testing.assert_allclose(b.qpos, a.qpos, atol=1e-9)
        np.testing.assert_allclose(b.actuator_force, a.actuator_force, atol=1e-6)
        np.testing.assert_allclose(b.end_effector_pos, a.end_effector_pos * MIRROR, atol=1e-9)
        for ours, theirs in (("headset", "headset"), ("controller_right", "controller_left")):
            at, turned = a.device_poses(ours)
            mirrored, mirror_turned = b.device_poses(theirs)
            np.testing.assert_allclose(mirrored, at * MIRROR, atol=1e-9)
            # (w, x, y, z) becomes (w, -x, y, -z), or its negative.
            dots = np.abs((turned * [1, -1, 1, -1] * mirror_turned).sum(axis=1))
            np.testing.assert_allclose(dots, 1.0, atol=1e-9)
    assert not a.diverged.any()
    assert np.abs(a.device_poses("controller_right")[0][:, 1]).max() > 0.05


def test_one_segment_and_errors() -> None:
    plain = _load("mobl_arms_wrist")
    long = _load("mobl_arms_wrist", segment_lengths_m={"upper_arm": 0.32}, ipd_m=0.058)
    assert (plain.ipd_m, long.ipd_m) == (0.063, 0.058)
    assert _length(long, "humerus", "ulna") == pytest.approx(0.32, abs=1e-9)
    assert _length(long, "ulna", "hand") == pytest.approx(_length(plain, "ulna", "hand"), abs=1e-12)
    assert _own_mass(long) == pytest.approx(_own_mass(plain), rel=1e-12)
    ratio = 0.32 / 0.290724
    model, before = long.physics_model, plain.physics_model
    humerus = model.body("humerus").inertia / before.body("humerus").inertia
    np.testing.assert_allclose(humerus, ratio**2, rtol=1e-5)
    # Muscles along the upper arm have longer paths, those of the forearm keep theirs.
    lengths = model.actuator_lengthrange[:, 1] / before.actuator_lengthrange[:, 1]
    by_name = dict(zip(plain.action_names, lengths.tolist(), strict=True))
    assert 1.05 < by_name["BIClong"] < ratio
    assert by_name["PQ"] == pytest.approx(1.0, abs=1e-12)
    for segments, message in (
        ({"upperarm": 0.3}, "got 'upperarm', .*did you mean 'upper_arm'"),
        ({"forearm": 26.0}, "forearm: got 26.0 m, expected a third to th"),
    ):
        with pytest.raises(ValueError, match=message):
            _load("mobl_arms_wrist", segment_lengths_m=segments)
