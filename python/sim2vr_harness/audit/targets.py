"""Targets of an audit: listed, logged, recorded, found in a game, or located in a page."""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from itertools import islice
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError, model_validator

from sim2vr_harness.base.errors import InputError, shown
from sim2vr_harness.base.files import file_name, read_yaml
from sim2vr_harness.base.rotations import turned
from sim2vr_harness.base.settings import Settings, first_problem
from sim2vr_harness.client import AppRefused, AppScene, DevicePoses, SceneObject, WebXRApp
from sim2vr_harness.client.devices import input_named
from sim2vr_harness.client.frames import position_to_mujoco
from sim2vr_harness.client.runtime import frame_time_ns
from sim2vr_harness.client.scene import POINTERS
from sim2vr_harness.client.webxr.hands import PageHands
from sim2vr_harness.envs.apps import app_factory, apps_wanted
from sim2vr_harness.envs.config import EnvConfig, SenseConfig
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.play.player import Job, Player
from sim2vr_harness.policies.scripted import scripted_policy
from sim2vr_harness.sessions import read_session
from sim2vr_harness.sessions.state_log import read_lines
from sim2vr_harness.users.kinematics.forward import Point
from sim2vr_harness.users.kinematics.posture_controller import AIM_RAY, DeviceRay, page_ray

FloatArray = NDArray[np.float64]
How = Literal["touch", "point", "press", "grab", "look"]
Hand = Literal["either", "preferred", "both"]

_FORM = "a list 'targets' of {name, place: [right, up, ahead] or object: NAME, ...}"
_MOST = 500
_STATURES_M = (1.55, 1.85)
"""Statures of two users whose rounds show whether a game's targets follow the head."""
_RIG = "XR Rig/"
_CONTROLLERS = {
    "XR Rig/RightHand Controller": "controller_right",
    "XR Rig/LeftHand Controller": "controller_left",
}
_STILL_M, _FLOOR_M, _FLAT_M = 0.4, 0.05, 0.02
"""Largest half diagonal of a target that does not move; objects this near the floor and this flat
do not count as targets."""
_NEW_AFTER_M = 0.01
"""Places nearer to each other than this are one."""
_RESTS = 5
"""User steps without movement after which an object counts as resting."""
_LONGEST_S = 300.0
"""Of a round that is watched for as long as something comes up in it."""
_NUMBER = r"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?"
_GRID = re.compile(rf"\[(\d+) \d+ \d+ {_NUMBER} {_NUMBER} ({_NUMBER}) ({_NUMBER}) ({_NUMBER})\]")
_PLANE = re.compile(rf", target plane transform ((?:{_NUMBER} ){{6}}{_NUMBER})")
_CENTER = re.compile(rf", target_spawn, .*grid ID (\d+), .*center ({_NUMBER}) ({_NUMBER})")
_PRESSED = 0.5
_SAME_PRESS_M, _MOST_PRESSES = 0.05, 100
"""Places of presses that are nearer to each other are one target; how many there are at most."""

Coordinate = Annotated[float, Field(ge=-100.0, le=100.0)]


class TargetSettings(Settings):
    """One target in a file of targets."""

    name: str = Field(min_length=1, max_length=80)
    """Name of the target in the report."""
    place: tuple[Coordinate, Coordinate, Coordinate] | None = None
    """Right, up, ahead in m; origin on the floor below the body."""
    object: str | None = None
    """Or the name of an object of the page, which is where it is as the session begins."""
    relative_to: Literal["world", "head"] = "world"
    """``head``: `place` is measured from where each participant's head is."""
    how: How = "touch"
    """``touch``, ``press``, ``grab``: the controller gets there; ``point``: its ray does; ``look``:
    it only has to be seen."""
    hand: Hand = "either"
    """``preferred``: the hand that the participant prefers; ``both``: both hands at once."""
    hold_s: float = Field(default=1.0, ge=0.0, le=3600.0)
    """Time for which the posture is held, s."""
    load_kg: float = Field(default=0.0, ge=0.0, le=50.0)
    """Mass in each hand in addition to the controller, kg."""
    grip_n: float = Field(default=0.0, ge=0.0, le=2000.0)
    """Grip force in addition to that for holding the load, N; with ``grab`` only."""
    radius_m: float = Field(default=0.0, ge=0.0, le=2.0)
    """Radius of the target: a distance below it counts as reached, m."""

    @model_validator(mode="after")
    def _one_place(self) -> TargetSettings:
        if (self.place is None) == (self.object is None):
            got = "none" if self.place is None else "both"
            raise ValueError(f"got {got} of place and object, expected one of them")
        if self.grip_n and self.how != "grab":
            raise ValueError(f"got grip_n with how: {self.how}, expected how: grab")
        return self


@dataclass(frozen=True)
class Target:
    """A target with its place.

    Attributes:
        name: In reports.
        place_m: (3,) right, up, ahead, m, from the floor below the body or from the head.
        from_head: True if it is from the head.
        how, hand, hold_s, load_kg, radius_m, grip_n: As of :class:`TargetSettings`.
        in_app: Operation in the app and the app's reaction; empty: it was not operated.
        reacts: True if the app reacted.
        ray: Ray with which the app lets the hand point, in the axes of the controller.
        head_offset_m: (3,) from the headset's position at the start of a game's round; None:
            unknown.
    """

    name: str
    place_m: FloatArray
    from_head: bool = False
    how: How = "touch"
    hand: Hand = "either"
    hold_s: float = 1.0
    load_kg: float = 0.0
    radius_m: float = 0.0
    grip_n: float = 0.0
    in_app: str = ""
    reacts: bool = True
    ray: DeviceRay = AIM_RAY
    head_offset_m: FloatArray | None = None

    def same_as(self, other: Target) -> bool:
        """Return whether both are one place, in the world or relative to the head if so placed."""
        near = _same(self.place_m, other.place_m)
        if near or self.head_offset_m is None or other.head_offset_m is None:
            return near
        return _same(self.head_offset_m, other.head_offset_m)


def listed_targets(sources: Sequence[str], env: EnvConfig | None = None) -> list[Target]:
    """Return the targets of command line arguments: ``[NAME=]RIGHT,UP,AHEAD``, files and logs.

    Args:
        sources: Each a place in metres, a YAML file of targets, or the log of a round.
        env: Names the page in which objects of files are located; None: there is no page.

    Raises:
        InputError: It is none of them, or names something that does not exist.
    """
    found: list[Target] = []
    for text in sources:
        path = Path(text)
        if path.is_dir() or path.name == "events.csv":
            found += logged_targets(path)
        elif path.is_file():
            found += located(read_targets(path), env)
        else:
            found.append(given_target(text))
    return found


def read_targets(file: Path) -> list[TargetSettings]:
    """Read a file of targets.

    Raises:
        InputError: It is no such file; names the target and the field.
    """
    tree = read_yaml(file, _FORM)
    listed = tree.get("targets") if isinstance(tree, dict) else None
    if not isinstance(listed, list) or not 1 <= len(listed) <= _MOST:
        raise InputError(file_name(file), shown(tree, 60), _FORM)
    found = []
    for number, each in enumerate(listed):
        where = f"{file_name(file)}: targets[{number}]"
        if not isinstance(each, dict):
            expected = "a mapping with 'name' and 'place' or 'object'"
            raise InputError(where, shown(each, 60), expected)
        try:
            found.append(TargetSettings.model_validate(each))
        except ValidationError as error:
            raise first_problem(error, TargetSettings, (where,)) from error
    names = [each.name for each in found]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"{file_name(file)}: targets", f"{name!r} twice", "each name once")
    return found


def found_targets(
    env: ResolvedEnv,
    *,
    objects: str | None = None,
    seconds: float = 10.0,
    how: How = "touch",
) -> list[Target]:
    """Find the targets of a game in rounds of a short and a tall user.

    A target at the same place from both heads follows the head.

    Args:
        env: User and game.
        objects: Pattern of the objects' names; None: objects that appear, disappear or move, and
            small ones.
        seconds: Duration of watching each round.
        how: Way of operating the targets.
    """
    plain = alike(env)
    seen = []
    for stature in _STATURES_M:
        person = plain.config.user.person.model_copy(update={"stature_m": stature})
        user = plain.config.user.model_copy(update={"person": person, "torso": True})
        sized = plain.changed(user=user)
        seen.append(seen_targets(sized, objects, seconds=seconds, still=True))
    (short, tall), found = seen, []
    for target in short:
        other = next((each for each in tall if target.same_as(each)), None)
        moved = other is not None and np.abs(other.place_m - target.place_m).max() > 0.01
        follows = moved and target.head_offset_m is not None
        place = target.head_offset_m if follows else target.place_m
        found.append(Target(target.name, np.asarray(place), bool(follows), how))
    return found


def alike(env: ResolvedEnv) -> ResolvedEnv:
    """Return the environment with the average user and the cheapest sense."""
    user = env.config.user.model_copy(update={"people": None})
    return env.changed(user=user, senses=(SenseConfig(sense="time"),))


def given_target(text: str) -> Target:
    """Read ``[NAME=]RIGHT,UP,AHEAD`` in metres.

    Raises:
        InputError: It is something else.
    """
    name, _, numbers = text.rpartition("=")
    try:
        place = np.array([float(number) for number in numbers.split(",")])
    except ValueError:
        place = np.empty(0)
    if place.shape != (3,) or not np.isfinite(place).all():
        expected = (
            "a file of targets, a round's log, or [NAME=]RIGHT,UP,AHEAD in metres, for example "
            "cup=0.2,1.1,0.45"
        )
        raise InputError("--targets", repr(text), expected)
    return Target(name or numbers, place)


def logged_targets(log: Path) -> list[Target]:
    """Read where targets were from a round's ``events.csv``.

    Their places are in ``grid mapping``, or in ``target_spawn`` as a centre in the target plane.

    Args:
        log: The file, or its folder.

    Raises:
        InputError: There is no such file, or no target in it.
    """
    file = log / "events.csv" if log.is_dir() else log
    if not file.is_file():
        raise InputError("--targets", repr(str(log)), "a folder with a round's events.csv")
    found: dict[str, FloatArray] = {}
    plane: FloatArray | None = None
    for line in read_lines(file):
        if match := _PLANE.search(line):
            plane = np.array([float(number) for number in match[1].split()])
        if ", grid mapping " in line:
            for cell, *place in _GRID.findall(line):
                found[cell] = np.array([float(number) for number in place])
        if plane is not None and (match := _CENTER.search(line)):
            in_plane = np.array([float(match[2]), float(match[3]), 0.0])
            place_m = plane[:3] + turned(plane[3:6], plane[6], in_plane)
            if not any(_same(place_m, other) for other in found.values()):
                found[str(len(found))] = place_m
    if not found:
        expected = "one with 'grid mapping', or with the 'center' of each target_spawn"
        raise InputError(
            "--targets", f"{str(file)!r}, which says of no target where it is", expected
        )
    return [Target(f"target {cell}", place) for cell, place in found.items()]


def _same(a: FloatArray, b: FloatArray) -> bool:
    return bool(np.linalg.norm(a - b) < _NEW_AFTER_M)


def seen_targets(
    env: ResolvedEnv,
    pattern: str | None,
    *,
    seconds: float = 10.0,
    seed: int = 1,
    rounds: int = 3,
    person: int | None = None,
    still: bool = False,
) -> list[Target]:
    """Play a game with the idle baseline, and record where objects appear.

    For an object that moves, its place nearest to the headset counts as a target, and, if the app
    moves it in one step, each resting position. A place that occurs in several rounds, in the world
    or relative to the head, is one target.

    Args:
        env: User and app.
        pattern: Of objects' names, with ``*`` and ``?``; None: objects that appear, disappear or
            move by themselves.
        seconds: Duration of watching a round; with ``still``, the first round is watched until no
            object has appeared for this time.
        seed: Of the first round.
        rounds: Number of rounds to watch.
        person: Number of the participant, if users are people.
        still: True: without a pattern, small objects above the floor that do not move count, too.

    Raises:
        InputError: The app does not report its scene, or no object matches the pattern.
    """
    seen: list[Target] = []
    paths: set[str] = set()
    with closing(Simulation(env, 1)) as users:
        app = users.apps[0]
        if "scene" not in app.capabilities:
            raise InputError("--game", "an app that tells nothing of its scene", "one that does")
        for number in range(rounds):
            # Sit still until the round ends, or so long.
            player = Player(users, scripted_policy("still", users), env.facts)
            player.begin([Job("", number, seed + number, person=person)])
            round_app = users.apps[0]
            tracks = _Tracks(round_app.scene(), pattern)
            for _ in islice(player.steps(), round(seconds * env.config.action_frequency_hz)):
                tracks.add(round_app.scene())
            if still and number == 0:
                _watch_on(env.config, tracks, seconds, seed)
            paths |= tracks.paths
            for target in tracks.targets(still=still):
                if not any(target.same_as(other) for other in seen):
                    seen.append(target)
    if not seen:
        wanted = "that comes, goes or moves" if pattern is None else f"called {pattern!r}"
        own = sorted({name.rpartition("/")[2] for name in paths if not name.startswith(_RIG)})
        raise InputError("--objects", f"nothing {wanted}", f"one of {', '.join(own)}")
    # Number places of a kind, whatever numbers the objects had.
    counts: dict[str, int] = {}
    for i, target in enumerate(seen[:_MOST]):
        kind = target.name.rstrip("0123456789 ") or target.name
        counts[kind] = counts.get(kind, 0) + 1
        seen[i] = replace(target, name=f"{kind} {counts[kind]}")
    return seen[:_MOST]


def _watch_on(config: EnvConfig, tracks: _Tracks, seconds: float, seed: int) -> None:
    """Play a round without a body, its devices at rest, for as long as things come up in it."""
    hz = config.action_frequency_hz
    with closing(app_factory(config, 1)(config, 0, None)) as app:
        steps = range(round(_LONGEST_S * hz))
        frames = ((frame_time_ns(step, hz), tracks.devices) for step in steps)
        for step, _ in enumerate(app.play(seed, frames)):
            if step > 0:
                tracks.add(app.scene())
            if tracks.moments - tracks.last_came > seconds * hz:
                break


class _Tracks:
    """Positions nearest to the head of a round's objects that match a pattern or move.

    Attributes:
        paths: of all objects that appeared.
        devices: Poses of the devices at the start of the round.
        moments: Number of recorded frames.
        last_came: Number of the last frame in which an object appeared or came to rest at a new
            place.
    """

    def __init__(self, first: AppScene, pattern: str | None) -> None:
        self._pattern = pattern
        self._first = {one.id: one for one in first.objects}
        self._best: dict[tuple[int, int], tuple[float, str, FloatArray]] = {}
        self._moved: set[tuple[int, int]] = set()
        self._size: dict[tuple[int, int], tuple[float, float]] = {}
        self._rests: dict[tuple[int, int], Resting] = {}
        self.moments = self.last_came = 0
        self._start = _head(first)
        # The devices where the scene has them.
        poses = {one.path: np.array(one.pose, dtype=np.float64) for one in first.objects}
        right, left = (poses.get(path) for path in _CONTROLLERS)
        self.devices = DevicePoses(poses[f"{_RIG}Main Camera"], right, left)
        self.paths: set[str] = set()
        self.add(first)

    def add(self, scene: AppScene) -> None:
        """Look at a moment."""
        head = _head(scene)
        counts: dict[int, int] = {}
        self.moments += 1
        for one in scene.objects:
            key = one.id, counts.get(one.id, 0)
            counts[one.id] = key[1] + 1
            self.paths.add(one.path)
            if one.path.startswith(_RIG) or key[1] or not self._fits(one):
                continue
            before = self._first.get(one.id)
            if before is None or not _same(before.pose[:3], one.pose[:3]):
                self._moved.add(key)
            self._size.setdefault(key, _size(scene, one))
            rest = self._rests.setdefault(key, Resting(one.pose[:3].copy()))
            if rest.add(one.pose[:3]) or key not in self._best:
                self.last_came = self.moments
            distance = float(np.linalg.norm(one.pose[:3] - head))
            if key not in self._best or distance < self._best[key][0]:
                self._best[key] = distance, one.path.rpartition("/")[2], one.pose[:3].copy()

    def _fits(self, one: SceneObject) -> bool:
        name = one.path.rpartition("/")[2]
        if one.mesh is None or self._pattern is None:
            return one.mesh is not None and name not in POINTERS
        return fnmatchcase(name, self._pattern) or fnmatchcase(one.path, self._pattern)

    def targets(self, *, still: bool = False) -> list[Target]:
        """Return the targets found, the earliest first; ``still``: as of :func:`seen_targets`."""
        return [
            Target(name, at, head_offset_m=at - self._start)
            for key, (_, name, place) in self._best.items()
            if self._pattern is not None or key in self._moved or (still and self._thing(key))
            for at in (place, *self._rests[key].others(place))
        ]

    def _thing(self, key: tuple[int, int]) -> bool:
        """Return whether an object is small, above the floor, and does not carry smaller ones."""
        (radius, height), place = self._size[key], self._best[key][2]
        carried = any(
            self._size[other][0] < radius and np.linalg.norm(where - place) < radius
            for other, (_, _, where) in self._best.items()
        )
        on_floor = abs(place[1]) < _FLOOR_M and height < _FLAT_M
        return radius <= _STILL_M and not on_floor and not carried


class Resting:
    """Resting positions of an object that the app moves in one step."""

    def __init__(self, place: FloatArray) -> None:
        self._place, self._steps, self._jumped = place, 0, False
        self._found: list[FloatArray] = []

    def add(self, place: FloatArray) -> bool:
        """Add a frame; return whether the object has come to rest at a new place."""
        if not _same(place, self._place):
            self._jumped = self._steps >= _RESTS
            self._place, self._steps = place.copy(), 0
        self._steps += 1
        came = self._jumped and self._steps == _RESTS
        if self._steps == _RESTS and (came or not self._found):
            self._found.append(self._place)
        return came

    def others(self, place: FloatArray) -> list[FloatArray]:
        """Return these places except one, each once; none if the object never jumped."""
        found = [place]
        for each in self._found if len(self._found) > 1 else []:
            if not any(_same(each, other) for other in found):
                found.append(each)
        return found[1:]


def _size(scene: AppScene, one: SceneObject) -> tuple[float, float]:
    """Return half the diagonal of an object's mesh, and its height, m."""
    assert one.mesh is not None
    extent = np.ptp(scene.meshes[one.mesh].vertices, axis=0) * one.scale
    height = sum(abs(turned(one.pose[3:6], one.pose[6], side)[1]) for side in np.diag(extent))
    return float(np.linalg.norm(extent)) / 2.0, float(height)


def _head(scene: AppScene) -> FloatArray:
    place = next(one.pose[:3] for one in scene.objects if one.path == f"{_RIG}Main Camera")
    return np.array(place, dtype=np.float64)


def tool_point(scene: AppScene, pattern: str) -> Point:
    """Return the point of a tool on the controller that carries it.

    Args:
        scene: Of a round that has begun.
        pattern: Name of the tool's object, with ``*`` and ``?``; it must be below a controller.

    Raises:
        InputError: No object matches, or several do.
    """
    carried = [
        (one, path)
        for one in scene.named(pattern)
        for path in _CONTROLLERS
        if one.path.startswith(f"{path}/")
    ]
    if len({one.path for one, _ in carried}) != 1:
        below = [
            one.path
            for one in scene.objects
            if any(one.path.startswith(f"{p}/") for p in _CONTROLLERS)
        ]
        got = f"{pattern!r}, which {len(carried)} objects in hands are called"
        raise InputError("--tool", got, f"one of {', '.join(map(repr, below)) or 'none'}")
    tool, path = carried[0]
    (hand,) = [one for one in scene.objects if one.path == path]
    quat = hand.pose[3:] * np.array([-1.0, -1.0, -1.0, 1.0])
    offset = turned(quat[:3], quat[3], tool.pose[:3] - hand.pose[:3])
    x, y, z = position_to_mujoco(offset).tolist()
    return Point(_CONTROLLERS[path], (x, y, z))


def pressed_places(file: Path) -> list[Target]:
    """Return the places of a session's hands at presses of trigger or squeeze, in order.

    Raises:
        InputError: It is no session, or nothing is pressed in it.
    """
    session = read_session(file)
    found: list[FloatArray] = []
    # Frames in which an input begins to be pressed, and where the hand is then.
    presses: list[tuple[int, FloatArray]] = []
    for hand, controller in (("left", session.left), ("right", session.right)):
        if controller is None or controller.inputs is None:
            continue
        columns = [input_named(f"{hand}.{name}").column for name in ("trigger", "squeeze")]
        down = np.asarray((controller.inputs[:, columns] >= _PRESSED).any(axis=1))
        begins = np.flatnonzero(down & ~np.r_[False, down[:-1]])
        presses += zip(begins.tolist(), controller.grip[begins, :3], strict=True)
    for _, place in sorted(presses, key=lambda press: press[0]):
        if np.isnan(place).any():
            continue
        if not any(np.linalg.norm(place - other) < _SAME_PRESS_M for other in found):
            found.append(place)
    if not found:
        expected = "one whose hands press a trigger or squeeze"
        raise InputError("--session", f"{file.name}, in which nothing is pressed", expected)
    return [
        Target(f"press {number}", place, how="press", radius_m=0.02)
        for number, place in enumerate(found[:_MOST_PRESSES], start=1)
    ]


def located(listed: Sequence[TargetSettings], env: EnvConfig | None) -> list[Target]:
    """Return targets with their places; those of objects are located in the page.

    Args:
        listed: Settings.
        env: User and page; None: there is no page.

    Raises:
        InputError: A target names an object, and there is no page or no such object.
    """
    named = list(dict.fromkeys(each.object for each in listed if each.object is not None))
    places: dict[str | None, Sequence[float]] = {}
    if named and (env is None or env.app.page is None):
        raise InputError("--targets", f"object {named[0]!r} without --page", "a place, or a page")
    ray = AIM_RAY
    if env is not None and env.app.page is not None:
        with WebXRApp(apps_wanted(env, 1)) as app:
            ray = page_ray(app.pointing_rays().get("right"))
            PageHands(app)
            for name in named:
                try:
                    places[name] = app.locate(name)
                except AppRefused as error:
                    raise InputError("--targets", f"object {name!r}", str(error)) from error
    copied = ("name", "how", "hand", "hold_s", "load_kg", "radius_m", "grip_n")
    return [
        Target(
            place_m=np.array(each.place or places[each.object], dtype=np.float64),
            from_head=each.relative_to == "head",
            ray=ray,
            **{name: getattr(each, name) for name in copied},
        )
        for each in listed
    ]
