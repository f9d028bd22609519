"""Cycles of collecting user steps, fitting the body model, and learning from imagined rollouts."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Generic, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from sim2vr_harness.base.state import State
from sim2vr_harness.base.torch_threads import FastestThreads, torch_threads
from sim2vr_harness.runs.teacher_config import ImaginedConfig
from sim2vr_harness.users import UserBatch
from sim2vr_harness.world_models.body_dynamics import BodyModel, fit_body
from sim2vr_harness.world_models.gradient_clipping import limited
from sim2vr_harness.world_models.learning_device import LearningDevice, Part
from sim2vr_harness.world_models.rollout_env import ImaginedUsers
from sim2vr_harness.world_models.transitions import KEPT_CYCLES, TransitionStore
from sim2vr_harness.world_models.value_function import ValueFunction
from sim2vr_harness.world_models.weight_average import WeightAverage


class Task(State, ABC):
    """A training task: success in a game model's rounds, or reaching goals with the hands.

    The body model is fitted to user steps of N simulated users in MuJoCo. The policy is trained
    with B imagined users. Observations are (B, size), actions (B, A).
    """

    policy: nn.Module
    """The policy that is trained."""
    actor: Sequence[nn.Parameter]
    """The policy's weights that gradients move."""
    body: BodyModel
    users: ImaginedUsers
    parts: Sequence[Part]
    """Further objects whose state imagined user steps change."""
    starts: int
    """Starts of all imagined users before the first update; 0: they continue from the rest pose,
    and the policy has its statistics of observations already."""
    recent_per_early: int
    """Start states from the last cycles for each one from the first cycle, whose states cover the
    most."""
    warm_up: int = 0
    """User steps after a start until an observation's past is the user's own."""
    batch: UserBatch
    """The simulated users."""
    rng: np.random.Generator
    """Random generator of the simulated users, noise on the actions included."""
    random_size: tuple[float, float]
    """Smallest and largest standard deviation of random actions; drawn per user."""
    success_rates: tuple[float, ...] = ()
    """Of the simulated users in the last collection, by condition; NaN: not known."""

    # --- simulated users ---------------------------------------------------------------------

    @abstractmethod
    def begin_collecting(self, *, randomly: bool) -> None:
        """Start episodes, or continue those that were; those of random actions are short."""

    def stagger(self) -> None:
        """Spread the episodes' ends over time."""

    def motion(self) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
        """Return angles (rad), speeds (rad/s), (N, J) each, and drives (N, A)."""
        users = self.batch
        joints, dofs = users.body.qpos_independent, users.body.qvel_independent
        return users.qpos[:, joints], users.qvel[:, dofs], self.body.drives.of(users)

    @abstractmethod
    def policy_actions(self) -> NDArray[Any]:
        """Return the policy's (N, A) mean actions."""

    @abstractmethod
    def simulate(
        self, actions: NDArray[Any]
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray[Any], NDArray[Any]]:
        """Advance by one user step.

        Returns:
            (N,) whether the user step can be learned from; (N,) whether the episode is over; (N, P)
            persons and (N, F) privileged numbers after it.
        """

    @abstractmethod
    def restart(self, ids: NDArray[np.int64]) -> None:
        """Start new episodes of simulated users (K,)."""

    def end_collecting(self) -> None:
        """Measure the results since :meth:`begin_collecting`."""

    # --- a cycle -----------------------------------------------------------------------------

    def begin_cycle(self, cycle: int) -> None:
        """Set how difficult this cycle is, the first being 0."""

    def calibrate(self, steps: TransitionStore) -> None:
        """Fit the task's parameters of the tools to the user steps of the first cycle."""

    def begin_updates(self, pool: TransitionStore) -> None:
        """Process the states that imagined users start from in this cycle."""

    @abstractmethod
    def report(
        self, cycle: int, updates: int, success_rates: tuple[float, ...], place_error_m: float
    ) -> Any:
        """Return the results of the cycle that has just ended, and adapt the next cycle to them.

        Args:
            success_rates: of its simulated users, by condition.
            place_error_m: of the body model, mean over devices, in one user step.
        """

    # --- imagined users ----------------------------------------------------------------------

    def place(self, steps: TransitionStore) -> Tensor:
        """Return the poses of the devices after user steps, (K, D, 4, 4)."""
        with torch.no_grad():
            place: Tensor = self.body.places(steps.after.angles, steps.after.persons)
        return place

    @abstractmethod
    def start(self, ids: Tensor, pool: TransitionStore, rows: Tensor) -> None:
        """Let imagined users ``ids`` (K,) continue from rows (K,) of the pool, or better ones.

        Rows are on the CPU, where random numbers are cheap one by one.
        """

    @abstractmethod
    def observe(self) -> Tensor:
        """Return the policy's observations."""

    @abstractmethod
    def present(self) -> Tensor:
        """Return the same without delays, for the critic."""

    @abstractmethod
    def normalise(self, observations: Tensor) -> None:
        """Set the policy's statistics of observations by (K, size) of them."""

    @abstractmethod
    def action_mean(self, observation: Tensor) -> Tensor:
        """Return the policy's mean actions."""

    @abstractmethod
    def step(self, actions: Tensor, done: float) -> Tensor:
        """Return the (B,) rewards of the last user step of the imagined users.

        Args:
            done: proportion of the training that is over; rewards may be relaxed at first.
        """

    @abstractmethod
    def cut(self) -> None:
        """Detach the present state from the computation graph before it."""


_KEPT = (0.0, 0.6, 0.9)
"""Proportion of random noise that lasts from one user step to the next; drawn per user."""
_RETURN = 0.3
"""Proportion of their way to rest that actuators of such users return in a user step."""


def collect(
    task: Task,
    steps: int,
    *,
    action_noise: float,
    randomly: bool,
    on_progress: Callable[[float], None],
) -> TransitionStore:
    """Return collected user steps of simulated users.

    Args:
        action_noise: standard deviation on the policy's actions.
        randomly: True: random actions in short episodes, instead of the policy's actions.
    """
    rng, batch, drives = task.rng, task.batch, task.body.drives
    task.begin_collecting(randomly=randomly)
    noise = np.zeros((batch.n, drives.count))
    rest = drives.rest(drives.of(batch))
    keep = rng.choice(_KEPT, (batch.n, 1))
    size = rng.uniform(*task.random_size, (batch.n, 1))
    task.stagger()
    rows: list[tuple[NDArray[Any], ...]] = []
    for step in range(steps):
        on_progress(step / steps)
        before = task.motion()
        if randomly:
            noise = keep * noise + np.sqrt(1.0 - keep**2) * rng.standard_normal(noise.shape)
            actions = size * noise + _RETURN * (rest - before[-1])
        else:
            mean = task.policy_actions()
            actions = mean + action_noise * rng.standard_normal(mean.shape)
        kept, over, persons, fields = task.simulate(actions)
        control = drives.controls(batch)  # motor noise included
        rows.append(tuple(a[kept] for a in (*before, control, *task.motion(), persons, fields)))
        ids = np.flatnonzero(over)
        if len(ids):
            task.restart(ids)
            rest[ids] = drives.rest(drives.of(batch))[ids]
    task.end_collecting()
    columns = (np.concatenate(column) for column in zip(*rows, strict=True))
    return TransitionStore.of([torch.tensor(c, dtype=torch.float32) for c in columns])


_PLAYED, _FITTED = 0.2, 0.4
"""Proportions of a cycle's time that are over after collecting, and after fitting."""
_CRITIC_LEARNING_RATE, _LAMBDA = 1e-3, 0.9
_BETAS = (0.8, 0.97)
"""Of Adam: gradients change as fast as the body model does."""
_ERROR_SHARE = 0.3
"""Noise on the imagined motion, in units of the body model's error, so that its errors do not
count as knowledge."""
_BEYOND_COST = 0.01
"""Of means beyond the actions' range, squared."""
_MOST_THREADS = 2
"""Torch's threads. With one or two the bits are the same, with three they are not; and half of an
update's time is starting operations, which more threads do not shorten."""
_STATISTICS_STARTS = 8
"""Starts of all imagined users that the statistics of observations are from."""

OnProgress = Callable[[str, float], None]
"""Called with the present activity and the approximate proportion of the cycle that is done."""

AnyTask = TypeVar("AnyTask", bound=Task)


def value_function(
    size: int, width: int, normalise: Callable[[Tensor], Tensor], gamma: float
) -> ValueFunction:
    """Return a critic of observations with ``size`` numbers, drawn from torch's generator."""
    return ValueFunction(
        size, width, normalise, learning_rate=_CRITIC_LEARNING_RATE, gamma=gamma, lam=_LAMBDA
    )


class ModelBasedTrainer(State, Generic[AnyTask]):
    """Trains a policy by gradients through a body model that is fitted to simulated users.

    The torch generator's state at construction is where the first cycle continues.

    Args:
        device: that all of it is on, but for the policy and the simulated users.
    """

    def __init__(
        self,
        task: AnyTask,
        config: ImaginedConfig,
        critic: ValueFunction,
        device: LearningDevice | None = None,
    ) -> None:
        self._device = device or LearningDevice("cpu")
        self.task, self.config = task, config
        self.body, self.users = task.body, task.users
        self.cycle = self.updates = 0
        self._critic = critic
        self._optimizer = torch.optim.Adam(
            task.actor, lr=config.learning_rate, betas=_BETAS, fused=self._device.is_gpu or None
        )
        with self._device.active(self.task.policy):
            self._average = WeightAverage(task.actor, config.average_updates)
        self._window = self._device.window(self._imagined_window, [self.users, *task.parts])
        self._threads = FastestThreads(range(1, _most_threads() + 1))
        self._seen: list[TransitionStore] = []
        self._pool: TransitionStore | None = None
        self._random_state = self._device.random_state()
        self._best: tuple[float, dict[str, Tensor]] | None = None
        """The highest success rate of the simulated users, and the weights they had."""

    @property
    def device(self) -> torch.device:
        """Device on which imagined rollouts are computed."""
        return self._device.device

    @property
    def finished(self) -> bool:
        """Return whether all cycles are done."""
        return self.cycle >= self.config.cycles

    # --- a cycle -----------------------------------------------------------------------------

    def step(self, on_progress: OnProgress = lambda doing, share: None) -> Any:
        """Collect user steps, fit the body model to them, and learn from imagined rollouts.

        Returns:
            The task's report of the cycle.
        """
        with self._device.seeded(self._random_state):
            report = self._cycle(on_progress)
            self._random_state = self._device.random_state()
        return report

    def _cycle(self, on_progress: OnProgress) -> Any:
        self.task.begin_cycle(self.cycle)
        with self._average.in_place():
            self._seen.append(self._collect(on_progress).to(self.device))
            self._keep_best()
        with self._device.active(self.task.policy), torch_threads(_most_threads()):
            place_error_m = self._learn(on_progress)
        self.cycle += 1
        rates = self.task.success_rates
        if self.finished:
            self._settle()
        with self._device.active():
            return self.task.report(self.cycle, self.updates, rates, place_error_m)

    def _learn(self, on_progress: OnProgress) -> float:
        """Fit the body model, and learn from imagined rollouts.

        Returns:
            The body model's error, mean distance of the devices from where they go, m.
        """
        config, first = self.config, self.cycle == 0
        if len(self._seen) > 1 + KEPT_CYCLES:
            del self._seen[1]
        if first:
            self.body.scale_by(self._seen[0])
            self.users.rest_as(self._seen[0].before.drives)
            self.task.calibrate(self._seen[0])
        self._threads.measure()
        fit_first, later = self._seen[0], self._seen[1:]
        if not later:
            to_fit = fit_first
        else:
            parts = (fit_first, TransitionStore.joined(later), TransitionStore.joined(later[-3:]))
            count = self.config.fit_minibatches * 300
            to_fit = TransitionStore.joined([part.drawn(count) for part in parts])
        fit = fit_body(
            self.body,
            to_fit,
            minibatches=config.first_fit_minibatches if first else config.fit_minibatches,
            learning_rate=4e-3 if first else 1.5e-3,
            device=self._device,
            threads=self._threads,
            on_progress=lambda share: on_progress(
                "fitting the body model", _PLAYED + share * (_FITTED - _PLAYED)
            ),
        )
        # Choose states to start from: of the last cycles, and of the first.
        recent = TransitionStore.joined(self._seen[1:][-8:] or self._seen[:1])
        early = self._seen[0].drawn(len(recent) // self.task.recent_per_early)
        self._pool = TransitionStore.joined([recent, early])
        self.task.begin_updates(self._pool)
        if first:
            # Start all imagined users, and set the policy's statistics by what they observe.
            seen = []
            with torch.no_grad():
                for _ in range(self.task.starts):
                    self._restart(torch.arange(self.users.n))
                    seen.append(self.task.observe())
            if seen:
                self.task.normalise(torch.cat(seen[:_STATISTICS_STARTS]))
        self._window.forget()  # delays, noise and costs are those of the next cycle
        self._threads.measure()
        for update in range(config.updates):
            share = update / config.updates
            on_progress("imagined rollouts", _FITTED + (1.0 - _FITTED) * share)
            with self._threads.turn():
                self._update()
        return fit["place_m"]

    def _collect(self, on_progress: OnProgress) -> TransitionStore:
        config, first = self.config, self.cycle == 0
        return collect(
            self.task,
            config.first_play_steps if first else config.play_steps,
            action_noise=config.action_noise,
            randomly=first,
            on_progress=lambda share: on_progress("collecting user steps", _PLAYED * share),
        )

    def _settle(self) -> None:
        """Give the policy the mean of the last updates' weights, or the best ones."""
        self._average.settle()
        if not self.config.keep_best:
            return
        self._collect(lambda doing, share: None)
        self._keep_best()
        if self._best is not None:
            self.task.policy.load_state_dict(self._best[1])

    def _keep_best(self) -> None:
        """Keep the weights that the simulated users have just had, if none were more successful.

        Rates of cycles that are easier than the last ones do not count.
        """
        known = [rate for rate in self.task.success_rates if rate == rate]
        easier = self.cycle < self.config.easier_cycles
        if not self.config.keep_best or not known or easier:
            return
        rate = sum(known) / len(known)
        if self._best is None or rate > self._best[0]:
            weights = {name: value.clone() for name, value in self.task.policy.state_dict().items()}
            self._best = (rate, weights)

    # --- where imagined rollouts start -------------------------------------------------------

    def _restart(self, ids: Tensor) -> None:
        """Continue imagined users ``ids`` (K,) from states of simulated ones."""
        assert self._pool is not None
        rows = torch.randint(len(self._pool), (len(ids),), device="cpu")
        self.task.start(ids, self._pool, rows)

    # --- learning ----------------------------------------------------------------------------

    def advance(self, actions: Tensor, done: float, *, error_share: float = _ERROR_SHARE) -> Tensor:
        """(B,) rewards of a user step of all imagined users; ``done`` as in :meth:`Task.step`."""
        self.users.step(actions, error_share=error_share)
        reward = self.task.step(actions, done)
        effort, beyond, wild = self.users.costs()
        return self.config.reward_scale * (reward - effort) - beyond - wild

    def _act(self) -> tuple[Tensor, Tensor]:
        """(B, A) means, and actions with noise."""
        mean = self.task.action_mean(self.task.observe())
        return mean, mean + self.config.action_noise * torch.randn_like(mean)

    def _cut(self) -> None:
        self.users.cut()
        self.task.cut()

    def _roll_window(self, done: float) -> tuple[Tensor, Tensor, Tensor]:
        """Advance all imagined users by a window of T user steps, differentiably.

        Returns:
            (B,) discounted returns, with the critic's value of the last state; (T + 1, B, size)
            observations without delays; (T, B) rewards.
        """
        config, limit = self.config, self.users.gradient_limit
        seen, rewards, total = [self.task.present()], [], torch.zeros(())
        for t in range(config.window_steps):
            mean, actions = self._act()
            if limit is not None:
                actions = limited(actions, limit)
            reward = self.advance(actions, done)
            reward = reward - _BEYOND_COST * torch.relu(mean.abs() - 1.0).square().sum(1)
            rewards.append(reward)
            seen.append(self.task.present())
            total = total + config.gamma**t * reward
        total = total + config.gamma**config.window_steps * self._critic(seen[-1])
        return total, torch.stack(seen), torch.stack(rewards)

    @property
    def _done(self) -> float:
        """Proportion of the training that is over."""
        return self.updates / (self.config.updates * self.config.cycles)

    def _imagined_window(self) -> tuple[Tensor, Tensor, Tensor]:
        """Advance all imagined users by a window, and set the policy's gradients by it.

        Returns:
            The gradients' norm before they were clipped; (T + 1, B, size) observations without
            delays; (T, B) rewards.
        """
        done = self._done
        # Give users who have just started a past of their own.
        with torch.no_grad():
            for _ in range(self.task.warm_up):
                _, actions = self._act()
                self.advance(actions, done)
        self._cut()
        total, seen, rewards = self._roll_window(done)
        self._optimizer.zero_grad()
        (-total.mean() / self.config.window_steps).backward()  # type: ignore[no-untyped-call]
        norm = nn.utils.clip_grad_norm_(self.task.actor, 1.0)
        self._cut()
        return norm, seen.detach(), rewards.detach()

    def _update(self) -> None:
        """Learn from a window of imagined user steps, and restart some of the users."""
        config, done = self.config, self._done
        for group in self._optimizer.param_groups:
            group["lr"] = config.learning_rate * min(1.0, 2.0 * (1.0 - done)) + 2e-5
        if config.gradient_limit is not None:  # the loss is a mean
            self.users.gradient_limit = config.gradient_limit / (config.window_steps * self.users.n)
        norm, seen, rewards = self._window()
        if torch.isfinite(norm) and self.updates >= config.critic_first_updates:
            self._optimizer.step()
            self._average.add()
        self._critic.learn(seen, rewards)
        again = torch.rand(self.users.n, device="cpu") < config.restart_share
        self._restart(torch.nonzero(again.to(self.device) | self.users.broken()).flatten())
        self.updates += 1

    # --- exact resume ------------------------------------------------------------------------

    _state = (
        *("cycle", "updates", "task.rng", "task.policy", "body", "_critic", "_optimizer"),
        *("_average", "_random_state", "users", "task"),
    )

    def state_dict(self) -> dict[str, Any]:
        """Copy everything that the next cycle depends on."""
        seen = [part.tensors() for part in self._seen]  # never changed
        return super().state_dict() | {"seen": seen, "best": self._best and list(self._best)}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from :meth:`state_dict`."""
        names = {"users", "task", "seen"} & state.keys()
        moved = {name: self._device.moved(state[name]) for name in names}
        if "simulation" in state.get("task", {}):  # not learned from
            moved["task"]["simulation"] = state["task"]["simulation"]
        with self._device.active(self.task.policy):
            super().load_state_dict({**state, **moved})
            for parameter in self.body.parameters():
                parameter.requires_grad_(False)
            self._seen = [TransitionStore.of(each) for each in moved["seen"]]
            self.users.rest_as(self._seen[0].before.drives)
        self._best = state["best"] and (state["best"][0], state["best"][1])


def _most_threads() -> int:
    return min(_MOST_THREADS, torch.get_num_threads())
