"""Choices that last."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from sim2vr_harness.envs.config import AppConfig, EnvConfig, VisionConfig
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.training.skills.guide import SkillGuide
from sim2vr_harness.training.skills.moves import Mover
from sim2vr_harness.training.skills.network import PlaceValues
from sim2vr_harness.training.skills.postures import reachable_poses
from sim2vr_harness.training.skills.shipped import motor_layer_for
from sim2vr_harness.training.skills.sight import Sight
from sim2vr_harness.users import load_body

pytest.importorskip("sim2vr_harness._app_runtime")

USERS, LASTS = 3, 4


def users() -> tuple[Simulation, SkillGuide]:
    channels = ("red", "green", "blue", "depth")
    app = AppConfig(game="sample", options={"round_seconds": 1.12})
    env = EnvConfig(app=app, vision=VisionConfig(channels=channels), cores=1)
    simulation = Simulation(env, USERS)
    layer = motor_layer_for(load_body("mobl_arms_wrist"), 0.05)
    torch.manual_seed(1)
    net = PlaceValues(Sight(env.vision.height, env.vision.width), 1, width=8)
    mover = Mover(layer, torch.zeros(1, 3), reachable_poses(layer, 1))
    guide = SkillGuide(net, mover, simulation, LASTS)
    simulation.reset(seeds=[1, 2, 3])
    return simulation, guide


def test_a_choice_is_seen_through_and_made_anew_in_a_new_round() -> None:
    simulation, guide = users()
    due = []
    for step in range(26):
        before = guide._held.due.tolist()
        result = simulation.step(guide.actions(simulation))
        due.append(before)
        simulation.renew(result)
        if step == 9:  # user 1 begins anew, and decides with its new round
            simulation.reset([1], [7])
            assert guide._held.choice.move[1].tolist() == [-1]
    simulation.close()
    decided = [[step for step, who in enumerate(due) if user in who] for user in range(USERS)]
    # A round has 23 user steps, and the one after it begins with a decision.
    assert decided[0] == decided[2] == [0, 4, 8, 12, 16, 20, 23]
    assert decided[1] == [0, 4, 8, 10, 14, 18, 22]


def test_a_saved_choice_goes_on() -> None:
    simulation, guide = users()
    for _ in range(6):
        simulation.step(guide.actions(simulation))
    saved = simulation.save_state()

    def play() -> list[np.ndarray]:
        played = []
        for _ in range(5):
            played.append(guide.actions(simulation))
            simulation.step(played[-1])
        return played

    first = play()
    simulation.load_state(saved)
    again = play()
    simulation.close()
    np.testing.assert_array_equal(first, again)
