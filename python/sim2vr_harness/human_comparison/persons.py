"""Measures of a person in a condition: per round, then over its rounds."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.files import file_name
from sim2vr_harness.games.behaviour import Behaviour
from sim2vr_harness.human_comparison import motion, outcomes, strikes
from sim2vr_harness.human_comparison.fitts import (
    AimedPerson,
    AimedRound,
    aimed_person,
    aimed_round,
)
from sim2vr_harness.human_comparison.grid import SETTLING_S, Track
from sim2vr_harness.human_comparison.measures import measures_in
from sim2vr_harness.human_comparison.reaction import Effect, effect_of, effects, reaction
from sim2vr_harness.human_comparison.rounds import PlayedRound, round_of
from sim2vr_harness.sessions import Session

FloatArray = NDArray[np.float64]
Cell = tuple[str, str]
"""Group and condition."""

_LEAST_STILL = 3
_LEAST_S = 3.0


@dataclass(frozen=True)
class RoundMeasures:
    """What was measured of a round.

    Attributes:
        cell: its group and condition.
        person: who played.
        values: measure -> number, where it has one.
        samples: single targets, hits and frames.
        cells: (C, 2) hits and misses of every cell.
        effect: what the visuomotor latency is worked out from; None where it is not measured.
        aimed: the movements of a round of aimed movements, in which nothing else is measured.
    """

    cell: Cell
    person: str
    values: Mapping[str, float]
    samples: Mapping[str, FloatArray]
    cells: FloatArray
    effect: Effect | None
    aimed: AimedRound | None = None


@dataclass(frozen=True)
class RecordedPerson:
    """What one person does in a condition: the mean over its rounds.

    Attributes:
        name: who.
        values: measure -> number, where it has one.
        samples: of all its rounds together.
        cell_rates: (C,) hit rate of every cell, NaN where nothing came up.
        effect: of all its targets; None where it is not measured.
        rounds: how many.
        further: numbers that are no measures of the game, such as misses.
        aimed: of all its aimed movements; None in other games.
    """

    name: str
    values: Mapping[str, float]
    samples: Mapping[str, FloatArray]
    cell_rates: FloatArray
    effect: Effect | None
    rounds: int
    further: Mapping[str, float] = field(default_factory=dict)
    aimed: AimedPerson | None = None


def measure_session(session: Session, behaviour: Behaviour, person: str) -> RoundMeasures | None:
    """Measure a session; None of a condition that is not compared.

    Raises:
        InputError: It is no round of the game, or too short.
    """
    if behaviour.aimed:
        cell = next(iter(behaviour.groups)), next(iter(behaviour.conditions))
        nothing = np.zeros((len(behaviour.places_m), 2))
        return RoundMeasures(cell, person, {}, {}, nothing, None, aimed_round(session))
    played = round_of(session, behaviour, person)
    return None if played is None else measure_round(played, behaviour)


def measure_round(played: PlayedRound, behaviour: Behaviour) -> RoundMeasures:
    """Measure a round.

    Raises:
        InputError: It is too short.
    """
    lasting = float(played.times_s[-1] - played.times_s[0]) if len(played.times_s) else 0.0
    if lasting < SETTLING_S + _LEAST_S:
        expected = f"at least {SETTLING_S + _LEAST_S:g} s of play"
        raise InputError(file_name(played.source), f"{lasting:.3g} s", expected)
    track = Track(played)
    found = [
        outcomes.counts(track),
        outcomes.timing(track),
        outcomes.choices(track, behaviour.alive_after_s),
        motion.speeds(track),
        motion.space(track),
        motion.smoothness(track),
        motion.swings(track),
        motion.rotations(track),
        motion.head(track),
        strikes.hit_speeds(track),
        strikes.peaks(track),
        strikes.endpoints(track),
        strikes.between_hits(track),
    ]
    if behaviour.any_app:
        found.append(motion.hands(track))
    effect = None
    if played.condition in behaviour.one_target:
        own, effect = reaction(track)
        found.append(own)
    targets, cells = played.targets, len(behaviour.places_m)
    counted = [
        np.bincount(targets.cell[part], minlength=cells) for part in (targets.hit, targets.missed)
    ]
    return RoundMeasures(
        cell=(played.group, played.condition),
        person=played.person,
        values={
            key: float(value)
            for values, _ in found
            for key, value in values.items()
            if math.isfinite(value)
        },
        samples={key: sample for _, samples in found for key, sample in samples.items()},
        cells=np.stack(counted, axis=1).astype(np.float64),
        effect=effect,
    )


def persons_of(
    rounds: Iterable[RoundMeasures], behaviour: Behaviour
) -> dict[Cell, tuple[RecordedPerson, ...]]:
    """Group rounds by condition and person; persons by name."""
    sorted_: dict[Cell, dict[str, list[RoundMeasures]]] = {}
    for each in rounds:
        sorted_.setdefault(each.cell, {}).setdefault(each.person, []).append(each)
    return {
        cell: tuple(_person(name, own, behaviour) for name, own in sorted(people.items()))
        for cell, people in sorted_.items()
    }


def _person(name: str, rounds: Sequence[RoundMeasures], behaviour: Behaviour) -> RecordedPerson:
    keys = dict.fromkeys(key for each in rounds for key in each.values)
    values = {
        key: float(np.mean([each.values[key] for each in rounds if key in each.values]))
        for key in keys
    }
    names = dict.fromkeys(key for each in rounds for key in each.samples)
    samples = {
        key: np.concatenate([each.samples[key] for each in rounds if key in each.samples])
        for key in names
    }
    parts = [each.effect for each in rounds if each.effect is not None]
    values |= effects(parts)
    if len(samples.get("rt_still", ())) >= _LEAST_STILL:
        values["rt_still"] = float(np.median(samples["rt_still"]))
    counts = np.sum([each.cells for each in rounds], axis=0)
    total = counts.sum(axis=1)
    rates = np.where(total > 0, counts[:, 0] / np.where(total > 0, total, 1.0), np.nan)
    if np.isfinite(rates).any():
        values["cell_hit_rates"] = float(np.nanmean(rates))
        values["worst_cell"] = float(np.nanmin(rates))
    movements = [each.aimed for each in rounds if each.aimed is not None]
    aimed = aimed_person(movements, name) if movements else None
    if aimed is not None:
        values |= aimed.values()
    chosen = {measure.name for measure in measures_in(behaviour, *rounds[0].cell)}
    return RecordedPerson(
        name=name,
        values={key: value for key, value in values.items() if key in chosen},
        samples=samples,
        cell_rates=rates,
        effect=effect_of(parts) if parts else None,
        rounds=len(rounds),
        further={key: values[key] for key in ("misses",) if key in values},
        aimed=aimed,
    )
