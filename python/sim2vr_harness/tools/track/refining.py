"""Model predictive control: before each step, what muscles could do better is tried.

A motor layer cuts fast strokes short, and shifted goals ask it for the same in vain. So bodies in
the state of the one that follows play some steps ahead, each with one muscle nudged; what that
moves the hand by is a Jacobian, and the change of all muscles that brings the hand nearest is a
damped Gauss-Newton step. It is tried in several sizes, and the best is done for one step, before
all begins anew. Like the correction of goals it needs to know what comes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.users import UserBatch

__all__ = ["AHEAD", "Refinement"]

FloatArray = NDArray[np.float64]

AHEAD = 6
"""Steps that are looked ahead: a stroke takes .2 to .4 s."""
_NUDGE = 0.4
"""By how much one muscle's action is changed to see what it does."""
_EASE_M2 = 15e-4
"""Weight of a whole change of one action beside squared errors: muscles saturate."""
_SIZES = (0.12, 0.25, 0.5, 1.0, 2.0)
"""Shares of a Gauss-Newton step that are tried."""
_ROUNDS = 2
_NEAR_M = 0.01
"""Who will be nearer than this in all steps ahead does as the motor layer says."""


class Refinement:
    """Changes of actions that bring hands nearer to where they shall be.

    Args:
        many: makes N bodies such as the one that follows.
        act: (bodies, step) -> (N, A) actions of the motor layer for the goals of that step.
        misses: (bodies, step) -> (N, E) errors of the hands after that step, m, along each axis.
        steps: of the whole recording.
    """

    def __init__(
        self,
        many: Callable[[int], UserBatch],
        act: Callable[[UserBatch, int], FloatArray],
        misses: Callable[[UserBatch, int], FloatArray],
        steps: int,
    ) -> None:
        self._known, self._tried = many(2), many(len(_SIZES))
        self._actions = len(self._known.body.action_names)
        self._nudged = many(self._actions)
        self._act, self._misses, self._steps = act, misses, steps
        self._plan = np.zeros((AHEAD, self._actions))

    def change(self, state: Mapping[str, Any], step: int) -> FloatArray:
        """(A,) what to add to the motor layer's actions in a step.

        Args:
            state: of the body that follows, at the step's beginning.
            step: which one.
        """
        ahead = min(AHEAD, self._steps - step)
        plan = np.zeros((ahead, self._actions))
        before = self._plan[1 : 1 + ahead]  # what was planned a step ago
        plan[: len(before)] = before
        self._plan = self._planned(state, step, plan)
        first: FloatArray = self._plan[0].copy()
        return first

    def _planned(self, state: Mapping[str, Any], step: int, plan: FloatArray) -> FloatArray:
        plans = np.stack([np.zeros_like(plan), plan])
        cost, plan, missed = self._best(self._known, state, step, plans)
        if np.abs(missed).max() < _NEAR_M:
            return plan
        for round_ in range(_ROUNDS):
            side = 1.0 if (step + round_) % 2 else -1.0
            change = self._step(state, step, plan, missed, side)
            plans = np.clip(plan + np.multiply.outer(_SIZES, change)[:, None], -2.0, 2.0)
            found = self._best(self._tried, state, step, plans)
            if found[0] < cost:
                cost, plan, missed = found
        return plan

    def _best(
        self, bodies: UserBatch, state: Mapping[str, Any], step: int, plans: FloatArray
    ) -> tuple[float, FloatArray, FloatArray]:
        """The least cost, its plan (steps, A), and what is missed by then (steps, E)."""
        missed = self._rolled(bodies, state, step, plans)
        cost = (missed**2).sum((1, 2)) + _EASE_M2 * (plans**2).mean(1).sum(1)
        best = int(np.argmin(cost))
        return float(cost[best]), plans[best], missed[best]

    def _step(
        self,
        state: Mapping[str, Any],
        step: int,
        plan: FloatArray,
        missed: FloatArray,
        side: float,
    ) -> FloatArray:
        """(A,) a damped Gauss-Newton step away from a plan, which misses by (steps, E)."""
        if not np.isfinite(missed).all():
            return np.zeros(self._actions)
        nudges = side * _NUDGE * np.where(np.arange(self._actions) % 2, 1.0, -1.0)
        there = self._rolled(self._nudged, state, step, plan + np.diag(nudges)[:, None])
        there = np.where(np.isfinite(there), there, missed)  # whose simulation broke
        moved = ((there - missed).reshape(self._actions, -1) / nudges[:, None]).T
        normal = moved.T @ moved + _EASE_M2 * np.eye(self._actions)
        asked = moved.T @ missed.ravel() + _EASE_M2 * plan.mean(0)
        return np.clip(-np.linalg.solve(normal, asked), -1.0, 1.0)

    def _rolled(
        self, bodies: UserBatch, state: Mapping[str, Any], step: int, plans: FloatArray
    ) -> FloatArray:
        """(N, steps ahead, E) what bodies miss by who begin alike and add (N, steps, A) plans."""
        for i in range(bodies.n):
            bodies.set_state(i, state)
        missed = []
        for k in range(plans.shape[1]):
            bodies.step(np.clip(self._act(bodies, step + k) + plans[:, k], -1.0, 1.0))
            missed.append(self._misses(bodies, step + k))
        found = np.stack(missed, 1)
        found[bodies.diverged] = np.inf
        return found
