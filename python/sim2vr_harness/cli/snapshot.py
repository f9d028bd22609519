"""``sim2vr-harness render snapshot``: pictures of a game and of who plays it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from sim2vr_harness.cli.app_options import with_page_options
from sim2vr_harness.cli.options import (
    EnvSetOption,
    TrustOption,
    UserOption,
    finite,
    game_option,
    print_written,
    who_plays,
    writable_folder,
)

_Condition = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="The game's condition.", show_default="its default"),
]
_Out = Annotated[Path, typer.Option(help="Folder for the pictures.", callback=writable_folder)]


@with_page_options
def snapshot(
    game: Annotated[
        str | None,
        game_option("The game.", "the user's"),
    ] = None,
    condition: _Condition = None,
    out: _Out = Path("snapshot"),
    size: Annotated[str, typer.Option(help="WIDTHxHEIGHT of the pictures.")] = "640x480",
    seconds: Annotated[
        float, typer.Option(help="How many seconds to play first.", callback=finite)
    ] = 2.0,
    seed: Annotated[int, typer.Option(help="Seed of the round.")] = 1,
    user: UserOption = None,
    overrides: EnvSetOption = None,
    trust_app: TrustOption = False,
    *,
    remote: dict[str, Any],
) -> None:
    """Write pictures of a game: headset view, third person and body.

    MuJoCo draws the body without a display; MUJOCO_GL=egl or osmesa chooses how.

    Examples:
        sim2vr-harness render snapshot --game beats --condition level
        sim2vr-harness render snapshot --page game.html --user random
    """
    from sim2vr_harness.play import render as pictures

    run, baseline = who_plays(None, user)
    files = pictures.snapshot(
        out,
        game=game,
        condition=condition,
        size=pictures.parse_size(size),
        seconds=seconds,
        seed=seed,
        user=run or baseline or "still",
        app=remote,
        overrides=overrides or (),
        trust_app=trust_app,
    )
    print_written(files)
