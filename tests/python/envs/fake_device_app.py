"""An app that does what it is told with everything a user wears, and writes down what it got."""

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from sim2vr_harness.client import (
    CAPABILITIES,
    AppClient,
    AppReply,
    DevicePoses,
    HapticPulse,
    SoundEvent,
)


class FakeDeviceApp(AppClient):
    """Its picture shows the number of the drawn frame; 8 x 8 pixels.

    Args:
        haptics: step -> pulses of that step (0: the reset).
        sounds: likewise.
        head_pitch_deg: what it wishes for.
        capabilities: None for all.
    """

    renderer_description = "none"
    image = np.zeros((8, 8, 4), np.uint8)
    capabilities: frozenset[str] = frozenset()

    def __init__(
        self,
        haptics: Mapping[int, tuple[HapticPulse, ...]] | None = None,
        sounds: Mapping[int, tuple[SoundEvent, ...]] | None = None,
        head_pitch_deg: float | None = None,
        capabilities: frozenset[str] | None = None,
        eyes: int = 1,
    ) -> None:
        self.haptics, self.sounds = dict(haptics or {}), dict(sounds or {})
        self.head_pitch_deg = head_pitch_deg
        self.capabilities = frozenset(CAPABILITIES) if capabilities is None else capabilities
        self.image = np.zeros((8, 8, 4) if eyes == 1 else (2, 8, 8, 4), np.uint8)
        self.got: list[DevicePoses] = []
        self.asked: list[int] = []
        self.frames = self.steps = 0

    def head_request(self, seed: int, options: Any = None) -> float | None:
        self.asked.append(seed)
        return self.head_pitch_deg

    def reset(self, seed: int, poses: DevicePoses, options: Any = None, **_: Any) -> AppReply:
        self.got = [poses]
        self.frames = self.steps = 0
        self.image[...] = 0
        return self._reply()

    def start_step(
        self, times_ns: np.ndarray, poses: DevicePoses, *, last: bool = False, drawn: int = -1
    ) -> None:
        self.got.append(poses)
        self.image[...] = self.frames + np.arange(1, len(times_ns) + 1)[drawn]
        self.frames += len(times_ns)
        self.steps += 1

    def finish_step(self) -> AppReply:
        return self._reply()

    def _reply(self) -> AppReply:
        return AppReply(
            0.0,
            False,
            self.steps / 100.0,
            {},
            self.haptics.get(self.steps, ()),
            self.sounds.get(self.steps, ()),
        )

    def save(self) -> bytes:
        return json.dumps([self.frames, self.steps, int(self.image.flat[0])]).encode()

    def load(self, state: bytes) -> None:
        self.frames, self.steps, level = json.loads(state)
        self.image[...] = level

    def close(self) -> None:
        pass
