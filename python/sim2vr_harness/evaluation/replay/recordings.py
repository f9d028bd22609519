"""Recorded rounds of Whac-A-Mole, read from the three forms in which they exist.

- ``states.csv`` with ``events.csv`` beside it: the original's logger, and ours.
- A packed round ``NAME.npz`` with ``NAME_events.csv``, listed in a ``manifest.json`` beside them.
- A folder that holds such rounds, or one above it.

Poses are in the app's frame (Unity: left-handed, x right, y up, z forward): position x y z in
metres, rotation x y z w.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.base.errors import InputError, shown
from sim2vr_harness.base.files import file_name, read_arrays, read_json
from sim2vr_harness.client import OptionValue
from sim2vr_harness.sessions import SessionEvent
from sim2vr_harness.sessions.checks import LATEST_NS, check_duration
from sim2vr_harness.sessions.logs import event_text, logged_options, numbered_events
from sim2vr_harness.sessions.state_log import read_lines, read_state_log

GAME = "whacamole"
"""Whose rounds were recorded."""

FloatArray = NDArray[np.float64]
_Logged = tuple[str, SessionEvent]

_UNCONSTRAINED = "-unconstrained"
_KINDS = ("spawn", "hit", "contact", "miss")
_LEAST_FRAMES = 3
_TITLE_LINES = 4
_PLANE, _GRID, _TARGET = "target_plane_transform", "grid_mapping", "target_"
_PLACE = re.compile(
    r"\[(?P<cell>\d+) \d+ \d+ (?P<x>-?[\d.]+(?:E-?\d+)?) (?P<y>-?[\d.]+(?:E-?\d+)?) "
)
_PERIOD = "a period from 0.0001 to 1 s"


@dataclass(frozen=True)
class Event:
    """Something that happened to a target."""

    time_s: float
    """On the game's clock: of the frame for a spawn, of the fixed step for the others."""
    kind: str
    """``spawn``, ``hit``, ``contact`` (a touch too slow for a hit) or ``miss``."""
    target: int
    """Counts the round's spawns from 0."""
    cell: int
    """0 to 8, row by row from the top left as the player sees it."""
    velocity_mps: tuple[float, float, float] | None = None
    """The game's smoothed hammer velocity, world axes; of hits and contacts."""

    @property
    def session_event(self) -> SessionEvent:
        """The same as sessions have it."""
        data: dict[str, Any] = {"target_id": self.target, "grid_id": self.cell}
        if self.velocity_mps is not None:
            data["velocity"] = list(self.velocity_mps)
        return SessionEvent(round(self.time_s * 1e9), _TARGET + self.kind, data)


@dataclass(frozen=True)
class Recording:
    """One recorded round.

    Attributes:
        name: Short name for tables.
        source: File or folder that it was read from.
        condition: The game's condition, with ``-unconstrained`` where any touch was a hit.
        seed: Of the round's random numbers.
        times_s: (N,) frame times as logged, absolute game time. Frame 0 placed the target area;
            the others are the frames of play.
        head: (N, 7) poses of the head.
        right: (N, 7) poses of the right controller.
        events: In the order of the file.
        finished: The round was played to its end.
        fixed_step_s: Period of the game's fixed steps, or None when the source does not say.
        options: Of the game, as far as our log says that they were not the usual ones.
        left: (N, 7) poses of the left controller, if that one held the hammer.
        others: Further poses, such as ``marker``, (N, 7) each.
        plane: (7,) pose of the targets' plane: x right, y up, z away from the player; None when the
            source does not say.
        places_m: cell -> x and y of its target in the plane, as far as the source says.
        person: Who played, where the source says.
    """

    name: str
    source: Path
    condition: str
    seed: int
    times_s: FloatArray
    head: FloatArray
    right: FloatArray
    events: tuple[Event, ...]
    finished: bool
    fixed_step_s: float | None = None
    options: Mapping[str, OptionValue] = field(default_factory=dict)
    left: FloatArray | None = None
    others: Mapping[str, FloatArray] = field(default_factory=dict)
    plane: FloatArray | None = None
    places_m: Mapping[int, tuple[float, float]] = field(default_factory=dict)
    person: str | None = None

    @property
    def constrained(self) -> bool:
        """Whether a hit needed speed."""
        return not self.condition.endswith(_UNCONSTRAINED)


def read_recordings(paths: Iterable[Path], *, unconstrained: bool = False) -> list[Recording]:
    """Read every round at or below the paths.

    Args:
        paths: Folders, and files of single rounds: logged ``states.csv`` or packed ``.npz``.
        unconstrained: Every touch was a hit in rounds whose logs do not say (the original's logs of
            the unconstrained version carry the plain condition name).

    Raises:
        InputError: A path holds no round, or a file cannot be read as one; names file and line.
    """
    found: list[Recording] = []
    for path in paths:
        if not path.exists():
            raise InputError("PATH", repr(str(path)), "a file or folder that exists")
        read = _rounds_below if path.is_dir() else _rounds_of_file
        rounds = list(read(path, unconstrained))
        if not rounds:
            expected = (
                "a folder with states.csv and events.csv, or with manifest.json, NAME.npz and "
                "NAME_events.csv; or a folder above such ones"
            )
            raise InputError("PATH", repr(str(path)), expected)
        found += rounds
    return found


def _rounds_of_file(file: Path, unconstrained: bool) -> Iterator[Recording]:
    if file.suffix == ".npz":
        yield _packed_round(_trial(file), file, unconstrained)
    elif file.name == "manifest.json":
        for trial in _trials(file):
            yield _packed_round(trial, file.parent / f"{trial['file']}.npz", unconstrained)
    elif file.name.endswith("states.csv"):
        yield _logged_round(file, unconstrained)
    else:
        expected = "a states.csv, a packed round NAME.npz, a manifest.json, or a folder of such"
        raise InputError("PATH", repr(str(file)), expected)


def _rounds_below(folder: Path, unconstrained: bool) -> Iterator[Recording]:
    for name in ("states.csv", "manifest.json"):
        if (folder / name).is_file():
            yield from _rounds_of_file(folder / name, unconstrained)
            return
    for below in sorted(path for path in folder.iterdir() if path.is_dir()):
        yield from _rounds_below(below, unconstrained)


# --- the original's logs, and ours ---------------------------------------------------------------


def _logged_round(states: Path, unconstrained: bool) -> Recording:
    events = states.with_name(states.name.removesuffix("states.csv") + "events.csv")
    if not events.is_file():
        raise InputError("PATH", repr(str(states)), f"its events in {events.name} beside it")
    log = read_state_log(states)
    if len(log.times_s) < _LEAST_FRAMES:
        raise InputError(str(states), f"{len(log.times_s)} rows", f"at least {_LEAST_FRAMES}")
    condition = log.condition
    if unconstrained and not condition.endswith(_UNCONSTRAINED):
        condition += _UNCONSTRAINED
    plain = states.name == "states.csv"
    name = states.stem.removesuffix("states").rstrip("_-. ")
    options = logged_options(events)
    logged = numbered_events(events)
    if not any(event.kind.startswith("target") for _, event in logged):
        expected = "a round of Whac-A-Mole; rounds of other games need --game NAME"
        raise InputError("PATH", f"{str(states.parent)!r}, a round of another game", expected)
    return Recording(
        name=states.parent.resolve().name if plain else name,
        source=states.parent if plain else states,
        condition=condition,
        seed=log.seed,
        times_s=log.times_s,
        right=log.right,
        left=log.left if options.get("hand") == "left" else None,
        head=log.head,
        events=_target_events(logged),
        finished=any(event.kind == "episode_statistics" for _, event in logged[-3:]),
        options=options,
        others=log.others,
        plane=_logged_plane(logged),
        places_m=_logged_places(logged),
    )


def _logged_plane(logged: Sequence[_Logged]) -> FloatArray | None:
    for place, event in logged[:_TITLE_LINES]:
        if event.kind.startswith(_PLANE):
            plane = np.array(event.data.get("value", ()), dtype=np.float64)
            if event.kind != _PLANE or plane.shape != (7,):
                expected = "the plane's pose: position x y z, rotation x y z w"
                raise InputError(place, shown(event_text(event), 60), expected)
            return plane
    return None


def _logged_places(logged: Sequence[_Logged]) -> dict[int, tuple[float, float]]:
    for _, event in logged[:_TITLE_LINES]:
        if event.kind == _GRID:
            found = _PLACE.finditer(str(event.data.get("text")))
            return {int(each["cell"]): (float(each["x"]), float(each["y"])) for each in found}
    return {}


def _checked_frames(source: Path, rows: FloatArray) -> FloatArray:
    """Rows that begin with the time: all finite, times not falling."""
    bad = np.flatnonzero(~np.isfinite(rows).all(axis=1))
    if len(bad):
        raise InputError(f"{source}, frame {bad[0]}", "a value that is not finite", "numbers")
    back = np.flatnonzero(np.diff(rows[:, 0]) < 0)
    if len(back):
        i = int(back[0])
        got = f"time {rows[i + 1, 0]:g} after {rows[i, 0]:g}"
        raise InputError(f"{source}, frame {i + 1}", got, "times that do not go backwards")
    check_duration(rows[:, 0], file_name(source))
    return rows


def read_events(path: Path) -> tuple[Event, ...]:
    """The targets' events of an ``events.csv``, other lines left out.

    Raises:
        InputError: The file or a line of it cannot be read.
    """
    return _target_events(numbered_events(path))


def _target_events(logged: Sequence[_Logged]) -> tuple[Event, ...]:
    found = []
    for i, (place, event) in enumerate(logged):
        if not event.kind.startswith(_TARGET) or event.kind.startswith(_PLANE):
            continue
        kind, data = event.kind.removeprefix(_TARGET), event.data
        try:
            target, cell = str(data["target_id"]), str(data["grid_id"])
            found.append(_event(event.time_ns / 1e9, kind, target, cell, data.get("velocity", ())))
        except (KeyError, TypeError, ValueError):
            if i + 1 == len(logged):  # cut off
                break
            got = shown(event_text(event), 80)
            expected = "'T, target_KIND, target ID N, grid ID G[, velocity X Y Z]'"
            raise InputError(place, got, expected) from None
    return tuple(found)


def _event(
    time_s: float, kind: str, target: str, cell: str, velocity: Sequence[str | float]
) -> Event:
    """An event from its parts; an error when one of them cannot be right."""
    speeds = tuple(float(v) for v in velocity)
    late = not abs(time_s) <= LATEST_NS * 1e-9
    if late or kind not in _KINDS or not 0 <= int(cell) < 9 or len(speeds) not in (0, 3):
        raise ValueError
    three = (speeds[0], speeds[1], speeds[2]) if speeds else None
    return Event(time_s, kind, int(target), int(cell), three)


# --- the packed form -----------------------------------------------------------------------------


def _trials(manifest: Path) -> list[dict[str, Any]]:
    expected = "a JSON object with a list 'trials'"
    trials = read_json(manifest, expected).get("trials")
    if not isinstance(trials, list):
        raise InputError(file_name(manifest), f"trials: {shown(trials, 40)}", expected)
    for trial in trials:
        if not isinstance(trial, dict) or not _is_file_name(trial.get("file")):
            expected = "trials with the name of a file beside the manifest"
            raise InputError(file_name(manifest), shown(trial, 60), expected)
    return [trial for trial in trials if trial.get("file") and "seed" in trial]


def _is_file_name(name: Any) -> bool:
    """Whether this is the name of a file in the manifest's folder; None of one that is missing."""
    return name is None or (isinstance(name, str) and Path(name).name == name)


def _trial(packed: Path) -> dict[str, Any]:
    manifest = packed.with_name("manifest.json")
    if not manifest.is_file():
        expected = "a manifest.json beside it, which has its condition and seed"
        raise InputError("PATH", repr(str(packed)), expected)
    for trial in _trials(manifest):
        if trial["file"] == packed.stem:
            return trial
    raise InputError(str(manifest), f"no trial {packed.stem!r}", "one for every packed round")


def _packed_round(trial: dict[str, Any], file: Path, unconstrained: bool) -> Recording:
    expected = "numbers t (N,), head and right (N, 7), N of 3 or more, in an .npz file"
    arrays = read_arrays(file, expected)
    for key in ("t", "head", "right"):
        if key not in arrays or arrays[key].dtype.kind not in "fiu":
            got = f"{key} of {arrays[key].dtype}" if key in arrays else f"no array {key!r}"
            raise InputError(file_name(file), got, expected)
    t, head, right = (arrays[key].astype(float) for key in ("t", "head", "right"))
    others = {
        key: array.astype(float)
        for key, array in arrays.items()
        if key not in ("t", "head", "right")
        and array.dtype.kind in "fiu"
        and array.shape == (len(t), 7)
    }
    if not (t.ndim == 1 and len(t) >= 3 and head.shape == right.shape == (len(t), 7)):
        got = f"shapes {t.shape}, {head.shape}, {right.shape}"
        raise InputError(file_name(file), got, expected)
    _checked_frames(file, np.column_stack([t, head, right, *others.values()]))
    trial = _checked_trial(file, trial)
    condition = trial["condition"]
    if (unconstrained or not trial.get("constrained", True)) and not condition.endswith(
        _UNCONSTRAINED
    ):
        condition += _UNCONSTRAINED
    return Recording(
        name=str(trial["file"]),
        source=file,
        condition=condition,
        seed=trial["seed"] % 2**32,
        times_s=t,
        head=head,
        right=right,
        events=_packed_events(file.with_name(f"{file.stem}_events.csv")),
        finished=True,
        fixed_step_s=trial.get("fixed_timestep"),
        others=others,
        plane=_packed_plane(file, trial),
        person=None if trial.get("participant") is None else str(trial["participant"]),
    )


def _packed_plane(file: Path, trial: dict[str, Any]) -> FloatArray | None:
    parts = [trial.get("plane_pos", ()), trial.get("plane_quat_xyzw", ())]
    if parts == [(), ()]:
        return None
    try:
        plane = np.array([float(number) for part in parts for number in part])
    except (TypeError, ValueError):
        plane = np.zeros(0)
    if plane.shape != (7,) or not np.isfinite(plane).all():
        place = f"{file_name(file.with_name('manifest.json'))}, trial {file_name(file.stem)}"
        raise InputError(
            f"{place}: plane_pos, plane_quat_xyzw", shown(parts, 60), "3 and 4 numbers"
        )
    return plane


def _checked_trial(file: Path, trial: dict[str, Any]) -> dict[str, Any]:
    """A trial of the manifest with what a replay needs of it, all of the right kind."""
    step = trial.get("fixed_timestep")
    number = isinstance(step, (int, float)) and not isinstance(step, bool)
    for key, wrong, expected in (
        ("condition", not isinstance(trial.get("condition"), str), "the name of a condition"),
        ("seed", type(trial.get("seed")) is not int, "a whole number"),
        ("constrained", type(trial.get("constrained", True)) is not bool, "true or false"),
        ("fixed_timestep", not (step is None or (number and 1e-4 <= step <= 1.0)), _PERIOD),
    ):
        if wrong:
            place = f"{file_name(file.with_name('manifest.json'))}, trial {file_name(file.stem)}"
            raise InputError(f"{place}: {key}", shown(trial.get(key), 40), expected)
    return trial


def _packed_events(path: Path) -> tuple[Event, ...]:
    lines = read_lines(path)
    expected = "t,type,target_id,grid_id,vx,vy,vz"
    if not set(expected.split(",")) <= set(lines[0].split(",")):
        raise InputError(f"{file_name(path)}, line 1", shown(lines[0], 60), f"columns {expected}")
    events = []
    # A line at a time: a quote that is never closed would swallow the rest.
    names = lines[0].split(",")
    for number, line in enumerate(lines[1:], start=2):
        if not line:
            continue
        row = dict(zip(names, line.split(","), strict=False))
        try:
            velocity = [row[axis] for axis in ("vx", "vy", "vz") if row[axis]]
            target, cell = row["target_id"], row["grid_id"]
            events.append(_event(float(row["t"]), row["type"], target, cell, velocity))
        except (KeyError, TypeError, ValueError):
            place = f"{file_name(path)}, line {number}"
            raise InputError(place, shown(line, 60), expected) from None
    return tuple(events)
