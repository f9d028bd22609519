"""A WebXR page as an app in lockstep: :class:`~sim2vr_harness.client.base.AppClient`."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.client.base import AppReply, Int64Array, OptionValue
from sim2vr_harness.client.devices import DevicePoses
from sim2vr_harness.client.errors import AppError, AppRefused, AppUnsupported
from sim2vr_harness.client.foreign import (
    FARTHEST_M,
    FRAME_RATE_HZ,
    VERTICAL_FOV_DEG,
    ForeignApp,
)
from sim2vr_harness.client.poses import checked_rows, later_times, one_frame
from sim2vr_harness.client.runtime import checked_seed
from sim2vr_harness.client.scene import AppScene, SceneMesh, SceneObject
from sim2vr_harness.client.transport import AppsWanted, checked_options
from sim2vr_harness.client.webxr.browser import Browser, find_browser
from sim2vr_harness.client.webxr.files import PageFiles
from sim2vr_harness.client.webxr.hands import Ray, find_rays
from sim2vr_harness.client.webxr.page import PROFILES, SCRIPT_ERRORS, WINDOW_FRAMES, Page
from sim2vr_harness.client.webxr.renderers import RENDERERS
from sim2vr_harness.client.webxr.replies import Box, PageReport, Signs, Thing

_LARGEST_M = 30.0
"""What is longer is no thing that people meet."""
_FLOOR_M = 0.02
"""Pictures have a floor of their own."""


def _cube() -> SceneMesh:
    """Return a cube of 1 m around the origin."""
    corners = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    triangles = []
    for axis in range(3):
        for side in (-0.5, 0.5):
            face = np.flatnonzero(corners[:, axis] == side)
            for three in (face[[0, 1, 2]], face[[3, 2, 1]]):
                a, b, c = corners[three]
                # Clockwise from outside, in a left-handed frame: this product points outwards.
                outwards = np.cross(b - a, c - a)[axis] * side > 0.0
                triangles.append(three if outwards else three[::-1])
    return SceneMesh("box", corners.astype(np.float32), np.array(triangles, np.int64))


_CUBE = _cube()


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
        way = head - np.array(box.place)
        axis, w = -rotation[:3], rotation[3]
        away = way + 2.0 * np.cross(axis, np.cross(axis, way) + w * way)
        size = np.array(box.size)
        within = (np.abs(away) <= size / 2.0).all()
        floor = size.min() < _FLOOR_M and abs(box.place[1]) < _FLOOR_M and size.max() > 1.0
        if size.max() > _LARGEST_M or within or floor:
            continue
        pose = np.concatenate([box.place, rotation])
        color = np.array(box.color, np.float32)
        objects.append(SceneObject(number, box.name, 0, 0, pose, size, color, unlit=False))
    return AppScene(tuple(objects), (_CUBE,))


CAPABILITIES = frozenset({"frames", "inputs", "left_controller", "haptics", "two_eyes", "scene"})


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

    def __init__(self, wanted: AppsWanted) -> None:
        super().__init__(wanted.width, wanted.height, wanted.eyes)
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
        self._wanted = wanted
        self._options: dict[str, OptionValue] = dict(wanted.options)
        self._last_ns = 0
        self._awaited: int | None = None
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
    def capabilities(self) -> frozenset[str]:
        return CAPABILITIES

    @property
    def renderer_description(self) -> str:
        if self._renderer is None:
            self._renderer = f"{self._browser.version}: {self._page.describe_renderer()}"
        return self._renderer

    @property
    def notes(self) -> list[str]:
        """What went wrong in this round that the page can do without."""
        return self._page.notes

    # --- rounds --------------------------------------------------------------------------------

    def reset(
        self,
        seed: int,
        poses: DevicePoses,
        options: Mapping[str, OptionValue] | None = None,
        *,
        time_ns: int = 0,
    ) -> AppReply:
        """See :class:`AppClient`; options are the query of the page's address."""
        self._require_open()
        checked_seed(seed)
        if time_ns != 0:
            raise AppUnsupported("time_ns: a page's clock begins at 0 with each round")
        frames = self._frames(np.zeros(1, np.int64), one_frame(poses), 0)
        wished = {**self._options, **(options or {})}
        again = self._playing and wished == self._options and self._wanted.page_reset is not None
        self._playing = False
        if again:
            assert self._wanted.page_reset is not None
            self._page.restart(seed, self._wanted.page_reset)
        else:
            self._page.load(seed, wished)
        self._options = wished
        self._playing, self._last_ns = True, 0
        self._awaited = self._page.start_step(frames, bool(self._wanted.values))
        reply = self.finish_step()
        if reply.finished:
            raise AppRefused(f"{self._left}, expected a page that stays in VR")
        return reply

    def start_step(
        self, times_ns: Int64Array, poses: DevicePoses, drawn: int = -1, *, last: bool = False
    ) -> None:
        """See :class:`AppClient`; sends the frames."""
        self._require_round()
        if self._awaited is not None:
            raise AppError("step: the last one goes on; call finish_step first")
        times = later_times(times_ns, self._last_ns)
        frames = self._frames(times, poses, range(len(times))[drawn])
        self._last_ns = int(times[-1])
        self._awaited = self._page.start_step(frames, bool(self._wanted.values))

    def finish_step(self) -> AppReply:
        """See :class:`AppClient`; waits for the page."""
        if self._awaited is None:
            raise AppError("finish_step: no step was started; call start_step first")
        number, self._awaited = self._awaited, None
        reply = self._page.finish_step(number, bool(self._wanted.values))
        if reply.picture is not None:
            wanted = self._wanted
            both = np.frombuffer(reply.picture, np.uint8).reshape(
                wanted.height, wanted.eyes, wanted.width, 4
            )
            self._image[...] = both.swapaxes(0, 1) if wanted.eyes == 2 else both[:, 0]
        self._playing = not reply.ended
        self._left = self._end_words() if reply.ended else ""
        for name, why in reply.lacking.items():
            raise self._without_value(name, why)
        self._valued = True
        return AppReply(
            reward=0.0,
            finished=reply.ended,
            time_feature=0.0,
            log={},
            haptics=reply.haptics,
            values=reply.values,
            left=self._left,
        )

    def _end_words(self) -> str:
        when = f"after {self._last_ns * 1e-9:.1f} s" if self._last_ns else "in its first frame"
        return f"{self._files.name}: the page ended its session (XRSession.end) {when}"

    def _frames(self, times: Int64Array, poses: DevicePoses, drawn: int) -> list[Any]:
        """The frames of a step as ``steps.js`` takes them.

        Raises:
            ValueError: a pose or an input that cannot be one; names it.
        """
        count = len(times)
        rows, inputs = checked_rows(poses, count)
        self._head = rows[-1, 0, :3]
        head, left, right = rows.swapaxes(0, 1).tolist()
        return [
            [
                int(times[k]) / 1e6,
                head[k],
                [
                    None if poses.left_controller is None else left[k],
                    None if poses.right_controller is None else right[k],
                ],
                inputs[k].tolist(),
                k == drawn,
            ]
            for k in range(count)
        ]

    def _without_value(self, name: str, why: str) -> Exception:
        """The error for an expression without a value: the task's at first, then the page's."""
        expression = self._wanted.values[name]
        if self._valued:
            return self._page.died(f"has no value of {expression!r} any more: {why}")
        return AppRefused(
            f"task: got the expression {expression!r}, of which {self._files.name} says: {why}; "
            "expected one that the page has a value for in every step"
        )

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
        """See :class:`AppClient`; meshes of three.js, A-Frame and Babylon.js, as boxes."""
        self._require_open()
        return scene_of(self._page.boxes(), self._head)

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
        """Whether its browser can still be asked."""
        return self._browser.tools.usable

    @property
    def asked(self) -> Mapping[str, int]:
        """Addresses that the page requested in this round: 200, 404, or 0: mapped nowhere."""
        return self._files.asked

    # --- the end -------------------------------------------------------------------------------

    def close(self) -> None:
        """See :class:`AppClient`; ends the browser."""
        self._page.log_notes()
        super().close()
        if self._browser.tools.usable and self._awaited is None:
            self._browser.stop()
        else:
            self._browser.kill()
