"""The Q-learning stage of the recipe ``skills``, which follows that of the motor policy."""

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.progress import View
from sim2vr_harness.base.torch_threads import torch_threads
from sim2vr_harness.envs.people_preset import with_measured_body
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.envs.shards import in_this_process, make_simulation
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.play.users import baseline_reward, note_of_baselines
from sim2vr_harness.policies.hierarchical.human_motor import HumanMotorPolicy
from sim2vr_harness.policies.hierarchical.motor_policy import MotorPolicy
from sim2vr_harness.policies.hierarchical.motor_store import (
    human_policy_for,
    load_human_policy,
    load_motor_layer,
    motor_layer_for,
)
from sim2vr_harness.policies.hierarchical.option_policy import HierarchicalPolicy, require_senses
from sim2vr_harness.policies.hierarchical.options import option_set
from sim2vr_harness.policies.hierarchical.person_policy import PersonPolicy, seen_late_steps
from sim2vr_harness.policies.hierarchical.pointing import AIM_RAYS, apart, rays_of
from sim2vr_harness.policies.hierarchical.primitives import MEASURED
from sim2vr_harness.policies.hierarchical.tool_detection import Tool, find_tools, straight_tool
from sim2vr_harness.runs.checkpoint import read_tensors, write_tensors, write_user
from sim2vr_harness.runs.config import TrainingConfig
from sim2vr_harness.runs.run_folder import RunFolder
from sim2vr_harness.training.motor_control.goal_task import MotorStage
from sim2vr_harness.training.option_q_learning.q_learning import SETTINGS, OptionQLearning
from sim2vr_harness.training.run.stage import Callbacks, Stage

HOLDS = (1, 3, 5)
"""Candidates for the user steps from one decision to the next."""
_HOLD_S = 128.0
"""Seconds of play of all users together that compare them: 4 to 10 of each user."""
_VIGOURS, _MANNER_S = (1.0, 3.3, 11.0, 36.0), 5.0
"""Divisors of a participant's effort weight that are compared, and seconds of play per
comparison."""
_PICTURES = "pictures.bin"
_SAVE_DECISIONS, _REPORT_DECISIONS = 100, 20
_MEASURED_SHARE = 0.4
"""Proportion of the user steps in which the measured body plays, with delayed images only, before
persons do: it finds what an app rewards faster, but not what a person's hands can do."""
_COMPARED_SHARE = 0.5
"""Proportion of the user steps before plain users compare manners of their hands; persons do when
they begin to play."""
_HOPELESS = 0.35
"""Proportion of the stage after which a user should do better than the idle baseline."""
UPDATE_STEPS, PERSON_STEPS, PERSON_COMPARED = 110, 1.5, 3.5
"""Work in the progress bar, in user steps of plain users: of an update of the Q-network (of 64
decisions), of a user step of a person, and of one in which a person may decide in every step.
Processor times of `sample` and `whacamole` on one core."""


def best_hold(
    learner: OptionQLearning, steps: int, callbacks: Callbacks, show: Callable[[str], None]
) -> int:
    """Return the user steps from one decision to the next with the highest reward less effort."""
    callbacks.doing("durations of decisions")
    earned = {}
    for number, hold in enumerate(HOLDS):
        text = f"measuring {len(HOLDS)} durations of decisions, {number + 1} of {len(HOLDS)}"
        earned[hold] = learner.earned(hold, steps, on_step=partial(show, text))
    best = max(HOLDS, key=lambda hold: earned[hold])
    found = ", ".join(f"{earned[hold]:.2f} for {hold}" for hold in HOLDS)
    callbacks.say(
        f"Reward per minute, less effort, by user steps of a decision: {found}. The user's: {best}."
    )
    return best


def choose_manner(
    learner: OptionQLearning, steps: int, callbacks: Callbacks, show: Callable[[str], None]
) -> None:
    """Choose whether hands lift off before they touch, and the speed of persons, by the reward.

    People move faster if rewards come more often (Yoon et al. 2018). These steps are not used for
    learning.
    """
    callbacks.doing("manner of hands")
    policy = learner.policy
    person = policy if isinstance(policy, PersonPolicy) else None
    earned = partial(
        learner.earned,
        1 if person else SETTINGS.decide_steps,
        steps,
        on_step=partial(show, "comparing manners of hands"),
    )
    if person is not None:
        person.vigour.fill_(_VIGOURS[1])
    by_lift, by_vigour = {}, {}
    for lifts in (1.0, 0.0):
        policy.lifts.fill_(lifts)
        by_lift[lifts] = earned()
    policy.lifts.fill_(max(by_lift, key=lambda each: by_lift[each]))
    said = f"{by_lift[1.0]:.2f} if hands lift off before they touch, {by_lift[0.0]:.2f} if not"
    if person is not None:
        for vigour in _VIGOURS:
            person.vigour.fill_(vigour)
            by_vigour[vigour] = earned()
        best = best_vigour(by_vigour)
        person.vigour.fill_(best)
        found = ", ".join(f"{by_vigour[each]:.2f} for {each:g}" for each in _VIGOURS)
        said += f"; by vigour: {found}. The participants': {best:.3g}"
    callbacks.say(f"Reward per minute, less effort, losses weighted: {said}.")
    learner.begin_rounds(learner.step_count, 60)
    learner.manner_chosen = True


def best_vigour(values: Mapping[float, float]) -> float:
    """Return the vigour at the top of a parabola through values by the logarithm of vigour."""
    logs = np.log(list(values))
    bend, slope, _ = np.polyfit(logs, list(values.values()), 2)
    if bend >= 0.0:
        return max(values, key=lambda vigour: values[vigour])
    return float(np.exp(np.clip(-0.5 * slope / bend, logs.min(), logs.max())))


class QLearningStage(Stage):
    """Stage that trains option values.

    Args:
        motor: the stage of the run's own motor layer, if it has one.
        run: the run folder of the checkpoints, which are hierarchical policies.
        stop: user steps after which the session ends, at most all of the stage.
    """

    name, unit = "q_learning", "user steps"
    title = "hands try what is worth doing with what is seen."
    state_of, log_file = "the state of Q-learning", "cycles.jsonl"
    leftovers = (_PICTURES,)

    _learner: OptionQLearning
    _simulation: Simulation

    def __init__(
        self,
        config: TrainingConfig,
        folder: Path,
        motor: MotorStage | None,
        run: RunFolder,
        *,
        stop: int,
    ) -> None:
        self.stop = min(stop, config.skills.q_learning.user_steps)
        super().__init__(config, folder, self.stop)
        self._motor, self._run = motor, run

    @property
    def done(self) -> float:
        """User steps of all users."""
        return self._learner.step_count

    @property
    def finished(self) -> bool:
        """Return whether a checkpoint has at least ``stop`` user steps."""
        return bool(self._run.checkpoints()) and self._run.step >= self.stop

    def _human(self) -> HumanMotorPolicy:
        env, given = self._config.env, self._config.skills.motor
        step_s = 1.0 / env.action_frequency_hz
        if given is not None:
            return load_human_policy(Path(given), env.user, step_s)
        return human_policy_for(env.user, step_s)

    def _layer(self) -> MotorPolicy:
        """Return the motor policy of the hands; before persons play, that of the measured body."""
        env, given = with_measured_body(self._config.env), self._config.skills.motor
        given = None if self._config.skills.people else given  # a person's, then
        body, step_s = ResolvedEnv(env).body, 1.0 / env.action_frequency_hz
        if given is not None:
            return load_motor_layer(Path(given), body, step_s)
        if self._motor is not None:
            return load_motor_layer(self._motor.layer_file, body, step_s)
        return motor_layer_for(body, step_s)

    @property
    def work(self) -> float:
        """Learning, and comparisons of manners and durations, in user steps without learning."""
        each = 0 if self._people else self._hold_steps * len(HOLDS)
        if self.stop >= self._compared_steps:
            each += self._manner_steps * (2 + len(_VIGOURS) * self._people)
        return self._played(self.stop) + self._compared(each * self._users)

    def _compared(self, steps: float) -> float:
        """Return the work for a number of user steps of comparisons."""
        return (PERSON_COMPARED if self._people else 1.0) * steps

    def _played(self, steps: float) -> float:
        """Return the work for a number of user steps of learning."""
        config = self._config.skills.q_learning
        updates = SETTINGS.updates_for_persons if self._people else SETTINGS.updates
        each = updates * UPDATE_STEPS / (config.users * SETTINGS.decide_steps)
        persons = max(0.0, steps - self._measured_steps)
        return steps + each * max(0.0, steps - config.try_steps) + (PERSON_STEPS - 1.0) * persons

    @property
    def _people(self) -> bool:
        return self._config.skills.people

    @property
    def _users(self) -> int:
        return self._config.skills.q_learning.users

    @property
    def _hold_steps(self) -> int:
        """User steps of each user that compare durations of decisions: more of few users."""
        hz = self._config.env.action_frequency_hz
        return max(1, round(min(max(4.0, _HOLD_S / self._users), 10.0) * hz))

    @property
    def _manner_steps(self) -> int:
        return round(_MANNER_S * self._config.env.action_frequency_hz)

    def open(self) -> None:
        """Make the simulation."""
        config = self._config.skills
        if config.people:
            if self._config.env.user.people is None:
                raise InputError(
                    "skills.user", "'person' without env.user.people", "train --people"
                )
            self._human()
        option_set(self._config.env.user.inputs, config.options)  # refuses options without input
        require_senses(self._config.env)
        width = config.motor_training.width
        if self._motor is None:
            width = self._layer().width
        if width != config.motor_training.width:
            got = f"{config.motor_training.width}, with a motor layer of width {width}"
            expected = f"{width} for a hierarchical policy"
            raise InputError("skills.motor_training.width", got, expected)
        env = self._before_persons.env
        self._simulation = make_simulation(env, config.q_learning.users)

    def run(self, callbacks: Callbacks) -> None:
        """Find tools, learn values, and write the user."""
        simulation, seed = self._simulation, self._config.seed
        self.folder.mkdir(parents=True, exist_ok=True)
        config = self._config
        with torch_threads(1):
            policy = HierarchicalPolicy(self._before_persons)
            policy.layer.take(self._layer().weights())
            people = config.env.user.people
            if self._people and people is not None:
                step_s = 1.0 / config.env.action_frequency_hz
                policy.late_steps = seen_late_steps(people.visual_delay_s, step_s)
                policy.manner = MEASURED
            before = self._prepared(policy, callbacks)
            learner = self._learner = OptionQLearning(
                config.skills.q_learning,
                simulation,
                policy,
                self.folder / _PICTURES,
                seed=seed,
                for_persons=config.skills.people,
                loss_weight=config.skills.loss_weight,
            )
            self.resume(callbacks)
            self._learn(learner, callbacks, before)
        finished = learner.finished
        steps = learner.step_count
        file = self._run.checkpoint_file(self.stop if finished else steps)
        # A person may decide in every user step: its refractory period says how often it does.
        show = partial(self._show, callbacks)
        hold = 1 if self._people else best_hold(learner, self._hold_steps, callbacks, show)
        learner.policy.hold.fill_(hold)
        user = learner.policy
        if config.skills.people and not learner.persons:
            user = self._person(user)
            user.values = learner.net
        write_user(file, user, steps)
        if finished:
            self.tidy()

    def take(self, state: dict[str, Any]) -> None:
        """Continue from a state, with persons where they had begun to play."""
        if state["persons"]:
            self._begin_persons(self._learner)
        super().take(state)

    def learned(self, state: Mapping[str, Any]) -> dict[str, Any]:
        """Return the parts of the state that must be finite."""
        return {"values": state["net"], "optimizer": state["learner"]["optimizer"]}

    def _begin_persons(self, learner: OptionQLearning) -> None:
        """Let virtual participants replace the measured body, and learn from their decisions."""
        measured, config = self._simulation, self._config
        self._simulation = make_simulation(config.env, config.skills.q_learning.users)
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
        """Return the configuration of the first users: the users as set, or the measured body."""
        return self._config.model_copy(update={"env": with_measured_body(self._config.env)})

    def _prepared(self, policy: HierarchicalPolicy, callbacks: Callbacks) -> dict[str, float]:
        """Find tools and rays of the hands; return baseline rewards per minute, less effort."""
        file, layer = self.folder / "before.pt", policy.layer
        known = read_tensors(file, "what was found before trying") if file.is_file() else {}
        if "rays" in known:
            policy.tool.copy_(known["tool"])
            policy.rays.copy_(known["rays"])
            return {name: float(v) for name, v in known["earned"].items()}
        callbacks.doing("tools and baselines")
        callbacks.say("Finding tools and measuring baselines ...")
        rays, wanted = AIM_RAYS.repeat(len(layer.hands), 1, 1), self._config.skills.tool
        with in_this_process(self._simulation) as seen:
            if any(name.endswith(".trigger") for name in self._config.env.user.inputs):
                rays = rays_of(seen, layer.hands)
            if off := apart(rays):
                callbacks.say(f"Hands point with the page's own ray, {off} from WebXR's.")
            if wanted == "auto":
                tools = find_tools(seen, layer, policy.poses, seed=self._config.seed, rays=rays)
            elif wanted == "none":
                tools = [
                    Tool(np.zeros((0, 3)), "nothing, as skills.tool says") for _ in layer.hands
                ]
            else:
                tools = [straight_tool(wanted) for _ in layer.hands]
        points = np.array([[tool.tip, tool.middle] for tool in tools])
        for hand, held in zip(layer.hands, tools, strict=True):
            callbacks.say(f"In the hand of {hand}: {held.why}.")
        idle, random = (
            baseline_reward(self._simulation, user, self._config.seed)
            for user in ("still", "random")
        )
        earned = {"still": idle[0] - idle[1], "random": random[0] - random[1]}
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
        return earned

    def _show(self, callbacks: Callbacks, doing: str) -> None:
        learner = self._learner
        done = self._played(learner.step_count) + self._compared(learner.compared)
        callbacks.show(lambda: View(done, doing))

    def _learn(
        self,
        learner: OptionQLearning,
        callbacks: Callbacks,
        before: Mapping[str, float],
    ) -> None:
        began, first, decisions = time.monotonic(), learner.step_count, 0
        doing, warned = "trying at random", False
        while learner.step_count < self.stop:
            if learner.step_count >= self._measured_steps and not learner.persons:
                callbacks.say("Virtual participants play from now on, with what has been learned.")
                self._begin_persons(learner)
            if learner.step_count >= self._compared_steps and not learner.manner_chosen:
                choose_manner(
                    learner, self._manner_steps, callbacks, partial(self._show, callbacks)
                )
            report = learner.step(callbacks.doing)
            decisions += 1
            done = learner.step_count
            self._show(callbacks, doing)
            if decisions % _REPORT_DECISIONS == 0 or done >= self.stop:
                rate = (done - first) / (time.monotonic() - began)
                doing = (
                    f"step {done:,}, reward per minute {report.reward:.2f} (still "
                    f"{before['still']:.2f}, random {before['random']:.2f}), "
                    f"{100 * report.explore:.0f} % exploratory ({rate:,.0f} steps/s)"
                )
                row = asdict(report) | {"step": done}
                row["loss"] = None if math.isnan(report.loss) else report.loss
                self.log(callbacks, row)
            if decisions % _SAVE_DECISIONS == 0 or done >= self.stop:
                self.remember()
                self.save()
            if not warned and done > _HOPELESS * self.total:
                warned = True
                best = max(before.values())
                if report.reward <= best + 0.05 * abs(best):
                    rewarded, within = learner.diagnosis()
                    callbacks.say(
                        f"Nothing is being learned yet: {report.reward:.2f} per minute, {best:.2f} "
                        f"without learning. {100 * rewarded:.1f} % of the decisions were rewarded "
                        f"and {100 * within:.0f} % of what is seen near is within reach. Check "
                        "where the app puts things (sim2vr-harness render snapshot, reach), that "
                        "they are seen against their background, and what the reward is for."
                    )
        callbacks.say("Q-learning: " + doing)

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
