"""``sim2vr-harness replay``: recorded rounds, played again."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer
from rich import box
from rich.console import Console
from rich.table import Table

from sim2vr_harness.base.errors import InputError, counted, printable
from sim2vr_harness.base.files import file_name
from sim2vr_harness.base.requests import argument, option
from sim2vr_harness.cli.app_options import AppOptions
from sim2vr_harness.cli.options import JsonOutput, print_json
from sim2vr_harness.cli.progress import Share

if TYPE_CHECKING:
    from sim2vr_harness.play.film import ReplayFilm
    from sim2vr_harness.sessions import Session
    from sim2vr_harness.sessions.agreement import Agreement
    from sim2vr_harness.sessions.replay import SessionReplay

_MOST_VALUES = 12
_THREADS = 2
_EVENTS = (
    "Targets",
    "Same\noutcome",
    "Hits\nrec/pred",
    "Misses\nrec/pred",
    "Contacts\nrec/pred",
    "First\ndifference",
)
_TIMES = (
    "Hit recall\n50/100 ms",
    "Precision\n50/100 ms",
    "Same\nstep",
    "|dt|\nms",
    "|dv| m/s\nmedian/p95",
)


@dataclass(frozen=True, kw_only=True)
class ReplayRequest(JsonOutput, AppOptions):
    """What to replay, and how."""

    paths: tuple[Path, ...] = argument(
        "PATH...",
        "Sessions in any format; or rounds of Whac-A-Mole: folders with states.csv and "
        "events.csv, packed .npz rounds with their manifest.json, or folders above such.",
    )
    closed: bool = option("Seed and poses only: spawns are predicted as well.", False)
    unconstrained: bool = option("Count every touch as a hit (no speed rule).", False)
    fixed_step: float | None = option(
        "Period of the recording's fixed steps, s.", shown="estimated"
    )
    log: Path | None = option(
        "Keep the replayed rounds' own logs in this folder.", place="folder to write"
    )
    video: Path | None = option(
        "Film the player's view, of games also the view from outside.",
        metavar="OUT.mp4",
        place="file to write",
    )
    size: str = option("WIDTHxHEIGHT of each view in the film.", "640x480")
    fps: float = option("Pictures per second of the film.", 30.0)
    game: str | None = option(
        "Replay sessions in this game.", metavar="NAME", shown="the session's", names="games"
    )
    strict: bool = option("Exit with status 1 unless the replay repeats every event.", False)


def replay(request: ReplayRequest) -> int:
    """Replay recorded rounds and compare every event with the record.

    A session is replayed in its game or in the app of --game, --page, --openxr or --app. The output
    compares values and events, and names the first difference with a likely cause.

    Examples:
        sim2vr-harness replay recordings/person_1 --video replay.mp4
        sim2vr-harness replay round.jsonl --page game.html --task task.yaml
    """
    from sim2vr_harness.play.film import ReplayFilm
    from sim2vr_harness.play.render import parse_size
    from sim2vr_harness.sessions import read_sessions
    from sim2vr_harness.sessions.agreement import agreement_of, rounds_json
    from sim2vr_harness.sessions.logs import WHACAMOLE
    from sim2vr_harness.sessions.whacamole import is_recorded_round, without_constraint

    remote, video, game = request.remote(), request.video, request.game
    film = None
    if video is not None:
        film = ReplayFilm(video, parse_size(request.size, (4096, 4096)), request.fps)
    sessions = [each for path in request.paths for each in read_sessions(path)]
    for each in sessions:
        if each.source == "log" and not (each.app.name or game or remote):
            events = file_name((each.folder or Path()) / "events.csv")
            raise InputError(events, "no event that tells its game", "such events; or --game NAME")
    own = not remote and game in (None, WHACAMOLE)
    rounds = [own and is_recorded_round(each) for each in sessions]
    given = {
        "--closed": request.closed,
        "--unconstrained": request.unconstrained,
        "--fixed-step": request.fixed_step,
    }
    for name, value in given.items():
        if value not in (False, None) and not any(rounds):
            raise InputError(name, "it with a session", "it with rounds of Whac-A-Mole")
    fixed_step = request.fixed_step
    if fixed_step is not None and not 1e-4 <= fixed_step <= 1.0:
        raise InputError("--fixed-step", f"{fixed_step:g}", "a period from 0.0001 to 1 s")
    if request.unconstrained:
        sessions = [
            without_constraint(each) if is_round else each
            for each, is_round in zip(sessions, rounds, strict=True)
        ]
    for each, is_round in zip(sessions, rounds, strict=True):
        for note in () if is_round else each.notes:
            typer.echo(printable(f"note: {_file_of(each)}: {note}"), err=True)
    player = _Player(game, remote, request.closed, fixed_step, request.log, film)
    played = list(zip(_distinct_names(sessions), sessions, rounds, strict=True))
    replays = []
    with Share("Replaying") as share:
        share.show(0.0)
        for done in player.replays(played, share.show):
            replays.append(done)
            share.show(len(replays) / len(played))
    both = list(zip(played, replays, strict=True))
    agreeing = [
        (n, s, agreement_of(s, done.session)) for (n, s, is_round), done in both if is_round
    ]
    others = [(s, done) for (_, s, is_round), done in both if not is_round]
    if request.json:
        content = rounds_json(agreeing, closed_loop=request.closed) if agreeing else {}
        if others:
            content["sessions"] = {str(each.path): _as_json(done) for each, done in others}
        print_json(content)
    else:
        if agreeing:
            _print_rounds(agreeing, closed_loop=request.closed)
        for each, done in others:
            app, end = done.session.app, "ended" if done.finished else "had not ended"
            what = f"{counted(done.frames, 'frame')} in {app.name or app.kind}; the round {end}"
            lines = [f"{_file_of(each)}: {what}", *_lines(done)]
            typer.echo("\n".join(map(printable, lines)))
        for file in () if film is None else film.files:
            typer.echo(f"Written: {file}")
    same = [part.identical_rounds == 1 for *_, part in agreeing]
    same += [done.comparison.same for _, done in others]
    return int(request.strict and not all(same))


@dataclass(frozen=True)
class _Player:
    """How sessions are replayed; see the options."""

    game: str | None
    remote: dict[str, Any]
    closed: bool
    fixed_step: float | None
    log: Path | None
    film: ReplayFilm | None

    def replays(
        self, played: Sequence[tuple[str, Session, bool]], on_progress: Callable[[float], None]
    ) -> Iterator[SessionReplay]:
        """Replay sessions in their order; games of this runtime in parallel unless filmed."""
        if self.film is None and not self.remote and len(played) > 1:
            with ThreadPoolExecutor(_THREADS) as pool:
                yield from pool.map(lambda one: self.replay(*one), played)
            return
        for number, one in enumerate(played):

            def show(part: float, done: int = number) -> None:
                on_progress((done + part) / len(played))

            yield self.replay(*one, only=len(played) == 1, on_progress=show)

    def replay(
        self,
        name: str,
        session: Session,
        is_round: bool,
        *,
        only: bool = True,
        on_progress: Callable[[float], None] = lambda part: None,
    ) -> SessionReplay:
        from sim2vr_harness.sessions import write_session
        from sim2vr_harness.sessions.replay import replay_session
        from sim2vr_harness.sessions.whacamole import with_clock

        place = None if self.log is None else self.log / name
        try:
            if is_round:
                session = with_clock(session, closed_loop=self.closed, fixed_step_s=self.fixed_step)
            with ExitStack() as stack:
                shown: dict[str, Any] = {}
                if self.film is not None:
                    app = self.game or str(self.remote.get("game") or session.app.name)
                    film = stack.enter_context(self.film.round(session, name, app, only=only))
                    shown = {"renderer": "automatic", "size": self.film.size, "watch": film.watch}
                done = replay_session(
                    session,
                    game=self.game,
                    app=self.remote,
                    log_dir=place,
                    on_progress=on_progress,
                    **shown,
                )
        except ValueError as error:
            source = "" if session.path is None else file_name(session.path)
            if not is_round or str(error).startswith(source):
                raise
            raise ValueError(f"{source}: {error}") from error
        if place is not None:
            write_session(done.session, place / "replay.jsonl")
        return done


def _file_of(session: Session) -> str:
    return "" if session.path is None else session.path.name


def _distinct_names(sessions: Sequence[Session]) -> list[str]:
    """Sessions that share a name get as much of their path in front as tells them apart."""
    parts = [(each.path or Path()).resolve().parts for each in sessions]
    names = [each.name for each in sessions]
    for depth in range(1, max(map(len, parts))):
        if len(set(names)) == len(names):
            break
        names = [
            "/".join([*own[-1 - depth : -1], each.name])
            for own, each in zip(parts, sessions, strict=True)
        ]
    return names


def _print_rounds(rounds: Sequence[tuple[str, Session, Agreement]], *, closed_loop: bool) -> None:
    """Print the events of each round and of all, then how well hits agree in time and speed."""
    console = Console()
    how = "seed and poses only" if closed_loop else "spawns from the log, outcomes predicted"
    console.print(_rounds_table(rounds, f"Replay: {how}", _EVENTS, _event_cells))
    console.print(_rounds_table(rounds, "When and how fast hits are", _TIMES, _time_cells))


def _rounds_table(
    rounds: Sequence[tuple[str, Session, Agreement]],
    title: str,
    columns: Sequence[str],
    cells: Callable[[Agreement], list[str]],
) -> Table:
    from sim2vr_harness.sessions.agreement import pooled
    from sim2vr_harness.sessions.whacamole import constrained

    table = Table(
        title=title,
        title_justify="left",
        title_style="bold",
        box=box.SIMPLE_HEAD,
        padding=(0, 0, 0, 1),
    )
    table.add_column("Round", overflow="fold")
    for heading in columns:
        table.add_column(heading, justify="right", no_wrap=True)
    groups: dict[str, list[Agreement]] = {"constrained": [], "unconstrained": []}
    for name, session, part in rounds:
        table.add_row(name, *cells(part))
        groups["constrained" if constrained(session) else "unconstrained"].append(part)
    table.add_section()
    if all(groups.values()):
        groups["all"] = [part for *_, part in rounds]
    for name, parts in groups.items():
        if parts:
            table.add_row(name, *cells(pooled(parts)), style="bold")
    return table


def _event_cells(part: Agreement) -> list[str]:
    from sim2vr_harness.sessions.agreement import as_json

    figures = as_json(part)
    counts = [
        f"{figures[f'{kind}_recorded']}/{figures[f'{kind}_predicted']}"
        for kind in ("hits", "misses", "contacts")
    ]
    different = part.rounds - part.identical_rounds
    first = f"in {different} of {part.rounds}" if different else "none"
    if part.first_divergence_s is not None:
        first = f"{part.first_divergence_s:.2f} s"
    return [str(part.targets), _four_digits(figures["outcome_agreement"]), *counts, first]


def _time_cells(part: Agreement) -> list[str]:
    from sim2vr_harness.sessions.agreement import as_json

    figures = as_json(part)
    dt_s, dv, dv_p95 = (figures[key] for key in ("mean_abs_dt_s", "dv_median", "dv_p95"))
    recall, precision = (
        "/".join(_four_digits(figures[f"hit_{what}_{window}ms"]) for window in (50, 100))
        for what in ("recall", "precision")
    )
    return [
        recall,
        precision,
        _four_digits(figures["same_step"]),
        "-" if dt_s is None else f"{1000 * dt_s:.3f}",
        "-" if dv is None else f"{dv:.4f}/{dv_p95:.4f}",
    ]


def _four_digits(value: float | None) -> str:
    """Four digits without the zero in front; 1 only when it is exactly that."""
    if value is None:
        return "-"
    return f"{value:g}" if value in (0.0, 1.0) else f"{min(value, 0.9999):.4f}"[1:]


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
