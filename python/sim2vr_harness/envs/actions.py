"""Action vector of a policy: actuators, then controller inputs, then gaze."""

from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from sim2vr_harness.base.state import RowState
from sim2vr_harness.client.devices import INPUT_COUNT, input_named
from sim2vr_harness.users.batch import checked_action

SACCADE_S, SACCADE_S_PER_DEG = 0.021, 0.0022
"""Duration of a saccade, and its growth with the amplitude (Carpenter 1988)."""
PURSUIT_DEG_S = 90.0
"""Fastest smooth pursuit (Meyer, Lasker and Robinson 1985)."""
PRESS, RELEASE = 0.33, -0.33
"""A finger presses a button by an action above the one, releases it by one below the other."""

FloatArray = NDArray[np.float64]


class Actions(RowState):
    """The actions of N users, and the fingers and eyes that they control besides the body.

    An analogue input has the value of the action, [-1, 1] mapped linearly to its range. A button is
    pressed by an action above 0.33, released by one below -0.33 and unchanged in between. Both hold
    for the whole user step. If the gaze moves, the last two actions are its direction: smooth
    pursuit follows small changes, a saccade covers larger ones and cannot be stopped. Rounds begin
    with inputs at rest and the gaze straight ahead.

    Args:
        body: names of the body's actions.
        inputs: names of the inputs that the fingers press (client.INPUT_NAMES).
        gaze_range_deg: rotation range of the gaze; 0: it does not move.
        step_s: duration of a user step.
    """

    _state = ("input_values", "gaze_deg", "last", "_goal_deg", "_saccade_s", "blind")

    def __init__(
        self,
        n: int,
        body: tuple[str, ...],
        inputs: tuple[str, ...],
        gaze_range_deg: float,
        step_s: float,
    ) -> None:
        gaze = ("gaze right", "gaze up") if gaze_range_deg else ()
        self.names = (*body, *inputs, *gaze)
        """(A,) names of the actions."""
        self.space = spaces.Box(-1.0, 1.0, (len(self.names),), np.float32)
        self._n, self._body, self._gaze_range_deg = n, len(body), gaze_range_deg
        self._inputs = [input_named(name) for name in inputs]
        self._low = np.array([one.low for one in self._inputs])
        self._digital = np.array([one.digital for one in self._inputs], dtype=bool)
        self.input_values: FloatArray = np.zeros((n, len(inputs)))
        """(N, F) values of the inputs, 0 at rest."""
        self.gaze_deg: FloatArray = np.zeros((n, len(gaze)))
        """(N, 2) gaze, degrees right and up; (N, 0) where it does not move."""
        self._step_s, self._goal_deg, self._saccade_s = step_s, self.gaze_deg.copy(), np.zeros(n)
        self.blind = np.zeros(n, dtype=bool)
        """(N,) True if a saccade goes on at the end of the user step."""
        self.last: FloatArray = np.zeros((n, len(self.names)))
        """(N, A) of the last user step, in [-1, 1]; 0 after a reset."""

    def take(self, actions: ArrayLike) -> Any:
        """Move fingers and eyes; return the body's part.

        Args:
            actions: (N, A) in [-1, 1]; values outside are clipped.

        Raises:
            ValueError: another shape, or numbers that are not finite; nothing has moved.
        """
        if len(self.names) == self._body:
            return actions  # the body checks its own
        given = checked_action(actions, self._n, self.names)
        extra = np.clip(given[:, self._body :], -1.0, 1.0)
        pressing = extra[:, : len(self._inputs)]
        analogue = self._low + (pressing + 1.0) / 2.0 * (1.0 - self._low)
        pressed = (pressing > PRESS) | ((self.input_values > 0.0) & (pressing >= RELEASE))
        self.input_values[...] = np.where(self._digital, pressed, analogue)
        if self._gaze_range_deg:
            # Pursue what is wanted, or go on with the saccade that has begun.
            wanted_deg = extra[:, len(self._inputs) :] * self._gaze_range_deg
            far = np.linalg.norm(wanted_deg - self.gaze_deg, axis=1)
            free = self._saccade_s <= 0.0
            self._goal_deg[free] = wanted_deg[free]
            jumps = free & (far > PURSUIT_DEG_S * self._step_s)
            self._saccade_s[jumps] = SACCADE_S + SACCADE_S_PER_DEG * far[jumps]
            share = np.minimum(1.0, self._step_s / np.maximum(self._saccade_s, 1e-9))
            self.gaze_deg += share[:, None] * (self._goal_deg - self.gaze_deg)
            self._saccade_s[...] = np.maximum(self._saccade_s - self._step_s, 0.0)
            self.blind[...] = self._saccade_s > 0.0
        return given[:, : self._body]

    def remember(self, actions: ArrayLike) -> None:
        """Store the actions of a user step, (N, A)."""
        self.last[...] = actions
        np.clip(self.last, -1.0, 1.0, out=self.last)

    def reset(self, ids: NDArray[np.int64]) -> None:
        """Release all inputs, center the gaze and clear the stored actions of these users."""
        self.last[ids] = 0.0
        self.input_values[ids] = 0.0
        self.gaze_deg[ids] = self._goal_deg[ids] = 0.0
        self._saccade_s[ids], self.blind[ids] = 0.0, False

    def finger_use(self) -> FloatArray:
        """(N,) how far all inputs together are held from rest."""
        use: FloatArray = np.abs(self.input_values).sum(axis=1)
        return use

    def input_rows(self, ids: NDArray[np.int64], frames: int) -> dict[str, FloatArray]:
        """Return rows of inputs for :class:`DevicePoses`, the same in every frame of a step.

        Args:
            ids: (K,) users.
            frames: F per step.

        Returns:
            ``right_inputs`` and ``left_inputs``, (K, F, INPUT_COUNT), of the hands whose fingers
            press inputs.
        """
        rows: dict[str, FloatArray] = {}
        for k, one in enumerate(self._inputs):
            key = f"{one.hand}_inputs"
            row = rows.setdefault(key, np.zeros((len(ids), frames, INPUT_COUNT)))
            row[:, :, one.column] = self.input_values[ids, k, None]
        return rows


def gaze_slopes(gaze_deg: NDArray[Any]) -> NDArray[Any]:
    """Return (K, 2) where gazes (K, 2), degrees right and up, meet a plane 1 m ahead, m."""
    right, up = np.radians(gaze_deg).T
    return np.stack([np.tan(right), np.tan(up) / np.cos(right)], 1)
