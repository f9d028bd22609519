"""``sim2vr-harness track``: a body follows what a person did."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from sim2vr_harness.cli.options import (
    EnvSetOption,
    TrustOption,
    finite,
    known_users,
    print_written,
    writable_folder,
)

if TYPE_CHECKING:
    from sim2vr_harness.tools.track.paths import Frame, RecordedPath
    from sim2vr_harness.tools.track.tracking import Tracked

__all__ = ["track"]

_SHOWN_MUSCLES = 8


_Recordings = Annotated[
    list[Path],
    typer.Argument(
        metavar="RECORDING...",
        help="Recorded rounds, sessions of any app, states.csv, or CSV files with a header.",
    ),
]
_User = Annotated[
    str,
    typer.Option(
        autocompletion=known_users,
        metavar="USER",
        help="Who follows: a body or its YAML file, a configuration, or a trained user.",
    ),
]
_Stature = Annotated[
    float | None,
    typer.Option(
        metavar="M",
        help="The person's stature in m, to which the body is cut.",
        show_default="estimated from the head's height",
        callback=finite,
    ),
]
_Mass = Annotated[
    float | None,
    typer.Option(
        metavar="KG", help="The person's mass.", show_default="by stature", callback=finite
    ),
]
_Yaw = Annotated[
    str,
    typer.Option(
        metavar="DEG|head",
        help="How far to the right of the recorded forward the person faces; head: as that.",
    ),
]
_Scale = Annotated[float, typer.Option(help="Scale of distances from the head.", callback=finite)]
_Offset = Annotated[
    str,
    typer.Option(metavar="X,Y,Z", help="Further shift of the path, m right, up and ahead."),
]
_Frame = Annotated[
    str,
    typer.Option(
        help="Of CSV files: app (Unity: left-handed, z ahead) or openxr (right-handed, z back)."
    ),
]
_Refine = Annotated[
    bool,
    typer.Option(
        "--refine/--no-refine",
        help="Then plan muscles two seconds ahead, for the hands' path with little effort: "
        "about ten minutes for each minute of fast play.",
    ),
]
_Pointed = Annotated[
    bool, typer.Option("--pointed", help="Let hands point as the person's did, too.")
]
_Play = Annotated[
    bool, typer.Option("--play/--no-play", help="Play the recorded game with this hand.")
]
_Out = Annotated[Path, typer.Option(help="Folder for the files.", callback=writable_folder)]


def track(
    recordings: _Recordings,
    user: _User = "mobl_arms_wrist",
    stature: _Stature = None,
    mass: _Mass = None,
    yaw: _Yaw = "0",
    scale: _Scale = 1.0,
    offset: _Offset = "0,0,0",
    frame: _Frame = "app",
    refine: _Refine = True,
    pointed: _Pointed = False,
    play: _Play = True,
    record: Annotated[bool, typer.Option("--record", help="Film it.")] = False,
    seed: Annotated[int, typer.Option(help="Of what is drawn.", min=0)] = 1,
    out: _Out = Path("track"),
    set_: EnvSetOption = None,
    trust_app: TrustOption = False,
) -> None:
    """Let a body follow recorded hands, and report errors and effort.

    Examples:
        sim2vr-harness track recordings/person_1 --no-refine
        sim2vr-harness track hands.csv --frame openxr --stature 1.75 --no-play
    """
    from sim2vr_harness.cli.progress import Share
    from sim2vr_harness.policies.hierarchical.motor_store import motor_layer_for
    from sim2vr_harness.tools.track.tracking import TrackingSettings, track
    from sim2vr_harness.tools.users import environment_of

    right, up, ahead = _three("--offset", offset)
    # fmt: off
    settings = TrackingSettings(
        refined=refine, yaw=_yaw(yaw),
        scale=_between("--scale", scale, 0.2, 5.0), offset_m=(ahead, -right, up),
        stature_m=None if stature is None else _between("--stature", stature, 1.0, 2.5),
        mass_kg=None if mass is None else _between("--mass", mass, 20.0, 300.0),
        pointed=pointed, seed=seed, play=play,
    )
    # fmt: on
    env = environment_of(user, overrides=set_ or (), trust_app=trust_app)
    paths = _paths(recordings, frame)
    layer_for = partial(motor_layer_for, following=True)
    done = []
    for path in paths:
        with Share(f"Tracking {path.name}") as share:
            share.show(0.0)
            done.append(track(path, env, layer_for, settings, on_progress=share.show))
        _tell(done[-1])
    _write(done, out, record=record)


def _write(done: Sequence[Tracked], out: Path, *, record: bool) -> None:
    from sim2vr_harness.cli.progress import say
    from sim2vr_harness.tools.track.files import film, write

    files = write(done, out)
    if record:
        for one in done:
            say(f"Filming {one.path.name}")
            files.append(film(one, out / f"{one.path.name}.mp4"))
    print_written(files)


def _paths(recordings: Sequence[Path], frame: str) -> list[RecordedPath]:
    """Everything to be followed, by distinct names."""
    from dataclasses import replace

    from sim2vr_harness.tools.track.paths import read_paths

    found: list[RecordedPath] = []
    for recording in recordings:
        for path in read_paths(recording, frame=_frame(frame)):
            name, number = path.name, 2
            while any(other.name == name for other in found):
                name, number = f"{path.name}-{number}", number + 1
            found.append(replace(path, name=name))
    return found


def _frame(name: str) -> Frame:
    from sim2vr_harness.base.errors import unknown_name
    from sim2vr_harness.tools.track.paths import FRAMES

    for known in FRAMES:
        if name == known:
            return known
    raise unknown_name("--frame", name, FRAMES)


def _yaw(text: str) -> float | Literal["head"]:
    from sim2vr_harness.base.errors import InputError

    if text == "head":
        return "head"
    try:
        degrees = float(text)
    except ValueError:
        raise InputError("--yaw", repr(text), "degrees, or head") from None
    return _between("--yaw", degrees, -360.0, 360.0)


def _three(option: str, text: str) -> tuple[float, float, float]:
    from sim2vr_harness.base.errors import InputError

    try:
        right, up, ahead = (float(part) for part in text.split(","))
    except ValueError:
        raise InputError(option, repr(text), "three numbers such as 0,0.1,-0.05") from None
    return (
        _between(option, right, -20.0, 20.0),
        _between(option, up, -20.0, 20.0),
        _between(option, ahead, -20.0, 20.0),
    )


def _between(option: str, value: Any, low: float, high: float) -> Any:
    from sim2vr_harness.base.errors import InputError

    if not low <= value <= high:
        raise InputError(option, f"{value:g}", f"{low:g} to {high:g}")
    return value


def _tell(one: Tracked) -> None:
    from rich.console import Console
    from rich.table import Table

    from sim2vr_harness.tools.track.summary import facts_of, hand_rows, muscle_rows, outcome_rows

    console = Console()
    for line in facts_of(one):
        console.print(line, highlight=False, markup=False)
    for title, (head, *rows) in (
        ("Error of the hand's place (mm)", hand_rows(one)),
        ("Muscles, the most active first", muscle_rows(one, _SHOWN_MUSCLES)),
        ("The game", outcome_rows(one)),
    ):
        if not rows:
            continue
        table = Table(title=title, title_justify="left", box=None, pad_edge=False)
        for column, heading in enumerate(head):
            table.add_column(heading, justify="left" if column == 0 else "right")
        for row in rows:
            table.add_row(*row)
        console.print(table)
