"""How far reaches of people go astray whom nobody corrects: what their motor noise is judged by."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from sim2vr_harness.envs.simulation import motor_noise
from sim2vr_harness.policies.hierarchical.motor_policy import MotorGoals
from sim2vr_harness.policies.hierarchical.motor_store import motor_layer_for
from sim2vr_harness.runs.config import load_config
from sim2vr_harness.users import MotorNoiseSettings, UserBatch, load_body

CONFIGS = Path(__file__).resolve().parents[3] / "configs"
STEP_S, USERS, REACHES = 0.05, 24, 6
SETTLE, MOVE = 24, 10
"""User steps in which a hand comes to a first place, and half a second to go on from there."""


class Reaches:
    """Reaches of 20 cm in half a second, told by the motor layer, without noise."""

    def __init__(self) -> None:
        self.body = load_body("mobl_arms_wrist")
        self.layer = motor_layer_for(self.body, STEP_S, following=True)
        self.rng = np.random.default_rng(5)

    def users(self, noise: MotorNoiseSettings | None = None) -> UserBatch:
        substeps = round(STEP_S / self.body.timestep)
        return UserBatch(self.body, USERS, threads=2, effort="zero", noise=noise, substeps=substeps)

    def begin(self, users: UserBatch, posture: NDArray[np.float64]) -> None:
        generators = [np.random.default_rng(i) for i in range(USERS)]
        users.reset(np.arange(USERS), generators, [posture] * USERS)

    def hands(self, users: UserBatch) -> NDArray[np.float64]:
        angles, speeds, _ = self.layer.motion(users)
        place = self.layer.places(angles, speeds)[0]
        return place[:, 0, :3, 3].numpy().astype(np.float64)

    def told(self) -> tuple[NDArray[np.float64], list[NDArray[np.float32]]]:
        """Where it begins, and what is done in every user step."""
        low, high = self.body.joint_ranges.T
        spread = 0.3 * (high - low) * self.rng.uniform(-1.0, 1.0, len(low))
        posture = 0.5 * (low + high) + spread
        first = np.array([0.4, -0.1, 1.2]) + [0.1, 0.2, 0.2] * self.rng.uniform(-1.0, 1.0, 3)
        way = self.rng.standard_normal(3)
        places = np.stack([first, first + 0.2 * way / np.linalg.norm(way)])
        users = self.users()
        self.begin(users, posture)
        goals, actions = MotorGoals.none(USERS, 1), []
        goals.active[:] = 1.0
        for step in range(SETTLE + MOVE):
            moves = step >= SETTLE
            goals.place[:] = torch.from_numpy(places[int(moves)]).float()
            goals.left_s[:] = max(0.0, (MOVE - step + SETTLE) * STEP_S) if moves else 0.5
            actions.append(np.clip(self.layer.act(users, goals), -1.0, 1.0))
            users.step(actions[-1])
        return posture, actions

    def deviation_m(self, noise: MotorNoiseSettings | None) -> float:
        """Along each axis, root mean square over reaches; what was told is done again, blindly."""
        squares = []
        for _ in range(REACHES):
            posture, actions = self.told()
            users = self.users(noise)
            self.begin(users, posture)
            factors = users.who.motor_noise.copy()
            for step, action in enumerate(actions):
                users.who.motor_noise[:] = factors if step >= SETTLE else 0.0
                users.step(action)
            squares.append(self.hands(users).var(0).mean())
        return float(np.sqrt(np.mean(squares)))


@cache
def deviation_m(noise: MotorNoiseSettings | None) -> float:
    """The same noise is measured once."""
    return Reaches().deviation_m(noise)


@pytest.mark.parametrize("name", ["whacamole_people", "pointing_people"])
def test_blind_reaches_of_people_spread_as_people_s_do(name: str) -> None:
    """About a centimetre along each axis after 20 cm, when nobody sees the hand.

    That is 5 % of the way, the order of what people have whose hands are out of sight (Gordon,
    Ghilardi and Ghez 1994). Half and twice as much will do: this body stiffens more than theirs.
    """
    config = load_config(CONFIGS / f"{name}.yaml")
    noise = motor_noise(config.env.user.noise)
    assert 0.005 < deviation_m(noise) < 0.02
