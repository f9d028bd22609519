"""Practice in the mind: does the imagined body and game do what the true ones do?"""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import torch
from rich.console import Console

from sim2vr_harness.client.frames import position_to_app
from sim2vr_harness.envs.config import AppConfig, EnvConfig, NoiseConfig, UserConfig
from sim2vr_harness.training import teacher
from sim2vr_harness.training.config import apply_overrides
from sim2vr_harness.training.errors import InputError
from sim2vr_harness.training.imagination import Practice
from sim2vr_harness.training.imagination.body import BodyModel, Experience, Motion, fit_body
from sim2vr_harness.training.imagination.noise import ImaginedNoise
from sim2vr_harness.training.imagination.whacamole import (
    CONTROLLER,
    FIELDS,
    HammerModel,
    ImaginedWhacAMole,
    Relaxation,
)
from sim2vr_harness.training.teacher_config import TeacherConfig
from sim2vr_harness.training.teacher_env import OBSERVATION, TeacherSimulation
from sim2vr_harness.training.teacher_policy import TeacherPolicy
from sim2vr_harness.users.noise import MotorNoise, MotorNoiseSettings

pytest.importorskip("sim2vr_harness._app_runtime")

ENV = EnvConfig(app=AppConfig(options={"condition": "random"}), threads=1)
SMALL = (
    *("ppo.n_envs=16", "ppo.n_steps=10", "ppo.batch_size=20", "ppo.net_arch=[16]"),
    *("aids.starts_per_cell=2", "evaluate_rounds=0", "total_timesteps=160"),
    *("imagination.cycles=3", "imagination.first_play_steps=30", "imagination.play_steps=10"),
    *("imagination.first_fit_minibatches=20", "imagination.fit_minibatches=20"),
    *("imagination.users=12", "imagination.updates=3", "imagination.critic_first_updates=1"),
    *("imagination.body_width=16", "imagination.critic_width=16", "coarse_until_step=0"),
)
SOFT = Relaxation(overlap_m=0.01, speed_mps=0.2, near=1.0, distance=1.0, effort=0.1)


def config(*overrides: str) -> TeacherConfig:
    return TeacherConfig.model_validate(apply_overrides({}, [*SMALL, *overrides]))


@pytest.fixture(scope="module")
def practice() -> Practice:
    """After its first cycle, in which users of the true game moved about at random."""
    made = new_practice()
    made.step()
    return made


def new_practice(*overrides: str, env: EnvConfig = ENV) -> Practice:
    settings = config(*overrides)
    simulation = TeacherSimulation(env, settings, seed=4)
    policy = TeacherPolicy(
        simulation.observation_space,
        simulation.action_space,
        lambda _: 1e-3,
        config=settings.ppo,
    )
    return Practice(settings.imagination, policy, simulation, seed=4)


def experience(practice: Practice) -> Experience:
    return practice._seen[0]


# --- the body ----------------------------------------------------------------------------------


def test_the_chain_places_the_hand_as_mujoco_does(practice: Practice) -> None:
    user = practice.simulation.simulation.body
    data = mujoco.MjData(user.physics_model)
    low, high = user.joint_ranges.T
    angles = np.random.default_rng(1).uniform(low, high, (20, 7))
    told = practice.body.chain(torch.tensor(angles, dtype=torch.float32)).numpy()
    for each, place in zip(angles, told, strict=True):
        data.qpos[:] = user.coupled_qpos(each)
        mujoco.mj_kinematics(user.physics_model, data)
        site = data.site(CONTROLLER)
        np.testing.assert_allclose(place[:3, 3], site.xpos, atol=2e-6)
        np.testing.assert_allclose(place[:3, :3].ravel(), site.xmat, atol=5e-6)


def test_the_hammer_is_where_the_game_says(practice: Practice) -> None:
    steps = experience(practice)
    marker, axes = practice.hammer(steps.after.angles)
    told = {name: steps.fields[:, i] for i, name in enumerate(FIELDS)}
    where = torch.stack([told[f"hammer.{axis}_m"] for axis in "xyz"], 1)
    face = torch.stack([told[f"hammer.face_{axis}"] for axis in "xyz"], 1)
    # Dependent joints lag behind their couplings a little, which are soft.
    assert (marker - where).norm(dim=1).median() < 5e-4
    assert (-axes[:, 0] - face).norm(dim=1).median() < 5e-3
    spin = torch.linalg.det(axes)
    torch.testing.assert_close(spin, torch.ones_like(spin), atol=0.02, rtol=0.0)


def test_a_body_learns_what_users_did() -> None:
    """After half a minute's practice of 16 users the hand's place is known to a third."""
    practice = new_practice("imagination.first_play_steps=200", "imagination.body_width=64")
    practice.step()
    fit = fit_body(practice.body, experience(practice), minibatches=400, learning_rate=4e-3)
    assert fit["moved_m"] > 0.03
    assert fit["place_m"] < fit["moved_m"] / 3.0
    assert fit["act"] < 0.03
    assert (practice.body.error > 0.0).all()
    practice.simulation.close()


# --- the game ----------------------------------------------------------------------------------


def test_the_mind_observes_what_the_true_game_tells(practice: Practice) -> None:
    """The same moment, in both: every number that a teacher observes."""
    sim, game = practice.simulation, practice._new_game(16)
    sim.explore(5.0)
    sim.reset(seeds=list(range(16)))
    sim.explore(None)
    rng = np.random.default_rng(3)
    for _ in range(30):
        result = sim.step(0.3 * rng.standard_normal((16, 32)))
        ended = np.flatnonzero(result.terminated | result.truncated)
        if len(ended):
            sim.reset([int(i) for i in ended])
    users = sim.simulation.users
    as_tensor = lambda a: torch.tensor(a, dtype=torch.float32)  # noqa: E731
    motion = Motion(
        as_tensor(users.qpos[:, users.body.qpos_independent]),
        as_tensor(users.qvel[:, users.body.qvel_independent]),
        as_tensor(users.act),
    )
    fields = sim.senses.values()
    columns = [sim.senses.names.index(name) for name in FIELDS]
    steps = Experience(motion, motion.act, motion, as_tensor(fields[:, columns]))
    game.start(
        torch.arange(16),
        motion,
        game.velocity_of(steps),
        game.condition_of(steps),
        torch.full((16,), -1),
    )
    life = np.stack([sim.senses.field(f"cell{c}.life_s") for c in range(9)], 1)
    there = np.stack([sim.senses.field(f"cell{c}.present") for c in range(9)], 1)
    ages = np.where(there > 0, np.round((1.098 - life) / 0.05), -1)
    game._age = torch.tensor(ages, dtype=torch.long)
    names = list(game.names)
    mind = game.observe()[:, [names.index(name) for name in sim.senses.observed_names]].numpy()
    true = sim.observation()[OBSERVATION]
    assert there.sum() > 10
    for i, name in enumerate(sim.senses.observed_names):
        # Where couplings yield, the hammer is turned by some hundredths.
        tolerance = 0.04 if name.startswith("hammer") else 0.01
        np.testing.assert_allclose(mind[:, i], true[:, i], atol=tolerance, err_msg=name)
    overlap = np.stack([sim.senses.field(f"cell{c}.overlap") for c in range(9)], 1)
    assert ((overlap == 0) | (there > 0)).all()


def resting_game(n: int, **how: float) -> ImaginedWhacAMole:
    """Users whose bodies stay where they are."""
    user = TeacherSimulation(ENV, config("ppo.n_envs=1", "ppo.batch_size=10"), seed=1)
    body = BodyModel(user.simulation.body, CONTROLLER, 0.05, width=4)
    told = [user.told_of(number) for number in range(3)]
    model = user.simulation.body
    user.close()
    with torch.no_grad():
        for parameter in body.acceleration.parameters():
            parameter.zero_()
    game = ImaginedWhacAMole(
        model, body, HammerModel(body), told, n, single=how.get("single", 0.0), seed=2
    )
    rest = Motion(torch.zeros(n, 7), torch.zeros(n, 7), torch.zeros(n, 32))
    conditions = torch.arange(n) % 3
    game.start(torch.arange(n), rest, torch.zeros(n, 3), conditions, torch.full((n,), -1))
    return game


def test_targets_live_as_long_and_come_as_often_as_in_the_game() -> None:
    game = resting_game(60, single=0.5)
    game._age[:] = -1
    most_single = most = 0
    births: dict[tuple[int, int], int] = {}
    lives = []
    for frame in range(300):
        before = game._age.clone()
        game.step(torch.zeros(60, 32), SOFT, error_share=0.0)
        there = game._age >= 0
        most_single = max(most_single, int(there[:30].sum(1).max()))
        most = max(most, int(there[30:].sum(1).max()))
        assert ((there & (before < 0)).sum(1) <= 1).all()  # at most one a frame
        for user, cell in torch.nonzero(there & (before < 0)).tolist():
            births[user, cell] = frame
        for user, cell in torch.nonzero(~there & (before >= 0)).tolist():
            lives.append(frame - births[user, cell])
    assert (most_single, most) == (1, 3)
    assert set(lives) == {22}  # 1.1 s, growing included
    assert game.counts[0].sum() == 0
    assert game.counts[1].sum() == len(lives)
    # A target, its fading out, and the mean ban: users with one at a time wait for the longest.
    assert 30 * 300 / 31 < len(lives) < 60 * 300 / 10


def game_at_a_target() -> ImaginedWhacAMole:
    """Four users whose hammers are in the middle target of the middle placement.

    The first comes in at 0.9 m/s, the second at 0.7 m/s, the third was inside already, and the
    fourth one's target is still growing.
    """
    game = resting_game(4)
    # The marker is where the controller is told to be.
    game.condition[:] = 1
    with torch.no_grad():
        game.hammer.fixed.zero_()
        # The box is 5 cm along the handle's axis y from the marker, 1.4 mm from it across.
        game.hammer.fixed[12, :3] = game._cells[1, 4]
        game.hammer.fixed[12, 3:6] = torch.tensor([0.0, 0.0, 1.0])
        game.hammer.fixed[12, 6:] = torch.tensor([0.0, 1.0, 0.0])
    root, _ = game._points(*game.hammer(game.motion.angles))
    game._age[:], game._fading[:] = -1, 0
    game._age[:, 4] = torch.tensor([5, 5, 5, 0])
    game._ban_s[:] = 9.0
    # The velocity that is judged is half the last frame's and half of what it was.
    speeds = torch.tensor([0.9, 0.7, 0.9, 0.9])
    game._velocity = torch.zeros(4, 3)
    game._root = root.clone()
    game._root[:, 2] -= speeds * 2.0 * 0.049999997
    game._inside[2, 4] = True
    return game


def test_only_coming_in_fast_enough_is_a_hit() -> None:
    game = game_at_a_target()
    game.step(torch.zeros(4, 32), SOFT, error_share=0.0)
    assert game._inside[:, 4].tolist() == [True, True, True, True]
    assert game._hit[:, 4].tolist() == [True, False, False, False]
    game.step(torch.zeros(4, 32), SOFT, error_share=0.0)
    assert game._age[:, 4].tolist() == [-1, 7, 7, 2]
    assert game.counts[0, 1].tolist() == [0, 0, 0, 0, 1, 0, 0, 0, 0]


def test_staying_in_a_target_costs_by_how_deep_the_hammer_is() -> None:
    rewards = []
    for stuck in (0.0, 1.0):
        game = game_at_a_target()
        soft = replace(SOFT, stuck=stuck)
        steps = [game.step(torch.zeros(4, 32), soft, error_share=0.0) for _ in range(2)]
        rewards.append(torch.stack(steps))
    # Half sizes of 12.5 mm (target) and 50 mm (hammer), middles 47.8 mm apart: 14.7 mm deep, of 40.
    cost = 1.0 + (0.0125 + 0.050 - (0.0482 - 0.000401)) / 0.04
    expected = torch.tensor([[0.0, 0.0, cost, 0.0], [0.0, cost, cost, cost]])
    torch.testing.assert_close(rewards[0] - rewards[1], expected, atol=1e-4, rtol=0.0)


def test_the_reward_s_gradient_is_that_of_finite_differences(practice: Practice) -> None:
    def total(actions: torch.Tensor) -> torch.Tensor:
        game = practice._new_game(6)
        steps = experience(practice).rows(torch.arange(0, 60, 10))
        game.start(
            torch.arange(6),
            steps.after,
            game.velocity_of(steps),
            game.condition_of(steps),
            torch.tensor([4, 4, 1, 3, 5, 7]),
        )
        worth = torch.zeros(())
        for change in actions:
            worth = worth + game.step(change, SOFT, error_share=0.0).sum()
        return worth

    generator = torch.Generator().manual_seed(1)
    actions = 0.2 * torch.randn(4, 6, 32, generator=generator)
    actions.requires_grad_(True)
    total(actions).backward()
    direction = torch.randn(4, 6, 32, generator=generator)
    with torch.no_grad():
        h = 2e-3
        slope = (total(actions + h * direction) - total(actions - h * direction)) / (2.0 * h)
    assert actions.grad is not None
    expected = float((actions.grad * direction).sum())
    assert abs(expected) > 1e-3
    assert float(slope) == pytest.approx(expected, rel=0.05)


def test_hits_are_worth_what_their_cells_say(practice: Practice) -> None:
    game, steps = practice._new_game(40), experience(practice)
    begin = steps.rows(torch.arange(40))
    rewards = []
    for value in (0.0, 1.0, 3.0):
        condition = game.condition_of(begin)
        game.start(
            torch.arange(40),
            begin.after,
            game.velocity_of(begin),
            condition,
            torch.zeros(40).long(),
        )
        game._age[:] = 5  # a target in every cell
        game._velocity = game._strike[condition]  # at 1 m/s
        game.hit_values.fill_(value)
        rewards.append(game._judge(*judged(game), replace(SOFT, overlap_m=0.1)))
    assert (rewards[1] - rewards[0] > 1e-3).any()
    torch.testing.assert_close(
        rewards[2] - rewards[0], 3.0 * (rewards[1] - rewards[0]), atol=1e-4, rtol=1e-4
    )


def judged(game: ImaginedWhacAMole) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    marker, axes = game._pose()
    return marker, game._points(marker, axes)[1], axes


def test_the_hammer_is_seen_where_a_user_goes_on(practice: Practice) -> None:
    game, steps = practice._new_game(2), experience(practice)
    place = [game.names.index(f"hammer.{axis}_m") for axis in "xyz"]
    game.observe()
    begin = steps.rows(torch.tensor([3, 50]))
    condition = game.condition_of(begin)
    game.start(
        torch.arange(2), begin.after, game.velocity_of(begin), condition, torch.full((2,), -1)
    )
    torch.testing.assert_close(
        game.observe()[:, place], practice.hammer(begin.after.angles)[0], atol=1e-6, rtol=0.0
    )


@pytest.mark.parametrize("colour", ["white", "red"])
def test_imagined_motor_noise_is_as_large_as_the_users(colour: Any) -> None:
    """Of 0.3: 0.103 of it for each muscle apart, 0.02 for all alike; red adds up."""
    settings = MotorNoiseSettings(signal_dependent=colour, constant=colour)
    settings = replace(settings, constant_level=0.02)  # so that nothing is cut off
    n, steps = 4000, 2
    mind, true = ImaginedNoise(settings, n, 3), MotorNoise(settings, n, 3)
    control = torch.full((n, 3), 0.3, requires_grad=True)
    torch.manual_seed(1)
    for _ in range(steps):
        imagined = mind.apply(control)
        noisy = true.apply(np.full((n, 3), 0.3), range(n))
    often = steps if colour == "red" else 1
    shared = often * 0.02**2
    expected = np.full((3, 3), shared) + np.eye(3) * often * (0.103 * 0.3) ** 2
    for got in (imagined.detach().numpy(), noisy):
        np.testing.assert_allclose(np.cov(got.T), expected, atol=0.08 * expected[0, 0])
        np.testing.assert_allclose(got.mean(0), 0.3, atol=0.003)
    (imagined.sum() / n).backward()
    assert control.grad is not None
    assert float(control.grad.sum()) == pytest.approx(3.0, abs=0.01)  # more control is more
    mind.forget(torch.arange(n))
    assert not any(float(value.abs().max()) for value in mind.state().values())


def test_users_with_motor_noise_practise_with_it(tmp_path: Path) -> None:
    """The mind's users have the noise of the true ones, and the body model knows it is there."""
    noise = NoiseConfig(signal_dependent="white", constant="red")
    env = ENV.model_copy(update={"user": UserConfig(noise=noise)})
    made = new_practice(env=env)
    told = made.step()
    quiet = new_practice()
    assert told.place_error_m != quiet.step().place_error_m
    controls, without = experience(made).control, experience(quiet).control
    assert controls.shape == without.shape
    assert not torch.equal(controls, without)
    made.save(tmp_path)
    after = made.step()
    again = new_practice(env=env)
    assert again.restore(tmp_path)
    assert again.step() == after
    assert float(made.game.state()["constant_red"].abs().max()) > 0.0
    made.simulation.close()
    again.simulation.close()
    quiet.simulation.close()


# --- practice ----------------------------------------------------------------------------------


def test_practice_moves_the_actor_alone(practice: Practice) -> None:
    before = {key: value.clone() for key, value in practice.policy.state_dict().items()}
    practice.step()
    after = practice.policy.state_dict()
    moved = {key for key in before if not torch.equal(before[key], after[key])}
    assert "action_net.weight" in moved
    assert all("policy_net" in key or key.startswith("action_net") for key in moved)


def test_missed_cells_come_up_more_often_and_are_worth_more(practice: Practice) -> None:
    game = practice.game
    game.spawn_weights.fill_(1.0 / 9.0)
    game.hit_values.fill_(1.0)
    game.counts[0], game.counts[1] = 10.0, 0.0
    game.counts[:, 2, 6] = torch.tensor([0.0, 10.0])
    practice._learn_weights()
    assert game.spawn_weights[2, 6] > 2.0 * game.spawn_weights[2, 0]
    torch.testing.assert_close(game.spawn_weights.sum(1), torch.ones(3))
    # It fails 7.8 times as often as the mean, of which 3 count: worth 2 hits more, half of it now.
    expected = torch.ones(3, 9)
    expected[2, 6] = 2.0
    torch.testing.assert_close(game.hit_values, expected)
    game.hit_values.fill_(1.0)


def test_only_what_the_mind_knows_may_be_observed() -> None:
    with pytest.raises(InputError, match=r"teacher.hidden_fields.*qacc.*imagination.cycles: 0"):
        new_practice('hidden_fields=["aid.*"]')


@pytest.mark.parametrize("stop", [1, 2])
def test_practice_that_was_stopped_ends_in_the_same_bits(
    stop: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    console = Console(file=io.StringIO())

    def train(folder: Path) -> teacher.TeacherResult | None:
        return teacher.train_teacher(config(), ENV, folder, seed=5, console=console)

    train(tmp_path / "whole")
    step = Practice.step

    def stopping(self: Practice, tell: Callable[[str, float], None]) -> object:
        if self.cycle == stop:
            raise KeyboardInterrupt
        return step(self, tell)

    with monkeypatch.context() as patch:
        patch.setattr(Practice, "step", stopping)
        with pytest.raises(InputError, match="no checkpoint yet"):
            train(tmp_path / "parts")
    assert (tmp_path / "parts" / "imagination.pt").is_file()
    train(tmp_path / "parts")
    one, other = (
        torch.load(tmp_path / name / "practised.pt", weights_only=True)
        for name in ("whole", "parts")
    )
    assert [key for key in one if not torch.equal(one[key], other[key])] == []
    assert not (tmp_path / "parts" / "imagination.pt").exists()
    lines = (tmp_path / "parts" / "practice.jsonl").read_text().splitlines()
    assert len(lines) == 3


def test_positions_are_the_app_s() -> None:
    # What the imagined game takes for granted: up is y, away from the player is z.
    np.testing.assert_allclose(position_to_app(np.array([[1.0, 2.0, 3.0]])), [[-2.0, 3.0, 1.0]])
