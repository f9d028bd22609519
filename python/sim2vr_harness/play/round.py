"""Measures of a round, and summaries over rounds.

A game publishes its own measures (:class:`~sim2vr_harness.client.GameFacts`); those of the player
are the same in every game (:data:`PLAYER_MEASURES`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from sim2vr_harness.client import GameFacts, Measure
from sim2vr_harness.play.fatigue import fatigue_measures

if TYPE_CHECKING:
    from sim2vr_harness.policies.scripted import StepOutcome

_EXERTION = {
    "nicer": ("NICER", "Time as a share of the arm's endurance, with recovery (Li et al. 2024)"),
    "consumed_endurance": (
        "Consumed Endurance",
        "Time as a share of the arm's endurance (Hincapie-Ramos et al. 2014)",
    ),
}


ARM_MEASURES = tuple(
    Measure(
        f"exertion.{name}_{side}",
        f"{label}, {side}",
        unit="%",
        better="lower",
        description=description,
    )
    for name, (label, description) in _EXERTION.items()
    for side in ("right", "left")
)
"""At the end of a round; 100 is exhaustion. A body without that arm has none."""

PLAYER_MEASURES = (
    Measure(
        "max_fatigued",
        "Muscle fatigue",
        unit="proportion",
        better="lower",
        digits=3,
        description="Tired share of a muscle's motor units at its worst, mean of all",
    ),
    *ARM_MEASURES,
    Measure(
        "action_change",
        "Jerkiness",
        unit="0-2",
        better="lower",
        digits=3,
        description="Mean change from one muscle command to the next; 0: smooth",
    ),
    Measure(
        "effort",
        "Effort cost",
        unit="reward",
        better="lower",
        description="What the effort model takes off the reward in a round",
    ),
    Measure("game_return", "Game's reward", better="higher"),
    Measure(
        "return",
        "Return",
        better="higher",
        description="Game's reward minus effort cost; what the user was trained for",
    ),
)
"""The numbers that a round has in every game, in the order of the tables.

``max_fatigued`` is the mean over the muscles of the largest share of fatigued motor units;
``action_change`` the mean over muscles and user steps of the absolute difference between an action
and the one before it; ``effort`` the summed cost of effort; ``return`` = ``game_return`` -
``effort``."""


def measures_of(facts: GameFacts) -> tuple[Measure, ...]:
    """All numbers of a round of a game, in the order of the tables, grids left out.

    Those of fatigue per muscle and body part depend on the body: :mod:`.fatigue`.
    """
    return (*facts.scalars, *PLAYER_MEASURES)


@dataclass(frozen=True)
class Round:
    """One round of one user.

    Attributes:
        condition: The game's condition.
        episode: Number of the round within its condition, from 0.
        seed: Its seed, of body, policy and game.
        game_seed: The game's own, drawn from ``seed``: the "random seed" of the game's logs.
        steps: User steps.
        ended: ``finished``, ``max_steps_reached``, ``diverged``, ``app_left`` or ``app_failed``.
        values: The numbers of :func:`measures_of` and of fatigue; None where a round has none.
        log: The game's last log.
        log_folder: Where the game's CSV logs of the round are, relative to the results; None
            without.
        person: The participant who played, field by field (``users.Person``); None where all users
            are the same.
        fatigue_parts: Measures of fatigue that are of a body part, not of a muscle.
        script: What the steps of a scripted user did.
        excluded: Why a participant could do no step of the script; empty: it did some.
    """

    condition: str
    episode: int
    seed: int
    game_seed: int | None
    steps: int
    ended: str
    values: dict[str, float | None]
    log: dict[str, float]
    log_folder: str | None = None
    person: dict[str, Any] | None = None
    fatigue_parts: tuple[str, ...] = ()
    script: tuple[StepOutcome, ...] = ()
    excluded: str = ""

    def with_values(self, values: Mapping[str, float | None]) -> Round:
        """Return the round with more measures.

        None has a value where the app failed or the participant was excluded.
        """
        known = {
            key: None if self.ended == "app_failed" or self.excluded else _finite(value)
            for key, value in values.items()
        }
        return replace(self, values={**self.values, **known})

    @property
    def key(self) -> str:
        """Names the round among those of an evaluation: ``easy_seed1``.

        ``easy_person3_seed1`` where users are people.
        """
        who = "" if self.person is None else f"_person{self.person['index']}"
        return f"{self.condition}{who}_seed{self.seed}"

    def as_dict(self) -> dict[str, Any]:
        """Return everything, ready for JSON; ``person`` is the number, with ``person_fields``."""
        content = asdict(self)
        content |= content.pop("values")
        del content["fatigue_parts"], content["script"]
        if not self.excluded:
            del content["excluded"]
        if self.script:
            content["script"] = [step.as_dict() for step in self.script]
        fields = content.pop("person")
        if fields is not None:
            content |= {"person": fields.pop("index"), "person_fields": fields}
        content["log"] = {key: _finite(value) for key, value in self.log.items()}
        return content


def round_result(
    facts: GameFacts,
    *,
    condition: str,
    episode: int,
    seed: int,
    steps: int,
    game_return: float,
    effort: float,
    game_seed: int | None = None,
    action_change: float | None = None,
    person: Mapping[str, Any] | None = None,
    info: Mapping[str, Any],
    log: Mapping[str, float],
) -> Round:
    """Return a finished round with the measures of game and player.

    Other arguments are fields of :class:`Round`.

    Args:
        game_return: Sum of the game's rewards.
        effort: Sum of the costs of effort.
        action_change: Mean absolute difference of successive actions, if known.
        info: The last step's info.
    """
    own: dict[str, float | None] = {
        "max_fatigued": info.get("max_fatigued"),
        "action_change": action_change,
        "effort": effort,
        "game_return": game_return,
        "return": game_return - effort,
    }
    of_game = {measure.name: measure.value(log) for measure in facts.with_log(log).scalars}
    values = of_game | {measure.name: own.get(measure.name) for measure in PLAYER_MEASURES}
    return Round(
        condition=condition,
        episode=episode,
        seed=seed,
        game_seed=game_seed,
        steps=steps,
        ended=str(info.get("termination", "unknown")),
        values={},
        log=dict(log),
        person=None if person is None else dict(person),
    ).with_values(values)


def summarise(rounds: Sequence[Round], facts: GameFacts) -> dict[str, Any]:
    """Return mean and standard deviation (ddof 1) of every number over rounds, or over people.

    Where users are people who differ, a number's value of a participant is the mean of the own
    rounds, and mean and deviation are over the ``persons``: rounds of
    one participant are no independent samples of people.

    A share such as ``hit_rate`` is the mean of the rounds' shares, as in the study;
    ``hit_rate_pooled`` divides the sums. Rounds without a number (no hit, no hit speed) are left
    out of its mean. Grids are pooled item by item; None where nothing came up. ``return_terms``
    splits the mean return: the reward terms that the game publishes, ``rest`` of the game's
    reward, and effort as a cost.

    Args:
        rounds: At least one round.
    """
    facts = facts.with_log({key: value for result in rounds for key, value in result.log.items()})
    logs = [result.log for result in rounds if result.ended != "app_failed"]
    summary: dict[str, Any] = {"episodes": len(rounds)}
    persons = _by_person(rounds)
    if persons:
        summary["persons"] = len(persons)
    fatigue = fatigue_measures(name for result in rounds for name in result.values)
    for measure in (*measures_of(facts), *fatigue):
        groups = persons or [[result] for result in rounds]
        values = [_mean([result.values.get(measure.name) for result in group]) for group in groups]
        known = np.array([value for value in values if value is not None], dtype=np.float64)
        summary[measure.name] = float(known.mean()) if len(known) else None
        summary[f"{measure.name}_sd"] = float(known.std(ddof=1)) if len(known) > 1 else None
    if fatigue:
        summary["fatigue_parts"] = list(rounds[0].fatigue_parts)
    for measure in facts.scalars:
        if measure.rate_with is not None:
            sums = {
                key: sum(log.get(key, 0.0) for log in logs)
                for key in (measure.log_key, measure.rate_with)
            }
            summary[f"{measure.name}_pooled"] = measure.value(sums)
    played = [result for result in rounds if result.values["return"] is not None]
    if not played:
        summary["return_terms"] = {}
    else:
        terms = {
            term.log_key: float(np.mean([result.log.get(term.sum_key, 0.0) for result in played]))
            for term in facts.reward_terms
            if any(term.sum_key in result.log for result in played)
        }
        game = float(np.mean([result.values["game_return"] or 0.0 for result in played]))
        effort = float(np.mean([result.values["effort"] or 0.0 for result in played]))
        summary["return_terms"] = {"rest": game - sum(terms.values()), **terms, "effort": -effort}
    for measure in facts.grids:
        counted = any(key.startswith(measure.log_key) for log in logs for key in log)
        summary[measure.name] = measure.values(logs) if counted else []
    for end in ("diverged", "app_left", "app_failed"):
        summary[end] = sum(result.ended == end for result in rounds)
    return summary


def _by_person(rounds: Sequence[Round]) -> list[list[Round]]:
    """The rounds of each participant; nothing where users are all the same."""
    groups: dict[int | None, list[Round]] = {}
    for result in rounds:
        if result.person is None:
            return []
        groups.setdefault(result.person["index"], []).append(result)
    return list(groups.values())


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def _finite(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)
