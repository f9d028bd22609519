"""``sim2vr-harness replay``: recorded rounds, played again."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from rich.console import Console

from sim2vr_harness.base.errors import InputError, counted, printable
from sim2vr_harness.base.requests import argument, option
from sim2vr_harness.cli.app_options import AppOptions
from sim2vr_harness.cli.options import JsonOutput, print_json
from sim2vr_harness.cli.progress import Share

_MOST_VALUES = 12

if TYPE_CHECKING:
    from sim2vr_harness.evaluation.replay.film import ReplayFilm
    from sim2vr_harness.sessions.replay import SessionReplay


@dataclass(frozen=True, kw_only=True)
class ReplayRequest(JsonOutput, AppOptions):
    """What to replay, and how."""

    paths: tuple[Path, ...] = argument(
        "PATH...",
        "Sessions in any format; or rounds of Whac-A-Mole: folders with states.csv and "
        "events.csv, packed .npz rounds with their manifest.json, or folders above such.",
    )
    closed: bool = option("Seed and poses only: spawns are predicted as well.", False)
    unconstrained: bool = option("Every touch was a hit, though the logs do not say.", False)
    fixed_step: float | None = option(
        "Period of the recording's fixed steps, s.", shown="worked out"
    )
    log: Path | None = option(
        "Keep the replayed rounds' own logs in this folder.", place="folder to write"
    )
    video: Path | None = option(
        "Film the player's view, and a game from outside.",
        metavar="OUT.mp4",
        place="file to write",
    )
    size: str = option("WIDTHxHEIGHT of each view in the film.", "640x480")
    fps: float = option("Pictures per second of the film.", 30.0)
    game: str | None = option(
        "Replay sessions in this game.", metavar="NAME", shown="the session's", names="games"
    )
    strict: bool = option("Exit with status 1 unless every event of a session came again.", False)


def replay(request: ReplayRequest) -> int:
    """Replay recorded rounds and compare every event with the record.

    With --game, --page or --app, or with sessions in files: any app, the recorded devices under
    virtual time, its values, its events and the first difference with a likely cause.

    Examples:
        sim2vr-harness replay recordings/person_1 --video replay.mp4
        sim2vr-harness replay round.jsonl --page game.html --task task.yaml
    """
    from sim2vr_harness.sessions.formats import is_session

    remote, paths, video = request.remote(), request.paths, request.video
    film = None if video is None else _film(video, request.size, request.fps)
    if request.game is not None or remote or all(map(is_session, paths)):
        status = _replay_sessions(request, remote, film)
    elif request.strict:
        raise InputError("--strict", "it with rounds of Whac-A-Mole", "sessions")
    else:
        _replay_rounds(request, film)
        status = 0
    for file in film.files if film is not None and not request.json else []:
        typer.echo(f"Written: {file}")
    return status


def _film(video: Path, size: str, fps: float) -> ReplayFilm:
    from sim2vr_harness.evaluation.replay.film import ReplayFilm
    from sim2vr_harness.evaluation.snapshot import parse_size

    return ReplayFilm(video, parse_size(size, (4096, 4096)), fps)


def _replay_rounds(request: ReplayRequest, film: ReplayFilm | None) -> None:
    """Replay rounds of Whac-A-Mole, whose spawns, outcomes and speeds are compared."""
    from sim2vr_harness.evaluation.replay.recordings import read_recordings
    from sim2vr_harness.evaluation.replay.replayer import Replay, replay_all
    from sim2vr_harness.evaluation.replay.report import ReplayReport

    fixed_step = request.fixed_step
    if fixed_step is not None and not 1e-4 <= fixed_step <= 1.0:
        raise InputError("--fixed-step", f"{fixed_step:g}", "a period from 0.0001 to 1 s")
    recordings = read_recordings(request.paths, unconstrained=request.unconstrained)
    replays: list[Replay] = []
    with Share("Replaying") as share:
        if film is not None:
            film.progress = lambda part: share.show((len(replays) + part) / len(recordings))
        share.show(0.0)
        for done in replay_all(
            recordings,
            closed_loop=request.closed,
            fixed_step_s=fixed_step,
            log_dir=request.log,
            film=film,
        ):
            replays.append(done)
            share.show(len(replays) / len(recordings))
    found = ReplayReport(replays)
    if request.json:
        print_json(found.as_json())
    else:
        found.print(Console())


def _replay_sessions(
    request: ReplayRequest, remote: dict[str, Any], film: ReplayFilm | None
) -> int:
    """Replay sessions in an app; 1 with ``strict`` if it did not do the same."""
    from sim2vr_harness.cli.session import read_any
    from sim2vr_harness.sessions import write_session
    from sim2vr_harness.sessions.replay import replay_session

    for option_, given in (
        ("--closed", request.closed),
        ("--unconstrained", request.unconstrained),
        ("--fixed-step", request.fixed_step is not None),
    ):
        if given:
            raise InputError(option_, "it with a session", "it with rounds of Whac-A-Mole")
    game = request.game
    done: dict[str, SessionReplay] = {}
    for path in request.paths:
        session = read_any(path)
        for note in session.notes:
            typer.echo(printable(f"note: {path.name}: {note}"), err=True)
        kept = None if request.log is None else request.log / path.name
        with Share(f"Replaying {path.name}") as share, ExitStack() as stack:
            shown: dict[str, Any] = {}
            if film is not None:
                name = path.name.split(".")[0]
                played = game or str(remote.get("game") or session.app.name)
                round_film = film.round(session, name, played, only=len(request.paths) == 1)
                watch = stack.enter_context(round_film).watch
                shown = {"renderer": "automatic", "size": film.size, "watch": watch}
            done[str(path)] = replay_session(
                session, game=game, app=remote, log_dir=kept, on_progress=share.show, **shown
            )
        if kept is not None:
            write_session(done[str(path)].session, kept / "replay.jsonl")
    if request.json:
        print_json({"sessions": {name: _as_json(each) for name, each in done.items()}})
    else:
        for name, each in done.items():
            lines = [f"{Path(name).name}: {_summary(each)}", *_lines(each)]
            typer.echo("\n".join(map(printable, lines)))
    return int(request.strict and not all(each.comparison.same for each in done.values()))


def _as_json(replayed: SessionReplay) -> dict[str, Any]:
    found = replayed.comparison
    return {
        "app": vars(replayed.session.app),
        "frames": replayed.frames,
        "finished": replayed.finished,
        "values": dict(replayed.values),
        "recorded": found.recorded,
        "again": found.again,
        "same_frame": found.same_frame,
        "extra": found.extra,
        "same": found.same,
        "kinds": {kind: vars(counts) for kind, counts in found.kinds.items()},
        "first_difference": None if found.first is None else vars(found.first),
    }


def _summary(replayed: SessionReplay) -> str:
    app = replayed.session.app
    end = "the round ended" if replayed.finished else "the round had not ended"
    return f"{counted(replayed.frames, 'frame')} in {app.name or app.kind}; {end}"


def _values(replayed: SessionReplay) -> dict[str, float]:
    """The measures that a game publishes; all of an app that publishes none."""
    from sim2vr_harness.client import describe_game

    app, values = replayed.session.app, replayed.values
    if app.kind != "game":
        return dict(values)
    keys = [each.log_key for each in describe_game(app.name).measures]
    return {key: values[key] for key in keys if key in values}


def _lines(replayed: SessionReplay) -> list[str]:
    found = replayed.comparison
    shown = list(_values(replayed).items())
    values = ", ".join(f"{name} {value:.6g}" for name, value in shown[:_MOST_VALUES])
    more = f", and {len(shown) - _MOST_VALUES} more" if len(shown) > _MOST_VALUES else ""
    lines = [f"  values: {values}{more}" if shown else "  values: none; --task names some"]
    if not found.recorded:
        return [*lines, "  the session has no events to compare with"]
    for kind, counts in found.kinds.items():
        again = f"{counts.recorded} recorded, {counts.replayed} replayed, {counts.again} the same"
        lines.append(f"  {kind}: {again}")
    lines.append(
        f"  {found.again} of {counted(found.recorded, 'recorded event')} came again, "
        f"{found.same_frame} in the same frame; {found.extra} came that were not recorded"
    )
    if found.first is None:
        return [*lines, "  no difference"]
    return [
        *lines,
        f"  first difference at {found.first.time_s:.3f} s: {found.first.text}",
        f"  likely cause: {found.first.cause}",
    ]
