"""``sim2vr-harness session``: rounds recorded, converted, described and stripped."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sim2vr_harness.cli import record
from sim2vr_harness.cli.command import CommandGroup
from sim2vr_harness.cli.options import JsonOption, game_option, print_json

if TYPE_CHECKING:
    from sim2vr_harness.sessions import Session

_In = Annotated[
    Path, typer.Argument(metavar="IN", help="A session in any format, or a round's folder.")
]
_Out = Annotated[
    Path,
    typer.Argument(
        metavar="OUT",
        help=".jsonl or .jsonl.gz (session), .json (IWER), .csv (table), or a folder (log).",
    ),
]
_Swap = Annotated[bool, typer.Option("--swap-hands", help="Exchange the controllers.")]
_Game = Annotated[
    str | None,
    game_option("The game, where the file does not say."),
]
_Seed = Annotated[int | None, typer.Option(help="The seed, where the file does not say.", min=0)]

app = CommandGroup(
    """Record rounds of a page; show, convert and strip rounds.

    Examples:
        sim2vr-harness session show round.jsonl
        sim2vr-harness session convert recording.json round.jsonl.gz
    """
)


def convert(
    source: _In,
    out: _Out,
    swap_hands: _Swap = False,
    game: _Game = None,
    seed: _Seed = None,
) -> None:
    """Convert a recorded round to the format of OUT's name.

    Examples:
        sim2vr-harness session convert recording.json round.jsonl.gz
        sim2vr-harness session convert replay.bsor poses.csv
    """
    from sim2vr_harness.sessions.formats import read_session, require_name, write_session

    form = require_name(out)
    session = read_session(source)
    if swap_hands:
        session = session.swapped()
    if game is not None:
        from sim2vr_harness.client import describe_game

        session = replace(session, app=replace(session.app, kind="game", name=game))
        describe_game(game)
    if seed is not None:
        session = replace(session, seed=seed)
    write_session(session, out)
    for note in session.notes:
        typer.echo(f"note: {note}", err=True)
    lost = _lost(session, form.name)
    if lost:
        typer.echo(f"note: {form.name} has no place for {', '.join(lost)}", err=True)
    typer.echo(f"Written: {out}")


def show(source: _In, json: JsonOption = False) -> None:
    """Show what a session holds: app, devices, rate, duration, events, and what is personal.

    Examples:
        sim2vr-harness session show round.jsonl
        sim2vr-harness session show recording.json --json
    """
    from sim2vr_harness.sessions import read_session

    session = read_session(source)
    content = _content(session)
    if json:
        print_json(content)
        return
    width = max(map(len, content))
    for name, value in content.items():
        lines = value if isinstance(value, list) else [_plain(value)]
        for i, line in enumerate(lines or ["none"]):
            typer.echo(f"{(name.replace('_', ' ') if i == 0 else ''):{width}}  {line}")


def strip(source: _In, out: _Out) -> None:
    """Write a copy without hand joints, the person's name and head height.

    All devices move up or down together until the head's median height is 1.6 m.

    Examples:
        sim2vr-harness session strip round.jsonl shared.jsonl
        sim2vr-harness session strip recording.json shared.jsonl.gz
    """
    from sim2vr_harness.sessions.formats import read_session, require_name, write_session
    from sim2vr_harness.sessions.privacy import personal_content, stripped

    require_name(out)
    session = stripped(read_session(source))
    write_session(session, out)
    typer.echo(f"Written: {out}")
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


def _plain(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name} {each}" for name, each in value.items()) or "none"
    return "not known" if value is None else str(value)


def _lost(session: Session, form: str) -> list[str]:
    """What a format has no place for, of what the session holds."""
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
    return [name for name in missing.get(form, ()) if held[name]]


app.add("record", record.record)
app.add("convert", convert)
app.add("show", show)
app.add("strip", strip)
