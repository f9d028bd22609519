"""Operate a thing of a page, and judge by a control whether the page reacted to that.

The same is done beside the thing. What the page does only at the thing is its reaction.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.audit.targets import How
from sim2vr_harness.client import WebXRApp
from sim2vr_harness.client.webxr.hands import HEAD_M, PageHands
from sim2vr_harness.client.webxr.replies import Signs, Thing

FloatArray = NDArray[np.float64]

OTHERS = "another object changes"
APPEARS = "another object appears"
_OWN = {"hears an event", "changes", APPEARS}
"""Reactions of the thing itself, and one that cannot come twice."""
MOVED_M = 0.02
"""So far something has moved."""
BUTTONS: Mapping[str, tuple[str, ...]] = {
    "trigger": ("trigger",),
    "squeeze": ("squeeze",),
    "buttons": ("thumbstick_click", "a", "b"),
}
"""What is pressed at once: the trigger, the squeeze, or all other buttons."""
_LEFT = {"a": "x", "b": "y"}
_AIM_FROM_M = np.array([0.15, 0.9, 0.2])
_GAZE_STEPS = 50
"""User steps for which the head looks at a thing; some wait so long before they react."""
_PULL_M = np.array([0.0, 0.0, 0.15])
_CARRIED_M = 0.05
_BESIDE_M, _BESIDE_RAD = 0.3, 0.25
"""How far beside a thing's size the control is: to touch it, to point at it."""
_SIDES = 8


@dataclass(frozen=True)
class Way:
    """How a thing is operated.

    Attributes:
        how: The hand touches it, its ray or the head points at it.
        side: Of the hand.
        button: A key of :data:`BUTTONS`.
    """

    how: How
    side: str
    button: str

    @property
    def held(self) -> tuple[str, ...]:
        """Names of the inputs."""
        other = _LEFT if self.side == "left" else {}
        return tuple(f"{self.side}.{other.get(each, each)}" for each in BUTTONS[self.button])


@dataclass(frozen=True)
class _Moment:
    thing: Thing | None
    signs: Signs
    pulses: int
    names: frozenset[str]


@dataclass
class _Effects:
    """What the page did: kinds, and which objects changed."""

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
        """Return what the page does if a thing is operated, and not if the same is done beside.

        Other objects that changed beside anything do not count. What the thing itself does not show
        must happen in a second try, too.
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
        """Return what the page does if the same is done beside the thing."""
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
        effects.carried = self._drag(name, way, pressed, effects, before)
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
                now = self._named(name)
                place = place if now is None else np.array(now.place_m)
            if way.how == "touch":
                at = start + part * (place + offset - start)
                hands.put(way.side, at, at + np.array([0.0, -0.3, 1.0]))
            else:
                mirror = np.array([1.0 if way.side == "right" else -1.0, 1.0, 1.0])
                hands.put(way.side, _AIM_FROM_M * mirror, place + offset)
            hands.step(1)
        hands.step(2)

    def _drag(
        self, name: str, way: Way, pressed: _Moment, effects: _Effects, before: _Moment
    ) -> bool:
        """Move the hand back with what it holds; return whether the thing came along."""
        if way.how == "look" or pressed.thing is None:
            return False
        hands = self._hands
        for _ in range(3):
            place = hands.place[way.side] - _PULL_M / 3.0
            hands.put(way.side, place)
            hands.step(1, *way.held)
        now = self._moment(name)
        self._add(effects, before, now)
        if now.thing is None:
            return False
        gap = np.array(now.thing.place_m) - np.array(pressed.thing.place_m)
        return name not in self._restless and bool(np.linalg.norm(gap) > _CARRIED_M)

    def carried_to(self, carrier: str, way: Way, name: str) -> frozenset[str]:
        """Return what a thing does if another one is let go there, and not beside it."""
        done = self._carry(carrier, way, name, beside=False)
        if not done.kinds:
            return frozenset()
        return frozenset(done.kinds - self._carry(carrier, way, name, beside=True).kinds)

    def _carry(self, carrier: str, way: Way, name: str, *, beside: bool) -> _Effects:
        hands, effects = self._hands, _Effects()
        hands.rest()
        hands.step(2)
        before, load = self._moment(name), self._named(carrier)
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
        """(3,) from a thing to a place beside it, as far as may be from other things."""
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

        def room(offset: FloatArray) -> float:
            gaps = [self._gap(place + offset, each, how) for each in others]
            return min(gaps, default=np.inf)

        return max(options, key=room)

    @staticmethod
    def _gap(at: FloatArray, thing: Thing, how: How) -> float:
        """From a place to a thing's rim, m; of rays the angle."""
        place, half = np.array(thing.place_m), max(thing.half_m)
        if how == "touch":
            return float(np.linalg.norm(at - place)) - half
        first, second = at - HEAD_M, place - HEAD_M
        angle = np.arctan2(np.linalg.norm(np.cross(first, second)), first @ second)
        return float(angle - np.arctan2(half, np.linalg.norm(second)))

    def _moment(self, name: str) -> _Moment:
        things = {each.name: each for each in self._app.things()}
        pulses = self._hands.pulses
        return _Moment(things.get(name), self._app.signs(), pulses, frozenset(things))

    def _named(self, name: str) -> Thing | None:
        return next((each for each in self._app.things() if each.name == name), None)

    def _add(self, effects: _Effects, before: _Moment, now: _Moment) -> None:
        """Add what has happened to the thing and to the user."""
        tests: Sequence[tuple[str, Callable[[], bool]]] = (
            ("hears an event", lambda: _events(now) > _events(before)),
            ("changes", lambda: self._differs(before.thing, now.thing)),
            (APPEARS, lambda: bool(now.names - before.names)),
            ("vibrates", lambda: now.pulses > before.pulses),
            ("sounds", lambda: now.signs.sounds > before.signs.sounds),
            (
                "the page's text changes",
                lambda: self._text_rests and now.signs.text != before.signs.text,
            ),
        )
        effects.kinds |= {kind for kind, test in tests if test()}

    def _differs(self, before: Thing | None, now: Thing | None) -> bool:
        if now is None or before is None:
            return now is not before
        if before.name in self._restless:
            return False
        moved = np.linalg.norm(np.array(now.place_m) - np.array(before.place_m)) > MOVED_M
        return bool(moved) or now.state != before.state

    def _changed(self, before: _Moment, now: _Moment) -> set[int]:
        first, second = before.signs.objects, now.signs.objects
        numbers = first.keys() | second.keys()
        return {k for k in numbers if first.get(k) != second.get(k)} - self._restless


def _events(moment: _Moment) -> int:
    return 0 if moment.thing is None else moment.thing.events
