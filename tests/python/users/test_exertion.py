"""Endurance models and arm loads against numbers worked out by hand."""

import mujoco
import numpy as np
import pytest

from python.users.bodies import body
from sim2vr_harness.envs.config import EffortConfig
from sim2vr_harness.users import CumulativeFatigue3CCr
from sim2vr_harness.users.exertion import (
    ArmDynamics,
    ConsumedEnduranceMeter,
    NicerMeter,
    Strength,
    arms_of,
    consumed_endurance_time,
    endurance_time,
    fatigue_endurance_time,
    nicer_correction,
)

BODY = body()
REFERENCE = (0.0146, 0.0022)


def test_endurance_of_people_s_shoulders() -> None:
    # 14.86 f^-1.83 by logarithms: f = .1: 1.83 ln 10 = 4.213731, e^ = 67.6083: 1004.66 s; .2:
    # e^2.945271 = 19.01580: 282.575; .4: e^1.676812 = 5.34848: 79.478; .6: e^.934811 = 2.54673:
    # 37.844; .8: e^.408353 = 1.504337: 22.354.
    published = {0.1: 1004.66, 0.2: 282.575, 0.4: 79.478, 0.6: 37.844, 0.8: 22.354}
    for share, seconds in published.items():
        assert endurance_time(share) == pytest.approx(seconds, rel=1e-4)
    assert endurance_time(0.0) == np.inf


def test_rohmert_s_curve() -> None:
    # f = .40: 1236.5 / 25^.618 - 72.5 = 169.148 - 72.5 = 96.648 s (25^.618 = 7.310160).
    assert consumed_endurance_time([0.15, 0.4]) == pytest.approx([np.inf, 96.648], rel=1e-4)
    # Twice the maximum: 1236.5 / 185^.618 = 49.1 < 72.5: nothing can be held.
    assert consumed_endurance_time(2.0) == 0.0


def test_maximum_torque_of_consumed_endurance_by_hand() -> None:
    # Men: 101.6 * .33 = 33.528; weight: 2.1*9.8*.14916 = 3.06971, 1.2*9.8*.444056 = 5.22210,
    # .4*9.8*.674827 = 2.64532, together 10.93713; left: 22.59087 Nm.
    assert Strength(man=True).consumed_endurance_torque == pytest.approx(22.59087, abs=1e-4)
    # Women: 87.2 * .31 = 27.032; 1.7*9.8*.14012 = 2.33440, 9.8*.409216 = 4.01032,
    # .4*9.8*.616651 = 2.41727, together 8.76199; left: 18.27001 Nm.
    assert Strength(man=False).consumed_endurance_torque == pytest.approx(18.27001, abs=1e-4)


def test_strength_and_correction_of_the_shoulder_by_hand() -> None:
    # 90 degrees, outstretched: 227.338 + 94.5 - 26.64 = 295.198; * .2845 = 83.98383 Nm.
    assert Strength().shoulder_torque(90.0, 180.0) == pytest.approx(83.98383, abs=1e-4)
    # Elbow at 90: 227.338 + 47.25 - 26.64 = 247.948; * .1495 * .5 = 18.53411 Nm.
    weak = Strength(man=False, factor=0.5)
    assert weak.shoulder_torque(90.0, 90.0) == pytest.approx(18.53411, abs=1e-4)
    # 120 degrees: e^((66.4 - 120)/7.83) = e^-6.845466 = .0010643; 11.685/1.0010643 = 11.672577;
    # less sin 120 / .09 = 9.622504: 2.050073 Nm. Below 90 or with a bent elbow: nothing.
    corrections = nicer_correction([120.0, 89.9, 120.0], [180.0, 180.0, 144.9])
    assert corrections == pytest.approx([2.050073, 0.0, 0.0], abs=1e-5)


def test_consumed_endurance_by_hand() -> None:
    # Tmax 22.59087: a torque of .4 Tmax for 30 s and of .6 Tmax for 30 s have the mean .5:
    # 35^.618 = e^(.618*3.5553481) = e^2.1972051 = 8.999820; 137.39164 - 72.5 = 64.89164 s;
    # 100 * 60 / 64.89164 = 92.462 %.
    meter = ConsumedEnduranceMeter(2)
    for share in (0.4, 0.6):
        for _ in range(600):
            meter.update(np.array([share * 22.59087, 0.1 * 22.59087]), 0.05)
    assert meter.value == pytest.approx([92.462, 0.0], rel=1e-4)


def test_nicer_by_hand() -> None:
    # Shoulder 60 degrees, elbow 180: strength (227.338 + 94.5 - 17.76) * .2845 = 86.510191 Nm.
    # A fifth of it for 60 s: 14.86 * .2^-1.83 = 282.6 s; 100 * 60 / 282.6 = 21.232 %.
    meter = NicerMeter(1)
    raised, hanging, straight = np.array([60.0]), np.array([10.0]), np.array([180.0])
    torque = np.array([0.2 * 86.510191])
    assert meter.value.tolist() == [0.0]
    for _ in range(1200):
        meter.update(torque, raised, straight, 0.05)
    endurance = 14.86 * 5.0**1.83
    assert meter.value == pytest.approx([6000.0 / endurance], rel=1e-9)
    # 10 s of rest: times e^-.4.
    for _ in range(200):
        meter.update(np.array([5.0]), hanging, straight, 0.05)
    rested = 6000.0 / endurance * np.exp(-0.4)
    assert meter.value == pytest.approx([rested], rel=1e-9)
    # Raised again for 10 s. The mean torque at 70 s is the one whose value was `rested` then:
    # share = (70 / (rested/100) / 14.86)^(-1/1.83); at 80 s it is (share * 70 + .2 * 10) / 80.
    for _ in range(200):
        meter.update(torque, raised, straight, 0.05)
    share = (70.0 / (rested / 100.0) / 14.86) ** (-1.0 / 1.83)
    mean = (share * 70.0 + 0.2 * 10.0) / 80.0
    assert meter.value == pytest.approx([8000.0 / (14.86 * mean**-1.83)], rel=1e-9)
    assert meter.value[0] > rested


def test_closed_form_of_3ccr_is_what_its_simulation_does() -> None:
    rates = REFERENCE
    shares = np.array([0.2, 0.4, 0.6])
    held_s = _held_s(CumulativeFatigue3CCr(3, 1, fatigue=rates[0], recovery=rates[1]), shares)
    np.testing.assert_allclose(held_s, fatigue_endurance_time(shares, *rates), rtol=0.03)


def test_3ccr_by_hand() -> None:
    # f = .5, F = .0146, R = .0022: (.5 * .0022)/(.0146 * .5) = .1506849; -ln(.8493151)/.0022 =
    # .1633250/.0022 = 74.2386 s. f = .1: (.9*.0022)/(.0146*.1) = 1.356 > 1: endless.
    assert fatigue_endurance_time([0.5, 0.1], *REFERENCE) == pytest.approx(
        [74.2386, np.inf], rel=1e-4
    )
    # Without recovery: (1 - .5)/(.01 * .5) = 100 s.
    assert fatigue_endurance_time(0.5, 0.01, 0.0) == pytest.approx(100.0)


def _held_s(model: CumulativeFatigue3CCr, shares: np.ndarray) -> np.ndarray:
    """How long a model's users meet a load each, to a hundredth of it."""
    load = np.repeat(shares[:, None], model.muscle_count, axis=1)
    held, steps = np.full(len(shares), np.nan), 0
    while np.isnan(held).any():
        model.update(load, load)
        steps += 1
        missed = model.state_dict()["MA"][:, 0] <= 0.99 * shares
        held[missed & np.isnan(held) & (steps >= 40)] = 0.05 * steps
    return held


def test_presets_against_the_published_endurance_of_the_shoulder() -> None:
    """Frey-Law and Avin's curve: the shoulder's rates follow it, the reference's last longer."""
    shares = np.array([0.2, 0.3, 0.4, 0.5])
    for settings, low, high in (({"preset": "shoulder"}, 0.9, 1.15), ({}, 1.38, 1.9)):
        rates = EffortConfig.model_validate(settings).options()
        ratio = _held_s(CumulativeFatigue3CCr(4, 1, **rates), shares) / endurance_time(shares)
        assert ((ratio > low) & (ratio < high)).all(), ratio


def _still(elevation_deg: float, elbow_deg: float) -> np.ndarray:
    angles = dict.fromkeys(BODY.independent_joints, 0.0)
    angles |= {"shoulder_elv": np.radians(elevation_deg), "elbow_flexion": np.radians(elbow_deg)}
    return BODY.coupled_qpos(np.array([angles[name] for name in BODY.independent_joints]))


@pytest.mark.parametrize("elevation", [0.0, 120.0])
def test_torque_of_an_arm_held_still(elevation: float) -> None:
    """Weight times the horizontal distance of the arm's centre of mass, summed part by part."""
    model = BODY.physics_model
    (arm,) = arms_of(BODY)
    qpos, still = _still(elevation, 10.0), np.zeros(model.nv)
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    shoulder = model.body("humerus").id
    moment = np.zeros(3)
    for part in range(model.nbody):
        if shoulder in _above(model, part):
            weight = [0.0, 0.0, -9.81 * model.body_mass[part]]
            moment += np.cross(data.xipos[part] - data.xpos[shoulder], weight)
    load = ArmDynamics(model, arm).load(qpos, still, still)
    assert load.torque == pytest.approx(np.linalg.norm(moment), rel=1e-9)
    # A kilogram in the hand: its weight times its horizontal distance, in the same direction.
    heavier = ArmDynamics(model, arm).load(qpos, still, still, held_kg=1.0)
    hand = data.site("controller_right").xpos - data.xpos[shoulder]
    whole = moment + np.cross(hand, [0.0, 0.0, -9.81])
    assert heavier.torque == pytest.approx(np.linalg.norm(whole), rel=1e-9)


def test_torque_of_a_swinging_arm_is_that_of_newton_and_euler() -> None:
    """Of differences of positions and momenta, part by part, over a millisecond."""
    model = BODY.physics_model
    (arm,) = arms_of(BODY)
    rng = np.random.default_rng(3)
    qpos = _still(60.0, 40.0)
    qvel, qacc = rng.normal(0.0, 1.0, (2, model.nv))
    shoulder = model.body("humerus").id
    parts = [part for part in range(model.nbody) if shoulder in _above(model, part)]

    def momenta(t: float) -> tuple[np.ndarray, np.ndarray]:
        """Linear and angular momentum (about the world's origin) of the arm at time t."""
        data = mujoco.MjData(model)
        mujoco.mj_integratePos(model, qpos_t := qpos.copy(), qvel + 0.5 * qacc * t, t)
        data.qpos[:], data.qvel[:] = qpos_t, qvel + qacc * t
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        linear, angular = np.zeros((2, 3))
        for part in parts:
            jacp, jacr = np.zeros((2, 3, model.nv))
            mujoco.mj_jacBodyCom(model, data, jacp, jacr, part)
            turn = data.ximat[part].reshape(3, 3)
            inertia = turn @ np.diag(model.body_inertia[part]) @ turn.T
            pull = model.body_mass[part] * (jacp @ data.qvel)
            linear += pull
            angular += inertia @ (jacr @ data.qvel) + np.cross(data.xipos[part], pull)
        return linear, angular

    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    h = 1e-4
    (p0, l0), (p1, l1) = momenta(-h), momenta(h)
    weights = np.outer(model.body_mass[parts], [0.0, 0.0, -9.81])
    force = (p1 - p0) / (2 * h) - weights.sum(axis=0)
    about_origin = (l1 - l0) / (2 * h) - np.cross(data.xipos[parts], weights).sum(axis=0)
    moment = about_origin - np.cross(data.xpos[shoulder], force)
    load = ArmDynamics(model, arm).load(qpos, qvel, qacc)
    assert load.torque == pytest.approx(np.linalg.norm(moment), rel=1e-5)


def _above(model: mujoco.MjModel, part: int) -> list[int]:
    return [part, *_above(model, int(model.body_parentid[part]))] if part else [0]


def test_angles_of_an_arm() -> None:
    (arm,) = arms_of(BODY)
    dynamics, still = ArmDynamics(BODY.physics_model, arm), np.zeros(BODY.physics_model.nv)
    low, high = (dynamics.load(_still(e, 0.0), still, still) for e in (0.0, 90.0))
    assert low.shoulder_deg < 10.0
    assert high.shoulder_deg == pytest.approx(90.0, abs=6.0)
    bent = dynamics.load(_still(0.0, 90.0), still, still)
    assert bent.elbow_deg == pytest.approx(90.0, abs=6.0)
    assert low.elbow_deg > 160.0  # outstretched, less the carrying angle of the elbow
