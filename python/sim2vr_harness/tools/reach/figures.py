"""The body in what it can reach: a picture, and a film that goes around."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from sim2vr_harness.base.files import naming
from sim2vr_harness.client import AppScene, SceneMesh, SceneObject
from sim2vr_harness.client.frames import position_to_app
from sim2vr_harness.play.film import Film, PlainLooks
from sim2vr_harness.tools.reach.measuring import Measured
from sim2vr_harness.tools.reach.shell import shell
from sim2vr_harness.users.rendering import OrbitView, UserRenderer

_PICTURE, _FILM = (1280, 720), (640, 480)
_FRAMES, _FPS = 90, 18.0
_BALL_M = 0.025
_ROOM, _INSIDE, _OUTSIDE = (
    (0.16, 0.45, 0.85, 0.20),
    (0.10, 0.65, 0.20, 1.0),
    (0.85, 0.10, 0.10, 1.0),
)
_STILL = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])


def write_picture(found: Measured, file: Path) -> Path:
    """Write a PNG file: the body from two sides, what it reaches, targets, a line of words."""
    views, things = [], _things(found)
    with UserRenderer(found.body, _PICTURE[0] // 2, _PICTURE[1]) as renderer:
        for azimuth in (150.0, 60.0):
            views.append(_draw(renderer, found, things, azimuth))
    image = Image.fromarray(np.concatenate(views, axis=1))
    draw = ImageDraw.Draw(image)
    draw.rectangle((0, 0, _PICTURE[0], 40), fill=(24, 26, 30))
    draw.text((14, 20), caption(found), (236, 236, 236), ImageFont.load_default(19), anchor="lm")
    with naming(file):
        image.save(file)
    return file


def write_turntable(found: Measured, file: Path) -> Path:
    """Write an MP4 film that goes around once, in five seconds."""
    film, things = Film(file, *_FILM, _FPS), _things(found)
    try:
        looks: Any = PlainLooks(found.body)
        with UserRenderer(looks, *_FILM) as renderer:
            for azimuth in np.linspace(0.0, 360.0, _FRAMES, endpoint=False):
                film.add(_draw(renderer, found, things, float(azimuth)))
    except BaseException:
        film.discard()
        raise
    return film.finish()


def caption(found: Measured) -> str:
    """Return what there is to say in a line."""
    text = f"{found.body.name}, {found.point.part}: {found.volume.litres:,.0f} litres within reach"
    if not found.targets:
        return text
    inside = len(found.targets) - len(found.missed)
    return f"{text}, {inside} of {len(found.targets)} targets"


def _draw(
    renderer: UserRenderer, found: Measured, things: AppScene, azimuth_deg: float
) -> NDArray[np.uint8]:
    x, y, z = found.reach.points.mean(axis=0).tolist()
    view = OrbitView((0.5 * x, 0.5 * y, 0.85 * z), 2.6, azimuth_deg, -14.0)
    qpos = found.body.coupled_qpos(_rest(found))
    return renderer.render(qpos, view, scene=things)


def _rest(found: Measured) -> NDArray[np.float64]:
    body = found.body
    posture = [body.reset_rule.posture.get(joint, 0.0) for joint in body.independent_joints]
    clipped: NDArray[np.float64] = np.clip(np.array(posture), *body.joint_ranges.T)
    return clipped


def _things(found: Measured) -> AppScene:
    """The room within reach and the targets, as objects of an app."""
    vertices, triangles = shell(found.volume)
    room = SceneMesh("reach", position_to_app(vertices).astype(np.float32), triangles[:, ::-1])
    objects = [_object(0, 1, np.zeros(3), 1.0, _ROOM)]
    for target, verdict in zip(found.targets, found.verdicts, strict=True):
        color = _INSIDE if verdict.inside else _OUTSIDE
        objects.append(_object(1, len(objects) + 1, target.place_m, _BALL_M, color))
    # What is seen through the room has to be drawn before it.
    return AppScene(tuple(objects[1:] + objects[:1]), (room, _ball()))


def _object(
    mesh: int, number: int, place_m: NDArray[np.float64], size: float, color: tuple[float, ...]
) -> SceneObject:
    pose = _STILL.copy()
    pose[:3] = place_m
    rgba = np.array(color, np.float32)
    return SceneObject(number, "reach", 0, mesh, pose, np.full(3, size), rgba, mesh == 1)


def _ball() -> SceneMesh:
    """A ball of radius 1 out of twice-divided triangles of an octahedron."""
    corners = np.concatenate([np.eye(3), -np.eye(3)])
    signs = [(0, 1, 2), (1, 3, 2), (3, 4, 2), (4, 0, 2), (1, 0, 5), (3, 1, 5), (4, 3, 5), (0, 4, 5)]
    faces = corners[np.array(signs)]
    for _ in range(2):
        a, b, c = faces[:, 0], faces[:, 1], faces[:, 2]
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        faces = np.concatenate([np.stack(part, axis=1) for part in parts])
    points = faces.reshape(-1, 3)
    points = points / np.linalg.norm(points, axis=1)[:, None]
    return SceneMesh("ball", points.astype(np.float32), np.arange(len(points)).reshape(-1, 3))
