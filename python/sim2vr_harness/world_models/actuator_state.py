"""State of a body's actuators: a number in [0, 1] each, kept between user steps.

Of a muscle it is the activation, of a motor its smoothed target; both are shares of the actuator's
range, so that one body model can have either, or both.
"""

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from sim2vr_harness.users import Body, UserBatch
from sim2vr_harness.users.bodies.rules import RULES, Direct, Motor, Muscle
from sim2vr_harness.world_models.columns import Columns
from sim2vr_harness.world_models.gradient_clipping import within

REST_ACT = 0.15
"""Activations of a body at rest, with arms that neither hang nor co-contract."""


class ActuatorState:
    """The A actuators of a body in the order of its actions, each by the rule of its group.

    Args:
        body: the body with the actuators.
    """

    def __init__(self, body: Body) -> None:
        rules = [RULES[group.rule] for group in body.actuator_groups for _ in group.actuators]
        self.count = len(rules)
        """Number of actuators A."""
        self.muscles, self.motors = _where(rules, Muscle), _where(rules, Motor)
        """Indices of the actions of muscles, and of motors with smoothed targets."""
        self._direct = _where(rules, Direct)
        self.muscle_columns = torch.tensor(self.muscles)
        self._observed = Columns([*self.muscles, *self.motors], self.count)
        self._is_motor = torch.tensor([rule is Motor for rule in rules])
        self._is_direct = torch.tensor([rule is Direct for rule in rules])
        names = body.action_names
        self.names = (
            *(f"{names[i]} act" for i in self.muscles),
            *(f"{names[i]} target" for i in self.motors),
        )
        """Names of the values of :meth:`observe`, as in the proprioception."""
        model = body.physics_model
        ids = [model.actuator(name).id for name in names]
        low, high = np.array(model.actuator_ctrlrange)[ids].T
        low[self.muscles], high[self.muscles] = 0.0, 1.0
        self.low, self.span = low, high - low
        """(A,) controls are ``low + share * span``; a motor's in rad (of a slide m)."""

    def of(self, users: UserBatch) -> NDArray[np.float64]:
        """(N, A) of users in the true game."""
        drives = self.controls(users)
        drives[:, self.muscles] = users.act
        return drives

    def controls(self, users: UserBatch) -> NDArray[np.float64]:
        """(N, A) the last step's controls as shares of their ranges, motor noise included."""
        shares: NDArray[np.float64] = (users.ctrl - self.low) / self.span
        shares[:, self.motors] = users.motor
        return shares

    def control(self, drives: Tensor, actions: Tensor, *, inwards: bool = False) -> Tensor:
        """(B, A) the controls that actions lead to, as shares of their ranges.

        Args:
            drives: (B, A) before the step.
            actions: (B, A), clipped to [-1, 1].
            inwards: whether gradients lead back into the range from beyond it.
        """
        actions = actions.clamp(-1.0, 1.0)
        aim = drives + actions
        aim = within(aim, 0.0, 1.0) if inwards else aim.clamp(0.0, 1.0)
        if len(self.motors):
            smoothed = Motor.KEPT * drives + (1.0 - Motor.KEPT) * aim
            aim = torch.where(self._is_motor, smoothed, aim)
        if len(self._direct):
            aim = torch.where(self._is_direct, 0.5 * (actions + 1.0), aim)
        return aim

    def shares(self, drives: NDArray[np.float64], actions: NDArray[Any]) -> NDArray[np.float64]:
        """Return (N, A) the result of :meth:`control` for NumPy arrays."""
        return np.asarray(self.control(torch.from_numpy(drives), torch.from_numpy(actions)))

    def actions(
        self, drives: NDArray[np.float64], shares: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return (N, A) the nearest actions for controls, given as proportions of their ranges."""
        actions = shares - drives
        motors, direct = self.motors, self._direct
        kept = Motor.KEPT * drives[:, motors]
        actions[:, motors] = (shares[:, motors] - kept) / (1.0 - Motor.KEPT) - drives[:, motors]
        actions[:, direct] = 2.0 * shares[:, direct] - 1.0
        return np.clip(actions, -1.0, 1.0)

    def beyond(self, drives: Tensor, actions: Tensor) -> Tensor:
        """(B,) sum of the squares of how far actions aim beyond the ranges of those that add up."""
        aim = drives + actions
        over = (torch.relu(aim - 1.0) + torch.relu(-aim)).square()
        if len(self._direct):
            over = torch.where(self._is_direct, 0.0, over)
        return over.sum(1)

    def observe(self, drives: Tensor) -> Tensor:
        """(B, F) drives scaled to [-1, 1], in the order of :attr:`names`."""
        return 2.0 * self._observed(drives) - 1.0

    def rest(self, start: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (N, A) rest drives of the random baseline: motors keep their start values."""
        rest = start.copy()
        rest[:, self.muscles] = REST_ACT
        return rest


def _where(rules: list[type], rule: type) -> NDArray[np.int64]:
    return np.array([i for i, each in enumerate(rules) if each is rule], dtype=np.int64)
