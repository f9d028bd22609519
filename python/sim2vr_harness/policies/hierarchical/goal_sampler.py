"""Training goals of the motor policy: sequences of goals within reach."""

from collections.abc import Mapping
from dataclasses import replace

import torch
from torch import Tensor

from sim2vr_harness.policies.hierarchical.motor_policy import (
    MOMENT_S,
    MotorGoals,
    describe,
    tips,
)

LEAD_STEPS = 2
"""User steps by which a path's goal is ahead of the hand's current position on the path."""
_REST, _ARRIVE, _FOLLOW = 0, 1, 2
_SHARES = (0.1, 0.62, 0.28)
"""Proportions of sampled goals that rest, arrive and follow a path (including holding still)."""
_STRUCK = 0.35
"""Proportion of arrivals that are strikes: from nearby, through a place, with time to wind up."""
_STRIKE_M, _STRIKE_S, _STRIKE_MPS = (0.04, 0.35), (0.15, 0.7), (0.6, 4.0)
"""Ranges of the distance, time and speed of strikes."""
_SWINGS = 0.5
"""Proportion of paths that are as fast as strikes; the others are as slow as reaching."""
_SLOW_M, _SWING_M = 0.10, 0.15
_SLOW_HZ, _SWING_HZ = (0.15, 1.35), (0.5, 3.0)
_FASTEST_MPS = 3.0
"""Largest speed of paths."""
_HELD = 0.5
"""Proportion of arrivals without speed after which the hand has to hold its position."""
_LONGEST_S = 1.2
_BEHIND = 0.12
"""Sampling weight of goals beside or behind the body, relative to goals in front of it."""
_FRONT_M = 0.12
_BONUS, _NEAR_M = 4.0, 0.02
_LIKE, _STILL_MPS = 0.4, 0.3
"""Tolerance of the velocity at arrival: a proportion of the requested speed, plus m/s."""
_EARLY_S = 0.04
"""Tolerance of the arrival time for movements that pass through a place at the requested speed."""
_BY_M, _BY_MPS, _BY_STRIKE_MPS, _BY_AXIS = 30.0, 1.0, 2.0, 2.0
"""Weights of the reward: cost of the errors of position, of velocity (without and with training in
strikes) and of direction. _BONUS is the reward for an arrival within _NEAR_M."""
_STEP_SHARE = 0.15
"""Proportion of this reward for each user step of following a path."""
_WAVES = 2
_REGION_M, _REGIONS = 0.12, 20
"""Regions of goals: cubes of this size, so many along each side of a cube around the body."""
_MIDDLE_M = 1.0
"""Height of that cube's middle."""
_CANDIDATES = 8
_FORGET, _HARDEST = 0.1, 4.0
"""Update rate of a region's mean error, and the highest relative sampling weight of a region."""
_USUAL_M = 0.04


class GoalSampler:
    """Goals of B users' H hands, drawn anew whenever their time is over.

    Args:
        poses: (P, H, 4, 4) places that the devices can be at, from the body's joints.
        strikes: whether to come through places on time, at the velocity requested, is trained,
            and fast paths are.
    """

    def __init__(
        self, poses: Tensor, n: int, step_s: float, seed: int, *, strikes: bool = False
    ) -> None:
        self.n, self.hands, self._step_s = n, poses.shape[1], step_s
        self._strikes = strikes
        self._poses = poses
        self.tools = True
        """True: points of tools are moved to the goals; False: the hands themselves."""
        self.generator = torch.Generator().manual_seed(seed)
        self.goals = MotorGoals.none(n, self.hands)
        shape = (n, self.hands)
        self._kind = torch.zeros(shape, dtype=torch.long)
        self._clock_s = torch.zeros(shape)
        self._until_s = torch.zeros(shape)
        self._center = torch.zeros(*shape, 3)
        self._hand_goal = torch.zeros(*shape, 3)
        """(B, H, 3) a reachable position of the hand with the tip at its goal."""
        self._wrong_m = torch.full((_REGIONS**3,), 2.0 * _USUAL_M)
        """Mean errors of the arrivals in every region; where no one has been, more than usual."""
        self._waves = torch.zeros(*shape, 3, 3, _WAVES)
        """Amplitude (m), angular frequency (rad/s) and phase of a path, by axis."""
        self.clear()

    def clear(self) -> None:
        """Measure anew."""
        self._errors: dict[str, list[Tensor]] = {"place_m": [], "speed_mps": [], "follow_m": []}

    def measured(self) -> dict[str, float]:
        """Medians since :meth:`clear`: errors of place and speed of arrivals, and of following."""
        return {
            name: float(torch.cat(parts).median()) if parts and torch.cat(parts).numel() else 0.0
            for name, parts in self._errors.items()
        }

    # --- goals -------------------------------------------------------------------------------

    def start(self, ids: Tensor, place: Tensor) -> None:
        """Give users (K,) with their devices at (K, H, 4, 4) goals that have just begun."""
        with torch.no_grad():
            for hand in range(self.hands if len(ids) else 0):
                self._draw(ids, hand, place[:, hand])

    def _rand(self, *shape: int) -> Tensor:
        return torch.rand(*shape, generator=self.generator)

    def _randn(self, *shape: int) -> Tensor:
        return torch.randn(*shape, generator=self.generator)

    def _tips(self, count: int) -> Tensor:
        """(K, 3) points fixed to the device: the hand, tools of all lengths, mostly ahead."""
        if not self.tools:
            return torch.zeros(count, 3)
        ahead = torch.tensor([1.0, 0.0, 0.0]) + 0.35 * self._randn(count, 3)
        sideways = self._randn(count, 3)
        way = torch.where(self._rand(count, 1) < 0.7, ahead, sideways)
        way = way / way.norm(dim=1, keepdim=True).clamp(min=1e-6)
        which = self._rand(count, 1)
        length = torch.where(
            which < 0.4, 0.05 + 0.45 * self._rand(count, 1), 0.5 + 0.6 * self._rand(count, 1)
        )
        return torch.where(which > 0.6, torch.zeros(()), length) * way

    def _draw(self, ids: Tensor, hand: int, place: Tensor) -> None:
        """New goals for a hand of users (K,), whose device is at (K, 4, 4)."""
        count = len(ids)
        kind = torch.multinomial(
            torch.tensor(_SHARES), count, replacement=True, generator=self.generator
        )
        tip = self._tips(count)
        here = tips(place, tip)
        # (K, 4, 4) of devices, drawn of what the body can do, mostly before it.
        reachable_count = len(tip)
        reachable_shape = (_CANDIDATES, reachable_count)
        rows = torch.randint(len(self._poses), reachable_shape, generator=self.generator)
        candidates = self._poses[rows, hand]  # (C, K, 4, 4)
        places = tips(candidates, tip.expand(*reachable_shape, 3))
        weights = torch.where(places[..., 0] > _FRONT_M, torch.ones(()), torch.tensor(_BEHIND))
        hard = self._wrong_m[_regions(candidates[..., :3, 3])] / _USUAL_M
        weights = (weights * hard.clamp(0.4, _HARDEST)).T
        chosen = torch.multinomial(weights, 1, generator=self.generator)[:, 0]
        pose = candidates[chosen, torch.arange(reachable_count)]
        there = tips(pose, tip)
        near = here + 0.12 * self._randn(count, 3)
        there = torch.where(self._rand(count, 1) < 0.2, near, there)
        strikes = self._rand(count, 1) < (_STRUCK if self._strikes else 0.0)
        way = self._randn(count, 3)
        way = way / way.norm(dim=1, keepdim=True).clamp(min=1e-6)
        there = torch.where(strikes, here + self._between(_STRIKE_M, count, 1) * way, there)
        far = (there - here).norm(dim=1)
        speed = 0.3 * torch.exp(self._rand(count) * 2.2)  # 0.3 to 2.7 m/s
        left = (far / speed).clamp(0.1, _LONGEST_S)
        left = torch.where(strikes[:, 0], self._between(_STRIKE_S, count), left)
        left = (left / self._step_s).round() * self._step_s
        onwards = (there - here) / far[:, None].clamp(min=0.05) + 0.7 * self._randn(count, 3)
        onwards = onwards / onwards.norm(dim=1, keepdim=True).clamp(min=1e-6)
        stops = self._rand(count, 1) < 0.45
        velocity = torch.where(stops, torch.zeros(()), (0.2 + 2.6 * self._rand(count, 1)) * onwards)
        struck = self._between(_STRIKE_MPS, count, 1) * onwards
        velocity = torch.where(strikes, struck, velocity)
        follows = kind == _FOLLOW
        # (K, 3, 3, WAVES) waves, and (K, 3) where they are at time 0, from their middle.
        swings = self._rand(count, 1, 1) < (_SWINGS if self._strikes else 0.0)
        shape = (count, 3, _WAVES)
        most = torch.where(swings, torch.tensor(_SWING_M), torch.tensor(_SLOW_M))
        amplitude = most * self._rand(*shape) * self._rand(count, 1, 1)
        slow, fast = self._between(_SLOW_HZ, *shape), self._between(_SWING_HZ, *shape)
        rate = 2.0 * torch.pi * torch.where(swings, fast, slow)
        paths_speed = (amplitude * rate).sum((1, 2)).clamp(min=1e-6)
        amplitude = amplitude * (_FASTEST_MPS / paths_speed).clamp(max=1.0)[:, None, None]
        phase = 2.0 * torch.pi * self._rand(*shape)
        waves, begin = torch.stack([amplitude, rate, phase], 1), (amplitude * phase.sin()).sum(-1)
        pointed = self._rand(count, 1) < 0.25
        axis = torch.where(pointed, pose[:, :3, 0], torch.zeros(()))
        goals = replace(
            MotorGoals.none(count, 1),
            tip=tip[:, None],
            place=there[:, None],
            velocity=velocity[:, None],
            left_s=left[:, None],
            axis=torch.where(follows[:, None] & pointed, place[:, :3, 0], axis)[:, None],
            active=(kind != _REST).float()[:, None],
        )
        column = torch.full_like(ids, hand)
        self.goals.put(ids, column, goals)
        lasts = torch.where(follows, 0.5 + 1.5 * self._rand(count), left)
        lasts = torch.where(kind == _REST, 0.3 + 1.2 * self._rand(count), lasts)
        self._set("_kind", ids, hand, kind)
        self._set("_clock_s", ids, hand, torch.zeros(count))
        self._set("_until_s", ids, hand, lasts)
        self._set("_center", ids, hand, here - begin)
        self._set("_waves", ids, hand, waves)
        self._set("_hand_goal", ids, hand, pose[:, :3, 3])
        self._show_paths()

    def _between(self, bounds: tuple[float, float], *shape: int) -> Tensor:
        low, high = bounds
        return low + (high - low) * self._rand(*shape)

    def _set(self, name: str, ids: Tensor, hand: int, values: Tensor) -> None:
        changed = getattr(self, name).clone()
        changed[ids, hand] = values
        setattr(self, name, changed)

    def _path(self, clock_s: Tensor) -> tuple[Tensor, Tensor]:
        """(B, H, 3) places and velocities on the paths at times (B, H)."""
        amplitude, rate, phase = self._waves.unbind(2)
        angle = rate * clock_s[..., None, None] + phase
        place = self._center + (amplitude * angle.sin()).sum(-1)
        return place, (amplitude * rate * angle.cos()).sum(-1)

    def _show_paths(self) -> None:
        """Move goals on paths ahead of the hand's current position on the path."""
        follows = (self._kind == _FOLLOW)[..., None]
        lead = LEAD_STEPS * self._step_s
        place, velocity = self._path(self._clock_s + lead)
        goals = self.goals
        goals.place = torch.where(follows, place, goals.place)
        goals.velocity = torch.where(follows, velocity, goals.velocity)
        goals.left_s = torch.where(follows[..., 0], torch.tensor(lead), goals.left_s)

    # --- a user step -------------------------------------------------------------------------

    def step(self, place: Tensor, soon: Tensor) -> Tensor:
        """Return (B,) rewards of a user step that ends with the devices at (B, H, 4, 4).

        Args:
            place: poses of the devices, differentiable.
            soon: their poses ``MOMENT_S`` later at constant velocity.
        """
        goals, kind = self.goals, self._kind
        self._clock_s = self._clock_s + self._step_s
        now = tips(place, goals.tip)
        velocity = (tips(soon, goals.tip) - now) / MOMENT_S
        over = self._clock_s > self._until_s - 0.5 * self._step_s
        path_place, path_velocity = self._path(self._clock_s)
        follows = kind == _FOLLOW
        wanted = torch.where(follows[..., None], path_place, goals.place)
        wanted_velocity = torch.where(follows[..., None], path_velocity, goals.velocity)
        through = goals.velocity * (kind == _ARRIVE).float()[..., None] * float(self._strikes)
        off = off_goal(now - wanted, through)
        slow = (velocity - wanted_velocity).square().sum(-1).add(1e-6).sqrt()
        pointed = (goals.axis.abs().sum(-1) > 0.0).float()
        askew = pointed * (1.0 - (goals.axis * place[..., :3, 0]).sum(-1))
        wrong = (off / _NEAR_M).square()
        by_mps = _BY_MPS
        if self._strikes:
            wanted_mps = wanted_velocity.norm(dim=-1)
            wrong = wrong + (slow / (_LIKE * wanted_mps + _STILL_MPS)).square()
            by_mps = _BY_STRIKE_MPS
        worth = _BONUS * torch.exp(-0.5 * wrong)
        worth = worth - _BY_M * ((off.square() + 1e-4).sqrt() - 0.01)
        worth = worth - by_mps * slow - _BY_AXIS * askew
        arrived = over & (kind == _ARRIVE)
        reward = (worth * (arrived.float() + _STEP_SHARE * follows.float())).sum(1)
        with torch.no_grad():
            self._errors["place_m"].append(off[arrived])
            self._errors["speed_mps"].append(slow[arrived])
            self._errors["follow_m"].append(off[follows & (self._clock_s > 0.3)])
            # Take in how far arrivals were off in the regions where the hands should be.
            where = _regions(self._hand_goal[arrived])
            for region, error in zip(where.tolist(), off[arrived].tolist(), strict=True):
                self._wrong_m[region] += _FORGET * (error - float(self._wrong_m[region]))
            goals.left_s = (goals.left_s - self._step_s).clamp(min=0.0)
            still = self.goals.velocity.abs().sum(-1) == 0.0
            stays = arrived & still & (self._rand(*over.shape) < _HELD)
            for hand in range(self.hands):
                ids = torch.nonzero(stays[:, hand]).flatten()
                if len(ids):
                    # Let hands stay where they were to arrive: a path that stands still.
                    self._set("_center", ids, hand, self.goals.place[ids, hand])
                    self._set("_waves", ids, hand, torch.zeros(len(ids), 3, 3, _WAVES))
                    self._set("_kind", ids, hand, torch.full((len(ids),), _FOLLOW))
                    self._set("_clock_s", ids, hand, torch.zeros(len(ids)))
                    self._set("_until_s", ids, hand, 0.3 + 0.5 * self._rand(len(ids)))
                ids = torch.nonzero(over[:, hand] & ~stays[:, hand]).flatten()
                if len(ids):
                    self._draw(ids, hand, place[ids, hand].detach())
            self._show_paths()
        return reward

    def observe(self, place: Tensor, soon: Tensor) -> Tensor:
        """(B, H * GOAL_SIZE) what the layer knows of its goals."""
        return describe(self.goals, place, soon).flatten(1)

    # --- exact resume ------------------------------------------------------------------------

    _STATE = ("_kind", "_clock_s", "_until_s", "_center", "_waves", "_hand_goal", "_wrong_m")

    def state_dict(self) -> dict[str, Tensor]:
        """Return the complete state of the goals."""
        own = {name: getattr(self, name).clone() for name in self._STATE}
        goals = {f"goals.{name}": value.clone() for name, value in self.goals.tensors().items()}
        return own | goals | {"generator": self.generator.get_state()}

    def load_state_dict(self, state: Mapping[str, Tensor]) -> None:
        """Restore a state of :meth:`state_dict`."""
        for name in self._STATE:
            setattr(self, name, state[name].clone())
        for name in self.goals.tensors():
            setattr(self.goals, name, state[f"goals.{name}"].clone())
        self.generator.set_state(state["generator"])


def off_goal(gap: Tensor, velocity: Tensor) -> Tensor:
    """(...) how far off (..., 3) counts, m: along the way through a place, time is forgiven."""
    speed = velocity.norm(dim=-1, keepdim=True)
    way = velocity / speed.clamp(min=1e-6)
    along = (gap * way).sum(-1, keepdim=True)
    slack = _EARLY_S * speed
    forgiven = along - along.clamp(-slack, slack)
    off: Tensor = (gap + (forgiven - along) * way).square().sum(-1).add(1e-8).sqrt()
    return off


def _regions(places: Tensor) -> Tensor:
    """(...) numbers of the regions that places (..., 3) are in."""
    middle = torch.tensor([0.0, 0.0, _MIDDLE_M])
    index = ((places - middle) / _REGION_M).floor().long() + _REGIONS // 2
    index = index.clamp(0, _REGIONS - 1)
    return (index[..., 0] * _REGIONS + index[..., 1]) * _REGIONS + index[..., 2]
