"""``sim2vr-harness track``: a body follows what a person did."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from sim2vr_harness.base.requests import ChangedEnvironment, TrustedApp, argument, option
from sim2vr_harness.cli.options import print_written

if TYPE_CHECKING:
    from sim2vr_harness.tools.track.paths import Frame, RecordedPath
    from sim2vr_harness.tools.track.tracking import Tracked

__all__ = ["track"]

_SHOWN_MUSCLES = 8


@dataclass(frozen=True, kw_only=True)
class TrackRequest(ChangedEnvironment, TrustedApp):
    """What to follow, and who follows."""

    recordings: tuple[Path, ...] = argument(
        "RECORDING...",
        "Recorded rounds, sessions of any app, states.csv, or CSV files with a header.",
    )
    user: str = option(
        "Who follows the hands: a body or its YAML file, a configuration, or a trained user.",
        "mobl_arms_wrist",
        metavar="USER",
        names="users",
    )
    stature: float | None = option(
        "The person's stature in m, to which the body is scaled.",
        metavar="M",
        shown="estimated from the head's height",
    )
    mass: float | None = option("The person's mass.", metavar="KG", shown="by stature")
    yaw: str = option(
        "How far right of the recorded forward the person faces; head: as the head does.",
        "0",
        metavar="DEG|head",
    )
    scale: float = option("Scale of distances from the head.", 1.0)
    offset: str = option(
        "Further shift of the path, m right, up and ahead.", "0,0,0", metavar="X,Y,Z"
    )
    frame: str = option(
        "Of CSV files: app (Unity: left-handed, z ahead) or openxr (right-handed, z back).", "app"
    )
    refine: bool = option(
        "After tracking, plan muscles two seconds ahead for the same path with less effort: about "
        "ten minutes for each minute of fast play.",
        True,
    )
    pointed: bool = option("Follow the directions of the hands, too.", False)
    play: bool = option("Let the tracked hand play the recorded game.", True)
    record: bool = option("Film it.", False)
    seed: int = option("Seed of the random numbers.", 1, least=0)
    out: Path = option("Folder for the files.", Path("track"), place="folder to write")


def track(request: TrackRequest) -> None:
    """Estimate the muscles that a recorded movement needs.

    Examples:
        sim2vr-harness track recordings/person_1 --no-refine
        sim2vr-harness track hands.csv --frame openxr --stature 1.75 --no-play
    """
    from sim2vr_harness.cli.progress import Share
    from sim2vr_harness.policies.hierarchical.motor_store import motor_layer_for
    from sim2vr_harness.tools.track.tracking import TrackingSettings, track
    from sim2vr_harness.tools.users import environment_of

    right, up, ahead = _three("--offset", request.offset)
    stature, mass = request.stature, request.mass
    settings = TrackingSettings(
        refined=request.refine,
        yaw=_yaw(request.yaw),
        scale=_between("--scale", request.scale, 0.2, 5.0),
        offset_m=(ahead, -right, up),
        stature_m=None if stature is None else _between("--stature", stature, 1.0, 2.5),
        mass_kg=None if mass is None else _between("--mass", mass, 20.0, 300.0),
        pointed=request.pointed,
        seed=request.seed,
        play=request.play,
    )
    env = environment_of(request.user, overrides=request.overrides, trust_app=request.trust_app)
    # Everything to be followed, by distinct names.
    from dataclasses import replace

    from sim2vr_harness.tools.track.paths import read_paths

    found: list[RecordedPath] = []
    for recording in request.recordings:
        for path in read_paths(recording, frame=_frame(request.frame)):
            name, number = path.name, 2
            while any(other.name == name for other in found):
                name, number = f"{path.name}-{number}", number + 1
            found.append(replace(path, name=name))
    paths = found
    layer_for = partial(motor_layer_for, following=True)
    done = []
    for path in paths:
        with Share(f"Tracking {path.name}") as share:
            share.show(0.0)
            done.append(track(path, env, layer_for, settings, on_progress=share.show))
        _tell(done[-1])
    _write(done, request.out, record=request.record)


def _write(done: Sequence[Tracked], out: Path, *, record: bool) -> None:
    from sim2vr_harness.cli.progress import say
    from sim2vr_harness.tools.track.files import film, write

    files = write(done, out)
    if record:
        for one in done:
            say(f"Filming {one.path.name}")
            files.append(film(one, out / f"{one.path.name}.mp4"))
    print_written(files)


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

    from sim2vr_harness.tools.track.files import facts_of, hand_rows, muscle_rows, outcome_rows

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
