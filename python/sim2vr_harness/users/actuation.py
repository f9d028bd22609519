"""From a policy's actions to MuJoCo's controls, for a body with groups of actuators."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.users.bodies.body import Body
from sim2vr_harness.users.bodies.rules import RULES, ActionRule, Muscle

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


class Actuation:
    """The action rules of a body's groups, side by side.

    Attributes:
        actuators: (A,) MuJoCo's ids of the actuators, in the order of the actions.
        muscles: (M,) which actions are those of muscles.
        activations: (M,) places of the muscles in MuJoCo's act.
        motors: (S,) which actions are those of actuators whose rule remembers something.
    """

    def __init__(self, body: Body) -> None:
        self._groups: list[tuple[ActionRule, slice, slice]] = []
        column = remembered = 0
        muscles: list[int] = []
        motors: list[int] = []
        activations: list[int] = []
        for group in body.actuator_groups:
            rule = RULES[group.rule](body.physics_model, group.actuators)
            columns = slice(column, column + len(group.actuators))
            held = slice(remembered, remembered + rule.remembers * len(group.actuators))
            self._groups.append((rule, columns, held))
            every = range(columns.start, columns.stop)
            if isinstance(rule, Muscle):
                muscles += every
                activations += rule.activations.tolist()
            if rule.remembers:
                motors += every
            column, remembered = columns.stop, held.stop
        self.actuators = _indices([i for rule, _, _ in self._groups for i in rule.ids.tolist()])
        self.muscles, self.motors = _indices(muscles), _indices(motors)
        self.activations = _indices(activations)

    def controls(self, action: FloatArray, act: FloatArray, memory: FloatArray) -> FloatArray:
        """Returns (K, A) controls, in the order of the actions.

        Args:
            action: (K, A) in [-1, 1].
            act: (K, na) MuJoCo's activations.
            memory: (K, S) of the rules that remember, changed in place.
        """
        controls = np.empty_like(action)
        for rule, columns, held in self._groups:
            controls[:, columns] = rule.control(action[:, columns], act, memory[:, held])
        return controls


def _indices(values: list[int]) -> IntArray:
    return np.array(values, dtype=np.int64)
