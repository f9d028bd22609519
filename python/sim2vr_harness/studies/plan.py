"""Plan of a study, checked before any of its tasks starts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from sim2vr_harness import __version__
from sim2vr_harness.base.errors import InputError, unknown_name
from sim2vr_harness.client import GameFacts, InProcessBatch, Measure
from sim2vr_harness.envs.config import AppConfig
from sim2vr_harness.envs.late_hands import app_options, hand_lag_s
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.evaluation.expectations import Planned, study_group
from sim2vr_harness.play.exertion import fatigue_names
from sim2vr_harness.play.fatigue import fatigue_measures
from sim2vr_harness.play.round import measures_of
from sim2vr_harness.studies.config import Cell, StudyConfig, cells_of, content_hash
from sim2vr_harness.studies.jobs import CellTask, Pruning, TrainingTask
from sim2vr_harness.studies.policy_selection import FORMAT, SelectionSource, Users, player_of


@dataclass(frozen=True)
class StudyPlan:
    """Everything that a study needs.

    Attributes:
        study: Its file.
        cells: Its cells, in order.
        tasks: What plays each; cells of the same content share a task's key.
        trainings: What has to be trained first.
        facts: What the game publishes.
        measures: Names of the measures that are looked at.
        known: Every measure that can be named, those of fatigue included.
        alike: Names of cells with the same user, resolved configuration and seeds, whose rounds are
            therefore the same; a tuple each.
    """

    study: StudyConfig
    cells: tuple[Cell, ...]
    tasks: tuple[CellTask, ...]
    trainings: tuple[TrainingTask, ...]
    facts: GameFacts
    measures: tuple[str, ...]
    known: tuple[Measure, ...]
    alike: tuple[tuple[str, ...], ...] = ()

    @property
    def planned(self) -> Planned:
        """Return what expectations can be about: cells, and the study's measures."""
        unit = self.study.unit_factor
        groups = dict.fromkeys(
            study_group({name: label for name, label in cell.levels.items() if name != unit})
            for cell in self.cells
        )
        compared = tuple(measure for measure in self.known if measure.name in self.measures)
        return Planned(tuple(groups), self.measures, compared)


def plan_of(
    study: StudyConfig,
    *,
    folder: Path | None = None,
    users: Users | None = None,
    pruning: Pruning | None = None,
    may_diverge: bool = False,
    trust_app: bool = False,
) -> StudyPlan:
    """Work out what is to be done, and check all of it.

    Args:
        folder: Where its file is; users and configurations are looked for there, too.
        users: Those that were looked up before.
        pruning: When its trainings are stopped early.
        may_diverge: Whether its trainings may, see :class:`.TrainingTask`.
        trust_app: Whether apps that its files name may be started, though this user never has.

    Raises:
        InputError: A user, configuration, key, option, condition or measure that cannot be used, or
            a program or Python that this user has never run.
    """
    source = f"the study {study.name}" if folder is None else folder
    where = SelectionSource(
        folder, users or Users(code=trust_app), pruning, may_diverge, source, trust_app
    )
    found = [_Resolved.of(study, cell, where) for cell in cells_of(study)]
    facts = found[0].facts
    for one in found:
        if one.facts.name != facts.name:
            expected = f"one of {facts.name}, as in cell {found[0].task.cell}"
            raise InputError(f"cell {one.task.cell}", f"a user of {one.facts.name}", expected)
    known = (*measures_of(facts), *_fatigue(found))
    trainings = {one.training.key: one.training for one in found if one.training is not None}
    return StudyPlan(
        study,
        tuple(one.cell for one in found),
        tuple(one.task for one in found),
        tuple(trainings.values()),
        facts,
        _measures(study, facts, known),
        known,
        _alike(found),
    )


def _measures(study: StudyConfig, facts: GameFacts, known: Sequence[Measure]) -> tuple[str, ...]:
    """Return the measures of a study and of its comparisons, each once."""
    names = [measure.name for measure in known]
    wanted = study.measures or tuple(measure.name for measure in measures_of(facts))
    compared = [name for comparison in study.comparisons for name in comparison.measures or ()]
    for name in (*wanted, *compared):
        if name not in names:
            raise unknown_name("measures", name, names)
    return (*wanted, *dict.fromkeys(name for name in compared if name not in wanted))


def _fatigue(found: Sequence[_Resolved]) -> tuple[Measure, ...]:
    """Measures of fatigue that the users of all cells have."""
    users = {one.env.config.user.model_dump_json(): one.env for one in found}
    names: dict[str, None] | None = None
    for env in users.values():
        own = fatigue_names(env)
        names = {name: None for name in own if names is None or name in names}
    return fatigue_measures(names or ())


def _alike(found: Sequence[_Resolved]) -> tuple[tuple[str, ...], ...]:
    """Names of cells whose rounds are the same, in the order of the first of each."""
    groups: dict[str, list[str]] = {}
    for one in found:
        groups.setdefault(one.content, []).append(one.cell.name)
    return tuple(tuple(names) for names in groups.values() if len(names) > 1)


@dataclass(frozen=True)
class _Resolved:
    cell: Cell
    task: CellTask
    training: TrainingTask | None
    env: ResolvedEnv
    facts: GameFacts
    content: str
    """Hash of what decides about its rounds, names and defaults resolved."""

    @classmethod
    def of(cls, study: StudyConfig, cell: Cell, where: SelectionSource) -> _Resolved:
        try:
            return cls._of(study, cell, where)
        except InputError as error:
            field = f"cell {cell.name}: {error.field}"
            raise InputError(field, error.got, error.expected) from error

    @classmethod
    def _of(cls, study: StudyConfig, cell: Cell, where: SelectionSource) -> _Resolved:
        player = player_of(study.name, cell, where)
        training = player.training
        condition = player.condition
        played = player.env.with_options(condition.options).config
        _check_options(played.app)
        task = CellTask(
            key="",
            cell=cell.name,
            user=player.user,
            training=None if training is None else training.key,
            condition=condition.name,
            overrides=tuple(cell.of("env.")),
            env=player.env.config,
            trust_app=where.trust_app,
            episodes=study.episodes,
            seed=cell.seed,
            people=study.people,
            deterministic=_deterministic(study, cell, player.deterministic),
            steps=study.steps,
            logs=study.logs,
            film_seconds=study.film_seconds,
        )
        identity = {
            **player.identity,
            "format": FORMAT,
            "sim2vr_harness": __version__,
            "condition": task.condition,
            "overrides": task.overrides,
            "episodes": task.episodes,
            "seed": task.seed,
            "people": task.people,
            "deterministic": task.deterministic,
            "steps": task.steps,
            "logs": task.logs,
            "film_seconds": task.film_seconds,
        }
        if condition.options != player.facts.condition(condition.name).options:
            identity["options"] = condition.options  # the cell's own win
        resolved = {
            **player.identity,
            "env": played.model_dump(mode="json"),
            **{key: identity[key] for key in ("episodes", "seed", "people", "deterministic")},
        }
        task = replace(task, key=content_hash(identity))
        return cls(cell, task, training, player.env, player.facts, content_hash(resolved))


def _check_options(app: AppConfig) -> None:
    """Refuse game options that the app would refuse, where it is ours and costs nothing."""
    if app.transport != "in_process":
        return
    try:
        hand_lag_s(app.options)
        InProcessBatch(1, app.game, app_options(app.options), renderer="null", width=8, height=8)
    except ValueError as error:
        field, _, rest = str(error).partition(": got ")
        got, _, expected = rest.partition(", expected ")
        place = "env.app.options" if field == "options" else f"env.app.options.{field}"
        raise InputError(place, got, expected) from error


def _deterministic(study: StudyConfig, cell: Cell, own: bool) -> bool:
    """Return what the cell sets, else the study, else the user's own configuration."""
    value = cell.settings.get("deterministic", study.deterministic)
    if value is None:
        return own
    if not isinstance(value, bool):
        raise InputError("deterministic", repr(value), "true or false")
    return value
