"""``sim2vr-harness render film``: users compared."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sim2vr_harness.cli.options import (
    TrustOption,
    finite,
    known_users,
    writable_file,
)
from sim2vr_harness.cli.progress import Share


def film(
    runs: Annotated[
        list[str],
        typer.Argument(
            autocompletion=known_users,
            metavar="RUN...",
            help="Runs, checkpoints or pretrained:NAME, from left to right.",
        ),
    ],
    condition: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="The game's condition.",
            show_default="that of each user's training",
        ),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of the round, the same for all.")] = 1,
    seconds: Annotated[
        float, typer.Option(help="How many seconds to film at most.", callback=finite)
    ] = 60.0,
    out: Annotated[
        Path, typer.Option(metavar="OUT.mp4", help="The film.", callback=writable_file)
    ] = Path("film.mp4"),
    trust_app: TrustOption = False,
) -> None:
    """Film a comparison video of users who play the same round.

    Examples:
        sim2vr-harness render film whacamole_constrained whacamole_people
        sim2vr-harness render film runs/a runs/b --seconds 20 --out ab.mp4
    """
    from sim2vr_harness.play.render import film_comparison

    # fmt: off
    with Share("Filming") as share:
        written = film_comparison(
            runs, out, condition=condition, seed=seed, seconds=seconds, trust_app=trust_app,
            on_progress=share.show,
        )
    # fmt: on
    typer.echo(f"Written: {written}")
