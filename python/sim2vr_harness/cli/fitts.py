"""``sim2vr-harness fitts``: Fitts' law from the logs of the game ``pointing``."""

from __future__ import annotations

import json as jsonlib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table

from sim2vr_harness.cli.options import writable_file

if TYPE_CHECKING:
    from sim2vr_harness.evaluation.fitts import FittsResult

__all__ = ["fitts"]


def fitts(
    folders: Annotated[
        list[Path],
        typer.Argument(
            metavar="FOLDER...", help="Each is one user's or person's: rounds of pointing below it."
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.png",
            help="Draw movement time over index of difficulty into this file.",
            callback=writable_file,
        ),
    ] = None,
    json: Annotated[
        bool, typer.Option("--json", help="Print the numbers as JSON, nothing else.")
    ] = False,
) -> None:
    """Measure aimed movements: Fitts' law, throughput, endpoint spread, submovements."""
    from sim2vr_harness.evaluation.fitts.law import measure_user, rounds_below
    from sim2vr_harness.evaluation.fitts.picture import draw_fitts

    users = [measure_user(rounds_below(folder), folder.name) for folder in folders]
    if out is not None:
        draw_fitts(users, out)
    if json:
        typer.echo(jsonlib.dumps([user.as_dict() for user in users], indent=2))
        return
    for user in users:
        _show(user)
    if out is not None:
        typer.echo(f"Written: {out}")


def _show(user: FittsResult) -> None:
    headings = ("D (cm)", "W (cm)", "ID (bits)", "MT (s)", "SD (mm)", "errors")
    table = Table(*headings, "TP (bits/s)", "submovements", title=f"{user.name}")
    for one in user.difficulties:
        pieces = "" if one.submovements is None else f"{one.submovements:.2f}"
        table.add_row(
            f"{100 * one.distance_m:.3g}",
            f"{100 * one.width_m:.3g}",
            f"{one.bits:.2f}",
            f"{one.movement_time_s:.3f}",
            f"{1000 * one.spread_m:.1f}",
            f"{one.error_rate:.3f}",
            f"{one.throughput_bps:.2f}",
            pieces,
        )
    Console().print(table)
    typer.echo(f"{user.rounds} rounds, {user.targets} targets, {user.timeouts} time-outs")
    typer.echo(f"throughput {user.throughput_bps:.2f} bits/s, errors {user.error_rate:.3f}")
    for name, line in (("nominal", user.line), ("effective", user.effective_line)):
        if line is not None:
            typer.echo(
                f"{name}: MT = {line.a_s:.3f} s + {line.b_s_per_bit:.3f} s/bit * ID, "
                f"R2 = {line.r2:.3f}, {line.points} indices"
            )
