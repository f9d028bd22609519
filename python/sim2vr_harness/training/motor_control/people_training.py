"""The training of a human motor policy: a forward model of the body, and feedback in space.

In each cycle virtual participants move, at first at random and then to goals, and the forward
model is fitted to their movements. Then the policy in space learns with the noise and delays of
people.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from sim2vr_harness.base.state import State
from sim2vr_harness.envs.config import UserConfig, motor_noise
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.policies.hierarchical.goal_sampler import off_goal
from sim2vr_harness.policies.hierarchical.human_motor import (
    GoalPerception,
    HandPolicy,
    HumanGoals,
    HumanHands,
    people_policy,
)
from sim2vr_harness.policies.hierarchical.motor_policy import INSIDE, tips
from sim2vr_harness.runs.option_config import PeopleTraining
from sim2vr_harness.users import UserBatch
from sim2vr_harness.world_models.body_dynamics import fit_body
from sim2vr_harness.world_models.transitions import Motion, TransitionStore


@dataclass(frozen=True)
class ReachSettings:
    """Movements that the policy in space learns with; the same for all bodies and apps."""

    hands: int = 512
    """Movements of a batch."""
    steps: int = 40
    """User steps after which a movement is given up."""
    stop: float = 0.55
    """Proportion of movements that stop in the target."""
    select: float = 0.2
    """Proportion that end in the target at any speed; the others pass it at a given velocity."""
    distances_m: tuple[float, float] = (0.03, 0.7)
    widths_m: tuple[float, float] = (0.01, 0.12)
    pass_mps: tuple[float, float] = (0.3, 3.0)
    """Speeds of those that pass."""
    moving: float = 0.3
    """Proportion of movements that begin while the hand moves."""
    moving_mps: float = 0.4
    """Standard deviation of its velocity then, along each axis."""
    jumps_hz: float = 0.3
    """Rate at which targets jump."""
    jump_m: float = 0.05
    """Standard deviation of a jump, along each axis."""
    still_mps: float = 0.15
    """Error of a velocity that a stop tolerates (one standard deviation)."""
    like: float = 0.4
    """The same of a hand that passes, as a proportion of the wanted speed."""
    slack_mps: float = 0.3
    """Added to that."""
    edge: float = 0.12
    """Softness of a target's edge, as a proportion of its width."""
    learning_rate: float = 2e-3
    max_grad_norm: float = 1.0


SETTINGS = ReachSettings()


@dataclass(frozen=True)
class Execution:
    """Accuracy with which hands execute a desired change of velocity, per user step.

    Measured in reaches of ``mobl_arms_wrist`` (docs/evidence/people.md). Of the error that grows
    with the change of velocity, half is assumed to be noise. The other half is the same for a
    person and a posture, and is adapted to.

    Attributes:
        gain: proportion of a desired change of velocity that happens within the user step.
        constant_mps: standard deviation of the velocity beside that, along each axis.
        change: the same, as a proportion of the desired change of velocity.
        speed: the same, as a proportion of the velocity.
        kept: correlation of the error from one user step to the next.
    """

    gain: float = 0.76
    constant_mps: float = 0.014
    change: float = 0.14
    speed: float = 0.01
    kept: float = 0.5


def ending(way: Tensor, velocity: Tensor, goals: HumanGoals) -> tuple[Tensor, Tensor, Tensor]:
    """Return success (0 to 1), position and velocity error (m, m/s) of movement ends, (B, H).

    Args:
        way: (B, H, 3) from the hands to their goals, m.
        velocity: (B, H, 3) of the hands, m/s.
        goals: the goals of the movements.
    """
    through = goals.velocity.square().sum(-1).add(1e-6).sqrt()
    passes = (through > 2e-3).float()
    off = off_goal(-way, goals.velocity)
    wrong = (velocity - goals.velocity).square().sum(-1).add(1e-6).sqrt() * (goals.stops + passes)
    inside = torch.sigmoid((0.5 * goals.width - off) / (SETTINGS.edge * goals.width))
    slack = torch.where(
        passes > 0.0, SETTINGS.like * through + SETTINGS.slack_mps, SETTINGS.still_mps
    )
    return inside * torch.exp(-0.5 * (wrong / slack).square()), off, wrong


def train_hand_policy(
    policy: HandPolicy,
    config: PeopleTraining,
    execution: Execution,
    step_s: float,
    *,
    updates: int,
    seed: int,
    on_progress: Callable[[float], None] = lambda share: None,
) -> float:
    """Train a policy in space.

    Args:
        policy: changed.
        config: rewards, costs and perception.

    Returns:
        The mean worth of a movement in the last tenth of the updates.
    """
    optimizer = torch.optim.Adam(policy.parameters(), lr=SETTINGS.learning_rate)
    worth: list[float] = []
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        for update in range(updates):
            on_progress(update / updates)
            rate = SETTINGS.learning_rate * min(1.0, 2.0 * (1.0 - update / updates)) + 1e-5
            for group in optimizer.param_groups:
                group["lr"] = rate
            reward = _Reaches(policy, config, execution, step_s).worth()
            optimizer.zero_grad()
            (-reward).backward()  # type: ignore[no-untyped-call]
            norm = nn.utils.clip_grad_norm_(policy.parameters(), SETTINGS.max_grad_norm)
            if torch.isfinite(norm):
                optimizer.step()
            worth.append(float(reward.detach()))
    last = worth[-max(1, updates // 10) :]
    return sum(last) / len(last)


class _Reaches:
    """A batch of movements, from their beginning to their ends."""

    def __init__(
        self,
        policy: HandPolicy,
        config: PeopleTraining,
        execution: Execution,
        step_s: float,
    ) -> None:
        self._policy, self._config, self._how, self._step_s = policy, config, execution, step_s
        count = (SETTINGS.hands, 1)
        self._goals = HumanGoals.none(SETTINGS.hands, 1)
        goals, kind = self._goals, torch.rand(count)
        direction = _directions()
        self._way = _between(SETTINGS.distances_m, log=True)[..., None] * direction
        goals.width = _between(SETTINGS.widths_m, log=True)
        goals.stops = (kind < SETTINGS.stop).float()
        onwards = nn.functional.normalize(direction + 0.8 * _directions(), dim=-1)
        speed = _between(SETTINGS.pass_mps) * (kind >= SETTINGS.stop + SETTINGS.select)
        goals.velocity = speed[..., None] * onwards
        moving = (torch.rand(count) < SETTINGS.moving).float()
        self._velocity = (SETTINGS.moving_mps * moving)[..., None] * torch.randn(*count, 3)
        self._noise = (0.12 * torch.randn(count)).exp()
        self._effort = (0.5 * torch.randn(count)).exp()
        self._error = torch.zeros(*count, 3)
        """Of the velocity reached in the last user step, m/s; not known yet."""
        self._seen = GoalPerception(SETTINGS.hands, 1, step_s, **config.perception)  # type: ignore[arg-type]
        self._seen.forget(torch.arange(SETTINGS.hands), self._way.norm(dim=-1))

    def worth(self) -> Tensor:
        """Mean expected reward of the movements."""
        config, alive, total = (
            self._config,
            torch.ones(SETTINGS.hands, 1),
            torch.zeros(SETTINGS.hands, 1),
        )
        for _ in range(SETTINGS.steps):
            over, cost = self._step()
            hazard = torch.sigmoid(over)
            succeeds, off, wrong = ending(self._way, self._velocity, self._goals)
            ends = config.success_reward * succeeds - config.miss_cost * (1.0 - succeeds)
            ends = ends - config.distance_cost * ((off.square() + 1e-4).sqrt() - 0.01)
            ends = ends - 0.1 * config.success_reward * wrong
            runs = -self._step_s * config.time_cost - cost
            total = total + alive * (runs + hazard * ends)
            alive = alive * (1.0 - hazard)
        total = total + alive * (ends - config.miss_cost)
        return total.mean()

    def _step(self) -> tuple[Tensor, Tensor]:
        """Advance by a user step: logits of ends, and the cost of effort."""
        how, step_s = self._how, self._step_s
        believed = self._velocity - self._error.detach()
        way = self._way + 0.5 * step_s * self._error.detach() + self._seen.error()
        wanted, over = self._policy(way, believed, self._goals, self._noise, self._effort)
        change = wanted - believed
        cost = self._config.effort_cost * step_s * (change / step_s).square().sum(-1)
        size = self._noise * (
            how.constant_mps + how.change * _length(change) + how.speed * _length(believed)
        )
        fresh = (1.0 - how.kept**2) ** 0.5
        error = how.kept * self._error + fresh * size[..., None] * torch.randn_like(wanted)
        before, self._error = self._velocity, error
        self._velocity = believed + how.gain * change + error
        self._way = self._way - 0.5 * step_s * (before + self._velocity)
        jumps = (torch.rand(SETTINGS.hands, 1, 1) < SETTINGS.jumps_hz * step_s).float()
        self._way = self._way + SETTINGS.jump_m * jumps * torch.randn_like(wanted)
        self._seen.look(self._way.detach().norm(dim=-1))
        return over, self._effort * cost


def _length(vectors: Tensor) -> Tensor:
    """Return lengths (B, H) with finite gradients."""
    return vectors.square().sum(-1).add(1e-6).sqrt()


def _directions() -> Tensor:
    return nn.functional.normalize(torch.randn(SETTINGS.hands, 1, 3), dim=-1)


def _between(bounds: tuple[float, float], *, log: bool = False) -> Tensor:
    low, high = torch.tensor(bounds).log() if log else torch.tensor(bounds)
    drawn = low + (high - low) * torch.rand(SETTINGS.hands, 1)
    return drawn.exp() if log else drawn


_KEPT, _RETURN, _SIZES = (0.0, 0.6, 0.9), 0.3, (0.05, 0.7)
"""Of random actions: how much lasts from one user step to the next, return to rest, and their
standard deviation."""
_RANDOM_STEPS, _GOAL_STEPS = 20, 24
"""User steps of an episode."""
_EXPLORES = 0.05
"""Noise on the actions to goals, so that the model is fitted to more than is usual."""
_TOOL_SHARES, _TOOLS_M = 0.5, (0.05, 0.4)
_REACH_MPS = (0.2, 2.0)
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
                width=config.width,
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
        """Run a cycle; the last one ends with the training of the policy in space.

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
            if self.finished:
                train_hand_policy(
                    self.policy.hand_policy,
                    self.config,
                    Execution(),
                    self.policy.step_s,
                    updates=self.config.updates,
                    seed=self._seed,
                    on_progress=lambda share: on_progress("learning to reach", share),
                )
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
        self._goal, self._mps = torch.zeros_like(self._tip), torch.ones(self._n, 1, 1)
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
                actions = self._to_goals(now) + explored
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
        """Give persons (K,) goals on the way to other postures, at other speeds."""
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
        low_mps, high_mps = np.log(_REACH_MPS)
        speed = np.exp(rng.uniform(low_mps, high_mps, (len(ids), 1, 1)))
        self._mps[rows] = torch.from_numpy(speed).float()

    def _to_goals(self, now: Motion) -> NDArray[np.float64]:
        """Return (N, A) actions of a simple rule in space, used before reaching is learned."""
        goals = HumanGoals.none(self._n, len(self._policy.hands))
        goals.tip, goals.place = self._tip, self._goal
        goals.active = torch.ones_like(goals.active)
        again = np.flatnonzero(self._rng.random(self._n) < 0.08)
        if len(again):
            self._aim(again)
        mps = self._mps

        def straight(way: Tensor, velocity: Tensor) -> Tensor:
            far = way.norm(dim=-1, keepdim=True)
            wanted = way / (far + 1e-3) * torch.minimum(mps, 5.0 * far)
            return velocity + 0.35 * (wanted - velocity)

        actions, _ = self._hands.act(now, goals, rule=straight)
        return actions.astype(np.float64)

    @property
    def velocity_mps(self) -> float:
        """Median error of the velocities reached."""
        if not self._rows:
            return 0.0
        return float(torch.cat([row[2] - row[0] for row in self._rows]).norm(dim=-1).median())
