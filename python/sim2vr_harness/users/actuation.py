"""From a policy's actions to MuJoCo's controls, for a body with groups of actuators."""

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.users.bodies.body import Body
from sim2vr_harness.users.bodies.rules import RULES, ActionRule, Muscle

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


class Actuation:
    """The action rules of all groups of a body.

    Attributes:
        actuators: (A,) MuJoCo's ids of the actuators, in the order of the actions.
        muscles: (M,) which actions are those of muscles.
        activations: (M,) places of the muscles in MuJoCo's act.
        motors: (S,) which actions are those of actuators whose rule remembers something.
        rest: (A,) actions of a user that does nothing: muscles relax, servos keep their targets.
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
        self.rest = np.array([action for rule, _, _ in self._groups for action in rule.rest])
        self.muscles, self.motors = _indices(muscles), _indices(motors)
        self.activations = _indices(activations)
        names = list(body.action_names)
        self._held = [
            _Servo(body, name, motors.index(names.index(name))) for name in body.reset_rule.held
        ]
        self._loads = _indices([names.index(name) for name in body.effort_inputs.loads])
        self._capacity = body.peak_forces[self._loads]

    def hold(self, memory: FloatArray, qpos: FloatArray) -> None:
        """Has the servos that begin held aim at where their joints are.

        Args:
            memory: (S,) one user's smoothed targets, changed in place.
            qpos: (nq,) posture.
        """
        for servo in self._held:
            target = (qpos[servo.qpos] - servo.low) / servo.span
            memory[servo.slot] = min(max(float(target), 0.0), 1.0)

    def loads(self, act: FloatArray, force: FloatArray) -> FloatArray:
        """Returns (K, M + L) loads that tire: activations, then torques as shares of capacities.

        Args:
            act: (K, M) activations of the muscles.
            force: (K, A) forces and torques of the actuators.
        """
        if len(self._loads) == 0:
            return act
        shares = np.abs(force[:, self._loads]) / self._capacity
        return np.concatenate([act, np.minimum(shares, 1.0)], axis=1)

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


class _Servo:
    """A position servo: its place among the smoothed targets, and its joint's in qpos."""

    def __init__(self, body: Body, name: str, slot: int) -> None:
        model = body.physics_model
        i = model.actuator(name).id
        affine = model.actuator_biastype[i] == mujoco.mjtBias.mjBIAS_AFFINE
        of_joint = model.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_JOINT
        gain, bias = model.actuator_gainprm[i, 0], model.actuator_biasprm[i, 1]
        if not (affine and of_joint and gain == -bias):
            raise ValueError(
                f"reset.hold: got the motor {name!r}, which is no position servo of a joint; "
                "expected a body whose motors all are"
            )
        self.slot = slot
        self.qpos = int(model.jnt_qposadr[model.actuator_trnid[i, 0]])
        self.low, high = model.actuator_ctrlrange[i].tolist()
        self.span = high - self.low


def _indices(values: list[int]) -> IntArray:
    return np.array(values, dtype=np.int64)
