"""Trunk and neck that move: what they are made of, what they can do, that they stand."""

from contextlib import closing
from typing import Any

import mujoco
import numpy as np
import pytest

from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.users import Body, Physique, UserBatch, load_body
from sim2vr_harness.users.bodies.registry import TORSO_MOTORS

MOTORS = "mobl_arms_bimanual_motor"
BODIES = [MOTORS, "mobl_arms_bimanual", "mobl_arms_wrist"]
JOINTS = tuple(name.removesuffix("_motor") for name in TORSO_MOTORS)


def _body(name: str = MOTORS, **options: Any) -> Body:
    return load_body(name, appearance=False, torso=True, **options)


def _rngs(n: int) -> list[np.random.Generator]:
    return [np.random.default_rng(i) for i in range(n)]


def _angles(batch: UserBatch) -> np.ndarray:
    model = batch.body.physics_model
    return batch.qpos[:, [model.joint(name).qposadr[0] for name in JOINTS]]


def _push(batch: UserBatch, motor: str, action: float, steps: int) -> np.ndarray:
    """(N, 3) where the headsets went, m."""
    start = batch.device_poses("headset")[0]
    actions = np.zeros((batch.n, batch.action_size))
    actions[:, batch.body.action_names.index(motor)] = action
    for _ in range(steps):
        batch.step(actions)
    return batch.device_poses("headset")[0] - start


def test_masses_are_those_of_de_leva_1996() -> None:
    """Males: share of the body mass, length (mm at 1741 mm), centre of mass and radii of gyration
    (about the forward, the long and the lateral axis) as shares of the length."""
    mass, scale = 78.4, 1.70 / 1.741

    def segment(share: float, length_mm: float, centre: float, *radii: float) -> Any:
        length = length_mm / 1000 * scale
        return share * mass, length, centre * length, share * mass * np.square(radii) * length**2

    head = segment(0.0694, 242.9, 0.5002, 0.303, 0.261, 0.315)
    upper = segment(0.1596, 170.7, 0.2999, 0.716, 0.659, 0.454)
    middle = segment(0.1633, 215.5, 0.4502, 0.482, 0.468, 0.383)
    lower = segment(0.1117, 145.7, 0.6115, 0.615, 0.587, 0.551)
    model = _body(devices=()).physics_model
    skull, thorax, pelvis = (model.body(name) for name in ("skull", "thorax", "pelvis"))
    assert skull.mass[0] == pytest.approx(head[0], abs=1e-4)
    assert skull.ipos[1] == pytest.approx(0.27262 - head[2], abs=1e-4)
    _same_inertia(skull, head[3])
    # Trunk: both parts about their common centre, less the shoulder girdles that the arms bring.
    whole = upper[0] + middle[0]
    centres = np.array([upper[2], upper[1] + middle[2]])
    centre = (upper[0] * centres[0] + middle[0] * centres[1]) / whole
    apart = upper[0] * (centres[0] - centre) ** 2 + middle[0] * (centres[1] - centre) ** 2
    girdles = 2 * (0.156 + 0.70396 + 4 * 0.001)
    assert thorax.mass[0] == pytest.approx(whole - girdles, abs=1e-3)
    assert thorax.ipos[1] == pytest.approx(-centre, abs=1e-4)
    inertia = upper[3] + middle[3] + apart * np.array([1, 0, 1])
    _same_inertia(thorax, inertia * (whole - girdles) / whole)
    assert pelvis.mass[0] == pytest.approx(lower[0], abs=1e-4)
    assert pelvis.ipos[1] == pytest.approx(-upper[1] - middle[1] - lower[2], abs=1e-4)
    _same_inertia(pelvis, lower[3])
    # With legs (2 x 19.86 %) it is a whole person.
    assert model.body_subtreemass[0] + 0.3972 * mass == pytest.approx(mass, rel=0.02)


def _same_inertia(body: Any, expected: np.ndarray) -> None:
    """About x, y and z of the body; MuJoCo sorts the principal ones, so sort both."""
    np.testing.assert_allclose(np.sort(body.inertia), np.sort(expected), rtol=2e-3)


def test_it_ducks_leans_and_looks() -> None:
    batch = UserBatch(_body(), 2, threads=1, effort="zero")
    for motor, action, seconds, axis, at_least in (
        ("trunk_flexion_motor", 1.0, 1.0, 2, -0.2),  # down
        ("trunk_bending_motor", 1.0, 1.0, 1, -0.2),  # to the right
        ("trunk_bending_motor", -1.0, 1.0, 1, 0.2),
        ("trunk_flexion_motor", -1.0, 1.0, 0, -0.2),  # back
    ):
        batch.reset([0, 1], _rngs(2))
        moved = _push(batch, motor, action, int(20 * seconds))[:, axis]
        assert (moved * np.sign(at_least) > abs(at_least)).all(), (motor, moved)
    batch.reset([0, 1], _rngs(2))
    _push(batch, "neck_rotation_motor", 1.0, 20)
    looking = _forward(batch)
    assert (looking[:, 1] < -0.85).all()  # 60 degrees to the right at least
    assert not batch.diverged.any()


def _forward(batch: UserBatch) -> np.ndarray:
    """(N, 3) where the headsets look."""
    w, x, y, z = batch.device_poses("headset")[1].T
    return np.stack([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)], axis=1)


@pytest.mark.parametrize("name", BODIES[:2])
def test_it_stays_upright_by_its_servos(name: str) -> None:
    """Three seconds without an action; the passive muscles and arms pull a little."""
    batch = UserBatch(_body(name), 4, threads=1, effort="zero")
    start, head = _angles(batch), batch.device_poses("headset")[0]
    for k in range(60):
        batch.step(np.zeros((4, batch.action_size)))
        assert np.degrees(np.abs(_angles(batch) - start)).max() < 7.0, k
    assert np.linalg.norm(batch.device_poses("headset")[0] - head, axis=1).max() < 0.05
    model = batch.body.physics_model
    dofs = [model.joint(name).dofadr[0] for name in JOINTS]
    assert np.abs(batch.qvel[:, dofs]).max() < 0.1
    # Without servos it falls.
    spec = batch.body.spec()
    for motor in TORSO_MOTORS:
        spec.actuator(motor).gainprm = np.zeros(10)
        spec.actuator(motor).biasprm = np.zeros(10)
    limp = spec.compile()
    data = mujoco.MjData(limp)
    data.qpos[:] = batch.qpos[0]
    mujoco.mj_step(limp, data, 1000)
    assert abs(data.joint("trunk_flexion").qpos[0]) > 0.5


def test_torques_are_those_of_people() -> None:
    body = _body()
    forces = body.peak_forces[-6:].tolist()
    assert forces == [210.0, 150.0, 90.0, 51.0, 32.0, 13.0]
    batch = UserBatch(body, 1, threads=1, effort="zero")
    seen = np.zeros(6)
    rng = np.random.default_rng(1)
    for _ in range(60):
        batch.step(rng.choice([-1.0, 1.0], (1, 20)))
        seen = np.maximum(seen, np.abs(batch.actuator_force[0, -6:]))
    assert (seen <= forces).all()
    assert (seen > 0.4 * np.array(forces)).all()
    tall = _body(person=Physique(strength=0.5, stature_m=1.87))
    assert tall.peak_forces[-6:].tolist() == [105.0, 75.0, 45.0, 25.5, 16.0, 6.5]
    necks = [each.physics_model.joint("neck_flexion").pos for each in (body, tall)]
    np.testing.assert_allclose(necks[1], 1.1 * necks[0], atol=1e-12)
    ranges = [[-40, 69.9], [-36.25, 36.25], [-38.5, 38.5], [-59.1, 57.7], [-41.75, 41.75]]
    expected = [*ranges, [-70.65, 70.65]]
    np.testing.assert_allclose(np.degrees(body.joint_ranges[:6]), expected, atol=0.01)


def test_a_neck_answers_the_apps_wish() -> None:
    batch = UserBatch(_body(), 4, threads=1, effort="neural")
    before = batch.device_poses("headset")[0]
    batch.turn_head([0, 1, 3], [-30.0, 30.0, -85.0])
    up = np.degrees(np.arcsin(_forward(batch)[:, 2]))
    assert up[:2] == pytest.approx([-30.0, 30.0], abs=0.3)  # the trunk may twist a little
    flexion = np.degrees(_angles(batch)[:, 3])
    assert flexion[3] == pytest.approx(57.7, abs=0.01)  # as far as the neck goes
    assert up[2] == pytest.approx(-10.0, abs=6.0)  # drawn about how the head is held
    moved = np.linalg.norm(batch.device_poses("headset")[0] - before, axis=1)
    assert (moved[[0, 1, 3]] > 0.03).all()  # the eyes move with the head
    assert moved[2] == 0.0
    for _ in range(20):  # the motor keeps it there
        batch.step(np.zeros((4, 20)))
    up_later = np.degrees(np.arcsin(_forward(batch)[:, 2]))
    assert up_later[:2] == pytest.approx(up[:2], abs=12.0)  # it yields under the head
    # ... and is the user's: looking elsewhere is a matter of its actions.
    _push(batch, "neck_flexion_motor", -1.0, 20)
    assert (np.degrees(np.arcsin(_forward(batch)[:, 2])) > 35.0).all()
    other = UserBatch(_body(), 1, threads=1, effort="neural")
    other.load_state_dict(0, batch.state_dict(1))
    np.testing.assert_array_equal(other.qpos[0], batch.qpos[1])


def test_whacamoles_wish_reaches_the_neck() -> None:
    config = EnvConfig.model_validate(
        {
            "app": {"renderer": "null", "options": {"condition": "low"}},
            "user": {"model": MOTORS, "torso": True, "effort": {"model": "neural"}},
            "cores": 1,
        }
    )
    with closing(Simulation(config, 1)) as users:
        users.reset(seeds=[1])
        down = np.degrees(np.arcsin(_forward(users.users)[0, 2]))
        assert down == pytest.approx(-30.0, abs=0.3)  # the game's "low"


def test_effort_counts_the_torso() -> None:
    """Neural: squared target angles; muscles' models: torques as shares of their capacity."""
    body = _body("mobl_arms_bimanual")
    rng = np.random.default_rng(3)
    actions = rng.uniform(-1, 1, (10, 2, 70))
    neural = UserBatch(body, 2, threads=1, effort="neural")
    state = UserBatch(body, 2, threads=1, effort="muscle_state")
    fatigue = UserBatch(body, 2, threads=1, effort="cumulative_fatigue_3ccr")
    assert fatigue.effort.state_dict()["MA"].shape == (2, 70)
    for action in actions:
        for batch in (neural, state, fatigue):
            batch.step(action)
        ctrl, act, torque = neural.ctrl, state.act, state.actuator_force[:, :6]
        shares = np.abs(torque) / [210, 150, 90, 51, 32, 13]
        np.testing.assert_allclose(neural.effort_cost, 1e-4 * (ctrl**2).sum(axis=1), rtol=1e-12)
        expected = 1e-4 * ((act**2).sum(axis=1) + (shares**2).sum(axis=1))
        np.testing.assert_allclose(state.effort_cost, expected, rtol=1e-12)
    assert shares.max() > 0.1
