"""Interactive things of a WebXR page: found by what they listen to, and by trying them.

The devices move without a body: what the page does with a controller counts, not who gets there.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.audit.targets import AuditTarget, How, TargetSettings
from sim2vr_harness.base.errors import InputError
from sim2vr_harness.client import AppRefused, DevicePoses, WebXRApp
from sim2vr_harness.client.devices import INPUT_COUNT, input_named
from sim2vr_harness.client.frames import AIM_DIRECTION, position_to_app
from sim2vr_harness.client.runtime import frame_time_ns
from sim2vr_harness.client.webxr.replies import Thing
from sim2vr_harness.envs.apps import apps_wanted
from sim2vr_harness.envs.config import EnvConfig

__all__ = ["FoundThing", "PageHands", "find_things", "located", "page_app", "things_as_targets"]

FloatArray = NDArray[np.float64]

_HZ = 20
_HEAD_M = np.array([0.0, 1.2, 0.0])
"""Of a seated person."""
_REST_M = {"right": np.array([0.25, 0.8, 0.15]), "left": np.array([-0.25, 0.8, 0.15])}
_AIM_FROM_M = np.array([0.15, 0.9, 0.2])
_MOST_PROBED = 80
_ROUNDS = ("right", "left")
"""Hands that try things, one after the other: some things are ready later only."""
_GAZE_STEPS = 50
"""User steps for which the head looks at a thing; some wait so long before they react."""
_PULL_M = np.array([0.0, 0.0, 0.15])
_LARGEST_M = 2.0
"""Half of the size, from which a thing is a room or a ground."""
_CARRIED_M = 0.02
_MOVED_M = 0.02
_UP = np.array([0.0, 1.0, -0.2])


@dataclass
class FoundThing:
    """A thing of a page.

    Attributes:
        name: Of the page, or its kind.
        how: What is done with it.
        place_m: Where it came nearest to the head: right, up, ahead.
        half_m: Halves of its size along the three axes, the smallest first.
        moves: Whether it moves by itself.
        listens: Whether the page listens to it or tests rays against it.
        reacts: Whether it did something when a controller touched it or pointed at it.
    """

    name: str
    how: How
    place_m: FloatArray
    half_m: tuple[float, ...]
    moves: bool
    listens: bool
    reacts: bool

    @property
    def radius_m(self) -> float:
        """How near is enough: to touch a flat thing its thickness counts, for a ray its width."""
        return self.half_m[0 if self.how == "touch" else 1]


@contextmanager
def page_app(env: EnvConfig) -> Iterator[WebXRApp]:
    """Open the page of an environment, without its task."""
    with WebXRApp(apps_wanted(env, 1)) as app:
        yield app


class PageHands:
    """Controllers in a page that go where they are put.

    Args:
        app: The page; a round begins.
        seed: Of the round.
    """

    def __init__(self, app: WebXRApp, seed: int = 1) -> None:
        self._app, self._step = app, 0
        self.place = {side: place.copy() for side, place in _REST_M.items()}
        self._towards = {side: np.array([0.0, 0.0, 1.0]) for side in _REST_M}
        self._held: tuple[str, ...] = ()
        self._gaze = np.array([0.0, 0.0, 1.0])
        self.pulses = 0
        """Vibrations so far."""
        app.reset(seed, self._poses())

    def step(self, count: int = 1, *held: str) -> None:
        """Let user steps pass, with inputs such as ``right.trigger`` held."""
        self._held = held
        for _ in range(count):
            self._step += 1
            reply = self._app.step(frame_time_ns(self._step, _HZ), self._poses())
            self.pulses += len(reply.haptics)
            if reply.finished:
                raise AppRefused("the page ended its session")

    def put(self, side: str, place: FloatArray, towards: FloatArray | None = None) -> None:
        """Put a controller at a place, its ray through another one."""
        self.place[side] = np.array(place, dtype=np.float64)
        if towards is not None:
            gap = np.asarray(towards) - self.place[side]
            self._towards[side] = gap / max(float(np.linalg.norm(gap)), 1e-9)

    def look(self, place: FloatArray) -> None:
        """Turn the head to a place."""
        gap = place - _HEAD_M
        self._gaze = gap / max(float(np.linalg.norm(gap)), 1e-9)

    def rest(self) -> None:
        """Look ahead and put both controllers down, their rays ahead and down."""
        self._gaze = np.array([0.0, 0.0, 1.0])
        for side, place in _REST_M.items():
            self.put(side, place, place + np.array([0.0, -0.5, 0.5]))

    def _poses(self) -> DevicePoses:
        inputs = {side: np.zeros(INPUT_COUNT) for side in _REST_M}
        for name in self._held:
            inputs[name.partition(".")[0]][input_named(name).column] = 1.0
        rows = {side: np.r_[self.place[side], _turn(_RAY, self._towards[side])] for side in _REST_M}
        head = np.r_[_HEAD_M, _turn(np.array([0.0, 0.0, 1.0]), self._gaze)]
        return DevicePoses(head, rows["right"], rows["left"], inputs["right"], inputs["left"])


_RAY = position_to_app(AIM_DIRECTION)


def _turn(first: FloatArray, second: FloatArray) -> FloatArray:
    """(4,) x y z w: the shortest turn that brings one direction onto another."""
    turn = np.r_[np.cross(first, second), 1.0 + first @ second]
    length = float(np.linalg.norm(turn))
    found: FloatArray = turn / length if length > 1e-6 else np.array([1.0, 0.0, 0.0, 0.0])
    return found


def find_things(env: EnvConfig, seconds: float = 4.0, *, probe: bool = True) -> list[FoundThing]:
    """Find the interactive things of a page.

    First nothing happens for some time, so that what moves by itself is known. Then a controller
    touches and points at each thing, with trigger and squeeze.

    Args:
        env: Names the page.
        seconds: How long nothing happens.
        probe: Whether to try the things; otherwise those are found that the page listens to.

    Raises:
        AppRefused, AppError: The page does not play.
    """
    with page_app(env) as app:
        hands = PageHands(app)
        seen = _watched(app, hands, seconds)
        found = [
            FoundThing(
                track.name,
                "touch" if track.how == "unknown" else track.how,  # type: ignore[arg-type]
                track.nearest_m,
                track.half_m,
                track.moves,
                track.how != "unknown",
                reacts=False,
            )
            for track in seen
        ]
        if probe:
            _probe_all(app, hands, found, {track.name for track in seen if track.changes})
    return [thing for thing in found if thing.listens or thing.reacts]


@dataclass
class _Track:
    name: str
    how: str
    nearest_m: FloatArray
    half_m: tuple[float, ...]
    first_m: FloatArray
    state: int
    offset_m: dict[str, FloatArray]
    moves: bool = False
    changes: bool = False
    apart: int = 0

    def add(self, thing: Thing, place: dict[str, FloatArray]) -> None:
        """Look at a moment."""
        now = np.array(thing.place_m)
        if np.linalg.norm(now - _HEAD_M) < np.linalg.norm(self.nearest_m - _HEAD_M):
            self.nearest_m = now
        self.moves |= bool(np.linalg.norm(now - self.first_m) > _MOVED_M)
        self.changes |= thing.state != self.state
        self.how = thing.how if self.how == "unknown" else self.how
        far = [np.linalg.norm(now - place[s] - self.offset_m[s]) > _CARRIED_M for s in place]
        self.apart += all(far)


def _watched(app: WebXRApp, hands: PageHands, seconds: float) -> list[_Track]:
    """Return what there is while nothing happens but hands that move, the right one pointing up.

    Objects that move with a hand or surround the head are left out.
    """
    tracks: dict[str, _Track] = {}
    hands.rest()
    steps = max(8, round(seconds * _HZ))
    for step in range(steps):
        if step % 4 == 0:
            for thing in app.things():
                if thing.name not in tracks:
                    place = np.array(thing.place_m)
                    offsets = {side: place - at for side, at in hands.place.items()}
                    half = tuple(sorted(thing.half_m))
                    tracks[thing.name] = _Track(
                        thing.name, thing.how, place, half, place, thing.state, offsets
                    )
                tracks[thing.name].add(thing, hands.place)
        sway = 0.1 * np.sin(0.35 * step) * np.array([1.0, 0.3, 0.5])
        for side, at in _REST_M.items():
            hands.put(
                side, at + sway, at + sway + (_UP if side == "right" else 0.0 * _UP + [0, -1, 1])
            )
        # A page that tests rays when a trigger is pulled shows against what.
        hands.step(1, *(["right.trigger", "left.trigger"] if step % 16 in (8, 9) else []))
    names = {thing.name: thing for thing in app.things()}
    return [
        track
        for name, track in tracks.items()
        if (track.apart or not track.moves) and not _surrounds(names.get(name))
    ]


def _surrounds(thing: Thing | None) -> bool:
    """Whether something is a room, a sky or a ground."""
    if thing is None:
        return False
    half = np.array(thing.half_m)
    inside = bool((np.abs(np.array(thing.place_m) - _HEAD_M) < half).all())
    return inside or float(half.max()) > _LARGEST_M


def _probe_all(
    app: WebXRApp, hands: PageHands, found: list[FoundThing], restless: set[str]
) -> None:
    for side in _ROUNDS:
        for thing in [each for each in found if not each.reacts][:_MOST_PROBED]:
            ways: Sequence[How] = ("touch", "point")
            if thing.how == "look":
                ways = ("look",)
            elif thing.listens and thing.how != "touch":
                ways = ("point", "touch")
            for how in ways:
                if _reacts(app, hands, thing, how, side, thing.name in restless):
                    thing.reacts = True
                    thing.how = how
                    break


def _reacts(
    app: WebXRApp, hands: PageHands, thing: FoundThing, how: How, side: str, restless: bool
) -> bool:
    """Whether a thing reacts to a controller; restless ones must hear of it or vanish.

    The controller gets there, pulls the trigger, moves back, and does the same with the squeeze.
    """
    before = _named(app, thing.name)
    if before is None:
        return False
    place, pulses = np.array(before.place_m), hands.pulses
    mirror = np.array([1.0 if side == "right" else -1.0, 1.0, 1.0])

    def reacted() -> bool:
        now = _named(app, thing.name)
        if now is None or now.events > before.events or hands.pulses > pulses:
            return True
        moved = float(np.linalg.norm(np.array(now.place_m) - place)) > _MOVED_M
        return not restless and (moved or now.state != before.state)

    for name in ("trigger", "squeeze"):
        if how == "touch":
            start = hands.place[side]
            for part in (0.7, 0.9, 1.0):
                at = start + part * (place - start)
                hands.put(side, at, at + np.array([0.0, -0.3, 1.0]))
                hands.step(1)
        elif how == "look":
            hands.look(place)
            hands.step(_GAZE_STEPS)
        else:
            hands.put(side, _AIM_FROM_M * mirror, place)
            hands.step(2)
        hands.step(2)
        done = reacted()
        hands.step(2, f"{side}.{name}")
        if how == "touch" and not done:
            hands.put(side, hands.place[side] - _PULL_M, place + np.array([0.0, -0.3, 1.0]))
            hands.step(2, f"{side}.{name}")
        done = done or reacted()
        hands.step(2)
        if done or reacted():
            hands.rest()
            hands.step(2)
            return True
    hands.rest()
    hands.step(2)
    return reacted()


def _named(app: WebXRApp, name: str) -> Thing | None:
    return next((each for each in app.things() if each.name == name), None)


def things_as_targets(found: Sequence[FoundThing]) -> list[AuditTarget]:
    """Return targets for an audit."""
    return [
        AuditTarget(each.name, each.place_m, how=each.how, radius_m=each.radius_m) for each in found
    ]


def located(listed: Sequence[TargetSettings], env: EnvConfig | None) -> list[AuditTarget]:
    """Return targets with their places; those of objects are located in the page.

    Args:
        listed: Settings.
        env: User and page; None: there is no page.

    Raises:
        InputError: A target names an object, and there is no page or no such object.
    """
    named = list(dict.fromkeys(each.object for each in listed if each.object is not None))
    places: dict[str, Sequence[float]] = {}
    if named and (env is None or env.app.page is None):
        raise InputError("--targets", f"object {named[0]!r} without --page", "a place, or a page")
    if named:
        assert env is not None
        with page_app(env) as app:
            PageHands(app)
            for name in named:
                try:
                    places[name] = app.locate(name)
                except AppRefused as error:
                    raise InputError("--targets", f"object {name!r}", str(error)) from error
    return [AuditTarget.of(each, places) for each in listed]
