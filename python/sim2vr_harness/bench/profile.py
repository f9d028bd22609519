"""``bench --profile``: where the time of a user step goes, alone and in a training."""

from __future__ import annotations

import cProfile
import io
import pstats
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from sim2vr_harness.bench.plan import Plan
from sim2vr_harness.bench.report import print_profile
from sim2vr_harness.bench.rows import Row, circumstances
from sim2vr_harness.bench.scenes import Scene, SceneName, Spec, open_scene
from sim2vr_harness.bench.stages import StageClock, timed_stages
from sim2vr_harness.bench.turns import TURNS

__all__ = ["profile"]

REST = "not in a stage"
APPS = "game and drawing"
_FUNCTIONS = 40

LIMITS = """\
How to read it. Timers stand around the functions that make up a stage and book its wall time, each
stage without the stages inside it. Physics and apps work on several threads while Python waits:
their wall time is how long it waits. 'cpu us' is the processor time of all threads meanwhile, which
other programs disturb less. 'drawing' is the difference between the apps' time with pictures and
that of a second run without; the two take turns, but on a busy machine it is the least certain
number here. A timer costs one or two microseconds per call, which is felt with few users only. The
lists of functions come from cProfile in a run of their own, which makes Python slower than it is;
they say which functions are called, not how much they cost in earnest.
"""


def profile(
    plan: Plan, file: Path, on_stage: Callable[[str], None] = lambda stage: None
) -> list[dict[str, Any]]:
    """Splits the time of the plan's scenes (``env``, ``train``) over their stages.

    The first of the plan's numbers of users and of threads counts.

    Args:
        plan: what to profile, and for how many seconds.
        file: gets the tables, the limits of the method and cProfile's lists.
        on_stage: told what is measured now.

    Returns:
        A JSON row per scene; ``extra`` holds ``stages_us`` and ``stages_cpu_us`` (wall time and
        processor time per user step in us, by stage) and ``not_timed`` (functions that could not
        be found).

    Raises:
        ValueError, RuntimeError: as :func:`~sim2vr_harness.bench.plan.run`.
    """
    common = circumstances(plan.config, plan.seconds, drawing=True)
    rows, lists = [], []
    usual: list[SceneName] = ["env", "train"]
    names = [name for name in usual if name in plan.scenes]
    for name in names:
        spec = Spec(name, plan.config, plan.n[0], plan.threads[0], train_steps=plan.train_steps)
        on_stage(f"{name}: setting up")
        rows.append(_split(spec, plan.seconds, on_stage))
        on_stage(f"{name}: functions")
        lists.append(f"{name}: functions by their own time (cProfile)\n{_functions(spec)}")
    found = [row.as_json(common) for row in rows]
    text = io.StringIO()
    print_profile(found, Console(file=text, width=100))
    file.write_text("\n".join([text.getvalue(), LIMITS, *lists]), encoding="utf-8")
    return found


def _split(spec: Spec, seconds: float, on_stage: Callable[[str], None]) -> Row:
    clock, blind_clock = StageClock(), StageClock()
    runs, blind_runs = [], []
    turns = TURNS if spec.scene == "env" else 1
    with _opened(spec) as scene, _opened(_blind(spec)) as blind:
        for turn in range(turns):
            on_stage(f"{spec.scene}: stages ({turn + 1} of {turns})")
            with timed_stages(clock) as missing:
                runs.append(_run(scene, seconds / turns, clock))
            with timed_stages(blind_clock):
                blind_runs.append(_run(blind, seconds / turns, blind_clock))
    totals = np.sum(runs, axis=0)
    steps, wall_s, cpu_s = totals.tolist()
    stages = _per_step(clock, totals[0])
    stages[REST] = 1e6 * totals[1:] / steps - sum(stages.values())
    apps_us = stages.pop(APPS, np.zeros(2))
    game_us = _per_step(blind_clock, np.sum(blind_runs, axis=0)[0]).get(APPS, np.zeros(2))
    game_us = np.minimum(apps_us, game_us)
    stages |= {"game": game_us, "drawing": apps_us - game_us}
    wall_us, stages_cpu_us = (
        {name: round(float(us[k]), 2) for name, us in _longest_first(stages)} for k in (0, 1)
    )
    return Row(
        f"profile-{spec.scene}",
        spec.transport,
        spec.n,
        spec.threads,
        rates=[steps / wall_s],
        cpu_us=[1e6 * cpu_s / steps],
        state_hash=scene.state_hash,
        extra={"stages_us": wall_us, "stages_cpu_us": stages_cpu_us, "not_timed": missing},
    )


def _per_step(clock: StageClock, steps: float) -> dict[str, NDArray[np.float64]]:
    """Wall and processor time of the stages in us per user step."""
    return {name: 1e6 * np.array(times) / steps for name, times in clock.times.items()}


def _longest_first(
    stages: Mapping[str, NDArray[np.float64]],
) -> list[tuple[str, NDArray[np.float64]]]:
    return sorted(stages.items(), key=lambda item: -item[1][0])


@contextmanager
def _opened(spec: Spec) -> Iterator[Scene]:
    with closing(open_scene(spec)) as scene:
        yield scene


def _blind(spec: Spec) -> Spec:
    config = spec.config
    app = config.env.app.model_copy(update={"renderer": "null"})
    env = config.env.model_copy(update={"app": app})
    # The learner's part does not matter: the apps' share is the same in the env.
    return replace(spec, scene="env", config=config.model_copy(update={"env": env}))


def _run(scene: Scene, seconds: float, clock: StageClock) -> tuple[float, float, float]:
    """Steps of all users, wall time and processor time, s, of a run; warms up before."""
    per_call = float(getattr(scene, "steps", scene.n))
    with clock.paused():
        scene.step()
    steps, began, cpu_began = 0.0, time.perf_counter(), time.process_time()
    while steps == 0.0 or time.perf_counter() - began < seconds:
        scene.step()
        steps += per_call
    return steps, time.perf_counter() - began, time.process_time() - cpu_began


def _functions(spec: Spec) -> str:
    """CProfile's list of one training iteration, or of some 50 env steps."""
    with _opened(spec) as scene:
        profiler = cProfile.Profile()
        profiler.enable()
        for _ in range(50 if spec.scene == "env" else 1):
            scene.step()
        profiler.disable()
    text = io.StringIO()
    pstats.Stats(profiler, stream=text).strip_dirs().sort_stats("tottime").print_stats(_FUNCTIONS)
    return text.getvalue()
