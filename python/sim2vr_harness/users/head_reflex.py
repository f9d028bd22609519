"""Head reflex: the head follows the hand, sways and recoils, without actions of the policy.

The heads of the arm bodies are fixed. This reflex moves the headset as the heads of people who
stand and strike with a hand. It turns a little towards the hand and more spontaneously, about the
upper joints of the neck; it sways with the body; and it recoils from the hand, because the common
centre of mass stays in place. Trunk and shoulder do not move, so arm, policy and learned body
models do not depend on it. docs/concepts/people.md has the sources and people's head movements.

Each of five motions (turn left, look down, tilt to the right, sway forward, sway left) is a linear
oscillator with an aim that changes with each user step; where it is within a step follows in closed
form, so that the number of app frames changes no bit of it.
"""

from functools import cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm, solve_discrete_lyapunov

from sim2vr_harness.base.rotations import turned
from sim2vr_harness.base.state import RowState
from sim2vr_harness.users.bodies.body import Body, held

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

HeadMotion = Literal["fixed", "reflex"]

FOLLOWS = 0.1
"""Head rotation as a proportion of the hand's direction: slope in the rounds of nine people, on
average 0.08 about the vertical and 0.06 up and down, range 0 to 0.38. Within 14 degrees the eyes
contribute most of a gaze shift."""
MOST_RAD = np.radians(30.0)
"""Largest direction that counts: people do not watch a hand that hangs down."""
TURNS_HZ = 0.9
"""Natural frequency of head rotation, critically damped. With noise as input the SD of its speed is
2 pi times this frequency times the SD of the angle; from this relation people's frequencies are 0.5
(easy, left) to 1.4 Hz (hard, down)."""
TURNS_RAD = np.radians([2.4, 2.0, 1.6])
"""Standard deviations of spontaneous head rotation: left, down, tilt. They are people's rotations
in the medium condition (2.6, 2.1, 1.4 degrees) without the part that follows the hand."""
SWAY_HZ, SWAY_DAMPING = 0.45, 0.3
"""Natural frequency and damping ratio of postural sway, an inverted pendulum on the ankles with a
spring (Winter et al. 1998)."""
SWAY_M = np.array([0.007, 0.005])
"""Standard deviations at the head, forward and left: those of the centre of mass in quiet stance, 4
and 3 mm (Winter et al. 1998), 1.7 times as high above the ankles."""
RECOIL = 0.02
"""Head displacement against the hand's, as a proportion, until sway brings the head back: the
body's centre of mass stays in place. The arm has 0.0494 of the body mass (de Leva 1996), and its
centre of mass moves 0.4 times as far as the hand. People's proportion is 0.014 to the side, 0.019
forward, and 0 up and down."""
EYES_FORWARD_M, EYES_UP_M = 0.093, 0.01
"""Position of the headset relative to the upper joints of the neck (skull on atlas, atlas on axis),
the centre of small rotations, in the headset's frame: fitted to nine people, 0.07 to 0.11 m
forward, -0.02 to 0.06 m up."""

_OMEGA = 2.0 * np.pi * np.array([TURNS_HZ] * 3 + [SWAY_HZ] * 2)
_DAMPING = np.array([1.0] * 3 + [SWAY_DAMPING] * 2)
_DEVIATIONS = np.concatenate([TURNS_RAD, SWAY_M])
_TURNS, _SWAYS = slice(0, 3), slice(3, 5)


class HeadReflex(RowState):
    """The heads of N users, each with a random stream of its own.

    Args:
        n: number of users N.
        timestep_s: physics step.
        substeps: physics steps per user step.
    """

    _state = ("_start", "_aim", "_hand_m", "_rngs")

    def __init__(self, n: int, timestep_s: float, substeps: int) -> None:
        self._timestep_s, self._substeps = timestep_s, substeps
        self._start = np.zeros((n, 5, 2))
        """Positions and velocities at the beginning of the last step; rad and m."""
        self._aim = np.zeros((n, 5))
        self._rngs = [np.random.default_rng(i) for i in range(n)]
        self._passage = cache(self._made_passage)
        free, driven = self._passage(substeps)
        shares = [
            solve_discrete_lyapunov(free[k], np.outer(driven[k], driven[k]))[0, 0] for k in range(5)
        ]
        self._kicks = _DEVIATIONS / np.sqrt(shares)
        """SDs of the aims per step that give the motions their intended SDs."""
        self._hand_m = np.zeros((n, 2))
        """Positions of the hands at the start of their episodes, x and y of the world."""
        self.reached = substeps
        """Current substep of the step that is being simulated."""

    def _made_passage(self, substeps: int) -> tuple[FloatArray, FloatArray]:
        """Return the transition matrices: (5, 2, 2) of the state and (5, 2) of the aim."""
        whole = np.zeros((5, 3, 3))
        whole[:, 0, 1] = 1.0
        whole[:, 1, 0] = -(_OMEGA**2)
        whole[:, 1, 1] = -2.0 * _DAMPING * _OMEGA
        whole[:, 1, 2] = _OMEGA**2
        passed = np.array([expm(one * substeps * self._timestep_s) for one in whole])
        return passed[:, :2, :2], passed[:, :2, 2]

    def _at(self, substep: int) -> FloatArray:
        """Return (N, 5, 2) positions and velocities at the end of a substep of the last step."""
        free, driven = self._passage(substep)
        # Sums written out: their order, and so every bit, is the same for any N.
        at = np.empty_like(self._start)
        for row in range(2):
            at[..., row] = (
                free[:, row, 0] * self._start[..., 0]
                + free[:, row, 1] * self._start[..., 1]
                + driven[:, row] * self._aim
            )
        return at

    def reset(self, ids: IntArray, seeds: list[int], hands_m: FloatArray) -> None:
        """Heads are where the bodies hold them.

        Args:
            ids: (K,) users.
            seeds: K of their random streams.
            hands_m: (K, 3) where their hands are, MuJoCo world frame.
        """
        self._start[ids], self._aim[ids] = 0.0, 0.0
        self._hand_m[ids] = hands_m[:, :2]
        for i, seed in zip(ids.tolist(), seeds, strict=True):
            self._rngs[i] = np.random.default_rng(seed)

    def begin(
        self,
        ids: IntArray,
        poses: tuple[FloatArray, FloatArray],
        hands_m: FloatArray,
        factors: FloatArray,
    ) -> None:
        """Begins a user step.

        Args:
            ids: (K,) users of this step.
            poses: (K, 3) and (K, 4), poses of the headsets without the reflex.
            hands_m: (K, 3) positions of their hands.
            factors: (K,) factors on the amplitude of a person's head movement.
        """
        self._start[ids] = self._at(self._substeps)[ids]
        drawn = np.array([self._rngs[i].standard_normal(5) for i in ids.tolist()]).reshape(-1, 5)
        aim = self._kicks * drawn
        aim[:, :2] += FOLLOWS * np.clip(direction(*poses, hands_m), -MOST_RAD, MOST_RAD)
        aim *= factors[:, None]
        aim[:, _SWAYS] += RECOIL * (hands_m[:, :2] - self._hand_m[ids])
        self._aim[ids] = aim

    def offsets(self, hands_m: FloatArray, substep: int) -> FloatArray:
        """Return (N, 5) the displacement of the heads by the reflex at the end of a substep.

        The columns are left, down and tilt in rad, forward and left in m.

        Args:
            hands_m: (N, 3) positions of the hands at that time.
            substep: 1 to `substeps`, of the last step.
        """
        at = self._at(substep)[..., 0]
        at[:, _SWAYS] -= RECOIL * (hands_m[:, :2] - self._hand_m)
        return at


def head_reflex(motion: HeadMotion, body: Body, n: int, substeps: int) -> HeadReflex | None:
    """Return the reflex of `n` copies of a body; None: their heads are fixed.

    Raises:
        ValueError: a reflex for a body with a neck, or without a headset or a controller.
    """
    if motion == "fixed":
        return None
    if body.nod is not None or "headset" not in body.devices or not held(body.devices):
        lacks = "a neck of its own" if body.nod else f"the devices {body.devices}"
        raise ValueError(
            f"head: got 'reflex' for a body with {lacks}, expected one with a headset, a "
            "controller and no neck"
        )
    return HeadReflex(n, body.timestep, substeps)


def moved_head(
    pos: FloatArray, quat: FloatArray, offsets: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The headsets' poses, (N, 3) and (N, 4).

    Args:
        pos: (N, 3) where the bodies hold them, m, MuJoCo world frame.
        quat: (N, 4) w x y z.
        offsets: (N, 5) of `HeadReflex.offsets`.
    """
    left, down, tilt = offsets[:, _TURNS].T
    lever = np.array([EYES_FORWARD_M, 0.0, EYES_UP_M])
    nod = _product(_about(down, 2), _about(tilt, 1))
    after = _product(_about(left, 3), _product(quat, nod))
    moved = pos - turned(quat[:, 1:], quat[:, :1], lever)
    moved = moved + turned(after[:, 1:], after[:, :1], lever)
    moved[:, :2] += offsets[:, _SWAYS]
    return moved, after


def direction(pos: FloatArray, quat: FloatArray, point: FloatArray) -> FloatArray:
    """Return (N, 2) directions of points relative to poses: to the left and down, rad.

    Args:
        pos: (N, 3) m.
        quat: (N, 4) w x y z; x forward, y left, z up.
        point: (N, 3) m.
    """
    x, y, z = turned(-quat[:, 1:], quat[:, :1], point - pos).T
    return np.stack([np.arctan2(y, x), np.arctan2(-z, np.hypot(x, y))], axis=1)


def _about(angles: FloatArray, axis: int) -> FloatArray:
    """(N, 4) quaternions of turns about one axis; 1 is x."""
    quat = np.zeros((len(angles), 4))
    quat[:, 0], quat[:, axis] = np.cos(angles / 2.0), np.sin(angles / 2.0)
    return quat


def _product(one: FloatArray, other: FloatArray) -> FloatArray:
    """(N, 4) quaternions: first the other's rotation, then the one's."""
    a, b, c, d = one.T
    w, x, y, z = other.T
    return np.stack(
        [
            a * w - b * x - c * y - d * z,
            a * x + b * w + c * z - d * y,
            a * y - b * z + c * w + d * x,
            a * z + b * y - c * x + d * w,
        ],
        axis=1,
    )
