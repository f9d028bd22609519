"""``sim2vr-harness plot measures``: measures of several users as bars."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sim2vr_harness.cli.options import writable_file


def chart(
    results: Annotated[
        list[str],
        typer.Argument(
            metavar="RESULTS...",
            help="Folders of evaluations (evaluate --out), or files with what --json printed.",
        ),
    ],
    condition: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="The condition.", show_default="the only one"),
    ] = None,
    measure: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="A measure, such as hand_travel_m, or exertion: effort before its weight; may be "
            "repeated.",
            show_default="the game's headlines and exertion",
        ),
    ] = None,
    out: Annotated[
        Path, typer.Option(help="The PNG or PDF file to write.", callback=writable_file)
    ] = Path("chart.png"),
) -> None:
    """Draw the measures of several evaluations as bars.

    Examples:
        sim2vr-harness plot measures evaluation/a evaluation/b --condition easy
        sim2vr-harness plot measures a.json b.json --measure effort --out effort.png
    """
    from sim2vr_harness.evaluation.bar_chart import chart as draw

    typer.echo(f"Written: {draw(results, out, condition=condition, measures=measure or ())}")
