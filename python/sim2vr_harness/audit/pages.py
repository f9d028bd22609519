"""Interactive things of a WebXR page: found by what they listen to, and by operating them.

The devices move without a body: what the page does with a controller counts, not who gets there.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.audit.operating import BUTTONS, MOVED_M, Operator, Way
from sim2vr_harness.audit.targets import AuditTarget, How, TargetSettings
from sim2vr_harness.base.errors import InputError
from sim2vr_harness.client import APP_FAILURES, AppDied, AppRefused, WebXRApp
from sim2vr_harness.client.webxr.hands import HEAD_M, HZ, PageHands, SessionEnded
from sim2vr_harness.client.webxr.replies import Thing
from sim2vr_harness.envs.apps import apps_wanted
from sim2vr_harness.envs.config import EnvConfig

FloatArray = NDArray[np.float64]

MOST_SEARCH_S = 300.0
"""How long a page's things are watched and operated at most; docs/guide/audit.md states it."""
_PROGRESS_S = 5.0
_MOST_TRIED = 160
_MOST_ROUNDS = 24
"""A page that was left or died is opened again so often."""
_MOST_AGAIN = 4
"""A thing that looks different is operated again so often."""
_AGAIN_S = 1.0
"""How long nothing happens in these rounds."""
_LARGEST_M = 2.0
"""Half of the size, from which a thing is a room or a ground."""
_CARRIED_M = 0.02
_SILENT = "no reaction to touch, ray or gaze with any button"
NOT_OPERATED = "not operated"
LEAVES = "leaves the page"
_LEFT = ("left its document", "went to another address", "loaded itself again")


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
        signs: What the page does if it is operated, and not if the same is done beside it.
        after: The thing that had to be operated before this one was there; None: it was there.
        way: How it was operated.
        obstacle: Why no reaction is known.
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

    @property
    def reacts(self) -> bool:
        """Whether the page reacts if it is operated."""
        return bool(self.signs)

    @property
    def told(self) -> str:
        """What was done to it, and what the page did."""
        if self.way is None or not self.signs:
            return self.obstacle
        button = "" if self.way.how == "look" else f" + {self.way.side} {self.way.button}"
        after = "" if self.after is None else f"after {self.after}, "
        return f"{after}{self.way.how}{button}: {', '.join(self.signs)}"

    @property
    def radius_m(self) -> float:
        """How near is enough: to touch a flat thing its thickness counts, for a ray its width."""
        return self.half_m[0 if self.how == "touch" else 1]


@contextmanager
def page_app(env: EnvConfig) -> Iterator[WebXRApp]:
    """Open the page of an environment, without its task."""
    with WebXRApp(apps_wanted(env, 1)) as app:
        yield app


def find_things(
    env: EnvConfig,
    seconds: float = 4.0,
    *,
    probe: bool = True,
    say: Callable[[str], None] = lambda text: None,
    most_s: float = MOST_SEARCH_S,
) -> list[FoundThing]:
    """Find the interactive things of a page, and operate them.

    First nothing happens for some time, so that what moves by itself is known. Then a controller
    touches and points at each thing, with its inputs. What appears then is operated next.

    Args:
        env: Names the page.
        seconds: How long nothing happens.
        probe: Whether to operate the things; otherwise those are found that the page listens to.
        say: Receives a line of progress every few seconds, and what was left out.
        most_s: After so long no further thing is operated.

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
    return [thing for thing in search.found.values() if thing.listens or thing.reacts]


class _Clock:
    """The time that a search takes: says how far it is, and when it is over."""

    def __init__(self, say: Callable[[str], None], most_s: float) -> None:
        self._say, self._most_s = say, most_s
        self._began = self._said = time.monotonic()
        self._doing = "opening the page"

    def over(self, doing: str | None = None) -> bool:
        """Say every few seconds what is done, the same as before if None; return if time is up."""
        now, self._doing = time.monotonic(), doing or self._doing
        if now - self._said >= _PROGRESS_S:
            self._said = now
            self._say(f"{self._doing}, {now - self._began:.0f} of at most {self._most_s:.0f} s ...")
        return now - self._began >= self._most_s


class _Search:
    """Operates what there is in a page, in as many rounds as it takes."""

    def __init__(self, env: EnvConfig, stack: ExitStack, seconds: float, clock: _Clock) -> None:
        self._env, self._stack, self._clock = env, stack, clock
        self._rounds = 0
        self._hands: PageHands | None = None
        self._looks: dict[str, int | None] = {}
        self._again: dict[str, int] = {}
        tracks = self._open(seconds)
        self.found = {track.name: track.found() for track in tracks}

    def _open(self, seconds: float) -> list[_Track]:
        """Begin a round, and watch it while nothing happens."""
        self._stack.close()
        self._rounds += 1
        app = self._stack.enter_context(page_app(self._env))
        rays = None if self._hands is None else self._hands.rays
        hands = PageHands(app, rays=rays)
        hands.on_step = self._clock.over
        watched = _watched(app, hands, seconds, self._clock)
        names = frozenset(track.name for track in watched.tracks if track.changes)
        restless = frozenset(watched.restless) | names
        self._app, self._hands = app, hands
        self._restless = restless
        self._operator = Operator(app, hands, restless, text_rests=watched.text_rests)
        return watched.tracks

    def operate_all(self) -> None:
        """Operate each thing with the right hand, and those that did not react with the left.

        What appears is operated next, and what looks different is operated again.
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
            for new in self._appeared(name):
                self.found[new.name] = new
                queue.appendleft((new.name, "right"))
            queue.extendleft((each, side) for each in self._changed(thing))

    def _changed(self, tried: FoundThing) -> list[str]:
        """Return what looks otherwise than when it was operated, such as a key that is lit now.

        Operating it may bring on what has not reacted yet.
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

    def _appeared(self, after: str) -> list[FoundThing]:
        now = [each for each in self._app.things() if each.name not in self.found]
        tracks = [_Track.of(each, {}) for each in now if each.how != "unknown"]
        found = [track.found() for track in tracks if not _surrounds(_named(now, track.name))]
        for each in found:
            each.after = after
        return found

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
        assert self._hands is not None
        if thing.how == "look" or [*self._hands.rays] == ["head"]:
            return [Way("look", side, "trigger")]
        hows: Sequence[How] = ("touch", "point")
        if thing.listens and thing.how != "touch":
            hows = ("point", "touch")
        return [Way(how, side, button) for how in hows for button in BUTTONS]

    def _reaction(self, name: str, way: Way) -> frozenset[str]:
        try:
            return self._operator.reaction(name, way)
        except (*APP_FAILURES, SessionEnded) as error:
            left = isinstance(error, SessionEnded) or _left(error)
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


def _left(error: BaseException) -> bool:
    """Whether the page went to another address, and did not break."""
    said = str(error)
    return isinstance(error, AppDied) and any(word in said for word in _LEFT)


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
        far = [np.linalg.norm(now - place[s] - self.offset_m[s]) > _CARRIED_M for s in place]
        self.apart += all(far)

    def found(self) -> FoundThing:
        """Return the thing."""
        how = "touch" if self.how == "unknown" else self.how
        return FoundThing(
            self.name,
            how,  # type: ignore[arg-type]
            self.nearest_m,
            self.half_m,
            self.moves,
            self.how != "unknown",
        )


@dataclass
class _Watched:
    """What there is, and what of it changes by itself."""

    tracks: list[_Track] = field(default_factory=list)
    restless: set[int] = field(default_factory=set)
    text_rests: bool = True


def _watched(app: WebXRApp, hands: PageHands, seconds: float, clock: _Clock) -> _Watched:
    """Return what there is while nothing happens but head and hands that move.

    Objects that move with a hand or surround the head are left out.
    """
    tracks: dict[str, _Track] = {}
    watched = _Watched()
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
            watched.restless |= changed
            watched.text_rests &= now.text == last.text
            last = now
        hands.sway(step)
        # A page that tests rays when a trigger is pulled shows against what.
        hands.step(1, *(["right.trigger", "left.trigger"] if step % 16 in (8, 9) else []))
    now_there = app.things()
    watched.tracks = [
        track
        for name, track in tracks.items()
        if (track.apart or not track.moves) and not _surrounds(_named(now_there, name))
    ]
    return watched


def _surrounds(thing: Thing | None) -> bool:
    """Whether something is a room, a sky or a ground."""
    if thing is None:
        return False
    half = np.array(thing.half_m)
    inside = bool((np.abs(np.array(thing.place_m) - HEAD_M) < half).all())
    return inside or float(half.max()) > _LARGEST_M


def things_as_targets(found: Sequence[FoundThing]) -> list[AuditTarget]:
    """Return targets for an audit."""
    return [
        AuditTarget(
            each.name,
            each.place_m,
            how=each.how,
            radius_m=each.radius_m,
            in_app=each.told,
            reacts=each.reacts,
        )
        for each in found
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
