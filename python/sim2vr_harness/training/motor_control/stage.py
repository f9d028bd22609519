"""The stage that trains the motor policy of a body for which none ships."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

from sim2vr_harness.base.cores import budget
from sim2vr_harness.base.errors import InputError
from sim2vr_harness.envs.config import motor_noise
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.policies.hierarchical.motor_store import motor_layer_for, save_motor_layer
from sim2vr_harness.runs.config import TrainingConfig
from sim2vr_harness.training.model_based.stage import CycleStage
from sim2vr_harness.training.model_based.trainer import ModelBasedTrainer
from sim2vr_harness.training.motor_control.goal_task import (
    MOTOR_STATE,
    MotorTrainingCycle,
    motor_trainer,
)


def needs_motor_policy(config: TrainingConfig, env: ResolvedEnv) -> bool:
    """Whether a run has to make its motor layer first."""
    if config.skills.motor is not None or config.skills.people:
        return False
    try:
        motor_layer_for(env.body, 1.0 / config.env.action_frequency_hz)
    except InputError:
        return True
    return False


class MotorStage(CycleStage):
    """The training of a motor policy.

    Args:
        config: of the run.
        folder: of the stage.
        env: of the run.
    """

    name = "motor"
    title = "hands learn to reach their goals (no motor policy ships for this body)."
    result, state_of = "layer.pt", MOTOR_STATE

    def __init__(self, config: TrainingConfig, folder: Path, env: ResolvedEnv) -> None:
        super().__init__(config, folder, config.skills.motor_training.cycles)
        self._env = env

    @property
    def layer_file(self) -> Path:
        """Where the motor policy is, once there is one."""
        return self.folder / self.result

    def open(self) -> None:
        """Make the trainer."""
        config = self._config
        env = config.env
        self._learner = motor_trainer(
            config.skills.motor_training,
            self._env.body,
            1.0 / env.action_frequency_hz,
            noise=motor_noise(env.user.noise),
            threads=budget(env.cores),
            seed=config.seed,
        )

    def describe(self, report: MotorTrainingCycle) -> str:
        return report.in_words(round(self.total))

    def write_result(self, file: Path, trainer: ModelBasedTrainer[Any], report: Any) -> None:
        save_motor_layer(file, trainer.task.policy, **({} if report is None else asdict(report)))
