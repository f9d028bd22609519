"""A WebXR page as an app in lockstep, a look at one, and the transport of pages."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from sim2vr_harness.base.rotations import turned
from sim2vr_harness.client.base import AppReply, Float64Array, Int64Array, OptionValue
from sim2vr_harness.client.devices import DevicePoses, HapticPulse
from sim2vr_harness.client.errors import AppError, AppRefused
from sim2vr_harness.client.foreign import (
    FARTHEST_M,
    FRAME_RATE_HZ,
    VERTICAL_FOV_DEG,
    ForeignApp,
    refuse_logs,
)
from sim2vr_harness.client.runtime import frame_time_ns
from sim2vr_harness.client.scene import AppScene, Observed, Observer, SceneMesh, SceneObject
from sim2vr_harness.client.transport import (
    AppPlace,
    AppSource,
    AppsWanted,
    Transport,
    checked_options,
)
from sim2vr_harness.client.webxr.browser import RENDERERS, Browser, find_browser
from sim2vr_harness.client.webxr.files import PageFiles
from sim2vr_harness.client.webxr.hands import Ray, find_rays
from sim2vr_harness.client.webxr.packages import package_of
from sim2vr_harness.client.webxr.page import PROFILES, SCRIPT_ERRORS, WINDOW_FRAMES, Page
from sim2vr_harness.client.webxr.replies import Box, PageReport, Signs, Thing

_CAPABILITIES = frozenset(
    {"frames", "inputs", "left_controller", "haptics", "two_eyes", "scene", "observers"}
)
_LARGEST_M = 30.0
"""Largest size of an object that people may interact with."""
_NOTHING_MM = 65535
"""Depth of an observer's picture where the page drew nothing."""
_FLOOR_M = 0.02
"""Pictures have a floor of their own."""


_CUBE = SceneMesh(
    "box",
    np.array(
        [(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)], np.float32
    ),
    # Two triangles of each side, clockwise from outside in the app's left-handed frame.
    np.array(
        [
            *([0, 1, 2], [3, 2, 1], [6, 5, 4], [5, 6, 7], [4, 1, 0], [1, 4, 5]),
            *([2, 3, 6], [7, 6, 3], [0, 2, 4], [6, 4, 2], [5, 3, 1], [3, 5, 7]),
        ]
    ),
)
"""A cube of 1 m around the origin."""


def scene_of(boxes: Sequence[Box], head: NDArray[np.float64]) -> AppScene:
    """Return boxes as a scene; left out are rooms and skies, which the head is in, and floors.

    Args:
        boxes: the page's.
        head: (3,) where the head is, app frame, m.
    """
    objects = []
    for number, box in enumerate(boxes):
        length = float(np.linalg.norm(box.rotation))
        rotation = (
            np.array(box.rotation) / length if length > 0.0 else np.array([0.0, 0.0, 0.0, 1.0])
        )
        away = turned(-rotation[:3], rotation[3], head - np.array(box.place))
        size = np.array(box.size)
        within = (np.abs(away) <= size / 2.0).all()
        floor = size.min() < _FLOOR_M and abs(box.place[1]) < _FLOOR_M and size.max() > 1.0
        if size.max() > _LARGEST_M or within or floor:
            continue
        pose = np.concatenate([box.place, rotation])
        color = np.array(box.color, np.float32)
        objects.append(SceneObject(number, box.name, 0, 0, pose, size, color, unlit=False))
    return AppScene(tuple(objects), (_CUBE,))


class WebXRApp(ForeignApp):
    """One page in one browser.

    A reset loads the page anew, unless the task names what begins a round. A page takes no part in
    being saved: what its scripts hold cannot be written down.

    Args:
        wanted: what is requested; its ``place`` names page, map and browser.

    Raises:
        AppRefused: a setting, the page or the browser cannot be used.
        AppDied, AppTimeout: the browser ends, or does not answer.
    """

    kind = "a page"
    found_capabilities = _CAPABILITIES

    def __init__(self, wanted: AppsWanted) -> None:
        super().__init__(wanted)
        place = wanted.place
        if place.page is None:
            raise AppRefused("app.page: got none, expected a page in HTML, a folder or an address")
        choices = {
            "profile": PROFILES,
            "script_errors": SCRIPT_ERRORS,
            "renderer": RENDERERS,
            "window_frames": WINDOW_FRAMES,
        }
        options = {"enter": ""} | checked_options(place.options, choices)
        self._files = PageFiles(place.page, place.map)
        self._awaited: int | None = None
        self._observed: tuple[bytes, ...] = ()
        self._valued = False
        self._head = np.zeros(3)
        self._renderer: str | None = None
        self._rays: tuple[dict[str, OptionValue], dict[str, Ray]] | None = None
        self._browser = Browser(
            find_browser(place.browser), place.start_timeout_s, options["renderer"]
        )
        try:
            self._page = Page(
                self._browser,
                self._files,
                {
                    "seed": 0,
                    "width": wanted.width,
                    "height": wanted.height,
                    "eyes": wanted.eyes,
                    "ipd_m": wanted.ipd_m,
                    "vertical_fov_deg": VERTICAL_FOV_DEG,
                    "farthest_m": FARTHEST_M,
                    "frame_rate_hz": FRAME_RATE_HZ,
                    "profile": options["profile"],
                    "window_frames": options["window_frames"] == "run",
                    "start": None if wanted.page_start is None else vars(wanted.page_start),
                },
                values=wanted.values,
                enter=options["enter"] or None,
                ignore_errors=options["script_errors"] == "ignore",
                timeout_s=place.timeout_s,
                start_timeout_s=place.start_timeout_s,
            )
        except BaseException:
            self._browser.kill()
            raise

    @property
    def renderer_description(self) -> str:
        if self._renderer is None:
            self._renderer = f"{self._browser.version}: {self._page.describe_renderer()}"
        return self._renderer

    @property
    def notes(self) -> list[str]:
        """Problems of the page in this round that do not prevent playing."""
        return self._page.watch.notes

    # --- rounds --------------------------------------------------------------------------------

    def reset(
        self,
        seed: int,
        poses: DevicePoses,
        options: Mapping[str, OptionValue] | None = None,
        *,
        time_ns: int = 0,
    ) -> AppReply:
        """Start a round; the options are the query of the page's address."""
        rows, inputs = self._checked_reset(seed, poses, time_ns)
        wished = {**self._options, **(options or {})}
        begins = self._wanted.page_reset
        again = self._playing and wished == self._options
        self._playing = False
        if again and begins is not None:
            self._page.restart(seed, begins)
        else:
            self._page.load(seed, wished)
        self._options = wished
        self._playing, self._last_ns = True, 0
        self.observe(self._observers)
        self._send(np.zeros(1, np.int64), rows, inputs, poses, 0)
        reply = self.finish_step()
        if reply.finished:
            raise AppRefused(f"{self._left}, expected a page that stays in VR")
        return reply

    def _send(
        self,
        times_ns: Int64Array,
        rows: Float64Array,
        inputs: Float64Array,
        poses: DevicePoses,
        drawn: int,
    ) -> None:
        """Send the frames as ``steps.js`` takes them."""
        self._head = rows[-1, 0, :3]
        head, left, right = rows.swapaxes(0, 1).tolist()
        frames = [
            [
                int(times_ns[k]) / 1e6,
                head[k],
                [
                    None if poses.left_controller is None else left[k],
                    None if poses.right_controller is None else right[k],
                ],
                inputs[k].tolist(),
                k == drawn and self._wanted.renderer != "null",
            ]
            for k in range(len(times_ns))
        ]
        self._awaited = self._page.start_step(frames, bool(self._wanted.values))

    def finish_step(self) -> AppReply:
        """Wait for the page to finish the step, and return its reply."""
        self._require_step()
        number, self._awaited = self._awaited, None
        assert number is not None
        reply = self._page.finish_step(number, bool(self._wanted.values))
        if reply.picture is not None:
            wanted = self._wanted
            both = np.frombuffer(reply.picture, np.uint8).reshape(
                wanted.height, wanted.eyes, wanted.width, 4
            )
            self._image[...] = both.swapaxes(0, 1) if wanted.eyes == 2 else both[:, 0]
        self._observed = reply.observed
        self._playing = not reply.ended
        words = self._ended_words(self._files.name, "XRSession.end", "in its first frame")
        self._left = words if reply.ended else ""
        for name, _, why in reply.values:
            if why is None:
                continue
            expression = self._wanted.values[name]
            if self._valued:
                raise self._page.died(f"has no value of {expression!r} any more: {why}")
            raise AppRefused(
                f"task: got the expression {expression!r}, of which {self._files.name} says: "
                f"{why}; expected one that the page has a value for in every step"
            )
        self._valued = True
        haptics = tuple(HapticPulse(hand, amp, 0.0, s) for hand, amp, s in reply.haptics)
        return self._reply(haptics, {name: value for name, value, _ in reply.values})

    def locate(self, name: str) -> tuple[float, float, float]:
        """Return where an object of the page is now, x y z in m, app frame; moves nothing.

        Args:
            name: of three.js and Babylon.js the object's name, of A-Frame its id.

        Raises:
            AppRefused: there is none of that name; names those that there are.
        """
        self._require_open()
        return self._page.locate(name)

    def scene(self) -> AppScene:
        """Return the scene: boxes in place of meshes of three.js, A-Frame and Babylon.js."""
        self._require_open()
        return scene_of(self._page.boxes(), self._head)

    def observe(self, observers: Sequence[Observer]) -> None:
        self._require_open()
        self._observers, self._observed = tuple(observers), ()
        if self._playing:
            self._page.observe(self._observers)

    def observed(self) -> tuple[Observed, ...]:
        found = []
        for one, png in zip(self._observers, self._observed, strict=False):
            size, depth_m = (one.width, one.height * (1 if one.pose is None else 2)), None
            try:
                image = Image.open(BytesIO(png), formats=["PNG"])
                if image.size != size:
                    raise ValueError(f"{image.size} pixels, expected {size}")
                pixels = np.asarray(image.convert("RGB"))
            except (OSError, ValueError) as error:
                raise self._page.died(f"answered with another picture: {error}") from error
            rgb = pixels[: one.height]
            if one.pose is not None:
                mm = pixels[one.height :, :, :2].astype(np.uint16) @ np.array([256, 1], np.uint16)
                depth_m = np.where(mm == _NOTHING_MM, np.inf, mm / 1000.0)
                if np.isinf(depth_m).all() and (rgb == rgb[0, 0]).all():  # it draws the eyes' only
                    return ()
            found.append(Observed(rgb, depth_m))
        return tuple(found)

    def pointing_rays(self) -> Mapping[str, Ray]:
        """Return the rays by which the page points: ``right``, ``left`` or ``head``, if it does.

        Origin (m) and direction in the device's own axes, app frame. An engine may turn its ray
        away from WebXR's target ray, for example if it has no model of the controller. They are
        found in a browser of their own, in which the controllers sway; this round stays as it is.

        Raises:
            AppRefused, AppError: the page does not play.
        """
        if self._rays is None or self._rays[0] != self._options:
            with WebXRApp(replace(self._wanted, options=self._options, values={})) as other:
                self._rays = dict(self._options), find_rays(other)
        return self._rays[1]

    def report(self) -> PageReport:
        """Return what the page is made of and requested so far; also after a reset failed."""
        return self._page.report()

    def things(self) -> tuple[Thing, ...]:
        """Return the objects that people may be able to use, as they are now.

        The page's objects get counters of events; what it does with them does not change.
        """
        self._require_open()
        return self._page.things()

    def signs(self) -> Signs:
        """Return what people may notice of the page now."""
        self._require_open()
        return self._page.signs()

    @property
    def usable(self) -> bool:
        """True if its browser still answers requests."""
        return self._browser.tools.usable

    @property
    def asked(self) -> Mapping[str, int]:
        """Addresses that the page requested in this round: 200, 404, or 0: mapped nowhere."""
        return self._files.asked

    # --- the end -------------------------------------------------------------------------------

    def close(self) -> None:
        """End the browser."""
        self._page.watch.log_notes()
        super().close()
        if self._browser.tools.usable and self._awaited is None:
            self._browser.stop()
        else:
            self._browser.kill()


# --- a look at a page ----------------------------------------------------------------------------

_CHECK_HZ = 20


@dataclass(frozen=True)
class PageCheck:
    """Result of checking a page.

    Attributes:
        page: name of the page as given.
        failure: reason why it does not play, in one sentence; None: it plays.
        report: engines, objects and inputs of the page; empty if it gave no answer.
        asked: requested address -> status: 200, 404, or 0: the address is not mapped.
        notes: problems that do not prevent playing.
    """

    page: str
    failure: str | None
    report: PageReport
    asked: Mapping[str, int]
    notes: tuple[str, ...]

    @property
    def missing(self) -> dict[str, str]:
        """Addresses without a file, each with what helps."""
        found = {}
        for address, status in self.asked.items():
            if status == 200:
                continue
            package = package_of(address)
            if status == 404 and package is None:
                found[address] = "put the file there"
            elif package is None:
                folder = address.rpartition("/")[0] + "/"
                found[address] = f"--map {folder}=FOLDER with the file"
            else:
                found[address] = f"npm package {package.spec}: sim2vr-harness page vendor"
        return found


def check_page(
    page: str,
    mapped: Mapping[str, str],
    browser: str | None = None,
    options: Mapping[str, OptionValue] | None = None,
    *,
    seconds: float = 2.0,
    timeout_s: float = 60.0,
) -> PageCheck:
    """Load a page behind the same walls as ever, play it a little, and say what it does.

    Args:
        page: a file, a folder or a mapped address.
        mapped: beginning of addresses -> local folder.
        browser: see :func:`.browser.find_browser`.
        options: the query of the page's address.
        seconds: how long to play.
        timeout_s: of the start and of every answer.

    Raises:
        AppRefused: there is no such page, or no browser.
    """
    place = AppPlace(
        page=page,
        map=dict(mapped),
        browser=browser,
        timeout_s=timeout_s,
        start_timeout_s=timeout_s,
    )
    head = np.array([0.0, 1.6, 0.0, 0.0, 0.0, 0.0, 1.0])
    right, left = (np.array([x, 1.2, 0.3, 0.0, 0.0, 0.0, 1.0]) for x in (0.2, -0.2))
    poses = DevicePoses(head, right_controller=right, left_controller=left)
    failure, report = None, PageReport()
    with WebXRApp(AppsWanted(n=1, game="page", place=place)) as app:
        try:
            app.reset(1, poses, options)
            for step in range(1, round(seconds * _CHECK_HZ)):
                app.step(frame_time_ns(step, _CHECK_HZ), poses)
        except (AppError, AppRefused) as error:
            failure = str(error)
        if app.usable:
            report = app.report()
        return PageCheck(page, failure, report, dict(app.asked), tuple(app.notes))


# --- the transport -------------------------------------------------------------------------------


def _apps(wanted: AppsWanted) -> AppSource:
    def app(index: int, log_dir: Path | None) -> WebXRApp:
        refuse_logs(log_dir, "a page")
        return WebXRApp(wanted)

    return app


WEBXR = Transport(
    name="webxr",
    summary="a WebXR page as it is, in a headless browser",
    apps=_apps,
    capabilities=_CAPABILITIES,
    reads=frozenset({"page", "map", "browser", "timeout_s", "start_timeout_s"}),
    options={
        "profile": "controllers: oculus-touch (default) or generic-trigger",
        "enter": "CSS selector of what to click to enter VR; found out by default",
        "script_errors": "ignore (default: a note) or fail at errors that the page does not catch",
        "renderer": "swiftshader (default: the browser's own) or mesa (the system's llvmpipe)",
        "window_frames": "frames of the window in VR: stop (default: as on a headset) or run",
    },
    text_options=frozenset({"profile", "enter", "script_errors", "renderer", "window_frames"}),
    users_per_connection=1,
    needs="page",
    reports_reward=False,
)
