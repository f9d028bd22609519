"""A run: scenes take turns, rows that must play alike are compared, ratios are paired."""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from typing import Any

import numpy as np

from measure.memory import memory_rows
from measure.plan import BenchPlan, specs
from measure.processes import peak_memory_mb
from measure.rows import BenchRow, circumstances
from measure.scene import IN_PROCESS, BenchScene, Spec
from measure.scenes import open_scene
from measure.turns import Turn, in_turns, paired_ratio

MEMORY_N = (16, 144)


def run(
    plan: BenchPlan, on_stage: Callable[[str], None] = lambda stage: None
) -> list[dict[str, Any]]:
    """Measures everything and returns the JSON rows.

    All scenes are set up first and then take turns.

    Args:
        plan: what to measure.
        on_stage: called with what is going on.

    Raises:
        ValueError: settings that cannot be used.
        RuntimeError: an app cannot be started or failed, or equal users did not play alike.
    """
    chosen = specs(plan)
    drawing = any(spec.scene != "physics" for spec in chosen)
    common = circumstances(plan.config, plan.seconds, drawing=drawing)
    rows: list[BenchRow] = []
    with ExitStack() as stack:
        scenes: dict[str, BenchScene] = {}
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


def _name(spec: Spec) -> str:
    return BenchRow(spec.scene, spec.transport, spec.n, spec.threads, spec.variant).name


def _row(spec: Spec, scene: BenchScene, turns: list[Turn]) -> BenchRow:
    return BenchRow(
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


def check_hashes(rows: Sequence[BenchRow]) -> None:
    """Raises RuntimeError where users that must play alike did not.

    Those of one scene with the same N: neither threads nor transport may matter.
    """
    seen: dict[tuple[str, int, str], BenchRow] = {}
    for row in rows:
        if row.state_hash is None:
            continue
        first = seen.setdefault((row.scene, row.n, row.variant), row)
        if first.state_hash != row.state_hash:
            raise RuntimeError(
                f"the same users played different rounds: state hash {first.state_hash} in "
                f"'{first.name}', {row.state_hash} in '{row.name}'"
            )


def _ratios(row: BenchRow, rows: Sequence[BenchRow]) -> dict[str, float]:
    """The row's rate divided by others' that it should be seen next to."""
    ratios = {}
    for other in rows:
        key = _compared_with(row, other)
        if key is not None:
            ratios[key] = paired_ratio(row.rates, other.rates)
            ratios[f"{key}, cpu"] = paired_ratio(other.cpu_us, row.cpu_us)
    return ratios


def _compared_with(row: BenchRow, other: BenchRow) -> str | None:
    """What the other row is to this one of an env, or None."""
    if row.scene != "env" or other is row or row.n != other.n:
        return None
    if other.scene == "physics":
        variants = {"", row.variant} if row.variant.startswith("shards=") else {row.variant}
        same = row.threads == other.threads and other.variant in variants
        return "physics" if same else None
    if other.variant:
        return None
    if other.scene != "env":
        return None
    if row.variant:
        same = (row.threads, row.transport) == (other.threads, other.transport)
        return "without" if same else None
    if row.threads == other.threads and other.transport == IN_PROCESS:
        return IN_PROCESS
    return "1 thread" if row.transport == other.transport and other.threads == 1 else None
