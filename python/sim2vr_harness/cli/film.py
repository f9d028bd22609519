"""``sim2vr-harness render film``: users compared."""

from dataclasses import dataclass
from pathlib import Path

import typer

from sim2vr_harness.base.requests import argument, option
from sim2vr_harness.cli.options import ChangedEnvironment, TrustedApp
from sim2vr_harness.cli.progress import Share


@dataclass(frozen=True, kw_only=True)
class FilmRequest(ChangedEnvironment, TrustedApp):
    """Which round to film."""

    runs: tuple[str, ...] = argument(
        "RUN...",
        "Runs, checkpoints, pretrained:NAME or scripts such as 'press lit', from left to right.",
        names="players",
    )
    condition: str | None = option(
        "The game's condition.", metavar="NAME", shown="that of each user's training"
    )
    seed: int = option("Seed of the round, the same for all.", 1)
    seconds: float = option("How many seconds to film at most.", 60.0)
    out: Path = option("The film.", Path("film.mp4"), metavar="OUT.mp4", place="file to write")


def film(request: FilmRequest) -> None:
    """Film a comparison video of users who play the same round.

    Examples:
        sim2vr-harness render film whacamole_constrained whacamole_people
        sim2vr-harness render film runs/a runs/b --seconds 20 --out ab.mp4
    """
    from sim2vr_harness.play.render import film_comparison

    with Share("Filming") as share:
        written = film_comparison(
            request.runs,
            request.out,
            condition=request.condition,
            seed=request.seed,
            seconds=request.seconds,
            overrides=request.set_,
            trust_app=request.trust_app,
            on_progress=share.show,
        )
    typer.echo(f"Written: {written}")
