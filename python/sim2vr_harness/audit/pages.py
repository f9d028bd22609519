"""Interactive objects of a WebXR page: found by their event listeners, and by operating them.

The devices move without a body: the page's reaction to a controller is tested, not a user's reach.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.audit.targets import How, Target
from sim2vr_harness.client import APP_FAILURES, AppDied, WebXRApp
from sim2vr_harness.client.webxr.hands import HEAD_M, HZ, PageHands, Ray, SessionEnded
from sim2vr_harness.client.webxr.replies import Signs, Thing
from sim2vr_harness.envs.apps import apps_wanted
from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.users.kinematics.posture_controller import AIM_RAY, DeviceRay, page_ray

FloatArray = NDArray[np.float64]

MOST_SEARCH_S = 300.0
"""Longest search of a page for objects that react, s; docs/guide/audit.md states it."""
PROGRESS_S = 5.0
_MOST_TRIED = 160
_MOST_ROUNDS = 24
"""Largest number of rounds; a new one begins after a page was left or died."""
_MOST_AGAIN = 4
"""Largest number of times that an object is operated again because it looks different."""
_AGAIN_S = 1.0
"""Time without input after a page is opened again, s."""
_LARGEST_M = 2.0
"""Half of the size, from which a thing is a room or a ground."""
_APART_M = 0.02
_SILENT = "no reaction to touch, ray or gaze with any button"
NOT_OPERATED = "not operated"
LEAVES = "leaves the page"
_LEFT = ("left its document", "went to another address", "loaded itself again")
"""Words of an error after which the page is not broken."""

OTHERS = "another object changes"
APPEARS = "another object appears"
_OWN = {"hears an event", "changes", APPEARS}
"""Reactions of the thing itself, and one that cannot come twice."""
MOVED_M = 0.02
"""Displacement from which an object counts as moved, m."""
BUTTONS: Mapping[str, tuple[str, ...]] = {
    "trigger": ("trigger",),
    "squeeze": ("squeeze",),
    "buttons": ("thumbstick_click", "a", "b"),
}
"""Inputs that are pressed together: the trigger, the squeeze, or all other buttons."""
_LEFT_NAMES = {"a": "x", "b": "y"}
_AIM_FROM_M = np.array([0.15, 0.9, 0.2])
_GAZE_STEPS = 50
"""User steps for which the head looks at an object; some objects react only after a dwell time."""
_PULL_M = np.array([0.0, 0.0, 0.15])
_DRAGGED_M = 0.05
_BESIDE_M, _BESIDE_RAD = 0.3, 0.25
"""Distance and angle beside the object at which the control is placed, for touching and
pointing."""
_SIDES = 8


@dataclass(frozen=True)
class Way:
    """Way of operating an object.

    Attributes:
        how: The hand touches it, or the hand's ray or the head points at it.
        side: Of the hand.
        button: A key of :data:`BUTTONS`.
    """

    how: How
    side: str
    button: str

    @property
    def held(self) -> tuple[str, ...]:
        """Names of the inputs."""
        other = _LEFT_NAMES if self.side == "left" else {}
        return tuple(f"{self.side}.{other.get(each, each)}" for each in BUTTONS[self.button])


@dataclass(frozen=True)
class _Moment:
    thing: Thing | None
    signs: Signs
    pulses: int
    names: frozenset[str]


@dataclass
class _Effects:
    """Reactions of the page: their kinds, and the objects that changed."""

    kinds: set[str] = field(default_factory=set)
    objects: set[int] = field(default_factory=set)
    carried: bool = False


class Operator:
    """Operates things of a page.

    Args:
        app: The page, in a round.
        hands: That do it.
        restless: Numbers of objects, and names of things, that change by themselves.
        text_rests: Whether the document's text stays as it is by itself.
    """

    def __init__(
        self,
        app: WebXRApp,
        hands: PageHands,
        restless: frozenset[int | str] = frozenset(),
        *,
        text_rests: bool = True,
    ) -> None:
        self._app, self._hands = app, hands
        self._restless, self._text_rests = restless, text_rests
        self._strays: set[int] = set()
        self.carriers: list[tuple[str, Way]] = []
        """Things that a hand carried, and how."""

    def reaction(self, name: str, way: Way) -> frozenset[str]:
        """Return the page's reactions to operating an object, without those to the same beside it.

        Other objects that also changed without the object being operated do not count. Reactions of
        other objects must occur in a second attempt, too.
        """
        done = self._act(name, way)
        if done.carried and len(self.carriers) < 2:
            self.carriers.append((name, way))
        if not done.kinds and not done.objects:
            return frozenset()
        found = self._beyond_control(done, name, way)
        if not found or found & _OWN:
            return found
        return found & self._beyond_control(self._act(name, way), name, way)

    def _beyond_control(self, done: _Effects, name: str, way: Way) -> frozenset[str]:
        control = self._act(name, way, beside=True)
        self._strays |= control.objects
        others = {OTHERS} if done.objects - self._strays else set()
        return frozenset((done.kinds - control.kinds) | others)

    def beside(self, name: str, way: Way) -> frozenset[str]:
        """Return the page's reactions to the same operation beside the object."""
        return frozenset(self._act(name, way, beside=True).kinds)

    def _act(self, name: str, way: Way, *, beside: bool = False) -> _Effects:
        hands, effects = self._hands, _Effects()
        hands.rest()
        hands.step(2)
        before = self._moment(name)
        if before.thing is None:
            return effects
        offset = self._offset(before.thing, way.how) if beside else np.zeros(3)
        self._approach(name, way, before.thing, offset)
        reached = self._moment(name)
        self._add(effects, before, reached)
        hands.step(2, *way.held)
        pressed = self._moment(name)
        self._add(effects, before, pressed)
        effects.objects |= self._changed(reached, pressed)
        if way.how != "look" and pressed.thing is not None:
            for _ in range(3):
                hands.put(way.side, hands.place[way.side] - _PULL_M / 3.0)
                hands.step(1, *way.held)
            now = self._moment(name)
            self._add(effects, before, now)
            if now.thing is not None and name not in self._restless:
                gap = np.array(now.thing.place_m) - np.array(pressed.thing.place_m)
                effects.carried = bool(np.linalg.norm(gap) > _DRAGGED_M)
        hands.step(2)
        self._add(effects, before, self._moment(name))
        hands.rest()
        hands.step(3)
        after = self._moment(name)
        self._add(effects, before, after)
        effects.objects |= self._changed(before, after)
        return effects

    def _approach(self, name: str, way: Way, thing: Thing, offset: FloatArray) -> None:
        hands, place = self._hands, np.array(thing.place_m)
        if way.how == "look":
            hands.look(place + offset)
            hands.step(_GAZE_STEPS)
            return
        start = hands.place[way.side]
        for part in (0.7, 0.9, 1.0):
            if name in self._restless:
                now = _named(self._app.things(), name)
                place = place if now is None else np.array(now.place_m)
            if way.how == "touch":
                at = start + part * (place + offset - start)
                hands.put(way.side, at, at + np.array([0.0, -0.3, 1.0]))
            else:
                mirror = np.array([1.0 if way.side == "right" else -1.0, 1.0, 1.0])
                hands.put(way.side, _AIM_FROM_M * mirror, place + offset)
            hands.step(1)
        hands.step(2)

    def carried_to(self, carrier: str, way: Way, name: str) -> frozenset[str]:
        """Return an object's reactions to another one released at it, and not beside it."""
        done = self._carry(carrier, way, name, beside=False)
        if not done.kinds:
            return frozenset()
        return frozenset(done.kinds - self._carry(carrier, way, name, beside=True).kinds)

    def _carry(self, carrier: str, way: Way, name: str, *, beside: bool) -> _Effects:
        hands, effects = self._hands, _Effects()
        hands.rest()
        hands.step(2)
        before, load = self._moment(name), _named(self._app.things(), carrier)
        if before.thing is None or load is None:
            return effects
        offset = self._offset(before.thing, way.how) if beside else np.zeros(3)
        goal = np.array(before.thing.place_m) + offset
        self._approach(carrier, way, load, np.zeros(3))
        hands.step(2, *way.held)
        start = hands.place[way.side]
        for part in (0.25, 0.5, 0.75, 1.0):
            if way.how == "touch":
                hands.put(way.side, start + part * (goal - np.array(load.place_m)))
            else:
                from_m = np.array(load.place_m)
                hands.put(way.side, start, from_m + part * (goal - from_m))
            hands.step(2, *way.held)
        self._add(effects, before, self._moment(name))
        hands.step(2)
        hands.rest()
        hands.step(3)
        self._add(effects, before, self._moment(name))
        effects.kinds &= {"hears an event", "changes"}
        return effects

    def _offset(self, thing: Thing, how: How) -> FloatArray:
        """Return the vector (3,) from an object to a place beside it, far from other objects."""
        place, half = np.array(thing.place_m), max(thing.half_m)
        ahead = place - HEAD_M
        distance = max(float(np.linalg.norm(ahead)), 1e-9)
        ahead = ahead / distance
        aside = np.cross([0.0, 1.0, 0.0], ahead)
        aside = aside / max(float(np.linalg.norm(aside)), 1e-9) if aside.any() else np.eye(3)[0]
        upward = np.cross(ahead, aside)
        reach = half + (_BESIDE_M if how == "touch" else distance * np.tan(_BESIDE_RAD))
        angles = np.arange(_SIDES) * 2.0 * np.pi / _SIDES
        options = [reach * (np.cos(each) * aside + np.sin(each) * upward) for each in angles]
        others = [each for each in self._app.things() if each.name != thing.name]

        def gap(at: FloatArray, other: Thing) -> float:
            """From a place to a thing's rim, m; of rays the angle."""
            middle, rim = np.array(other.place_m), max(other.half_m)
            if how == "touch":
                return float(np.linalg.norm(at - middle)) - rim
            first, second = at - HEAD_M, middle - HEAD_M
            angle = np.arctan2(np.linalg.norm(np.cross(first, second)), first @ second)
            return float(angle - np.arctan2(rim, np.linalg.norm(second)))

        return max(options, key=lambda o: min((gap(place + o, x) for x in others), default=np.inf))

    def _moment(self, name: str) -> _Moment:
        things = {each.name: each for each in self._app.things()}
        signs = self._app.signs()
        return _Moment(things.get(name), signs, self._hands.pulses, frozenset(things))

    def _add(self, effects: _Effects, before: _Moment, now: _Moment) -> None:
        """Add reactions of the object and events of the user."""
        first, last = before.thing, now.thing
        differs = first is not last
        if first is not None and last is not None:
            moved = np.linalg.norm(np.array(last.place_m) - np.array(first.place_m)) > MOVED_M
            differs = first.name not in self._restless and (
                bool(moved) or last.state != first.state
            )
        happened = {
            "hears an event": _events(now) > _events(before),
            "changes": differs,
            APPEARS: bool(now.names - before.names),
            "vibrates": now.pulses > before.pulses,
            "sounds": now.signs.sounds > before.signs.sounds,
            "the page's text changes": self._text_rests and now.signs.text != before.signs.text,
        }
        effects.kinds |= {kind for kind, yes in happened.items() if yes}

    def _changed(self, before: _Moment, now: _Moment) -> set[int]:
        first, second = before.signs.objects, now.signs.objects
        numbers = first.keys() | second.keys()
        return {k for k in numbers if first.get(k) != second.get(k)} - self._restless


def _events(moment: _Moment) -> int:
    return 0 if moment.thing is None else moment.thing.events


@dataclass
class FoundThing:
    """An interactive object of a page.

    Attributes:
        name: In the page, or its kind.
        how: Way of operating it.
        place_m: Its position nearest to the head: right, up, ahead.
        half_m: Halves of its size along the three axes, the smallest first.
        moves: True if it moves by itself.
        listens: True if the page listens to it or tests rays against it.
        signs: Reactions of the page to the operation, without those to the same beside the object.
        after: The object that had to be operated before this one appeared; None: it was present.
        way: Way in which it was operated.
        obstacle: Reason why no reaction is known.
        ray: Ray with which the page lets the right hand point.
    """

    name: str
    how: How
    place_m: FloatArray
    half_m: tuple[float, ...]
    moves: bool
    listens: bool
    signs: tuple[str, ...] = ()
    after: str | None = None
    way: Way | None = None
    obstacle: str = NOT_OPERATED
    ray: DeviceRay = AIM_RAY

    @property
    def reacts(self) -> bool:
        """Return whether the page reacts if the object is operated."""
        return bool(self.signs)

    @property
    def told(self) -> str:
        """Description of the action on the object and of the page's reaction."""
        if self.way is None or not self.signs:
            return self.obstacle
        button = "" if self.way.how == "look" else f" + {self.way.side} {self.way.button}"
        after = "" if self.after is None else f"after {self.after}, "
        return f"{after}{self.way.how}{button}: {', '.join(self.signs)}"

    @property
    def radius_m(self) -> float:
        """Distance that counts as near: the thickness for touching, the width for a ray."""
        return self.half_m[0 if self.how == "touch" else 1]


def find_things(
    env: EnvConfig,
    seconds: float = 4.0,
    *,
    probe: bool = True,
    say: Callable[[str], None] = lambda text: None,
    most_s: float = MOST_SEARCH_S,
) -> list[FoundThing]:
    """Find the interactive objects of a page, and operate them.

    First there is no input for some time, to find objects that move by themselves. Then a
    controller touches and points at each object, with its inputs. Objects that appear are operated
    next.

    Args:
        env: Names the page.
        seconds: Duration without input.
        probe: True: operate the objects; otherwise those are returned that the page listens to.
        say: Receives a line of progress every few seconds, and notes on what was left out.
        most_s: After this time no further object is operated.

    Raises:
        AppRefused, AppError: The page does not play.
    """
    with ExitStack() as stack:
        search = _Search(env, stack, seconds, _Clock(say, most_s))
        if probe:
            search.operate_all()
            search.carry_all()
        left = sum(each.obstacle == NOT_OPERATED for each in search.found.values())
        if probe and left:
            say(
                f"note: {left} of {len(search.found)} things were not operated: at most "
                f"{_MOST_TRIED} attempts are made, in {most_s:.0f} s. List targets with --targets "
                "to audit others."
            )
    things = [thing for thing in search.found.values() if thing.listens or thing.reacts]
    for thing in things:
        thing.ray = page_ray(search.rays.get("right"))
    return things


class _Clock:
    """Timer of a search: reports its progress, and its end."""

    def __init__(self, say: Callable[[str], None], most_s: float) -> None:
        self._say, self._most_s = say, most_s
        self._began = self._said = time.monotonic()
        self._doing = "opening the page"

    def over(self, doing: str | None = None) -> bool:
        """Report the activity (None: the last) every few seconds; return whether time is up."""
        now, self._doing = time.monotonic(), doing or self._doing
        if now - self._said >= PROGRESS_S:
            self._said = now
            self._say(f"{self._doing}, {now - self._began:.0f} of at most {self._most_s:.0f} s ...")
        return now - self._began >= self._most_s


class _Search:
    """Operates all objects of a page, in as many rounds as necessary."""

    def __init__(self, env: EnvConfig, stack: ExitStack, seconds: float, clock: _Clock) -> None:
        self._env, self._stack, self._clock = env, stack, clock
        self.rays: dict[str, Ray] = {}
        """With which the page points, as of :class:`.PageHands`."""
        self._rounds = 0
        self._looks: dict[str, int | None] = {}
        self._again: dict[str, int] = {}
        self.found = {track.name: track.found() for track in self._open(seconds)}

    def _open(self, seconds: float) -> list[_Track]:
        """Begin a round, and watch it without input."""
        self._stack.close()
        self._rounds += 1
        app = self._stack.enter_context(WebXRApp(apps_wanted(self._env, 1)))
        hands = PageHands(app, rays=self.rays)
        hands.on_step = self._clock.over
        tracks, changing, text_rests = _watched(app, hands, seconds, self._clock)
        names = {track.name for track in tracks if track.changes}
        self._app, self._restless = app, frozenset(changing | names)
        self._operator = Operator(app, hands, self._restless, text_rests=text_rests)
        return tracks

    def operate_all(self) -> None:
        """Operate each object with the right hand, and those that did not react with the left.

        Objects that appear are operated next, and objects that look different are operated again.
        """
        first = sorted(self.found.values(), key=lambda thing: not thing.listens)
        queue = deque((thing.name, "right") for thing in first)
        for tried in range(_MOST_TRIED):
            doing = f"operated {tried} times, {len(queue)} of {len(self.found)} things are left"
            if not queue or self._rounds > _MOST_ROUNDS or self._clock.over(doing):
                return
            name, side = queue.popleft()
            thing = self.found[name]
            self._operate(thing, side)
            if not thing.reacts and side == "right":
                queue.append((name, "left"))
            for new in self._app.things():
                if new.name not in self.found and new.how != "unknown" and not _surrounds(new):
                    self.found[new.name] = _Track.of(new, {}).found()
                    self.found[new.name].after = name
                    queue.appendleft((new.name, "right"))
            queue.extendleft((each, side) for each in self._changed(thing))

    def _changed(self, tried: FoundThing) -> list[str]:
        """Return objects that look different from when they were operated, such as a lit key.

        Operating them may cause reactions of objects that did not react before.
        """
        now = {each.name: each.state for each in self._app.things()}
        self._looks[tried.name] = now.get(tried.name)
        if not tried.reacts or all(each.reacts for each in self.found.values() if each.listens):
            return []
        others = [
            name
            for name, looks in self._looks.items()
            if name != tried.name
            and self.found[name].listens
            and name not in self._restless
            and looks != now.get(name, looks)
            and self._again.get(name, 0) < _MOST_AGAIN
        ]
        for name in others:
            self._again[name] = self._again.get(name, 0) + 1
        return others

    def _operate(self, thing: FoundThing, side: str) -> None:
        there = _named(self._app.things(), thing.name) is not None
        thing.obstacle = _SILENT if there else "gone before it was operated"
        for way in [thing.way] if thing.way is not None else self._ways(thing, side):
            if self._clock.over(f"operating {thing.name}"):
                return
            if signs := self._reaction(thing.name, way):
                thing.how, thing.way = way.how, way
                thing.signs = tuple(sorted({*thing.signs, *signs}))
                return

    def _ways(self, thing: FoundThing, side: str) -> list[Way]:
        """Return how a thing may be operated, the likeliest first."""
        if thing.how == "look" or [*self.rays] == ["head"]:
            return [Way("look", side, "trigger")]
        hows: Sequence[How] = ("touch", "point")
        if thing.listens and thing.how != "touch":
            hows = ("point", "touch")
        return [Way(how, side, button) for how in hows for button in BUTTONS]

    def _reaction(self, name: str, way: Way) -> frozenset[str]:
        try:
            return self._operator.reaction(name, way)
        except (*APP_FAILURES, SessionEnded) as error:
            went = isinstance(error, AppDied) and any(word in str(error) for word in _LEFT)
            left = isinstance(error, SessionEnded) or went
        self._open(_AGAIN_S)
        if not left:
            self.found[name].obstacle = "the page stopped when it was operated"
            return frozenset()
        try:
            self._operator.beside(name, way)
        except (*APP_FAILURES, SessionEnded):
            self._open(_AGAIN_S)
            return frozenset()
        return frozenset({LEAVES})

    def carry_all(self) -> None:
        """Carry a thing to those that listen and did not react."""
        for thing in self.found.values():
            carriers = [each for each in self._operator.carriers if each[0] != thing.name]
            if thing.reacts or not thing.listens or self._rounds > _MOST_ROUNDS:
                continue
            for carrier, way in carriers:
                if self._clock.over(f"carrying {carrier} to {thing.name}"):
                    return
                try:
                    signs = self._operator.carried_to(carrier, way, thing.name)
                except (*APP_FAILURES, SessionEnded):
                    self._open(_AGAIN_S)
                    break
                if signs:
                    thing.how, thing.way, thing.signs = way.how, way, tuple(sorted(signs))
                    thing.after = carrier
                    break


def _named(things: Sequence[Thing], name: str) -> Thing | None:
    return next((each for each in things if each.name == name), None)


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

    @classmethod
    def of(cls, thing: Thing, hands: dict[str, FloatArray]) -> _Track:
        """Return the track that begins with a thing."""
        place = np.array(thing.place_m)
        offsets = {side: place - at for side, at in hands.items()}
        half = tuple(sorted(thing.half_m))
        return cls(thing.name, thing.how, place, half, place, thing.state, offsets)

    def add(self, thing: Thing, place: dict[str, FloatArray]) -> None:
        """Look at a moment."""
        now = np.array(thing.place_m)
        if np.linalg.norm(now - HEAD_M) < np.linalg.norm(self.nearest_m - HEAD_M):
            self.nearest_m = now
        self.moves |= bool(np.linalg.norm(now - self.first_m) > MOVED_M)
        self.changes |= thing.state != self.state
        self.how = thing.how if self.how == "unknown" else self.how
        far = [np.linalg.norm(now - place[s] - self.offset_m[s]) > _APART_M for s in place]
        self.apart += all(far)

    def found(self) -> FoundThing:
        """Return the thing."""
        listens = self.how != "unknown"
        how: How = self.how if listens else "touch"  # type: ignore[assignment]
        return FoundThing(self.name, how, self.nearest_m, self.half_m, self.moves, listens)


def _watched(
    app: WebXRApp, hands: PageHands, seconds: float, clock: _Clock
) -> tuple[list[_Track], set[int | str], bool]:
    """Watch a page without input, except for movements of head and hands.

    Objects that move with a hand or surround the head are left out.

    Returns:
        The objects, numbers of those that change by themselves, and True if the document's text
        does not change.
    """
    tracks: dict[str, _Track] = {}
    restless: set[int | str] = set()
    text_rests = True
    hands.rest()
    last = app.signs()
    steps = max(8, round(seconds * HZ))
    for step in range(steps):
        if clock.over(f"watched {len(tracks)} things for {step / HZ:.1f} of {steps / HZ:.1f} s"):
            break
        if step % 4 == 0:
            for thing in app.things():
                if thing.name not in tracks:
                    tracks[thing.name] = _Track.of(thing, hands.place)
                tracks[thing.name].add(thing, hands.place)
            hands.learn_rays()
            now = app.signs()
            changed = {k for k, state in now.objects.items() if last.objects.get(k, state) != state}
            restless |= changed
            text_rests &= now.text == last.text
            last = now
        hands.sway(step)
        # A page that tests rays when a trigger is pulled shows against what.
        hands.step(1, *(["right.trigger", "left.trigger"] if step % 16 in (8, 9) else []))
    now_there = app.things()
    kept = [
        track
        for name, track in tracks.items()
        if (track.apart or not track.moves) and not _surrounds(_named(now_there, name))
    ]
    return kept, restless, text_rests


def _surrounds(thing: Thing | None) -> bool:
    """Return whether an object is a room, a sky or a ground."""
    if thing is None:
        return False
    half = np.array(thing.half_m)
    inside = bool((np.abs(np.array(thing.place_m) - HEAD_M) < half).all())
    return inside or float(half.max()) > _LARGEST_M


def things_as_targets(found: Sequence[FoundThing]) -> list[Target]:
    """Return targets for an audit."""
    return [
        Target(
            each.name,
            each.place_m,
            how=each.how,
            radius_m=each.radius_m,
            in_app=each.told,
            reacts=each.reacts,
            ray=each.ray,
        )
        for each in found
    ]
