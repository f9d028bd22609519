"""The training configuration: one YAML file is one simulated user.

Defaults are the reference's Whac-A-Mole training. Every model forbids unknown keys; errors name
the dotted key, what was found and the closest valid key.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, get_args

import pydantic
import yaml
from pydantic import BaseModel, Field

from sim2vr_harness import paths
from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.games import imagined_settings
from sim2vr_harness.settings import Settings
from sim2vr_harness.training.errors import InputError
from sim2vr_harness.training.ppo_config import LearningRateConfig, PPOConfig
from sim2vr_harness.training.student_config import StudentConfig
from sim2vr_harness.training.teacher_config import TeacherConfig
from sim2vr_harness.users.bodies import is_file

__all__ = [
    "CheckpointConfig",
    "EvaluationConfig",
    "LearningRateConfig",
    "PPOConfig",
    "PolicyConfig",
    "TrainingConfig",
    "WandbConfig",
    "apply_overrides",
    "defaults",
    "first_difference",
    "load_config",
    "parse_config",
    "to_yaml",
]


class PolicyConfig(Settings):
    """The network; defaults are the reference's."""

    vision_channels: tuple[int, ...] = (8, 16, 32)
    """Output channels of the 3x3 convolutions of stride 2."""
    vision_features: int = Field(default=256, ge=1)
    proprioception_features: int = Field(default=128, ge=1)
    net_arch: tuple[int, ...] = (256, 256)
    """Widths of the hidden layers behind the features, LeakyReLU."""
    shared_mlp: bool = False
    """True: actor and critic share ``net_arch``, as the paper says; False: two separate
    networks, as the reference runs."""
    log_std_init: float = 0.0
    vision_precision: Literal["float32", "bfloat16"] = "float32"
    """What the vision encoder computes in. Weights, optimiser and everything behind the image's
    features are float32 either way. bfloat16 is quicker on CPUs with AVX-512 BF16 or AMX."""
    scale_proprioception: bool = False
    """True: proprioception is standardised with numbers kept beside the weights, which
    ``UserPolicy.fit_scaling`` sets; False: taken as it is, as in the reference."""


class CheckpointConfig(Settings):
    """What is kept of the run, and how often."""

    every_steps: int = Field(default=1_000_000, ge=1)
    """User steps between two checkpoints, rounded up to whole iterations; one more is written
    when the session ends."""
    keep: int | None = Field(default=None, ge=1)
    """Keep only this many newest checkpoints; None keeps all."""


class EvaluationConfig(Settings):
    """Rounds played with a trained user."""

    conditions: tuple[str, ...] | None = None
    """Conditions of ``sim2vr-harness evaluate`` and of the evaluation that ends a training; None
    takes those that the game names for it (``sim2vr-harness games``)."""
    episodes: int = Field(default=10, ge=1)
    """Rounds per condition of ``sim2vr-harness evaluate``."""
    episodes_after_training: int = Field(default=2, ge=0)
    """Rounds per condition at the end of a training session; 0 leaves the table out."""
    seed: int = Field(default=1, ge=0, lt=2**31)
    """Seed of the first round; round k has seed + k."""
    deterministic: bool = False
    """False: actions are sampled, as in the reference."""


class WandbConfig(Settings):
    """Weights & Biases (needs the extra ``sim2vr-harness[wandb]``)."""

    enabled: bool = False
    project: str = "sim2vr"
    entity: str | None = None
    mode: Literal["online", "offline"] = "online"


class TrainingConfig(Settings):
    """Everything that a training run is made of."""

    name: str = Field(default="whacamole", pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$")
    seed: int = Field(default=1, ge=0, lt=2**31)
    total_timesteps: int = Field(default=100_000_000, ge=1)
    """User steps of the complete training, over which the learning-rate schedule runs."""
    device: Literal["auto", "cpu", "cuda"] = "auto"
    recipe: Literal["ppo", "distill"] = "ppo"
    """The stages of the run. ``ppo``: PPO from pixels alone, as the reference. ``distill``: first
    imagined rollouts, a teacher and a student, whose weights PPO begins with; for games that have a
    twin (docs/training.md)."""
    teacher: TeacherConfig = TeacherConfig()
    student: StudentConfig = StudentConfig()
    env: EnvConfig = EnvConfig()
    policy: PolicyConfig = PolicyConfig()
    ppo: PPOConfig = PPOConfig()
    checkpoint: CheckpointConfig = CheckpointConfig()
    evaluation: EvaluationConfig = EvaluationConfig()
    wandb: WandbConfig = WandbConfig()


def load_config(path: str | Path, overrides: Sequence[str] = ()) -> TrainingConfig:
    """Read and validate a training configuration.

    Args:
        path: A YAML file, or the name of a configuration that ships with the package.
        overrides: ``key=value`` with dotted keys; values are written as in YAML.

    Raises:
        InputError: The file is missing or not YAML, or a key or value cannot be used.
    """
    try:
        file = paths.config_path(path)
    except FileNotFoundError as error:
        raise InputError("CONFIG", repr(str(path)), f"a configuration file: {error}") from error
    try:
        tree = yaml.safe_load(file.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        reason = " ".join(str(error).split())
        raise InputError(str(file), "a file that is not YAML", f"YAML ({reason})") from error
    tree = {} if tree is None else tree
    if not isinstance(tree, dict):
        raise InputError(str(file), f"a {type(tree).__name__}", "a mapping of keys to values")
    return parse_config(apply_overrides(_with_body_beside(tree, file), overrides))


def _with_body_beside(tree: dict[str, Any], file: Path) -> dict[str, Any]:
    """A body's file is looked for beside the configuration that names it, then where one is."""
    tree = _copied(tree)
    env = tree.get("env")
    user = env.get("user") if isinstance(env, dict) else None
    model = user.get("model") if isinstance(user, dict) else user
    if not (isinstance(env, dict) and isinstance(model, str) and is_file(model)):
        return tree
    beside = file.parent / model
    found = str((beside if beside.is_file() else Path(model)).resolve())
    env["user"] = {**user, "model": found} if isinstance(user, dict) else {"model": found}
    return tree


def defaults(overrides: Sequence[str] = ()) -> TrainingConfig:
    """Return the reference's Whac-A-Mole training, medium; overrides as in :func:`load_config`."""
    return parse_config(apply_overrides({}, overrides))


def parse_config(tree: Mapping[str, Any]) -> TrainingConfig:
    """Validate a configuration given as nested mappings.

    Raises:
        InputError: Names the first key that cannot be used.
    """
    try:
        return _with_twin(TrainingConfig.model_validate(tree))
    except pydantic.ValidationError as error:
        raise _first_problem(error) from error


_TWIN = ("teacher", "imagined", "game")


def _with_twin(config: TrainingConfig) -> TrainingConfig:
    """Return the configuration with all settings of the game's twin, if the recipe needs them."""
    if config.recipe != "distill":
        return config
    settings = imagined_settings(config.env.app.game)
    if settings is None:
        return config  # training it says what is missing
    given = config.teacher.imagined.game
    try:
        complete = settings.model_validate(given).model_dump()
    except pydantic.ValidationError as error:
        raise _first_problem(error, _TWIN, settings) from error
    imagined = config.teacher.imagined.model_copy(update={"game": complete})
    teacher = config.teacher.model_copy(update={"imagined": imagined})
    return config.model_copy(update={"teacher": teacher})


def _first_problem(
    error: pydantic.ValidationError,
    below: Sequence[str] = (),
    model: type[BaseModel] | None = None,
) -> InputError:
    # An unknown key explains more than the wrong value it may have caused.
    problems = sorted(error.errors(), key=lambda problem: problem["type"] != "extra_forbidden")
    return _input_error(problems[0], below, model or TrainingConfig)


def apply_overrides(tree: Mapping[str, Any], overrides: Sequence[str]) -> dict[str, Any]:
    """Return a copy of ``tree`` with every ``dotted.key=value`` set.

    Raises:
        InputError: An override is not ``key=value``, or its key runs through a plain value.
    """
    result = _copied(tree)
    for override in overrides:
        key, separator, text = override.partition("=")
        key = key.strip()
        if not separator or not all(key.split(".")):
            raise InputError("--set", repr(override), "key=value, for example ppo.n_envs=4")
        try:
            value = yaml.safe_load(text)
        except yaml.YAMLError as error:
            expected = f"a value written as in YAML for {key}"
            raise InputError("--set", repr(override), expected) from error
        node = result
        *parents, last = key.split(".")
        for depth, parent in enumerate(parents):
            child = node.setdefault(parent, {})
            if not isinstance(child, dict):
                at = ".".join(parents[: depth + 1])
                expected = f"{at} itself: it is a value"
                raise InputError(f"--set {key}", f"a key inside {at}", expected)
            node = child
        node[last] = value
    return result


def to_yaml(config: TrainingConfig) -> str:
    """Write the complete configuration, defaults included, as YAML."""
    return yaml.safe_dump(config.model_dump(mode="json"), sort_keys=False)


def first_difference(
    one: TrainingConfig, other: TrainingConfig, ignore: Sequence[str] = ()
) -> tuple[str, Any, Any] | None:
    """Return the first dotted key in which two configurations differ, and both values.

    Args:
        one: The first configuration.
        other: The second one.
        ignore: Dotted keys to leave out, with everything below them.
    """
    left, right = (
        {
            key: value
            for key, value in _flat(config.model_dump(mode="json")).items()
            if not any(f"{key}.".startswith(f"{ignored}.") for ignored in ignore)
        }
        for config in (one, other)
    )
    for key in [*left, *(key for key in right if key not in left)]:
        if left.get(key) != right.get(key):
            return key, left.get(key), right.get(key)
    return None


def _flat(tree: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    leaves: dict[str, Any] = {}
    for key, value in tree.items():
        if isinstance(value, dict):
            leaves |= _flat(value, f"{prefix}{key}.")
        else:
            leaves[f"{prefix}{key}"] = value
    return leaves


def _copied(tree: Mapping[str, Any]) -> dict[str, Any]:
    return {
        key: _copied(value) if isinstance(value, Mapping) else value for key, value in tree.items()
    }


def _input_error(problem: Any, below: Sequence[str], model: type[BaseModel]) -> InputError:
    """Word one of pydantic's problems: dotted key, got, expected.

    Args:
        problem: of pydantic.
        below: keys that lead to ``model``.
        model: the one that was validated.
    """
    location = _written(model, problem["loc"])
    field = ".".join([*below, *location]) or "configuration"
    if problem["type"] == "extra_forbidden":
        return _unknown_key(location, below, model)
    message = str(problem["msg"]).removeprefix("Value error, ")
    if problem["type"] == "value_error":
        key, separator, rest = message.partition("got ")
        if separator and (not key or key.endswith(": ")):
            got, _, expected = rest.partition(", expected ")
            return InputError(".".join([field, key[:-2]]) if key else field, got, expected)
    expected = message.removeprefix("Input should be ")
    if problem["type"] == "model_type":
        expected = "a mapping of keys to values"
    elif problem["type"] in _WORDS:
        expected = _WORDS[problem["type"]]
    return InputError(field, repr(problem["input"]), expected[:1].lower() + expected[1:])


_WORDS = {
    "int_parsing": "a whole number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "float_parsing": "a number",
    "float_type": "a number",
    "bool_parsing": "true or false",
    "bool_type": "true or false",
}


def _written(model: type[BaseModel], location: Sequence[Any]) -> list[str]:
    """Return the keys of a problem as people write them: without the members of a union."""
    parts: list[str] = []
    for part in map(str, location):
        above = _model_at(parts, model)
        inside_value = above is None and parts and _model_at(parts[:-1], model) is None
        if inside_value and part in _UNION_MEMBERS:
            break
        parts.append(part)
    return parts


_UNION_MEMBERS = ("bool", "int", "float", "str", "list[float]")


def _unknown_key(
    location: Sequence[str], below: Sequence[str], root: type[BaseModel]
) -> InputError:
    model = _model_at(location[:-1], root)
    known = list(model.model_fields) if model else []
    prefix = "".join(f"{part}." for part in [*below, *location[:-1]])
    near = _nearest(location[-1], known)
    here = prefix + near if near else None
    # What was written without its mapping is meant wherever it is; else it is meant here.
    best = here if prefix and here else _elsewhere(location[-1]) or here
    hint = f" (did you mean {best!r}?)" if best else ""
    return InputError(
        prefix + location[-1], "an unknown key", f"one of {', '.join(known) or 'no keys'}{hint}"
    )


def _nearest(name: str, names: Sequence[str]) -> str | None:
    """Return the one of ``names`` that is most like ``name``, the first of equals; None if none."""
    likeness = [difflib.SequenceMatcher(None, name, each).ratio() for each in names]
    best = max(likeness, default=0.0)
    return names[likeness.index(best)] if best >= _LIKE else None


_LIKE = 0.4


def _elsewhere(name: str) -> str | None:
    """Return the dotted key of the field called ``name`` that is nearest to the top, if one is."""
    matches = [key for key in _all_keys(TrainingConfig) if key.rpartition(".")[2] == name]
    depth = min((key.count(".") for key in matches), default=0)
    nearest = [key for key in matches if key.count(".") == depth]
    return nearest[0] if len(nearest) == 1 else None


def _all_keys(model: type[BaseModel], prefix: str = "") -> list[str]:
    keys = []
    for name, field in model.model_fields.items():
        keys.append(prefix + name)
        child = _as_model(field.annotation)
        if child is not None:
            keys += _all_keys(child, f"{prefix}{name}.")
    return keys


def _model_at(location: Sequence[str], root: type[BaseModel]) -> type[BaseModel] | None:
    model: type[BaseModel] | None = root
    for part in location:
        if model is None or part not in model.model_fields:
            return None
        model = _as_model(model.model_fields[part].annotation)
    return model


def _as_model(annotation: Any) -> type[BaseModel] | None:
    for candidate in (annotation, *get_args(annotation)):
        if isinstance(candidate, type) and issubclass(candidate, BaseModel):
            return candidate
    return None
