"""The reach as a page to turn around, without a network."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.base.optional import needed
from sim2vr_harness.client.frames import position_to_app
from sim2vr_harness.figures.html import save_page, table
from sim2vr_harness.tools.reach.extent import FURTHEST_MARGIN_M
from sim2vr_harness.tools.reach.measuring import Measured
from sim2vr_harness.tools.reach.shell import shell

FloatArray = NDArray[np.float64]

_INSIDE, _OUTSIDE, _ROOM, _SWEPT, _BONES = "#1a9e3f", "#c9211e", "#2a6fd6", "#e08a00", "#444b55"
_SHOWN_EVERY = 4
"""Of the sweep's points, to keep the page small."""


def margin_words(margin_m: float) -> str:
    """Return a margin for people: ``inside, 3.2 cm to spare``."""
    if margin_m >= FURTHEST_MARGIN_M:
        return f"inside, more than {100 * FURTHEST_MARGIN_M:.0f} cm to spare"
    if margin_m >= 0.0:
        return f"inside, {100 * margin_m:.1f} cm to spare"
    return f"outside by {-100 * margin_m:.1f} cm"


def write_page(found: Measured, file: Path) -> Path:
    """Write the page.

    Raises:
        InputError: Plotly is not installed.
    """
    names = found.missed
    low, high = found.extent_m
    words = (
        f"<p>Everywhere that <b>{found.point.part}</b> of <b>{found.body.name}</b> can be brought "
        f"within the limits of {len(found.reach.linkage.joints)} joints: "
        f"{found.volume.litres:,.0f} litres, from {low[0]:.2f} to {high[0]:.2f} m to the right, "
        f"{low[1]:.2f} to {high[1]:.2f} m up and {low[2]:.2f} to {high[2]:.2f} m ahead. Origin: "
        "the floor below the body. Collisions with oneself and strength do not count.</p>"
    )
    parts: list[str | Any] = [words]
    if found.targets:
        verdict = (
            f"{len(names)} of {len(found.targets)} targets cannot be reached"
            if names
            else f"All {len(found.targets)} targets can be reached"
        )
        parts.append(f"<p><b>{verdict}.</b></p>")
    parts.append(_figure(found))
    if found.targets:
        parts += ["<h2>Targets</h2>", _table(found)]
    title = f"Reach of {found.body.name}, {found.point.part}"
    return save_page(file, title, parts)


def _table(found: Measured) -> str:
    rows, bad = [], []
    for i, (target, verdict) in enumerate(zip(found.targets, found.verdicts, strict=True)):
        place = [f"{value:.3f}" for value in target.place_m]
        rows.append([target.name, *place, margin_words(verdict.margin_m)])
        if not verdict.inside:
            bad.append(i)
    return table(["Target", "Right (m)", "Up (m)", "Ahead (m)", "Within reach"], rows, bad)


def _axes(points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Right, ahead, up of points (N, 3) in MuJoCo's world, for a figure whose z is up."""
    right, up, ahead = position_to_app(points).round(4).T
    return right, ahead, up


def _figure(found: Measured) -> Any:
    go = needed("plotly.graph_objects", "studies", "--out")
    vertices, triangles = shell(found.volume)
    x, y, z = _axes(vertices)
    i, j, k = triangles.T
    figure = go.Figure()
    room = {"color": _ROOM, "opacity": 0.22, "name": "within reach", "showlegend": True}
    figure.add_trace(go.Mesh3d(x=x, y=y, z=z, i=i, j=j, k=k, hoverinfo="skip", **room))
    x, y, z = _axes(found.sweep.points[::_SHOWN_EVERY])
    swept = " x ".join(found.sweep.joints)
    dots = {"mode": "markers", "marker": {"size": 1.6, "color": _SWEPT}, "hoverinfo": "skip"}
    figure.add_trace(go.Scatter3d(x=x, y=y, z=z, name=f"sweep of {swept}", **dots))
    right, ahead, up = _bones(found)
    line = {"color": _BONES, "width": 6}
    figure.add_trace(
        go.Scatter3d(
            x=right, y=ahead, z=up, mode="lines", line=line, name="the body", hoverinfo="skip"
        )
    )
    for inside, color, label in ((True, _INSIDE, "reached"), (False, _OUTSIDE, "not reached")):
        _add_targets(go, figure, found, inside, color, label)
    figure.update_layout(
        height=640,
        margin={"l": 0, "r": 0, "t": 0, "b": 0},
        legend={"orientation": "h", "y": 0.0, "yanchor": "top"},
        scene={
            "aspectmode": "data",
            "xaxis_title": "right (m)",
            "yaxis_title": "ahead (m)",
            "zaxis_title": "up (m)",
            "camera": {"eye": {"x": 1.5, "y": -1.5, "z": 0.8}},
        },
    )
    return figure


def _add_targets(
    go: Any, figure: Any, found: Measured, inside: bool, color: str, label: str
) -> None:
    chosen = [
        (target, verdict)
        for target, verdict in zip(found.targets, found.verdicts, strict=True)
        if verdict.inside == inside
    ]
    if not chosen:
        return
    right, up, ahead = np.array([target.place_m for target, _ in chosen]).T
    texts = [f"{target.name}: {margin_words(verdict.margin_m)}" for target, verdict in chosen]
    marker = {"size": 5, "color": color, "line": {"width": 1, "color": "white"}}
    figure.add_trace(
        go.Scatter3d(
            x=right,
            y=ahead,
            z=up,
            mode="markers",
            marker=marker,
            name=f"targets {label}",
            text=texts,
            hovertemplate="%{text}<extra></extra>",
        )
    )


def _bones(found: Measured) -> tuple[list[float | None], ...]:
    """Lines between the body's parts in the posture that episodes start near."""
    body, model = found.body, found.body.physics_model
    data = mujoco.MjData(model)
    rest = np.array([body.reset_rule.posture.get(name, 0.0) for name in body.independent_joints])
    data.qpos[:] = body.coupled_qpos(np.clip(rest, *body.joint_ranges.T))
    mujoco.mj_kinematics(model, data)
    places = np.stack(_axes(np.array(data.xpos)), axis=1).tolist()
    lines: list[list[float | None]] = []
    for part in range(1, model.nbody):
        above = int(model.body_parentid[part])
        if above:
            lines += [places[above], places[part], [None] * 3]
    x, y, z = (list(column) for column in zip(*lines, strict=True))
    return x, y, z
