"""The training configuration: one YAML file is one simulated user.

Defaults are the reference's Whac-A-Mole training. Every model forbids unknown keys; errors name
the dotted key, what was found and the closest valid key.
"""

import copy
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, Self

import pydantic
import yaml
from pydantic import Field

from sim2vr_harness.base import paths
from sim2vr_harness.base.bounded_yaml import MOST_DEPTH
from sim2vr_harness.base.errors import InputError, shown
from sim2vr_harness.base.files import file_name, read_yaml
from sim2vr_harness.base.settings import (
    MOST_STEPS,
    Settings,
    Width,
    annotation_at,
    first_problem,
    model_at,
)
from sim2vr_harness.base.written_values import written_value
from sim2vr_harness.client import list_transports
from sim2vr_harness.client.in_process import option_kind
from sim2vr_harness.envs.config import AppConfig, EnvConfig
from sim2vr_harness.games import imagined_settings
from sim2vr_harness.runs.attention_config import AttentionCropConfig, check_attention
from sim2vr_harness.runs.dagger_config import StudentConfig
from sim2vr_harness.runs.option_config import SkillsConfig
from sim2vr_harness.runs.ppo_config import LearningRateConfig, PPOConfig
from sim2vr_harness.runs.teacher_config import TeacherConfig
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
    "read_mapping",
    "to_yaml",
]


class PolicyConfig(Settings):
    """The network; defaults are the reference's."""

    vision_channels: tuple[Width, ...] = Field(default=(8, 16, 32), min_length=1, max_length=10)
    """Output channels of the 3x3 convolutions of stride 2."""
    vision_features: Width = 256
    """Number of features that the image encoder returns."""
    proprioception_features: Width = 128
    """Number of features that the encoder of all senses without an image returns."""
    net_arch: tuple[Width, ...] = Field(default=(256, 256), max_length=20)
    """Widths of the hidden layers behind the features, LeakyReLU; actor and critic have their own,
    as the reference runs (the paper says that they share them)."""
    log_std_init: float = Field(default=0.0, ge=-20.0, le=5.0)
    """Logarithm of the actions' standard deviation at the start."""
    vision_precision: Literal["float32", "bfloat16"] = "float32"
    """Numeric format of the vision encoder. Weights, optimiser and everything behind the image's
    features are float32 either way. bfloat16 is quicker on CPUs with AVX-512 BF16 or AMX."""
    scale_proprioception: bool = False
    """True: proprioception is standardised with statistics that are stored with the weights and set
    by ``UserPolicy.fit_scaling``; False: it is used without scaling, as in the reference."""
    attention_crops: AttentionCropConfig | None = None
    """Crops around relevant objects; the recipe ``distill`` trains their positions."""


class CheckpointConfig(Settings):
    """Checkpoints of the run: their interval and number."""

    every_steps: int = Field(default=1_000_000, ge=1, le=MOST_STEPS)
    """User steps between two checkpoints, rounded up to whole iterations; one more is written
    when the session ends."""
    keep: int | None = Field(default=None, ge=1, le=1_000_000)
    """Keep only this many newest checkpoints; None keeps all."""


class EvaluationConfig(Settings):
    """Rounds played with a trained user."""

    conditions: tuple[str, ...] | None = None
    """Conditions of ``sim2vr-harness evaluate`` and of the evaluation that ends a training; None:
    those that the game names for it (``sim2vr-harness games``)."""
    episodes: int = Field(default=10, ge=1, le=1_000_000)
    """Rounds per condition of ``sim2vr-harness evaluate``."""
    episodes_after_training: int = Field(default=2, ge=0, le=1_000_000)
    """Rounds per condition at the end of a training session; 0 leaves the table out."""
    seed: int = Field(default=1, ge=0, lt=2**31)
    """Seed of the first round; round k has seed + k."""
    deterministic: bool = False
    """False: actions are sampled, as in the reference."""


class WandbConfig(Settings):
    """Weights & Biases (needs the extra ``sim2vr-harness[wandb]``)."""

    enabled: bool = False
    """True: metrics are sent to Weights & Biases."""
    project: str = "sim2vr"
    """Project on Weights & Biases."""
    entity: str | None = None
    """User or team on Weights & Biases; None: your default one."""
    mode: Literal["online", "offline"] = "online"
    """``offline`` writes to a local folder, to be uploaded with ``wandb sync``."""


class TrainingConfig(Settings):
    """Everything that a training run is made of."""

    name: str = Field(default="whacamole", pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$")
    """Name of the run; its folder under ``runs/`` has it unless ``--out`` is given."""
    seed: int = Field(default=1, ge=0, lt=2**31)
    """Seed of everything that is random in the training."""
    total_timesteps: int = Field(default=100_000_000, ge=1, le=MOST_STEPS)
    """User steps of the complete training, over which the learning-rate schedule runs."""
    device: Literal["auto", "cpu", "cuda"] = "auto"
    """Device on which torch computes; ``auto`` uses a GPU if torch finds one."""
    recipe: Literal["ppo", "distill", "skills", "adapt"] = "ppo"
    """The stages of the run. ``ppo``: PPO from pixels alone, as the reference. ``distill``: first
    imagined rollouts, a teacher and a student, whose weights PPO begins with; for games that have a
    differentiable game model. ``skills``: value learning over motor options at image cells, for any
    app (docs/concepts/training.md). ``adapt``: PPO continues with the weights of ``from_user``."""
    from_user: str | None = None
    """With the recipe ``adapt``: the trained user to continue, in any form that ``evaluate``
    accepts."""
    skills: SkillsConfig = SkillsConfig()
    """The recipe ``skills``."""
    teacher: TeacherConfig = TeacherConfig()
    """The teacher policy of the recipe ``distill``."""
    student: StudentConfig = StudentConfig()
    """The student policy of the recipe ``distill``."""
    env: EnvConfig = EnvConfig()
    """The app, the simulated user and its senses."""
    policy: PolicyConfig = PolicyConfig()
    """The network of the policy from senses to actions."""
    ppo: PPOConfig = PPOConfig()
    """PPO with the policy from senses to actions."""
    checkpoint: CheckpointConfig = CheckpointConfig()
    """Checkpoints of the run."""
    evaluation: EvaluationConfig = EvaluationConfig()
    """Rounds played with the trained user."""
    wandb: WandbConfig = WandbConfig()
    """Logging to Weights & Biases."""

    @property
    def policy_kind(self) -> str:
        """Kind of the trained policy: ``hierarchical`` or ``visual``."""
        return "hierarchical" if self.recipe == "skills" else "visual"

    @property
    def last_stage_steps(self) -> int:
        """User steps of the run's last stage, which ``--timesteps`` counts."""
        hierarchical = self.policy_kind == "hierarchical"
        return self.skills.q_learning.user_steps if hierarchical else self.total_timesteps

    @pydantic.model_validator(mode="after")
    def _from_user(self) -> Self:
        if (self.recipe == "adapt") != (self.from_user is not None):
            got = "none" if self.from_user is None else f"{self.from_user!r}"
            raise ValueError(
                f"from_user: got {got} with recipe {self.recipe!r}, expected a trained user with "
                "recipe 'adapt', and none with others"
            )
        return self

    @pydantic.model_validator(mode="after")
    def _clear_crops(self) -> Self:
        if self.policy.attention_crops is not None:
            check_attention(self.recipe, self.env)
        return self


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
    return parse_config(apply_overrides(_extended(file), overrides))


_MOST_EXTENDED = 8
"""Files of a chain of ``extends``; more are a mistake."""


def _extended(file: Path, above: tuple[Path, ...] = ()) -> dict[str, Any]:
    """Return the content of a file, merged into the configuration that it extends, if any."""
    chain = (*above, file.resolve())
    tree = _with_files_beside(read_mapping(file), file)
    name = tree.pop("extends", None)
    if name is None:
        return tree
    field = f"{file_name(file)}: extends"
    if not isinstance(name, str):
        raise InputError(field, shown(name), "the name or the file of a configuration")
    base = _base(name, file, field)
    if base.resolve() in chain:
        raise InputError(field, shown(name), "a configuration that does not extend this one")
    if len(chain) >= _MOST_EXTENDED:
        raise InputError(field, shown(name), f"a chain of at most {_MOST_EXTENDED} configurations")
    return _merged(_extended(base, chain), tree)


def _base(name: str, file: Path, field: str) -> Path:
    """Find an extended configuration: in the file's folder first, then as on the command line."""
    for beside in (file.parent / name, file.parent / f"{name}.yaml"):
        if beside.is_file():
            return beside
    try:
        return paths.config_path(name)
    except FileNotFoundError as error:
        raise InputError(field, shown(name), f"a configuration file: {error}") from error


def _merged(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return a mapping with changes laid over it; mappings are merged, all else is replaced."""
    result = dict(base)
    for key, value in changes.items():
        below = result.get(key)
        if isinstance(below, Mapping) and isinstance(value, Mapping):
            value = _merged(below, value)
        result[key] = value
    return result


def read_mapping(file: Path) -> dict[str, Any]:
    """Return the content of a configuration's YAML file, before any check.

    Raises:
        InputError: It is missing, not YAML, or no mapping of keys to values.
    """
    expected = "a configuration in YAML, a mapping of keys to values"
    tree = read_yaml(file, expected)
    if not isinstance(tree, dict):
        raise InputError(file_name(file), f"YAML of {shown(tree, 40)}", expected)
    return tree


def _with_files_beside(tree: dict[str, Any], file: Path) -> dict[str, Any]:
    """Resolve files of body, page and task: in the configuration's folder, then the current one."""
    tree = _copied(tree)
    env = tree.get("env")
    app = env.get("app") if isinstance(env, dict) else None
    if isinstance(app, dict):
        _with_page_beside(app, file.parent)
    user = env.get("user") if isinstance(env, dict) else None
    model = user.get("model") if isinstance(user, dict) else user
    if not (isinstance(env, dict) and isinstance(model, str) and is_file(model)):
        return tree
    beside = file.parent / model
    found = str((beside if beside.is_file() else Path(model)).resolve())
    env["user"] = {**user, "model": found} if isinstance(user, dict) else {"model": found}
    return tree


def _with_page_beside(app: dict[str, Any], folder: Path) -> None:
    """Make the paths of a page absolute, in place; missing files stay as they are."""

    def found(name: object) -> Any:
        beside = folder / name if isinstance(name, str) and "://" not in name else None
        return str(beside.resolve()) if beside is not None and beside.exists() else name

    if "page" in app:
        app["page"] = found(app["page"])
    if isinstance(app.get("map"), dict):
        app["map"] = {prefix: found(place) for prefix, place in app["map"].items()}
    if isinstance(app.get("task"), str):
        task, colon, name = app["task"].partition(".py:")
        app["task"] = found(f"{task}.py") + f":{name}" if colon else found(app["task"])


def defaults(overrides: Sequence[str] = ()) -> TrainingConfig:
    """Return the reference's Whac-A-Mole training, medium; overrides as in :func:`load_config`."""
    return parse_config(apply_overrides({}, overrides))


def parse_config(tree: Mapping[str, Any]) -> TrainingConfig:
    """Validate a configuration given as nested mappings.

    Raises:
        InputError: Names the first key that cannot be used.
    """
    try:
        return _with_game_model(TrainingConfig.model_validate(tree))
    except pydantic.ValidationError as error:
        raise first_problem(error, TrainingConfig) from error


_GAME_MODEL = ("teacher", "imagined", "game")


def _with_game_model(config: TrainingConfig) -> TrainingConfig:
    """Return the configuration with all settings of its game model, if the recipe needs them."""
    if config.recipe != "distill":
        return config
    settings = imagined_settings(config.env.app.game)
    if settings is None:
        return config  # training it says what is missing
    given = config.teacher.imagined.game
    try:
        complete = settings.model_validate(given).model_dump()
    except pydantic.ValidationError as error:
        raise first_problem(error, settings, _GAME_MODEL) from error
    imagined = config.teacher.imagined.model_copy(update={"game": complete})
    teacher = config.teacher.model_copy(update={"imagined": imagined})
    return config.model_copy(update={"teacher": teacher})


def apply_overrides(tree: Mapping[str, Any], overrides: Sequence[str]) -> dict[str, Any]:
    """Return a copy of ``tree`` with every ``dotted.key=value`` set.

    Raises:
        InputError: An override is not ``key=value``, or its key runs through a plain value.
    """
    result = copy.deepcopy(dict(tree))
    for override in overrides:
        key, separator, text = override.partition("=")
        key = key.strip()
        if not separator or not all(key.split(".")):
            raise InputError("--set", shown(override), "key=value, for example ppo.n_envs=4")
        *parents, last = key.split(".")
        try:
            value = written_value(paths.uri_unless_utf8(text), _declared(parents, last))
        except InputError as error:
            expected = f"a value written as in YAML for {shown(key)[1:-1]} ({error.got})"
            raise InputError("--set", shown(override), expected) from error
        node = result
        if len(parents) >= MOST_DEPTH:
            raise InputError("--set", shown(override), f"a key of at most {MOST_DEPTH} parts")
        for depth, parent in enumerate(parents):
            child = node.setdefault(parent, {})
            if child is None and model_at(parents[: depth + 1], TrainingConfig) is not None:
                child = node[parent] = {}  # an optional group, off so far: a key of it turns it on
            if not isinstance(child, dict):
                at = ".".join(parents[: depth + 1])
                expected = f"{at} itself: it is a {'list' if isinstance(child, list) else 'value'}"
                raise InputError(f"--set {key}", f"a key inside {at}", expected)
            node = child
        node[last] = value
    _settle_words(overrides, result)
    return result


def _settle_words(overrides: Sequence[str], tree: dict[str, Any]) -> None:
    """Take ``yes`` or ``no`` for a game's option as the game declares it: a truth, or text.

    Raises:
        InputError: The game does not say which.
    """
    last = {one.partition("=")[0].strip(): one for one in overrides}
    for key, override in last.items():
        *parents, option = key.split(".")
        word = override.partition("=")[2].strip()
        if parents != _GAME_OPTIONS or word.lower() not in _WORDS:
            continue
        app = tree["env"]["app"]
        if not isinstance(app, dict) or option not in (app.get("options") or {}):
            continue  # a later override is of all of it
        game = str(app.get("game", AppConfig().game))
        kind = None if app.get("page") is not None else option_kind(game, option)
        if kind is None:
            expected = f"true or false, or text in quotes, such as {option}=\"'{word}'\""
            raise InputError("--set", f"{shown(override)}, a truth or a word", expected)
        if kind == "text":
            app["options"][option] = word


_GAME_OPTIONS = ["env", "app", "options"]
_WORDS = ("yes", "no", "on", "off")
"""Words that YAML 1.1 reads as booleans and people mean as words."""
_TRANSPORT_OPTIONS = ["env", "app", "transport_options"]


def _declared(parents: Sequence[str], last: str) -> Any:
    """Return the declared type of a key; None if it is not declared."""
    if list(parents) == _TRANSPORT_OPTIONS:
        known = [transport for transport in list_transports() if last in transport.options]
        if known and all(last in transport.text_options for transport in known):
            return str
    return annotation_at([*parents, last], TrainingConfig)


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
