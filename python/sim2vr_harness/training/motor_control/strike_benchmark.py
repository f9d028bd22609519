"""Pushes of a human motor policy: how often a tool passes a place with the hand fast enough.

Simulated persons hold a tool that stands 10 cm out of the hand. They settle beside places in front
of the head, and push each of them as in apps. The speed that counts is that of the hand, as in
Whac-A-Mole.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from sim2vr_harness.envs.config import UserConfig
from sim2vr_harness.policies.hierarchical.human_motor import HumanMotorPolicy
from sim2vr_harness.policies.hierarchical.person_layer import PersonLayer
from sim2vr_harness.policies.hierarchical.primitives import (
    MOVES,
    PERSONS,
    OptionChoice,
    PrimitiveController,
)
from sim2vr_harness.policies.hierarchical.workspace import reachable_poses
from sim2vr_harness.training.motor_control.person_course import (
    SAMPLE_S,
    FloatArray,
    PersonCourse,
    one_by_one,
)

_TIP_M, _WIDTH_M = (0.1, 0.0, 0.0), 0.05
"""The point that strikes, in the hand's frame, and the diameter of places."""
_NEED_MPS = 0.8
"""Speed of the hand that a hit needs."""
_AREA_M = ((0.38, 0.42), (-0.3, 0.0), (-0.25, 0.05))
"""Places from the head: forward, left and up."""
_SIDE_M, _ROUNDS, _SETTLE_S, _STRIKE_S = 0.15, 4, 0.8, 1.5
_OVER_S = 0.04
"""Time over which a speed is measured."""


@dataclass(frozen=True)
class StrikeMeasures:
    """K passages of tools through the planes of M places, in their order in time.

    Attributes:
        strikes: M.
        number: (K,) of the place.
        time_s: (K,) from the place's appearance.
        beside_m: (K,) from the middle of the place.
        hand_mps: (K,) speed of the hand along the direction of the strike.
        tip_mps: (K,) speed of the tool's tip.
    """

    strikes: int
    number: NDArray[np.int64]
    time_s: FloatArray
    beside_m: FloatArray
    hand_mps: FloatArray
    tip_mps: FloatArray

    def rows(self) -> list[str]:
        """Return a line for people."""
        return [f"{self.strikes} pushes: tools passed their places {len(self.number)} times"]

    def summary(self) -> dict[str, float]:
        """Return the measures by name with unit."""
        inside = self.beside_m <= 0.5 * _WIDTH_M
        hits = inside & (self.hand_mps >= _NEED_MPS)
        _, first = np.unique(self.number, return_index=True)
        when = [self.time_s[hits & (self.number == k)][:1] for k in range(self.strikes)]
        times = np.concatenate(when) if when else np.zeros(0)
        return {
            "strike_inside": float(inside.mean()) if len(inside) else 0.0,
            "strike_inside_and_fast": float(hits.mean()) if len(hits) else 0.0,
            "strike_first_hits": float(hits[first].sum() / self.strikes),
            "strike_hits_in_1s": float((times <= 1.0).sum() / self.strikes),
            "strike_time_s": float(np.median(times)) if len(times) else float("nan"),
            "strike_hand_mps": float(np.median(self.hand_mps)) if len(hits) else 0.0,
            "strike_tip_mps": float(np.median(self.tip_mps)) if len(hits) else 0.0,
        }


def passages(
    tip: FloatArray, hand: FloatArray, place: FloatArray, direction: FloatArray
) -> StrikeMeasures:
    """Find where tips pass places.

    Args:
        tip: (M, S, 3) paths, every 10 ms, m.
        hand: (M, S, 3) those of the hands.
        place: (M, 3) m.
        direction: (M, 3) unit vectors.
    """
    away = tip - place[:, None]
    along = (away * direction[:, None]).sum(-1)
    beside = np.linalg.norm(away - along[..., None] * direction[:, None], axis=-1)
    over = round(_OVER_S / SAMPLE_S)
    passes = (along[:, over - 1 : -1] < 0.0) & (along[:, over:] >= 0.0)
    number, step = np.nonzero(passes)
    step = step + over
    time_s = SAMPLE_S * step.astype(np.float64)
    speeds = []
    for path in (tip, hand):
        moved = path[number, step] - path[number, step - over]
        speeds.append((moved * direction[number]).sum(-1) / _OVER_S)
    return StrikeMeasures(len(tip), number, time_s, beside[number, step], speeds[1], speeds[0])


def measure_strikes(
    policy: HumanMotorPolicy,
    user: UserConfig,
    *,
    persons: int = 12,
    repeats: int = 4,
    threads: int = 0,
    seed: int = 1,
    on_progress: Callable[[float], None] = lambda share: None,
) -> StrikeMeasures:
    """Measure strikes of persons that no training has had.

    Args:
        policy: what moves them.
        user: configuration with people.
        persons: number of persons.
        repeats: users of each, with four strikes.
        threads: of the physics; 0: all.
        seed: of persons, places and noise.
        on_progress: receives the proportion that is done.
    """
    course = _Strikes(policy, user, persons, repeats, threads, seed)
    parts = one_by_one([course.strike] * _ROUNDS, on_progress)
    tip, hand, place, direction = (np.concatenate(part) for part in zip(*parts, strict=True))
    return passages(tip, hand, place, direction)


class _Strikes(PersonCourse):
    """Persons that strike one place after the other."""

    stream = 94

    def __init__(self, *course: Any) -> None:
        super().__init__(*course)
        policy, seed = self._policy, self._seed
        middle = self._bodies.body.joint_ranges.mean(1)
        self._reset([middle] * self._n, self._rng.integers(2**31, size=self._n))
        self._layer = PersonLayer(policy, self._n, self._who, seed)
        tool = torch.tensor(_TIP_M).expand(len(policy.hands), 2, 3)
        poses = reachable_poses(self._layer, seed)
        self._primitives = PrimitiveController(self._layer, tool, poses, manner=PERSONS)
        self._choice = OptionChoice(self._n, len(policy.hands))

    def strike(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Let everyone settle beside a place, and push it: :func:`passages`'s arguments."""
        head = self._bodies.users.device_poses("headset")[0]
        low, high = np.array(_AREA_M).T
        place = head + self._rng.uniform(low, high, (self._n, 3))
        side = self._rng.standard_normal((self._n, 3)) * [0.0, 1.0, 1.0]
        side /= np.linalg.norm(side, axis=1, keepdims=True)
        self._go("touch", place + _SIDE_M * (side - [1.0, 0.0, 0.0]), _SETTLE_S)
        direction = place - head
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        tip, hand = self._go("push", place, _STRIKE_S)
        return tip, hand, place, direction

    def _go(self, move: str, place: FloatArray, time_s: float) -> tuple[FloatArray, FloatArray]:
        """Let everyone take an option at a place: (N, S, 3) each, paths of tips and hands."""
        choice, users, layer = self._choice, self._bodies.users, self._layer
        choice.move[:, self._hand] = MOVES.index(move)
        choice.place[:, self._hand] = torch.from_numpy(place).float()
        choice.seen = choice.place.clone()
        tips, hands = [], []
        for _ in range(round(time_s / layer.step_s)):
            head = torch.from_numpy(users.device_poses("headset")[0]).float()
            with torch.no_grad():
                motion = layer.motion(users)
                placed = layer.places(*motion[:2])
                goals = self._primitives.goals(choice, head, *placed)
            users.step(layer.decide(motion, placed, goals), pose_samples=self._samples)
            for sample in range(self._samples):
                at, turned = self._poses(sample)
                hands.append(at)
                tips.append(at + _TIP_M[0] * _forward(turned))
        return np.stack(tips, 1), np.stack(hands, 1)


def _forward(turned: FloatArray) -> FloatArray:
    """(N, 3) x axes of frames that are turned by quaternions (N, 4), w x y z."""
    w, x, y, z = turned.T
    return np.stack([1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)], 1)
