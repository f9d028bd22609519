"""A headset and controllers in a page that go where they are put: a user without a body."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.base.rotations import turned
from sim2vr_harness.client.devices import INPUT_COUNT, DevicePoses, input_named
from sim2vr_harness.client.errors import AppRefused
from sim2vr_harness.client.frames import AIM_DIRECTION, position_to_app
from sim2vr_harness.client.runtime import frame_time_ns

if TYPE_CHECKING:
    from sim2vr_harness.client.webxr.app import WebXRApp

FloatArray = NDArray[np.float64]
Ray = tuple[FloatArray, FloatArray]

HZ = 20
HEAD_M = np.array([0.0, 1.2, 0.0])
"""Of a seated person."""
_REST_M = {"right": np.array([0.25, 0.8, 0.15]), "left": np.array([-0.25, 0.8, 0.15])}
_AHEAD = np.array([0.0, 0.0, 1.0])
_SAME_M, _SAME = 0.01, 0.01
"""So much may a ray differ, seen from a device, and still be the device's: origin and direction."""
_SEEN = 3
"""In so many postures a ray must have been the device's."""
_SWAYS, _LEARN_EVERY = 48, 4
"""User steps in which a page shows its rays, and between postures that are compared."""
_TURNS = 4
"""Aiming with a ray that begins beside the hand is repeated so often."""


class SessionEnded(AppRefused):
    """The page ended its session."""


class PageHands:
    """Devices in a page that go where they are put.

    Args:
        app: The page; a round begins.
        seed: Of the round.
        rays: Of the devices, where known.

    Attributes:
        place: Of each controller, m.
        pulses: Vibrations so far.
        on_step: Is called after every user step, for example to show progress.
        rays: By which the page points with each device, in the device's frame: origin and
            direction; without one, the one of WebXR.
    """

    def __init__(self, app: WebXRApp, seed: int = 1, rays: dict[str, Ray] | None = None) -> None:
        self._app, self._step = app, 0
        self.place = {side: place.copy() for side, place in _REST_M.items()}
        self._turn = {side: np.array([0.0, 0.0, 0.0, 1.0]) for side in (*_REST_M, "head")}
        self._held: tuple[str, ...] = ()
        self.pulses = 0
        self.on_step: Callable[[], object] = lambda: None
        self.rays: dict[str, Ray] = {} if rays is None else rays
        self._seen: dict[str, list[tuple[FloatArray, FloatArray, int, int]]] = {}
        self._postures = 0
        app.reset(seed, self._poses())

    def step(self, count: int = 1, *held: str) -> None:
        """Let user steps pass, with inputs such as ``right.trigger`` held.

        Raises:
            SessionEnded: The page ended its session.
        """
        self._held = held
        for _ in range(count):
            self._step += 1
            reply = self._app.step(frame_time_ns(self._step, HZ), self._poses())
            self.pulses += len(reply.haptics)
            self.on_step()
            if reply.finished:
                raise SessionEnded("the page ended its session")

    def put(self, side: str, place: FloatArray, towards: FloatArray | None = None) -> None:
        """Put a controller at a place, its ray through another one."""
        self.place[side] = np.array(place, dtype=np.float64)
        if towards is not None:
            self._turn[side] = self._aimed(side, self.place[side], np.asarray(towards))

    def look(self, place: FloatArray) -> None:
        """Turn the head to a place."""
        self._turn["head"] = self._aimed("head", HEAD_M, np.asarray(place))

    def rest(self) -> None:
        """Look ahead and put both controllers down, their rays ahead and down."""
        self.look(HEAD_M + _AHEAD)
        for side, place in _REST_M.items():
            self.put(side, place, place + np.array([0.0, -0.5, 0.5]))

    def sway(self, step: int) -> None:
        """Move head and controllers a little, each in its own way."""
        self.look(HEAD_M + _AHEAD + 0.1 * np.sin([0.3 * step, 0.4 * step, 0.0]))
        for side, sign in (("right", 1.0), ("left", -1.0)):
            part = np.array([0.35, 0.5, 0.2]) * step + (0.0 if side == "right" else 2.0)
            place = _REST_M[side] + 0.1 * np.sin(part) * [1.0, 0.4, 0.5]
            aside = [0.3 * sign * np.sin(0.31 * step), 0.0, 0.2 * np.cos(0.23 * step)]
            upward = [0.0, 1.0, -0.2] if side == "right" else [0.0, -1.0, 1.0]
            self.put(side, place, place + upward + aside)

    def learn_rays(self) -> None:
        """Note which rays the page tests objects against: those that keep to a device are its."""
        self._postures += 1
        for side in self._turn:
            origin, turn = self.place.get(side, HEAD_M), self._turn[side]
            known = self._seen.setdefault(side, [])
            for start, direction in self._app.signs().rays:
                begin = turned(-turn[:3], turn[3], np.array(start) - origin)
                along = turned(-turn[:3], turn[3], direction)
                self._note(known, begin, along / max(float(np.linalg.norm(along)), 1e-9))
            best = max(known, key=lambda one: one[2], default=None)
            if best is not None and best[2] >= _SEEN:
                self.rays[side] = best[0], best[1]

    def _note(
        self,
        known: list[tuple[FloatArray, FloatArray, int, int]],
        begin: FloatArray,
        along: FloatArray,
    ) -> None:
        for k, (first, way, count, posture) in enumerate(known):
            near = np.linalg.norm(first - begin) < _SAME_M and np.linalg.norm(way - along) < _SAME
            if near and posture != self._postures:
                known[k] = first, way, count + 1, self._postures
            if near:
                return
        known.append((begin, along, 1, self._postures))

    def _aimed(self, side: str, place: FloatArray, towards: FloatArray) -> FloatArray:
        """The rotation with which the device's ray goes from a place through another one."""
        plain = _AHEAD if side == "head" else _RAY
        begin, along = self.rays.get(side, (np.zeros(3), plain))
        gap = towards - place
        turn = _turn(along, gap)
        for _ in range(_TURNS if begin.any() else 0):
            turn = _turn(along, towards - place - turned(turn[:3], turn[3], begin))
        return turn

    def _poses(self) -> DevicePoses:
        inputs = {side: np.zeros(INPUT_COUNT) for side in _REST_M}
        for name in self._held:
            inputs[name.partition(".")[0]][input_named(name).column] = 1.0
        rows = {side: np.r_[self.place[side], self._turn[side]] for side in _REST_M}
        head = np.r_[HEAD_M, self._turn["head"]]
        return DevicePoses(head, rows["right"], rows["left"], inputs["right"], inputs["left"])


def find_rays(app: WebXRApp) -> dict[str, Ray]:
    """Begin a round; return the rays by which the page points, see :attr:`PageHands.rays`."""
    hands = PageHands(app)
    for step in range(_SWAYS):
        if step % _LEARN_EVERY == 0:
            app.things()  # whose tests against rays are watched from then on
            hands.learn_rays()
        hands.sway(step)
        # A page that tests rays when a trigger is pulled shows them then.
        hands.step(1, *(["right.trigger", "left.trigger"] if step % 16 in (8, 9) else []))
    return hands.rays


_RAY = position_to_app(AIM_DIRECTION)


def _turn(first: FloatArray, second: FloatArray) -> FloatArray:
    """(4,) x y z w: the shortest turn that brings one direction onto another."""
    goal = second / max(float(np.linalg.norm(second)), 1e-9)
    turn = np.r_[np.cross(first, goal), 1.0 + first @ goal]
    length = float(np.linalg.norm(turn))
    found: FloatArray = turn / length if length > 1e-6 else np.array([1.0, 0.0, 0.0, 0.0])
    return found
