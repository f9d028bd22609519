"""``sim2vr-harness plot curves``: learning curves of runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sim2vr_harness.cli.options import writable_file


def curves(
    runs: Annotated[
        list[str],
        typer.Argument(metavar="RUN...", help="Folders of runs, or packed users with curves."),
    ],
    out: Annotated[
        Path, typer.Option(help="The PNG or PDF file to write.", callback=writable_file)
    ] = Path("curves.png"),
) -> None:
    """Draw the learning curves of one or more runs.

    Examples:
        sim2vr-harness plot curves runs/sample
        sim2vr-harness plot curves runs/a runs/b --out curves.png
    """
    from sim2vr_harness.evaluation.curves import plot

    typer.echo(f"Written: {plot(runs, out)}")
