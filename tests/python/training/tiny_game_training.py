"""Model-based training in Whac-A-Mole with as little of everything as there can be."""

from __future__ import annotations

from sim2vr_harness.envs.config import AppConfig, EnvConfig
from sim2vr_harness.policies.state_actor_critic import new_teacher
from sim2vr_harness.runs.config import apply_overrides
from sim2vr_harness.runs.teacher_config import TeacherConfig
from sim2vr_harness.training.model_based.game_task import GameTrainer, game_trainer
from sim2vr_harness.training.teacher.env import TeacherSimulation

ENV = EnvConfig(app=AppConfig(options={"condition": "random"}), cores=1)
SMALL = (
    *("ppo.n_envs=16", "ppo.n_steps=10", "ppo.batch_size=20"),
    *("curriculum.starts_per_cell=2", "evaluate_rounds=0", "total_timesteps=160"),
    *("imagined.cycles=3", "imagined.first_play_steps=30", "imagined.play_steps=10"),
    *("imagined.first_fit_minibatches=20", "imagined.fit_minibatches=20"),
    *("imagined.users=12", "imagined.updates=3", "imagined.critic_first_updates=1"),
    *("imagined.body_width=16", "imagined.critic_width=16"),
)


def new_rollouts(*overrides: str, env: EnvConfig = ENV, device: str = "cpu") -> GameTrainer:
    settings = TeacherConfig.model_validate(apply_overrides({}, [*SMALL, *overrides]))
    simulation = TeacherSimulation(env, settings, seed=4)
    policy = new_teacher(
        simulation.observation_space, simulation.action_space, settings.policy, seed=1
    )
    return game_trainer(settings.imagined, policy, simulation, seed=4, device=device)
