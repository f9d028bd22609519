"""Hands of virtual participants: scripted users who move by the human motor policy."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from sim2vr_harness.policies.hierarchical.human_motor import (
    REFERENCE_M,
    SAME_M,
    HumanHands,
    far_off,
)
from sim2vr_harness.policies.hierarchical.motor_policy import WIDTH_M, WIDTHS_M, MotorGoals
from sim2vr_harness.policies.hierarchical.motor_store import human_policy_for
from sim2vr_harness.policies.scripted.hand import By, Hand, turned

FloatArray = NDArray[np.float64]

_TOGETHER = 12
"""Persons whose matrices are multiplied together: always so many, so that the last bits of a
participant's movement do not depend on how many others play."""
_LEAST_M = 0.4
"""Rays of places that are nearer to the hand turn as if these were so far away."""
_BEFORE_M, _BEHIND_M = 0.025, 0.03
"""A hand that touches something flat stays before it by the first until it is within half of its
radius of the middle, and ends behind it by the second. Both together are less than ``SAME_M``."""


class PersonHand(Hand):
    """A hand that a participant moves: the motor policy decides when it is there."""

    width_m = WIDTH_M
    """Width of the target, m."""
    new = over = False
    """Flags: the place is a new target; the participant considers the movement finished."""
    _target: FloatArray | None = None
    _facing: FloatArray | None = None
    _in_front = _pushes = False

    def follow(self, place: FloatArray, by: By) -> None:
        """Move towards a place, (3,) MuJoCo's world, from this user step on."""
        before = self._target if by == self._by else None
        self.new = self.new or before is None or bool(np.linalg.norm(place - before) >= SAME_M)
        self.over = self.over and not self.new
        self._target, self._by = place, by
        self.place = place
        if self._facing is not None and not self.new:
            position, quat = self._pose
            gap = position + turned(quat, self._tip_m) - place
            ahead = float(gap @ self._facing)
            beside = float(np.linalg.norm(gap - ahead * self._facing))
            self._in_front = self._in_front or ahead > 0.0
            self._pushes = self._pushes or (self._in_front and beside < 0.25 * self.width_m)
            depth = -_BEHIND_M if self._pushes else _BEFORE_M
            self.place = place + depth * self._facing

    def aim(self, width_m: float, facing: FloatArray | None) -> None:
        """Take up a new target; with the direction (3,) in which it faces, it is pushed."""
        self.width_m, self._in_front, self._pushes = width_m, False, False
        self._facing = facing
        if facing is not None and self._target is not None:
            if facing @ (self.position - self._target) < 0.0:
                facing = self._facing = -facing
            self.place = self._target + _BEFORE_M * facing

    def hold_tool(self, place: FloatArray | None) -> None:
        """As of other hands; what was pushed is approached anew."""
        super().hold_tool(place)
        if self._facing is not None:
            self._target = self._facing = None

    @property
    def narrow(self) -> bool:
        """True if the target is narrower than those that the motor policy was trained for."""
        return self.width_m < 0.999 * self.believed_width_m

    def push(self) -> bool:
        """Push what the hand is before, on target or not; False: it has, or nothing is pushed."""
        pushes = self._facing is not None and not self._pushes
        self._pushes = self._pushes or pushes
        self.over = self.over and not pushes
        return pushes

    def off_m(self, place: FloatArray, by: By) -> float:
        """As of other hands; beside something flat, the distance along it."""
        if by == "ray" or self._facing is None:
            return super().off_m(place, by)
        position, quat = self._pose
        gap = position + turned(quat, self._tip_m) - place
        return float(np.linalg.norm(gap - (gap @ self._facing) * self._facing))

    @property
    def turns(self) -> bool:
        """True if the hand points with its ray."""
        return self._by == "ray"

    @property
    def believed_width_m(self) -> float:
        """Width of the target within the trained range of widths; for rays by their angle."""
        if self._by == "touch" or self.place is None:
            width_m = min(self.width_m, _BEHIND_M) if self._pushes else self.width_m
            return float(np.clip(width_m, *WIDTHS_M))
        scale = REFERENCE_M / max(float(np.linalg.norm(self.place - self.position)), _LEAST_M)
        return float(np.clip(scale * self.width_m, *WIDTHS_M)) / scale

    @property
    def tip(self) -> FloatArray:
        """(3,) point that the hand brings to the place, in the device's axes, m."""
        if self._by == "touch" or self.place is None:
            return self._tip_m
        far = np.linalg.norm(self.place - self.position - self.ray.origin_m)
        return self.ray.origin_m + max(float(far), _LEAST_M) * self.ray.direction


class PersonMotor:
    """Moves the participants of a simulation by the human motor policy of their body.

    Args:
        simulation: Of N participants.

    Raises:
        InputError: No human motor policy ships for the body.
    """

    def __init__(self, simulation: Any) -> None:
        self._simulation, config = simulation, simulation.config
        self.policy = human_policy_for(config.user, 1.0 / config.action_frequency_hz)
        count = range(-(-simulation.n // _TOGETHER))
        self._generators = [[torch.Generator() for _ in range(_TOGETHER)] for _ in count]
        self._parts = [
            HumanHands(self.policy, _TOGETHER, self.policy.perception(_TOGETHER, own))
            for own in self._generators
        ]

    def begin(self, user: int, rng: np.random.Generator | None) -> None:
        """Begin an episode of a user with sampled perceptual errors; None: always the same ones."""
        part, row = divmod(user, _TOGETHER)
        self._parts[part].forget([row])
        self._generators[part][row].manual_seed(0 if rng is None else int(rng.integers(2**31)))

    def act(
        self, hands: Sequence[PersonHand], rngs: Sequence[np.random.Generator | None]
    ) -> NDArray[np.float32]:
        """(N, B) actions of the bodies; each hand learns whether its movement is over.

        Args:
            hands: N, which each participant moves.
            rngs: N, draw the ends of movements; None: they end when that is the likelier.
        """
        who = self.policy.persons.of(self._simulation)
        every = self._parts[0].motion(self._simulation.users, who)
        actions = []
        for number, part in enumerate(self._parts):
            own = hands[number * _TOGETHER : (number + 1) * _TOGETHER]
            rows = torch.arange(_TOGETHER).clamp(max=len(own) - 1) + number * _TOGETHER
            motion, goals = every.rows(rows), self._goals(own)
            new = torch.tensor([i for i, hand in enumerate(own) if hand.new], dtype=torch.long)
            part.aim_anew(new, far_off(goals, self.policy.places(motion)[0])[new])
            done, over = part.act(motion, goals)
            actions.append(done[: len(own)])
            for i, hand in enumerate(own):
                rng, side = rngs[number * _TOGETHER + i], self.policy.hands.index(hand.device)
                limit = 0.5 if rng is None else rng.random()
                hand.over, hand.new = bool(over[i, side] > limit), False
        return np.concatenate(actions)

    def _goals(self, hands: Sequence[PersonHand]) -> MotorGoals:
        """Return the goals of a part's participants; hands that go for nothing rest."""
        goals = MotorGoals.none(_TOGETHER, len(self.policy.hands))
        for i, hand in enumerate(hands):
            if hand.place is not None:
                side = self.policy.hands.index(hand.device)
                goals.place[i, side] = torch.from_numpy(hand.place).float()
                goals.tip[i, side] = torch.from_numpy(np.asarray(hand.tip)).float()
                goals.width[i, side] = hand.believed_width_m
                goals.rays[i, side] = float(hand.turns)
                goals.active[i, side] = 1.0
        return goals
