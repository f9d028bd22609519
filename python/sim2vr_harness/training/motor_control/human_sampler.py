"""Goals that a human motor policy trains with, and what ending a movement is worth."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor

from sim2vr_harness.policies.hierarchical.goal_sampler import off_goal
from sim2vr_harness.policies.hierarchical.human_goals import HumanGoals
from sim2vr_harness.policies.hierarchical.human_motor import HumanMotorPolicy
from sim2vr_harness.policies.hierarchical.motor_goals import MOMENT_S, tips
from sim2vr_harness.policies.hierarchical.workspace import INSIDE
from sim2vr_harness.runs.option_config import PeopleTrainingConfig

__all__ = ["HumanGoalSampler"]

REST, STOP, SELECT, PASS, HOLD = range(5)
_SHARES = (0.06, 0.54, 0.16, 0.24)
"""Of hands that rest, stop in a target, select it on the way and pass it at a speed."""
_WIDTHS_M = (0.01, 0.12)
_TOOL_SHARES = (0.5, 0.85)
"""Hands themselves up to the first, short tools up to the second, long ones above."""
_TOOLS_M = ((0.05, 0.35), (0.35, 1.1))
_PASS_MPS = (0.3, 3.0)
_NEAR = 0.6
"""Of goals that lie on the way to a random posture instead of at its end."""
_CANDIDATES, _FRONT_M, _BEHIND = 6, 0.12, 0.12
_POINTED = 0.12
_HELD, _HOLD_S, _REST_S = 0.3, (0.3, 0.8), (0.3, 1.0)
_LONGEST_S = 2.5
_JUMPS_HZ, _JUMP_M = 0.3, 0.05
"""How often a goal jumps while it is pursued, and how far along each axis."""
_STILL_MPS, _LIKE, _SLACK_MPS = 0.15, 0.4, 0.3
_EDGE = 0.12
"""Softness of a target's edge, of its width."""


class HumanGoalSampler:
    """Goals of B users' H hands.

    Args:
        policy: whose body reaches them.
        n: number of users B.
        seed: of goals.
        worth: rewards and costs of movements.
    """

    def __init__(
        self, policy: HumanMotorPolicy, n: int, seed: int, worth: PeopleTrainingConfig
    ) -> None:
        self._policy, self.n, self.hands = policy, n, len(policy.hands)
        self.worth, self._step_s = worth, policy.step_s
        self._low, self._high = torch.tensor(policy.body.joint_ranges.T.copy()).float()
        self.generator = torch.Generator().manual_seed(seed)
        self.goals = HumanGoals.none(n, self.hands)
        self.kind = torch.zeros(n, self.hands, dtype=torch.long)
        self._clock_s = torch.zeros(n, self.hands)
        self._until_s = torch.zeros(n, self.hands)

    def _rand(self, *shape: int) -> Tensor:
        return torch.rand(*shape, generator=self.generator)

    def _randn(self, *shape: int) -> Tensor:
        return torch.randn(*shape, generator=self.generator)

    def _between(self, bounds: tuple[float, float], *shape: int) -> Tensor:
        low, high = bounds
        return low + (high - low) * self._rand(*shape)

    # --- goals -------------------------------------------------------------------------------

    def draw(self, users: Tensor, hands: Tensor, angles: Tensor, persons: Tensor) -> None:
        """Give hands (K,) of users (K,) new goals, from angles (K, J) of persons (K, P)."""
        for hand in range(self.hands):
            rows = torch.nonzero(hands == hand).flatten()
            if len(rows):
                self._draw(users[rows], hand, angles[rows], persons[rows])

    def _tips(self, count: int) -> Tensor:
        """(K, 3) points fixed to the device: the hand, tools of all lengths, mostly ahead."""
        ahead = torch.tensor([1.0, 0.0, 0.0]) + 0.35 * self._randn(count, 3)
        sideways = self._randn(count, 3)
        way = torch.where(self._rand(count, 1) < 0.7, ahead, sideways)
        way = way / way.norm(dim=1, keepdim=True).clamp(min=1e-6)
        which = self._rand(count, 1)
        short, long = (self._between(bounds, count, 1) for bounds in _TOOLS_M)
        length = torch.where(which < _TOOL_SHARES[1], short, long)
        return torch.where(which < _TOOL_SHARES[0], torch.zeros(()), length) * way

    def _reachable(self, hand: int, tip: Tensor, angles: Tensor, persons: Tensor) -> Tensor:
        """(K, 4, 4) of devices in postures of these persons, mostly before the body."""
        count, shape = len(tip), (_CANDIDATES, len(tip))
        middle, half = 0.5 * (self._low + self._high), 0.5 * INSIDE * (self._high - self._low)
        there = middle + half * (2.0 * self._rand(*shape, len(self._low)) - 1.0)
        part = 0.05 + 0.95 * self._rand(1, count, 1)
        part = torch.where(self._rand(1, count, 1) < _NEAR, part, torch.ones(()))
        there = angles + part * (there - angles)
        with torch.no_grad():
            placed = self._policy.forward_model.places(
                there.flatten(0, 1), persons.repeat(_CANDIDATES, 1)
            )[:, hand].reshape(*shape, 4, 4)
        at = tips(placed, tip.expand(*shape, 3))
        weights = torch.where(at[..., 0] > _FRONT_M, torch.ones(()), torch.tensor(_BEHIND)).T
        chosen = torch.multinomial(weights, 1, generator=self.generator)[:, 0]
        return placed[chosen, torch.arange(count)]

    def _draw(self, ids: Tensor, hand: int, angles: Tensor, persons: Tensor) -> None:
        count = len(ids)
        shares = torch.tensor(_SHARES)
        kind = torch.multinomial(shares, count, replacement=True, generator=self.generator)
        tip = self._tips(count)
        with torch.no_grad():
            here = tips(self._policy.forward_model.places(angles, persons)[:, hand], tip)
        pose = self._reachable(hand, tip, angles, persons)
        there = tips(pose, tip)
        onwards = (there - here) / (there - here).norm(dim=1, keepdim=True).clamp(min=0.05)
        onwards = onwards + 0.7 * self._randn(count, 3)
        onwards = onwards / onwards.norm(dim=1, keepdim=True).clamp(min=1e-6)
        speed = self._between(_PASS_MPS, count, 1) * (kind == PASS)[:, None]
        low, high = torch.tensor(_WIDTHS_M).log()
        pointed = (self._rand(count, 1) < _POINTED).float()
        values = {
            "tip": tip,
            "place": there,
            "velocity": speed * onwards,
            "left_s": torch.zeros(count),
            "axis": pointed * pose[:, :3, 0],
            "active": (kind != REST).float(),
            "width": (low + (high - low) * self._rand(count)).exp(),
            "stops": (kind == STOP).float(),
        }
        for name, value in values.items():
            changed = getattr(self.goals, name).clone()
            changed[ids, hand] = value
            setattr(self.goals, name, changed)
        lasts = torch.where(kind == REST, self._between(_REST_S, count), _LONGEST_S)
        self._set(ids, hand, kind, lasts)

    def _set(self, ids: Tensor, hand: int, kind: Tensor, lasts: Tensor) -> None:
        self.kind, self._clock_s = self.kind.clone(), self._clock_s.clone()
        self._until_s = self._until_s.clone()
        self.kind[ids, hand] = kind
        self._clock_s[ids, hand] = 0.0
        self._until_s[ids, hand] = lasts

    # --- a user step -------------------------------------------------------------------------

    @property
    def pursued(self) -> Tensor:
        """(B, H) whether a hand has a goal that its user ends."""
        return (self.kind != REST) & (self.kind != HOLD)

    def distance(self, place: Tensor) -> Tensor:
        """(B, H) how far tips are from their goals with the devices at (B, H, 4, 4), m."""
        return (self.goals.place - tips(place, self.goals.tip)).detach().norm(dim=-1)

    def success(self, place: Tensor, soon: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """(B, H) each: in how far a movement that ends now succeeds, m and m/s it is off."""
        goals = self.goals
        now = tips(place, goals.tip)
        velocity = (tips(soon, goals.tip) - now) / MOMENT_S
        passes = (self.kind == PASS).float()
        off = off_goal(now - goals.place, goals.velocity * passes[..., None])
        slow = (velocity - goals.velocity).square().sum(-1).add(1e-6).sqrt()
        slow = slow * (goals.stops + passes)
        inside = torch.sigmoid((0.5 * goals.width - off) / (_EDGE * goals.width))
        slack = torch.where(
            passes > 0.0, _LIKE * goals.velocity.norm(dim=-1) + _SLACK_MPS, _STILL_MPS
        )
        return inside * torch.exp(-0.5 * (slow / slack).square()), off, slow

    def step(self, place: Tensor, soon: Tensor) -> tuple[Tensor, Tensor]:
        """(B, H) each: reward of a user step that goes on, and of a movement that ends with it.

        Args:
            place: (B, H, 4, 4) where the devices are at its end, differentiable.
            soon: the same ``MOMENT_S`` later.
        """
        worth, goals = self.worth, self.goals
        self._clock_s = self._clock_s + self._step_s
        succeeds, off, slow = self.success(place, soon)
        pointed = (goals.axis.abs().sum(-1) > 0.0).float()
        askew = pointed * (1.0 - (goals.axis * place[..., :3, 0]).sum(-1))
        ends = worth.success_reward * succeeds - worth.miss_cost * (1.0 - succeeds)
        away = (off.square() + 1e-4).sqrt() - 0.01
        ends = (
            ends
            - worth.distance_cost * away
            - 0.5 * worth.success_reward * askew
            - 0.1 * worth.success_reward * slow
        )
        near = torch.exp(-0.5 * (off / (0.5 * goals.width)).square())
        holds = self._step_s * worth.time_cost * (near - 1.0 - slow - 10.0 * away)
        runs = torch.where(self.kind == HOLD, holds, -self._step_s * worth.time_cost)
        runs = torch.where(self.kind == REST, torch.zeros(()), runs)
        self._jump()
        return runs, ends

    def _jump(self) -> None:
        jumps = self._rand(self.n, self.hands) < _JUMPS_HZ * self._step_s
        moved = _JUMP_M * self._randn(self.n, self.hands, 3)
        moves = (jumps & self.pursued)[..., None]
        self.goals.place = torch.where(moves, self.goals.place + moved, self.goals.place)

    def go_on(self, over: Tensor, angles: Tensor, persons: Tensor) -> Tensor:
        """Give new goals after movements that are over, (B, H); returns (K,) users with one."""
        stays = over & (self.kind == STOP) & (self._rand(self.n, self.hands) < _HELD)
        users, hands = torch.nonzero(stays, as_tuple=True)
        for hand in range(self.hands):
            ids = users[hands == hand]
            if len(ids):
                kept = torch.full((len(ids),), HOLD)
                self._set(ids, hand, kept, self._between(_HOLD_S, len(ids)))
        late = self._clock_s > self._until_s - 0.5 * self._step_s
        users, hands = torch.nonzero((over | late) & ~stays, as_tuple=True)
        self.draw(users, hands, angles[users], persons[users])
        return users

    # --- exact resume ------------------------------------------------------------------------

    _STATE = ("kind", "_clock_s", "_until_s")

    def state_dict(self) -> dict[str, Tensor]:
        """Everything that their future depends on."""
        own = {name: getattr(self, name).clone() for name in self._STATE}
        goals = {f"goals.{name}": value.clone() for name, value in self.goals.tensors().items()}
        return own | goals | {"generator": self.generator.get_state()}

    def load_state_dict(self, state: Mapping[str, Tensor]) -> None:
        """Continue from :meth:`state_dict`."""
        for name in self._STATE:
            setattr(self, name, state[name].clone())
        for name in self.goals.tensors():
            setattr(self.goals, name, state[f"goals.{name}"].clone())
        self.generator.set_state(state["generator"])
