"""``sim2vr-harness audit``: judge a population on targets, and search for improvements.

With a user of its own: the user's reach, and the time for which it holds a posture.
"""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import replace
from typing import TypeVar, cast

import numpy as np

from sim2vr_harness.audit.hull import Measured, chosen_point, measure, people_margins
from sim2vr_harness.audit.judging import Judged, judge
from sim2vr_harness.audit.pacing import path_loads
from sim2vr_harness.audit.pages import find_things, things_as_targets
from sim2vr_harness.audit.population import (
    FEWEST,
    LIMITATIONS,
    MODEL,
    NONE,
    Limitation,
    Stance,
    draw,
    groups_of,
)
from sim2vr_harness.audit.postures import Held, hold, who_hold
from sim2vr_harness.audit.reaching import Crowd
from sim2vr_harness.audit.remedies import GOAL, remedy
from sim2vr_harness.audit.request import AuditRequest
from sim2vr_harness.audit.summary import Audit, AuditPath
from sim2vr_harness.audit.targets import (
    How,
    Target,
    alike,
    found_targets,
    listed_targets,
    pressed_places,
    seen_targets,
    tool_point,
)
from sim2vr_harness.base.cores import available
from sim2vr_harness.base.errors import InputError
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.evaluation.evaluate import evaluate
from sim2vr_harness.evaluation.request import Request
from sim2vr_harness.play.environment import evaluation_env
from sim2vr_harness.runs.config import TrainingConfig
from sim2vr_harness.tools.users import environment_of

T = TypeVar("T")
Say = Callable[[str], None]

_PARTS = 4
"""In which everyone's targets are judged."""
_PART = 10
"""Divisor of the number of participants that are judged with each limitation, at least
:data:`FEWEST`."""
_TWO_HANDED = "mobl_arms_bimanual"
"""Looks at games that are played with both hands."""


def population_audit(request: AuditRequest, say: Say = lambda text: None) -> Audit:
    """Find the targets of a request, and audit a population.

    Args:
        request: Without ``user``.
        say: Receives the present activity.

    Raises:
        InputError: Something cannot be used.
    """
    targets = _listed(request, say)
    if request.game is not None:
        for condition in request.condition or (None,):
            targets += _of_game(request, condition, say)
    # An app that raises its user lowers its world, as the body stays where it is.
    down_m = np.array([0.0, request.height_offset, 0.0])
    targets = [
        each if each.from_head else replace(each, place_m=each.place_m - down_m) for each in targets
    ]
    audit = run(
        request.title,
        targets,
        people=request.people or 500,
        seed=request.seed,
        stance=cast("Stance", request.stance),
        recline_deg=request.recline,
        pace=request.pace,
        say=say,
    )
    if request.script is None:
        return audit
    say(f"{request.operate} virtual participants carry out {request.script!r} ...")
    asked = Request(
        conditions=request.condition,
        episodes=1,
        people=request.operate,
        seed=request.seed,
        overrides=request.overrides,
        trust_app=request.trust_app,
        app=request.app or {"game": request.game, "transport": "in_process"},
    )
    return replace(audit, script=request.script, rounds=evaluate(request.script, asked).rounds)


def user_reach(request: AuditRequest, say: Say = lambda text: None) -> Measured:
    """Measure the reach of a request's user, and its targets.

    Args:
        request: With ``user``.
        say: Receives the present activity.

    Raises:
        InputError: Something cannot be used.
    """
    assert request.user is not None
    environments = [
        environment_of(
            request.user,
            game=request.game,
            condition=condition,
            overrides=request.overrides,
            trust_app=request.trust_app,
        )
        for condition in request.condition or (None,)
    ]
    body = environments[0].body
    point = chosen_point(body, request.point)
    if request.tool is not None:
        with closing(Simulation(alike(environments[0]), 1)) as users:
            users.reset(seeds=[1])
            point = tool_point(users.apps[0].scene(), request.tool)
    listed = _listed(request, say)

    def look(env: ResolvedEnv, person: int | None) -> list[Target]:
        pattern, seconds = request.objects, request.seconds
        return seen_targets(env, pattern, seconds=seconds, person=person, still=person is None)

    sources = [(environments[0], "", listed, lambda _env, _person: listed)] if listed else []
    if request.game is not None:
        say(f"targets of {request.game} ...")
        names = request.condition or [""]
        sources += [
            (env, name, look(alike(env), None), look)
            for env, name in zip(environments, names, strict=True)
        ]
    targets, margins = [], []
    for env, name, found, find in sources:
        targets += [replace(each, name=f"{name} {each.name}".strip()) for each in found]
        if request.people is not None:
            say(f"{request.people} virtual participants, {len(found)} targets ...")
            margins.append(people_margins(env, point, found, request.people, find, request.seed))
    say("what is within reach ...")
    people = np.concatenate(margins, axis=1) if margins else None
    return measure(body, point, targets, people, cell_m=request.cell)


def posture_endurance(request: AuditRequest) -> list[list[Held]]:
    """Return how each arm of each participant holds the posture of a request.

    Args:
        request: With ``user`` and ``pose``.

    Raises:
        InputError: Something cannot be used.
    """
    assert request.user is not None and request.pose is not None
    env = environment_of(request.user, overrides=request.overrides, trust_app=request.trust_app)
    persons = who_hold(env.config.user, request.people)
    return [hold(who, request.pose, request.load, strength) for who, strength in persons]


def _listed(request: AuditRequest, say: Say) -> list[Target]:
    """Return the targets that are listed, recorded, or the page's things."""
    env = None
    if request.app:
        env = evaluation_env(
            TrainingConfig(), request.app, request.overrides, source="--set"
        ).config
    found = listed_targets(request.targets, env)
    if env is not None and not request.targets and request.app.get("page"):
        say(f"things of {env.app.page} ...")
        found = things_as_targets(find_things(env, request.seconds, say=say))
        if not found:
            expected = "objects that listen or react to a controller, or --targets FILE.yaml"
            raise InputError("--page", f"{env.app.page}, in which nothing is found", expected)
    return found + ([] if request.session is None else pressed_places(request.session))


def _of_game(request: AuditRequest, condition: str | None, say: Say) -> list[Target]:
    # The game before the options, which are its own.
    chosen = [f"env.app.game={request.game}", *request.overrides]
    env = environment_of(MODEL, condition=condition, overrides=chosen)
    if "controller_left" in env.facts.needs("right"):
        env = environment_of(_TWO_HANDED, condition=condition, overrides=chosen)
    say(f"targets of {request.game}{f', condition {condition}' if condition else ''} ...")
    how = cast("How", request.how)
    found = found_targets(env, objects=request.objects, seconds=request.seconds, how=how)
    return [replace(each, name=f"{condition or ''} {each.name}".strip()) for each in found]


def limitations_of(stance: str, recline_deg: float) -> tuple[Limitation, ...]:
    """Return the limitations that differ from an audit with a posture."""
    own = stance, recline_deg
    return tuple(e for e in LIMITATIONS if (e.stance, e.recline_deg) != own or e.lift_m)


def limited_persons(people: int) -> int:
    """Return how many of an audit's participants are judged with each limitation."""
    return min(people, max(FEWEST, people // _PART))


def run(
    title: str,
    targets: Sequence[Target],
    *,
    people: int = 500,
    seed: int = 1,
    stance: Stance = "seated",
    recline_deg: float = 0.0,
    pace: float = 20.0,
    processes: int = 0,
    say: Say = lambda text: None,
) -> Audit:
    """Audit targets.

    Args:
        title: Name of the audited app or list.
        targets: At least one.
        people: Participants of the population.
        seed: Of the population.
        stance: Of everyone.
        recline_deg: By how much everyone's trunk leans back.
        pace: Uses of a target in a minute.
        processes: At most; 0: one per core. The number does not change any result.
        say: Receives the present activity.
    """
    say(f"{people} virtual participants, {len(targets)} targets ...")
    subjects = draw(people, seed, recline_deg)
    everyone = Crowd(subjects, stance, NONE)
    # The same parts for any number of processes, so that this number changes no result: everyone on
    # some targets each, and some of them with each limitation on all targets.
    parts = Parts(processes)
    few = subjects[: limited_persons(len(subjects))]
    every, limitations = np.arange(len(targets)), limitations_of(stance, recline_deg)
    jobs = [(everyone, each, NONE) for each in np.array_split(every, _PARTS) if len(each)]
    count = len(jobs)
    jobs += [(Crowd(few, stance, limitation), every, limitation) for limitation in limitations]

    def judged_part(number: int) -> Judged:
        crowd, columns, limitation = jobs[number]
        chosen, whole = [targets[i] for i in columns.tolist()], number < count
        return judge(crowd, chosen, limitation, pace if whole else None, muscles=whole)

    verdicts = parts.run(judged_part, range(len(jobs)))
    judged, limited = Judged.joined(verdicts[:count]), verdicts[count:]
    # What would include 95 %, for each target; None where 95 % are included.
    missed = [i for i in range(len(targets)) if judged.usable[:, i].mean() < GOAL]
    if missed:
        say(f"what would include 95 %: {', '.join(targets[i].name for i in missed)} ...")
    fixes = parts.run(lambda i: remedy(everyone, targets[i], judged, i), missed)
    found = dict(zip(missed, fixes, strict=True))
    remedies = [found.get(i) for i in range(len(targets))]
    middle = sorted(range(people), key=lambda i: subjects[i].person.stature_m)[people // 2]
    # Its paths from each target that it reaches to the next one.
    postures = judged.postures[middle]
    known = [i for i in range(len(targets)) if not np.isnan(postures[i]).any()]
    loads = path_loads(subjects[middle], [postures[i] for i in known], NONE)
    pairs = zip(known, known[1:], loads, strict=False)
    return Audit(
        title=title,
        seed=seed,
        stance=stance if recline_deg == 0.0 else "reclined",
        pace=pace,
        targets=targets,
        crowd=everyone,
        judged=judged,
        groups=groups_of(subjects),
        limited=limited,
        remedies=remedies,
        middle=middle,
        paths=[AuditPath(targets[a].name, targets[b].name, *load) for a, b, load in pairs],
    )


_do: Callable[[int], object] = int
"""Function that the worker processes call; they inherit it by fork, as bodies cannot be pickled."""


def _part(number: int) -> object:
    return _do(number)


def _quiet() -> None:
    """Leave signals to the first process, which ends the others."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)


class Parts:
    """Runs a function for some numbers.

    Args:
        processes: How many at most; 0: one per core.
    """

    def __init__(self, processes: int = 0) -> None:
        self._processes = processes or available()

    def run(self, function: Callable[[int], T], numbers: Sequence[int]) -> list[T]:
        """Return the function's results for all numbers, in order."""
        count = min(self._processes, len(numbers))
        if count < 2:
            return [function(number) for number in numbers]
        global _do
        _do = function
        with multiprocessing.get_context("fork").Pool(count, _quiet) as pool:
            found: list[T] = pool.map(_part, numbers, chunksize=1)  # type: ignore[arg-type]
            pool.close()
            pool.join()
        return found
