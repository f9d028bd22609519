"""Policy of a cell: trained, fine-tuned first, or trained by the study."""

import hashlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from sim2vr_harness import __version__
from sim2vr_harness.base.errors import InputError, shown
from sim2vr_harness.base.files import read_bytes
from sim2vr_harness.base.settings import MOST_STEPS
from sim2vr_harness.client import Condition, GameFacts
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.evaluation.conditions import chosen_conditions, named_options
from sim2vr_harness.play.environment import evaluation_env
from sim2vr_harness.play.users import SimulatedUser, name_of
from sim2vr_harness.policies.scripted import is_script, read_steps
from sim2vr_harness.policies.store import TrainedUser, find_user, require_contract
from sim2vr_harness.runs.config import TrainingConfig, load_config, to_yaml
from sim2vr_harness.runs.trust import named_app, require_trust
from sim2vr_harness.studies.config import Cell, content_hash
from sim2vr_harness.studies.jobs import Pruning, TrainingTask
from sim2vr_harness.training.ppo.fine_tune import adapting

FORMAT = 2
"""Of what a cell's folder holds; another one makes all cells anew."""


class Users:
    """Trained users and hashes of their weights, each read once.

    Args:
        code: whether policies in Python files may run (``FILE.py:CLASS``).
    """

    def __init__(self, *, code: bool = False) -> None:
        self._code = code
        self._known: dict[str, tuple[TrainedUser, str]] = {}

    def find(self, name: str) -> tuple[TrainedUser, str]:
        """Return a user and the SHA-256 of its weights."""
        if name not in self._known:
            user = find_user(name, code=self._code)
            weights = read_bytes(user.source, "weights of a user")
            self._known[name] = user, hashlib.sha256(weights).hexdigest()
        return self._known[name]


@dataclass(frozen=True)
class SelectionSource:
    """Settings that all cells of a plan share; see :func:`.plan_of`.

    Attributes:
        source: The study's file or its name, for messages.
        trust_app: True if apps that files name may be run.
    """

    folder: Path | None
    users: Users
    pruning: Pruning | None
    may_diverge: bool
    source: str | Path
    trust_app: bool


@dataclass(frozen=True)
class SelectedPolicy:
    """Policy that plays a cell, with its environment and condition.

    Attributes:
        user: Trained user, as for ``evaluate``; None: the one of ``training``.
        training: Training that has to run first, if any.
        env: Environment in which it plays.
        facts: Facts of the game; a script adds measures of its own.
        condition: Condition that it plays, with the options that the cell names.
        identity: All that identifies the policy, for the cell's hash.
        deterministic: True if the user's own configuration evaluates the policy's mean.
    """

    user: str | None
    training: TrainingTask | None
    env: ResolvedEnv
    facts: GameFacts
    condition: Condition
    identity: Mapping[str, Any]
    deterministic: bool


def player_of(study: str, cell: Cell, where: SelectionSource) -> SelectedPolicy:
    """Work out who plays a cell of a study of this name.

    Raises:
        InputError: A user, configuration, key or condition that cannot be used.
    """
    settings = cell.settings
    if ("user" in settings) == ("config" in settings):
        got = "both user and config" if "user" in settings else "neither user nor config"
        raise InputError("user", got, "a trained user, or the configuration of a training")
    if "config" in settings:
        if "adapt" in settings:
            raise InputError("adapt", "it together with config", "a trained user: only those go on")
        file = _near(str(settings["config"]), where.folder)
        return _trained(study, cell, load_config(file, cell.of("training.")), where, file)
    user = _near(str(settings["user"]), where.folder)
    if user in ("still", "random") or is_script(user):
        return _untrained(cell, user, where)
    if "adapt" not in settings and cell.of("training."):
        key = next(key for key in sorted(settings) if key.startswith("training."))
        expected = "config instead of user, or adapt: what is trained already stays otherwise"
        raise InputError(key, "it together with a user", expected)
    known, weights = where.users.find(user)
    env = _env(known.config, cell, user, where)
    require_contract(known, env)
    condition = _condition(env, known.config, cell)
    identity = {"user": Path(user).name, "weights": weights}
    steps = _steps(settings.get("adapt", 0))
    if steps == 0:
        whole = identity | {"config": to_yaml(known.config)}
        mean = known.config.evaluation.deterministic
        return SelectedPolicy(user, None, env, env.facts, condition, whole, mean)
    there = env.with_options(condition.options).config
    wanted = [f"total_timesteps={steps}", *cell.of("training.")]
    config = adapting(known, user, wanted, env=there)
    return _trained(study, cell, config, where, user, adapts=(name_of(known), identity))


def _untrained(cell: Cell, user: str, where: SelectionSource) -> SelectedPolicy:
    """One without training: idle, random, or a script."""
    for key in sorted(cell.settings):
        if key == "adapt" or key.startswith("training."):
            raise InputError(key, f"it together with {user!r}", "a trained user: only those go on")
    player = SimulatedUser.find(user)
    env = player.env(None, cell.of("env."), trust_app=where.trust_app, file=where.source)
    facts = player.facts(env.facts)
    steps = [asdict(step) for step in read_steps(user)] if is_script(user) else []
    condition = _condition(env, player.config, cell)
    identity = {"user": user, "steps": steps}
    mean = player.config.evaluation.deterministic
    return SelectedPolicy(user, None, env, facts, condition, identity, mean)


def _trained(
    study: str,
    cell: Cell,
    config: TrainingConfig,
    where: SelectionSource,
    source: str,
    adapts: tuple[str, Mapping[str, Any]] | None = None,
) -> SelectedPolicy:
    """One that the study trains, of nothing or of a user of this name and identity."""
    # The training plays there, whatever the cell changes for its own rounds.
    named = where.source if named_app(cell.of("training.")) else source
    require_trust(config.env, named, trust=where.trust_app)
    config = config.model_copy(update={"name": study})
    # How often something is saved or measured changes no weight, nor does where a user lies.
    pruning = where.pruning
    compared = pruning and asdict(pruning) | {"stop": pruning.stop.model_dump(mode="json")}
    apart = {"name", "evaluation", "wandb", "from_user"}
    key = content_hash(
        config.model_dump(mode="json", exclude=apart)
        | {"format": FORMAT, "sim2vr_harness": __version__}
        | ({} if adapts is None else {"adapts": adapts[1]})
        | ({} if compared is None else {"pruning": compared})
        | ({"may_diverge": True} if where.may_diverge else {})
    )
    name = None if adapts is None else adapts[0]
    task = TrainingTask(key, to_yaml(config), cell.name, where.pruning, where.may_diverge, name)
    env = _env(config, cell, named, where)
    condition = _condition(env, config, cell)
    mean = config.evaluation.deterministic
    return SelectedPolicy(None, task, env, env.facts, condition, {"training": key}, mean)


def _env(
    config: TrainingConfig, cell: Cell, source: str | Path, where: SelectionSource
) -> ResolvedEnv:
    """Return where a cell is played; what a study's file says is not this user's word."""
    return evaluation_env(
        config,
        overrides=cell.of("env."),
        source=where.source if named_app(cell.of("env.")) else source,
        typed=False,
        trust_app=where.trust_app,
    )


def _near(name: str, folder: Path | None) -> str:
    """A path beside the study's file, where there is one; else what was written."""
    file = name.rpartition(":")[0] if ".py:" in name else name
    if folder is not None and not Path(name).is_absolute() and (folder / file).exists():
        return str(folder / name)
    return name


def _steps(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= MOST_STEPS:
        expected = f"user steps, a whole number from 0 (as it is) to {MOST_STEPS:,}"
        raise InputError("adapt", shown(value, 40), expected)
    return value


def _condition(env: ResolvedEnv, config: TrainingConfig, cell: Cell) -> Condition:
    """Return the condition of a cell; its dotted keys override the condition's own options."""
    name = cell.settings.get("condition")
    facts = env.facts
    usual = facts.condition_of(config.env.app.options) or facts.default_condition
    names = None if name is None else [str(name)]
    named = named_options(env.config, cell.of("env."))
    return chosen_conditions(facts, names, [usual], named, field="condition")[0]
