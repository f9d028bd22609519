"""Recipes: which stages a run is made of. A new recipe is one function and one line."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import cast

from torch import nn

from sim2vr_harness.envs.protocols import SimulationLike
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.runs.config import TrainingConfig
from sim2vr_harness.runs.run_folder import RunFolder
from sim2vr_harness.training.dagger.dagger import Expert
from sim2vr_harness.training.dagger.expert import TeacherExpert
from sim2vr_harness.training.dagger.stage import StudentStage
from sim2vr_harness.training.model_based.stage import ImaginedStage
from sim2vr_harness.training.motor_control.stage import MotorStage, needs_motor_policy
from sim2vr_harness.training.option_q_learning.stage import QLearningStage
from sim2vr_harness.training.ppo.fine_tune import user_to_adapt
from sim2vr_harness.training.ppo.stage import PPOStage
from sim2vr_harness.training.run.stage import Stage

MakeSimulation = Callable[[TrainingConfig], SimulationLike]
"""Makes the users to train with: ``config.ppo.n_envs`` of them."""


@dataclass(frozen=True)
class Run:
    """What a recipe makes stages of.

    Attributes:
        config: of the run.
        folder: of the run.
        stop: user steps after which the last stage ends.
        make_simulation: makes the users of the last stage.
        resumed: whether it goes on with what is in its folder; otherwise that is deleted before a
            stage runs, and nothing of it counts.
    """

    config: TrainingConfig
    folder: RunFolder
    stop: int
    make_simulation: MakeSimulation
    resumed: bool


def _from_pixels(
    run: Run, title: str, begin: Callable[[nn.Module], object] = lambda policy: None
) -> PPOStage:
    return PPOStage(run.config, run.folder, title, run.make_simulation, begin, run.stop)


def _ppo(run: Run) -> list[Stage]:
    return [_from_pixels(run, "PPO from what the user senses.")]


def _distill(run: Run) -> list[Stage]:
    """A teacher that knows, a student that sees, then PPO on what it senses itself.

    The result is a policy that is best for its own senses and its own effort.
    """
    config, path = run.config, run.folder.path
    teacher = ImaginedStage(config, path / ImaginedStage.name)

    def guide(simulation: Simulation) -> Expert:
        return TeacherExpert(teacher.folder / teacher.result, config.teacher, simulation)

    student = StudentStage(config, path / StudentStage.name, guide)

    def begin(policy: nn.Module) -> None:
        policy.load_state_dict(student.weights())

    title = "the student goes on by itself: PPO from what the user senses."
    return [teacher, student, _from_pixels(run, title, begin)]


def _skills(run: Run) -> list[Stage]:
    """Hands that know how to come to places, then what is worth doing there."""
    config, path = run.config, run.folder.path
    motor = MotorStage(config, path / MotorStage.name) if needs_motor_policy(config) else None
    values = QLearningStage(config, path / QLearningStage.name, motor, run.folder, stop=run.stop)
    return [values] if motor is None else [motor, values]


def _adapt(run: Run) -> list[Stage]:
    """A trained user that goes on where something is different."""
    title = "a trained user goes on: PPO from what it senses."
    if run.resumed and run.folder.checkpoints():
        return [_from_pixels(run, title)]
    user = user_to_adapt(run.config)
    noise = run.config.policy.log_std_init

    def begin(policy: nn.Module) -> None:
        user.load(policy)
        if noise != user.config.policy.log_std_init:  # the run has another one
            nn.init.constant_(cast(nn.Parameter, policy.log_std), noise)

    return [_from_pixels(run, title, begin)]


RECIPES: dict[str, Callable[[Run], list[Stage]]] = {
    "ppo": _ppo,
    "distill": _distill,
    "skills": _skills,
    "adapt": _adapt,
}


def stages_of(run: Run) -> list[Stage]:
    """Return the stages of a run, in order."""
    return RECIPES[run.config.recipe](run)
