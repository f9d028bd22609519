"""Measures how fast this machine simulates, draws and learns.

Run: python tools/bench/bench.py --scene physics,env --n 1,16,64
"""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from measure.plan import BenchPlan
from measure.profile import profile_lines
from measure.report import print_rows
from measure.rows import append_rows
from measure.run import run
from sim2vr_harness.base.errors import InputError
from sim2vr_harness.runs.config import defaults, load_config
from sim2vr_harness.runs.trust import named_app, require_trust


def _options() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description="Measure simulation, drawing and learning.")
    parser.add_argument("config", nargs="?", help="default: Whac-A-Mole medium, reference user")
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="change a setting"
    )
    parser.add_argument(
        "--scene",
        action="append",
        metavar="NAME",
        help="physics, render, env, train, scaling, senses, bodies, memory or all; repeated or "
        "with commas",
    )
    parser.add_argument("--n", default="64", metavar="LIST", help="numbers of users: 16,64")
    parser.add_argument("--threads", metavar="LIST", help="numbers of threads; default: cores")
    parser.add_argument(
        "--transport", action="append", metavar="NAME", help="of render and env; or all"
    )
    parser.add_argument("--seconds", type=float, default=2.0, help="per scene")
    parser.add_argument(
        "--train-steps", type=int, default=1000, help="user steps of a training iteration"
    )
    parser.add_argument("--output", type=Path, metavar="FILE", help="add the JSON rows to a file")
    parser.add_argument(
        "--profile", action="store_true", help="with --scene train: the stages of the recipe"
    )
    parser.add_argument("--trust-app", action="store_true", help="run the configuration's app")
    parser.add_argument("--json", action="store_true", help="print JSON rows, nothing else")
    return parser


def _measure(options: argparse.Namespace) -> None:
    name, overrides = options.config, options.set
    config = load_config(name, overrides) if name else defaults(overrides)
    source = Path(name or "the defaults")
    require_trust(config.env, source, named=named_app(overrides), trust=options.trust_app)
    if options.profile:
        if options.scene != ["train"]:
            scenes = ",".join(options.scene or ["(default)"])
            raise InputError("--profile", f"scenes {scenes}", "--scene train")
        print("\n".join(profile_lines(config)))
        return
    if options.output is not None and options.output.is_dir():
        raise InputError("--output", f"{str(options.output)!r}, which is a folder", "a file")
    plan = BenchPlan(
        config,
        options.scene,
        n=options.n,
        threads=options.threads,
        transport=options.transport,
        seconds=options.seconds,
        train_steps=options.train_steps,
    )
    rows = run(plan, lambda stage: print(f"Measuring {stage}", file=sys.stderr))
    if options.output is not None:
        append_rows(options.output, rows)
    if options.json:
        print("\n".join(json.dumps(row) for row in rows))
        return
    print_rows(rows, Console())
    if options.output is not None:
        print(f"Written: {options.output}")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; return its exit status."""
    try:
        _measure(_options().parse_args(arguments))
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
