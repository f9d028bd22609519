"""The audit's results as plain values: by target, by group, and as measures to expect."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sim2vr_harness.audit.judging import EASY_RAISED_DEG, Judged, can_grip, steady
from sim2vr_harness.audit.pacing import MODELS
from sim2vr_harness.audit.population import FEWEST, Group, Limitation, Subject
from sim2vr_harness.audit.reaching import Crowd, FloatArray, Ints
from sim2vr_harness.audit.remedies import Remedy
from sim2vr_harness.audit.targets import Target
from sim2vr_harness.client.frames import position_to_mujoco
from sim2vr_harness.evaluation.expectations import Estimate
from sim2vr_harness.play.round import Round
from sim2vr_harness.statistics.intervals import wilson_interval


def cause(judged: Judged, target: Target, person: int, column: int) -> str | None:
    """Return why a participant cannot use a target; None: it can be used."""
    place, needed = judged.places_m[person, column], judged.needed_m[person, column]
    if not judged.seen[person, column]:
        return "behind" if place[2] < 0.0 else "out of view"
    if not judged.reached[person, column]:
        if target.hand == "both" and judged.one_hand[person, column]:
            return "needs two hands"
        if target.how == "point":
            return "the ray cannot be aimed there"
        side = int(np.abs(needed).argmax())
        if side == 0:
            return "too far to the side"
        if side == 1:
            return "too high" if needed[1] < 0.0 else "too low"
        return "behind" if place[2] < 0.0 else "too far" if needed[2] < 0.0 else "too near"
    if not judged.held[person, column]:
        if not steady(target, position_to_mujoco(place), judged.limitation):
            return "too small for a tremor"
        weak = judged.published_share[person, column] > 1.0
        if not weak and not can_grip(judged.grip_share[person, column], target.hold_s):
            return "grip too weak" if target.grip_n > 0.0 else "too heavy to grip"
        if target.load_kg > 0.0:
            return "too heavy"
        return "too weak to hold the arm" if weak else "held too long"
    return None


_REACH = "EN 301 549, 4.2.8 usage with limited reach"
_STRENGTH = "EN 301 549, 4.2.7 usage with limited manipulation or strength"
_MOTION = "XAUR 4.2, motion agnostic interactions"
CLAUSES = {
    "needs two hands": "EN 301 549, 5.9 simultaneous user actions",
    **dict.fromkeys(("the ray cannot be aimed there", "too small for a tremor"), _STRENGTH),
    **dict.fromkeys(("too high", "too low", "too far", "too near", "too far to the side"), _REACH),
    **dict.fromkeys(("grip too weak", "too heavy to grip", "too heavy"), _STRENGTH),
    **dict.fromkeys(("too weak to hold the arm", "held too long"), _STRENGTH),
    **dict.fromkeys(("behind", "out of view"), _MOTION),
}
"""Cause -> the clause of EN 301 549 (V3.2.1), or the user need of W3C's XR Accessibility User
Requirements, that it concerns."""


def causes(judged: Judged, target: Target, column: int, members: Ints) -> dict[str, int]:
    """Return how many of some participants are excluded by each cause, the most frequent first."""
    found = (cause(judged, target, int(person), column) for person in members)
    counts = Counter(each for each in found if each is not None)
    return dict(sorted(counts.items(), key=lambda item: (-item[1], item[0])))


EVERYONE = "everyone"
_PARTS = ("use", "reach", "seen", "held")
MEASURES = tuple(f"{part}.{kind}" for part in _PARTS for kind in ("min", "mean"))
"""``reach.min``: the least proportion over targets, ``reach.mean`` the mean one."""


@dataclass(frozen=True)
class AuditPath:
    """A movement of the participant of median stature from one target to the next.

    Attributes:
        start, end: Names of targets.
        mean, peak: Torque at the shoulder as a share of published strength.
    """

    start: str
    end: str
    mean: float
    peak: float


@dataclass(frozen=True)
class Audit:
    """Results of an audit.

    Attributes:
        title: Name of the audited app or list.
        seed, stance: Of the population.
        pace: Uses of a target in a minute.
        targets: T of them.
        crowd: The participants.
        judged: Of everyone.
        groups: Of everyone.
        limited: The same participants with limitations, by group.
        remedies: (T,) changes that would include 95 %; None if 95 % are included.
        middle: Number of the participant of median stature.
        paths: Its movements from target to target.
        script: What some participants did in the app; empty: nothing.
        rounds: Of each of them, and of each condition.
    """

    title: str
    seed: int
    stance: str
    pace: float
    targets: Sequence[Target]
    crowd: Crowd
    judged: Judged
    groups: Sequence[Group]
    limited: Sequence[Judged]
    remedies: Sequence[Remedy | None]
    middle: int
    paths: Sequence[AuditPath]
    script: str = ""
    rounds: Sequence[Round] = ()

    @property
    def subjects(self) -> Sequence[Subject]:
        """The participants."""
        return self.crowd.subjects

    def in_body(self, person: int, places: FloatArray | None = None) -> FloatArray:
        """(T, 3) targets, or other places of MuJoCo's world, in the right-handed upright body."""
        if places is None:
            places = position_to_mujoco(self.judged.places_m[person])
        who = np.full(len(places), person)
        return self.crowd.local(places, who, np.full(len(places), self.subjects[person].mirrored))

    def columns(self) -> list[tuple[str, Limitation | None, Judged, Ints]]:
        """Return name, limitation, verdicts and members of all groups, everyone first."""
        every = np.arange(len(self.judged.seen))
        rows: list[tuple[str, Limitation | None, Judged, Ints]] = [
            (EVERYONE, None, self.judged, every)
        ]
        rows += [(group.name, None, self.judged, group.members) for group in self.groups]
        rows += [
            (each.limitation.name, each.limitation, each, np.arange(len(each.seen)))
            for each in self.limited
        ]
        return rows


def proportion(successes: int, n: int) -> dict[str, float | int | None]:
    """Return a proportion with Wilson's interval; of too few participants, only their number."""
    if n < FEWEST:
        return {"n": n, "share": None, "low": None, "high": None}
    low, high = wilson_interval(successes, n)
    return {"n": n, "share": successes / n, "low": round(low, 4), "high": round(high, 4)}


def estimates(audit: Audit) -> dict[str, dict[str, Estimate]]:
    """Return the measures of all groups; those of groups that are too small have no value."""
    found: dict[str, dict[str, Estimate]] = {}
    for name, _, judged, members in audit.columns():
        tables = (judged.usable, judged.reached, judged.seen, judged.reached & judged.held)
        n, found[name] = len(members), {}
        for part, table in zip(_PARTS, tables, strict=True):
            shares = table[members].mean(axis=0) if n >= FEWEST else None
            for kind, of in (("min", np.min), ("mean", np.mean)):
                mean = None if shares is None else float(of(shares))
                found[name][f"{part}.{kind}"] = Estimate(mean, None, n, "person")
    return found


def plain(audit: Audit) -> dict[str, Any]:
    """Return the audit for JSON."""
    conditions = dict.fromkeys(each.condition for each in audit.rounds)
    return {
        "title": audit.title,
        "seed": audit.seed,
        "people": len(audit.judged.seen),
        "stance": audit.stance,
        "pace_per_minute": audit.pace,
        "measures": {
            group: {
                name: None if each.mean is None else round(each.mean, 4)
                for name, each in measures.items()
            }
            for group, measures in estimates(audit).items()
        },
        "targets": [_target(audit, i) for i in range(len(audit.targets))],
        "paths": [
            {**vars(path), "mean": round(path.mean, 4), "peak": round(path.peak, 4)}
            for path in audit.paths
        ],
        "groups": [_group(audit, *row) for row in audit.columns()],
        "script": audit.script,
        "carried_out": [_carried_out(audit.rounds, each) for each in conditions],
    }


CARRIED_OUT = ("step_time", "step_misses", "steps_failed")
"""Measures of a script in an audit."""


def _carried_out(rounds: Sequence[Round], condition: str) -> dict[str, Any]:
    """Return how many did a script in a condition, their means, and why others did not."""
    own = [each for each in rounds if each.condition == condition]
    done = [each for each in own if (each.values["steps_done"] or 0.0) > 0.0]
    means = {name: [each.values[name] for each in done] for name in CARRIED_OUT}
    return {
        "condition": condition,
        "n": len(own),
        "done": len(done),
        **{
            name: round(float(np.mean(np.array(values, dtype=float))), 4) if values else None
            for name, values in means.items()
        },
        "excluded": dict(Counter(each.excluded for each in own if each.excluded)),
    }


def _target(audit: Audit, column: int) -> dict[str, Any]:
    target, judged = audit.targets[column], audit.judged
    every, n = np.arange(len(judged.seen)), len(judged.seen)
    tables = {"usable": judged.usable, "seen": judged.seen, "reached": judged.reached}
    counts = {name: int(table[:, column].sum()) for name, table in tables.items()}
    counts["held"] = int((judged.reached & judged.held)[:, column].sum())
    counts["leans"] = int((judged.reached & judged.leans)[:, column].sum())
    able = judged.reached & judged.feasible
    reached = counts["reached"]
    fix = audit.remedies[column]
    return {
        "name": target.name,
        "place_m": np.round(target.place_m, 4).tolist(),
        "relative_to": "head" if target.from_head else "world",
        "how": target.how,
        "hand": target.hand,
        "hold_s": target.hold_s,
        "load_kg": target.load_kg,
        "grip_n": target.grip_n,
        "in_app": target.in_app,
        "app_reacts": target.reacts,
        **{name: proportion(count, n) for name, count in counts.items()},
        "muscles_suffice": proportion(int(able[:, column].sum()), reached),
        "causes": causes(judged, target, column, every),
        "remedy": None if fix is None else fix.plain(),
        "clauses": [CLAUSES[each] for each in causes(judged, target, column, every)],
        "gaze": _gaze(judged.gaze[:, :, column]),
        "exertion": _exertion(judged, column),
    }


def _gaze(gaze: FloatArray) -> dict[str, Any]:
    """Return 5 %, 50 % and 95 % of (3, N), and for how many the neck bears little."""
    low, high = EASY_RAISED_DEG
    easy = int(((gaze[1] >= low) & (gaze[1] <= high)).sum())
    names = ("rotation_deg", "elevation_deg", "share_of_neck_strength")
    rows = {name: _quantiles(each) for name, each in zip(names, gaze, strict=True)}
    return {**rows, "easy_elevation": proportion(easy, gaze.shape[1])}


def _exertion(judged: Judged, column: int) -> dict[str, Any]:
    """Return 5 %, 50 % and 95 % of those who reach the target; null: too weak, or unlimited.

    All are null and ``n`` is 0 if no one reaches it.
    """
    rows = {
        "share_of_activation": judged.share,
        "share_of_published_strength": judged.published_share,
        "share_of_trunk_strength": judged.trunk_share,
        "share_of_grip_strength": np.where(
            np.isnan(judged.published_share), np.nan, judged.grip_share
        ),
        **{f"minutes, {model}": judged.minutes[model] for model in MODELS},
        **{f"minutes at pace, {model}": values for model, values in judged.paced.items()},
    }
    reached = int((~np.isnan(judged.published_share[:, column])).sum())
    return {"n": reached} | {name: _quantiles(each[:, column]) for name, each in rows.items()}


def _quantiles(values: FloatArray) -> list[float | None]:
    known = values[~np.isnan(values)]
    if len(known) == 0:
        return [None] * 3
    found = np.quantile(known, [0.05, 0.5, 0.95], method="nearest").tolist()
    return [round(value, 4) if np.isfinite(value) else None for value in found]


def _group(
    audit: Audit, name: str, limitation: Limitation | None, judged: Judged, members: Ints
) -> dict[str, Any]:
    usable = judged.usable[members]
    reached = (judged.seen & judged.reached)[members].all(axis=1)
    targets: Mapping[str, Any] = {
        target.name: proportion(int(usable[:, i].sum()), len(members))
        for i, target in enumerate(audit.targets)
    }
    return {
        "name": name,
        "n": len(members),
        "source": "sampled" if limitation is None else limitation.source,
        "verified": limitation is None or limitation.verified,
        "reach_every_target": proportion(int(reached.sum()), len(members)),
        "every_target": proportion(int(usable.all(axis=1).sum()), len(members)),
        "targets": targets,
        "causes": {
            target.name: causes(judged, target, i, members)
            for i, target in enumerate(audit.targets)
        },
    }
