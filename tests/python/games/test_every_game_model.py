"""What every game's model must keep: it is the game, for whoever moves in it at random.

Users of the true game move about; the model gets the same movements from the same starts, and has
its own chance. So what happens in it, what a teacher observes and what it pays must agree on
average over users, within what chance explains. Rules one by one are tested beside this.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from true_users import worn_by

from sim2vr_harness.envs.config import AppConfig, EffortConfig, EnvConfig, UserConfig
from sim2vr_harness.games import imagined_games
from sim2vr_harness.runs.config import apply_overrides
from sim2vr_harness.runs.teacher_config import TeacherConfig
from sim2vr_harness.training.teacher import env as teacher_env
from sim2vr_harness.training.teacher.env import TeacherSimulation

N, STEPS = 24, 160
BODIES = {"beats": "mobl_arms_bimanual_motor"}
"""Of games that the usual body cannot play."""
MOST_DEVIATIONS = 5.0
"""By which the mean difference of users may be off, in standard errors of that mean, ..."""
SLACK = 0.05
"""... and beside that, in standard deviations of the number over all users and times."""


@dataclass(frozen=True)
class Both:
    """The same movements in a game and in its model.

    Attributes:
        names: of what a teacher observes of the game.
        true: (STEPS, N, F) that in the game, and
        imagined: in the model.
        rewards: (2, STEPS, N) of the game and of the model, in the game's unit.
        counts: (2, 2) successes and failures of all, of the game and of the model.
    """

    names: tuple[str, ...]
    true: NDArray[np.float64]
    imagined: NDArray[np.float64]
    rewards: NDArray[np.float64]
    counts: NDArray[np.float64]


@pytest.fixture(autouse=True, scope="module")
def short_teacher() -> Iterator[None]:
    with patch.multiple(teacher_env, _STARTS_PER_CELL=4, _EPISODE_S=60.0):
        yield


def users_of(game: str) -> TeacherSimulation:
    settings = [f"imagined.n_envs={N}"]
    config = TeacherConfig.model_validate(apply_overrides({}, settings))
    user = UserConfig(
        model=BODIES.get(game, "mobl_arms_wrist"), effort=EffortConfig(model="zero", weight=0.0)
    )
    return TeacherSimulation(
        EnvConfig(app=AppConfig(game=game), user=user, cores=1), config, seed=1
    )


def model_of(sim: TeacherSimulation) -> Any:
    conditions = [sim.describe(k) for k in range(len(sim.conditions))]
    frames = sim.config.frames_per_step
    settings = sim.game.settings()
    rounds = sim.game.rounds(
        N, conditions, settings, step_s=sim.step_s, frames=frames, seed=3, gamma=0.96
    )
    if sim.game.name == "whacamole":
        rounds._single[:] = False  # users with one target at a time have easier rounds
    return rounds


def play(name: str) -> Both:
    """Let users of the true game move about, and the model's with them."""
    sim = users_of(name)
    model = model_of(sim)
    sim.reset(seeds=list(range(N)))
    sim._limit[:] = STEPS + 1  # no round is cut
    everyone = torch.arange(N)
    columns = [sim.senses.names.index(name) for name in sim.game.fields]

    def fields() -> torch.Tensor:
        return torch.tensor(sim.senses.values()[:, columns], dtype=torch.float32)

    model.calibrate(worn_by(sim), fields())
    model.start(everyone, worn_by(sim), fields(), torch.full((N,), -1))
    model.begin(everyone)
    model.clear_counts()
    rng = np.random.default_rng(5)
    actions = sim.action_space.shape[0]
    wild = np.zeros((N, actions))
    told = [sim.senses.names.index(name) for name in model.names]
    true, imagined, rewards = [], [], []
    for step in range(STEPS):
        if step == STEPS - 20:  # one that goes on from its state plays the same
            other = model_of(sim)
            other.load_state_dict(model.state_dict())
        wild = 0.8 * wild + 0.6 * rng.standard_normal(wild.shape)
        result = sim.step(np.clip(0.25 * wild, -1.0, 1.0))
        place = worn_by(sim)
        places = place[:, None].expand(-1, model.frames, -1, -1, -1)
        paid = model.step(places, 1.0)
        if step >= STEPS - 20:
            assert torch.equal(other.step(places, 1.0), paid)
        with torch.no_grad():
            imagined.append(model.observe(place).numpy())
        true.append(sim.senses.values()[:, told])
        game_reward = result.reward + result.effort_cost
        rewards.append([game_reward, paid.detach().numpy()])
    outcomes = sum(sim.game.outcomes(log) for log in sim.simulation.logs)
    sim.close()
    counts = [outcomes.sum(1), model.counts.sum((1, 2)).numpy()]
    return Both(
        names=tuple(model.names),
        true=np.array(true, np.float64),
        imagined=np.array(imagined, np.float64),
        rewards=np.swapaxes(np.array(rewards, np.float64), 0, 1),
        counts=np.array(counts, np.float64),
    )


def off(true: NDArray[np.float64], imagined: NDArray[np.float64]) -> float:
    """How far two (STEPS, N) are apart on average, by what chance and SLACK explain; 1: too far."""
    each = (imagined - true).mean(0)
    error = each.std(ddof=1) / np.sqrt(len(each))
    return float(abs(each.mean()) / (MOST_DEVIATIONS * error + SLACK * true.std() + 1e-6))


@pytest.mark.parametrize("game", imagined_games())
def test_game_and_model_agree(game: str) -> None:
    """Counts of all users: apart by five times what Poisson's law says of both.

    Rewards are those of a training's end, where the model's hits are hardly soft any more.
    """
    both = play(game)
    wrong = {
        name: round(off(both.true[..., k], both.imagined[..., k]), 2)
        for k, name in enumerate(both.names)
    }
    assert {name: by for name, by in wrong.items() if by > 1.0} == {}
    assert (both.true.std((0, 1)) > 0.0).mean() > 0.3, "nothing happens in this game"
    true, imagined = both.counts
    assert true.sum() >= 20
    assert np.all(np.abs(true - imagined) <= MOST_DEVIATIONS * np.sqrt(true + imagined + 1.0))
    assert off(*both.rewards) <= 1.0
