"""``sim2vr-harness render snapshot``: pictures of a game and of who plays it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sim2vr_harness.cli.app_options import (
    BrowserOption,
    MapOption,
    PageOption,
    TaskOption,
    app_settings,
)
from sim2vr_harness.cli.options import TrustOption, finite, writable_folder

__all__ = ["snapshot"]


def snapshot(
    game: Annotated[
        str | None, typer.Option(metavar="NAME", help="The game; without, the user's.")
    ] = None,
    condition: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="The game's condition; without, its default."),
    ] = None,
    out: Annotated[
        Path, typer.Option(help="Folder for the pictures.", callback=writable_folder)
    ] = Path("snapshot"),
    size: Annotated[str, typer.Option(help="WIDTHxHEIGHT of the pictures.")] = "640x480",
    seconds: Annotated[
        float, typer.Option(help="How many seconds to play first.", callback=finite)
    ] = 2.0,
    seed: Annotated[int, typer.Option(help="Seed of the round.")] = 1,
    run: Annotated[
        str | None, typer.Option(help="A trained user; without, the arm moves at random.")
    ] = None,
    page: PageOption = None,
    map_: MapOption = None,
    task: TaskOption = None,
    browser: BrowserOption = None,
    trust_app: TrustOption = False,
) -> None:
    """Write pictures of a game: headset view, third person and body.

    MuJoCo draws the body without a display; MUJOCO_GL=egl or osmesa chooses how.

    Examples:
        sim2vr-harness render snapshot --game beats --condition level
        sim2vr-harness render snapshot --page game.html --task task.yaml
    """
    from sim2vr_harness.evaluation import snapshot as pictures

    files = pictures.snapshot(
        out,
        game=game,
        condition=condition,
        size=pictures.parse_size(size),
        seconds=seconds,
        seed=seed,
        run=run,
        app=app_settings(page=page, mapped=map_, task=task, browser=browser),
        trust_app=trust_app,
    )
    for file in files:
        typer.echo(f"Written: {file}")
