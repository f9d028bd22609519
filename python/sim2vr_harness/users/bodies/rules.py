"""Action rules: what an action of a policy does to a group of actuators.

A rule turns actions in [-1, 1] into MuJoCo's controls. Numbers follow the User-in-the-Box
reference: an action changes a muscle's activation, and shifts the smoothed target of a motor.

At rest muscles relax: without any activation an arm hangs where gravity and passive forces leave
it, within 4 cm of the starting posture of the `mobl_arms` bodies. Constant activations that balance
the starting posture hold it no better, as the balance is unstable, and a minute of them tires more
(docs/evidence/body_and_alignment.md).
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import ClassVar

import mujoco
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


class ActionRule(ABC):
    """Rule that converts actions to controls of the actuators of one group.

    Args:
        model: the compiled body.
        actuators: names of the A actuators, in the order of their actions.

    Raises:
        ValueError: an actuator is of a kind that the rule cannot work with.
    """

    name: ClassVar[str]
    remembers: ClassVar[bool] = False
    """True if each actuator has a state that persists from step to step."""
    rest: FloatArray
    """(A,) actions of an idle user."""

    def __init__(self, model: mujoco.MjModel, actuators: Sequence[str]) -> None:
        self.ids = np.array([model.actuator(name).id for name in actuators], dtype=np.int64)
        for name, i in zip(actuators, self.ids.tolist(), strict=True):
            self.check(model, i, name)

    @classmethod
    @abstractmethod
    def check(cls, model: mujoco.MjModel, i: int, name: str) -> None:
        """Raises ValueError when actuator i cannot follow this rule."""

    @abstractmethod
    def control(self, action: FloatArray, act: FloatArray, memory: FloatArray) -> FloatArray:
        """Returns (K, A) controls.

        Args:
            action: (K, A) in [-1, 1].
            act: (K, na) activations of all actuators of the body.
            memory: (K, A) what the rule remembers, changed in place; (K, 0) if it does not.
        """


class Muscle(ActionRule):
    """A change of the present activation: ctrl = clip(act + action, 0, 1)."""

    name = "muscle"

    def __init__(self, model: mujoco.MjModel, actuators: Sequence[str]) -> None:
        super().__init__(model, actuators)
        self.rest = np.full(len(self.ids), -1.0)
        self.activations = np.array(model.actuator_actadr[self.ids], dtype=np.int64)

    @classmethod
    def check(cls, model: mujoco.MjModel, i: int, name: str) -> None:
        if model.actuator_dyntype[i] != mujoco.mjtDyn.mjDYN_MUSCLE:
            raise ValueError(
                f"rule: got 'muscle' for actuator {name!r}, whose dyntype is "
                f"{_kind(model, i)!r}; expected one with muscle dynamics"
            )

    def control(self, action: FloatArray, act: FloatArray, memory: FloatArray) -> FloatArray:
        return np.clip(act[:, self.activations] + action, 0.0, 1.0)


class _Ranged(ActionRule):
    """Base of the rules that need a control range."""

    def __init__(self, model: mujoco.MjModel, actuators: Sequence[str]) -> None:
        super().__init__(model, actuators)
        self._low, high = np.array(model.actuator_ctrlrange[self.ids]).reshape(-1, 2).T
        self._span = high - self._low
        self.rest = np.zeros(len(self.ids))

    @classmethod
    def check(cls, model: mujoco.MjModel, i: int, name: str) -> None:
        if not model.actuator_ctrllimited[i]:
            raise ValueError(
                f"rule: got {cls.name!r} for actuator {name!r}, which has no ctrlrange; expected "
                "one with a ctrlrange (low high)"
            )


class Motor(_Ranged):
    """The reference's smoothed position servo.

    m <- 0.1 m + 0.9 clip(m + action, 0, 1) and ctrl = low + m (high - low), with m uniform in
    [0, 1] at a reset.
    """

    name = "motor"
    remembers = True
    KEPT = 0.1
    """Share of the memory that a step keeps."""

    def control(self, action: FloatArray, act: FloatArray, memory: FloatArray) -> FloatArray:
        aim = np.clip(memory + action, 0.0, 1.0)
        memory[:] = self.KEPT * memory + (1.0 - self.KEPT) * aim
        return self._low + memory * self._span


class Direct(_Ranged):
    """The action is the control: -1 is the low end of the ctrlrange, 1 the high one."""

    name = "direct"

    def __init__(self, model: mujoco.MjModel, actuators: Sequence[str]) -> None:
        super().__init__(model, actuators)
        # A control of 0, or the one in the range that is nearest to it.
        self.rest = np.clip(-2.0 * self._low / self._span - 1.0, -1.0, 1.0)

    def control(self, action: FloatArray, act: FloatArray, memory: FloatArray) -> FloatArray:
        return self._low + 0.5 * (action + 1.0) * self._span


RULES: dict[str, type[ActionRule]] = {rule.name: rule for rule in (Muscle, Motor, Direct)}


def usual_rule(model: mujoco.MjModel, i: int) -> str:
    """Returns the rule that actuator i follows unless something else is requested."""
    muscle = model.actuator_dyntype[i] == mujoco.mjtDyn.mjDYN_MUSCLE
    return Muscle.name if muscle else Motor.name


def _kind(model: mujoco.MjModel, i: int) -> str:
    kind = mujoco.mjtDyn(int(model.actuator_dyntype[i])).name
    return kind.removeprefix("mjDYN_").lower()


def moment_arms(model: mujoco.MjModel, data: mujoco.MjData) -> NDArray[np.float64]:
    """(nu, nv) moment arms of all actuators in the posture of the last kinematics, m or 1."""
    moments = np.zeros((model.nu, model.nv))
    mujoco.mju_sparse2dense(
        moments, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind
    )
    return moments
