"""A short trial of an app's executable: handshake, reset, ten steps, one picture."""

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sim2vr_harness.client.base import AppClient, UInt8Array
from sim2vr_harness.client.devices import DevicePoses
from sim2vr_harness.client.launch import is_sim2vr_app, start_sim2vr_app, start_unity_app
from sim2vr_harness.client.protocol1 import Protocol1App
from sim2vr_harness.client.protocol2 import Protocol2Connection
from sim2vr_harness.client.runtime import frame_time_ns

STEPS = 10
FREQUENCY_HZ = 20
HEAD_TURN_RAD = 0.35
"""How far the head turns during the steps, so that the picture of any scene changes."""


@dataclass(frozen=True)
class AppTrial:
    """What an app did over one protocol.

    Attributes:
        protocol: 1 or 2.
        steps: How many it played; fewer than ten when its round ended.
        steps_per_s: Wall-clock speed of these steps, pictures included.
        reward: Sum over the steps.
        images: (steps + 1, H, W, 4), of the reset and of every step.
        announces_protocol2: Whether its handshake says that it also speaks protocol 2.
    """

    protocol: int
    steps: int
    steps_per_s: float
    reward: float
    images: UInt8Array
    announces_protocol2: bool

    @property
    def picture_changes(self) -> bool:
        """Whether any picture differs from the reset's."""
        return bool((self.images != self.images[0]).any())

    def warnings(self) -> list[str]:
        """Return one sentence for each way in which a user could not see in this app."""
        found = []
        if not self.picture_changes:
            found.append(
                "the picture never changed while head and hand moved, expected another one after "
                "each step: does the app apply the poses, and does it draw without a window?"
            )
        for channels, name in ((slice(0, 3), "colour"), (slice(3, 4), "depth")):
            last = self.images[-1][..., channels]
            if not (last != last[0, 0]).any():
                found.append(
                    f"{name} is the same in every pixel of the last picture, expected a scene in "
                    "front of the user"
                )
        return found


def try_app(
    executable: Path,
    arguments: Sequence[str] = (),
    *,
    size: tuple[int, int] = (120, 80),
    timeout_s: float = 60.0,
) -> list[AppTrial]:
    """Start an app and play ten steps over protocol 1, and over protocol 2 if it has it.

    Args:
        executable: A Unity build with the SIM2VR asset, sim2vr-app, or a program like either.
        arguments: Added to those that every app gets.
        size: (width, height) of the app's picture, pixels.
        timeout_s: How long the start and every answer may take.

    Raises:
        AppRefused: The executable, an argument or the picture's size cannot be used.
        AppTimeout, AppDied, ProtocolError: The app gives no answer, ends, or answers nonsense.
    """
    trials: list[AppTrial] = []
    for protocol in (1, 2):
        if protocol == 1 or trials[0].announces_protocol2:
            with _opened(protocol, executable, arguments, size, timeout_s) as app:
                trials.append(_play(app, protocol))
    return trials


@contextmanager
def _opened(
    protocol: int,
    executable: Path,
    arguments: Sequence[str],
    size: tuple[int, int],
    timeout_s: float,
) -> Iterator[AppClient]:
    start = start_sim2vr_app if is_sim2vr_app(executable) else start_unity_app
    starting = start(executable, arguments)
    width, height = size
    try:
        channel = starting.channel(timeout_s, timeout_s)
        app: AppClient
        if protocol == 1:
            app = Protocol1App(
                channel,
                width=width,
                height=height,
                frequency_hz=FREQUENCY_HZ,
                start_timeout_s=timeout_s,
            )
        else:
            app = Protocol2Connection(
                channel, width=width, height=height, start_timeout_s=timeout_s
            ).app(0)
    finally:
        starting.release_port()
    try:
        yield app
    finally:
        app.close()


def _play(app: AppClient, protocol: int) -> AppTrial:
    app.reset(1, _poses(0))
    images = [app.image.copy()]
    reward = 0.0
    began = time.perf_counter()
    for step in range(1, STEPS + 1):
        reply = app.step(frame_time_ns(step, FREQUENCY_HZ), _poses(step))
        reward += reply.reward
        images.append(app.image.copy())
        if reply.finished:
            break
    elapsed_s = time.perf_counter() - began
    announces = isinstance(app, Protocol1App) and app.server is not None
    steps = len(images) - 1
    return AppTrial(protocol, steps, steps / elapsed_s, reward, np.stack(images), announces)


def _poses(step: int) -> DevicePoses:
    """A seated user who turns the head and moves the right hand to the left."""
    done = step / STEPS
    half = 0.5 * HEAD_TURN_RAD * done
    head = [0.0, 1.2, 0.0, 0.0, np.sin(half), 0.0, np.cos(half)]
    hand = [0.25 - 0.3 * done, 1.0, 0.4, 0.0, 0.0, 0.0, 1.0]
    return DevicePoses(head=np.array(head), right_controller=np.array(hand))
