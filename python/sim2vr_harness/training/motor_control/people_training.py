"""The training of a human motor policy: a forward model of the body.

In each cycle virtual participants move, at first at random and then to goals, and the forward
model is fitted to their movements.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from sim2vr_harness.base.state import State
from sim2vr_harness.envs.config import UserConfig, motor_noise
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.policies.hierarchical.human_motor import (
    HumanHands,
    people_policy,
)
from sim2vr_harness.policies.hierarchical.motor_policy import INSIDE, MotorGoals, tips
from sim2vr_harness.runs.option_config import PeopleTraining
from sim2vr_harness.users import UserBatch
from sim2vr_harness.world_models.body_dynamics import fit_body
from sim2vr_harness.world_models.transitions import Motion, TransitionStore

_KEPT, _RETURN, _SIZES = (0.0, 0.6, 0.9), 0.3, (0.05, 0.7)
"""Of random actions: how much lasts from one user step to the next, return to rest, and their
standard deviation."""
_RANDOM_STEPS, _GOAL_STEPS = 20, 24
"""User steps of an episode."""
_EXPLORES = 0.05
"""Noise on the actions to goals, so that the model is fitted to more than is usual."""
_TOOL_SHARES, _TOOLS_M = 0.5, (0.05, 0.4)
_PASSES, _PASS_MPS = 0.5, 1.0
"""Proportion of goals that hands pass, and the standard deviation of their velocity per axis."""
_ARMS = 1024
"""Arms in a minibatch of the forward model: two arms of a body share one model."""


class Bodies:
    """Simulated persons, as :class:`ImaginedPersons` reads them.

    Args:
        user: configuration with people.
    """

    def __init__(self, user: UserConfig, n: int, step_s: float, threads: int) -> None:
        self.n = n
        env = ResolvedEnv.of_user(user)
        assert env.people is not None
        self.people, self.body = env.people, env.body
        self.users = UserBatch(
            self.body,
            n,
            threads=threads,
            effort="zero",
            noise=motor_noise(user.noise),
            substeps=round(step_s / self.body.timestep),
            people=self.people,
            cut=env.body_for,
        )

    def reset(self, ids: NDArray[np.int64], rng: np.random.Generator) -> None:
        """Replace the users' persons, in random postures."""
        low, high = self.body.joint_ranges.T
        middle, half = 0.5 * (low + high), 0.5 * INSIDE * (high - low)
        postures = middle + half * rng.uniform(-1.0, 1.0, (len(ids), len(low)))
        seeds = rng.integers(2**31, size=len(ids))
        persons = [self.people.of_episode(int(seed)) for seed in seeds]
        rngs = [np.random.default_rng(seed) for seed in seeds]
        self.users.reset(ids, rngs, list(postures), persons)


@dataclass(frozen=True)
class PeopleCycle:
    """Results of one training cycle.

    Attributes:
        cycle: its number, from 1.
        model_m: forward model error: mean distance between predicted and simulated hand positions
            after one user step.
        velocity_mps: median difference between actual and desired hand velocity; 0 in the first
            cycle.
    """

    cycle: int
    model_m: float
    velocity_mps: float

    def in_words(self, cycles: int) -> str:
        """Return a line of text on the cycle, with the number of all cycles."""
        return (
            f"Cycle {self.cycle}/{cycles}: forward model error {1000 * self.model_m:.1f} mm a "
            f"step; velocities of hands are {self.velocity_mps:.2f} m/s off"
        )


class PeopleTrainer(State):
    """Trains a human motor policy, cycle by cycle.

    Args:
        user: configuration with people.
    """

    def __init__(
        self,
        config: PeopleTraining,
        user: UserConfig,
        step_s: float,
        *,
        threads: int = 0,
        seed: int = 1,
    ) -> None:
        self.config, self._seed, self.cycle = config, seed, 0
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.policy = people_policy(
                user,
                step_s,
                body_width=config.body_width,
                perception=config.perception,
            )
        self._hands = len(self.policy.hands)
        self._bodies = Bodies(user, -(-config.bodies // self._hands), step_s, threads)
        self._seen: list[TransitionStore] = []

    @property
    def finished(self) -> bool:
        """Return whether all cycles are done."""
        return self.cycle >= self.config.cycles

    def step(self, on_progress: Callable[[str, float], None] = lambda doing, share: None) -> Any:
        """Run a cycle.

        Returns:
            Results of the cycle.
        """
        config, first = self.config, self.cycle == 0
        rng = np.random.default_rng([self._seed, self.cycle, 61])
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(int(rng.integers(2**31)))
            collected = _Collection(self, rng)
            steps = config.random_steps if first else config.goal_steps
            self._seen.append(collected.steps(steps, randomly=first, on_progress=on_progress))
            fit_first, later, model = self._seen[0], self._seen[1:], self.policy.forward_model
            if not later:
                model.scale_by(fit_first)
            count = self.config.fit_minibatches * 300
            known = [fit_first, *([TransitionStore.joined(later), later[-1]] if later else [])]
            fit_steps = (
                fit_first if not later else TransitionStore.joined([x.drawn(count) for x in known])
            )
            found = fit_body(
                model,
                fit_steps,
                minibatches=self.config.fit_minibatches * (1 if later else 3),
                learning_rate=2e-3 if later else 4e-3,
                batch_size=_ARMS // self._hands,
                on_progress=lambda share: on_progress("fitting the forward model", share),
            )
            model_m = found["place_m"]
            self.cycle += 1
        return PeopleCycle(self.cycle, model_m, collected.velocity_mps)

    # --- exact resume ------------------------------------------------------------------------

    _state = ("cycle", "policy")

    def state_dict(self) -> dict[str, Any]:
        """Return everything that the next cycle depends on."""
        return super().state_dict() | {"transitions": [part.tensors() for part in self._seen]}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from :meth:`state_dict`."""
        super().load_state_dict(state)
        self._seen = [TransitionStore.of(part) for part in state["transitions"]]


class _Collection:
    """User steps of simulated persons: at random, or to goals anywhere at any speed."""

    def __init__(self, trainer: PeopleTrainer, rng: np.random.Generator) -> None:
        self._policy, self._bodies, self._rng = trainer.policy, trainer._bodies, rng
        self._n, self._hands = self._bodies.n, HumanHands(trainer.policy, self._bodies.n)
        self._tip = torch.zeros(self._n, len(self._policy.hands), 3)
        self._goal, self._final = torch.zeros_like(self._tip), torch.zeros_like(self._tip)
        self._rows: list[tuple[Tensor, ...]] = []
        """Changes of velocity wanted, velocities, and changes that happened, (K, 3)."""

    def steps(
        self, count: int, *, randomly: bool, on_progress: Callable[[str, float], None]
    ) -> TransitionStore:
        """Return the given number of user steps of all persons."""
        users, drives, rng = self._bodies.users, self._policy.drives, self._rng
        everyone = np.arange(self._n)
        longest = _RANDOM_STEPS if randomly else _GOAL_STEPS
        age = rng.integers(0, longest, self._n)
        self._begin(everyone)
        noise = np.zeros((self._n, drives.count))
        keep, size = rng.choice(_KEPT, (self._n, 1)), rng.uniform(*_SIZES, (self._n, 1))
        rest, rows = drives.rest(drives.of(users)), []
        for step in range(count):
            on_progress("collecting user steps", step / count)
            now = self._now()
            if randomly:
                noise = keep * noise + np.sqrt(1.0 - keep**2) * rng.standard_normal(noise.shape)
                actions = size * noise + _RETURN * (rest - now.drives.numpy())
            else:
                explored = _EXPLORES * rng.standard_normal(noise.shape)
                explored[::2] = 0.0  # those measure how well wanted velocities are executed
                goals = MotorGoals.none(self._n, len(self._policy.hands))
                goals.tip, goals.place, goals.velocity = self._tip, self._goal, self._final
                goals.active = torch.ones_like(goals.active)
                if len(again := np.flatnonzero(rng.random(self._n) < 0.08)):
                    self._aim(again)
                actions = self._hands.act(now, goals)[0] + explored
            users.step(np.clip(actions, -1.0, 1.0))
            after, control = self._now(), torch.from_numpy(drives.controls(users)).float()
            kept = torch.from_numpy(~users.diverged)
            before = (now.angles, now.speeds, now.drives, control)
            then = (after.angles, after.speeds, after.drives, now.persons, control[:, :0])
            rows.append(tuple(values[kept] for values in (*before, *then)))
            if not randomly:
                hands = self._hands
                _, reached = self._policy.inverse.velocities(after, self._tip)
                wanted, believed = hands.wanted, hands.velocity
                note_rows = (wanted - believed, believed, reached - believed)
                self._rows.append(tuple(values[::2].flatten(0, 1) for values in note_rows))
            age += 1
            over = np.flatnonzero((age >= longest) | users.diverged)
            age[over] = 0
            self._begin(over)
        columns = (torch.cat(column) for column in zip(*rows, strict=True))
        return TransitionStore.of(list(columns))

    def _now(self) -> Motion:
        return self._hands.motion(self._bodies.users, self._policy.persons.of(self._bodies))  # type: ignore[arg-type]

    def _begin(self, ids: NDArray[np.int64]) -> None:
        """Replace the persons and their tools."""
        if not len(ids):
            return
        self._bodies.reset(ids, self._rng)
        self._hands.forget(ids)
        shape = (len(ids), len(self._policy.hands), 1)
        ahead = torch.from_numpy(self._rng.standard_normal((*shape[:2], 3))).float()
        ahead = ahead / ahead.norm(dim=-1, keepdim=True)
        length = torch.from_numpy(self._rng.uniform(*_TOOLS_M, shape)).float()
        tool = torch.from_numpy(self._rng.random(shape) > _TOOL_SHARES).float()
        self._tip[ids] = tool * length * ahead
        self._aim(ids)

    def _aim(self, ids: NDArray[np.int64]) -> None:
        """Give persons (K,) goals on the way to other postures, to stop at or to pass."""
        body, rng, policy = self._bodies.body, self._rng, self._policy
        low, high = body.joint_ranges.T
        rows = torch.from_numpy(ids)
        now = self._now().rows(rows)
        spread = rng.uniform(-INSIDE, INSIDE, now.angles.shape)
        other = torch.from_numpy(0.5 * (low + high) + 0.5 * spread * (high - low)).float()
        part = torch.from_numpy(rng.uniform(0.1, 1.0, (len(ids), 1))).float()
        angles = now.angles + part * (other - now.angles)
        with torch.no_grad():
            placed = policy.forward_model.places(angles, now.persons)
        self._goal[rows] = tips(placed, self._tip[rows])
        final = _PASS_MPS * rng.standard_normal((len(ids), len(policy.hands), 3))
        final *= rng.random((len(ids), 1, 1)) < _PASSES
        self._final[rows] = torch.from_numpy(final).float()
        self._hands.left_s[rows] = torch.nan

    @property
    def velocity_mps(self) -> float:
        """Median error of the velocities reached."""
        if not self._rows:
            return 0.0
        return float(torch.cat([row[2] - row[0] for row in self._rows]).norm(dim=-1).median())
