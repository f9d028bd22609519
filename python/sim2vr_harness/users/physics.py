"""The MuJoCo simulations of N users: how they go on, which of them broke, where devices are."""

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import Batch, SimulationError
from numpy.typing import NDArray

from sim2vr_harness.base.errors import unknown_name
from sim2vr_harness.users.actuation import Actuation
from sim2vr_harness.users.bodies.body import Body

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_WARNINGS = {
    warning.name.removeprefix("mjWARN_").lower(): int(warning)
    for warning in mujoco.mjtWarning.__members__.values()
    if warning != mujoco.mjtWarning.mjNWARNING
}
_BROKEN = slice(_WARNINGS["badqpos"], _WARNINGS["badctrl"] + 1)
"""Warnings (of qpos, qvel, qacc, ctrl) after which the motion means nothing; the others (a nearly
singular inertia, a full list of contacts or constraints) make it wrong, and are counted."""

_POS = mujoco.mjtStage.mjSTAGE_POS.value
_ACC = mujoco.mjtStage.mjSTAGE_ACC.value


class Physics:
    """N simulations of one body, user first.

    Kinematics are those of the state after every call; accelerations and forces those of the last
    substep, or of the start.

    Args:
        n: number of users N.
        threads: worker threads, 0 for one per CPU.
        actuation: the body's.

    Attributes:
        batch: MuJoCo's simulations.
        qpos: (N, nq), live, as are the next four: written to, they change the simulation.
        qvel: (N, nv).
        act: (N, na) in MuJoCo's order.
        ctrl: (N, nu) in MuJoCo's order.
        time: (N,) s since the reset.
        motor: (N, S) smoothed targets of motors.
        qacc: (N, nv) accelerations.
        force: (N, nu) forces of the actuators, in MuJoCo's order.
        diverged: (N,) whose simulation broke.
    """

    def __init__(self, body: Body, n: int, threads: int, actuation: Actuation) -> None:
        model = body.physics_model
        self._activations = actuation.activations
        self.batch = Batch(model, n, threads)
        self._state = self.batch.state
        self.qpos, self.qvel = self.batch.bind("qpos"), self.batch.bind("qvel")
        self.act, self.ctrl = self.batch.bind("act"), self.batch.bind("ctrl")
        self.time = self.batch.bind("time")
        self.motor = np.zeros((n, len(actuation.motors)))
        # Fields a call does not compute may hold another simulation's values, so every derived
        # field is copied out right after the call that computed it.
        self._live_qacc = self.batch.bind("qacc")
        self._live_force = self.batch.bind("actuator_force")
        self.qacc, self.force = np.zeros((n, model.nv)), np.zeros((n, model.nu))
        self.diverged = np.zeros(n, dtype=bool)
        self._warning = self.batch.warning

    def rows(self, ids: IntArray) -> IntArray | slice:
        """Return an index of these users; a slice for all, with which nothing is copied."""
        return slice(None) if len(ids) == len(self.diverged) else ids

    @property
    def warnings(self) -> dict[str, IntArray]:
        """(N,) numbers of MuJoCo warnings since the last reset, by kind."""
        counts = np.array(self.batch.warning[:, :, 1], dtype=np.int64)
        return {name: counts[:, k] for name, k in _WARNINGS.items()}

    def reset(self, ids: IntArray) -> None:
        """Clears some simulations, whose state then is to be written, and `start`ed from."""
        self.batch.reset(ids, stage=mujoco.mjtStage.mjSTAGE_NONE.value)
        self.diverged[ids] = False

    def start(self, ids: IntArray) -> None:
        """Works out what follows from a state that was written: poses, accelerations, forces."""
        self.batch.forward(ids, _ACC)
        self.copy_forces(ids)

    def advance(self, ids: IntArray, substeps: int) -> None:
        """Goes on, and flags those that broke."""
        if len(ids) == 0:
            return
        rows = self.rows(ids)
        counts = self._warning[rows, _BROKEN, 1].copy()
        try:
            everyone = len(ids) == len(self.diverged)
            self.batch.step(None if everyone else ids, nstep=substeps, stage=_POS)
        except SimulationError as error:
            self.diverged[error.ids] = True
        broken = (self._warning[rows, _BROKEN, 1] != counts).any(axis=1)
        broken |= ~np.isfinite(self._state[rows]).all(axis=1)
        if broken.any():
            self.diverged[ids[broken]] = True

    def copy_forces(self, ids: IntArray) -> None:
        """Takes over accelerations and forces of the last substep."""
        rows = self.rows(ids)
        self.qacc[rows] = self._live_qacc[rows]
        self.force[rows] = self._live_force[rows]

    def kept(self, ids: IntArray) -> tuple[FloatArray, ...]:
        """Return the state of these users for `put_back`, one row each."""
        rows = self.rows(ids)
        return tuple(x[rows].copy() for x in (self._state, self.qacc, self.force, self.motor))

    def put_back(self, ids: IntArray, kept: tuple[FloatArray, ...]) -> None:
        """Restore the state of these users from `kept`."""
        self._state[ids], self.qacc[ids], self.force[ids], self.motor[ids] = kept
        self.batch.forward(ids, _POS)

    def state_dict(self, i: int) -> dict[str, FloatArray]:
        """Everything that simulation i's future depends on, solver warm start included."""
        return {
            "simulation": self._state[i].copy(),
            "motor": self.motor[i].copy(),
            "qacc": self.qacc[i].copy(),
            "force": self.force[i].copy(),
            "diverged": np.array(self.diverged[i]),
            "warnings": np.array(self.batch.warning[i]),
        }

    def load_state_dict(self, i: int, state: Mapping[str, Any]) -> None:
        """Puts simulation i where `state_dict` says."""
        kept = (state["simulation"], state["qacc"], state["force"], state["motor"])
        self.put_back(np.array([i]), kept)
        self.batch.warning[i] = state["warnings"]
        self.diverged[i] = bool(state["diverged"])

    def set_motion(
        self, qpos: FloatArray, qvel: FloatArray, act: FloatArray, motor: FloatArray
    ) -> None:
        """Does what `UserBatch.set_motion` says."""
        live = {"qpos": self.qpos, "qvel": self.qvel, "motor": self.motor}
        live["act"] = self.act[:, self._activations]
        given = {"qpos": qpos, "qvel": qvel, "motor": motor, "act": act}
        for name, values in given.items():
            if np.shape(values) != live[name].shape:
                raise ValueError(
                    f"{name}: got shape {np.shape(values)}, expected {live[name].shape}"
                )
            if not np.isfinite(values).all():
                raise ValueError(f"{name}: got NaN or infinity, expected finite numbers")
        self.qpos[:], self.qvel[:], self.motor[:] = qpos, qvel, motor
        self.act[:, self._activations] = act
        self.diverged[:] = False


class WornDevices:
    """Poses of every device, end effectors, and heads that were asked to look up or down.

    Args:
        batch: simulations of it.
    """

    def __init__(self, body: Body, batch: Batch) -> None:
        model, n = body.physics_model, batch.nsim
        # Fields a call does not compute may hold another simulation's values, so what is wanted
        # is copied out right after the call that computed it.
        self._site_pos = batch.bind("site_xpos")
        self._body_quat = batch.bind("xquat")
        effectors = [int(model.site(name).id) for name in body.end_effectors]
        self._effectors = np.array(effectors, dtype=np.int64)
        self._sites = {name: int(model.site(name).id) for name in body.devices}
        self._bodies = {name: int(model.body(name).id) for name in body.devices}
        self._pos = {name: np.zeros((1, n, 3)) for name in body.devices}
        self._quat = {name: np.zeros((1, n, 4)) for name in body.devices}
        self.end_effectors = np.zeros((n, len(effectors), 3))
        self.head_pitch_deg = np.full(n, np.nan)

    def copy(self, ids: IntArray, sample: int | slice) -> None:
        """Takes over where everything is now, for some users."""
        rows = slice(None) if len(ids) == len(self.head_pitch_deg) else ids
        self.end_effectors[rows] = self._site_pos[rows][:, self._effectors]
        for name, site in self._sites.items():
            # The OpenXR offset is a translation, so site and body have the same orientation.
            self._pos[name][sample, rows] = self._site_pos[rows, site]
            self._quat[name][sample, rows] = self._body_quat[rows, self._bodies[name]]

    def resize(self, samples: int) -> None:
        """Makes room for the pose samples, filled with the current pose."""
        if samples == self.samples == 1:
            return
        for poses in (self._pos, self._quat):
            for name, kept in poses.items():
                poses[name] = np.repeat(kept[-1:], samples, axis=0)

    @property
    def samples(self) -> int:
        """Number of pose samples that are kept of the last step."""
        return max((len(kept) for kept in self._pos.values()), default=1)

    def hands(self, sample: int) -> FloatArray:
        """(N, 3) the middle of the controllers, m."""
        hands = [poses[sample] for name, poses in self._pos.items() if name != "headset"]
        return np.asarray(np.mean(hands, axis=0))

    def poses(self, name: str, sample: int) -> tuple[FloatArray, FloatArray]:
        """Returns what `UserBatch.device_poses` does."""
        if name not in self._pos:
            raise unknown_name("device", name, self._pos)
        count = len(self._pos[name])
        if not -count <= sample < count:
            raise ValueError(f"sample: got {sample}, expected -{count} to {count - 1}")
        pos, quat = self._pos[name][sample].copy(), self._quat[name][sample].copy()
        if name == "headset":
            turned = ~np.isnan(self.head_pitch_deg)
            if not turned.any():
                return pos, quat
            half = np.radians(self.head_pitch_deg[turned]) / 2.0
            # About y, which points to the left: positive angles turn x forward downwards.
            quat[turned] = 0.0
            quat[turned, 0], quat[turned, 2] = np.cos(half), -np.sin(half)
        return pos, quat
