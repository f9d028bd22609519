"""``sim2vr-harness audit``: judge a population on targets, and look for what includes more."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from sim2vr_harness.audit.acting import act_out
from sim2vr_harness.audit.judging import Judged, judge
from sim2vr_harness.audit.pacing import path_loads
from sim2vr_harness.audit.population import (
    FEWEST,
    LIMITATIONS,
    NONE,
    Limitation,
    Stance,
    Subject,
    draw,
    groups_of,
)
from sim2vr_harness.audit.processes import Parts
from sim2vr_harness.audit.reaching import Crowd, FloatArray
from sim2vr_harness.audit.remedies import GOAL, Remedy, remedy
from sim2vr_harness.audit.summary import Audit, AuditPath
from sim2vr_harness.audit.targets import AuditTarget

PACE = 20.0
"""Uses of a target in a minute."""
_PARTS = 4
"""In which everyone's targets are judged."""
_PART = 10
"""One in so many persons is judged with each limitation, at least :data:`FEWEST`."""


def limitations_of(stance: Stance) -> tuple[Limitation, ...]:
    """Return the limitations that differ from an audit with a stance."""
    return tuple(each for each in LIMITATIONS if each.stance != stance or each.lift_m)


def limited_persons(people: int) -> int:
    """Return how many of an audit's persons are judged with each limitation."""
    return min(people, max(FEWEST, people // _PART))


def run(
    title: str,
    targets: Sequence[AuditTarget],
    *,
    people: int = 500,
    seed: int = 1,
    stance: Stance = "seated",
    pace: float = PACE,
    operate: int = 0,
    processes: int = 0,
    say: Callable[[str], None] = lambda text: None,
) -> Audit:
    """Audit targets.

    Args:
        title: What is audited.
        targets: At least one.
        people: Persons of the population.
        seed: Of the population.
        stance: Of everyone.
        pace: Uses of a target in a minute.
        operate: How many persons act it out.
        processes: At most; 0: one per core. They change no result.
        say: Receives what is being done.
    """
    say(f"{people} persons, {len(targets)} targets ...")
    subjects = draw(people, seed)
    everyone = Crowd(subjects, stance, NONE)
    parts = Parts(processes)
    judged, limited = _judge_all(everyone, stance, targets, pace, parts)
    remedies = _remedies(everyone, targets, judged, parts, say)
    acting = min(operate, people)
    if acting:
        say(f"{acting} persons act it out ...")
    acted = parts.run(lambda person: act_out(everyone, person, targets, judged), range(acting))
    middle = sorted(range(people), key=lambda i: subjects[i].person.stature_m)[people // 2]
    return Audit(
        title,
        seed,
        stance,
        pace,
        targets,
        subjects,
        everyone.lift_m,
        judged,
        groups_of(subjects),
        limited,
        remedies,
        middle,
        everyone.landmarks(middle),
        _paths(subjects[middle], targets, judged.postures[middle]),
        acted,
    )


def _judge_all(
    everyone: Crowd, stance: Stance, targets: Sequence[AuditTarget], pace: float, parts: Parts
) -> tuple[Judged, list[Judged]]:
    """Return everyone judged on all targets, and some of them with each limitation.

    The same parts for any number of processes, so that this number changes no result.
    """
    few = everyone.subjects[: limited_persons(len(everyone.subjects))]
    limitations = limitations_of(stance)
    crowds = [everyone, *(Crowd(few, stance, limitation) for limitation in limitations)]
    shares = [(0, columns) for columns in np.array_split(np.arange(len(targets)), _PARTS)]
    jobs = [each for each in shares if len(each[1])]
    count = len(jobs)
    jobs += [(1 + i, np.arange(len(targets))) for i in range(len(limitations))]

    def judged_part(number: int) -> Judged:
        crowd, columns = jobs[number]
        limitation = NONE if crowd == 0 else limitations[crowd - 1]
        chosen = [targets[i] for i in columns.tolist()]
        return judge(crowds[crowd], chosen, limitation, None if crowd else pace, muscles=not crowd)

    found = parts.run(judged_part, range(len(jobs)))
    return Judged.joined(found[:count]), found[count:]


def _remedies(
    everyone: Crowd,
    targets: Sequence[AuditTarget],
    judged: Judged,
    parts: Parts,
    say: Callable[[str], None],
) -> list[Remedy | None]:
    """Return what would include 95 %, for each target; None where 95 % are included."""
    missed = [i for i in range(len(targets)) if judged.usable[:, i].mean() < GOAL]
    if missed:
        say(f"what would include 95 %: {', '.join(targets[i].name for i in missed)} ...")
    found: list[Remedy | None] = [None] * len(targets)
    fixes = parts.run(lambda i: remedy(everyone, targets[i], judged, i), missed)
    for column, fix in zip(missed, fixes, strict=True):
        found[column] = fix
    return found


def _paths(
    subject: Subject, targets: Sequence[AuditTarget], postures: FloatArray
) -> list[AuditPath]:
    """Return the paths of a person from each target that it reaches to the next one."""
    known = [i for i in range(len(targets)) if not np.isnan(postures[i]).any()]
    loads = path_loads(subject, [postures[i] for i in known], NONE)
    pairs = zip(known, known[1:], loads, strict=False)
    return [AuditPath(targets[a].name, targets[b].name, *load) for a, b, load in pairs]
