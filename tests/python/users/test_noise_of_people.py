"""How far reaches of people spread when nothing corrects them: the measure of their noise."""

from pathlib import Path

import numpy as np
import torch

from sim2vr_harness.envs.simulation import motor_noise
from sim2vr_harness.policies.hierarchical.motor_policy import MotorGoals
from sim2vr_harness.policies.hierarchical.motor_store import motor_layer_for
from sim2vr_harness.runs.config import load_config
from sim2vr_harness.users import MotorNoiseSettings, UserBatch, load_body

CONFIGS = Path(__file__).resolve().parents[3] / "configs"
STEP_S, USERS, REACHES = 0.05, 24, 3
SETTLE, MOVE = 24, 10
"""User steps in which a hand comes to a first place, and half a second to go on from there."""


def test_blind_reaches_of_people_spread_as_people_s_do() -> None:
    """About a centimetre along each axis after 20 cm, when nobody sees the hand.

    That is 5 % of the way, the order of what people have whose hands are out of sight (Gordon,
    Ghilardi and Ghez 1994). Half and twice as much will do: this body stiffens more than theirs.
    """
    noises = [
        motor_noise(load_config(CONFIGS / f"{name}.yaml").env.user.noise)
        for name in ("whacamole_people", "pointing_people")
    ]
    assert noises[0] == noises[1]
    body = load_body("mobl_arms_wrist")
    layer = motor_layer_for(body, STEP_S, following=True)
    rng, (low, high) = np.random.default_rng(5), body.joint_ranges.T

    def users(posture: np.ndarray, noise: MotorNoiseSettings | None = None) -> UserBatch:
        substeps = round(STEP_S / body.timestep)
        batch = UserBatch(body, USERS, threads=1, effort="zero", noise=noise, substeps=substeps)
        generators = [np.random.default_rng(i) for i in range(USERS)]
        batch.reset(np.arange(USERS), generators, [posture] * USERS)
        return batch

    variances = []
    for _ in range(REACHES):
        posture = 0.5 * (low + high) + 0.3 * (high - low) * rng.uniform(-1.0, 1.0, len(low))
        first = np.array([0.4, -0.1, 1.2]) + [0.1, 0.2, 0.2] * rng.uniform(-1.0, 1.0, 3)
        way = rng.standard_normal(3)
        places = [first, first + 0.2 * way / np.linalg.norm(way)]
        clean, goals, actions = users(posture), MotorGoals.none(USERS, 1), []
        goals.active[:] = 1.0
        for step in range(SETTLE + MOVE):
            moves = step >= SETTLE
            goals.place[:] = torch.from_numpy(places[moves]).float()
            goals.left_s[:] = max(0.0, (MOVE - step + SETTLE) * STEP_S) if moves else 0.5
            actions.append(np.clip(layer.act(clean, goals), -1.0, 1.0))
            clean.step(actions[-1])
        noisy = users(posture, noises[0])
        factors = noisy.who.motor_noise.copy()
        for step, action in enumerate(actions):
            noisy.who.motor_noise[:] = factors if step >= SETTLE else 0.0
            noisy.step(action)
        variances.append(noisy.device_poses("controller_right")[0].var(0).mean())
    assert 0.005 < np.sqrt(np.mean(variances)) < 0.02
