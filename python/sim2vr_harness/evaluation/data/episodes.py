"""The table of episodes: user, condition, settings, and every measure of each episode."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

from sim2vr_harness.client import GameFacts
from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.evaluation.data.columns import Column, column_name, columns_of, merged
from sim2vr_harness.play.fatigue import fatigue_measures
from sim2vr_harness.play.round import Round, measures_of

EPISODE_COLUMNS = (
    Column("episode", "text", "", "Key: condition, participant, seed; name of its files and logs"),
    Column("user", "text", "", "The trained user, or its run and checkpoint"),
    Column("trained_steps", "integer", "", "User steps that it was trained for"),
    Column("person", "integer", "", "Number of the virtual participant; none where all are alike"),
    Column("game", "text", "", "The game"),
    Column("condition", "text", "", "Its condition"),
    Column("number", "integer", "", "Of the episode within its condition, from 0"),
    Column("seed", "integer", "", "Seed of body, policy and game; the same in paired conditions"),
    Column("game_seed", "integer", "", "The game's own, drawn from it: 'random seed' of its logs"),
    Column("deterministic", "boolean", "", "Whether actions are the policy's mean"),
    Column("changes", "text", "", "JSON list: what differs from the training's environment"),
    Column("ended", "text", "", "finished, max_steps_reached, diverged, app_left or app_failed"),
    Column("steps", "integer", "", "User steps"),
    Column("duration_s", "number", "s", "Length of the episode, game time"),
    Column("effort_weight", "number", "", "Factor on the cost of effort"),
    Column("log_folder", "text", "", "Where the game's CSV logs are, if they were kept"),
)
"""Columns of episodes in every game; those of people, app options and measures follow them."""

_PERSON_UNITS = {"stature_m": "m", "visual_delay_s": "s", "proprioceptive_delay_s": "s"}


def episode_rows(
    results: Sequence[Round],
    settings: Mapping[str, Any],
    facts: GameFacts,
    env: EnvConfig,
    effort_weight: float,
) -> list[dict[str, Any]]:
    """Return a row per episode.

    Args:
        results: The episodes.
        settings: Of the evaluation, as in its results.
        env: Environment of the episodes.
        effort_weight: Factor on the cost of effort.
    """
    rows = []
    for result in results:
        options = {**env.app.options, **_options_of(facts, result.condition)}
        person = {} if result.person is None else dict(result.person)
        row: dict[str, Any] = {
            "episode": result.key,
            "user": settings["user"],
            "trained_steps": settings.get("trained_steps"),
            "person": person.pop("index", None),
            "game": facts.name,
            "condition": result.condition,
            "number": result.episode,
            "seed": result.seed,
            "game_seed": result.game_seed,
            "deterministic": settings["deterministic"],
            "changes": json.dumps(list(settings["overrides"])),
            "ended": result.ended,
            "steps": result.steps,
            "duration_s": result.steps / env.action_frequency_hz,
            "effort_weight": effort_weight,
            "log_folder": result.log_folder,
        }
        row |= {f"person_{key}": value for key, value in person.items()}
        for key, value in sorted(options.items()):
            plain = json.dumps(value) if isinstance(value, (list, tuple, dict)) else value
            row[f"option_{column_name(key)}"] = plain
        if result.script and result.person is not None:
            row["excluded"] = result.excluded
        row |= result.values
        found: dict[str, float | None] = {}
        for measure in facts.grids:
            if result.ended != "app_failed" and any(
                k.startswith(measure.log_key) for k in result.log
            ):
                values = measure.values([result.log])
                found |= {f"{measure.name}_{i}": value for i, value in enumerate(values)}
        rows.append(row | found)
    return rows


def _options_of(facts: GameFacts, condition: str) -> Mapping[str, Any]:
    try:
        return facts.condition(condition).options
    except ValueError:
        return {}


def episode_columns(rows: Sequence[Mapping[str, Any]], facts: GameFacts) -> list[Column]:
    """Return the columns that these rows need, measures last.

    Args:
        rows: Of :func:`episode_rows`.
    """
    facts = facts.with_log({key: 0.0 for row in rows for key in row})
    told = {
        measure.name: (measure.unit, ": ".join(filter(None, (measure.label, measure.description))))
        for measure in (*measures_of(facts), *fatigue_measures(key for row in rows for key in row))
    }
    told |= {
        f"{measure.name}_{i}": (measure.unit, f"{measure.label}, item {i}, row by row")
        for measure in facts.grids
        for i in range(measure.grid[0] * measure.grid[1] if measure.grid else 0)
    }
    known = {column.name for column in EPISODE_COLUMNS}
    people: list[Column] = []
    options: list[Column] = []
    measures: list[Column] = []
    for row in rows:
        for name, value in row.items():
            if name in known:
                continue
            what = told.get(name, ("", name.replace("_", " ")))
            into = measures
            if name == "excluded":
                what = ("", "Why the participant did no step of the script; empty: it did some")
            if name.startswith("person_"):
                field = name.removeprefix("person_")
                into, what = people, (_PERSON_UNITS.get(field, ""), f"Person's {field}")
            elif name.startswith("option_"):
                into, what = options, ("", f"The game's option {name.removeprefix('option_')}")
            elif value is None:  # a measure that no episode has is a column all the same
                measures.append(Column(name, "number", *what))
            into += columns_of({name: value}, {name: what})
    return merged([*EPISODE_COLUMNS, *people, *options, *measures])
