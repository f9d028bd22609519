"""Trunk and neck that move: what they are made of, what they can do, that they stand."""

import csv
import re
from contextlib import closing
from importlib import resources
from typing import Any

import mujoco
import numpy as np
import pytest

from python.users.bodies import OWN_ARM
from python.users.references import coupling_jacobian, gap
from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.envs.contract import contract
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.perception import Proprioception
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


def test_every_number_has_a_source() -> None:
    folder = resources.files("sim2vr_harness.users").joinpath("data", "torso")
    for table in ("bodies.csv", "joints.csv", "motors.csv"):
        for row in csv.DictReader(folder.joinpath(table).read_text().splitlines()):
            assert re.search(r"[A-Z][a-z]+.* (19|20)\d\d", row["source"]), row  # author and year


@pytest.mark.parametrize("name", BODIES)
def test_it_ducks_leans_and_looks(name: str) -> None:
    batch = UserBatch(_body(name), 2, threads=1, effort="zero")
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


@pytest.mark.parametrize("name", BODIES)
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
    half = _body(person=Physique(strength=0.5))
    assert half.peak_forces[-6:].tolist() == [105.0, 75.0, 45.0, 25.5, 16.0, 6.5]


@pytest.mark.parametrize("name", BODIES)
def test_the_arms_are_what_they_were(name: str) -> None:
    """Effective inertia, gravity and servo torques of the arms on an upright trunk."""
    still, moving = load_body(name, appearance=False, skull_rotation_deg=0), _body(name)
    rng = np.random.default_rng(4)
    arms = [moving.independent_joints.index(name) for name in still.independent_joints]
    assert len(moving.independent_joints) == len(arms) + 6
    low, high = still.joint_ranges.T
    for _ in range(4):
        q = rng.uniform(low, high)
        whole = np.zeros(len(moving.independent_joints))
        whole[arms] = q
        one, two = (_statics(*each) for each in ((still, q), (moving, whole)))
        assert gap(two[0][np.ix_(arms, arms)], one[0]) < 1e-7
        assert gap(two[1][arms], one[1]) < 1e-7


def _statics(body: Body, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    model, data = body.physics_model, mujoco.MjData(body.physics_model)
    data.qpos[:], data.act[:] = body.coupled_qpos(q), 0.3
    mujoco.mj_forward(model, data)
    follow, inertia = coupling_jacobian(body, q), np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    return follow.T @ inertia @ follow, follow.T @ (data.qfrc_bias - data.qfrc_actuator)


def test_names_and_observation() -> None:
    body = _body()
    assert body.action_names[14:] == TORSO_MOTORS
    assert _body("mobl_arms_bimanual").action_names[:6] == TORSO_MOTORS  # motors before muscles
    sense = Proprioception(body)
    assert sense.size == 3 * 20 + 6 + 20
    assert sense.names[:6] == tuple(f"{joint} qpos" for joint in JOINTS)
    ranges = np.degrees(body.joint_ranges[:6])
    expected = [[-40, 69.9], [-36.25, 36.25], [-38.5, 38.5], [-59.1, 57.7], [-41.75, 41.75]]
    np.testing.assert_allclose(ranges, [*expected, [-70.65, 70.65]], atol=0.01)
    config = EnvConfig.model_validate({"user": {"model": MOTORS, "torso": True}})
    assert contract(config)["actuators"] == [["motor", *body.action_names]]


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


@pytest.mark.parametrize("name", BODIES)
def test_people(name: str) -> None:
    tall, left = _body(name, person=Physique(stature_m=1.87)), _body(name, person=_left())
    plain = _body(name)
    head = [load.physics_model.joint("neck_flexion").pos for load in (plain, tall)]
    np.testing.assert_allclose(head[1], 1.1 * head[0], atol=1e-12)
    batches = [UserBatch(body, 1, threads=1, effort="zero") for body in (plain, left)]
    rng = np.random.default_rng(6)
    for _ in range(20):
        action = rng.uniform(-1, 1, (1, plain.action_size))
        action[:, plain.action_names.index("trunk_bending_motor")] = 0.5  # to the right
        for batch in batches:
            batch.step(action)
        gone = batches[0].device_poses("headset")[0]
        mirrored = batches[1].device_poses("headset")[0]
        np.testing.assert_allclose(mirrored, gone * [1, -1, 1], atol=1e-9)
    assert gone[0, 1] < -0.2
    batch = UserBatch(tall, 1, threads=1, effort="zero")
    start = _angles(batch)
    for _ in range(40):
        batch.step(np.zeros((1, batch.action_size)))
    assert np.degrees(np.abs(_angles(batch) - start)).max() < 7.0


def _left() -> Physique:
    return Physique(handedness="left")


def test_other_bodies_have_their_own_trunk() -> None:
    with pytest.raises(ValueError, match=r"body.yaml: torso: got true, expected false: trunk and"):
        load_body(OWN_ARM, torso=True)
