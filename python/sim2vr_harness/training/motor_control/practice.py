"""Practice of a motor layer: bodies move, a model is fitted, the layer learns by its gradients."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from sim2vr_harness.policies.hierarchical.goal_sampler import GoalSampler
from sim2vr_harness.policies.hierarchical.motor_policy import MotorPolicy
from sim2vr_harness.policies.hierarchical.workspace import INSIDE, reachable_poses
from sim2vr_harness.runs.option_config import MotorTrainingConfig
from sim2vr_harness.users import Body, UserBatch
from sim2vr_harness.users.noise import MotorNoiseSettings
from sim2vr_harness.world_models.body_dynamics import BodyModel, fit_body
from sim2vr_harness.world_models.effort import Effort
from sim2vr_harness.world_models.rollout_env import ImaginedUsers
from sim2vr_harness.world_models.transitions import KEPT_CYCLES, TransitionStore
from sim2vr_harness.world_models.value_function import ValueFunction

__all__ = ["PRACTICE", "MotorTraining", "MotorTrainingCycle"]

PRACTICE = "the state of a motor layer's practice"
"""What a file of :meth:`MotorTraining.state` is called in errors."""

STATE_FORMAT = 2
_WILD_SIZE = (0.05, 0.7)
_WILD_KEEP = (0.0, 0.6, 0.9)
_RETURN = 0.3
_EPISODE_STEPS = 60
_WILD_STEPS = 20
_BEYOND = 0.01
_GAMMA = 0.95
"""Discount factor per user step: goals are reached within about 20 user steps."""
_LEARNING_RATE = 1.5e-3
"""The layer is small, and learns from exact gradients."""
_CRITIC_LEARNING_RATE, _LAMBDA = 1e-3, 0.9
_ACTION_NOISE = 0.06
"""Standard deviation on the actions, true and imagined: policies above the layer are not exact."""
_ERROR_SHARE = 0.3
"""Noise on the imagined motion, in units of the body model's error, so that its errors do not
count as knowledge."""
_RESTART_SHARE = 0.15
"""Proportion of imagined users who continue from a state of a simulated body after a window:
imagined states drift away from true ones."""
_EFFORT = 0.3
"""Cost of the mean square of the drives per user step; arriving well is worth about 10."""
_ACTUATOR_RANGE_COST = 0.1
"""Cost of actuator targets beyond their ranges, where they have no effect and no gradient."""


@dataclass(frozen=True)
class MotorTrainingCycle:
    """What a cycle was like; medians, over the simulated bodies in MuJoCo.

    In the first one bodies move at random: nothing is asked of their hands, and errors are 0.

    Attributes:
        cycle: its number, from 1.
        place_m: how far from their goals tips were at the time of arrival.
        speed_mps: how far their velocities were from those asked for then.
        follow_m: how far from the paths that they were to follow.
        model_m: error of the body model: of the hands' places after a user step, mean.
    """

    cycle: int
    place_m: float
    speed_mps: float
    follow_m: float
    model_m: float

    def in_words(self, cycles: int) -> str:
        """One line, for people, of a cycle among so many."""
        if self.cycle == 1:
            return (
                f"Cycle 1/{cycles}: moved at random, to learn what muscles and motors do "
                f"(it foretells hands to {1000 * self.model_m:.0f} mm a step)"
            )
        return (
            f"Cycle {self.cycle}/{cycles}: arrives {1000 * self.place_m:.0f} mm from its goals and "
            f"{self.speed_mps:.2f} m/s from the speeds asked for, follows "
            f"{1000 * self.follow_m:.0f} mm beside its paths (medians)"
        )


class MotorTraining:
    """Teaches a body's hands to come where they are told.

    Args:
        config: of the practice.
        body: whose hands.
        step_s: duration of a user step.
        noise: motor noise of the muscles, imagined and simulated; None: none.
        threads: of the physics.
        seed: of everything drawn here.
        begin: a layer of this body to go on from, of the same width; None: a new one. What is
            known of the body is learned anew.
    """

    def __init__(
        self,
        config: MotorTrainingConfig,
        body: Body,
        step_s: float,
        *,
        noise: MotorNoiseSettings | None = None,
        threads: int = 0,
        seed: int = 1,
        begin: MotorPolicy | None = None,
    ) -> None:
        self.config, self._user, self._step_s = config, body, step_s
        self._begun = begin is not None
        substeps = round(step_s / body.timestep)
        self.bodies = UserBatch(
            body, config.bodies, threads=threads, effort="zero", noise=noise, substeps=substeps
        )
        self.rng = np.random.default_rng([seed, 31])
        self.cycle = self.updates = 0
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self._make(body, noise, seed)
            if begin is not None:
                self.layer.take(begin.weights())
            self._torch_state = torch.get_rng_state()

    def _make(self, body: Body, noise: MotorNoiseSettings | None, seed: int) -> None:
        config, step_s = self.config, self._step_s
        self.layer = MotorPolicy(body, step_s, width=config.width)
        self.model = BodyModel(body, self.layer.hands, step_s, width=config.body_width)
        self.users = ImaginedUsers(
            body,
            self.model,
            config.users,
            effort=self._effort(),
            noise=noise,
            actuator_range_cost=_ACTUATOR_RANGE_COST,
        )
        poses = reachable_poses(self.layer, seed)
        strikes = config.strikes
        self.exercises = GoalSampler(poses, config.users, step_s, seed + 5, strikes=strikes)
        self._played = GoalSampler(poses, config.bodies, step_s, seed + 6, strikes=strikes)
        """Goals of the simulated bodies."""
        self._critic = ValueFunction(
            self.layer.size,
            config.width,
            self.layer.normalised,
            learning_rate=_CRITIC_LEARNING_RATE,
            gamma=_GAMMA,
            lam=_LAMBDA,
        )
        self._optimizer = torch.optim.Adam(
            self.layer.net.parameters(), lr=_LEARNING_RATE, betas=(0.8, 0.97)
        )
        self._seen: list[TransitionStore] = []
        self._pool: TransitionStore | None = None
        self._age = np.zeros(config.bodies, dtype=np.int64)

    def _effort(self) -> Effort:
        muscles = torch.from_numpy(self.layer.drives.muscles)

        def activations(after: Tensor, control: Tensor) -> Tensor:
            return _EFFORT * after[:, muscles].square().mean(1)

        def nothing(after: Tensor, control: Tensor) -> Tensor:
            return torch.zeros(len(after))

        return activations if len(muscles) else nothing

    def _postures(self, count: int) -> NDArray[np.float64]:
        """(K, J) anything that the joints can do."""
        low, high = self._user.joint_ranges.T
        middle, half = 0.5 * (low + high), 0.5 * INSIDE * (high - low)
        return middle + half * self.rng.uniform(-1.0, 1.0, (count, len(low)))

    @property
    def finished(self) -> bool:
        """Whether all cycles are done."""
        return self.cycle >= self.config.cycles

    # --- a cycle -----------------------------------------------------------------------------

    def step(
        self, on_progress: Callable[[str, float], None] = lambda doing, share: None
    ) -> MotorTrainingCycle:
        """Let bodies move, fit the model, and learn from imagined rollouts."""
        with torch.random.fork_rng(devices=[]):
            torch.set_rng_state(self._torch_state)
            report = self._cycle(on_progress)
            self._torch_state = torch.get_rng_state()
        return report

    def _cycle(self, on_progress: Callable[[str, float], None]) -> MotorTrainingCycle:
        config, first = self.config, self.cycle == 0
        self._played.clear()
        steps = config.first_play_steps if first else config.play_steps
        self._seen.append(self._play(steps, wildly=first, on_progress=on_progress))
        if len(self._seen) > 1 + KEPT_CYCLES:
            del self._seen[1]
        if first:
            self.model.scale_by(self._seen[0])
            self.users.rest_as(self._seen[0].before.drives)
        fit = fit_body(
            self.model,
            self._to_learn(),
            minibatches=config.first_fit_minibatches if first else config.fit_minibatches,
            learning_rate=4e-3 if first else 1.5e-3,
            on_progress=lambda share: on_progress("fitting the body model", 0.2 + 0.2 * share),
        )
        recent = TransitionStore.joined(self._seen[1:][-8:] or self._seen[:1])
        early = self._seen[0].rows(torch.randint(len(self._seen[0]), (len(recent) // 3,)))
        self._pool = TransitionStore.joined([recent, early])
        if first and not self._begun:
            self._fit_statistics()
        for update in range(config.updates):
            on_progress("imagined rollouts", 0.4 + 0.6 * update / config.updates)
            self._update()
        self.cycle += 1
        measured = self._played.measured()
        return MotorTrainingCycle(self.cycle, **measured, model_m=fit["place_m"])

    def _play(
        self, steps: int, *, wildly: bool, on_progress: Callable[[str, float], None]
    ) -> TransitionStore:
        bodies, layer, config = self.bodies, self.layer, self.config
        n = config.bodies
        self._begin(np.arange(n))
        wild = np.zeros((n, layer.drives.count))
        rest = layer.drives.rest(layer.drives.of(bodies))
        keep = self.rng.choice(_WILD_KEEP, (n, 1))
        size = self.rng.uniform(*_WILD_SIZE, (n, 1))
        rows: list[list[Tensor]] = []
        most = _WILD_STEPS if wildly else _EPISODE_STEPS
        self._age[:] = self.rng.integers(0, most, n)
        for step in range(steps):
            on_progress("moving", 0.2 * step / steps)
            before = layer.motion(bodies)
            if wildly:
                wild = keep * wild + np.sqrt(1.0 - keep**2) * self.rng.standard_normal(wild.shape)
                actions = size * wild + _RETURN * (rest - before[2].numpy())
            else:
                actions = layer.act(bodies, self._played.goals)
                actions = actions + _ACTION_NOISE * self.rng.standard_normal(actions.shape)
            bodies.step(np.clip(actions, -1.0, 1.0))
            after = layer.motion(bodies)
            control = torch.from_numpy(layer.drives.controls(bodies)).float()
            fine = torch.from_numpy(~bodies.diverged)
            nothing = torch.zeros(n, 0)
            rows.append([part[fine] for part in (*before, control, *after, nothing, nothing)])
            if not wildly:
                with torch.no_grad():
                    self._played.step(*layer.places(after[0], after[1]))
            self._age += 1
            over = np.flatnonzero((self._age >= most) | bodies.diverged)
            if len(over):
                self._begin(over)
                rest[over] = layer.drives.rest(layer.drives.of(bodies))[over]
        return TransitionStore.of([torch.cat(column) for column in zip(*rows, strict=True)])

    def _begin(self, ids: NDArray[np.int64]) -> None:
        """Start bodies anew, in any posture."""
        postures = self._postures(len(ids))
        seeds = self.rng.integers(2**31, size=len(ids))
        self.bodies.reset(ids, [np.random.default_rng(s) for s in seeds], list(postures))
        self._age[ids] = 0
        rows = torch.from_numpy(ids)
        with torch.no_grad():
            angles, speeds, _ = self.layer.motion(self.bodies)
            self._played.start(rows, self.layer.places(angles[rows], speeds[rows])[0])

    def _to_learn(self) -> TransitionStore:
        first, later = self._seen[0], self._seen[1:]
        if not later:
            return first
        count = self.config.fit_minibatches * 300
        parts = (first, TransitionStore.joined(later), TransitionStore.joined(later[-3:]))
        return TransitionStore.joined([p.rows(torch.randint(len(p), (count,))) for p in parts])

    # --- learning ----------------------------------------------------------------------------

    def _observe(self) -> Tensor:
        motion = self.users.motion
        place, soon = self.layer.places(motion.angles, motion.speeds)
        told = self.exercises.observe(place, soon)
        return self.layer.observe(motion.angles, motion.speeds, motion.drives, told)

    def _restart(self, ids: Tensor) -> None:
        assert self._pool is not None
        begin = self._pool.rows(torch.randint(len(self._pool), (len(ids),)))
        self.users.start(ids, begin.after)
        with torch.no_grad():
            place, _ = self.layer.places(begin.after.angles, begin.after.speeds)
        self.exercises.start(ids, place)

    def _fit_statistics(self) -> None:
        seen = []
        with torch.no_grad():
            for _ in range(8):
                self._restart(torch.arange(self.config.users))
                seen.append(self._observe())
            values = torch.cat(seen)
            self.layer.mean.copy_(values.mean(0))
            self.layer.std.copy_(values.std(0).clamp(min=0.05))

    def _update(self) -> None:
        config = self.config
        done = self.updates / (config.updates * config.cycles)
        for group in self._optimizer.param_groups:
            group["lr"] = _LEARNING_RATE * min(1.0, 2.0 * (1.0 - done)) + 2e-5
        self.users.cut()
        observation = self._observe()
        seen, rewards, total = [observation.detach()], [], torch.zeros(())
        for t in range(config.window_steps):
            mean = self.layer(observation)
            actions = mean + _ACTION_NOISE * torch.randn_like(mean)
            self.users.step(actions, error_share=_ERROR_SHARE)
            motion = self.users.motion
            reward = self.exercises.step(*self.layer.places(motion.angles, motion.speeds))
            effort, beyond, wild = self.users.costs()
            reward = reward - effort - beyond - wild
            reward = reward - _BEYOND * torch.relu(mean.abs() - 1.0).square().sum(1)
            observation = self._observe()
            rewards.append(reward)
            seen.append(observation.detach())
            total = total + _GAMMA**t * reward
        total = total + _GAMMA**config.window_steps * self._critic(observation)
        self._optimizer.zero_grad()
        (-total.mean() / config.window_steps).backward()  # type: ignore[no-untyped-call]
        norm = nn.utils.clip_grad_norm_(self.layer.net.parameters(), 1.0)
        if torch.isfinite(norm) and self.updates >= 20:
            self._optimizer.step()
        self._critic.learn(torch.stack(seen), torch.stack(rewards).detach())
        self.users.cut()
        again = (torch.rand(self.users.n) < _RESTART_SHARE) | self.users.broken()
        self._restart(torch.nonzero(again).flatten())
        self.updates += 1

    # --- exact resume ------------------------------------------------------------------------

    def state(self) -> dict[str, Any]:
        """Everything that the next cycle depends on; it shares weights: write it before that."""
        header = {
            "format": STATE_FORMAT,
            "cycle": self.cycle,
            "updates": self.updates,
            "rng": self.rng.bit_generator.state,
        }
        return {
            "header": json.dumps(header),
            "layer": self.layer.state_dict(),
            "model": self.model.state_dict(),
            "critic": self._critic.state(),
            "optimizer": self._optimizer.state_dict(),
            "torch": self._torch_state,
            "users": self.users.state(),
            "rest": self.users.rest,
            "exercises": self.exercises.state(),
            "played": self._played.state(),
            "seen": [part.tensors() for part in self._seen],
        }

    def load_state(self, state: dict[str, Any]) -> None:
        """Go on from :meth:`state`; the simulated bodies begin every cycle anew.

        Raises:
            ValueError: it is of another format.
        """
        header = json.loads(state["header"])
        if header["format"] != STATE_FORMAT:
            raise ValueError(f"got format {header['format']}, expected {STATE_FORMAT}")
        self.cycle, self.updates = header["cycle"], header["updates"]
        self.rng.bit_generator.state = header["rng"]
        self.layer.load_state_dict(state["layer"])
        self.model.load_state_dict(state["model"])
        self._critic.load_state(state["critic"])
        for parameter in self.model.parameters():
            parameter.requires_grad_(False)
        self._optimizer.load_state_dict(state["optimizer"])
        self._torch_state = state["torch"]
        self.users.load_state(state["users"])
        self.users.rest = state["rest"]
        self.exercises.load_state(state["exercises"])
        self._played.load_state(state["played"])
        self._seen = [TransitionStore.of(tensors) for tensors in state["seen"]]
