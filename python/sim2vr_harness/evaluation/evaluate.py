"""``sim2vr-harness evaluate``: a trained user plays, and what it did is measured."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.client import Condition, GameFacts
from sim2vr_harness.envs.apps import knows_options
from sim2vr_harness.envs.config import EnvConfig, UserConfig, with_options
from sim2vr_harness.envs.games import game_facts
from sim2vr_harness.evaluation.data.folder import EvaluationData
from sim2vr_harness.evaluation.data.recording import DataRecorder
from sim2vr_harness.evaluation.environment import evaluation_env
from sim2vr_harness.evaluation.metrics import RoundResult, summarise
from sim2vr_harness.evaluation.results import EvaluationResults
from sim2vr_harness.evaluation.rollouts import Watcher, jobs_for, play
from sim2vr_harness.evaluation.round_logs import RoundLogs
from sim2vr_harness.evaluation.training_distribution import met, unpractised
from sim2vr_harness.evaluation.video import RoundFilmer
from sim2vr_harness.policies.player import PolicyRunner
from sim2vr_harness.policies.store import TrainedUser, find_user, require_contract
from sim2vr_harness.runs.config import TrainingConfig
from sim2vr_harness.users import PeopleSettings, effort_weight

__all__ = ["Evaluation", "Request", "evaluate", "name_of"]

_LONGEST_NAME = 120
"""Of a folder, in characters."""

_PASSING_LOGS = ".logs"
"""Of rounds whose logs are read, and not kept."""

_USER_BYTES = 2_000_000
"""What a round needs beside others at least: body, app and its share of the renderers."""

SimulationFactory = Callable[..., Any]
"""(EnvConfig, n, log_dir=Path | None) -> simulation."""


@dataclass(frozen=True)
class Request:
    """What to evaluate; None takes the value of the run's configuration.

    Attributes:
        conditions: The game's conditions; without any in the configuration, those that the game
            names.
        episodes: Rounds per condition.
        seed: Seed of the first round, and of the people.
        people: How many persons (``env.user.people``, docs/concepts/people.md) play
            ``episodes`` rounds per condition each; None: as in the training.
        deterministic: Whether actions are the policy's mean.
        record: Whether to film the first round of every condition.
        film_seconds: The longest film, game time; None: whole rounds.
        log: Whether to keep the game's CSV logs.
        steps: Whether to write tables of every user step and app frame, too.
        out: Where files go; None takes the run's ``evaluation/step_<N>``, and in it a folder named
            after what is different from the run's own settings, if anything is. Results are added
            to those that are there.
        overwrite: Whether to begin with new results where there are others.
        batch: Rounds played side by side at most.
        app: Settings that replace those of ``env.app``, for example another executable.
        overrides: ``env.key=value``, what else is different from the training's environment.
        trust_app: Whether the program that the run names as its app may be started, though this
            user has never done so (docs/reference/apps.md).
        cores: How many to use, whatever the run says; changes no number.
    """

    conditions: Sequence[str] | None = None
    episodes: int | None = None
    seed: int | None = None
    people: int | None = None
    deterministic: bool | None = None
    record: bool = False
    film_seconds: float | None = None
    log: bool = False
    steps: bool = True
    out: str | Path | None = None
    overwrite: bool = False
    batch: int = 10
    app: Mapping[str, Any] = field(default_factory=dict)
    overrides: Sequence[str] = ()
    trust_app: bool = False
    cores: int | None = None


@dataclass(frozen=True)
class Evaluation:
    """What came out.

    Attributes:
        summaries: condition -> means over its rounds, and ``rounds``, one entry each.
        facts: What the game publishes.
        step: User steps that the evaluated checkpoint was trained for.
        checkpoint: The evaluated checkpoint or packed weights.
        files: Results, tables, videos and logs that were written.
        rounds: Every round.
        unpractised: What the user never practised, a line each.
        data: The tables, as data frames: of everything that is in the folder.
        unread: Logs of the app that the tables lack, and why, a line each.
    """

    summaries: dict[str, dict[str, Any]]
    facts: GameFacts
    step: int
    checkpoint: Path
    files: list[Path]
    rounds: list[RoundResult]
    unpractised: list[str]
    data: EvaluationData
    unread: list[str]

    @property
    def episodes(self) -> Any:
        """A row per episode; see :class:`EvaluationData`, as for what follows."""
        return self.data.episodes

    @property
    def events(self) -> Any:
        """A row per item of a round."""
        return self.data.events

    @property
    def steps(self) -> Any:
        """A row per user step."""
        return self.data.steps()

    @property
    def frames(self) -> Any:
        """A row per frame of the app."""
        return self.data.frames()


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
        on_progress: Called with the share of the work done, from 0 to 1.
        simulation: How to make the users.

    Raises:
        InputError: The run, a number, a condition or the place for the results cannot be used.
    """
    request = request or Request()
    user = find_user(run)
    config = user.config
    episodes = config.evaluation.episodes if request.episodes is None else request.episodes
    seed = config.evaluation.seed if request.seed is None else request.seed
    deterministic = request.deterministic
    if deterministic is None:
        deterministic = config.evaluation.deterministic
    env = evaluation_env(
        config, request.app, request.overrides, source=run, trust_app=request.trust_app
    )
    if request.people is not None:
        env = _with_people(env, request.people, seed)
    if request.cores is not None:
        env = env.model_copy(update={"cores": request.cores})
    require_contract(user, env)
    facts = game_facts(env.app)
    wanted = request.conditions or config.evaluation.conditions or met(config)
    conditions = _conditions(facts, wanted)
    names = [condition.name for condition in conditions]
    batch = _batch_for(env, request.batch)
    rounds_each = episodes * (request.people or 1)
    _check_numbers(episodes, seed, min(batch, rounds_each * len(conditions)))
    out = Path(request.out) if request.out else user.evaluation_dir / _folder_of(config, request)
    settings: dict[str, Any] = {
        "user": name_of(user),
        "episodes": episodes,
        "seed": seed,
        "deterministic": deterministic,
        "overrides": list(request.overrides),
        "app": dict(request.app),
        **({} if request.people is None else {"people": request.people}),
    }
    results = EvaluationResults(out)
    new = unpractised(config, env, names)
    weight = effort_weight(env.user.effort.model, env.user.effort.weight)
    log_root = out / ("logs" if request.log else _PASSING_LOGS)
    logs = RoundLogs(log_root) if request.log or _logs_by_itself(env) else None
    filmer = None
    if request.record:
        filmer = RoundFilmer(out, facts, seconds=request.film_seconds)
    recorder = DataRecorder(out, facts, env, moments=request.steps)
    watchers: list[Watcher] = [*recorder.watchers, *(each for each in (logs, filmer) if each)]

    def make_act(users: Any) -> PolicyRunner:
        player = PolicyRunner(user, users.observation_space, users.action_space)
        settings["trained_steps"] = player.step
        if not request.overwrite:
            results.require_room(names, settings)
        else:
            recorder.clear()
        return player

    with ExitStack() as stack:
        stack.callback(shutil.rmtree, out / _PASSING_LOGS, ignore_errors=True)
        if filmer is not None:
            stack.enter_context(closing(filmer))
        rounds: list[RoundResult] = []
        groups = _groups(env, conditions)
        for number, (own_env, own_conditions) in enumerate(groups):

            def make(n: int, own: EnvConfig = own_env) -> Any:
                return simulation(own, n, log_dir=logs.folder() if logs is not None else None)

            def advance(share: float, done: int = number) -> None:
                on_progress((done + share) / len(groups))

            rounds += play(
                make,
                make_act,
                jobs_for(own_conditions, episodes, seed, request.people),
                facts,
                deterministic=deterministic,
                batch=batch,
                watchers=watchers,
                on_progress=advance,
            )
        if logs is not None:
            settled = logs.settle(rounds, out)
            rounds = settled if request.log else rounds
            recorder.take_logs(settled)
        recorder.finish(rounds, settings, weight)
    summaries = {}
    for name in names:
        own = [result for result in rounds if result.condition == name]
        summaries[name] = {
            **summarise(own, facts),
            **settings,
            "game": facts.name,
            "effort_weight": weight,
            "unpractised": new,
            "rounds": [result.as_dict() for result in own],
        }
    files = [results.add(summaries, overwrite=request.overwrite), recorder.root]
    files += filmer.files if filmer else []
    if request.log and logs is not None and logs.any:
        files.append(out / "logs")
    step = int(settings["trained_steps"])
    data, unread = EvaluationData(recorder.root), recorder.unread
    return Evaluation(summaries, facts, step, user.source, files, rounds, new, data, unread)


def _logs_by_itself(env: EnvConfig) -> bool:
    """Whether the app is ours and started here, so that its logs cost nobody an argument."""
    app = env.app
    return app.connect is None and app.executable is None and app.page is None


def _with_people(env: EnvConfig, people: int, seed: int) -> EnvConfig:
    """The environment with so many people of this seed, as the training's differ or as usual.

    Raises:
        InputError: There is nobody, or the configuration says what people differ in.
    """
    if people < 1:
        raise InputError("--people", str(people), "at least 1")
    chosen = (env.user.people or PeopleSettings()).model_dump() | {"seed": seed, "count": people}
    user = UserConfig(**(env.user.model_dump() | {"people": chosen}))
    return env.model_copy(update={"user": user})


def name_of(user: TrainedUser) -> str:
    """A packed user's name, or the run's and the checkpoint's."""
    if "name" in user.card:
        return str(user.card["name"])
    return f"{Path(os.path.realpath(user.source)).parents[1].name}/{user.source.stem}"


def _conditions(facts: GameFacts, names: Sequence[str] | None) -> list[Condition]:
    """The conditions of these names, or those that the game evaluates.

    Raises:
        InputError: The game does not know one, or one comes twice.
    """
    chosen = list(names or facts.evaluated)
    if not chosen:
        raise InputError(
            "--condition", "none", f"one: the app of {facts.name!r} does not say which it has"
        )
    if len(set(chosen)) != len(chosen):
        raise InputError("--condition", ", ".join(chosen), "every condition once")
    try:
        return [facts.condition(name) for name in chosen]
    except ValueError as error:
        got, _, expected = str(error).partition(": got ")[2].partition(", expected ")
        raise InputError("--condition", got, expected) from error


def _folder_of(config: TrainingConfig, request: Request) -> str:
    """A folder's name that says what is different from the run's own settings; empty if nothing."""
    usual = config.evaluation
    told = [override.strip().removeprefix("env.") for override in request.overrides]
    if request.people is not None:
        told.append(f"people={request.people}")
    for key in ("episodes", "seed", "deterministic"):
        value = getattr(request, key)
        if value is not None and value != getattr(usual, key):
            told.append(f"{key}={value}".lower())
    told += [f"{key}={value}" for key, value in request.app.items() if value]
    return re.sub(r"[^\w.,=-]+", "_", ",".join(told))[:_LONGEST_NAME]


def _groups(
    env: EnvConfig, conditions: Sequence[Condition]
) -> list[tuple[EnvConfig, Sequence[Condition]]]:
    """Return the conditions that can be played by the same apps, and these apps' settings.

    An app that takes its options at its start only is started anew for every condition.
    """
    if knows_options(env.app):
        return [(env, conditions)]
    return [(with_options(env, condition.options), [condition]) for condition in conditions]


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
    have = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_AVPHYS_PAGES")
    if batch * _USER_BYTES > have:
        raise InputError(
            "--batch",
            f"{batch:,} rounds side by side, which need {batch * _USER_BYTES / 2**30:,.0f} GiB",
            f"at most {have // _USER_BYTES:,} with the memory that is free",
        )
