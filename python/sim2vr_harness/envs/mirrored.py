"""Left-handers among right-handers: who is another's mirror image, at the border to the apps.

Physics knows no left and right. A person who plays with the other hand than the users' body is
therefore that body, seen in a mirror: its devices reach the app reflected across the sagittal plane
and in the other hand, the app plays for that hand, and what comes back is reflected again. Body,
effort, noise and senses notice nothing of it, nor does the policy: the network of a left-hander is
the mirror image of a right-hander's, as the body is.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.client import DevicePoses, HapticPulse, OptionValue, SoundEvent
from sim2vr_harness.client.devices import Hand
from sim2vr_harness.envs.app_group import AppGroup, Logs

IntArray = NDArray[np.int64]

_OTHER: dict[str, Hand] = {"left": "right", "right": "left"}
_POSE = np.array([-1.0, 1.0, 1.0, 1.0, -1.0, -1.0, 1.0])
"""Signs of x right, y up, z forward, and of x y z w: a rotation's axis is a pseudovector."""


class MirroredGroup:
    """Apps of users of which some are mirror images; see :class:`~.app_group.AppGroup`.

    Args:
        group: the apps.
        n: number of users N.
        option: the game's option for the hand that plays.
        hand: with which the users' body plays.
        eyes: 1 or 2.
    """

    def __init__(self, group: AppGroup, n: int, option: str, hand: str, eyes: int) -> None:
        self.drawn_by_gpu = False  # one hand's users play after the other's
        self._group, self._option, self._hand, self._eyes = group, option, hand, eyes
        self._mirrored = np.zeros(n, dtype=bool)
        self.pictures: NDArray[np.uint8] = group.pictures.copy()
        # Lists, dictionaries and arrays that the group changes in place.
        self.apps, self.failed, self.failures = group.apps, group.failed, group.failures
        self.left = group.left
        self.reward, self.finished = group.reward, group.finished
        self.time_feature = group.time_feature
        self._haptics: dict[int, tuple[HapticPulse, ...]] = {}
        self._sounds: dict[int, tuple[SoundEvent, ...]] = {}

    def resume(self, mirrored: NDArray[np.bool_]) -> None:
        """Go on with rounds whose apps have been loaded; (N,) who is a mirror image."""
        self._mirrored[:] = mirrored
        self._begin()
        for rows, _ in self._parts(np.arange(len(mirrored)), None):
            self._take(rows)

    def mirror(self, ids: IntArray, mirrored: NDArray[np.bool_]) -> None:
        """Say who of these users is a mirror image, from the next reset on; (M,) each."""
        self._mirrored[ids] = mirrored

    @property
    def haptics(self) -> Mapping[int, tuple[HapticPulse, ...]]:
        return self._haptics

    @property
    def sounds(self) -> Mapping[int, tuple[SoundEvent, ...]]:
        return self._sounds

    def head_requests(
        self, ids: IntArray, seeds: IntArray, options: Mapping[str, OptionValue] | None
    ) -> NDArray[np.float64]:
        """(M,) pitch in degrees, which is the same in a mirror."""
        return self._group.head_requests(ids, seeds, options)

    def reset(
        self,
        ids: IntArray,
        seeds: IntArray,
        poses: DevicePoses,
        options: Mapping[str, OptionValue] | None,
    ) -> None:
        """Start rounds, each for the hand that its user plays with."""
        self._begin()
        for rows, own in self._parts(ids, options):
            self._group.reset(ids[rows], seeds[rows], self._seen(poses, ids, rows), own)
            self._take(ids[rows])

    def step(
        self,
        ids: IntArray,
        times_ns: IntArray,
        poses: DevicePoses,
        steps: IntArray,
        last: int,
        *,
        drawn: int | IntArray = -1,
    ) -> IntArray:
        """One user step, right-handers first."""
        self._begin()
        answered = []
        for rows, _ in self._parts(ids, None):
            own = drawn if isinstance(drawn, int) else drawn[rows]
            seen = self._seen(poses, ids, rows)
            answered.append(
                self._group.step(ids[rows], times_ns[rows], seen, steps[rows], last, drawn=own)
            )
            self._take(ids[rows])
        found = np.concatenate(answered) if answered else np.zeros(0, dtype=np.int64)
        return np.asarray(ids[np.isin(ids, found)])

    def logs(self) -> Logs:
        """The games' numbers."""
        return self._group.logs()

    def save(self, i: int, step: int) -> bytes | None:
        """The state of a user's app."""
        return self._group.save(i, step)

    def close(self) -> None:
        """End the apps."""
        self._group.close()

    def _parts(
        self, ids: IntArray, options: Mapping[str, OptionValue] | None
    ) -> list[tuple[IntArray, dict[str, OptionValue]]]:
        """Rows of ``ids`` of each hand that is there, and the options of their games."""
        mirrored = self._mirrored[ids]
        parts = []
        for hand, own in ((self._hand, ~mirrored), (_OTHER[self._hand], mirrored)):
            rows = np.flatnonzero(own)
            if len(rows):
                parts.append((rows, {**(options or {}), self._option: hand}))
        return parts

    def _seen(self, poses: DevicePoses, ids: IntArray, rows: IntArray) -> DevicePoses:
        """The devices of one hand's users as their apps get them."""
        own = poses[rows]
        return mirrored_poses(own) if self._mirrored[ids[rows[0]]] else own

    def _begin(self) -> None:
        self._haptics, self._sounds = {}, {}

    def _take(self, ids: IntArray) -> None:
        """Take over what a call has brought to users of one hand."""
        mirrored = bool(self._mirrored[ids[0]])
        pictures = self._group.pictures[ids]
        if mirrored and pictures.size:
            eyes = pictures.reshape(len(ids), self._eyes, -1, *pictures.shape[2:])
            pictures = eyes[:, ::-1, ..., ::-1].reshape(pictures.shape)
        self.pictures[ids] = pictures
        moved = set(ids.tolist())
        for i, pulses in self._group.haptics.items():
            if i in moved:
                self._haptics[i] = tuple(map(_felt, pulses)) if mirrored else pulses
        for i, sounds in self._group.sounds.items():
            if i in moved:
                self._sounds[i] = tuple(map(_heard, sounds)) if mirrored else sounds


def mirrored_poses(poses: DevicePoses) -> DevicePoses:
    """Devices as in a mirror between left and right: the controllers change hands.

    Args:
        poses: rows (..., 7) in the app's frame, and inputs.
    """
    turned = poses.map(lambda rows: rows * _POSE if rows.shape[-1] == len(_POSE) else rows)
    return DevicePoses(
        head=turned.head,
        right_controller=turned.left_controller,
        left_controller=turned.right_controller,
        right_inputs=turned.left_inputs,
        left_inputs=turned.right_inputs,
    )


def _felt(pulse: HapticPulse) -> HapticPulse:
    return replace(pulse, hand=_OTHER[pulse.hand])


def _heard(sound: SoundEvent) -> SoundEvent:
    x, y, z = sound.position_m
    return replace(sound, position_m=(-x, y, z))
