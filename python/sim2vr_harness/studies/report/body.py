"""Muscles and motors: who tires, who works, drawn on the body that played."""

import base64
import io
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.figures.figure import Figure, Heat, Layer, Line, Panel, colour_of
from sim2vr_harness.play.exertion import muscles_by_part
from sim2vr_harness.play.fatigue import full_name
from sim2vr_harness.play.users import name_of
from sim2vr_harness.policies.store import TrainedUser, find_user
from sim2vr_harness.studies.report.source import Group, ReportSource
from sim2vr_harness.users import Body
from sim2vr_harness.users.rendering import OrbitView

FloatArray = NDArray[np.float64]

_SIZE = (420, 420)
_MOST_PICTURES = 15
_ARM_VIEW_M = (0.39, 1.36)
"""Heights that the body's own view of its arms shows, in the arm's plane."""
_HAND_M = 0.15
"""Of a hand with its controller above the hand's origin."""
_OVER_TIME = 40
_PREFIXES = (
    ("most_fatigued_", "largest share of fatigued motor units"),
    ("act_", "mean activation"),
    ("force_", "mean torque, without its sign (Nm)"),
)
"""Columns of a muscle's or motor's load; the first that exists is used."""


@dataclass(frozen=True)
class Load:
    """Mean load of each muscle or motor of a group.

    Attributes:
        names: Names of M muscles or motors.
        values: (M,) means over rounds.
        what: The quantity in words, with its unit.
        fatigue: True if the load is fatigue.
    """

    names: tuple[str, ...]
    values: FloatArray
    what: str
    fatigue: bool


@dataclass(frozen=True)
class BodyPicture:
    """The body in its usual posture, muscles coloured by their load.

    Attributes:
        label: Of the group.
        png: Base64.
        highest: What the strongest colour stands for.
    """

    label: str
    png: str
    highest: float


def load_of(group: Group) -> Load | None:
    """Return how much every muscle did, mean over rounds; None where steps do not tell."""
    known = group.columns("steps")
    for prefix, what in _PREFIXES:
        columns = [name for name in known if name.startswith(prefix)]
        if not columns:
            continue
        rounds = []
        for rows in group.moments("steps", columns):
            values = rows[columns].to_numpy(np.float64)
            # The largest share so far is the round's at its end.
            last = prefix == "most_fatigued_"
            rounds.append(values[-1] if last else np.abs(values).mean(axis=0))
        if rounds:
            names = tuple(name.removeprefix(prefix) for name in columns)
            return Load(names, np.mean(rounds, axis=0), what, prefix == "most_fatigued_")
    return None


def trained_users_of(source: ReportSource) -> Iterator[tuple[str, TrainedUser, Body]]:
    """Yield the users that played, by the tables' names, as far as they are found again."""
    wanted = set(source.users)
    for place in dict.fromkeys(_places_of_users(source)):
        if not wanted:
            return
        try:
            user = find_user(place)
            body = user.env.body
        except (InputError, ValueError, OSError):
            continue
        name = name_of(user)
        if name in wanted:
            wanted.remove(name)
            yield name, user, body


def _places_of_users(source: ReportSource) -> Iterator[str]:
    """Yield places of users: shipped ones, those that the study names or trained, its run."""
    for user in source.users:
        yield f"pretrained:{user}"
    for settings in (source.planned.get("fixed", {}), *_levels(source)):
        if isinstance(settings.get("user"), str):
            yield settings["user"]
    yield from sorted(str(run) for run in source.root.glob("trainings/*"))
    yield from map(str, source.root.resolve().parents[:3])


def _levels(source: ReportSource) -> Iterator[dict[str, Any]]:
    for factor in source.planned.get("factors", {}).values():
        for value in factor["levels"].values():
            yield value if isinstance(value, dict) else {factor.get("key"): value}


def body_with(bodies: Iterable[Body], loads: Sequence[Load | None]) -> Body | None:
    """Return the first body that has the muscles and motors of the loads, the same in all."""
    names = {load.names for load in loads if load is not None}
    if len(names) != 1:
        return None
    wanted = set(next(iter(names)))
    return next((b for b in bodies if wanted <= {*b.muscles, *b.action_names}), None)


def figures_of_body(
    source: ReportSource, loads: Sequence[Load | None], body: Body | None
) -> Iterator[Figure]:
    """Yield loads by muscle, by part of the body and over time."""
    told = [(g, load) for g, load in zip(source.groups, loads, strict=True) if load is not None]
    if not told or len({load.names for _, load in told}) != 1:
        return
    first = told[0][1]
    labels = [group.label for group, _ in told]
    of_parts = {} if body is None else muscles_by_part(body, first.names)
    parts = {full_name(part): own for part, own in of_parts.items() if f"{part}_r" not in of_parts}
    order = np.argsort(-np.mean([load.values for _, load in told], axis=0), kind="stable")
    high = float(max(load.values.max() for _, load in told)) or 1.0
    rows = [full_name(first.names[i]) for i in order]
    values = [[float(load.values[i]) for _, load in told] for i in order]
    panels = [Panel(f"Each: {first.what}", [Heat(values, labels, rows, 0.0, high)])]
    if parts:
        table = [[float(load.values[own].mean()) for _, load in told] for own in parts.values()]
        heat = Heat(table, labels, list(parts), 0.0, high)
        panels.append(Panel("By part of the body (mean)", [heat]))
    over_time = list(_over_time(source.groups))
    if over_time:
        panels.append(
            Panel("Over the round, mean of the muscles", over_time, "time (s)",
                  "proportion of fatigued motor units", legend=True)
        )  # fmt: skip
    kind = "Muscle fatigue" if first.fatigue else "Load"
    caption = "Means over rounds; the most loaded first." + (
        " A muscle counts to every part of the body that it moves, so the proportions of parts "
        "may add up to more than 1."
        if parts
        else ""
    )
    yield Figure("body", f"Body: {kind.lower()}", caption, panels)


def _over_time(groups: Sequence[Group]) -> Iterator[Layer]:
    for index, group in enumerate(groups):
        columns = [name for name in group.columns("steps") if name.startswith("fatigued_")]
        curves = [
            (rows["time_s"].to_numpy(np.float64), rows[columns].to_numpy(np.float64).mean(axis=1))
            for rows in group.moments("steps", columns)
        ]
        if curves:
            end = min(times[-1] for times, _ in curves)
            at = np.linspace(curves[0][0][0], end, _OVER_TIME)
            mean = np.mean([np.interp(at, *curve) for curve in curves], axis=0)
            yield Line(group.label, at, mean, colour_of(index))


def body_pictures(
    groups: Sequence[Group], loads: Sequence[Load | None], body: Body | None
) -> list[BodyPicture]:
    """Draw the body, muscles coloured by their load, a picture per group.

    Returns:
        Nothing for bodies without muscles, and where no OpenGL platform works.
    """
    from sim2vr_harness.users.rendering import RenderingError, UserRenderer

    told = [(g, load) for g, load in zip(groups, loads, strict=True) if load is not None]
    if body is None or not told or not set(body.muscles) <= set(told[0][1].names):
        return []
    highest = float(max(load.values.max() for _, load in told))
    if highest <= 0:
        return []
    found = []
    told = told[:_MOST_PICTURES]
    postures = [_posture(group, body) for group, _ in told]
    view = _view_of(body, postures)
    try:
        with UserRenderer(body, *_SIZE) as renderer:
            for (group, load), posture in zip(told, postures, strict=True):
                share = dict(zip(load.names, load.values / highest, strict=True))
                colours = np.array([share[name] for name in body.muscles])
                picture = renderer.render(posture, view, colours)
                found.append(BodyPicture(group.label, _png(picture), highest))
    except RenderingError:
        return []
    return found


def _view_of(body: Body, postures: Sequence[FloatArray]) -> str | OrbitView:
    """The body's own view of its arms, or one from farther off that holds the highest hand, too."""
    data, top = mujoco.MjData(body.model), 0.0
    for posture in postures:
        data.qpos[:] = posture
        mujoco.mj_kinematics(body.model, data)
        top = max(top, float(data.xpos[:, 2].max()) + _HAND_M)
    if top <= _ARM_VIEW_M[1]:
        return "arm"
    half = (top - _ARM_VIEW_M[0]) / 2
    distance = half / np.tan(np.radians(body.model.vis.global_.fovy / 2))
    return OrbitView((0.10, -0.14, top - half), float(distance), 130.0, -11.5)


def _posture(group: Group, body: Body) -> FloatArray:
    """The posture of a step in the middle of the first round; the body's own without steps."""
    model = body.model
    qpos = np.array(model.qpos0, dtype=np.float64)
    columns = [name for name in group.columns("steps") if name.startswith("q_")]
    for rows in group.moments("steps", columns)[:1]:
        row = rows[columns].to_numpy(np.float64)
        # A real moment: medians joint by joint need not be a posture of a coupled shoulder.
        nearest = int(np.argmin(np.abs(row - np.median(row, axis=0)).sum(axis=1)))
        for name, value in zip(columns, row[nearest], strict=True):
            joint = name.removeprefix("q_")
            if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, joint) >= 0:
                qpos[model.joint(joint).qposadr[0]] = value
    return qpos


def _png(picture: NDArray[np.uint8]) -> str:
    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(picture).save(stream, "PNG", optimize=True)
    return base64.b64encode(stream.getvalue()).decode()
