"""The recipe ``skills`` on a running app, small."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
import torch

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.cli.train import _of_people
from sim2vr_harness.envs.config import AppConfig, EnvConfig, VisionConfig
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.policies.hierarchical.motor_policy import MotorPolicy, reachable_poses
from sim2vr_harness.policies.hierarchical.motor_store import (
    human_policy_for,
    load_motor_layer,
    motor_layer_for,
    save_motor_layer,
)
from sim2vr_harness.policies.hierarchical.option_policy import HierarchicalPolicy
from sim2vr_harness.policies.hierarchical.person_policy import PersonPolicy
from sim2vr_harness.policies.hierarchical.primitives import (
    MOVES,
    OptionChoice,
    PrimitiveController,
)
from sim2vr_harness.policies.hierarchical.tool_detection import Tool, find_tools
from sim2vr_harness.runs.config import TrainingConfig, load_config
from sim2vr_harness.runs.option_config import MotorTrainingConfig, QLearningConfig
from sim2vr_harness.training.motor_control import goal_task
from sim2vr_harness.training.motor_control.goal_task import MotorTrainer, motor_trainer
from sim2vr_harness.training.option_q_learning import q_learning
from sim2vr_harness.training.option_q_learning.q_learning import (
    SETTINGS,
    OptionQLearning,
)
from sim2vr_harness.training.option_q_learning.stage import choose_manner
from sim2vr_harness.users import UserBatch, list_bodies, load_body

STEP_S = 0.05


@pytest.fixture(scope="module")
def layer() -> MotorPolicy:
    return motor_layer_for(load_body("mobl_arms_wrist"), STEP_S)


@pytest.fixture(scope="module")
def poses(layer: MotorPolicy) -> torch.Tensor:
    return reachable_poses(layer, 1)


@pytest.fixture(scope="module")
def primitives(layer: MotorPolicy, poses: torch.Tensor) -> PrimitiveController:
    return PrimitiveController(layer, torch.zeros(1, 2, 3), poses)


def doing(move: str, *place: float) -> OptionChoice:
    """Return the choice of one hand that does something at a place."""
    choice = OptionChoice(1, 1)
    choice.move[:], choice.place[0, 0] = MOVES.index(move), torch.tensor(place)
    return choice


@pytest.mark.parametrize("body", list_bodies())
def test_a_shipped_layer_brings_hands_to_places_and_stops_there(body: str) -> None:
    """Places before the shoulders, m; one arm reached 0.01 when it was made, two 0.02 to 0.05."""
    layer = motor_layer_for(load_body(body), STEP_S)
    hands = len(layer.hands)
    right = torch.tensor([[0.44, -0.2, 1.1], [0.44, -0.4, 1.0], [0.3, -0.2, 0.9]])
    places = torch.stack([right, right * torch.tensor([1.0, -1.0, 1.0])], 1)[:, :hands]
    bodies = UserBatch(layer.body, 3, threads=1, effort="zero")
    bodies.reset(range(3), [np.random.default_rng(i) for i in range(3)])
    choice = OptionChoice(3, hands)
    choice.move[:] = MOVES.index("touch")
    choice.place = places
    primitives = PrimitiveController(layer, torch.zeros(hands, 2, 3), reachable_poses(layer, 1))
    for _ in range(40):
        angles, speeds, _ = layer.motion(bodies)
        head = torch.from_numpy(bodies.device_poses("headset")[0]).float()
        goals = primitives.goals(choice, head, *layer.places(angles, speeds))
        bodies.step(layer.act(bodies, goals))
    angles, speeds, _ = layer.motion(bodies)
    found = layer.places(angles, speeds)[0][..., :3, 3]
    for number, hand in enumerate(layer.hands):
        true = torch.from_numpy(bodies.device_poses(hand)[0]).float()
        assert torch.allclose(found[:, number], true, atol=1e-3)  # the chain is the body's
    away = places - head[:, None]
    away = away / away.norm(dim=-1, keepdim=True)
    off = (found - (places + 0.025 * away)).norm(dim=-1)  # a touch goes 25 mm deeper
    assert float(off.max()) < (0.04 if hands == 1 else 0.06), off


def test_a_push_goes_through_its_place_away_from_the_head(
    primitives: PrimitiveController,
) -> None:
    choice = doing("push", 0.5, 0.0, 1.2)
    place = torch.eye(4)[None, None].clone()
    place[0, 0, :3, 3] = torch.tensor([0.08, 0.0, 1.2])  # farther than a run-up
    head = torch.tensor([[0.0, 0.0, 1.2]])
    goals = primitives.goals(choice, head, place, place)
    assert goals.velocity[0, 0].tolist() == pytest.approx([2.5, 0.0, 0.0])
    assert goals.left_s[0, 0].item() == pytest.approx(0.42 / 1.2)
    choice = doing("up right", 0.2, -0.3, 1.5)  # 0.42 m to go, up to the right
    swung = primitives.goals(choice, head, place, place).velocity[0, 0]
    half = 2.0 * 0.5**0.5
    assert swung.tolist() == pytest.approx([0.0, -half, half])  # y is to the left


def env(game: str) -> EnvConfig:
    channels = ("red", "green", "blue", "depth")
    return EnvConfig(app=AppConfig(game=game), vision=VisionConfig(channels=channels), cores=1)


def held_in(game: str, layer: MotorPolicy, poses: torch.Tensor, seed: int) -> Tool:
    """Return what is found in the hand of 32 users."""
    simulation = Simulation(env(game), 32)
    (tool,) = find_tools(simulation, layer, poses, seed=seed)
    simulation.close()
    return tool


def test_the_hammer_is_found_in_the_hand(layer: MotorPolicy, poses: torch.Tensor) -> None:
    """A tenth of the pictures show it. Places: shared facts, whacamole.md, 5."""
    tool = held_in("whacamole", layer, poses, 1)
    head, face = np.array([0.054, -0.009, 0.039]), np.array([0.083, -0.010, 0.002])
    assert np.linalg.norm(tool.tip - 0.5 * (head + face)) < 0.04
    assert len(tool.points) > 10


def test_a_stylus_ends_in_its_point_and_an_empty_hand_holds_nothing(
    layer: MotorPolicy, poses: torch.Tensor
) -> None:
    """Its tip is 10 cm ahead of the grip (docs/reference/games/pointing.md)."""
    stylus = held_in("pointing", layer, poses, 4)
    assert stylus.tip == pytest.approx([0.1, 0.0, 0.0], abs=0.006)
    assert not held_in("sample", layer, poses, 1).tip.any()


SMALL = QLearningConfig(users=3, user_steps=240, try_steps=90, explore_steps=100)


@pytest.fixture(autouse=True)
def small_minibatches(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(q_learning, "SETTINGS", replace(SETTINGS, batch_size=8))


def skills(*changes: str) -> TrainingConfig:
    return load_config("skills", ["env.app.game=sample", "env.cores=1", *changes])


def learner(folder: Path, cores: int = 1, for_persons: bool = False) -> OptionQLearning:
    folder.mkdir(exist_ok=True)
    config = skills(f"env.cores={cores}")
    policy, simulation = HierarchicalPolicy(config), Simulation(config.env, SMALL.users)
    policy.layer.take(motor_layer_for(policy.layer.body, STEP_S).weights())
    file = folder / "pictures.bin"
    return OptionQLearning(SMALL, simulation, policy, file, seed=2, for_persons=for_persons)


def with_persons(folder: Path, steps: int, since: int = 5) -> OptionQLearning:
    """Return a learner whose persons have played, after the measured body."""
    one = learner(folder, for_persons=True)
    for _ in range(since):
        one.step()
    config = _of_people(skills())
    person = PersonPolicy(config)
    person.human.take(human_policy_for(config.env.user, STEP_S).weights())
    one.simulation.close()
    one.continue_with_persons(Simulation(config.env, SMALL.users), person)
    for _ in range(steps):
        one.step()
    return one


def test_hands_move_as_it_pays(tmp_path: Path) -> None:
    """Straight hands earn 5 more; vigour 6 earns most; nothing of it counts as learning."""
    one, said = with_persons(tmp_path / "own", 0), []
    person, taken, decisions = one.policy, one.step_count, one._decisions.count
    assert isinstance(person, PersonPolicy)
    callbacks = SimpleNamespace(say=said.append, doing=lambda part: None)

    def of_now(*_: object, **__: object) -> float:
        lost = 3.0 * np.log(float(person.vigour) / 6.0) ** 2
        return float(20.0 - lost - 5.0 * float(person.primitives.lifts))

    with patch.object(one, "earned", side_effect=of_now):
        choose_manner(one, 100, callbacks, print)  # type: ignore[arg-type]
    assert (float(person.vigour), float(person.lifts)) == (pytest.approx(6.0), 0.0)
    assert said[0].endswith("The participants': 6.")
    assert (one.step_count, one._decisions.count) == (taken, decisions)
    assert one._memory[0].bodies.vigour == pytest.approx(6.0)  # type: ignore[attr-defined]
    one.simulation.close()


def test_effort_is_taken_off_the_reward_of_every_decision(tmp_path: Path) -> None:
    one = learner(tmp_path / "own")
    step, played = one.simulation.step, []

    def noted(actions: np.ndarray) -> Any:
        played.append(step(actions))
        return played[-1]

    with patch.object(one.simulation, "step", noted):
        one.step()
    assert len(played) == SETTINGS.decide_steps
    infos = [outcome.infos for outcome in played]
    points = np.sum([[info["game_reward"] for info in each] for each in infos], axis=0)
    effort = np.sum([[info["effort_cost"] for info in each] for each in infos], axis=0)
    last = np.array([one._decisions.count - 1])
    assert (effort > 0.01).all()
    np.testing.assert_allclose(one._decisions.read("game_reward", last)[0], points, atol=1e-5)
    np.testing.assert_allclose(one._decisions.read("reward", last)[0], points - effort, atol=1e-5)
    one.simulation.close()


def test_learning_beside_playing_is_learning_before_it(tmp_path: Path) -> None:
    alone, beside = (learner(tmp_path / f"{cores}", cores) for cores in (1, 2))
    for _ in range(15):
        one, other = asdict(alone.step()), asdict(beside.step())
        np.testing.assert_equal(one, other)  # losses are not numbers at first
    for name, values in alone.net.state_dict().items():
        assert torch.equal(values, beside.net.state_dict()[name]), name
    for one in (alone, beside):
        one.simulation.close()


def test_tries_and_steps_grow_smaller_in_the_end(tmp_path: Path) -> None:
    """Half-way through the last half: tries fall to 1 - .75 / 2 of .08, and rates alike."""
    one = learner(tmp_path / "settling")
    one.step_count = 120
    assert one.explore == pytest.approx(0.9 - 0.3 * 0.82)
    one.step_count = 180
    assert one.explore == pytest.approx((0.9 - 0.9 * 0.82) * 0.625)
    one.step_count = 240
    assert one.explore == pytest.approx(0.08 * 0.25)
    one.simulation.close()


TINY = MotorTrainingConfig(cycles=2, bodies=4, width=16)
TINY_SIZES = {"_FIRST_PLAY_STEPS": 12, "_BODY_WIDTH": 16, "_USERS": 8, "_WINDOW_STEPS": 4}
TINY_CYCLES = {"play_steps": 6, "first_fit_minibatches": 20, "fit_minibatches": 20, "updates": 3}


@contextmanager
def tiny_practice() -> Iterator[None]:
    with patch.multiple(goal_task, **TINY_SIZES), patch.multiple(goal_task._Cycles, **TINY_CYCLES):
        yield


def motor_training() -> MotorTrainer:
    return motor_trainer(TINY, load_body("mobl_arms_wrist"), STEP_S, threads=1, seed=3)


@tiny_practice()
def test_a_motor_layer_is_kept_in_a_file_for_its_body_and_step(tmp_path: Path) -> None:
    whole, body = motor_training(), load_body("mobl_arms_wrist")
    whole.step()
    save_motor_layer(tmp_path / "layer.pt", whole.task.policy, body=body.name)
    read = load_motor_layer(tmp_path / "layer.pt", body, STEP_S)
    for name, values in whole.task.policy.weights().items():
        assert torch.equal(values, read.weights()[name]), name
    with pytest.raises(InputError, match="user steps differ"):
        load_motor_layer(tmp_path / "layer.pt", body, 0.1)
    other = load_body("mobl_arms_bimanual_motor")
    with pytest.raises(InputError, match="joints differ"):
        load_motor_layer(tmp_path / "layer.pt", other, STEP_S)


def test_a_body_without_a_layer_is_named() -> None:
    with pytest.raises(InputError, match=r"none for the body 'mobl_arms_wrist' in steps of 0\.1 s"):
        motor_layer_for(load_body("mobl_arms_wrist"), 0.1)
