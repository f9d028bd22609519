import sys

import mujoco
import numpy as np
import pytest

from sim2vr_harness.users import Body, installed_bodies, list_bodies, load_body
from sim2vr_harness.users.appearance import colour_muscles
from sim2vr_harness.users.bodies.tables import load_device_rows, load_model_tables


@pytest.fixture(scope="module")
def user() -> Body:
    return load_body("mobl_arms_wrist")


def test_registry() -> None:
    assert "mobl_arms_wrist" in list_bodies()
    with pytest.raises(ValueError, match="did you mean 'mobl_arms_wrist'") as error:
        load_body("mobl_arm_wrist")
    assert str(error.value).startswith("user model: got 'mobl_arm_wrist', expected one of ")


def test_sizes(user: Body) -> None:
    model = user.model
    assert (model.nq, model.nv, model.nu, model.na, model.ntendon) == (21, 21, 32, 32, 32)
    assert len(load_model_tables("mobl_arms_wrist").bodies) == 17  # 18 with the world
    assert model.nbody == 18 + 2
    assert len(user.independent_joints) == 7
    assert len(user.dependent_joints) == 14
    assert len(user.muscles) == 32
    points = load_model_tables("mobl_arms_wrist").points
    assert len(points) == 133
    assert model.nsite == len(points) + 1 + 2  # fingertip and two devices
    assert model.neq == 14
    assert model.opt.timestep == user.timestep == 0.002
    assert user.joint_ranges.shape == (7, 2)
    assert set(user.qpos_independent) | set(user.qpos_dependent) == set(range(21))


def test_muscle_parameters_are_those_of_the_tables(user: Body) -> None:
    model = user.model
    for muscle in load_model_tables("mobl_arms_wrist").muscles:
        actuator = model.actuator(muscle.name)
        assert tuple(actuator.lengthrange) == muscle.length_range
        assert actuator.gainprm[2] == actuator.biasprm[2] == muscle.peak_force
    assert model.actuator("DELT1").gainprm.tolist() == [
        *(0.5, 2.0, 1218.9, 2000.0, 0.4327, 1.595, 10.0, 0.725016, 1.4, 0.0)
    ]
    assert model.actuator("DELT1").biasprm.tolist() == [
        *(0.75, 1.05, 1218.9, 2000.0, 0.5, 1.6, 1.5, 1.3, 1.2, 0.0)
    ]
    assert model.actuator("DELT1").dynprm[:3].tolist() == [0.01, 0.04, 0.0]


def test_devices_add_their_mass(user: Body) -> None:
    bare = load_body("mobl_arms_wrist", devices=(), appearance=False)
    added = user.model.body_subtreemass[0] - bare.model.body_subtreemass[0]
    assert added == pytest.approx(0.571 + 0.129, abs=1e-12)
    assert user.model.body("hand").subtreemass[0] == pytest.approx(0.5819 + 0.004 + 0.129)


def test_openxr_offset_is_in_the_device_frame(user: Body) -> None:
    data = mujoco.MjData(user.model)
    data.qpos[:] = user.coupled_qpos(np.array([0.4, 0.8, -0.3, 1.0, 0.5, 0.1, 0.2]))
    mujoco.mj_kinematics(user.model, data)
    body, site = data.body("controller_right"), data.site("controller_right")
    offset = np.array(load_device_rows()["controller_right"].openxr_offset)
    assert offset.tolist() == [0.053, 0.0, 0.002]
    np.testing.assert_allclose(site.xpos, body.xpos + body.xmat.reshape(3, 3) @ offset, atol=1e-12)
    np.testing.assert_array_equal(data.site("headset").xpos, data.body("headset").xpos)


def test_skull_rotation(user: Body) -> None:
    def gaze(degrees: float) -> np.ndarray:
        model = load_body("mobl_arms_wrist", skull_rotation_deg=degrees, appearance=False).model
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        return data.body("headset").xmat.reshape(3, 3)[:, 0]  # the headset looks along its x

    np.testing.assert_allclose(gaze(0.0), [1, 0, 0], atol=1e-6)
    down = np.deg2rad(10)
    np.testing.assert_allclose(gaze(10.0), [np.cos(down), 0, -np.sin(down)], atol=1e-6)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"devices": ("headse",)}, "device: got 'headse'.*did you mean 'headset'"),
        ({"devices": ("headset", "headset")}, "devices: got .* expected each device at most"),
        ({"skull_rotation_deg": 95.0}, "skull_rotation_deg: got 95.0, expected -90 to 90"),
        (
            {"timestep_s": float("nan")},
            "timestep_s: got nan, expected a number from 0.0001 to 0.02",
        ),
    ],
)
def test_wrong_arguments(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        load_body("mobl_arms_wrist", **arguments)  # type: ignore[arg-type]


def test_spec_is_fresh_and_model_cached(user: Body) -> None:
    spec = user.spec()
    spec.body("hand").pos = [1.0, 2.0, 3.0]
    assert user.spec().body("hand").pos.tolist() != [1.0, 2.0, 3.0]
    assert user.model is user.model


def test_appearance_changes_nothing_but_the_picture(user: Body) -> None:
    drawn, plain = user.model, user.physics_model
    assert drawn.ngeom > 50
    assert plain.ngeom == 0
    assert not drawn.geom_contype.any()
    assert not drawn.geom_conaffinity.any()
    np.testing.assert_array_equal(drawn.body_mass, plain.body_mass)
    np.testing.assert_array_equal(drawn.body_inertia, plain.body_inertia)
    states = []
    for model in (drawn, plain):
        data = mujoco.MjData(model)
        data.ctrl[:] = 0.3
        mujoco.mj_step(model, data, 100)
        states.append(np.concatenate([data.qpos, data.qvel, data.act]))
    np.testing.assert_array_equal(states[0], states[1])


def test_coupled_qpos(user: Body) -> None:
    # wrist_hand_r1 = 1.35714 d - 0.818507 d^2 at d = 0.1: 0.135714 - 0.00818507
    q = np.array([0.5, 1.0, 0.0, 0.0, 0.0, 0.1, 0.4])
    full = user.coupled_qpos(np.stack([q, 0 * q]))
    assert full.shape == (2, 21)
    address = {name: user.model.joint(name).qposadr[0] for name in user.dependent_joints}
    assert full[0, address["wrist_hand_r1"]] == pytest.approx(0.12752893, abs=1e-12)
    assert full[0, address["wrist_hand_r3"]] == pytest.approx(0.2)
    assert full[0, address["shoulder1_r2"]] == pytest.approx(-0.5)
    assert full[0, address["acromioclavicular_r3"]] == pytest.approx(0.396002)
    np.testing.assert_allclose(full[1], 0.0, atol=1e-15)
    with pytest.raises(
        ValueError, match=r"q_independent: got shape \(6,\), expected \(\.\.\., 7\)"
    ):
        user.coupled_qpos(np.zeros(6))


def test_muscle_colours(user: Body) -> None:
    model = user.spec().compile()
    level = np.zeros(32)
    level[3] = 1.0
    colour_muscles(model, user.muscles, level)
    active, relaxed = model.tendon_rgba[3], model.tendon_rgba[4]
    assert active[0] > 0.8 > 0.3 > active[2]  # red
    assert relaxed[0] - relaxed[1] < 0.2 < relaxed[2]  # skin, not red
    with pytest.raises(ValueError, match=r"activations: got shape \(3,\), expected \(32,\)"):
        colour_muscles(model, user.muscles, np.zeros(3))


def test_a_body_of_a_missing_package_is_listed_but_not_installed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Games for two hands choose among the installed ones."""
    monkeypatch.setitem(sys.modules, "myo_sim", None)
    assert set(list_bodies()) - set(installed_bodies()) == {"myoarm_r"}
