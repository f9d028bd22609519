"""The learner: rollout and update with the configuration's policy, from pixels."""

from __future__ import annotations

from typing import Any

from sim2vr_harness.bench.processes import cpu_seconds
from sim2vr_harness.bench.scenes import Scene, Spec
from sim2vr_harness.bench.turns import Turn
from sim2vr_harness.training import ppo
from sim2vr_harness.training.config import TrainingConfig
from sim2vr_harness.training.measuring import silent_logger
from sim2vr_harness.training.memory import keep_freed_memory
from sim2vr_harness.training.vec_env import SimulationVecEnv

__all__ = ["TrainScene", "short_iteration"]


class TrainScene(Scene):
    """Training iterations that are short; the update's number of epochs is the configuration's.

    A turn is one whole iteration, however long it takes, and its rate is that of rollout and update
    together. The policies of two runs need not agree to the bit, so there is no hash.
    """

    most_turns = 3

    def __init__(self, spec: Spec) -> None:
        super().__init__(spec.n)
        from sim2vr_harness.envs.simulation import Simulation

        small = short_iteration(spec.config, spec.n, spec.train_steps)
        self.steps = small.ppo.steps_per_iteration
        self.batch_size = small.ppo.batch_size
        keep_freed_memory()
        env = SimulationVecEnv(Simulation(spec.env(), spec.n))
        self._stack.callback(env.close)
        self.model = ppo.build(small, env)
        self.model.set_logger(silent_logger())

    def step(self) -> None:
        """One iteration."""
        self.model.learn(self.steps, reset_num_timesteps=False)

    def measure(self, seconds: float) -> Turn:
        """One iteration, whatever the time given."""
        cpu_began = cpu_seconds()
        self.step()
        cpu_us = 1e6 * (cpu_seconds() - cpu_began) / self.steps
        rollout, update = self.model.last_times
        parts = {
            "rollout_steps_per_s": self.steps / rollout,
            "update_steps_per_s": self.steps / update,
        }
        return Turn(self.steps / (rollout + update), cpu_us, parts)

    def extra(self) -> dict[str, Any]:
        """See the base class."""
        return {
            "train_steps": self.steps,
            "batch_size": self.batch_size,
            "n_epochs": self.model.n_epochs,
        }


def short_iteration(config: TrainingConfig, n: int, train_steps: int) -> TrainingConfig:
    """The configuration with an iteration of at least ``train_steps`` user steps.

    Minibatches are whole and about as large as the configuration's.

    Args:
        config: the training's.
        n: number of users.
        train_steps: user steps of an iteration; at least two per user are taken.
    """
    n_steps = max(2, -(-train_steps // n))
    minibatches = max(1, round(n * n_steps / config.ppo.batch_size))
    n_steps = minibatches * -(-n_steps // minibatches)
    batch_size = n * n_steps // minibatches
    changes = {"n_envs": n, "n_steps": n_steps, "batch_size": batch_size}
    return config.model_copy(update={"ppo": config.ppo.model_copy(update=changes)})
