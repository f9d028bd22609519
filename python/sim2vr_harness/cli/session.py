"""``sim2vr-harness session``: rounds recorded, converted, described and stripped."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from sim2vr_harness.base.requests import argument, option
from sim2vr_harness.cli import record
from sim2vr_harness.cli.command import CommandGroup
from sim2vr_harness.cli.options import JsonOutput, print_json

if TYPE_CHECKING:
    from sim2vr_harness.sessions import Session


@dataclass(frozen=True, kw_only=True)
class SessionRequest:
    """A recorded round."""

    source: Path = argument("IN", "A session in any format, or a round's folder.")


@dataclass(frozen=True, kw_only=True)
class ShowRequest(SessionRequest, JsonOutput):
    """What to show."""


@dataclass(frozen=True, kw_only=True)
class CopyRequest(SessionRequest):
    """What to write, and where to."""

    out: Path = argument(
        "OUT",
        ".jsonl or .jsonl.gz (session), .json (IWER), .csv (table), or a folder (log).",
    )


@dataclass(frozen=True, kw_only=True)
class ConvertRequest(CopyRequest):
    """What to write, and what to change in it."""

    swap_hands: bool = option("Exchange the controllers.", False)
    game: str | None = option(
        "The game, where the file does not say.", metavar="NAME", names="games"
    )
    seed: int | None = option("The seed, where the file does not say.", least=0)


app = CommandGroup(
    """Record rounds of a page; show, convert and strip rounds.

    Examples:
        sim2vr-harness session show round.jsonl
        sim2vr-harness session convert recording.json round.jsonl.gz
    """
)


def convert(request: ConvertRequest) -> None:
    """Convert a recorded round to the format of OUT's name.

    Examples:
        sim2vr-harness session convert recording.json round.jsonl.gz
        sim2vr-harness session convert replay.bsor poses.csv
    """
    from sim2vr_harness.sessions.formats import read_session, require_name, write_session

    form = require_name(request.out)
    session = read_session(request.source)
    if request.swap_hands:
        session = session.swapped()
    if request.game is not None:
        from sim2vr_harness.client import describe_game

        session = replace(session, app=replace(session.app, kind="game", name=request.game))
        describe_game(request.game)
    if request.seed is not None:
        session = replace(session, seed=request.seed)
    write_session(session, request.out)
    for note in session.notes:
        typer.echo(f"note: {note}", err=True)
    # What a format has no place for, of what the session holds.
    controllers = session.controllers.values()
    held = {
        "events": bool(session.events),
        "the seed": session.seed is not None,
        "the app's options": bool(session.app.options),
        "inputs": any(one.inputs is not None for one in controllers),
        "hand joints": any(one.joints is not None for one in controllers),
    }
    missing = {
        "iwer": ("events", "the seed", "the app's options"),
        "csv": ("events", "the seed", "the app's options", "hand joints"),
        "log": ("the app's options", "inputs", "hand joints"),
    }
    lost = [name for name in missing.get(form.name, ()) if held[name]]
    if lost:
        typer.echo(f"note: {form.name} has no place for {', '.join(lost)}", err=True)
    typer.echo(f"Written: {request.out}")


def show(request: ShowRequest) -> None:
    """Show what a session holds: app, devices, rate, duration, events, and what is personal.

    Examples:
        sim2vr-harness session show round.jsonl
        sim2vr-harness session show recording.json --json
    """
    from sim2vr_harness.sessions import read_session

    content = _content(read_session(request.source))
    if request.json:
        print_json(content)
        return
    width = max(map(len, content))
    for name, value in content.items():
        if isinstance(value, dict):
            value = ", ".join(f"{key} {each}" for key, each in value.items()) or "none"
        lines = value if isinstance(value, list) else ["not known" if value is None else value]
        for i, line in enumerate(lines or ["none"]):
            typer.echo(f"{(name.replace('_', ' ') if i == 0 else ''):{width}}  {line}")


def strip(request: CopyRequest) -> None:
    """Write a copy without hand joints, the person's name and head height.

    All devices move up or down together until the head's median height is 1.6 m.

    Examples:
        sim2vr-harness session strip round.jsonl shared.jsonl
        sim2vr-harness session strip recording.json shared.jsonl.gz
    """
    from sim2vr_harness.sessions.formats import read_session, require_name, write_session
    from sim2vr_harness.sessions.privacy import personal_content, stripped

    require_name(request.out)
    session = stripped(read_session(request.source))
    write_session(session, request.out)
    typer.echo(f"Written: {request.out}")
    for line in personal_content(session):
        typer.echo(f"still in it: {line}")


def _content(session: Session) -> dict[str, Any]:
    from sim2vr_harness.sessions.privacy import personal_content

    kinds = [event.kind for event in session.events]
    rate = session.frame_rate_hz
    about = session.app
    return {
        "format": session.source,
        "app": " ".join(each for each in (about.kind, about.name, about.condition) if each),
        "options": dict(about.options),
        "seed": session.seed,
        "headset": session.headset or None,
        "frames": len(session),
        "duration_s": round(session.duration_s, 3),
        "rate_hz": None if rate is None else round(rate, 2),
        "devices": _devices(session),
        "events": {kind: kinds.count(kind) for kind in sorted(set(kinds))},
        "personal": personal_content(session),
        "notes": list(session.notes),
    }


def _devices(session: Session) -> list[str]:
    found = ["head"]
    for side, one in session.controllers.items():
        parts = [name for name, rows in vars(one).items() if rows is not None]
        found.append(f"{side} controller: {', '.join(parts)}")
    return found


app.add("record", record.record)
app.add("convert", convert)
app.add("show", show)
app.add("strip", strip)
