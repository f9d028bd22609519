"""A recording of a show for Rerun's viewer."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from sim2vr_harness.base.optional import needed
from sim2vr_harness.tools.watch.frames import Playlist, ViewerFrame
from sim2vr_harness.tools.watch.shapes import Poser, body_shapes


def write_rerun(
    show: Playlist, file: Path, *, on_progress: Callable[[float], None] = lambda time_s: None
) -> Path:
    """Play a show to its end and write what there was to see, by game time.

    Args:
        show: the show.
        file: ``*.rrd``.
        on_progress: called with the game's time, s.

    Raises:
        InputError: Rerun is not installed.
    """
    rerun = needed("rerun", "rerun", "--rerun")
    stream = rerun.RecordingStream("sim2vr", make_default=False)
    stream.save(str(file))
    stream.log("/", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    poser = None
    if show.body is not None:
        poser = Poser(show.body)
        for shape in body_shapes(show.body):
            mesh = rerun.Mesh3D(
                vertex_positions=shape.vertices.astype(np.float32),
                triangle_indices=shape.faces.astype(np.uint32),
                albedo_factor=[*shape.color, 255],
            )
            stream.log(f"body/{shape.part}/{shape.name}", mesh, static=True)
    objects = _Objects(rerun, stream)
    for moment in show.moments():
        stream.set_time("game", duration=moment.time_s)
        if poser is not None:
            _log_body(rerun, stream, poser, moment)
        objects.log(moment, player=show.body is None)
        stream.log("headset", rerun.Image(moment.headset).compress(jpeg_quality=85))
        for line in moment.events:
            stream.log("events", rerun.TextLog(line))
        for name, value in {**moment.bars, **moment.numbers}.items():
            stream.log(f"numbers/{name}", rerun.Scalars(value))
        on_progress(moment.time_s)
    stream.flush()
    return file


def _log_body(rerun: Any, stream: Any, poser: Poser, moment: ViewerFrame) -> None:
    if moment.qpos is None:
        return
    activations = np.zeros(0) if moment.activations is None else moment.activations
    posture = poser.pose(moment.qpos, activations)
    for part, (place, quat) in enumerate(zip(posture.positions, posture.quats, strict=True)):
        turn = rerun.Quaternion(xyzw=np.roll(quat, -1))
        stream.log(f"body/{part}", rerun.Transform3D(translation=place, rotation=turn))
    if len(posture.muscles):
        lines = rerun.LineStrips3D(posture.muscles, colors=posture.colors[:, 0], radii=0.004)
        stream.log("muscles", lines)


class _Objects:
    """What the app shows: shape, colour and place of an object are written when they change."""

    def __init__(self, rerun: Any, stream: Any) -> None:
        self._rerun, self._stream = rerun, stream
        self._known: dict[str, dict[str, Any]] = {}
        """Of what is there now."""

    def log(self, moment: ViewerFrame, player: bool) -> None:
        """Write those of a moment, and clear those that are gone."""
        rerun, stream = self._rerun, self._stream
        counts: dict[str, int] = {}
        here = set()
        for one in moment.scene.drawn(player=player):
            assert one.mesh is not None
            path = f"app/{one.path.replace(' ', '_')}/{one.id}"
            counts[path] = counts.get(path, 0) + 1
            own = f"{path}_{counts[path]}"
            here.add(own)
            known = self._known.setdefault(own, {})
            color = (255 * np.clip(one.color, 0.0, 1.0)).astype(np.uint8)
            if self._changes(known, "mesh", one.mesh):
                vertices, triangles = moment.scene.meshes[one.mesh].in_mujoco()
                mesh = rerun.Mesh3D(
                    vertex_positions=vertices.astype(np.float32),
                    triangle_indices=triangles.astype(np.uint32),
                    albedo_factor=color,
                )
                stream.log(own, mesh)
                known["color"] = bytes(color)
            elif self._changes(known, "color", bytes(color)):
                stream.log(own, rerun.Mesh3D.from_fields(albedo_factor=color))
            position, quat, scale = one.in_mujoco()
            if self._changes(known, "place", np.concatenate([position, quat, scale]).tobytes()):
                turn = rerun.Quaternion(xyzw=np.roll(quat, -1))
                place = rerun.Transform3D(translation=position, rotation=turn, scale=scale)
                stream.log(own, place)  # nothing lies below it that it would move, too
        for gone in self._known.keys() - here:
            stream.log(gone, rerun.Clear(recursive=False))
            del self._known[gone]

    @staticmethod
    def _changes(known: dict[str, Any], what: str, now: Any) -> bool:
        """Take in what an object is like now; whether it was otherwise."""
        before, known[what] = known.get(what), now
        return bool(before != now)
