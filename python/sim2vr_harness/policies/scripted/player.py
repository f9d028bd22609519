"""A user that follows a script: it touches, points, presses and grabs, by its muscles.

Where users are people, each of them is a virtual participant (:mod:`~.person`): it sees late,
takes time to recognise a target, and decides by itself, noise and all, when it is there. It does
the script over and over until the round ends.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Generator, Mapping, Sequence
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.base.errors import unknown_name
from sim2vr_harness.client import Task, TaskedApp
from sim2vr_harness.client.tasks.events import EVENT_VALUE, count_key
from sim2vr_harness.policies.hierarchical.human_motor import RECOGNITION_S, SAME_M
from sim2vr_harness.policies.hierarchical.motor_policy import WIDTH_M
from sim2vr_harness.policies.protocol import Observation
from sim2vr_harness.policies.scripted.hand import By, Hand, head_angles
from sim2vr_harness.policies.scripted.outcomes import StepOutcome
from sim2vr_harness.policies.scripted.person import PersonHand, PersonMotor
from sim2vr_harness.policies.scripted.places import Places, own_ray
from sim2vr_harness.policies.scripted.steps import Place, Step
from sim2vr_harness.users.kinematics.posture_controller import AIM_RAY

FloatArray = NDArray[np.float64]

_NEAR_M, _NEAR_DEG = 0.02, 1.0
"""Distance that counts as arrived if it holds for :data:`_SETTLED` successive user steps."""
_SETTLED = 3
_TOUCHED_M, _JUMP_M = 0.1, 0.05
"""An object counts as touched that jumps by more than the second in a user step, or vanishes, while
the hand is nearer than the first: it reacts to the hand."""
_HOLD_S, _PRESS_S, _RELEASE_S, _GRASP_S = 0.3, 0.2, 0.2, 0.2
_PERSON_S = 0.1
"""For how long participants hold, press, let go and grasp (as trained ones do)."""


def hand_of(step: Step, task: Task | None, devices: Sequence[str]) -> str:
    """Return the hand of a step: its own, the only one of the task, or the right one if worn."""
    if step.hand is not None:
        return step.hand
    wanted = () if task is None else tuple(task.devices)
    if len(wanted) == 1:
        return wanted[0].removeprefix("controller_")
    return "right" if "controller_right" in devices else "left"


def inputs_of(step: Step, task: Task | None, hand: str) -> tuple[str, ...]:
    """Return the controller inputs that a step works, such as ``right.trigger``.

    Those of the step; else trigger or squeeze, whichever the task names; else the trigger, and to
    grab the squeeze too.
    """
    if step.kind not in ("press", "grab"):
        return ()
    names = step.inputs
    if names is None:
        known = () if task is None else task.inputs
        named = [name for name in ("trigger", "squeeze") if f"{hand}.{name}" in known]
        usual = ("trigger",) if step.kind == "press" else ("trigger", "squeeze")
        names = tuple(named[:1]) or usual
    return tuple(f"{hand}.{name}" for name in names)


class ScriptedPolicy:
    """Follows steps in every episode, then stays with the last one.

    Args:
        simulation: Of the users; its ``env.user.inputs`` hold what the steps work.
        steps: At least one.
        watched: Numbers of the app whose changes count as what a step did.

    Raises:
        InputError: The app names no objects.
        ValueError: The body has no muscles, or wears no such controller.
    """

    def __init__(
        self, simulation: Any, steps: Sequence[Step], watched: Collection[str] = ()
    ) -> None:
        self._simulation, self._steps, self._watched = simulation, tuple(steps), watched
        self._motor = None if simulation.people is None else PersonMotor(simulation)
        places = Places(simulation, 0)
        for step in steps:
            for place in (step.place, step.to):
                if place is not None:
                    places.check(place)
        self.episodes: list[Episode] = self.begin(simulation.n)
        """Last episode of each user."""

    def begin(self, n: int) -> list[Episode]:
        """Begin an episode of every user."""
        self.episodes = [self._episode(i) for i in range(n)]
        return self.episodes

    def _episode(self, user: int) -> Episode:
        return Episode(self._simulation, self._steps, self._watched, user)

    def restart(self, memory: list[Episode], users: Sequence[int]) -> None:
        """Begin the script anew."""
        for i in users:
            memory[i] = self._episode(i)

    def act(
        self,
        observations: Observation,
        memory: list[Episode],
        rngs: Sequence[np.random.Generator | None],
    ) -> NDArray[np.float32]:
        """Return the actions, (N, A) in [-1, 1]; random numbers are those of participants."""
        motor = self._motor
        if motor is not None:
            for i, episode in enumerate(memory):
                if not episode.begun:
                    motor.begin(i, rngs[i])
        actions = np.stack([episode.act() for episode in memory])
        if motor is not None:
            hands = [each.hand for each in memory if isinstance(each.hand, PersonHand)]
            body = motor.act(hands, rngs)
            actions[:, : body.shape[1]] = body
        return actions

    def state_dict(self) -> Mapping[str, Any]:
        """Return no weights."""
        return {}


class Episode:
    """A script in one episode of a user.

    Args:
        simulation: Of the users.
        steps: What to do.
        watched: As of :class:`ScriptedPolicy`.
        user: Whose episode it is.

    Attributes:
        outcomes: Of the steps that were begun.
        hand: That does the step.
        begun: Whether it has acted.
    """

    def __init__(
        self, simulation: Any, steps: Sequence[Step], watched: Collection[str], user: int
    ) -> None:
        self._simulation, self._steps = simulation, steps
        self._watched, self._user = watched, user
        app = simulation.apps[user]
        self._task: Task | None = app.task if isinstance(app, TaskedApp) else None
        self._places = Places(simulation, user)
        sides = [hand_of(step, self._task, simulation.body.devices) for step in steps]
        self._hz = hz = simulation.config.action_frequency_hz
        self._person = None if simulation.people is None else simulation.users.persons[user]
        kind = Hand if self._person is None else PersonHand
        self._hands = {side: kind(simulation, side, user) for side in dict.fromkeys(sides)}
        delay_s = 0.0 if self._person is None else self._person.visual_delay_s
        # User steps after which one sees where a known target is, and recognises another one.
        self._follows, self._decides = (
            math.ceil(late_s * hz - 1e-9) for late_s in (delay_s, delay_s + RECOGNITION_S)
        )
        self._now = self._since = 0
        """Current user step, and the first one in which the step's target can be present."""
        self._watching: Place | None = None
        self._seen: list[FloatArray | None] = []
        """Positions of the target in the last user steps, the newest last."""
        self._aim: FloatArray | None = None
        """Position of the target as the participant perceives it."""
        self._known: set[str] = set()
        self._values: dict[str, float] = {}
        self._before: dict[str, float] = {}
        self._pressed: tuple[str, ...] = ()
        self.hand = self._hands[sides[0]]
        self._run = self._all()
        self.begun = self._over = self._finished = self._reacted = False
        self.outcomes: list[StepOutcome] = []

    def _look(self) -> None:
        """Note the app's numbers after a user step."""
        log = self._simulation.logs[self._user]
        self._values = {name: log[name] for name in log if name in self._watched}
        self._before = self._before or self._values

    def act(self) -> NDArray[np.float32]:
        """Return the action of the next user step, (A,)."""
        action: NDArray[np.float32] = self._simulation.resting_action.copy()
        if self._over:
            return action
        if self.begun:
            self._look()
            self._now += 1
        self.begun = True
        if self._watching is not None:
            self._watch(self._watching)
        next(self._run)
        body = self.hand.action()
        if body is not None:
            action[: len(body)] = body
        for name in self._pressed:
            action[self._simulation.actions.names.index(name)] = 1.0
        return action

    def ended(self) -> list[StepOutcome]:
        """Return the outcomes of all steps, as the round is over; the user rests from now on."""
        self._look()
        self._over = True
        if not self._finished and self.outcomes:
            self._compare(self.outcomes[-1])
        if self._person is not None:  # what the end has cut short is no failure
            return self.outcomes[:-1] if any(one.done for one in self.outcomes) else self.outcomes
        missing = self._steps[len(self.outcomes) :]
        return self.outcomes + [
            StepOutcome(step.text, problem="the round ended before it was begun")
            for step in missing
        ]

    # --- steps -----------------------------------------------------------------------------------

    def _all(self) -> Generator[None]:
        while True:
            for _, entry in groupby(self._steps, key=lambda step: step.entry):
                yield from self._entry(tuple(entry))
            if self._person is None:
                break
        self._finished = True
        last, by = self._steps[-1], self.outcomes[-1].by
        while True:
            where = self._located(last.place if last.to is None else last.to)
            if where is not None:
                self.hand.follow(where, by)
            yield

    def _entry(self, steps: Sequence[Step]) -> Generator[None]:
        """Do the steps of an entry, over and over if it says until when."""
        until = steps[0].until
        before = self._number(until)
        while True:
            for step in steps:
                side = hand_of(step, self._task, self._simulation.body.devices)
                self.hand, self._before = self._hands[side], self._values
                outcome = StepOutcome(step.text, by=step.by or "touch", hand=side)
                outcome.problem = "the round ended before it was done"
                self.outcomes.append(outcome)
                outcome.problem = yield from self._do(step, outcome)
                outcome.done = not outcome.problem
                self._pressed = ()
                self._compare(outcome)
                if until is not None and self._number(until) != before:
                    return
            if until is None:
                return

    def _number(self, name: str | None) -> float | None:
        """Return a number of the app, or how often an event of the task has happened."""
        log = self._simulation.logs[self._user]
        if name is None or not log:
            return None
        key = name if name in log else count_key(name)
        if key not in log:
            raise unknown_name("until", name, [one for one in log if EVENT_VALUE not in one])
        return log[key]

    def _do(self, step: Step, outcome: StepOutcome) -> Generator[None, None, str]:
        """Do a step; return why it is not done, empty if it is."""
        problem = yield from self._appear(step, outcome)
        problem = problem or (yield from self._arrive(step, outcome))
        if problem:
            return problem
        outcome.time_s = (self._now + 1 - self._since) / self._hz  # the app knows a step later
        true = self._places.find(step.place, self.hand.position)
        if true is not None:
            wide = self._places.shape(true)[0] or 2.0 * _NEAR_M
            # What is touched may have jumped away at that.
            seen = [true, *(self._seen if outcome.by == "touch" else ())]
            off_m = min(self.hand.off_m(one, outcome.by) for one in seen if one is not None)
            outcome.missed = off_m > 0.5 * wide and not self._reacted
            if "headset" in self._simulation.body.devices:
                outcome.head_deg = head_angles(
                    self._simulation.users, self._user, true if self._aim is None else self._aim
                )
        self._since = self._now + 1  # what this brings up is not there before
        if step.kind in ("touch", "point"):
            yield from self._stay(_HOLD_S)
            return ""
        self._before = self._values
        outcome.inputs = self._pressed = inputs_of(step, self._task, outcome.hand)
        if step.kind == "grab":
            return (yield from self._carry(step, outcome))
        yield from self._stay(_PRESS_S)
        self._pressed = ()
        yield from self._stay(_RELEASE_S)
        return ""

    def _appear(self, step: Step, outcome: StepOutcome) -> Generator[None, None, str]:
        """Wait for the object; choose between touch and ray."""
        self._places.forget()
        self._aim = None
        if self._person is None or step.place != self._watching:
            self._since = self._now
        if step.place != self._watching:
            self._watch(step.place)
        for _ in range(self._user_steps(step.seconds)):
            where = self._located(step.place)
            if where is not None:
                self.hand.hold_tool(self._tool(step))
                if step.by is None:
                    outcome.by = "ray" if self.hand.beyond_m(where) else "touch"
                if outcome.by == "ray":
                    # All apps are the same; each would be loaded once more to be asked.
                    self.hand.ray = own_ray(self._simulation, outcome.hand)
                    outcome.ray_off_deg = float(
                        np.degrees(
                            np.arccos(
                                np.clip(self.hand.ray.direction @ AIM_RAY.direction, -1.0, 1.0)
                            )
                        )
                    )
                return ""
            yield
        name = str(step.place)
        if name not in self._known:
            raise self._places.unknown(name)
        return f"there was no object {name!r} within {step.seconds:g} s"

    def _arrive(self, step: Step, outcome: StepOutcome) -> Generator[None, None, str]:
        after, error = yield from self._reach(
            lambda: self._located(step.place),
            outcome.by,
            step.seconds,
            pushes=step.kind == "touch",
        )
        outcome.arrived_s = after
        if outcome.by == "ray":
            outcome.angle_deg = error
        else:
            outcome.gap_m = error
        if after is not None:
            return ""
        if error is None:
            return f"the object vanished within {step.seconds:g} s"
        if outcome.by == "ray":
            return f"the ray came as near as {error:.1f} degrees in {step.seconds:g} s"
        text = f"the hand came as near as {100 * error:.1f} cm in {step.seconds:g} s"
        beyond = 0.0 if self.hand.place is None else self.hand.beyond_m(self.hand.place)
        return f"{text}; the place is {100 * beyond:.0f} cm out of reach" if beyond else text

    def _carry(self, step: Step, outcome: StepOutcome) -> Generator[None, None, str]:
        """Hold the inputs, move to the second place, and let go."""
        assert step.to is not None
        first = self._located(step.place)
        # Where it was when the hand closed: the second place may move with what is held.
        to = self._located(step.to)
        if to is None:
            raise self._places.unknown(str(step.to))
        wide = self._places.shape(to)[0]
        yield from self._stay(_GRASP_S)
        held = self._places.find(step.place, self.hand.position)
        if held is not None and step.tool is None and self.hand.error(held, "touch") < _TOUCHED_M:
            self.hand.hold_tool(held)  # what is held goes there, not the hand
        moved = [0.0]

        def carried() -> FloatArray:
            now = self._located(step.place)
            if first is not None and now is not None:
                moved.append(_distance(now, first))
            return to

        after, error = yield from self._reach(carried, "touch", step.seconds)
        outcome.moved_s, outcome.moved_gap_m = after, error
        self._pressed = ()
        yield from self._stay(_RELEASE_S)
        if isinstance(step.place, str):
            outcome.object_moved_m = max(moved)
        rests = self._places.find(step.place, self.hand.position)
        if self._person is not None and rests is not None and wide is not None:
            outcome.missed = outcome.missed or _distance(rests, to) > 0.5 * wide
        return "" if after is not None else f"did not get there in {step.seconds:g} s"

    def _reach(
        self,
        place: Callable[[], FloatArray | None],
        by: By,
        seconds: float,
        *,
        pushes: bool = False,
    ) -> Generator[None, None, tuple[float | None, float | None]]:
        """Move until there; return after how many seconds (None: not), and the last or least error.

        The error is a distance, m, or the ray's angle, degrees.
        """
        near = _NEAR_M if by == "touch" else _NEAR_DEG
        settled, least, error, before = 0, None, np.inf, None
        offs: list[float] = []
        for k in range(self._user_steps(seconds)):
            where = place()
            reacts = before is not None and (where is None or _distance(where, before) > _JUMP_M)
            self._reacted = reacts and by == "touch" and error < _TOUCHED_M
            if self._reacted:
                return (k - 1) / self._hz, error
            if where is not None:
                error = self.hand.error(where, by)
                least = error if least is None else min(least, error)
                settled = settled + 1 if error <= near else 0
                if isinstance(self.hand, PersonHand):
                    offs.append(self.hand.off_m(where, by))
                    # People end on narrow targets when they see, late, that they are on them; after
                    # a miss they recognise that first.
                    seen = offs[self._decides : -self._follows][-2:]
                    on = not self.hand.narrow or (
                        len(seen) > 1 and max(seen) <= 0.5 * self.hand.width_m
                    )
                    # At first it was at its last target.
                    if k and self.hand.over and on and not (pushes and self.hand.push()):
                        return k / self._hz, error
                elif settled == _SETTLED:
                    return (k - _SETTLED + 1) / self._hz, error
                self.hand.follow(where, by)
                if isinstance(self.hand, PersonHand) and self.hand.new:
                    width_m, facing = self._places.shape(where)
                    self.hand.aim(width_m or WIDTH_M, facing if pushes else None)
            before = where
            yield
        return None, least

    def _stay(self, seconds: float) -> Generator[None]:
        """Stay where the hand is; a place that jumps is not followed."""
        for _ in range(self._user_steps(seconds if self._person is None else _PERSON_S)):
            yield

    # --- places and values -----------------------------------------------------------------------

    def _watch(self, place: Place) -> None:
        """Note where a target is in this user step."""
        if place != self._watching:
            self._watching, self._seen = place, []
        if self._person is not None:
            self._seen = self._seen[-self._decides :]
            self._seen.append(self._places.find(place, self.hand.position))

    def _located(self, place: Place) -> FloatArray | None:
        """Return where something is; of participants, where they believe the target to be."""
        if self._person is None or place != self._watching:
            found = self._places.find(place, self.hand.position)
        else:
            found = self._believed()
        if found is not None and isinstance(place, str):
            self._known.add(place)
        return found

    def _believed(self) -> FloatArray | None:
        """Follow a target by what is seen late; recognise that it is elsewhere later still."""

        def ago(steps: int) -> FloatArray | None:
            return self._seen[-1 - steps] if len(self._seen) > steps else None

        near, aim = ago(self._follows), self._aim
        if aim is not None and near is not None and _distance(near, aim) < SAME_M:
            self._aim = near
            return near
        if self._now - self._since >= self._decides:
            self._aim = ago(self._decides)
        return self._aim

    def _tool(self, step: Step) -> FloatArray | None:
        if step.tool is None:
            return None
        found = self._located(step.tool)
        if found is None:
            raise self._places.unknown(step.tool)
        away = found - self.hand.position
        wide = self._places.shape(found, player=True)[0] or 0.0
        return found + 0.5 * wide * away / max(float(np.linalg.norm(away)), 1e-9)

    def _compare(self, outcome: StepOutcome) -> None:
        """Note which values have changed."""
        outcome.watched = tuple(self._values)
        outcome.changed = {
            name: (self._before[name], value)
            for name, value in self._values.items()
            if self._before.get(name, value) != value
        }

    def _user_steps(self, seconds: float) -> int:
        return max(1, round(seconds * self._hz))


def _distance(first: FloatArray, second: FloatArray) -> float:
    return float(np.linalg.norm(first - second))
