"""``sim2vr-harness replay``: recorded rounds, played again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from sim2vr_harness.cli.options import (
    JsonOption,
    finite,
    print_json,
    writable_file,
    writable_folder,
)
from sim2vr_harness.cli.progress import Share

__all__ = ["replay"]


_Paths = Annotated[
    list[Path],
    typer.Argument(
        metavar="PATH...",
        help="Recorded rounds: folders with states.csv and events.csv, packed .npz rounds with "
        "their manifest.json, or folders above such.",
    ),
]
_Closed = Annotated[
    bool, typer.Option("--closed", help="Seed and poses only: spawns are predicted as well.")
]
_Unconstrained = Annotated[
    bool,
    typer.Option("--unconstrained", help="Every touch was a hit, though the logs do not say."),
]
_FixedStep = Annotated[
    float | None,
    typer.Option(
        help="Period of the recording's fixed steps, s.",
        show_default="worked out",
        callback=finite,
    ),
]
_Log = Annotated[
    Path | None,
    typer.Option(
        help="Keep the replayed rounds' own logs in this folder.", callback=writable_folder
    ),
]
_Video = Annotated[
    Path | None,
    typer.Option(
        metavar="OUT.mp4",
        help="Film the player's view and the game from outside.",
        callback=writable_file,
    ),
]
_Fps = Annotated[float, typer.Option(help="Pictures per second of the film.", callback=finite)]


def replay(
    paths: _Paths,
    closed: _Closed = False,
    unconstrained: _Unconstrained = False,
    fixed_step: _FixedStep = None,
    log: _Log = None,
    video: _Video = None,
    size: Annotated[str, typer.Option(help="WIDTHxHEIGHT of each view in the film.")] = "640x480",
    fps: _Fps = 30.0,
    json: JsonOption = False,
) -> None:
    """Replay recorded rounds and compare every event with the record.

    Examples:
        sim2vr-harness replay recordings/person_1
        sim2vr-harness replay recordings --video replay.mp4
    """
    from sim2vr_harness.base.errors import InputError
    from sim2vr_harness.evaluation.replay.film import ReplayFilm
    from sim2vr_harness.evaluation.replay.recordings import read_recordings
    from sim2vr_harness.evaluation.replay.replayer import Replay, replay_all
    from sim2vr_harness.evaluation.replay.report import ReplayReport
    from sim2vr_harness.evaluation.snapshot import parse_size

    if fixed_step is not None and not 1e-4 <= fixed_step <= 1.0:
        raise InputError("--fixed-step", f"{fixed_step:g}", "a period from 0.0001 to 1 s")
    recordings = read_recordings(paths, unconstrained=unconstrained)
    replays: list[Replay] = []
    with Share("Replaying") as share:
        film = None
        if video is not None:
            film = ReplayFilm(
                video,
                parse_size(size, (4096, 4096)),
                fps,
                on_progress=lambda part: share.show((len(replays) + part) / len(recordings)),
            )
        share.show(0.0)
        for done in replay_all(
            recordings, closed_loop=closed, fixed_step_s=fixed_step, log_dir=log, film=film
        ):
            replays.append(done)
            share.show(len(replays) / len(recordings))
    found = ReplayReport(replays)
    if json:
        print_json(found.as_json())
        return
    found.print(Console())
    for file in film.files if film else []:
        typer.echo(f"Written: {file}")
