"""What is to be done for a study, checked before anything of it is."""

from __future__ import annotations

import hashlib
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from sim2vr_harness import __version__
from sim2vr_harness.client import GameFacts, InProcessBatch
from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.envs.games import game_facts
from sim2vr_harness.errors import InputError, unknown_name
from sim2vr_harness.evaluation.environment import evaluation_env
from sim2vr_harness.evaluation.metrics import measures_of
from sim2vr_harness.files import read_bytes
from sim2vr_harness.studies.cells import Cell, cells_of, content_hash
from sim2vr_harness.studies.config import StudyConfig
from sim2vr_harness.studies.tasks import CellTask, Limits, TrainingTask
from sim2vr_harness.training.config import TrainingConfig, load_config, to_yaml
from sim2vr_harness.training.trained_users import TrainedUser, find_user, require_contract

__all__ = ["Plan", "Users", "plan_of"]

_FORMAT = 2
"""Of what a cell's folder holds; another one makes all cells anew."""


@dataclass(frozen=True)
class Plan:
    """Everything that a study needs.

    Attributes:
        study: Its file.
        cells: Its cells, in order.
        tasks: What plays each; cells of the same content share a task's key.
        trainings: What has to be trained first.
        facts: What the game publishes.
        measures: Names of the measures that are looked at.
    """

    study: StudyConfig
    cells: tuple[Cell, ...]
    tasks: tuple[CellTask, ...]
    trainings: tuple[TrainingTask, ...]
    facts: GameFacts
    measures: tuple[str, ...]


def plan_of(
    study: StudyConfig,
    *,
    folder: Path | None = None,
    users: Users | None = None,
    limits: Limits | None = None,
) -> Plan:
    """Work out what is to be done, and check all of it.

    Args:
        study: The study.
        folder: Where its file is; users and configurations are looked for there, too.
        users: Those that were looked up before.
        limits: When its trainings are stopped early.

    Raises:
        InputError: A user, configuration, key, option, condition or measure that cannot be used.
    """
    where = _Where(folder, users or Users(), limits)
    found = [_Resolved.of(study, cell, where) for cell in cells_of(study)]
    facts = found[0].facts
    for one in found:
        if one.facts.name != facts.name:
            raise InputError(
                f"cell {one.task.cell}",
                f"a user of {one.facts.name}",
                f"one of {facts.name}, as in cell {found[0].task.cell}",
            )
    names = [measure.name for measure in measures_of(facts)]
    wanted = study.measures or tuple(names)
    asked = [name for comparison in study.comparisons for name in comparison.measures or ()]
    for name in (*wanted, *asked):
        if name not in names:
            raise unknown_name("measures", name, names)
    trainings = {one.training.key: one.training for one in found if one.training is not None}
    return Plan(
        study,
        tuple(one.cell for one in found),
        tuple(one.task for one in found),
        tuple(trainings.values()),
        facts,
        (*wanted, *dict.fromkeys(name for name in asked if name not in wanted)),
    )


class Users:
    """Trained users and hashes of their weights, each read once."""

    def __init__(self) -> None:
        self._known: dict[str, tuple[TrainedUser, str]] = {}

    def find(self, name: str) -> tuple[TrainedUser, str]:
        """Return a user and the SHA-256 of its weights."""
        if name not in self._known:
            user = find_user(name)
            weights = read_bytes(user.source, "weights of a user")
            self._known[name] = user, hashlib.sha256(weights).hexdigest()
        return self._known[name]


@dataclass(frozen=True)
class _Where:
    """What all cells of a plan have in common; see :func:`plan_of`."""

    folder: Path | None
    users: Users
    limits: Limits | None


@dataclass(frozen=True)
class _Resolved:
    cell: Cell
    task: CellTask
    training: TrainingTask | None
    facts: GameFacts

    @classmethod
    def of(cls, study: StudyConfig, cell: Cell, where: _Where) -> _Resolved:
        try:
            return cls._of(study, cell, where)
        except InputError as error:
            field = f"cell {cell.name}: {error.field}"
            raise InputError(field, error.got, error.expected) from error

    @classmethod
    def _of(cls, study: StudyConfig, cell: Cell, where: _Where) -> _Resolved:
        settings, folder, users = cell.settings, where.folder, where.users
        if ("user" in settings) == ("config" in settings):
            got = "both user and config" if "user" in settings else "neither user nor config"
            raise InputError("user", got, "a trained user, or the configuration of a training")
        training, user = None, None
        identity: dict[str, Any]
        if "config" in settings:
            config = load_config(
                _near(str(settings["config"]), folder), cell.of("training.")
            ).model_copy(update={"name": study.name})
            text = to_yaml(config)
            # How often something is saved or measured changes no weight.
            key = content_hash(
                config.model_dump(mode="json", exclude={"name", "evaluation", "wandb"})
                | {"format": _FORMAT, "sim2vr_harness": __version__}
                | ({} if where.limits is None else {"limits": asdict(where.limits)})
            )
            training = TrainingTask(key, text, cell.name, where.limits)
            identity = {"training": key}
        else:
            if cell.of("training."):
                key = next(key for key in sorted(settings) if key.startswith("training."))
                expected = "config instead of user: what is trained already stays"
                raise InputError(key, "it together with a user", expected)
            user = _near(str(settings["user"]), folder)
            known, weights = users.find(user)
            config = known.config
            identity = {
                "user": Path(user).name,
                "weights": weights,
                "config": to_yaml(config),
            }
        overrides = tuple(cell.of("env."))
        env = evaluation_env(config, overrides=overrides, source=user or "config")
        if user is not None:
            require_contract(users.find(user)[0], env)
        facts = game_facts(env.app)
        condition = _condition(facts, config, settings.get("condition"))
        _check_options(env, facts, condition)
        task = CellTask(
            key="",
            cell=cell.name,
            user=user,
            training=None if training is None else training.key,
            condition=condition,
            overrides=overrides,
            episodes=study.episodes,
            seed=cell.seed,
            people=study.people,
            deterministic=_truth(settings.get("deterministic", study.deterministic)),
            steps=study.steps,
            logs=study.logs,
            film_seconds=study.film_seconds,
        )
        identity |= {
            "format": _FORMAT,
            "sim2vr_harness": __version__,
            "condition": condition,
            "overrides": overrides,
            "episodes": task.episodes,
            "seed": task.seed,
            "people": task.people,
            "deterministic": task.deterministic,
            "steps": task.steps,
            "logs": task.logs,
            "film_seconds": task.film_seconds,
        }
        return cls(cell, replace(task, key=content_hash(identity)), training, facts)


def _near(name: str, folder: Path | None) -> str:
    """A path beside the study's file, where there is one; else what was written."""
    if folder is not None and not Path(name).is_absolute() and (folder / name).exists():
        return str(folder / name)
    return name


def _condition(facts: GameFacts, config: TrainingConfig, name: Any) -> str:
    chosen = name or facts.condition_of(config.env.app.options) or facts.default_condition
    try:
        return facts.condition(str(chosen)).name
    except ValueError as error:
        got, _, expected = str(error).partition(": got ")[2].partition(", expected ")
        raise InputError("condition", got, expected) from error


def _check_options(env: EnvConfig, facts: GameFacts, condition: str) -> None:
    """Refuse game options that the app would refuse, where it is ours and costs nothing."""
    if env.app.transport != "in_process":
        return
    options = {**env.app.options, **facts.condition(condition).options}
    try:
        InProcessBatch(1, env.app.game, options, renderer="null", width=8, height=8)
    except ValueError as error:
        field, _, rest = str(error).partition(": got ")
        got, _, expected = rest.partition(", expected ")
        place = "env.app.options" if field == "options" else f"env.app.options.{field}"
        raise InputError(place, got, expected) from error


def _truth(value: Any) -> bool:
    if not isinstance(value, bool):
        raise InputError("deterministic", repr(value), "true or false")
    return value
