"""Play in the browser, by viser: a 3D scene, with controls and plots beside it."""

import contextlib
import io
import logging
import socket
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any
from urllib.parse import urlsplit

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.optional import needed
from sim2vr_harness.base.rotations import product
from sim2vr_harness.client.frames import (
    pose_to_app,
    pose_to_mujoco,
)
from sim2vr_harness.tools.gate import Gate, Refused
from sim2vr_harness.tools.watch.frames import Hands, Playlist, ViewerFrame
from sim2vr_harness.users import Body

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_SEGMENTS = 12
_TILTS = np.pi * np.array([0.0, 0.15, 0.3, 0.44])
"""Of the rings of half a ball."""
_RELAXED, _ACTIVE = np.array([204, 168, 145]), np.array([224, 31, 26])
"""As in pictures (``users/appearance.py``)."""
_LEAST_ALPHA = 0.05
_SEEN_GROUPS = (0, 1, 2)


@dataclass(frozen=True)
class BodyShape:
    """Shape of a body part in one colour.

    Attributes:
        part: number of the part in the model.
        name: unique.
        vertices: (V, 3) in the part's frame, m.
        faces: (F, 3).
        color: red, green, blue, 0 to 255.
    """

    part: int
    name: str
    vertices: FloatArray
    faces: IntArray
    color: tuple[int, int, int]


@dataclass(frozen=True)
class Posture:
    """Poses of a body's parts, and paths of its muscles.

    Attributes:
        positions: (parts, 3) MuJoCo's world, m.
        quats: (parts, 4) w x y z.
        muscles: (S, 2, 3) ends of the pieces of muscles.
        colors: (S, 2, 3) uint8, skin (relaxed) to red (fully active).
    """

    positions: FloatArray
    quats: FloatArray
    muscles: FloatArray
    colors: NDArray[np.uint8]


class Poser:
    """Works out postures.

    Args:
        body: loaded with `appearance=True`.
    """

    def __init__(self, body: Body) -> None:
        self._model = body.model
        self._data = mujoco.MjData(self._model)
        self._tendon_muscle = np.full(self._model.ntendon, -1)
        for row, name in enumerate(body.muscles):
            actuator = self._model.actuator(name).id
            if self._model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_TENDON:
                self._tendon_muscle[self._model.actuator_trnid[actuator, 0]] = row

    def pose(self, qpos: FloatArray, activations: FloatArray) -> Posture:
        """Return the posture of angles (nq,) and activations (M,) of the muscles."""
        data = self._data
        data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, data)
        mujoco.mj_comPos(self._model, data)
        mujoco.mj_tendon(self._model, data)
        places = np.array(data.wrap_xpos).reshape(-1, 3)
        pieces, colors = [np.empty((0, 2, 3))], [np.empty((0, 2, 3))]
        for tendon in np.flatnonzero(self._tendon_muscle >= 0):
            first, count = int(data.ten_wrapadr[tendon]), int(data.ten_wrapnum[tendon])
            path = places[first : first + count]
            level = float(np.clip(activations[self._tendon_muscle[tendon]], 0.0, 1.0))
            color = _RELAXED + level * (_ACTIVE - _RELAXED)
            pieces.append(np.stack([path[:-1], path[1:]], axis=1))
            colors.append(np.broadcast_to(color, (max(count - 1, 0), 2, 3)))
        return Posture(
            np.array(data.xpos),
            np.array(data.xquat),
            np.concatenate(pieces),
            np.concatenate(colors).astype(np.uint8),
        )


def body_shapes(body: Body) -> list[BodyShape]:
    """Return the shapes of a body that was loaded with `appearance=True`, the floor left out."""
    model = body.model
    parts: dict[tuple[int, tuple[int, int, int]], list[tuple[FloatArray, IntArray]]] = {}
    for geom in range(model.ngeom):
        material = int(model.geom_matid[geom])
        color_rgba = model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]
        rgba = np.asarray(color_rgba, dtype=np.float64)
        if model.geom_group[geom] not in _SEEN_GROUPS or rgba[3] < _LEAST_ALPHA:
            continue
        shape = _shape(model, geom)
        if shape is None:
            continue
        vertices, faces = shape
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
        placed = vertices @ turn.reshape(3, 3).T + model.geom_pos[geom]
        red, green, blue = (int(255 * channel) for channel in rgba[:3])
        parts.setdefault((int(model.geom_bodyid[geom]), (red, green, blue)), []).append(
            (placed, faces)
        )
    shapes = []
    for (part, color), own in parts.items():
        starts = np.cumsum([0, *(len(vertices) for vertices, _ in own)])
        faces = np.concatenate([f + start for (_, f), start in zip(own, starts, strict=False)])
        vertices = np.concatenate([vertices for vertices, _ in own])
        name = f"{model.body(part).name}_{bytes(color).hex()}"
        shapes.append(BodyShape(part, name, vertices, faces, color))
    return shapes


def _shape(model: mujoco.MjModel, geom: int) -> tuple[FloatArray, IntArray] | None:
    kind, size = mujoco.mjtGeom(int(model.geom_type[geom])), model.geom_size[geom]
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = int(model.geom_dataid[geom])
        first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        face, faces = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
        vertices = np.array(model.mesh_vert[first : first + count], dtype=np.float64)
        return vertices, np.array(model.mesh_face[face : face + faces], dtype=np.int64)
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        ring = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], dtype=np.float64)
        return _rings([(z, ring) for z in (-1.0, 1.0)], size)
    angles = 2.0 * np.pi * np.arange(_SEGMENTS) / _SEGMENTS
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    if kind in (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_ELLIPSOID):
        radii = np.full(3, size[0]) if kind == mujoco.mjtGeom.mjGEOM_SPHERE else size
        return _rings([(np.sin(a), np.cos(a) * circle) for a in (*-_TILTS[:0:-1], *_TILTS)], radii)
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return _rings([(-1.0, circle), (1.0, circle)], [size[0], size[0], size[1]])
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        half = size[1] / size[0]
        upper = [(np.sin(a) + half, np.cos(a) * circle) for a in _TILTS]
        lower = [(-height, ring) for height, ring in upper[::-1]]
        return _rings([*lower, *upper], [size[0]] * 3)
    return None  # planes: the viewer has a floor


def _rings(
    rings: list[tuple[float, FloatArray]], scale: FloatArray | list[float]
) -> tuple[FloatArray, IntArray]:
    """Return a closed skin over rings of as many corners, (height, (K, 2)) from low to high."""
    count = len(rings[0][1])
    vertices = [np.column_stack([ring, np.full(count, height)]) for height, ring in rings]
    ids = np.arange(len(rings) * count).reshape(len(rings), count)
    here, beside = ids, np.roll(ids, -1, axis=1)
    faces = [
        np.stack([here[:-1], beside[:-1], beside[1:]], axis=-1).reshape(-1, 3),
        np.stack([here[:-1], beside[1:], here[1:]], axis=-1).reshape(-1, 3),
    ]
    for ring in (ids[0, ::-1], ids[-1]):
        faces.append(
            np.stack([np.full(count - 2, ring[0]), ring[1:-1], ring[2:]], axis=-1).reshape(-1, 3)
        )
    return np.concatenate(vertices) * np.asarray(scale), np.concatenate(faces)


SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0)


class Playback:
    """Plays a show's frames; new ones are made when they are needed, and kept.

    Args:
        show: the source of frames.

    Attributes:
        moments: frames made so far.
        at: number of the shown frame; -1: none yet.
        playing: True if time runs.
        speed: game seconds per second.
        over: True if the last frame was made.
    """

    def __init__(self, show: Playlist) -> None:
        self._show = show
        self._source: Iterator[ViewerFrame] | None = None
        self._due = 0.0
        self.moments: list[ViewerFrame] = []
        self.at, self.playing, self.speed, self.over = -1, True, 1.0, False

    @property
    def now(self) -> ViewerFrame | None:
        """The shown frame."""
        return self.moments[self.at] if self.at >= 0 else None

    def tick(self, seconds: float) -> bool:
        """Advance the time; return whether another frame is shown.

        At most one frame is made at a time: if that takes longer than its duration, play is slower.
        """
        if not self.playing or (self.over and self.at == len(self.moments) - 1):
            self._due = 0.0
            return False
        self._due += seconds * self.speed * self._show.frequency_hz
        steps = int(self._due)
        self._due -= steps
        if steps == 0:
            return False
        known = min(steps, len(self.moments) - 1 - self.at)
        if known > 0:
            self.at += known
            return True
        return self.step()

    def step(self) -> bool:
        """Show the next moment; return whether there is one."""
        if self.at + 1 < len(self.moments):
            self.at += 1
            return True
        if self.over:
            return False
        if self._source is None:
            self._source = self._show.moments()
        moment = next(self._source, None)
        if moment is None:
            self.over = True
            return False
        self.moments.append(moment)
        self.at += 1
        return True

    def seek(self, number: int) -> bool:
        """Show a moment that was made; return whether it is another one than before."""
        number = max(0, min(number, len(self.moments) - 1))
        if not self.moments or number == self.at:
            return False
        self.at = number
        return True

    def restart(self) -> None:
        """Start again: with another round if the show is live."""
        self.close()
        self.moments, self.at, self.over = [], -1, False

    def close(self) -> None:
        """Close the resources that the show opened."""
        source, self._source = self._source, None
        if source is not None:
            source.close()  # type: ignore[attr-defined]


_LAST_EVENTS = 8
_MOST_WANTED = 100
"""Presses that wait for the next moment; more of them are dropped."""
_LIGHTEST = 0.995
_SEATED_M, _BESIDE_M = (0.3, -0.05, 0.85), (-1.2, -1.55, 0.75)
"""Middle of a seated user's movements, and position of the camera, MuJoCo's world."""
_LARGE_M = 3.0
"""Objects that are larger are floors and skies."""
_KEYS: tuple[tuple[str, str, tuple[float, float, float]], ...] = (
    ("W", "Hand ahead", (0.0, 0.0, 1.0)),
    ("S", "Hand back", (0.0, 0.0, -1.0)),
    ("A", "Hand to the left", (-1.0, 0.0, 0.0)),
    ("D", "Hand to the right", (1.0, 0.0, 0.0)),
    ("E", "Hand up", (0.0, 1.0, 0.0)),
    ("Q", "Hand down", (0.0, -1.0, 0.0)),
)
_STRIDE_M = 0.04
_TURNS: tuple[tuple[str, str, tuple[float, float, float]], ...] = (
    ("arrowleft", "Look left", (0.0, -1.0, 0.0)),
    ("arrowright", "Look right", (0.0, 1.0, 0.0)),
    ("arrowup", "Look up", (-1.0, 0.0, 0.0)),
    ("arrowdown", "Look down", (1.0, 0.0, 0.0)),
)
"""Rotations about axes of the head, app frame: left-handed, so that one about y turns right."""
_TURN_RAD = np.radians(5.0)


class ViewerStage:
    """Body and objects of a show in viser's scene, MuJoCo's world.

    Args:
        scene: of a viser server.
        show: the source of frames.
    """

    def __init__(self, scene: Any, show: Playlist) -> None:
        self._scene, self._show = scene, show
        self._objects: dict[tuple[int, int], tuple[int, Any]] = {}
        self._poser: Poser | None = None
        self._parts: list[tuple[int, Any]] = []
        self._muscles: Any = None
        scene.set_up_direction("+z")
        scene.configure_default_lights(cast_shadow=False)  # browsers without a GPU are slow
        scene.add_grid("/floor", width=6.0, height=6.0, cell_size=0.25, position=(0, 0, -0.01))
        if show.body is not None:
            self._poser = Poser(show.body)
            for shape in body_shapes(show.body):
                handle = scene.add_mesh_simple(
                    f"/body/{shape.name}",
                    shape.vertices.astype(np.float32),
                    shape.faces.astype(np.uint32),
                    color=shape.color,
                    side="double",
                )
                self._parts.append((shape.part, handle))

    def draw(self, moment: ViewerFrame) -> None:
        """Show a moment."""
        if self._poser is not None and moment.qpos is not None:
            self._draw_body(self._poser, moment)
        self._draw_objects(moment)

    def _draw_body(self, poser: Poser, moment: ViewerFrame) -> None:
        assert moment.qpos is not None
        activations = np.zeros(0) if moment.activations is None else moment.activations
        posture = poser.pose(moment.qpos, activations)
        for part, handle in self._parts:
            handle.position, handle.wxyz = posture.positions[part], posture.quats[part]
        if not len(posture.muscles):
            return
        points = posture.muscles.astype(np.float32)
        if self._muscles is None:
            self._muscles = self._scene.add_line_segments(
                "/body/muscles", points, posture.colors, thickness=0.008
            )
        else:
            self._muscles.points, self._muscles.colors = points, posture.colors

    def _draw_objects(self, moment: ViewerFrame) -> None:
        seen: dict[int, int] = {}
        shown = set()
        for one in moment.scene.drawn(player=self._show.body is None):
            assert one.mesh is not None
            key = one.id, seen.get(one.id, 0)
            seen[one.id] = key[1] + 1
            shown.add(key)
            position, quat, scale = one.in_mujoco()
            mesh, handle = self._objects.get(key, (-1, None))
            if mesh != one.mesh:
                if handle is not None:
                    handle.remove()
                vertices, triangles = moment.scene.meshes[one.mesh].in_mujoco()
                handle = self._scene.add_mesh_simple(
                    f"/app/{key[0]}_{key[1]}",
                    vertices.astype(np.float32),
                    triangles.astype(np.uint32),
                    side="double",
                )
                self._objects[key] = one.mesh, handle
            assert handle is not None
            handle.position, handle.wxyz = position, quat
            handle.scale = tuple(scale.tolist())
            handle.color = tuple(int(255 * channel) for channel in one.color[:3])
            opacity = float(one.color[3])
            handle.opacity = None if opacity > _LIGHTEST else opacity
            handle.visible = True
        for key, (_, handle) in self._objects.items():
            if key not in shown:
                handle.visible = False


class Viewer:
    """A server that shows a show to browsers that open its address.

    Args:
        host: address to listen on; this machine alone by default.
        port: of the server.
        shared: whether to open a public tunnel to it.

    Raises:
        InputError: viser is not installed, ``host`` is no address of this machine, or no tunnel
            could be opened.
    """

    def __init__(
        self, show: Playlist, host: str = "127.0.0.1", port: int = 8080, *, shared: bool = False
    ) -> None:
        viser = needed("viser", "watch", "watch")
        _require_own(host)
        self._show, self.playback = show, Playback(show)
        self._gate = Gate(host)
        self._server = open_server(viser, self._gate, host, port)
        place = np.array(_SEATED_M)
        if show.body is None and self.playback.step():
            assert self.playback.now is not None
            place = middle_of(self.playback.now, place)
        self._server.initial_camera.position = tuple((place + _BESIDE_M).tolist())
        self._server.initial_camera.look_at = tuple(place.tolist())
        self._seen = False
        self._stage = ViewerStage(self._server.scene, show)
        self._wanted: list[Callable[[], bool]] = []
        self._bars: dict[str, tuple[Any, Any]] = {}
        self._sliding = False
        self._build()
        if show.hands is not None:
            self._give_hands(show.hands)
        self.draw()
        self.public_address = share(self._server, self._gate) if shared else None

    @property
    def address(self) -> str:
        """Address of the page, with the token without which the server sends no frames."""
        return page_of(self._gate.address(self._server.get_port(), "ws"))

    def _build(self) -> None:
        gui = self._server.gui
        gui.configure_theme(show_logo=False, show_share_button=False)
        gui.main_panel.dock_right()
        gui.set_panel_label(self._show.title[:60])
        self._numbers = gui.add_markdown("Getting ready ...")
        self._image = gui.add_image(np.zeros((160, 240, 3), np.uint8), label="Headset view")
        speeds = {f"{s:g}x": s for s in SPEEDS}
        pause = gui.add_button_group("Play", ("pause", "step", "again"))
        self._speed = gui.add_dropdown("Speed", list(speeds), initial_value="1x")
        self._slider = gui.add_slider("Time (s)", 0.0, 0.1, 0.05, 0.0)
        self._bar_folder = gui.add_folder("Effort and fatigue", visible=False)
        with gui.add_folder("Events"):
            self._events = gui.add_markdown("None yet.")

        def hurry(_event: Any) -> None:
            self.playback.speed = speeds[self._speed.value]

        def seek(event: Any) -> None:
            if event.client is None or self._sliding:
                return  # moved by the play itself
            number = round(self._slider.value * self._show.frequency_hz) - 1
            self._want(partial(self._sought, number))

        pause.on_click(lambda _event: self._ask(pause.value))
        self._speed.on_update(hurry)
        self._slider.on_update(seek)

        for key, label, what in (
            ("space", "Pause or play", "pause"),
            ("enter", "One step", "step"),
        ):
            command = gui.add_command(label, hotkey=key)
            command.on_trigger(lambda _event, what=what: self._ask(what))

    def _ask(self, what: str) -> None:
        self._want(partial(self._pressed, what))

    def _want(self, doing: Callable[[], bool]) -> None:
        if len(self._wanted) < _MOST_WANTED:
            self._wanted.append(doing)

    def _pressed(self, what: str) -> bool:
        if what == "pause":
            self.playback.playing = not self.playback.playing
            return False
        if what == "again":
            self.playback.restart()
            self.playback.playing = True
            return self.playback.step()
        self.playback.playing = False
        return self.playback.step()

    def _sought(self, number: int) -> bool:
        self.playback.playing = False
        return self.playback.seek(number)

    def _give_hands(self, hands: Hands) -> None:
        """Add controls for a person's head and hands: arrows to drag, keys to press."""
        for device in hands.poses:
            position, quat = pose_to_mujoco(hands.poses[device])
            grip = self._server.scene.add_transform_controls(
                f"/hands/{device}", scale=0.25, position=position, wxyz=quat, depth_test=False
            )

            def drag(_event: Any, device: str = device, grip: Any = grip) -> None:
                hands.poses[device] = pose_to_app(grip.position, grip.wxyz)

            grip.on_update(drag)
            self._hotkeys(hands, device, grip)

    def _hotkeys(self, hands: Hands, device: str, grip: Any) -> None:
        keys, change = (_TURNS, turned) if device == "head" else (_KEYS, moved)
        if device == "left_controller":
            return  # by the mouse
        for key, label, way in keys:
            command = self._server.gui.add_command(label, hotkey=key)

            def press(_event: Any, way: tuple[float, float, float] = way) -> None:
                hands.poses[device] = change(hands.poses[device], np.array(way))
                grip.position, grip.wxyz = pose_to_mujoco(hands.poses[device])

            command.on_trigger(press)

    def draw(self) -> None:
        """Show the moment of the playback."""
        moment = self.playback.now
        if moment is None:
            return
        with self._server.atomic():
            self._stage.draw(moment)
            self._image.image = moment.headset
            self._numbers.content = f"**{moment.time_s:.2f} s**   {moment.text}"
            events = [
                line
                for past in self.playback.moments[: self.playback.at + 1]
                for line in past.events
            ]
            last = events[-_LAST_EVENTS:][::-1]
            self._events.content = "\n".join(f"- {line}" for line in last) or "None yet."
            self._bar_folder.visible = bool(moment.bars)
            for name, share in moment.bars.items():
                if name not in self._bars:
                    with self._bar_folder:
                        text = self._server.gui.add_markdown("")
                        self._bars[name] = text, self._server.gui.add_progress_bar(0.0)
                text, bar = self._bars[name]
                text.content = f"{name}: {100.0 * share:.1f} %"
                bar.value = 100.0 * float(np.clip(share, 0.0, 1.0))
            self._sliding = True
            self._slider.max = max(0.1, self.playback.moments[-1].time_s)
            self._slider.value = min(moment.time_s, self._slider.max)
            self._sliding = False

    def turn(self, seconds: float) -> None:
        """Process requests from the browser, advance the time, and draw changes."""
        changed = False
        while self._wanted:
            changed |= self._wanted.pop(0)()
        if self.playback.tick(seconds) or changed:
            self.draw()

    def run(self, until: Callable[[], bool] = lambda: False) -> None:
        """Run until interrupted, or ``until`` returns True; time runs once a page is connected."""
        before = time.monotonic()
        while not until():
            now = time.monotonic()
            self._seen = self._seen or bool(self._server.get_clients())
            self.turn(now - before if self._seen else 0.0)
            before = now
            time.sleep(0.005)

    def close(self) -> None:
        """End the round and the server."""
        self.playback.close()
        self._server.stop()


def middle_of(moment: ViewerFrame, otherwise: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the middle of a frame's objects, MuJoCo's world: users sit and stand anywhere."""
    places = []
    for one in moment.scene.drawn(player=True):
        position, _, scale = one.in_mujoco()
        if np.max(scale) < _LARGE_M:
            places.append(position)
    return (np.min(places, axis=0) + np.max(places, axis=0)) / 2 if places else otherwise


def open_server(viser: Any, gate: Gate, host: str, port: int) -> Any:
    """Start a viser server that exchanges messages only with pages that pass a gate.

    viser sends its page, which contains no frames, to everyone. Frames and inputs go over
    WebSockets; each is checked before its first message.

    Args:
        gate: checks WebSockets.
        host: Address to listen on.
        port: Port to listen on, or the next one that is free.

    Raises:
        InputError: This version of viser does not report how a page opened its WebSocket.
    """
    # Strangers must not fill the terminal with failed handshakes.
    logging.getLogger("websockets.server").setLevel(logging.CRITICAL)
    with contextlib.redirect_stdout(io.StringIO()):  # viser prints an address without the token
        server = viser.ViserServer(host=host, port=port, label="sim2vr", verbose=False)
    sockets = getattr(server, "_websock_server", None)
    connections = getattr(sockets, "_live_connections", None)
    if sockets is None or connections is None:
        server.stop()
        raise InputError("watch", f"viser {viser.__version__}", "viser 1.1")

    async def check(client: Any) -> None:
        connection = connections[client.client_id]
        request, reached = connection.request, str(connection.local_address[0])
        hosts, origins = request.headers.get_all("Host"), request.headers.get_all("Origin")
        try:
            gate.admit(request.path, hosts, origins, reached)
        except Refused as refused:
            del connections[client.client_id]
            await connection.close(1008, str(refused).partition(":")[0])
            raise  # or viser would read what has arrived by now

    sockets.on_client_connect(check)
    sockets.disconnect_all_clients()  # who came before the check
    return server


def share(server: Any, gate: Gate) -> str:
    """Open a public tunnel to a server, and return its address with the token.

    Raises:
        InputError: No tunnel could be opened.
    """
    url = server.request_share_url(verbose=False)
    if url is None:
        raise InputError("--share", "no tunnel from viser's share server", "a network connection")
    name = urlsplit(url).netloc
    gate.accept_name(urlsplit(url).hostname or "")
    return page_of(f"wss://{name}/{gate.token}/")


def page_of(address: str) -> str:
    """Return the address of viser's page that connects to a WebSocket's address."""
    scheme, name = urlsplit(address)[:2]
    return f"{scheme.replace('ws', 'http')}://{name}/?websocket={address.rstrip('/')}"


def _require_own(host: str) -> None:
    """Reject an address that cannot be listened on here; viser would wait forever."""
    try:
        kind, *_, address = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(kind, socket.SOCK_STREAM) as probe:
            probe.bind(address)
    except (OSError, UnicodeError) as error:
        expected = "an address of this machine, such as 127.0.0.1 or 0.0.0.0"
        raise InputError("--host", repr(host), expected) from error


def moved(pose: NDArray[np.float64], way: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a pose (7,) a little further along a way (right, up, ahead)."""
    there = pose.copy()
    there[:3] += _STRIDE_M * way
    return there


def turned(pose: NDArray[np.float64], axis: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a pose (7,) turned a little about one of its own axes; sideways about the vertical."""
    half = 0.5 * _TURN_RAD
    step = np.array([*(np.sin(half) * axis), np.cos(half)])
    there = pose.copy()
    there[3:] = product(step, pose[3:]) if axis[1] else product(pose[3:], step)
    return there
