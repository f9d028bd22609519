"""A film of the worst case: a person tries to get to the target that excludes most."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.audit.acting import Actor
from sim2vr_harness.audit.population import MODEL
from sim2vr_harness.audit.reaching import MIRROR
from sim2vr_harness.audit.summary import Audit
from sim2vr_harness.client import AppScene, SceneMesh, SceneObject
from sim2vr_harness.client.frames import position_to_app, position_to_mujoco
from sim2vr_harness.play.film import Film
from sim2vr_harness.users import load_body
from sim2vr_harness.users.rendering import OrbitView, UserRenderer

FloatArray = NDArray[np.float64]

_SIZE = (640, 480)
_RED, _GREY = (0.7, 0.12, 0.1, 1.0), (0.5, 0.55, 0.6, 1.0)
_HALF_M = 0.04
_TRUNK_M = 0.6
"""Below the head, which the film shows too."""
_AWAY_M, _AWAY = 0.6, 1.1
"""Distance of the camera: so far, and so much of what it shows."""
_AZIMUTH_DEG, _ELEVATION_DEG = 115.0, -12.0


def worst_case(audit: Audit) -> tuple[int, int] | None:
    """Return person and target: the target that fewest reach, and who misses it by most.

    None: everyone reaches everything that takes a hand.
    """
    judged = audit.judged
    hands = np.array([each.how not in ("look", "point") for each in audit.targets])
    missed = np.where(hands, (~judged.reached).mean(axis=0), 0.0)
    target = int(missed.argmax())
    if missed[target] == 0.0:
        return None
    gaps = np.linalg.norm(judged.needed_m[:, target], axis=1) * ~judged.reached[:, target]
    return int(gaps.argmax()), target


def write_film(audit: Audit, file: Path) -> Path | None:
    """Write how the person of the worst case tries it; None: there is no worst case.

    Raises:
        RenderingError: Nothing draws here.
        RuntimeError: ffmpeg cannot be started.
    """
    found = worst_case(audit)
    if found is None:
        return None
    person, column = found
    subject = audit.subjects[person]
    side = MIRROR if subject.mirrored else np.ones(3)
    places = position_to_mujoco(audit.judged.places_m[person]) * side
    places = places - np.array([0.0, 0.0, audit.lifts_m[person]])
    frames: list[tuple[FloatArray, FloatArray]] = []
    Actor(subject, watch=lambda qpos, act: frames.append((qpos, act))).act(
        places[column], np.zeros((0, 0))
    )
    body = load_body(MODEL, person=subject.user.person, torso=True, appearance=True)
    head, place = position_to_mujoco(audit.landmarks_m[0]), places[column]
    view = _view(head - np.array([0.0, 0.0, audit.lifts_m[audit.middle]]), place)
    film = Film(file, *_SIZE, fps=20.0)
    try:
        with UserRenderer(body, *_SIZE) as renderer:
            scene = _scene(places, column)
            for qpos, act in frames:
                film.add(renderer.render(qpos, view, act, scene))
        return film.finish()
    except BaseException:
        film.discard()
        raise


def _view(head: FloatArray, place: FloatArray) -> OrbitView:
    """From the right and a little ahead: head, trunk and target are in the picture."""
    shown = np.stack([head, head - np.array([0.0, 0.0, _TRUNK_M]), place])
    low, high = shown.min(axis=0), shown.max(axis=0)
    x, y, z = ((low + high) / 2.0).tolist()
    distance = _AWAY_M + _AWAY * float(np.linalg.norm(high - low))
    return OrbitView((x, y, z), distance, _AZIMUTH_DEG, _ELEVATION_DEG)


def _scene(places: FloatArray, column: int) -> AppScene:
    """The targets as small octahedra, the one that counts in red."""
    corners = _HALF_M * np.concatenate([np.eye(3), -np.eye(3)]).astype(np.float32)
    faces = []
    for x in (0, 3):
        for y in (1, 4):
            for z in (2, 5):
                signs = (x < 3) ^ (y < 3) ^ (z < 3)
                faces.append((x, z, y) if signs else (x, y, z))
    mesh = SceneMesh("target", corners, np.array(faces, dtype=np.int64))
    objects = tuple(
        SceneObject(
            number,
            f"target {number}",
            0,
            0,
            np.r_[position_to_app(place), 0.0, 0.0, 0.0, 1.0],
            np.ones(3),
            np.array(_RED if number == column else _GREY, dtype=np.float32),
            unlit=True,
        )
        for number, place in enumerate(places)
    )
    return AppScene(objects, (mesh,))
