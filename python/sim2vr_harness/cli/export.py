"""``sim2vr-harness export``: an evaluation's steps for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sim2vr_harness.cli.options import writable_folder

__all__ = ["export"]


def export(
    folder: Annotated[
        Path, typer.Argument(metavar="FOLDER", help="Of an evaluation that kept its steps.")
    ],
    episode: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY", help="A key of the table episodes; may be repeated.", show_default="all"
        ),
    ] = None,
    out: Annotated[
        Path, typer.Option(help="Folder for the files.", callback=writable_folder)
    ] = Path("opensim"),
) -> None:
    """Write joint angles, activations and forces for OpenSim.

    Angles go to .mot files, activations and forces to .sto files.

    Examples:
        sim2vr-harness export runs/sample/evaluation/step_1000000
        sim2vr-harness export evaluation/sample --out opensim/sample
    """
    from sim2vr_harness.evaluation.data import export_opensim, read_data

    for file in export_opensim(read_data(folder), out, episode or ()):
        typer.echo(f"Written: {file}")
