"""A recorded session of any app to watch, alone or beside a user."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.client import (
    AppClient,
    AppReply,
    AppScene,
    SceneMesh,
    SceneObject,
    facts_of_outside,
)
from sim2vr_harness.client.scene import PLAYER_LAYER
from sim2vr_harness.sessions import Session
from sim2vr_harness.sessions.replay import replay_session
from sim2vr_harness.tools.watch.frames import Counters, Playlist, ViewerFrame, look

_HZ = 20.0
"""Moments per second that are kept of a session."""
_BESIDE_M = 1.2
"""By which the session's app is to the left of the user's, where the camera sees both."""
_COLOR = np.array([0.95, 0.6, 0.1, 1.0], np.float32)
_DEVICES_M = {
    "head": (0.17, 0.1, 0.12),
    "left": (0.05, 0.05, 0.14),
    "right": (0.05, 0.05, 0.14),
}
"""Sizes of the boxes that stand for the devices in apps that do not show them."""
_CORNERS = np.array(list(product((-0.5, 0.5), repeat=3)), np.float32)
_SIDES = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
_TRIANGLES = np.array([three for a, b, c, d in _SIDES for three in ((a, b, c), (a, c, d))])


def session_show(
    session: Session, name: str, *, game: str | None = None, app: Mapping[str, Any] | None = None
) -> Playlist:
    """Return a recorded session, replayed in its app.

    Args:
        name: for people.
        game: to replay it in; None: ``app``, or the session's own.
        app: settings of ``env.app``.
    """
    if game is None and not app and session.app.kind != "game":
        got = f"a session of {session.app.name or 'an app that it does not name'}"
        raise InputError("SESSION", got, "the app to replay it in: --game NAME or --page FILE")
    played = game or str((app or {}).get("game") or session.app.name)
    facts = facts_of_outside(played)

    def moments() -> Iterator[ViewerFrame]:
        found: list[ViewerFrame] = []
        counters = Counters(facts)

        def watch(client: AppClient, i: int, reply: AppReply) -> None:
            time_s = float(session.time_ns[i] - session.time_ns[0]) / 1e9
            if time_s < len(found) / _HZ:
                return
            text, events = counters.told(reply.log, time_s)
            scene, headset = look(client)
            scene = _with_devices(scene, session, i)
            numbers = dict(reply.log)
            found.append(ViewerFrame(time_s, scene, headset, text, events, numbers=numbers))

        replay_session(session, game=game, app=app, renderer="automatic", watch=watch)
        yield from found

    return Playlist(f"{name}: {played} {session.app.condition}".strip(), _HZ, moments)


def _with_devices(scene: AppScene, session: Session, i: int) -> AppScene:
    """Add boxes for head and hands if the app has no objects for them."""
    if any(one.layer == PLAYER_LAYER and one.mesh is not None for one in scene.objects):
        return scene
    poses = {"head": session.head[i]}
    poses |= {side: one.grip[i] for side, one in session.controllers.items() if one.tracked[i]}
    objects = [
        SceneObject(
            -1 - k, device, PLAYER_LAYER, 0, poses[device], np.array(size), _COLOR, unlit=False
        )
        for k, (device, size) in enumerate(_DEVICES_M.items())
        if device in poses
    ]
    shifted = [
        one if one.mesh is None else replace(one, mesh=one.mesh + 1) for one in scene.objects
    ]
    box = SceneMesh("device", _CORNERS, _TRIANGLES)
    return AppScene((*shifted, *objects), (box, *scene.meshes))


def beside(user: Playlist, person: Playlist) -> Playlist:
    """Return a user's round with a recorded one to its left, frame by frame.

    Times are since each round began; the shorter round stays at its last frame.

    Args:
        user: the round with body, numbers and effort.
        person: of a session.
    """

    def moments() -> Iterator[ViewerFrame]:
        theirs = list(person.moments())
        times_s = np.array([one.time_s for one in theirs])
        now, last = None, -1

        def shown(now: ViewerFrame) -> tuple[ViewerFrame, int]:
            at = max(0, int(np.searchsorted(times_s, now.time_s + 1e-9, side="right")) - 1)
            passed = [line for one in theirs[last + 1 : at + 1] for line in one.events]
            return _together(now, theirs[at], passed), at

        for now in user.moments():
            both, last = shown(now)
            yield both
        while now is not None and last + 1 < len(theirs):
            now = replace(now, time_s=now.time_s + 1.0 / user.frequency_hz, events=())
            both, last = shown(now)
            yield both

    return replace(user, title=f"{user.title}, beside {person.title}", moments=moments)


def _together(user: ViewerFrame, person: ViewerFrame, events: list[str]) -> ViewerFrame:
    numbers = {f"session/{name}": value for name, value in person.numbers.items()}
    return replace(
        user,
        scene=_both_scenes(user.scene, person.scene),
        headset=_pictures(user.headset, person.headset),
        text=f"{user.text}   session: {person.text}",
        events=(*user.events, *(f"{line} (session)" for line in events)),
        numbers={**user.numbers, **numbers},
    )


def _both_scenes(user: AppScene, person: AppScene) -> AppScene:
    """Both scenes; shapes take turns, so that each keeps its number as others are added."""
    count = max(len(user.meshes), len(person.meshes))
    nothing = SceneMesh("nothing", np.zeros((3, 3), np.float32), np.array([[0, 1, 2]]))
    meshes = [nothing] * (2 * count)
    meshes[: 2 * len(user.meshes) : 2] = user.meshes
    meshes[1 : 2 * len(person.meshes) : 2] = person.meshes
    aside = np.array([-_BESIDE_M, 0, 0, 0, 0, 0, 0])
    objects = []
    for one in user.objects:
        mesh = None if one.mesh is None else 2 * one.mesh
        objects.append(replace(one, id=2 * one.id, mesh=mesh))
    for one in person.objects:
        mesh = None if one.mesh is None else 2 * one.mesh + 1
        layer = 0 if one.layer == PLAYER_LAYER else one.layer  # this player has no other body
        path, place = f"Session/{one.path}", one.pose + aside
        own = replace(one, id=2 * one.id + 1, path=path, layer=layer, mesh=mesh, pose=place)
        objects.append(own)
    return AppScene(tuple(objects), tuple(meshes))


def _pictures(left: NDArray[np.uint8], right: NDArray[np.uint8]) -> NDArray[np.uint8]:
    height = max(len(left), len(right))
    both = [np.pad(one, ((0, height - len(one)), (0, 0), (0, 0))) for one in (left, right)]
    return np.concatenate(both, axis=1)
