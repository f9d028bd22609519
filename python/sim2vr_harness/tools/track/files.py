"""Output files of motion tracking: tables, OpenSim files, a summary, pictures."""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.base.files import write_atomically
from sim2vr_harness.client.frames import position_to_app
from sim2vr_harness.evaluation.data import export_opensim, read_data
from sim2vr_harness.evaluation.data.columns import Column, columns_of, merged, number_table
from sim2vr_harness.evaluation.data.folder import FOLDER, DataFolder
from sim2vr_harness.evaluation.data.items import item_columns
from sim2vr_harness.figures.figure import (
    GREY,
    INK,
    Bars,
    Figure,
    Layer,
    Line,
    Panel,
    Points,
    colour_of,
)
from sim2vr_harness.figures.matplotlib_backend import write_figure
from sim2vr_harness.tools.track.postures import REACHED_M
from sim2vr_harness.tools.track.registration import STANDING_M, head_height_m
from sim2vr_harness.tools.track.tracking import Tracked
from sim2vr_harness.users.bodies.rules import moment_arms

_MUSCLES = 12


def draw(tracked: Tracked, out: Path) -> Path:
    """Draw a tracked recording into a PNG or PDF file."""
    right, up, ahead = "right (m)", "up (m)", "ahead (m)"
    panels = [
        Panel("Error", [*_errors(tracked)], "time (s)", "error of the hand (mm)",
              y_range=(0.0, 0.0), legend=True),
        _muscles(tracked),
        Panel("From behind", [*_paths(tracked, (0, 1))], right, up, square=True, legend=True),
        Panel("From above", [*_paths(tracked, (0, 2))], right, ahead, square=True, legend=True),
    ]  # fmt: skip
    title = f"{tracked.path.name}, tracked by {tracked.body.name}"
    return write_figure(Figure("tracking", title, "", panels), out)


def _hands(tracked: Tracked) -> Iterator[tuple[int, str, str]]:
    """Number, name and colour of the tracked hands."""
    wanted = tracked.followed.wanted
    for hand in np.flatnonzero(wanted.followed).tolist():
        yield hand, wanted.hands[hand].removeprefix("controller_"), colour_of(hand)


def _errors(tracked: Tracked) -> Iterator[Layer]:
    times = tracked.followed.times_s
    for hand, name, colour in _hands(tracked):
        errors = 1e3 * tracked.followed.errors_m[:, hand]
        median, most = np.median(errors), np.quantile(errors, 0.95)
        label = f"{name} hand: median {median:.0f} mm, 95 % {most:.0f} mm"
        yield Line(label, times, errors, colour, width=0.8)
        yield Line("median", times[[0, -1]], [median, median], colour, dashed=True, width=0.8)
        beyond = times[tracked.beyond_m[:, hand] > REACHED_M]
        if len(beyond):
            yield Points("beyond reach", beyond, np.zeros(len(beyond)), INK, symbol="x")


def _paths(tracked: Tracked, which: tuple[int, int]) -> Iterator[Layer]:
    for hand, name, colour in _hands(tracked):
        x, y = position_to_app(tracked.followed.targets[:, hand])[:, which].T
        yield Line("recorded", x, y, GREY, width=0.8)
        x, y = position_to_app(tracked.followed.places[1:, hand])[:, which].T
        yield Line(f"{name} hand, tracked", x, y, colour, width=0.8)


def _muscles(tracked: Tracked) -> Panel:
    loads = tracked.muscles[:_MUSCLES]
    names = [load.muscle for load in loads]
    bars = [
        Bars("mean", names, [load.mean for load in loads], colour_of(1)),
        Bars("95 % of the time below", names, [load.most for load in loads], colour_of(4)),
    ]
    return Panel("Most loaded muscles", bars, "", "activation", legend=True)


FloatArray = NDArray[np.float64]


def named_joints(model: Any) -> list[tuple[str, int]]:
    """Return names and degrees of freedom of the hinge joints."""
    hinges = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE.value)
    return [(model.joint(int(i)).name, int(model.jnt_dofadr[i])) for i in hinges]


def joint_moments(model: Any, qpos: FloatArray, forces: FloatArray) -> FloatArray:
    """Return (N, J) moments about the joints of :func:`named_joints`, Nm.

    Args:
        model: the body.
        qpos: (N, nq) postures.
        forces: (N, nu) of the actuators in their order, pulling: < 0.
    """
    data = mujoco.MjData(model)
    columns = [dof for _, dof in named_joints(model)]
    found = np.empty((len(qpos), len(columns)))
    for k, (posture, force) in enumerate(zip(qpos, forces, strict=True)):
        data.qpos[:] = posture
        mujoco.mj_fwdPosition(model, data)
        found[k] = (force @ moment_arms(model, data))[columns]
    return found


_FILM_SIZE = 640, 480
_SHORT = {"controller_right": "right", "controller_left": "left"}
_WORDS = {"x": "right", "y": "up", "z": "forward"}
_ABOUT = {
    "episode": ("", "Name of the recording; key of the steps"),
    "source": ("", "Where it was read"),
    "body": ("", "Who followed it"),
    "stature_m": ("m", "Stature that the body was cut to; none: its own"),
    "stature_estimated": ("", "Whether that follows from the height of the head"),
    "duration_s": ("s", "Length of the recording"),
    "steps": ("", "User steps"),
    "effort": ("reward", "Cost of effort, summed"),
    "fatigued": ("", "Mean share of fatigued motor units at the end (3CC-r)"),
}
_ABOUT_HAND = {
    "median_m": ("m", "Median error of the hand's place"),
    "most_m": ("m", "95 % of the errors are below"),
    "unreachable": ("", "Share of the steps whose place is beyond the joints' limits"),
    "reachable_median_m": ("m", "Median error where the place is within reach"),
    "reachable_most_m": ("m", "95 % of these are below"),
    "layer_median_m": ("m", "Median error of the motor layer alone"),
    "layer_most_m": ("m", "95 % of these are below"),
}


def write(tracked: Sequence[Tracked], out: Path) -> list[Path]:
    """Write everything that can be said of recordings into a folder.

    Args:
        tracked: the recordings; of distinct names.
        out: made if needed; files of the same names are replaced.

    Returns:
        Files and folders.
    """
    data = DataFolder(out / FOLDER)
    rows = []
    for one in tracked:
        data.write_moments("steps", one.path.name, _steps(one))
        rows.append(_row(one))
    told = dict(_ABOUT)
    for row in rows:
        for name in row:
            part = name.partition("_")
            if part[0] in _SHORT.values() and part[2] in _ABOUT_HAND:
                unit, about = _ABOUT_HAND[part[2]]
                told[name] = (unit, f"{part[0].capitalize()} hand: {about}")
    columns = merged([column for row in rows for column in columns_of(row, told)])
    data.add({"episodes": (rows, columns), "events": ([], item_columns([]))})
    names = [one.path.name for one in tracked]
    files = [out / FOLDER]
    export_opensim(read_data(out), out / "opensim", names)
    files.append(out / "opensim")
    for one in tracked:
        files.append(draw(one, out / f"{one.path.name}.png"))
    summary = out / "summary.json"
    text = json.dumps({"recordings": [one.summary() for one in tracked]}, indent=1)
    write_atomically(summary, f"{text}\n".encode())
    return [*files, summary]


def _row(one: Tracked) -> dict[str, Any]:
    known = one.summary()
    row = {name: known[name] for name in _ABOUT if name in known}
    row = {"episode": one.path.name, **row}
    for hand in one.hands:
        short = _SHORT[hand.hand]
        row |= {f"{short}_{name}": getattr(hand, name) for name in _ABOUT_HAND}
    for who, outcome in one.outcomes.items():
        prefix = who.replace(" ", "_")
        row |= {
            f"{prefix}_targets": outcome.targets,
            f"{prefix}_hits": outcome.hits,
            f"{prefix}_misses": outcome.misses,
            f"{prefix}_hit_rate": outcome.hit_rate,
        }
    return row


def _steps(one: Tracked) -> Any:
    """Return the table of the user steps: as an evaluation's, with the reference trajectories."""
    followed = one.followed
    columns, parts = list(followed.columns), [followed.values]
    for hand in np.flatnonzero(followed.wanted.followed):
        short = _SHORT[followed.wanted.hands[hand]]
        columns += [
            Column(
                f"{short}_wanted_{axis}_m",
                "single",
                "m",
                f"Where the {short} hand was recorded, in the body's world, {word}",
            )
            for axis, word in _WORDS.items()
        ]
        columns += [
            Column(f"{short}_error_m", "single", "m", f"How far the {short} hand was from there"),
            Column(
                f"{short}_beyond_reach_m",
                "single",
                "m",
                f"How far that is from what the {short} hand can reach within its joints' limits",
            ),
        ]
        parts += [
            position_to_app(followed.targets[:, hand]),
            followed.errors_m[:, hand, None],
            one.beyond_m[:, hand, None],
        ]
    columns.append(Column("effort_cost", "single", "reward", "Cost of the step's effort"))
    parts.append(followed.effort[:, None])
    model = one.body.physics_model
    columns += [
        Column(f"moment_{name}", "single", "Nm", f"Moment of muscles and motors about {name}")
        for name, _ in named_joints(model)
    ]
    parts.append(joint_moments(model, followed.qpos, _forces(one)))
    counts = [
        (
            Column("step", "integer", "", "User step, from 1; a key"),
            np.arange(1, len(followed.values) + 1),
        ),
        (
            Column(
                "time_s", "number", "s", "Since the recording's first moment, at the step's end"
            ),
            followed.times_s,
        ),
    ]
    values = np.concatenate(parts, axis=1, dtype=np.float32)
    return number_table(one.path.name, counts, values, columns)


def _forces(one: Tracked) -> NDArray[np.float64]:
    """Return the force of each actuator of the body, (N, nu); 0 for those without a column."""
    model, names = one.body.physics_model, [column.name for column in one.followed.columns]
    forces = np.zeros((len(one.followed.values), model.nu))
    for actuator in range(model.nu):
        name = f"force_{model.actuator(actuator).name}"
        if name in names:
            forces[:, actuator] = one.followed.values[:, names.index(name)]
    return forces


def film(one: Tracked, file: Path) -> Path:
    """Film how the body followed, muscles coloured by their activations: skin to red.

    Args:
        one: the recording.
        file: the MP4 file.
    """
    from sim2vr_harness.play.film import Film
    from sim2vr_harness.users.rendering import UserRenderer

    followed = one.followed
    made = Film(file, *_FILM_SIZE, fps=len(followed.values) / followed.times_s[-1])
    try:
        with UserRenderer(one.body, *_FILM_SIZE) as renderer:
            camera = "side" if "side" in renderer.cameras else renderer.cameras[0]
            for qpos, activations in zip(followed.qpos, followed.activations, strict=True):
                made.add(renderer.render(qpos, camera=camera, activations=activations))
    except BaseException:
        made.discard()
        raise
    return made.finish()


# --- sentences and rows of tables -----------------------------------------------------------------

_CUT_SHORT_M = 0.05
"""Error in one of twenty steps from which the hands miss the struck targets, m."""


def facts_of(one: Tracked) -> list[str]:
    """Return lines on the recording, the body, its registration, and effort and fatigue."""
    first, last = one.followed.passes[0], len(one.followed.passes)
    lines = [
        f"{one.path.name}: {one.path.duration_s:.1f} s, followed by {one.body.name} "
        f"({_size(one)}), {last} {'goes' if last > 1 else 'go'}"
    ]
    if last > 1:
        lines.append(
            f"  motor layer alone: median {1e3 * first.median_m:.0f} mm, 95 % "
            f"{1e3 * first.most_m:.0f} mm; with planned muscles, below"
        )
    lines += [f"  {note}" for note in one.placement.notes]
    summary = one.summary()
    fatigue = (
        "" if one.fatigued is None else f", {100 * one.fatigued:.1f} % of motor units fatigued"
    )
    lines.append(
        f"  effort {summary['effort']:.2f} ({summary['effort_per_s']:.3f} per s), mean activation "
        f"{one.followed.activations.mean() if one.muscles else 0.0:.3f}{fatigue}"
    )
    # Hands whose fastest strokes the body does not follow (docs/reference/tools.md, "Track").
    helps = []
    if not one.settings.refined:
        helps.append("without --no-refine")
    if one.muscles:
        helps.append("--set env.user.person.strength=1.5")
    mending = f"; closer, perhaps, {' or '.join(helps)} (docs/reference/tools.md)" if helps else ""
    cut_short = [
        f"{hand.hand.removeprefix('controller_')} hand: one step in twenty is more than "
        f"{1e3 * hand.reachable_most_m:.0f} mm off within reach. Its fastest strokes are cut "
        f"short, and the load of those moments is underestimated{mending}"
        for hand in one.hands
        if hand.reachable_most_m is not None and hand.reachable_most_m > _CUT_SHORT_M
    ]
    return lines + [f"  {note}" for note in cut_short]


def _size(one: Tracked) -> str:
    if one.estimated:
        return f"cut to {one.stature_m:.2f} m, estimated from the head's height while standing"
    if one.stature_m is not None:
        return f"cut to {one.stature_m:.2f} m"
    height = head_height_m(one.path)
    if height is not None and height < STANDING_M:
        return f"own size: a head at {height:.2f} m, sitting, tells no stature; --stature does"
    return "own size"


def hand_rows(one: Tracked) -> list[list[str]]:
    """Head and rows: errors, and how much is beyond reach."""
    head = [
        "hand",
        "median",
        "95 %",
        f"beyond reach by > {1e3 * REACHED_M:.0f} mm",
        "median within reach",
        "95 % within reach",
    ]
    return [
        head,
        *(
            [
                hand.hand.removeprefix("controller_"),
                f"{1e3 * hand.median_m:.1f}",
                f"{1e3 * hand.most_m:.1f}",
                f"{100 * hand.unreachable:.1f} %",
                _mm(hand.reachable_median_m),
                _mm(hand.reachable_most_m),
            ]
            for hand in one.hands
        ),
    ]


def muscle_rows(one: Tracked, most: int) -> list[list[str]]:
    """Head and rows: activation and fatigue of the most active muscles."""
    return [
        ["muscle", "mean activation", "95 % below", "fatigued at the end"],
        *(
            [
                load.muscle,
                f"{load.mean:.3f}",
                f"{load.most:.3f}",
                "-" if load.fatigued is None else f"{100 * load.fatigued:.1f} %",
            ]
            for load in one.muscles[:most]
        ),
    ]


def outcome_rows(one: Tracked) -> list[list[str]]:
    """Return head and rows of the round's outcomes, by player."""
    names = {
        "person": "the person",
        "tracked": "the body's hand, turned as the person's",
        "tracked pose": "the body's hand, turned as it is",
    }
    return [
        ["who", "targets", "hits", "misses", "too slow", "hit rate"],
        *(
            [
                names.get(who, who),
                *(str(n) for n in (found.targets, found.hits, found.misses, found.contacts)),
                "-" if found.hit_rate is None else f"{found.hit_rate:.3f}",
            ]
            for who, found in one.outcomes.items()
        ),
    ]


def _mm(value_m: float | None) -> str:
    return "-" if value_m is None else f"{1e3 * value_m:.1f}"
