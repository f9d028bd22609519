"""A hand that goes to given places, without learning: muscles worked by the body's own mechanics.

A spring pulls the hand to its goal. Its force, and what gravity and motion ask for, become torques
of the joints that are free to move, and these activations of muscles, as small as will do.
"""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.users.actuation import Actuation
from sim2vr_harness.users.bodies.body import Body
from sim2vr_harness.users.bodies.moments import moment_arms
from sim2vr_harness.users.kinematics.bounded import bounded_least_squares

FloatArray = NDArray[np.float64]

_STIFFNESS_N_M = 250.0
_DAMPING_N_S_M = 45.0
_FURTHEST_M = 0.25
"""The spring pulls no harder than at this distance."""
_JOINT_DAMPING = 0.3
"""N m s: keeps the joints quiet that the hand's place leaves free."""
_EASE = 0.3
"""Weight of activations beside torques, N m: of muscles that pull against each other, less."""


class ReachController:
    """Says what the muscles of a body have to do for a device to come to a place.

    Args:
        body: with muscles, wearing the device.
        device: such as ``controller_right``.

    Raises:
        ValueError: the body has no muscles, or does not wear the device.
    """

    def __init__(self, body: Body, device: str = "controller_right") -> None:
        if device not in body.devices:
            raise ValueError(f"device: got {device!r}, expected one of {', '.join(body.devices)}")
        self._model = body.physics_model
        self._data = mujoco.MjData(self._model)
        self._actuation = Actuation(body)
        if len(self._actuation.muscles) == 0:
            raise ValueError(f"user: got {body.name!r}, expected a body with muscles")
        self._site = int(self._model.site(device).id)
        self._actions = len(body.action_names)
        self.gap_m = float("inf")
        """How far the device was from the goal of the last action."""

    def action(
        self, qpos: FloatArray, qvel: FloatArray, act: FloatArray, goal: FloatArray
    ) -> NDArray[np.float32]:
        """Return the body's action, (A,) in [-1, 1].

        Args:
            qpos: (nq,) posture.
            qvel: (nv,) velocities.
            act: (M,) activations of the muscles.
            goal: (3,) where the device shall go, MuJoCo's frame, m.
        """
        muscles = self._actuation.muscles
        wanted = self._activations(qpos, qvel, goal)
        action = np.zeros(self._actions, np.float32)
        action[muscles] = np.clip(wanted - act, -1.0, 1.0)
        return action

    def holding(self, qpos: FloatArray) -> FloatArray:
        """(M,) the least activations, by the sum of their squares, that hold a posture (nq,)."""
        return self._least(qpos, np.zeros(self._model.nv), self._holding_torques, 0.02)

    def _activations(self, qpos: FloatArray, qvel: FloatArray, goal: FloatArray) -> FloatArray:
        return self._least(qpos, qvel, lambda: self._wanted_torques(goal), _EASE)

    def _least(
        self,
        qpos: FloatArray,
        qvel: FloatArray,
        wanted: Callable[[], FloatArray],
        ease: float,
    ) -> FloatArray:
        """(M,) activations for torques (nv,) that are requested once the posture is set."""
        free, pulls, slack = self._muscles(qpos, qvel)
        torques = free.T @ (wanted() - slack)
        muscles = pulls.shape[1]
        stacked = np.concatenate([pulls, ease * np.eye(muscles)])
        target = np.concatenate([torques, np.zeros(muscles)])
        return bounded_least_squares(stacked, target)

    def _muscles(
        self, qpos: FloatArray, qvel: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Set the posture; return what muscles can do in it.

        Returns:
            (nv, F) directions in which joints can move; (F, M) forces along them of fully active
            muscles beyond those of muscles at rest; (nv,) torques of muscles at rest.
        """
        model, data = self._model, self._data
        data.qpos[:], data.qvel[:] = qpos, qvel
        columns = self._actuation.activations
        data.act[columns] = 1.0
        mujoco.mj_forward(model, data)
        ids = self._actuation.actuators[self._actuation.muscles]
        full = data.actuator_force[ids].copy()
        data.act[columns] = 0.0
        mujoco.mj_forward(model, data)
        slack = data.actuator_force[ids].copy()
        moments = moment_arms(self._model, self._data)[ids]
        free = self._free_directions()
        pulls = free.T @ (moments * (full - slack)[:, None]).T
        return free, pulls, moments.T @ slack

    def _holding_torques(self) -> FloatArray:
        """(nv,) of gravity and of what the joints' springs leave."""
        torques: FloatArray = self._data.qfrc_bias - self._data.qfrc_passive
        return torques

    def _wanted_torques(self, goal: FloatArray) -> FloatArray:
        """(nv,) of gravity, motion and the spring."""
        model, data = self._model, self._data
        jacobian = np.zeros((3, model.nv))
        mujoco.mj_jacSite(model, data, jacobian, None, self._site)
        gap = goal - data.site_xpos[self._site]
        self.gap_m = far = float(np.linalg.norm(gap))
        gap *= min(1.0, _FURTHEST_M / far) if far > 0.0 else 1.0
        force = _STIFFNESS_N_M * gap - _DAMPING_N_S_M * (jacobian @ data.qvel)
        wanted: FloatArray = (
            jacobian.T @ force - _JOINT_DAMPING * data.qvel + self._holding_torques()
        )
        return wanted

    def _free_directions(self) -> FloatArray:
        """(nv, F) directions in which joints can move that hang together by equalities."""
        model, data = self._model, self._data
        if data.ne == 0:
            return np.eye(model.nv)
        jacobian = np.zeros((data.nefc, model.nv))
        if mujoco.mj_isSparse(model):
            mujoco.mju_sparse2dense(
                jacobian, data.efc_J, data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind
            )
        else:
            jacobian[:] = data.efc_J.reshape(data.nefc, model.nv)
        _, sizes, rows = np.linalg.svd(jacobian[: data.ne])
        rank = int((sizes > 1e-8 * sizes[0]).sum())
        free: FloatArray = rows[rank:].T
        return free
