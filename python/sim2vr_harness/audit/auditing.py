"""``sim2vr-harness audit``: judge a population on targets, and look for what includes more."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from sim2vr_harness.audit.judging import judge
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
from sim2vr_harness.audit.reaching import Crowd
from sim2vr_harness.audit.remedies import GOAL, Remedy, remedy
from sim2vr_harness.audit.summary import Audit
from sim2vr_harness.audit.targets import AuditTarget

__all__ = ["limitations_of", "limited_persons", "run"]

_PART = 10
"""One in so many persons is judged with each limitation, at least :data:`FEWEST`."""


def limitations_of(stance: Stance) -> tuple[Limitation, ...]:
    """Return the limitations that differ from an audit with a stance."""
    return tuple(each for each in LIMITATIONS if each.stance != stance)


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
    say: Callable[[str], None] = lambda text: None,
) -> Audit:
    """Audit targets.

    Args:
        title: What is audited.
        targets: At least one.
        people: Persons of the population.
        seed: Of the population.
        stance: Of everyone.
        say: Receives what is being done.
    """
    say(f"{people} persons, {len(targets)} targets ...")
    subjects = draw(people, seed)
    crowd = Crowd(subjects, stance, NONE)
    judged = judge(crowd, targets, NONE)
    few: list[Subject] = subjects[: limited_persons(people)]
    limited = []
    for limitation in limitations_of(stance):
        say(f"{len(few)} persons, {limitation.name} ...")
        limited.append(judge(Crowd(few, stance, limitation), targets, limitation))
    remedies: list[Remedy | None] = []
    for column, target in enumerate(targets):
        if judged.usable[:, column].mean() >= GOAL:
            remedies.append(None)
            continue
        say(f"what would include 95 %: {target.name} ...")
        remedies.append(remedy(crowd, target, judged, column))
    order = sorted(range(people), key=lambda i: subjects[i].person.stature_m)
    middle = order[people // 2]
    landmarks = crowd.landmarks(middle)
    groups = groups_of(subjects)
    return Audit(title, seed, stance, targets, judged, groups, limited, remedies, middle, landmarks)
