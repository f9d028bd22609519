"""N simulated users stepped side by side on a thread pool.

A user's motion depends on its own seed and actions only: neither the number of threads nor the
other users of the batch change a single bit of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import Batch, SimulationError
from numpy.typing import ArrayLike, NDArray

from sim2vr_harness.users.effort import EffortModel, make_effort
from sim2vr_harness.users.noise import MotorNoise, MotorNoiseSettings
from sim2vr_harness.users.user import User, unknown_name

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

RESET_RANGE = 0.05
"""Start angles (rad) and velocities (rad/s) are uniform in +-this (User-in-the-Box reference)."""

_POS = mujoco.mjtStage.mjSTAGE_POS.value
_ACC = mujoco.mjtStage.mjSTAGE_ACC.value


class UserBatch:
    """N copies of one user, each a simulation of its own.

    All arrays are float64, user first, in MuJoCo's world frame (z up, x forward, y left).
    Properties return copies that stay valid after the next call.

    Poses, `qpos`, `qvel`, `act` and `end_effector_pos` describe the end of the last step. `qacc`
    and the forces of the effort model are those of the last 2 ms substep, the accelerations that
    led to this state. The reference reports poses one substep late as well (by 2.5 mm at median),
    which computing the kinematics once more per step avoids, at 2 % of the step's time; recomputing
    the accelerations too would cost 3.5 % and describe controls that will not be applied.

    A user whose simulation breaks is flagged in `diverged`; MuJoCo also notes its warning in
    MUJOCO_LOG.TXT in the working directory.

    Args:
        user: the body model.
        n: number of users N.
        threads: worker threads, 0 for one per CPU.
        effort: name for `make_effort`, or a ready model for N users.
        effort_weight: factor on the effort cost; None takes the model's default.
        effort_params: further parameters of the effort model.
        noise: motor noise settings; None for none.
        substeps: simulation steps of `user.timestep` per `step`: 25 make 0.05 s (20 Hz).

    Raises:
        ValueError: a number out of range, or an unknown effort model.
    """

    def __init__(
        self,
        user: User,
        n: int,
        *,
        threads: int = 0,
        effort: str | EffortModel = "CumulativeFatigue3CCr",
        effort_weight: float | None = None,
        effort_params: Mapping[str, Any] | None = None,
        noise: MotorNoiseSettings | None = None,
        substeps: int = 25,
    ) -> None:
        for field, value, least in (
            ("n", n, 1),
            ("threads", threads, 0),
            ("substeps", substeps, 1),
        ):
            if int(value) != value or value < least:
                raise ValueError(f"{field}: got {value}, expected a whole number, at least {least}")
        self.user = user
        self.n = n
        self.substeps = substeps
        self.dt = substeps * user.timestep
        self.muscle_count = len(user.muscles)
        self.effort = self._make_effort(effort, effort_weight, effort_params)
        self.noise = MotorNoise(noise, n, self.muscle_count) if noise else None

        model = user.physics_model
        self._batch = Batch(model, n, threads)
        self._state = self._batch.state
        self._qpos, self._qvel = self._batch.bind("qpos"), self._batch.bind("qvel")
        self._act, self._ctrl = self._batch.bind("act"), self._batch.bind("ctrl")
        self._time = self._batch.bind("time")
        # Fields a call does not compute may hold another simulation's values, so every derived
        # field is copied out right after the call that computed it.
        self._live_qacc = self._batch.bind("qacc")
        self._live_force = self._batch.bind("actuator_force")
        self._live_site_pos = self._batch.bind("site_xpos")
        self._live_body_quat = self._batch.bind("xquat")
        self._qacc = np.zeros((n, model.nv))
        self._force = np.zeros((n, model.nu))
        self._tip_site = int(model.site(user.end_effector).id)
        self._tip_pos = np.zeros((n, 3))
        self._device_site = {name: int(model.site(name).id) for name in user.hardware}
        self._device_body = {name: int(model.body(name).id) for name in user.hardware}
        self._device_pos = {name: np.zeros((1, n, 3)) for name in user.hardware}
        self._device_quat = {name: np.zeros((1, n, 4)) for name in user.hardware}
        self._cost = np.zeros(n)
        self._diverged = np.zeros(n, dtype=bool)
        self.reset(np.arange(n), [np.random.default_rng(i) for i in range(n)])

    def _make_effort(
        self, effort: str | EffortModel, weight: float | None, params: Mapping[str, Any] | None
    ) -> EffortModel:
        if isinstance(effort, str):
            settings = {"dt": self.dt, **(params or {})}
            return make_effort(effort, self.n, self.user, weight=weight, **settings)
        if weight is not None or params:
            raise ValueError(
                "effort_weight, effort_params: got values next to a ready effort model, expected "
                "None; give them to the model instead"
            )
        if (effort.n, effort.muscle_count) != (self.n, self.muscle_count):
            raise ValueError(
                f"effort: got a model of {effort.n} users with {effort.muscle_count} muscles, "
                f"expected {self.n} users with {self.muscle_count}"
            )
        return effort

    # --- episode -----------------------------------------------------------------------------

    def reset(
        self,
        ids: Sequence[int] | NDArray[np.integer],
        rngs: Sequence[np.random.Generator],
        postures: Sequence[FloatArray | None] | None = None,
    ) -> None:
        """Starts a new episode for some users.

        Independent joint angles and velocities are uniform in +-0.05 rad (rad/s), dependent ones 0,
        and activations uniform in [0, 1]. Each generator is asked in this order: angles,
        velocities, activations, seed of the motor noise (also when there is none, so that noise
        does not change the start).

        Args:
            ids: (K,) distinct user indices, in any order.
            rngs: K random generators, one per entry of `ids`.
            postures: K postures to start in, (7,) angles of the independent joints in rad, to
                which the dependent joints are fitted; None for a drawn one.

        Raises:
            ValueError: an index out of range or given twice, or another number of generators or
                postures.
        """
        ids = self._checked_ids(ids)
        if len(rngs) != len(ids):
            raise ValueError(f"rngs: got {len(rngs)} generators, expected {len(ids)}, one per id")
        chosen = [None] * len(ids) if postures is None else list(postures)
        if len(chosen) != len(ids):
            raise ValueError(f"postures: got {len(chosen)}, expected {len(ids)}, one per id")
        order = np.argsort(ids)
        ids, rngs, chosen = ids[order], [rngs[k] for k in order], [chosen[k] for k in order]
        if len(ids) == 0:
            return
        self._batch.reset(ids, stage=mujoco.mjtStage.mjSTAGE_NONE.value)
        joints, dofs = self.user.qpos_independent, self.user.qvel_independent
        noise_seeds = []
        for i, rng, posture in zip(ids, rngs, chosen, strict=True):
            self._qpos[i, joints] = rng.uniform(-RESET_RANGE, RESET_RANGE, len(joints))
            self._qvel[i, dofs] = rng.uniform(-RESET_RANGE, RESET_RANGE, len(dofs))
            self._act[i] = rng.uniform(0.0, 1.0, self.muscle_count)
            noise_seeds.append(int(rng.integers(2**63)))
            if posture is not None:
                self._qpos[i] = self.user.coupled_qpos(posture)
        if self.noise is not None:
            self.noise.reset(ids, noise_seeds)
        self._diverged[ids] = False
        self._batch.forward(ids, _ACC)
        self._copy_forces(ids)
        self._copy_poses(ids, slice(None))
        self.effort.reset(ids)
        self._update_effort(ids)

    def step(self, action: ArrayLike, *, pose_samples: int = 1) -> None:
        """Advances every user by one step of `dt` seconds.

        The control is clip(act + action, 0, 1): an action changes the current activation.

        Args:
            action: (N, M) numbers; values outside [-1, 1] are clipped to it.
            pose_samples: how many device poses to keep, evenly spread over the step, the last one
                at its end. Must divide `substeps`; the motion is the same to the bit.

        Raises:
            ValueError: the action has another shape or is not finite, or a wrong `pose_samples`.
        """
        action = self._checked_action(action)
        if pose_samples < 1 or self.substeps % pose_samples:
            raise ValueError(
                f"pose_samples: got {pose_samples}, expected a divisor of substeps={self.substeps}"
            )
        ids = np.flatnonzero(~self._diverged)
        before = self._state[ids].copy()
        ctrl = np.clip(self._act[ids] + np.clip(action[ids], -1.0, 1.0), 0.0, 1.0)
        self._ctrl[ids] = ctrl if self.noise is None else self.noise.apply(ctrl, ids)
        self._resize_poses(pose_samples)
        for sample in range(pose_samples):
            alive = ids[~self._diverged[ids]]
            self._advance(alive, self.substeps // pose_samples)
            self._copy_poses(alive[~self._diverged[alive]], sample)
        lost = self._diverged[ids]
        if lost.any():
            self._freeze(ids[lost], before[lost])
        survivors = ids[~lost]
        self._copy_forces(survivors)
        self._update_effort(survivors)

    def _advance(self, ids: IntArray, substeps: int) -> None:
        """Steps these users and flags those whose simulation broke."""
        if len(ids) == 0:
            return
        warnings = self._batch.warning[ids].copy()
        try:
            self._batch.step(ids, nstep=substeps, stage=_POS)
        except SimulationError as error:
            self._diverged[error.ids] = True
        # Every warning that this contact-free model can raise means a broken simulation.
        warned = (self._batch.warning[ids] != warnings).reshape(len(ids), -1).any(axis=1)
        finite = np.isfinite(self._state[ids]).all(axis=1)
        self._diverged[ids[warned | ~finite]] = True

    def _freeze(self, ids: IntArray, states: FloatArray) -> None:
        """Puts diverged users back to the last finite state, where they stay until reset."""
        self._state[ids] = states
        self._batch.forward(ids, _POS)
        self._copy_poses(ids, slice(None))

    def _update_effort(self, ids: IntArray) -> None:
        if len(ids):
            self._cost[ids] = self.effort.update(
                self._act[ids], self._ctrl[ids], self._force[ids], ids
            )

    # --- what the simulation says ------------------------------------------------------------

    def device_poses(self, name: str, sample: int = -1) -> tuple[FloatArray, FloatArray]:
        """Returns where a device is, as its OpenXR runtime would report it.

        Args:
            name: "headset" or "controller_right".
            sample: which of the last step's `pose_samples`; -1 is the end of the step.

        Returns:
            (N, 3) positions in m and (N, 4) unit quaternions w x y z, MuJoCo world frame.

        Raises:
            ValueError: the user does not wear that device, or there is no such sample.
        """
        if name not in self._device_pos:
            raise ValueError(unknown_name("device", name, self.user.hardware))
        count = len(self._device_pos[name])
        if not -count <= sample < count:
            raise ValueError(f"sample: got {sample}, expected -{count} to {count - 1}")
        return self._device_pos[name][sample].copy(), self._device_quat[name][sample].copy()

    @property
    def act(self) -> FloatArray:
        """(N, M) muscle activations in [0, 1]."""
        return np.array(self._act)

    @property
    def ctrl(self) -> FloatArray:
        """(N, M) muscle controls in [0, 1], with motor noise."""
        return np.array(self._ctrl)

    @property
    def qpos(self) -> FloatArray:
        """(N, nq) joint angles in rad."""
        return np.array(self._qpos)

    @property
    def qvel(self) -> FloatArray:
        """(N, nv) joint velocities in rad/s."""
        return np.array(self._qvel)

    @property
    def qacc(self) -> FloatArray:
        """(N, nv) joint accelerations of the last substep in rad/s^2."""
        return self._qacc.copy()

    @property
    def muscle_force(self) -> FloatArray:
        """(N, M) muscle forces of the last substep in N; pulling is negative."""
        return self._force.copy()

    @property
    def end_effector_pos(self) -> FloatArray:
        """(N, 3) position of the tip of the index finger in m."""
        return self._tip_pos.copy()

    @property
    def effort_cost(self) -> FloatArray:
        """(N,) weighted effort cost of the last step, to be subtracted from the reward."""
        return self._cost.copy()

    @property
    def time(self) -> FloatArray:
        """(N,) seconds since the user's last reset."""
        return np.array(self._time)

    @property
    def diverged(self) -> NDArray[np.bool_]:
        """(N,) whether the simulation broke; such a user stays at its last finite state."""
        return self._diverged.copy()

    # --- save and restore --------------------------------------------------------------------

    def get_state(self, i: int) -> dict[str, Any]:
        """Returns everything that user i's future depends on, as arrays and bytes.

        Includes activations, solver warm start, fatigue and noise streams, so that a restored user
        goes on to the bit. The last step's extra pose samples are not included.
        """
        i = int(self._checked_ids([i])[0])
        state: dict[str, Any] = {
            "simulation": self._state[i].copy(),
            "qacc": self._qacc[i].copy(),
            "force": self._force[i].copy(),
            "effort_cost": self._cost[i].copy(),
            "diverged": np.array(self._diverged[i]),
        }
        state.update({f"effort/{k}": v[i].copy() for k, v in self.effort.state().items()})
        if self.noise is not None:
            state.update({f"noise/{k}": v for k, v in self.noise.get_state(i).items()})
        return state

    def set_state(self, i: int, state: Mapping[str, Any]) -> None:
        """Restores what `get_state` returned, into any user of a batch with the same settings.

        Raises:
            ValueError: an index out of range, a state of another model, effort or noise, or one
                that is not finite.
        """
        i = int(self._checked_ids([i])[0])
        expected = self.get_state(i)
        if set(state) != set(expected):
            raise ValueError(f"state: got keys {sorted(state)}, expected {sorted(expected)}")
        for key, value in expected.items():
            if isinstance(value, np.ndarray) and np.shape(state[key]) != value.shape:
                raise ValueError(
                    f"state {key}: got shape {np.shape(state[key])}, expected {value.shape}"
                )
        if not np.isfinite(state["simulation"]).all():
            raise ValueError("state simulation: got NaN or infinity, expected finite numbers")
        ids = np.array([i])
        self._state[i] = state["simulation"]
        self._batch.forward(ids, _POS)
        self._copy_poses(ids, slice(None))
        self._qacc[i], self._force[i] = state["qacc"], state["force"]
        self._cost[i], self._diverged[i] = state["effort_cost"], bool(state["diverged"])
        effort = {k: state[f"effort/{k}"][None] for k in self.effort.state()}
        self.effort.set_state(effort, ids)
        if self.noise is not None:
            keys = self.noise.get_state(i)
            self.noise.set_state(i, {k: state[f"noise/{k}"] for k in keys})

    # --- helpers -----------------------------------------------------------------------------

    def _copy_forces(self, ids: IntArray) -> None:
        self._qacc[ids] = self._live_qacc[ids]
        self._force[ids] = self._live_force[ids]

    def _copy_poses(self, ids: IntArray, sample: int | slice) -> None:
        self._tip_pos[ids] = self._live_site_pos[ids, self._tip_site]
        for name, site in self._device_site.items():
            # The OpenXR offset is a translation, so site and body have the same orientation.
            self._device_pos[name][sample, ids] = self._live_site_pos[ids, site]
            self._device_quat[name][sample, ids] = self._live_body_quat[
                ids, self._device_body[name]
            ]

    def _resize_poses(self, samples: int) -> None:
        """Makes room for the pose samples, filled with the current pose."""
        for poses in (self._device_pos, self._device_quat):
            for name, kept in poses.items():
                poses[name] = np.repeat(kept[-1:], samples, axis=0)

    def _checked_ids(self, ids: Sequence[int] | NDArray[np.integer]) -> IntArray:
        given = np.asarray(ids)
        if given.ndim != 1 or (given.size and not np.issubdtype(given.dtype, np.integer)):
            raise ValueError(f"ids: got {ids!r}, expected a list of user indices")
        wrong = given[(given < 0) | (given >= self.n)]
        if wrong.size:
            raise ValueError(f"ids: got {int(wrong[0])}, expected 0 to {self.n - 1}")
        if len(np.unique(given)) != len(given):
            raise ValueError(f"ids: got {given.tolist()}, expected each user at most once")
        return given.astype(np.int64)

    def _checked_action(self, action: ArrayLike) -> FloatArray:
        given = np.asarray(action)
        shape = (self.n, self.muscle_count)
        if given.shape != shape:
            raise ValueError(f"action: got shape {given.shape}, expected {shape}")
        if not np.issubdtype(given.dtype, np.number) or np.iscomplexobj(given):
            raise ValueError(f"action: got dtype {given.dtype}, expected real numbers")
        given = given.astype(np.float64)
        wrong = np.argwhere(~np.isfinite(given))
        if len(wrong):
            i, j = (int(k) for k in wrong[0])
            raise ValueError(
                f"action[{i}, {j}] ({self.user.muscles[j]}): got {given[i, j]}, "
                "expected a finite number in [-1, 1]"
            )
        return given
