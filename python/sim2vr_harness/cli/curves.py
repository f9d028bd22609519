"""``sim2vr-harness plot curves``: learning curves of runs."""

from dataclasses import dataclass
from pathlib import Path

import typer

from sim2vr_harness.base.requests import argument, option


@dataclass(frozen=True, kw_only=True)
class CurvesRequest:
    """What to draw."""

    runs: tuple[str, ...] = argument("RUN...", "Folders of runs, or packed users with curves.")
    out: Path = option("The PNG or PDF file to write.", Path("curves.png"), place="file to write")


def curves(request: CurvesRequest) -> None:
    """Draw the learning curves of one or more runs.

    Examples:
        sim2vr-harness plot curves runs/sample
        sim2vr-harness plot curves runs/a runs/b --out curves.png
    """
    from sim2vr_harness.evaluation.curves import plot

    typer.echo(f"Written: {plot(request.runs, request.out)}")
