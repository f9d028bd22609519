"""Beats and its model at once: the same users at the same time, moving about at random."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from short_cycles import short_cycles
from true_users import motion_of, worn_by

from sim2vr_harness.client import OptionValue
from sim2vr_harness.envs.config import AppConfig, EffortConfig, EnvConfig, UserConfig
from sim2vr_harness.envs.privileged import OBSERVATION
from sim2vr_harness.games.beats.game_model import FIELDS
from sim2vr_harness.games.beats.settings import Relaxation
from sim2vr_harness.policies.teacher import new_teacher
from sim2vr_harness.runs.config import apply_overrides
from sim2vr_harness.runs.teacher_config import TeacherConfig
from sim2vr_harness.training.model_based.stage import GameTrainer, game_trainer
from sim2vr_harness.training.teacher.env import TeacherSimulation

USERS, STEPS = 12, 199
SMALL = (
    *(f"imagined.n_envs={USERS}", "imagined.reward_scale=0.05"),
    *("imagined.cycles=2", "imagined.first_play_steps=30", "imagined.users=8"),
    *("imagined.body_width=16", "imagined.critic_width=16", "imagined.gradient_limit=2.0"),
)


@dataclass(frozen=True)
class Played:
    """A round of everybody, in the true game and in the model.

    Attributes:
        names: of what a teacher observes.
        imagined: (STEPS, USERS, F) what it observes in the model, and
        true: in the true game.
        effort: (STEPS, 2, USERS) costs, imagined and true.
        events: (STEPS, E) what has happened in the model so far, in the order of `EVENTS`.
        counts: (STEPS, L) of the true game so far, all users together, in the order of `counted`.
        sabers: how the model's blades are fixed.
    """

    names: tuple[str, ...]
    imagined: NDArray[np.float32]
    true: NDArray[np.float32]
    effort: NDArray[np.float64]
    events: NDArray[np.float64]
    counts: NDArray[np.float64]
    sabers: torch.Tensor


def rollouts(options: Mapping[str, OptionValue], *, torso: bool = False) -> GameTrainer:
    user = UserConfig(
        model="mobl_arms_bimanual_motor",
        skull_rotation_deg=0.0,
        torso=torso,
        effort=EffortConfig(model="neural", weight=0.01),
    )
    app = AppConfig(game="beats", options={**options, "end_on_miss": False})
    env = EnvConfig(app=app, user=user, cores=1)
    settings = TeacherConfig.model_validate(apply_overrides({}, SMALL))
    simulation = TeacherSimulation(env, settings, seed=4)
    spaces = simulation.observation_space, simulation.action_space
    policy = new_teacher(*spaces, seed=1)
    return game_trainer(settings.imagined, policy, simulation, seed=4)


def started(options: Mapping[str, OptionValue], *, torso: bool) -> tuple[GameTrainer, Any, Any]:
    """A training after its first step, and users and game of its model as in the true game."""
    with short_cycles():
        made = rollouts(options, torso=torso)
        made.step()
    sim = made.task.simulation
    users, game = made.task.imagine(USERS)
    game.sabers.fixed = made.task.game.sabers.fixed
    sim.reset(seeds=list(range(USERS)))
    sim._limit[:] = 10 * STEPS
    everyone = torch.arange(USERS)
    users.start(everyone, motion_of(sim.simulation.users, made.body.drives))
    columns = [sim.senses.names.index(name) for name in FIELDS]
    fields = torch.tensor(sim.senses.values()[:, columns], dtype=torch.float32)
    game.start(everyone, worn_by(sim), fields, everyone)
    game.begin(everyone)
    game.clear_counts()
    return made, users, game


def play(
    options: Mapping[str, OptionValue],
    *,
    torso: bool = False,
    soft: Relaxation | None = None,
    counted: tuple[str, ...] = (),
) -> Played:
    """Play a level that is the same for all seeds.

    Args:
        options: of the game, which its condition may change.
        soft: the model's relaxation; None takes that of a training's end.
        counted: names of the log to add up after every step.
    """
    made, users, game = started(options, torso=torso)
    sim = made.task.simulation
    rng = np.random.default_rng(0)
    observed = [[*users.names, *game.names].index(name) for name in sim.senses.observed_names]
    soft = soft or game.settings.relaxation(1.0)
    imagined, true, effort, events, counts = [], [], [], [], []
    for _ in range(STEPS):
        actions = 0.2 * rng.standard_normal((USERS, sim.action_space.shape[0]))
        control = made.body.drives.control(users.motion.drives, torch.tensor(actions))
        result = sim.step(actions)
        users.motion = motion_of(sim.simulation.users, made.body.drives)
        torch.testing.assert_close(users.motion.drives, control.float(), atol=1e-5, rtol=0.0)
        users._control = control.float()
        effort.append((users.costs()[0].numpy(), result.effort_cost))
        place = worn_by(sim)
        game.play(place, soft)
        events.append(game.events.tolist())
        seen = torch.cat([users.observe(), game.observe(place)], 1)
        imagined.append(seen[:, observed].numpy())
        true.append(sim.observation()[OBSERVATION])
        logs = sim.simulation.logs
        counts.append([sum(log[key] for log in logs) for key in counted])
    sim.close()
    return Played(
        names=tuple(sim.senses.observed_names),
        imagined=np.array(imagined),
        true=np.array(true),
        effort=np.array(effort),
        events=np.array(events),
        counts=np.array(counts),
        sabers=game.sabers.fixed,
    )
