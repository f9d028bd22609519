"""What a person decides by: late pictures, and time between decisions."""

from unittest.mock import patch

import numpy as np
import pytest
import torch

from sim2vr_harness.cli.train import _of_people
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.perception.proprioception import Proprioception
from sim2vr_harness.policies.hierarchical.action_selection import OptionScene
from sim2vr_harness.policies.hierarchical.option_policy import Memory, Moment
from sim2vr_harness.policies.hierarchical.person_policy import PersonPolicy, seen_late_steps
from sim2vr_harness.policies.hierarchical.primitives import OptionChoice
from sim2vr_harness.runs.config import load_config
from sim2vr_harness.users import FEATURES


class Following(PersonPolicy):
    """Touches at a height that the picture's first pixel says, 10 cm for each unit."""

    def _best(self, scene: OptionScene, before: OptionChoice) -> OptionChoice:
        choice = before.copy()
        choice.move[:] = 0
        choice.place[..., 2] = 0.1 * scene.pictures[:, 0, 0, :1].float()
        choice.place[..., 0] = 0.4
        return choice


@pytest.fixture(scope="module")
def policy() -> Following:
    return Following(_of_people(load_config("skills", [])))


def seeing(policy: Following, height: float = 0.0) -> dict[str, np.ndarray]:
    """Return what one person senses whose picture has this number everywhere."""
    vision, eyes = policy._wanted["vision"], ("fovea", "fovea_depth", "gaze")
    return {
        **{key: np.zeros((1, *policy._wanted[key]), np.float32) for key in eyes},
        "vision": np.full((1, 2 * vision[0], *vision[1:]), height, dtype=np.float32),
        "proprioception": np.zeros((1, len(Proprioception(policy.layer.body).names)), "f4"),
        "person": np.zeros((1, len(FEATURES)), np.float32),
    }


def places(policy: Following, heights: list[float]) -> list[float]:
    """Return where it wants to be, 0.1 m, after pictures with these heights, one per user step."""
    memory, found = policy.begin(1), []
    for height in heights:
        policy.act(seeing(policy, height), memory, [None])
        found.append(round(10.0 * float(memory[0].choice.place[0, 0, 2]), 3))
    return found


def test_new_targets_are_recognised_and_known_ones_are_followed(policy: Following) -> None:
    """Sight is 2 user steps late, recognition 2 more; 4 cm are the same target, 1 m another."""
    assert seen_late_steps(0.1, 0.05) == 4
    assert places(policy, [5.0] * 5 + [5.4] * 5) == [5.0] * 7 + [5.4] * 3
    assert places(policy, [5.0] * 5 + [15.0] * 6) == [5.0] * 9 + [15.0] * 2


def test_a_decision_takes_time(policy: Following) -> None:
    """Two new targets 0.05 s apart: the second is decided for 0.15 s after the first."""
    heights = [5.0] * 5 + [15.0] + [25.0] * 8
    assert places(policy, heights) == [5.0] * 9 + [15.0] * 3 + [25.0] * 2


def test_persons_look_from_where_their_eyes_were() -> None:
    """Statures differ by decimetres, heads move, and Pointing asks for a pitch of 14 degrees down.

    What is seen was drawn two user steps ago, what is recognised four.
    """
    config = _of_people(load_config("skills", ["env.app.game=pointing"]))
    policy, simulation = Following(config), Simulation(config.env, 6)
    policy.together = 6
    simulation.reset(seeds=list(range(6)), persons=list(range(6)))
    memory, true, looked = policy.begin(6), [], []
    scene = policy.scene

    def noted(moment: Moment, part: Memory, late: np.ndarray) -> OptionScene:
        found = scene(moment, part, late)
        if late is moment.follows:
            looked.append(found)
        return found

    with patch.object(policy, "scene", noted):
        for step in range(8):
            true.append(simulation.users.device_poses("headset")[0].copy())
            looked.clear()
            simulation.step(policy.act(simulation.observation(), memory, [None] * 6))
            heads = torch.cat([each.head for each in looked]).numpy()
            assert heads == pytest.approx(true[max(0, step - 2)], abs=1e-5)
            if step == 0:
                ahead, down = looked[0].turned[0, :, 0].numpy(), np.arctan2(0.1, 0.4)
                assert ahead == pytest.approx([np.cos(down), 0.0, -np.sin(down)], abs=1e-3)
    moment = policy.sense(simulation.observation(), memory[0])
    late = scene(moment, memory[0], moment.decides).head.numpy()
    simulation.close()
    assert late == pytest.approx(true[-4], abs=1e-5)
    assert np.ptp(true[0][:, 2]) > 0.05
    assert np.abs(true[-3] - true[-5]).min(0)[1] > 1e-5  # everyone sways
