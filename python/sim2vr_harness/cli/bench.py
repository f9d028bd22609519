"""``sim2vr-harness bench``: how fast this machine simulates, draws and learns."""

from __future__ import annotations

import json as jsonlib
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console

from sim2vr_harness.cli.options import (
    SetOption,
    TrustOption,
    finite,
    known_configs,
    writable_file,
)
from sim2vr_harness.cli.progress import say

if TYPE_CHECKING:
    from sim2vr_harness.runs.config import TrainingConfig

_Config = Annotated[
    str | None,
    typer.Argument(
        autocompletion=known_configs,
        metavar="CONFIG",
        help="What to measure.",
        show_default="Whac-A-Mole medium and the reference's user",
    ),
]
_Scene = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME",
        help="physics, render, env, train, senses, bodies, memory or all; may be repeated, or "
        "a list with commas.",
        show_default="physics,render,env,train",
    ),
]
_Threads = Annotated[
    str | None,
    typer.Option(
        metavar="LIST", help="Numbers of threads, such as 1,2.", show_default="one per core"
    ),
]
_Transport = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME",
        help="How render and env reach their apps: in_process, another transport "
        "(docs/reference/apps.md), or all.",
        show_default="in_process",
    ),
]
_TrainSteps = Annotated[
    int, typer.Option(help="User steps of a measured training iteration, at least.")
]
_Output = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Add the JSON rows to this file.", callback=writable_file),
]
_Profile = Annotated[
    bool,
    typer.Option(
        "--profile", help="With --scene train: each stage of the recipe for a short time."
    ),
]
_Json = Annotated[bool, typer.Option("--json", help="Print JSON rows, one per line, nothing else.")]


def bench(
    config: _Config = None,
    set_: SetOption = None,
    scene: _Scene = None,
    n: Annotated[str, typer.Option(metavar="LIST", help="Numbers of users, such as 16,64.")] = "64",
    threads: _Threads = None,
    transport: _Transport = None,
    seconds: Annotated[float, typer.Option(help="Seconds per scene.", callback=finite)] = 2.0,
    train_steps: _TrainSteps = 1000,
    output: _Output = None,
    profile: _Profile = False,
    trust_app: TrustOption = False,
    json: _Json = False,
) -> None:
    """Measure how fast this machine simulates, draws and learns.

    Examples:
        sim2vr-harness bench
        sim2vr-harness bench --scene physics,env --n 1,16,64
    """
    from sim2vr_harness.bench.plan import BenchPlan
    from sim2vr_harness.bench.run import run as measure
    from sim2vr_harness.runs.config import defaults, load_config
    from sim2vr_harness.runs.trust import named_app, require_trust

    settings = load_config(config, set_ or []) if config else defaults(set_ or [])
    require_trust(
        settings.env, Path(config or "the defaults"), named=named_app(set_ or []), trust=trust_app
    )
    if profile:
        return _print_profile(settings, scene)
    amounts = {"n": n, "threads": threads, "seconds": seconds, "train_steps": train_steps}
    plan = BenchPlan(settings, scene, transport=transport, **amounts)  # type: ignore[arg-type]
    rows = measure(plan, lambda stage: say(f"Measuring {stage}"))
    _report(rows, output, json=json)


def _report(rows: list[dict[str, Any]], output: Path | None, *, json: bool) -> None:
    """Print what was measured, and add it to a file."""
    from sim2vr_harness.bench.report import print_rows
    from sim2vr_harness.bench.rows import append_rows

    if output is not None:
        append_rows(output, rows)
    if json:
        sys.stdout.writelines(jsonlib.dumps(row) + "\n" for row in rows)
        return
    print_rows(rows, Console())
    if output is not None:
        typer.echo(f"Written: {output}")


def _print_profile(settings: TrainingConfig, scene: list[str] | None) -> None:
    """Train the recipe for a short time, and print where the time goes."""
    from sim2vr_harness.base.errors import InputError
    from sim2vr_harness.bench.profile import profile_lines

    if scene != ["train"]:
        raise InputError("--profile", f"scenes {','.join(scene or ['(default)'])}", "--scene train")
    say("Measuring the stages of the recipe, shortened")
    typer.echo("\n".join(profile_lines(settings)))
