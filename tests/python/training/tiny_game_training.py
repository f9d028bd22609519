"""Model-based training in Whac-A-Mole with as little of everything as there can be."""

from collections.abc import Iterator
from contextlib import contextmanager
from unittest.mock import patch

from short_cycles import short_cycles

from sim2vr_harness.envs.config import AppConfig, EnvConfig
from sim2vr_harness.policies.teacher import new_teacher
from sim2vr_harness.runs.config import apply_overrides
from sim2vr_harness.runs.teacher_config import TeacherConfig
from sim2vr_harness.training.model_based.stage import GameTrainer, game_trainer
from sim2vr_harness.training.teacher import env as teacher_env
from sim2vr_harness.training.teacher.env import TeacherSimulation

ENV = EnvConfig(app=AppConfig(options={"condition": "random"}), cores=1)
SMALL = (
    *(
        "imagined.n_envs=16",
        "imagined.cycles=3",
        "imagined.first_play_steps=30",
        "imagined.users=12",
    ),
    *("imagined.body_width=16", "imagined.critic_width=16"),
)


@contextmanager
def short_teacher(updates: int = 3) -> Iterator[None]:
    """Train with few starts and updates within a ``with`` statement."""
    starts = patch.object(teacher_env, "_STARTS_PER_CELL", 2)
    with starts, short_cycles(updates=updates, critic_first=1):
        yield


def new_rollouts(*overrides: str, env: EnvConfig = ENV, device: str = "cpu") -> GameTrainer:
    settings = TeacherConfig.model_validate(apply_overrides({}, [*SMALL, *overrides]))
    simulation = TeacherSimulation(env, settings, seed=4)
    policy = new_teacher(simulation.observation_space, simulation.action_space, seed=1)
    return game_trainer(settings.imagined, policy, simulation, seed=4, device=device)
