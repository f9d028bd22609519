"""Training of hands' feedback in space: reaches with late senses, noise, and a cost of time.

A hand is a point whose velocity follows the policy's, with noise that grows with its changes. The
policy learns by gradients through whole movements. A movement ends with the probability that the
policy says; what it earns is the expected value over these ends.
"""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from sim2vr_harness.policies.hierarchical.goal_sampler import off_goal
from sim2vr_harness.policies.hierarchical.hand_policy import HandPolicy
from sim2vr_harness.policies.hierarchical.human_goals import GoalPerception, HumanGoals
from sim2vr_harness.runs.option_config import PeopleTraining

_HANDS, _STEPS = 512, 40
_STOP, _SELECT = 0.55, 0.2
_DISTANCES_M, _WIDTHS_M, _PASS_MPS = (0.03, 0.7), (0.01, 0.12), (0.3, 3.0)
_MOVING, _MOVING_MPS = 0.3, 0.4
_JUMPS_HZ, _JUMP_M = 0.3, 0.05
_STILL_MPS, _LIKE, _SLACK_MPS, _EDGE = 0.15, 0.4, 0.3, 0.12
"""Speed at which a stop half counts; share of a velocity, and m/s beside it, by which one may be
wrong; softness of a target's edge, of its width."""
_LEARNING_RATE, _CLIP = 2e-3, 1.0


@dataclass(frozen=True)
class Execution:
    """How well hands do what is wanted, per user step.

    Measured in reaches of ``mobl_arms_wrist`` (docs/research/human_motor.md). Of the error that
    grows with the change of velocity, half is taken to be noise; the rest is the same for a person
    and a posture, and is adapted to.

    Attributes:
        gain: share of a wanted change of velocity that happens within the user step.
        constant_mps: standard deviation of the velocity beside that, along each axis.
        change: the same, of the change of velocity that was wanted.
        speed: the same, of the velocity.
        kept: correlation of the error from one user step to the next.
    """

    gain: float = 0.76
    constant_mps: float = 0.014
    change: float = 0.14
    speed: float = 0.01
    kept: float = 0.5


def ending(way: Tensor, velocity: Tensor, goals: HumanGoals) -> tuple[Tensor, Tensor, Tensor]:
    """(B, H) each: in how far a movement that ends so succeeds; m and m/s that it is off.

    Args:
        way: (B, H, 3) from the hands to their goals, m.
        velocity: (B, H, 3) of the hands, m/s.
        goals: what was wanted.
    """
    through = goals.velocity.square().sum(-1).add(1e-6).sqrt()
    passes = (through > 2e-3).float()
    off = off_goal(-way, goals.velocity)
    wrong = (velocity - goals.velocity).square().sum(-1).add(1e-6).sqrt() * (goals.stops + passes)
    inside = torch.sigmoid((0.5 * goals.width - off) / (_EDGE * goals.width))
    slack = torch.where(passes > 0.0, _LIKE * through + _SLACK_MPS, _STILL_MPS)
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
        execution: noise of the body.
        step_s: duration of a user step.
        updates: how many.
        seed: of everything drawn.
        on_progress: receives the proportion that is done.

    Returns:
        The mean worth of a movement in the last tenth of the updates.
    """
    optimizer = torch.optim.Adam(policy.parameters(), lr=_LEARNING_RATE)
    worth: list[float] = []
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        for update in range(updates):
            on_progress(update / updates)
            rate = _LEARNING_RATE * min(1.0, 2.0 * (1.0 - update / updates)) + 1e-5
            for group in optimizer.param_groups:
                group["lr"] = rate
            reward = _Reaches(policy, config, execution, step_s).worth()
            optimizer.zero_grad()
            (-reward).backward()  # type: ignore[no-untyped-call]
            norm = nn.utils.clip_grad_norm_(policy.parameters(), _CLIP)
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
        count = (_HANDS, 1)
        self._goals = HumanGoals.none(_HANDS, 1)
        goals, kind = self._goals, torch.rand(count)
        direction = _directions()
        self._way = _between(_DISTANCES_M, log=True)[..., None] * direction
        goals.width = _between(_WIDTHS_M, log=True)
        goals.stops = (kind < _STOP).float()
        onwards = nn.functional.normalize(direction + 0.8 * _directions(), dim=-1)
        speed = _between(_PASS_MPS) * (kind >= _STOP + _SELECT)
        goals.velocity = speed[..., None] * onwards
        moving = (torch.rand(count) < _MOVING).float()
        self._velocity = (_MOVING_MPS * moving)[..., None] * torch.randn(*count, 3)
        self._noise = (0.12 * torch.randn(count)).exp()
        self._effort = (0.5 * torch.randn(count)).exp()
        self._error = torch.zeros(*count, 3)
        """Of the velocity reached in the last user step, m/s; not known yet."""
        self._seen = GoalPerception(_HANDS, 1, step_s, **config.perception)  # type: ignore[arg-type]
        self._seen.forget(torch.arange(_HANDS), self._way.norm(dim=-1))

    def worth(self) -> Tensor:
        """Mean expected reward of the movements."""
        config, alive, total = self._config, torch.ones(_HANDS, 1), torch.zeros(_HANDS, 1)
        for _ in range(_STEPS):
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
        jumps = (torch.rand(_HANDS, 1, 1) < _JUMPS_HZ * step_s).float()
        self._way = self._way + _JUMP_M * jumps * torch.randn_like(wanted)
        self._seen.look(self._way.detach().norm(dim=-1))
        return over, self._effort * cost


def _length(vectors: Tensor) -> Tensor:
    """(B, H) lengths, whose gradients are finite."""
    return vectors.square().sum(-1).add(1e-6).sqrt()


def _directions() -> Tensor:
    return nn.functional.normalize(torch.randn(_HANDS, 1, 3), dim=-1)


def _between(bounds: tuple[float, float], *, log: bool = False) -> Tensor:
    low, high = torch.tensor(bounds).log() if log else torch.tensor(bounds)
    drawn = low + (high - low) * torch.rand(_HANDS, 1)
    return drawn.exp() if log else drawn
