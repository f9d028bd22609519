"""``sim2vr-harness render snapshot``: pictures of a game and of who plays it."""

from dataclasses import dataclass
from pathlib import Path

from sim2vr_harness.base.requests import option
from sim2vr_harness.cli.app_options import PageOptions
from sim2vr_harness.cli.options import (
    AnyUser,
    ChangedEnvironment,
    TrustedApp,
    print_written,
    who_plays,
)


@dataclass(frozen=True, kw_only=True)
class SnapshotRequest(AnyUser, ChangedEnvironment, TrustedApp, PageOptions):
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
        app=remote,
        overrides=request.set_,
        trust_app=request.trust_app,
    )
    print_written(files)
