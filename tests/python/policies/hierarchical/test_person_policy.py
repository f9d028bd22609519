"""What a person decides by: late pictures, and time between decisions."""

from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
import torch
from typer.testing import CliRunner

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.cli.main import app
from sim2vr_harness.cli.train import _of_people
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.perception.proprioception import Proprioception
from sim2vr_harness.policies.hierarchical.action_selection import OptionScene
from sim2vr_harness.policies.hierarchical.option_policy import Memory, Moment
from sim2vr_harness.policies.hierarchical.person_policy import PersonPolicy, seen_late_steps
from sim2vr_harness.policies.hierarchical.primitives import OptionChoice
from sim2vr_harness.runs.config import TrainingConfig, load_config
from sim2vr_harness.training.run import trainer
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


def test_people_work_the_inputs_of_a_game(monkeypatch: pytest.MonkeyPatch) -> None:
    """The panel's trigger comes before two actions of the gaze; no choice points: it is at rest."""
    given: list[TrainingConfig] = []

    def keep(settings: TrainingConfig, *others: Any, **named: Any) -> None:
        given.append(settings)
        raise InputError("train", "a test", "no training")

    monkeypatch.setattr(trainer, "train", keep)
    CliRunner().invoke(app, ["train", "--people", "panel"])
    CliRunner().invoke(app, ["train", "--people", "40", "panel"])
    counts = [each.env.user.people and each.env.user.people.count for each in given]
    assert counts == [None, 40]
    assert given[0].env.user.inputs == ("right.trigger",)
    policy = Following(given[0])
    action = policy.act(seeing(policy), policy.begin(1), [None])[0]
    assert len(action) == len(policy.layer.body.action_names) + 3
    assert action[-3] == -1.0
    # 0.4 m ahead of the world's origin and at its height, seen by eyes that are far above.
    assert action[-1] == -1.0 and abs(action[-2]) < 1.0


@pytest.mark.parametrize("together", [1, 6])
def test_persons_look_from_where_their_eyes_were(together: int) -> None:
    """Statures differ by decimetres, heads move, and Pointing asks for a pitch of 14 degrees down.

    What is seen was drawn two user steps ago, what is recognised four.
    """
    config = _of_people(load_config("skills", ["env.app.game=pointing"]))
    policy, simulation = Following(config), Simulation(config.env, 6)
    policy.together = together
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
    assert late == pytest.approx(true[-4][:together], abs=1e-5)
    assert np.ptp(true[0][:, 2]) > 0.05
    assert np.abs(true[-3] - true[-5]).min(0)[1] > 1e-5  # everyone sways


@pytest.mark.parametrize("recipe", ["skills", "webxr"])
def test_persons_of_games_and_pages_say_how_they_hold_their_heads(recipe: str) -> None:
    """Also where a recipe leaves the sense out, as this one of another recipe does."""
    given = load_config(recipe, ["recipe=skills", "skills.user=hierarchical"])
    senses = {sense.sense for sense in _of_people(given).env.senses}
    assert {"headset", "person"} <= senses


def test_people_need_decisions_by_themselves() -> None:
    with pytest.raises(InputError, match="--people: got it with recipe 'distill'"):
        _of_people(load_config("pointing"))
    config = _of_people(load_config("skills", []))
    assert config.skills.people and config.env.user.people is not None
    assert [sense.sense for sense in config.env.senses].count("person") == 1
    assert torch.is_tensor(PersonPolicy(config).hold)


def test_persons_that_learned_the_same_are_equal_in_every_weight() -> None:
    """Whatever numbers torch drew when they were made, as equal seeds write equal checkpoints."""
    config = _of_people(load_config("skills", []))
    made = []
    source = PersonPolicy(config)
    for seed in (1, 2):
        torch.manual_seed(seed)
        made.append(PersonPolicy(config))
        made[-1].human.take(source.human.weights())
        made[-1].values = source.values
    first, second = (each.state_dict() for each in made)
    assert [name for name in first if not torch.equal(first[name], second[name])] == []


@pytest.mark.parametrize(
    ("width_m", "beside_m", "depth_m"),
    [
        (0.04, 0.0, 0.04),
        (0.04, 0.01, 0.04),
        (0.04, 0.013, 0.02),
        (0.04, 0.016, 0.0),
        (0.04, 0.02, -0.01),
        (0.04, 0.036, -0.05),
        (0.04, 0.2, -0.05),
        (0.02, 0.013, -0.0125),  # the place of the third row, and a narrower thing
        (0.12, 0.03, 0.04),
    ],
)
def test_persons_stay_before_a_thing_until_they_are_inside(
    policy: Following, width_m: float, beside_m: float, depth_m: float
) -> None:
    """4 cm behind the surface at half a radius from the middle, at the surface at 0.8 radii.

    From there on up to 5 cm before it, over 2 cm, whether the hand comes nearer or not.
    """
    head, choice = torch.zeros(1, 3), OptionChoice(1, 1)
    choice.move[:], choice.width[:] = 0, width_m
    choice.place[0, 0] = choice.seen[0, 0] = torch.tensor([0.4, 0.0, 0.0])
    hand = torch.eye(4).repeat(1, 1, 1, 1)
    hand[0, 0, :3, 3] = torch.tensor([0.42, beside_m, 0.0])
    goals = policy.primitives.goals(choice, head, hand, hand)
    assert goals.place[0, 0].tolist() == pytest.approx([0.4 + depth_m, 0.0, 0.0], abs=1e-4)
