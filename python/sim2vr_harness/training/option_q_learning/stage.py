"""The Q-learning stage of the recipe ``skills``, which follows that of the motor policy."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.finite import require_finite
from sim2vr_harness.base.torch_threads import torch_threads
from sim2vr_harness.envs.config import EnvConfig, body_of
from sim2vr_harness.envs.people_preset import with_measured_body
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.play.users import BASELINE_S, baseline_reward, note_of_baselines
from sim2vr_harness.policies.hierarchical.human_motor import HumanMotorPolicy
from sim2vr_harness.policies.hierarchical.motor_policy import MotorPolicy
from sim2vr_harness.policies.hierarchical.motor_store import (
    human_policy_for,
    load_human_policy,
    load_motor_layer,
    motor_layer_for,
)
from sim2vr_harness.policies.hierarchical.option_policy import HierarchicalPolicy, require_senses
from sim2vr_harness.policies.hierarchical.options import OptionSet, option_set
from sim2vr_harness.policies.hierarchical.person_policy import PersonPolicy, seen_late_steps
from sim2vr_harness.policies.hierarchical.pointing import AIM_RAYS, apart, rays_of
from sim2vr_harness.policies.hierarchical.primitives import MEASURED
from sim2vr_harness.policies.hierarchical.tool_detection import Tool, find_tools, straight_tool
from sim2vr_harness.runs.checkpoint import read_tensors, take_in, write_tensors, write_user
from sim2vr_harness.runs.config import TrainingConfig
from sim2vr_harness.runs.run_folder import RunFolder, append_row, keep_rows
from sim2vr_harness.training.motor_control.stage import MotorStage
from sim2vr_harness.training.option_q_learning.manner import (
    best_hold,
    choose_manner,
    compared_steps,
    hold_steps,
    holds,
)
from sim2vr_harness.training.option_q_learning.minibatch import N_STEP
from sim2vr_harness.training.option_q_learning.pace import Pace
from sim2vr_harness.training.option_q_learning.q_learning import DECIDE_STEPS, OptionQLearning
from sim2vr_harness.training.run.progress import View, duration
from sim2vr_harness.training.run.stage import Callbacks

_STATE, _LOG, _PICTURES = "state.pt", "cycles.jsonl", "pictures.bin"
_SAVE_DECISIONS, _REPORT_DECISIONS, _PACE_DECISIONS = 100, 20, 10
_MEASURED_SHARE = 0.75
"""Share of the user steps in which the measured body plays, undelayed but for its pictures, before
persons do: what an app rewards does not depend on who moves, and persons move slowly."""
_COMPARED_SHARE = 0.5
"""Share of the user steps before plain users compare manners of their hands; persons do when they
begin to play."""
_FIRST_S = 60.0
"""Before that the rates say little: learning has not begun."""
_HOPELESS = 0.35
"""Share of the stage after which a user should do better than one who does nothing."""


class QLearningStage:
    """See :class:`~sim2vr_harness.training.run.stage.Stage`.

    Args:
        config: of the run.
        folder: of the stage.
        motor: the run's own motor layer, if it makes one.
        run: whose checkpoints are hierarchical policies.
        stop: user steps after which the session ends, at most all of the stage.
    """

    name, unit = "q_learning", "user steps"
    title = "hands try what is worth doing with what is seen."

    def __init__(
        self,
        config: TrainingConfig,
        folder: Path,
        motor: MotorStage | None,
        run: RunFolder,
        *,
        stop: int,
    ) -> None:
        self._config, self.folder, self._motor, self._run = config, folder, motor, run
        self.stop = min(stop, config.skills.q_learning.user_steps)
        self.total = float(self.stop)
        self._simulation: Simulation | None = None
        self._learner: OptionQLearning | None = None
        self._state: dict[str, Any] | None = None
        self._steps_saved = 0

    @property
    def begun(self) -> bool:
        """See the protocol."""
        return self.finished or (self.folder / _STATE).is_file()

    @property
    def finished(self) -> bool:
        """See the protocol."""
        return bool(self._run.checkpoints()) and self._run.step >= self.stop

    @property
    def saved(self) -> str:
        """See the protocol."""
        done = self._steps_saved
        return f"{done:,} of {self.total:,.0f} user steps" if done else ""

    def _human(self) -> HumanMotorPolicy:
        env, given = self._config.env, self._config.skills.motor
        step_s = 1.0 / env.action_frequency_hz
        if given is not None:
            return load_human_policy(Path(given), env.user, step_s)
        return human_policy_for(env.user, step_s)

    def _layer(self) -> MotorPolicy:
        """Return what moves the hands, of persons before they play: those of the measured body."""
        env, given = with_measured_body(self._config.env), self._config.skills.motor
        given = None if self._config.skills.people else given  # a person's, then
        body, step_s = body_of(env.user), 1.0 / env.action_frequency_hz
        if given is not None:
            return load_motor_layer(Path(given), body, step_s)
        if self._motor is not None:
            return load_motor_layer(self._motor.layer_file, body, step_s)
        return motor_layer_for(body, step_s)

    @property
    def _options(self) -> OptionSet:
        return option_set(self._config.env.user.inputs, self._config.skills.options)

    def open(self) -> None:
        """See the protocol."""
        config = self._config.skills
        if config.people:
            if self._config.env.user.people is None:
                raise InputError(
                    "skills.user", "'person' without env.user.people", "train --people"
                )
            self._human()
        self._options  # noqa: B018  # refuses options without their input
        require_senses(self._config.env)
        width = config.motor_training.width
        if self._motor is None:
            width = self._layer().width
        if width != config.motor_training.width:
            got = f"{config.motor_training.width}, with a motor layer of width {width}"
            expected = f"{width} for a hierarchical policy"
            raise InputError("skills.motor_training.width", got, expected)
        env = self._before_persons.env
        self._simulation = Simulation(_seeing(env), config.q_learning.users)

    def run(self, callbacks: Callbacks) -> None:
        """See the protocol."""
        simulation, seed = self._simulation, self._config.seed
        assert simulation is not None
        self.folder.mkdir(parents=True, exist_ok=True)
        config = self._config
        with torch_threads(1):
            policy = HierarchicalPolicy(self._before_persons)
            policy.layer.take(self._layer().weights())
            policy.late_steps = self._late_steps
            if config.skills.people:
                policy.manner = MEASURED
            before, rate = self._prepared(simulation, policy, callbacks)
            learner = self._learner = OptionQLearning(
                config.skills.q_learning,
                simulation,
                policy,
                self.folder / _PICTURES,
                seed=seed,
                for_persons=config.skills.people,
            )
            if (self.folder / _STATE).is_file():
                take_in(self.folder / _STATE, "the state of Q-learning", self._resume)
                callbacks.say(f"Continuing with {learner.step_count:,} user steps.")
            self._steps_saved = learner.step_count
            log = self.folder / _LOG
            keep_rows(log, lambda row: row["step"] <= learner.step_count)
            self._learn(learner, callbacks, log, before, rate)
        finished = learner.finished
        steps = learner.step_count
        file = self._run.checkpoint_file(self.stop if finished else steps)
        # A person may decide in every user step: its refractory period says how often it does.
        hold = 1 if config.skills.people else best_hold(learner, callbacks)
        learner.policy.hold.fill_(hold)
        user = learner.policy
        if config.skills.people and not learner.persons:
            user = self._person(user)
            user.values = learner.net
        write_user(file, user, steps)
        if finished:
            self.tidy()

    def _resume(self, state: Mapping[str, Any]) -> None:
        """Continue from a state, with persons where they had begun to play."""
        assert self._learner is not None
        if OptionQLearning.of_persons(state):
            self._begin_persons(self._learner)
        self._learner.load_state_dict(state)

    def _begin_persons(self, learner: OptionQLearning) -> None:
        """Let persons play in the place of the measured body, and learn from what they do."""
        measured, config = self._simulation, self._config
        assert measured is not None
        self._simulation = Simulation(_seeing(config.env), config.skills.q_learning.users)
        learner.continue_with_persons(self._simulation, self._person(learner.policy))
        measured.close()

    def _person(self, measured: HierarchicalPolicy) -> PersonPolicy:
        """Return a person with the tools, rays and manner of the measured body."""
        person = PersonPolicy(self._config)
        person.human.take(self._human().weights())
        for name in ("tool", "rays", "lifts"):
            getattr(person, name).copy_(getattr(measured, name))
        return person

    @property
    def _before_persons(self) -> TrainingConfig:
        """The configuration of the users who begin: of plain users, or of the measured body."""
        return self._config.model_copy(update={"env": with_measured_body(self._config.env)})

    @property
    def _late_steps(self) -> int:
        """User steps by which persons see what they decide by."""
        env = self._config.env
        if not self._config.skills.people or env.user.people is None:
            return 0
        return seen_late_steps(env.user.people.visual_delay_s, 1.0 / env.action_frequency_hz)

    def _prepared(
        self, simulation: Simulation, policy: HierarchicalPolicy, callbacks: Callbacks
    ) -> tuple[dict[str, float], float]:
        """Find tools and rays of the hands; return baseline rewards and the simulation rate.

        Rewards are per minute, effort taken off, the rate is in user steps a second; of a resumed
        run it is 0.
        """
        file, layer = self.folder / "before.pt", policy.layer
        known = read_tensors(file, "what was found before trying") if file.is_file() else {}
        if "rays" in known:
            policy.tool.copy_(known["tool"])
            policy.rays.copy_(known["rays"])
            return {name: float(v) for name, v in known["earned"].items()}, 0.0
        callbacks.doing("tools and baselines")
        callbacks.say("Finding tools and measuring baselines ...")
        rays = AIM_RAYS.repeat(len(layer.hands), 1, 1)
        if any(name.endswith(".trigger") for name in self._config.env.user.inputs):
            rays = rays_of(simulation, layer.hands)
        if off := apart(rays):
            callbacks.say(f"Hands point with the page's own ray, {off} from WebXR's.")
        tools = self._tools(simulation, policy, rays)
        points = np.array([[tool.tip, tool.middle] for tool in tools])
        for hand, held in zip(layer.hands, tools, strict=True):
            callbacks.say(f"In the hand of {hand}: {held.why}.")
        began = time.monotonic()
        idle, random = (
            baseline_reward(simulation, user, self._config.seed) for user in ("still", "random")
        )
        earned = {"still": idle[0] - idle[1], "random": random[0] - random[1]}
        steps = 2.0 * BASELINE_S * self._config.env.action_frequency_hz * simulation.n
        rate = steps / (time.monotonic() - began)
        callbacks.say(
            f"Reward per minute, less effort: {earned['still']:.2f} of the idle baseline, "
            f"{earned['random']:.2f} of the random baseline."
        )
        if note := note_of_baselines(idle, random):
            callbacks.say(f"Note: {note}.")
        tool = torch.tensor(points, dtype=torch.float32)
        rewards = {name: torch.tensor(value) for name, value in earned.items()}
        write_tensors(file, {"tool": tool, "rays": rays, "earned": rewards})
        policy.tool.copy_(tool)
        policy.rays.copy_(rays)
        return earned, rate

    def _tools(
        self, simulation: Simulation, policy: HierarchicalPolicy, rays: Tensor
    ) -> list[Tool]:
        """What each hand holds, as ``skills.tool`` says or as it is seen."""
        wanted, layer, poses = self._config.skills.tool, policy.layer, policy.poses
        if wanted == "auto":
            return find_tools(simulation, layer, poses, seed=self._config.seed, rays=rays)
        if wanted == "none":
            return [Tool(np.zeros((0, 3)), "nothing, as skills.tool says") for _ in layer.hands]
        return [straight_tool(wanted) for _ in layer.hands]

    def _learn(
        self,
        learner: OptionQLearning,
        callbacks: Callbacks,
        log: Path,
        before: Mapping[str, float],
        rate: float,
    ) -> None:
        began, first, decisions = time.monotonic(), learner.step_count, 0
        each = learner.n * DECIDE_STEPS
        pace = self._pace(each, learner, rate)
        doing = "trying at random"
        warned = said = False
        while learner.step_count < self.stop:
            if learner.step_count >= self._measured_steps and not learner.persons:
                callbacks.say("Persons play from now on, with what has been learned.")
                self._begin_persons(learner)
            if learner.step_count >= self._compared_steps and not learner.manner_chosen:
                choose_manner(learner, callbacks)
                pace.compared = 0
            before_s = time.monotonic()
            report = learner.step(callbacks.doing)
            decisions += 1
            done = learner.step_count
            pace.note(done // each, time.monotonic() - before_s)
            if rate and decisions == max(_PACE_DECISIONS, N_STEP + 1):
                measuring = time.monotonic()
                pace.update_s = learner.updates * learner.update_seconds()
                began += time.monotonic() - measuring
            if not said and time.monotonic() - began >= _FIRST_S:
                said = True
                left = duration(pace.left_s(done // each))
                callbacks.say(f"About {left} of Q-learning are left, all measurements included.")
            callbacks.show(lambda: View(done, doing, pace.left_s(done // each)))  # noqa: B023
            if decisions % _REPORT_DECISIONS == 0 or done >= self.stop:
                rate = (done - first) / (time.monotonic() - began)
                doing = (
                    f"step {done:,}, reward per minute {report.reward:.2f} (still "
                    f"{before['still']:.2f}, random {before['random']:.2f}), "
                    f"{100 * report.explore:.0f} % exploratory ({rate:,.0f} steps/s)"
                )
                row = asdict(report) | {"step": done}
                row["loss"] = None if math.isnan(report.loss) else report.loss
                append_row(log, row)
                callbacks.report(done, row)
            if decisions % _SAVE_DECISIONS == 0 or done >= self.stop:
                self._remember(learner)
                self.save()
            if not warned and done > _HOPELESS * self.total:
                warned = True
                _warn(report.reward, before, learner, callbacks)
        callbacks.say("Q-learning: " + doing)

    def _pace(self, each: int, learner: OptionQLearning, rate: float) -> Pace:
        """The time that the stage takes.

        Args:
            each: user steps of a decision of all users.
            learner: as it begins or continues.
            rate: user steps a second of idle users; 0: not known.
        """
        persons, hz = self._config.skills.people, self._config.env.action_frequency_hz
        steps = hold_steps(learner.n, hz)
        compared = 0
        if not learner.manner_chosen and self.stop > self._compared_steps:
            compared = compared_steps(hz, persons=persons) // DECIDE_STEPS
        return Pace(
            -(-self._config.skills.q_learning.try_steps // each),
            -(-self.stop // each),
            compared=compared,
            durations=() if persons else [(steps, hold) for hold in holds()],
            hold=DECIDE_STEPS,
            step_s=learner.n / rate if rate else 0.0,
        )

    @property
    def _measured_steps(self) -> float:
        """User steps that the measured body plays, before persons do."""
        share = _MEASURED_SHARE if self._config.skills.people else math.inf
        return share * self._config.skills.q_learning.user_steps

    @property
    def _compared_steps(self) -> float:
        """User steps before the manner of hands is chosen."""
        if self._config.skills.people:
            return self._measured_steps
        return _COMPARED_SHARE * self._config.skills.q_learning.user_steps

    def _remember(self, learner: OptionQLearning) -> None:
        state = learner.state_dict()
        file = self.folder / _STATE
        learned = {"values": state["net"], "optimizer": state["optimizer"]}
        where = f"after {learner.step_count:,} user steps"
        require_finite(learned, where, file if file.is_file() else None)
        self._state = state

    def save(self) -> None:
        """See the protocol."""
        learner = self._learner
        if self._state is None or learner is None:
            return
        write_tensors(self.folder / _STATE, self._state)
        self._state, self._steps_saved = None, learner.step_count

    def tidy(self) -> None:
        """See the protocol: pictures and the state, which no one needs any more."""
        self._state = None
        for name in (_STATE, _PICTURES):
            (self.folder / name).unlink(missing_ok=True)

    def close(self) -> None:
        """See the protocol."""
        if self._simulation is not None:
            self._simulation.close()
        self._simulation = self._learner = self._state = None


def _seeing(env: EnvConfig) -> EnvConfig:
    """What users decide by is drawn, and no larger."""
    vision = env.vision.model_copy(update={"zoom": 1})
    return env.model_copy(update={"vision": vision})


def _warn(
    reward: float, before: Mapping[str, float], learner: OptionQLearning, callbacks: Callbacks
) -> None:
    """Say so where nothing is learned, and what to look at."""
    best = max(before.values())
    if reward > best + 0.05 * abs(best):
        return
    earned, within = learner.diagnosis()
    callbacks.say(
        f"Nothing is being learned yet: {reward:.2f} per minute, {best:.2f} without learning. "
        f"{100 * earned:.1f} % of the decisions were rewarded and {100 * within:.0f} % of what is "
        "seen near is within reach. Check where the app puts things (sim2vr-harness render "
        "snapshot, reach), that they are seen against their background, and what the reward is for."
    )
