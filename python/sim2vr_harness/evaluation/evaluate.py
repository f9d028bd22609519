"""``sim2vr-harness evaluate``: a trained user plays, and what it did is measured."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing, nullcontext
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from sim2vr_harness.envs.apps import knows_options
from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.evaluation.metrics import RoundResult, summarise
from sim2vr_harness.evaluation.player import Player
from sim2vr_harness.evaluation.rollouts import jobs_for, play
from sim2vr_harness.evaluation.video import RoundFilmer
from sim2vr_harness.training.config import TrainingConfig, apply_overrides, parse_config
from sim2vr_harness.training.errors import InputError
from sim2vr_harness.training.run_folder import write_atomically
from sim2vr_harness.training.trained_users import find_user, require_contract

__all__ = ["Evaluation", "Request", "evaluate"]

_LONGEST_NAME = 120
"""Of a folder, in characters."""

SimulationFactory = Callable[..., Any]
"""(EnvConfig, n, log_dir=Path | None) -> simulation."""


@dataclass(frozen=True)
class Request:
    """What to evaluate; None takes the value of the run's configuration.

    Attributes:
        conditions: The game's conditions.
        episodes: Rounds per condition.
        seed: Seed of the first round.
        deterministic: Whether actions are the policy's mean.
        record: Whether to film the first round of every condition.
        log: Whether to write the game's CSV logs.
        out: Where files go; None takes the run's ``evaluation/step_<N>``, and in it a folder named
            after ``overrides`` if there are any.
        batch: Rounds played side by side at most.
        app: Settings that replace those of ``env.app``, for example another executable.
        overrides: ``env.key=value``, what else is different from the training's environment.
    """

    conditions: Sequence[str] | None = None
    episodes: int | None = None
    seed: int | None = None
    deterministic: bool | None = None
    record: bool = False
    log: bool = False
    out: Path | None = None
    batch: int = 10
    app: Mapping[str, Any] = field(default_factory=dict)
    overrides: Sequence[str] = ()


@dataclass(frozen=True)
class Evaluation:
    """What came out.

    Attributes:
        summaries: condition -> means over its rounds, and ``rounds``, one entry each.
        step: User steps that the evaluated checkpoint was trained for.
        checkpoint: The evaluated checkpoint or packed weights.
        files: Results, videos and logs that were written.
        rounds: Every round.
    """

    summaries: dict[str, dict[str, Any]]
    step: int
    checkpoint: Path
    files: list[Path]
    rounds: list[RoundResult]


def _simulation(config: EnvConfig, n: int, *, log_dir: Path | None = None) -> Any:
    from sim2vr_harness.envs.simulation import Simulation

    return Simulation(config, n, log_dir=log_dir)


def evaluate(
    run: str | Path,
    request: Request | None = None,
    *,
    on_progress: Callable[[float], None] = lambda share: None,
    simulation: SimulationFactory = _simulation,
) -> Evaluation:
    """Let a trained user play and measure it.

    Args:
        run: A run's folder, one of its checkpoints, or ``pretrained:NAME``.
        request: What to play.
        on_progress: Told the share of the work done, from 0 to 1.
        simulation: How to make the users.

    Raises:
        InputError: The run or a number cannot be used.
        ValueError: The game does not know a condition.
    """
    request = request or Request()
    user = find_user(run)
    config = user.config
    conditions = list(request.conditions or config.evaluation.conditions)
    episodes = config.evaluation.episodes if request.episodes is None else request.episodes
    seed = config.evaluation.seed if request.seed is None else request.seed
    _check_numbers(episodes, seed, request.batch)
    deterministic = request.deterministic
    if deterministic is None:
        deterministic = config.evaluation.deterministic
    env = evaluation_env(config, request.app, request.overrides)
    require_contract(user, env)
    batch = _batch_for(env, request.batch)
    if knows_options(env.app):
        _check_conditions(env, conditions, simulation)
    out = request.out or user.evaluation_dir / _folder_of(request.overrides)
    log_dir = out / "logs" if request.log else None
    if log_dir is not None:
        for older in log_dir.glob("user*"):
            shutil.rmtree(older)
    step = 0

    def make_act(users: Any) -> Callable[..., Any]:
        nonlocal step
        player = Player(user, users.observation_space, users.action_space)
        step = player.step
        return player.act

    filmer = RoundFilmer(out) if request.record else None
    with closing(filmer) if filmer is not None else nullcontext():
        rounds: list[RoundResult] = []
        groups = _groups(env, conditions)
        for number, (own_env, own_conditions) in enumerate(groups):

            def advance(share: float, done: int = number) -> None:
                on_progress((done + share) / len(groups))

            rounds += play(
                partial(simulation, own_env, log_dir=log_dir),
                make_act,
                jobs_for(own_conditions, episodes, seed),
                deterministic=deterministic,
                batch=batch,
                watcher=filmer,
                on_progress=advance,
            )
    summaries = {}
    for condition in conditions:
        own = [result for result in rounds if result.condition == condition]
        summaries[condition] = {
            **summarise(own),
            "seed": seed,
            "deterministic": deterministic,
            "trained_steps": step,
            "overrides": list(request.overrides),
            "rounds": [result.as_dict() for result in own],
        }
    files = [_store(out, summaries), *(filmer.files if filmer else [])]
    if log_dir is not None:
        files.append(log_dir)
    return Evaluation(summaries, step, user.source, files, rounds)


def _folder_of(overrides: Sequence[str]) -> str:
    """A folder's name that says what is different; empty if nothing is."""
    told = ",".join(override.strip().removeprefix("env.") for override in overrides)
    return re.sub(r"[^\w.,=-]+", "_", told)[:_LONGEST_NAME]


def evaluation_env(
    config: TrainingConfig,
    app: Mapping[str, Any] | None = None,
    overrides: Sequence[str] = (),
) -> EnvConfig:
    """Return the environment to evaluate in: the training's, its curriculum switched off.

    As in the reference's evaluator; an adaptive game favours the targets that a user fails at, so
    that hit rates would not compare.

    Args:
        config: The run's configuration.
        app: Settings that replace those of ``env.app``.
        overrides: ``env.key=value``, what else is different.

    Raises:
        InputError: They do not go together, or an override is not of the environment.
    """
    settings = {**config.env.app.model_dump(), **(app or {})}
    options = dict(settings["options"])
    if "adaptive" in options:
        options["adaptive"] = False
    tree = config.model_dump()
    tree["env"]["app"] = {**settings, "options": options}
    for override in overrides:
        if not override.lstrip().startswith("env."):
            raise InputError("--set", repr(override), "env.KEY=VALUE: an evaluation trains nothing")
    return parse_config(apply_overrides(tree, overrides)).env


def _groups(env: EnvConfig, conditions: Sequence[str]) -> list[tuple[EnvConfig, Sequence[str]]]:
    """Return the conditions that can be played by the same apps, and these apps' settings.

    An app that takes its options at its start only is started anew for every condition.
    """
    if knows_options(env.app):
        return [(env, conditions)]
    groups: list[tuple[EnvConfig, Sequence[str]]] = []
    for condition in conditions:
        options = {**env.app.options, "condition": condition}
        app = env.app.model_copy(update={"options": options})
        groups.append((env.model_copy(update={"app": app}), [condition]))
    return groups


def _batch_for(env: EnvConfig, batch: int) -> int:
    """Return how many rounds can be played side by side: one in an app that runs already."""
    return 1 if env.app.connect is not None else batch


def _check_numbers(episodes: int, seed: int, batch: int) -> None:
    if episodes < 1:
        raise InputError("--episodes", str(episodes), "at least 1")
    if not 0 <= seed < 2**31:
        raise InputError("--seed", str(seed), "0 to 2147483647")
    if batch < 1:
        raise InputError("--batch", str(batch), "at least 1")


def _check_conditions(
    env: EnvConfig, conditions: Sequence[str], simulation: SimulationFactory
) -> None:
    """Ask the game for every condition before minutes are spent on the first one."""
    if len(set(conditions)) != len(conditions):
        raise InputError("--condition", ", ".join(conditions), "every condition once")
    blind = env.model_copy(update={"app": env.app.model_copy(update={"renderer": "null"})})
    with closing(simulation(blind, 1)) as trial:
        for condition in conditions:
            trial.reset(seeds=[0], options={"condition": condition})


def _store(out: Path, summaries: dict[str, dict[str, Any]]) -> Path:
    file = out / "results.json"
    write_atomically(file, (json.dumps(summaries, indent=2) + "\n").encode())
    return file
