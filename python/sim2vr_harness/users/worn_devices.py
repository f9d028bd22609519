"""Device poses of N users, sampled during the last step."""

import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from sim2vr_harness.users.bodies.body import Body
from sim2vr_harness.users.name_errors import unknown_name

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


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
        self.end_effectors[ids] = self._site_pos[np.ix_(ids, self._effectors)]
        for name, site in self._sites.items():
            # The OpenXR offset is a translation, so site and body have the same orientation.
            self._pos[name][sample, ids] = self._site_pos[ids, site]
            self._quat[name][sample, ids] = self._body_quat[ids, self._bodies[name]]

    def resize(self, samples: int) -> None:
        """Makes room for the pose samples, filled with the current pose."""
        for poses in (self._pos, self._quat):
            for name, kept in poses.items():
                poses[name] = np.repeat(kept[-1:], samples, axis=0)

    @property
    def samples(self) -> int:
        """How many moments of the last step are kept."""
        return max((len(kept) for kept in self._pos.values()), default=1)

    def hands(self, sample: int) -> FloatArray:
        """(N, 3) the middle of the controllers, m."""
        hands = [poses[sample] for name, poses in self._pos.items() if name != "headset"]
        return np.asarray(np.mean(hands, axis=0))

    def poses(self, name: str, sample: int) -> tuple[FloatArray, FloatArray]:
        """Returns what `UserBatch.device_poses` does."""
        if name not in self._pos:
            raise ValueError(unknown_name("device", name, self._pos))
        count = len(self._pos[name])
        if not -count <= sample < count:
            raise ValueError(f"sample: got {sample}, expected -{count} to {count - 1}")
        pos, quat = self._pos[name][sample].copy(), self._quat[name][sample].copy()
        if name == "headset":
            turned = ~np.isnan(self.head_pitch_deg)
            half = np.radians(self.head_pitch_deg[turned]) / 2.0
            # About y, which points to the left: positive angles turn x forward downwards.
            quat[turned] = 0.0
            quat[turned, 0], quat[turned, 2] = np.cos(half), -np.sin(half)
        return pos, quat
