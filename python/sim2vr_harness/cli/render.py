"""``sim2vr-harness render`` and ``plot``: pictures of a game, films, learning curves."""

from dataclasses import dataclass
from pathlib import Path

import typer

from sim2vr_harness.base.requests import (
    ChangedEnvironment,
    OnePerson,
    TrustedApp,
    argument,
    option,
)
from sim2vr_harness.cli.app_options import PageOptions
from sim2vr_harness.cli.options import (
    AnyUser,
    print_written,
    who_plays,
)
from sim2vr_harness.cli.progress import Share


@dataclass(frozen=True, kw_only=True)
class FilmRequest(ChangedEnvironment, OnePerson, TrustedApp, PageOptions):
    """Which round to film."""

    runs: tuple[str, ...] = argument(
        "RUN...",
        "Runs, checkpoints, pretrained:NAME or scripts such as 'press lit', from left to right.",
        names="players",
    )
    game: str | None = option("The game.", metavar="NAME", shown="the user's", names="games")
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
        sim2vr-harness render film "press lit by ray" --page menu --person 3 --seconds 20
    """
    from sim2vr_harness.play.render import film_comparison

    with Share("Filming") as share:
        written = film_comparison(
            request.runs,
            request.out,
            game=request.game,
            app=request.remote(),
            condition=request.condition,
            person=request.person,
            seed=request.seed,
            seconds=request.seconds,
            overrides=request.overrides,
            trust_app=request.trust_app,
            on_progress=share.show,
        )
    typer.echo(f"Written: {written}")


@dataclass(frozen=True, kw_only=True)
class SnapshotRequest(AnyUser, ChangedEnvironment, OnePerson, TrustedApp, PageOptions):
    """What to picture."""

    game: str | None = option("The game.", metavar="NAME", shown="the user's", names="games")
    condition: str | None = option("The game's condition.", metavar="NAME", shown="its default")
    out: Path = option("Folder for the pictures.", Path("snapshot"), place="folder to write")
    size: str = option("WIDTHxHEIGHT of the pictures.", "640x480")
    seconds: float = option("How many seconds to play first.", 2.0)
    seed: int = option("Seed of the round.", 1)


def snapshot(request: SnapshotRequest) -> None:
    """Write pictures of a game: headset view, third person and body.

    MuJoCo draws the body without a display; MUJOCO_GL=egl or osmesa chooses how.

    Examples:
        sim2vr-harness render snapshot --game beats --condition level
        sim2vr-harness render snapshot --page game.html --user random
    """
    from sim2vr_harness.play import render as pictures

    remote = request.remote()
    run, baseline = who_plays(None, request.user)
    files = pictures.snapshot(
        request.out,
        game=request.game,
        condition=request.condition,
        size=pictures.parse_size(request.size),
        seconds=request.seconds,
        seed=request.seed,
        user=run or baseline or "still",
        person=request.person,
        app=remote,
        overrides=request.overrides,
        trust_app=request.trust_app,
    )
    print_written(files)


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
