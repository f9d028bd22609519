"""Play in the browser, by viser: one scene to walk around in, and what drives it beside it."""

import contextlib
import io
import logging
import socket
import time
from collections.abc import Callable
from functools import partial
from typing import Any
from urllib.parse import urlsplit

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.optional import needed
from sim2vr_harness.client.frames import (
    pose_to_app,
    pose_to_mujoco,
)
from sim2vr_harness.tools.gate import Gate, Refused
from sim2vr_harness.tools.watch.frames import Hands, Playlist, ViewerFrame
from sim2vr_harness.tools.watch.playback import SPEEDS, Playback
from sim2vr_harness.tools.watch.shapes import Poser, body_shapes

_LAST_EVENTS = 8
_MOST_WANTED = 100
"""Presses that wait for the next moment; more of them are dropped."""
_LIGHTEST = 0.995
_SEATED_M, _BESIDE_M = (0.3, -0.05, 0.85), (-1.2, -1.55, 0.75)
"""MuJoCo's world: the middle of what a seated user does, and from where on it is seen."""
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
"""Turns about axes of the head, app frame: left-handed, so that a turn about y goes right."""
_TURN_RAD = np.radians(5.0)


class ViewerStage:
    """Body and objects of a show in viser's scene, MuJoCo's world.

    Args:
        scene: of a viser server.
        show: whose body.
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
        show: what to show.
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
        """Where to look; it holds the token without which the server sends nothing of the show."""
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
        """Let a person move head and hands: arrows to drag, keys to press."""
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
        """Do what was requested in the browser, let time go by, and draw what changed."""
        changed = False
        while self._wanted:
            changed |= self._wanted.pop(0)()
        if self.playback.tick(seconds) or changed:
            self.draw()

    def run(self, until: Callable[[], bool] = lambda: False) -> None:
        """Go on until interrupted, or ``until`` says so; time goes by once someone is there."""
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
    """Where the things of a moment are, MuJoCo's world: people sit and stand anywhere."""
    places = []
    for one in moment.scene.drawn(player=True):
        position, _, scale = one.in_mujoco()
        if np.max(scale) < _LARGE_M:
            places.append(position)
    return (np.min(places, axis=0) + np.max(places, axis=0)) / 2 if places else otherwise


def open_server(viser: Any, gate: Gate, host: str, port: int) -> Any:
    """Start a viser server that exchanges messages only with pages that pass a gate.

    viser hands out its page, which holds nothing of the show, to everyone. The show and what
    is pressed go over WebSockets; each is checked before its first message.

    Args:
        viser: The package.
        gate: WebSockets that may pass.
        host: Address to listen on.
        port: Port to listen on, or the next one that is free.

    Raises:
        InputError: This version of viser does not tell how a page opened its WebSocket.
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
    """Refuse an address that no one can listen on here; viser would wait for ever."""
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
    there[3:] = _product(step, pose[3:]) if axis[1] else _product(pose[3:], step)
    return there


def _product(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """The turn a after b, x y z w."""
    vector = a[3] * b[:3] + b[3] * a[:3] + np.cross(a[:3], b[:3])
    return np.array([*vector, a[3] * b[3] - a[:3] @ b[:3]])
