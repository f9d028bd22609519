"""The training of a human motor policy: movements that the policy itself ends."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from sim2vr_harness.envs.config import UserConfig, body_of, motor_noise, people_of
from sim2vr_harness.policies.hierarchical.human_goals import GoalPerception, describe_human
from sim2vr_harness.policies.hierarchical.human_motor import (
    HumanHands,
    HumanMotorPolicy,
    people_policy,
)
from sim2vr_harness.policies.hierarchical.motor_policy import MotorPolicy
from sim2vr_harness.policies.hierarchical.workspace import INSIDE
from sim2vr_harness.runs.option_config import PeopleTrainingConfig
from sim2vr_harness.runs.teacher_config import ImaginedConfig
from sim2vr_harness.training.model_based.task import Task
from sim2vr_harness.training.model_based.trainer import ModelBasedTrainer, value_function
from sim2vr_harness.training.motor_control.human_sampler import HumanGoalSampler
from sim2vr_harness.users import Physique, UserBatch
from sim2vr_harness.world_models.effort import Effort, volume_shares
from sim2vr_harness.world_models.rollout_env import ImaginedUsers
from sim2vr_harness.world_models.transitions import Motion, TransitionStore

__all__ = ["Bodies", "HumanMotorTask", "HumanMotorTrainer", "human_trainer"]

_EPISODE_STEPS, _RANDOM_EPISODE_STEPS = 60, 20
FIRST_PLAY_STEPS = 400
"""User steps of each person in the first cycle, at random."""


class _Cycles(ImaginedConfig):
    fit_minibatches: ClassVar[int] = 150
    updates: ClassVar[int] = 100
    critic_first_updates: ClassVar[int] = 30


def _settings(config: PeopleTrainingConfig) -> ImaginedConfig:
    return _Cycles(
        cycles=config.cycles,
        first_play_steps=FIRST_PLAY_STEPS,
        body_width=config.body_width,
        users=config.users,
        window_steps=16,
        critic_width=config.width,
        gamma=0.98,
        learning_rate=5e-4,
        action_noise=0.03,
        restart_share=0.1,
        actuator_range_cost=0.1,
        average_updates=60,
    )


class Bodies:
    """Simulated persons, as :class:`ImaginedPersons` reads them.

    Args:
        user: configuration with people.
        n: number of them.
        step_s: duration of a user step.
        threads: of the physics.
    """

    def __init__(self, user: UserConfig, n: int, step_s: float, threads: int) -> None:
        self._user, self.n = user, n
        people = people_of(user)
        assert people is not None
        self.people = people
        self.body = body_of(user)
        self.users = UserBatch(
            self.body,
            n,
            threads=threads,
            effort="zero",
            noise=motor_noise(user.noise),
            substeps=round(step_s / self.body.timestep),
            people=people,
            cut=self.body_for,
        )

    def body_for(self, physique: Physique) -> Any:
        """Return the body of a physique."""
        return body_of(self._user.model_copy(update={"person": physique}))

    def reset(self, ids: NDArray[np.int64], rng: np.random.Generator) -> None:
        """Let users be other persons, in any posture."""
        low, high = self.body.joint_ranges.T
        middle, half = 0.5 * (low + high), 0.5 * INSIDE * (high - low)
        postures = middle + half * rng.uniform(-1.0, 1.0, (len(ids), len(low)))
        seeds = rng.integers(2**31, size=len(ids))
        persons = [self.people.of_episode(int(seed)) for seed in seeds]
        rngs = [np.random.default_rng(seed) for seed in seeds]
        self.users.reset(ids, rngs, list(postures), persons)


@dataclass(frozen=True)
class HumanMotorCycle:
    """What a cycle was like, over the movements of simulated persons.

    Attributes:
        cycle: its number, from 1.
        success_rate: proportion of movements that ended as their goals say.
        time_s: median duration of movements.
        distance_m: median distance from the goals at their ends.
        model_m: error of the forward model: of the hands' places after a user step, mean.
    """

    cycle: int
    success_rate: float
    time_s: float
    distance_m: float
    model_m: float

    def in_words(self, cycles: int) -> str:
        """Return one line, for people, of a cycle among so many."""
        return (
            f"Cycle {self.cycle}/{cycles}: {self.success_rate:.2f} of the movements succeed, "
            f"median {self.time_s:.2f} s, {1000 * self.distance_m:.0f} mm from the goals; forward "
            f"model error {1000 * self.model_m:.1f} mm a step"
        )


class HumanMotorTask(Task):
    """Persons' hands that pursue goals and decide when they have reached them.

    Args:
        config: of the training.
        user: configuration with people.
        step_s: duration of a user step.
        threads: of the physics.
        seed: of everything drawn here, but for the networks.
        begin: a plain motor policy of the body to continue from; None: a new one.
    """

    policy: HumanMotorPolicy
    recent_per_early, random_size = 3, (0.05, 0.7)

    def __init__(
        self,
        config: PeopleTrainingConfig,
        user: UserConfig,
        step_s: float,
        *,
        threads: int,
        seed: int,
        begin: MotorPolicy | None,
    ) -> None:
        self.config = config
        self.rng = np.random.default_rng([seed, 31])
        self._bodies = Bodies(user, config.bodies, step_s, threads)
        self.batch, body = self._bodies.users, self._bodies.body
        self.policy = people_policy(
            user,
            step_s,
            width=config.width,
            body_width=config.body_width,
            perception=config.perception,
        )
        self._who = self.policy.persons
        self.starts, self._begun = 8, begin is not None
        if begin is not None:
            self.policy.begin_with(begin)
        self.actor = list(self.policy.net.parameters())
        self.body = self.policy.forward_model
        settings = _settings(config)
        self.users = ImaginedUsers(
            body,
            self.body,
            config.users,
            effort=self._effort(),
            noise=motor_noise(user.noise),
            persons=self._who,
            actuator_range_cost=settings.actuator_range_cost,
            action_rate_cost=config.action_rate_cost,
        )
        self.goals = HumanGoalSampler(self.policy, config.users, seed + 5, config)
        self._played = HumanGoalSampler(self.policy, config.bodies, seed + 6, config)
        self._seen = self.policy.perception(config.users)
        self._hands = self._new_hands(seed)
        self.parts = (self.goals,)
        self._believed: Motion | None = None
        self._placed: tuple[Motion, tuple[Tensor, Tensor]] | None = None
        self.alive = torch.ones(config.users, self.goals.hands)
        """(B, H) probability that a movement has not ended yet in this window."""
        self.ended: list[Tensor] = []
        self._age = np.zeros(config.bodies, dtype=np.int64)
        self._random = False
        self._known: list[tuple[float, float, float]] = []

    def _new_hands(self, seed: int) -> HumanHands:
        drawn = torch.Generator().manual_seed(seed + 7)
        self._judged = self.policy.perception(self.config.bodies, drawn)
        return HumanHands(self.policy, self.config.bodies, self._judged)

    def _effort(self) -> Effort:
        muscles, weight = self.policy.drives.muscle_columns, self.config.effort_cost
        shares = volume_shares(self.policy.body)

        def activations(after: Tensor, control: Tensor) -> Tensor:
            return weight * (shares * after[:, muscles].square()).mean(1)

        return activations

    # --- simulated persons -------------------------------------------------------------------

    def begin_collecting(self, *, randomly: bool) -> None:
        """See :class:`Task`."""
        self._random = randomly
        self._known = []
        self.restart(np.arange(self.batch.n))

    @property
    def _longest(self) -> int:
        return _RANDOM_EPISODE_STEPS if self._random else _EPISODE_STEPS

    def stagger(self) -> None:
        """See :class:`Task`."""
        self._age[:] = self.rng.integers(0, self._longest, self.batch.n)

    def _now(self) -> Motion:
        return self._hands.motion(self.batch, self._who.of(self._bodies))  # type: ignore[arg-type]

    def policy_actions(self) -> NDArray[Any]:
        """See :class:`Task`."""
        actions, over = self._hands.act(self._now(), self._played.goals)
        drawn = torch.from_numpy(self.rng.random(tuple(over.shape)))
        self._over = drawn < over
        return actions

    def simulate(
        self, actions: NDArray[Any]
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray[Any], NDArray[Any]]:
        """See :class:`Task`."""
        self.batch.step(np.clip(actions, -1.0, 1.0))
        now = self._now()
        if not self._random:
            with torch.no_grad():
                placed = self.policy.places(now)
                self._played.step(*placed)
                self._note(*placed)
                over = self._over & self._played.pursued
                users = self._played.go_on(over, now.angles, now.persons)
                far = self._played.distance(placed[0])
                self._judged.forget(users, far[users])
        self._age += 1
        diverged, none = self.batch.diverged, np.zeros((self.batch.n, 0))
        over_now = (self._age >= self._longest) | diverged
        return ~diverged, over_now, now.persons.numpy(), none

    def _note(self, place: Tensor, soon: Tensor) -> None:
        played = self._played
        late = played.pursued & (played._clock_s > played._until_s - 0.5 * self.policy.step_s)
        ended = (self._over & played.pursued) | late
        succeeds, off, _ = played.success(place, soon)
        for i, hand in torch.nonzero(ended).tolist():
            row = (succeeds[i, hand], played._clock_s[i, hand], off[i, hand])
            self._known.append(tuple(float(value) for value in row))  # type: ignore[arg-type]

    def restart(self, ids: NDArray[np.int64]) -> None:
        """See :class:`Task`."""
        self._bodies.reset(ids, self.rng)
        self._age[ids] = 0
        self._hands.forget(ids)
        now, rows = self._now(), torch.from_numpy(ids)
        self._begin(self._played, self._judged, rows, now.rows(rows))

    def _begin(
        self, goals: HumanGoalSampler, seen: GoalPerception, ids: Tensor, motion: Motion
    ) -> None:
        hands = goals.hands
        users = ids.repeat_interleave(hands)
        which = torch.arange(hands).repeat(len(ids))
        repeated = motion.rows(torch.arange(len(ids)).repeat_interleave(hands))
        goals.draw(users, which, repeated.angles, repeated.persons)
        with torch.no_grad():
            place, _ = self.policy.places(motion)
        now = place[..., :3, 3] + (place[..., :3, :3] @ goals.goals.tip[ids][..., None])[..., 0]
        seen.forget(ids, (goals.goals.place[ids] - now).norm(dim=-1))

    # --- a cycle -----------------------------------------------------------------------------

    def report(
        self, cycle: int, updates: int, success_rates: tuple[float, ...], place_error_m: float
    ) -> HumanMotorCycle:
        """See :class:`Task`."""
        known = np.array(self._known or [(0.0, 0.0, 0.0)])
        return HumanMotorCycle(
            cycle,
            float((known[:, 0] > 0.5).mean()),
            float(np.median(known[:, 1])),
            float(np.median(known[:, 2])),
            place_error_m,
        )

    # --- imagined users ----------------------------------------------------------------------

    def start(self, ids: Tensor, pool: TransitionStore, rows: Tensor) -> None:
        """See :class:`Task`."""
        begin = pool.rows(rows)
        self.users.start(ids, begin.after)
        self.alive = self.alive.detach().clone()
        self.alive[ids] = 1.0
        self._begin(self.goals, self._seen, ids, begin.after)
        if self._believed is not None:
            believed = self._believed.detach()
            for name in ("angles", "speeds", "drives", "persons"):
                getattr(believed, name)[ids] = getattr(begin.after, name)
            self._believed = believed
        self._placed = None

    def _places(self) -> tuple[Tensor, Tensor]:
        """(B, H, 4, 4) each: where devices are, and a moment later; once per motion."""
        now = self.users.motion
        if self._placed is None or self._placed[0] is not now:
            self._placed = (now, self.policy.places(now))
        return self._placed[1]

    def observe(self) -> Tensor:
        """See :class:`Task`: of the present as believed, and of goals where they seem to be.

        Gradients are those of the present itself: beliefs differ from it by noise alone.
        """
        now, believed, placed = self.users.motion, self.users.motion, self._places()
        if self._believed is not None:
            with torch.no_grad():
                seemed = self.policy.places(self._believed)
            placed = (_as(placed[0], seemed[0]), _as(placed[1], seemed[1]))
            seen = self._believed
            believed = Motion(
                _as(now.angles, seen.angles),
                _as(now.speeds, seen.speeds),
                _as(now.drives, seen.drives),
                now.persons,
            )
        goals = replace(self.goals.goals, place=self.goals.goals.place + self._seen.error())
        return self.policy.observe(believed, describe_human(goals, *placed))

    def present(self) -> Tensor:
        """See :class:`Task`."""
        told = describe_human(self.goals.goals, *self._places())
        return self.policy.observe(self.users.motion, told)

    def normalise(self, observations: Tensor) -> None:
        """See :class:`Task`; a policy that goes on keeps its own."""
        if self._begun:
            return
        self.policy.mean.copy_(observations.mean(0))
        self.policy.std.copy_(observations.std(0).clamp(min=0.05))

    def action_mean(self, observation: Tensor) -> Tensor:
        """See :class:`Task`; the logits of movements that are over are kept for :meth:`step`."""
        out = self.policy(observation)
        actions, logits = out.split([self.policy.drives.count, self.goals.hands], 1)
        self._hazard = torch.sigmoid(logits) * self.goals.pursued.float()
        return actions

    def before_step(self, actions: Tensor) -> None:
        """Keep what the forward model predicts of the user step that begins."""
        now = self.users.motion.detach()
        with torch.no_grad():
            self._believed = self.policy.predicted(now, actions.detach().clamp(-1.0, 1.0))

    def step(self, actions: Tensor, done: float) -> Tensor:
        """See :class:`Task`: the reward expected, given what has ended already."""
        placed = self._places()
        runs, ends = self.goals.step(*placed)
        each = runs + self._hazard * ends
        reward = (self.alive * each).sum(1)
        self.beside = (each.sum(1) - reward).detach()
        self.alive = self.alive * (1.0 - self._hazard)
        self.ended.append(self._hazard.detach().amax(1))
        with torch.no_grad():
            self._seen.look(self.goals.distance(placed[0]))
        return reward

    def cut(self) -> None:
        """See :class:`Task`: movements that ended in the window are followed by others."""
        self._placed = None
        with torch.no_grad():
            drawn = torch.rand_like(self.alive)
            over = drawn > self.alive.detach()
            motion = self.users.motion
            users = self.goals.go_on(over, motion.angles, motion.persons)
            place, _ = self._places()
            self._seen.forget(users, self.goals.distance(place)[users])
        self.alive, self.ended = torch.ones_like(self.alive), []
        if self._believed is not None:
            self._believed = self._believed.detach()

    # --- exact resume ------------------------------------------------------------------------

    def state_dict(self) -> dict[str, Any]:
        """See :class:`Task`; the simulated persons begin every cycle anew."""
        believed = self._believed
        return {
            "goals": self.goals.state_dict(),
            "played": self._played.state_dict(),
            "perceived": self._seen.state_dict(),
            "judged": self._judged.state_dict(),
            "believed": {} if believed is None else dict(vars(believed)),
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """See :class:`Task`."""
        self.goals.load_state_dict(state["goals"])
        self._played.load_state_dict(state["played"])
        self._seen.load_state_dict(state["perceived"])
        self._judged.load_state_dict(state["judged"])
        believed = {name: value.clone() for name, value in state["believed"].items()}
        self._believed = Motion(**believed) if believed else None
        self._placed = None


def _as(now: Tensor, believed: Tensor) -> Tensor:
    """Return what is believed, with the gradients of what is."""
    return now + (believed - now).detach()


class HumanMotorTrainer(ModelBasedTrainer[HumanMotorTask]):
    """Model-based training in which an episode ends where the policy says so."""

    def _roll_window(self, done: float) -> tuple[Tensor, Tensor, Tensor]:
        config, task = self.config, self.task
        seen, rewards, total = [task.present().detach()], [], torch.zeros(())
        for t in range(config.window_steps):
            mean, actions = self._act()
            task.before_step(actions)
            reward = self.advance(actions, done)
            reward = reward - 0.01 * torch.relu(mean.abs() - 1.0).square().sum(1)
            rewards.append(reward + task.beside)
            present = task.present()
            seen.append(present)
            total = total + config.gamma**t * reward
        last = self._critic(seen[-1])
        total = total + config.gamma**config.window_steps * task.alive.amin(1) * last
        self._critic.goes_on = 1.0 - torch.stack(task.ended)
        return total, torch.stack(seen), torch.stack(rewards)


def human_trainer(
    config: PeopleTrainingConfig,
    user: UserConfig,
    step_s: float,
    *,
    threads: int = 0,
    seed: int = 1,
    begin: MotorPolicy | None = None,
) -> HumanMotorTrainer:
    """Return the training of a body's human motor policy."""
    settings = _settings(config)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        task = HumanMotorTask(config, user, step_s, threads=threads, seed=seed, begin=begin)
        policy = task.policy
        critic = value_function(policy.size, config.width, policy.normalised, settings.gamma)
        return HumanMotorTrainer(task, settings, critic)
