"""The effects battery: published effects, and what a simulated user shows of them.

A folder of YAML files. Each one lets participants reach, or is a study, and names the effects that
its numbers are compared with.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pydantic
from numpy.typing import NDArray
from pydantic import Field, model_validator

from sim2vr_harness.base.errors import InputError, shown
from sim2vr_harness.base.files import file_name, read_yaml, write_atomically
from sim2vr_harness.base.settings import Settings, first_problem
from sim2vr_harness.figures import html
from sim2vr_harness.policies.hierarchical.motor_store import human_policy_for, load_human_policy
from sim2vr_harness.policies.store import find_user
from sim2vr_harness.runs.config import TrainingConfig, load_config
from sim2vr_harness.statistics.intervals import mean_interval
from sim2vr_harness.studies.config import parse_study
from sim2vr_harness.studies.data import StudyData, factor_column
from sim2vr_harness.studies.runner import StudyProgress, run_study
from sim2vr_harness.training.motor_control.aimed_movements import measure_movements

FloatArray = NDArray[np.float64]
_EXPECTED = "effects in YAML, a mapping of keys to values"
_RESAMPLES = 400
"""Of participants, for intervals of what is not a mean over participants."""


class Reaches(Settings):
    """Aimed movements to nine indices of difficulty (``users motor measure --people``)."""

    persons: int = Field(default=12, ge=2, le=1000)
    repeats: int = Field(default=8, ge=1, le=1000)
    """Movements of each participant to each index of difficulty."""
    seed: int = Field(default=3, ge=0, le=2**31 - 1)


class EffectConfig(Settings):
    """A published effect."""

    effect: str
    """Published effect, in words."""
    measure: str
    minus: str | None = None
    """Of reaches: the measure that is subtracted."""
    factor: str | None = None
    """Of a study: whose two levels are compared."""
    levels: tuple[str, str] | None = None
    of: Literal["difference", "ratio"] = "difference"
    """Of a study: the second level minus the first, or divided by it."""
    sign: Literal["positive", "negative"] | None = None
    """Of a difference, or of a ratio minus 1; None: only the size is published."""
    published: tuple[float, float] | None = None
    """Least and greatest size that is published of people."""
    source: str


class EffectsConfig(Settings):
    """Effects that the same participants are measured for."""

    name: str
    game: str | None = None
    """Of the study."""
    reaches: Reaches | None = None
    study: dict[str, Any] | None = None
    """Study as in docs/reference/study.md; ``--user`` replaces ``fixed.user``."""
    effects: tuple[EffectConfig, ...] = Field(min_length=1)

    @model_validator(mode="after")
    def _consistent(self) -> EffectsConfig:
        if (self.reaches is None) == (self.study is None):
            raise ValueError("reaches, study: got both or none, expected one of them")
        if self.study is not None and self.game is None:
            raise ValueError("game: got none, expected that of the study")
        for i, effect in enumerate(self.effects):
            compared = effect.factor is not None and effect.levels is not None
            if self.study is not None and not compared:
                raise ValueError(f"effects.{i}: got no factor and levels, expected both")
            if self.reaches is not None and (effect.factor or effect.levels):
                raise ValueError(f"effects.{i}.factor: got one, expected none with reaches")
        return self


@dataclass(frozen=True)
class EffectResult:
    """Size of a published effect in a simulated user.

    Attributes:
        name: Name of the file.
        effect: Published effect, in words.
        source: Publication.
        sign: Published sign.
        published: Published interval of the size.
        value: Size in the simulated user; NaN if it was not measured.
        interval: 95 % interval of the value over participants; None: unknown.
        n: Number of participants.
        note: Reason why it was not measured.
    """

    name: str
    effect: str
    source: str
    sign: str | None
    published: tuple[float, float] | None
    value: float = float("nan")
    interval: tuple[float, float] | None = None
    n: int = 0
    neutral: float = 0.0
    note: str = ""

    @property
    def sign_found(self) -> str:
        """``right``, ``wrong``, or ``unclear`` where the interval has both; empty: none known."""
        if self.sign is None or self.note:
            return ""
        low, high = self.interval or (self.value, self.value)
        if low <= self.neutral <= high:
            return "unclear"
        return "right" if (self.value > self.neutral) == (self.sign == "positive") else "wrong"

    @property
    def size_found(self) -> str:
        """``inside`` or ``outside`` the published interval; empty: none known."""
        if self.published is None or self.note:
            return ""
        return "inside" if self.published[0] <= self.value <= self.published[1] else "outside"


def load_effects(folder: Path) -> list[EffectsConfig]:
    """Read a folder's files, in the order of their names.

    Raises:
        InputError: There is none, or one cannot be used.
    """
    files = sorted(folder.glob("*.yaml"))
    if not files:
        raise InputError(file_name(folder), "no *.yaml in it", "a folder of effects")
    return [_load(file) for file in files]


def _load(file: Path) -> EffectsConfig:
    tree = read_yaml(file, _EXPECTED)
    if not isinstance(tree, dict):
        raise InputError(file_name(file), f"YAML of {shown(tree, 40)}", _EXPECTED)
    try:
        return EffectsConfig.model_validate(tree)
    except pydantic.ValidationError as error:
        found = first_problem(error, EffectsConfig)
        field = f"{file_name(file)}: {found.field}"
        raise InputError(field, found.got, found.expected) from error


def run_effects(
    folder: Path,
    out: Path,
    *,
    user: str | None = None,
    jobs: int | None = None,
    trust_app: bool = False,
    on_progress: Callable[[StudyProgress], None] = lambda progress: None,
    on_reaches: Callable[[float], None] = lambda share: None,
) -> list[EffectResult]:
    """Measure a user's effects, and write ``effects.json``, ``effects.md`` and ``effects.html``.

    Args:
        folder: Of effects.
        out: What was measured there before is not measured again.
        user: Who plays, as of ``evaluate``; None: the users that the files name, and the human
            motor policy that ships.
        jobs: As of a study.
        trust_app: As of a study.
        on_progress: As of a study.
        on_reaches: Receives the proportion of the reaches that is done.

    Raises:
        InputError: A file or the user cannot be used; nothing is played then.
    """
    files = load_effects(folder)
    for file in files:
        if file.study is not None:
            parse_study({"name": file.name, **file.study})
    config = None if user is None else find_user(user, code=trust_app).config
    out.mkdir(parents=True, exist_ok=True)
    found: list[EffectResult] = []
    for file in files:
        if file.reaches is not None:
            found += _of_reaches(file, file.reaches, config, on_reaches)
            continue
        study = _study(file, user, config)
        if isinstance(study, str):
            found += [_unmeasured(file, effect, study) for effect in file.effects]
            continue
        done = run_study(
            study, out / file.name, jobs=jobs, trust_app=trust_app, on_progress=on_progress
        )
        found += [_of_study(file, effect, done.data) for effect in file.effects]
    _write(out, found, user)
    return found


def _unmeasured(file: EffectsConfig, effect: EffectConfig, note: str) -> EffectResult:
    return EffectResult(
        file.name, effect.effect, effect.source, effect.sign, effect.published, note=note
    )


# --- reaches ---------------------------------------------------------------------------------


def _of_reaches(
    file: EffectsConfig,
    reaches: Reaches,
    config: TrainingConfig | None,
    on_progress: Callable[[float], None],
) -> list[EffectResult]:
    if config is not None and not config.skills.people:
        note = "the user has no human motor policy"
        return [_unmeasured(file, effect, note) for effect in file.effects]
    env = (config or _shipped()).env
    step_s = 1.0 / env.action_frequency_hz
    given = None if config is None else config.skills.motor
    if given is None:
        policy = human_policy_for(env.user, step_s)
    else:
        policy = load_human_policy(Path(given), env.user, step_s)
    measures = measure_movements(
        policy,
        env.user,
        persons=reaches.persons,
        repeats=reaches.repeats,
        seed=reaches.seed,
        on_progress=on_progress,
    )
    # Summaries of participants drawn with replacement.
    rng = np.random.default_rng([reaches.seed, 71])
    rows = np.arange(reaches.persons * reaches.repeats).reshape(reaches.persons, -1)
    drawn = rng.integers(reaches.persons, size=(_RESAMPLES, reaches.persons))
    summaries = [measures.of(rows[persons].ravel()).summary() for persons in drawn]
    return [
        _reached(file, effect, measures.summary(), summaries, reaches) for effect in file.effects
    ]


def _shipped() -> TrainingConfig:
    """Persons of the body that the human motor policy ships for."""
    from sim2vr_harness.envs.people_preset import as_population

    config = load_config("skills", [])
    env = config.env.model_copy(update={"user": as_population(config.env.user)})
    return config.model_copy(update={"env": env})


def _reached(
    file: EffectsConfig,
    effect: EffectConfig,
    summary: Mapping[str, float],
    resampled: Sequence[Mapping[str, float]],
    reaches: Reaches,
) -> EffectResult:
    for name in (effect.measure, effect.minus):
        if name is not None and name not in summary:
            raise InputError(f"{file.name}: measure", repr(name), f"one of {', '.join(summary)}")

    def value(of: Mapping[str, float]) -> float:
        return of[effect.measure] - (0.0 if effect.minus is None else of[effect.minus])

    low, high = np.nanpercentile([value(each) for each in resampled], [2.5, 97.5])
    return EffectResult(
        file.name,
        effect.effect,
        effect.source,
        effect.sign,
        effect.published,
        value(summary),
        (float(low), float(high)),
        reaches.persons,
    )


# --- studies ---------------------------------------------------------------------------------


def _study(
    file: EffectsConfig, user: str | None, config: TrainingConfig | None
) -> dict[str, Any] | str:
    """Return the study with its user, or why it cannot be played."""
    assert file.study is not None
    tree = {"name": file.name, **file.study}
    fixed = dict(tree.get("fixed", {}))
    if user is not None and config is not None:
        if config.env.app.game != file.game:
            return f"the user plays {config.env.app.game}, not {file.game}"
        fixed["user"] = user
    if "user" not in fixed:
        return f"no user of {file.game} ships; give one with --user"
    measures = tuple(dict.fromkeys(effect.measure for effect in file.effects))
    return {**tree, "fixed": fixed, "measures": list(measures)}


def _of_study(file: EffectsConfig, effect: EffectConfig, data: StudyData) -> EffectResult:
    assert effect.factor is not None and effect.levels is not None
    column, episodes = factor_column(effect.factor), data.episodes
    if column not in episodes or not set(effect.levels) <= set(episodes[column]):
        expected = f"two levels of a factor of the study {file.name}"
        raise InputError(f"{file.name}: {effect.factor}", ", ".join(effect.levels), expected)
    means = episodes.groupby(["unit", column])[effect.measure].mean().unstack()
    first, second = (means[level].to_numpy(float) for level in effect.levels)
    ratio = effect.of == "ratio"
    each = second / first if ratio else second - first
    each = each[np.isfinite(each)]
    if not len(each):
        return _unmeasured(file, effect, "no participant has a value at both levels")
    return EffectResult(
        file.name,
        effect.effect,
        effect.source,
        effect.sign,
        effect.published,
        float(each.mean()),
        mean_interval(each),
        len(each),
        1.0 if ratio else 0.0,
    )


# --- output ----------------------------------------------------------------------------------

HEADER = ("effect", "published", "user", "95 % interval", "n", "sign", "size", "source")


def table(found: Sequence[EffectResult]) -> list[tuple[str, ...]]:
    """Return a row of text per effect, in the order of :data:`HEADER`."""
    return [
        (
            each.effect,
            _published(each),
            each.note or f"{each.value:.3g}",
            "" if each.interval is None else f"{each.interval[0]:.3g} to {each.interval[1]:.3g}",
            str(each.n or ""),
            each.sign_found,
            each.size_found,
            each.source,
        )
        for each in found
    ]


def score(found: Sequence[EffectResult]) -> str:
    """Return one line: how many signs and sizes are as published."""
    signs = [each.sign_found for each in found if each.sign_found]
    sizes = [each.size_found for each in found if each.size_found]
    left = sum(bool(each.note) for each in found)
    return (
        f"Signs right: {signs.count('right')} of {len(signs)}. Sizes inside the published "
        f"interval: {sizes.count('inside')} of {len(sizes)}. Not measured: {left}."
    )


def _published(each: EffectResult) -> str:
    size = "" if each.published is None else f"{each.published[0]:g} to {each.published[1]:g}"
    return ", ".join(part for part in (each.sign or "", size) if part)


def _write(out: Path, found: Sequence[EffectResult], user: str | None) -> None:
    rows = table(found)
    lines = [" | ".join(cells) for cells in (HEADER, ("-",) * len(HEADER), *rows)]
    title = f"Effects: {user or 'shipped users'}"
    text = "\n".join([f"# {title}", "", score(found), "", *(
        f"| {line} |" for line in lines
    )])  # fmt: skip
    write_atomically(out / "effects.md", (text + "\n").encode())
    html.save_page(out / "effects.html", title, score(found), [html.table(HEADER, rows)])
    told = [
        {**asdict(each), "sign_found": each.sign_found, "size_found": each.size_found}
        for each in found
    ]
    for row in told:
        row["value"] = None if row["note"] else row["value"]
    write_atomically(out / "effects.json", (json.dumps(told, indent=2) + "\n").encode())
