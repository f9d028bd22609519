"""Which scenes are measured, with how many users and threads; and the run itself."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from sim2vr_harness.bench.memory import memory_rows
from sim2vr_harness.bench.processes import peak_memory_mb
from sim2vr_harness.bench.rows import Row, circumstances
from sim2vr_harness.bench.scenes import (
    DRAWING,
    SCENES,
    TRANSPORTS,
    Scene,
    SceneName,
    Spec,
    open_scene,
)
from sim2vr_harness.bench.turns import Turn, in_turns, paired_ratio
from sim2vr_harness.training.config import TrainingConfig
from sim2vr_harness.training.errors import InputError, unknown_name

__all__ = [
    "DEFAULT_N",
    "NAMES",
    "SCALING_N",
    "Kind",
    "Plan",
    "chosen_names",
    "run",
    "specs",
    "whole_numbers",
]

NAMES = (*SCENES, "targets", "memory")
"""What ``--scene`` takes; ``targets`` stands for several scenes, ``memory`` has no rate."""

DEFAULT_N = 64
SCALING_N = (1, 4, 16, 64, 256, 512)
MEMORY_N = (16, 144)
TARGETS = (0, 1, 3, 5, 9, 27)
CONDITIONS = ("easy", "medium", "hard")
EASIEST = f"condition={CONDITIONS[0]}"

Kind = Literal["usual", "scaling", "profile"]
_USUAL_SCENES: dict[Kind, tuple[str, ...]] = {
    "usual": SCENES,
    "scaling": ("physics", "env", "targets", "memory"),
    "profile": ("env", "train"),
}
_OVER_TRANSPORTS = ("game", "render", "env")


class Plan:
    """What to measure.

    Args:
        config: users, apps and learner.
        scenes: of :data:`NAMES`.
        n: numbers of users.
        threads: numbers of threads.
        transports: of TRANSPORTS, for the scenes that have apps.
        seconds: of measurement per scene.
        train_steps: user steps of a training iteration.

    Raises:
        InputError: a number out of range; names the option.
    """

    def __init__(
        self,
        config: TrainingConfig,
        scenes: Sequence[str],
        *,
        n: Sequence[int] = (DEFAULT_N,),
        threads: Sequence[int] | None = None,
        transports: Sequence[str] = ("in_process",),
        seconds: float = 2.0,
        train_steps: int = 1000,
    ) -> None:
        if not 0.0 < seconds < float("inf"):
            raise InputError("--seconds", str(seconds), "more than 0")
        if train_steps < 1:
            raise InputError("--train-steps", str(train_steps), "at least 1")
        self.config = config
        self.scenes = list(scenes)
        self.n, self.threads = list(n), list(threads or (config.env.threads or cores(),))
        self.transports = list(transports)
        self.seconds, self.train_steps = seconds, train_steps

    @classmethod
    def from_options(
        cls,
        config: TrainingConfig,
        kind: Kind,
        scene: Sequence[str] | None = None,
        n: str | None = None,
        threads: str | None = None,
        transport: Sequence[str] | None = None,
        *,
        seconds: float = 2.0,
        train_steps: int = 1000,
    ) -> Plan:
        """The plan that options of the command line mean; lists are written with commas.

        Raises:
            InputError: names the option, what was got and what was expected.
        """
        usual = _USUAL_SCENES[kind]
        names = chosen_names("--scene", scene, NAMES) or list(usual)
        if kind == "profile" and (others := set(names) - set(usual)):
            raise InputError("--scene", f"{min(others)!r} with --profile", " and ".join(usual))
        many = kind == "scaling"
        numbers = SCALING_N if many else (DEFAULT_N,)
        return cls(
            config,
            names,
            n=whole_numbers("--n", n) if n is not None else numbers,
            threads=(
                whole_numbers("--threads", threads)
                if threads is not None
                else doubling_threads()
                if many
                else None
            ),
            transports=chosen_names("--transport", transport, TRANSPORTS) or ["in_process"],
            seconds=seconds,
            train_steps=train_steps,
        )


def cores() -> int:
    """CPUs that this process may use."""
    return len(os.sched_getaffinity(0))


def doubling_threads() -> list[int]:
    """1, 2, 4, ... and the number of cores."""
    powers = [2**k for k in range(cores().bit_length()) if 2**k < cores()]
    return [*powers, cores()]


def chosen_names(option: str, given: Sequence[str] | None, known: Sequence[str]) -> list[str]:
    """The names of a list with commas, in the order of ``known``; ``all`` means each of them.

    Raises:
        InputError: an unknown name.
    """
    names = [name.strip() for part in given or () for name in part.split(",")]
    for name in names:
        if name not in ("all", *known):
            raise unknown_name(option, name, ["all", *known])
    return [name for name in known if name in names or "all" in names]


def whole_numbers(option: str, given: str) -> list[int]:
    """The numbers of a list with commas, each once.

    Raises:
        InputError: something else, or a number below 1.
    """
    numbers = []
    for part in given.split(","):
        try:
            numbers.append(int(part))
        except ValueError:
            raise InputError(
                option, repr(given), "whole numbers with commas, such as 16,64"
            ) from None
        if numbers[-1] < 1:
            raise InputError(option, part.strip(), "at least 1")
    return list(dict.fromkeys(numbers))


def specs(plan: Plan) -> list[Spec]:
    """The scenes to take turns, in order."""
    found: list[Spec] = []
    for n in plan.n:
        for threads in plan.threads:
            for name in plan.scenes:
                found += _specs(plan, name, n, threads)
    if "targets" in plan.scenes:  # once, however many numbers there are
        n = DEFAULT_N if DEFAULT_N in plan.n else plan.n[0]
        found += _target_specs(plan, n, max(plan.threads))
    # Scenes that do not depend on the threads are there once.
    return list({_name(spec): spec for spec in found}.values())


def _specs(plan: Plan, name: str, n: int, threads: int) -> list[Spec]:
    one: Any = {"config": plan.config, "n": n, "train_steps": plan.train_steps}
    if name in ("targets", "memory"):
        return []
    if name == "physics":
        return [Spec("physics", threads=threads, transport=None, **one)]
    if name == "reference-way":
        return [Spec("reference-way", threads=None, transport="protocol1", **one)]
    if name == "train":
        return [Spec("train", threads=threads, **one)]
    assert name in _OVER_TRANSPORTS
    return [
        Spec(name, threads=threads, transport=transport, **one)  # type: ignore[arg-type]
        for transport in TRANSPORTS
        if transport in plan.transports
    ]


def _target_specs(plan: Plan, n: int, threads: int) -> list[Spec]:
    """Whac-A-Mole with more and more targets: whole users, and apps with a fixed number."""
    if plan.config.env.app.game != "whacamole":
        game = plan.config.env.app.game
        raise InputError("--scene", f"'targets' with game {game!r}", "the game whacamole")
    found = []
    for condition in CONDITIONS:
        config = _with_options(plan.config, {"condition": condition})
        found.append(Spec("env", config, n, threads, variant=f"condition={condition}"))
    for count in TARGETS:
        config = _with_options(plan.config, _standing_targets(count))
        kinds: list[SceneName] = ["game", "render"]
        found += [Spec(kind, config, n, threads, variant=f"targets={count}") for kind in kinds]
    return found


def _standing_targets(count: int) -> dict[str, Any]:
    """Options of a round in which ``count`` targets appear at once and stay."""
    cells = [float(k % 9) for k in range(count)]  # more than nine share cells
    return {
        "condition": "medium",
        "life_seconds": 3600.0,
        "spawn_times": [0.0] * count or [1e9],  # no list at all would mean random targets
        "spawn_cells": cells or [0.0],
    }


def _with_options(config: TrainingConfig, options: Mapping[str, Any]) -> TrainingConfig:
    app = config.env.app.model_copy(update={"options": {**config.env.app.options, **options}})
    return config.model_copy(update={"env": config.env.model_copy(update={"app": app})})


def _name(spec: Spec) -> str:
    return Row(spec.scene, spec.transport, spec.n, spec.threads, spec.variant).name


def run(plan: Plan, on_stage: Callable[[str], None] = lambda stage: None) -> list[dict[str, Any]]:
    """Measures everything and returns the JSON rows.

    All scenes are set up first and then take turns.

    Args:
        plan: what to measure.
        on_stage: told what is going on.

    Raises:
        ValueError: settings that cannot be used.
        RuntimeError: an app cannot be started or failed, or equal users did not play alike.
    """
    chosen = specs(plan)
    drawing = any(spec.scene in DRAWING for spec in chosen)
    common = circumstances(plan.config, plan.seconds, drawing=drawing)
    rows: list[Row] = []
    if chosen:
        with ExitStack() as stack:
            scenes: dict[str, Scene] = {}
            for spec in chosen:
                on_stage(f"{_name(spec)}: setting up")
                scene = scenes[_name(spec)] = open_scene(spec)
                stack.callback(scene.close)
            found = in_turns(scenes, plan.seconds, on_stage=on_stage)
            rows = [_row(spec, scenes[_name(spec)], found[_name(spec)]) for spec in chosen]
    check_hashes(rows)
    rows = [replace(row, ratios=_ratios(row, rows)) for row in rows]
    if "memory" in plan.scenes:
        numbers = plan.n if len(plan.n) > 1 else MEMORY_N
        rows += memory_rows(plan.config, numbers, max(plan.threads), on_stage)
    return [row.as_json(common) for row in rows]


def _row(spec: Spec, scene: Scene, turns: list[Turn]) -> Row:
    return Row(
        scene=spec.scene,
        transport=spec.transport,
        n=spec.n,
        threads=spec.threads,
        variant=spec.variant,
        unit=scene.unit,
        rates=[turn.rate_per_s for turn in turns],
        cpu_us=[turn.cpu_us for turn in turns],
        state_hash=scene.state_hash,
        observation_hash=scene.observation_hash,
        parts={
            key: float(np.median([turn.parts[key] for turn in turns])) for key in turns[0].parts
        },
        memory_mb=peak_memory_mb(),
        extra=scene.extra(),
    )


def check_hashes(rows: Sequence[Row]) -> None:
    """Raises RuntimeError where users that must play alike did not.

    Those of one scene with the same N: neither threads nor transport may matter; the users of
    ``reference-way`` are those of ``env``.
    """
    seen: dict[tuple[str, int, str], Row] = {}
    for row in rows:
        if row.state_hash is None:
            continue
        scene = "env" if row.scene == "reference-way" else row.scene
        scene = "game" if row.scene == "render" else scene
        first = seen.setdefault((scene, row.n, row.variant), row)
        if first.state_hash != row.state_hash:
            raise RuntimeError(
                f"the same users played different rounds: state hash {first.state_hash} in "
                f"'{first.name}', {row.state_hash} in '{row.name}'"
            )


def _ratios(row: Row, rows: Sequence[Row]) -> dict[str, float]:
    """The row's rate divided by others' that it should be seen next to."""
    if row.scene != "env":
        return {}
    ratios = {}
    for other in rows:
        key = _compared_with(row, other)
        if key is not None:
            ratios[key] = paired_ratio(row.rates, other.rates)
            ratios[f"{key}, cpu"] = paired_ratio(other.cpu_us, row.cpu_us)
    return ratios


def _compared_with(row: Row, other: Row) -> str | None:
    """What the other row is to this one of an env, or None."""
    if other is row:
        return None
    alike = row.n == other.n and row.variant == other.variant == ""
    if other.scene == "physics":
        return "physics" if alike and row.threads == other.threads else None
    if other.scene == "reference-way":
        return "reference-way" if alike and row.transport == "in_process" else None
    if other.scene != "env":
        return None
    if row.variant:
        same = (row.n, row.threads, row.transport) == (other.n, other.threads, other.transport)
        return other.variant if same and other.variant == EASIEST else None
    if other.variant:
        return None
    if alike and row.threads == other.threads and other.transport == "in_process":
        return "in_process"
    if alike and row.transport == other.transport and other.threads == 1:
        return "1 thread"
    per_user = row.threads == other.threads and row.transport == other.transport
    return "N=16" if per_user and other.n == 16 else None
