"""Find the objects of an app by name: of pages, and of apps whose scene is known."""

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.base.errors import InputError, closest
from sim2vr_harness.client import AppRefused, WebXRApp
from sim2vr_harness.client.frames import position_to_mujoco
from sim2vr_harness.client.scene import PLAYER_LAYER, POINTERS, AppScene, SceneMesh, SceneObject
from sim2vr_harness.policies.scripted.hand import turned
from sim2vr_harness.policies.scripted.steps import Place
from sim2vr_harness.users.kinematics.posture_controller import DeviceRay, page_ray

FloatArray = NDArray[np.float64]

_SHOWN = 20
"""Largest number of names in an error message."""
LIT = "lit"
"""Name for the highlighted object, unless an object of the scene has this name."""
_ALIKE = 3
"""Lowest number of objects of one size among which one of another colour is highlighted."""
_FLAT = 0.5
"""Largest thickness of something flat, as a proportion of its width."""
_BESIDE_M, _WIDEST_M = 0.1, 1.0
"""Largest distance from a place, and largest width, of the object at it; wider ones are walls."""


def _app_of(simulation: Any, user: int) -> Any:
    """A user's app, which a replacement may have become, below its task if there is one."""
    app = simulation.apps[user]
    return getattr(app, "app", app)


def own_ray(simulation: Any, side: str, user: int = 0) -> DeviceRay:
    """Return the ray with which a user's app points for a hand: a page's own, else WebXR's.

    A page of which this was not asked yet is loaded once more.
    """
    app = _app_of(simulation, user)
    return page_ray(app.pointing_rays().get(side) if isinstance(app, WebXRApp) else None)


class Places:
    """Finds objects in the app of a user.

    Of several objects that a name fits, the nearest to the hand counts, for as long as it exists.

    Args:
        simulation: Of the users.
        user: In whose app.
    """

    def __init__(self, simulation: Any, user: int) -> None:
        self._simulation, self._user = simulation, user
        self._kept: dict[str, int] = {}
        self._unnamed: set[str] = set()

    @property
    def _app(self) -> Any:
        return _app_of(self._simulation, self._user)

    def check(self, place: Place) -> None:
        """Refuse a name where the app names no objects.

        Raises:
            InputError: The app names none.
        """
        if isinstance(place, tuple) or isinstance(self._app, WebXRApp):
            return
        if "scene" not in self._app.capabilities:
            raise InputError(
                "--user",
                repr(place),
                "X Y Z in metres in the app's frame: this app names no objects",
            )

    def forget(self) -> None:
        """Choose anew among several objects of a name."""
        self._kept = {}

    def find(self, place: Place, hand: FloatArray) -> FloatArray | None:
        """Return where something is, (3,) MuJoCo's frame, m; None: there is no such object now.

        Args:
            place: A name or a place. A name is a value of the task that is a position, an object,
                or ``lit``: of the objects of a size the one that has another colour.
            hand: (3,) of the hand, MuJoCo's frame, m.
        """
        if isinstance(place, tuple):
            return position_to_mujoco(place)
        value = getattr(self._simulation.apps[self._user], "values", {}).get(place)
        if isinstance(value, tuple):
            return position_to_mujoco(value)
        if isinstance(self._app, WebXRApp) and place not in self._unnamed:
            try:
                return position_to_mujoco(self._app.locate(place))
            except AppRefused:
                if place != LIT:
                    return None
                self._unnamed.add(place)
        name = place
        scene = self._app.scene()
        if name == LIT and not scene.named(LIT):
            lit = _lit(scene)
            return None if lit is None else position_to_mujoco(lit.pose[:3])
        named = scene.named(name) or scene.named(f"*/{name}")
        fitting = [one for one in named if one.layer != PLAYER_LAYER]
        shown = [one for one in fitting if one.mesh is not None] or fitting
        if not shown:
            return None
        kept = [one for one in shown if one.id == self._kept.get(name)]
        chosen = (
            kept[0]
            if kept
            else min(
                shown,
                key=lambda one: float(np.linalg.norm(position_to_mujoco(one.pose[:3]) - hand)),
            )
        )
        self._kept[name] = chosen.id
        return position_to_mujoco(chosen.pose[:3])

    def shape(
        self, place: FloatArray, *, player: bool = False
    ) -> tuple[float | None, FloatArray | None]:
        """Return the width of what is shown at a place, (3,) MuJoCo's frame, m, and its facing.

        The facing is the (3,) direction away from the surface of something flat, MuJoCo's frame,
        towards the headset or against it; None: it is not flat. None, None: nothing is shown there.
        With ``player``, what stands for the player counts, too.
        """
        if not isinstance(self._app, WebXRApp) and "scene" not in self._app.capabilities:
            return None, None
        scene = self._app.scene()
        near = [
            (round(float(np.linalg.norm(position_to_mujoco(one.pose[:3]) - place)), 2), -wide, one)
            for one in scene.drawn(player=player)
            if 0.0 < (wide := float(_size(scene, one)[1])) < _WIDEST_M
        ]
        gap, wide, one = min(near, key=lambda each: each[:2], default=(_BESIDE_M, 0.0, None))
        if one is None or gap >= _BESIDE_M:
            return None, None
        assert one.mesh is not None
        sizes = _extents(scene.meshes[one.mesh]) * np.abs(one.scale)
        if sizes.min() > _FLAT * -wide:
            return -wide, None
        facing = turned(one.pose[[6, 3, 4, 5]], np.eye(3)[int(sizes.argmin())])
        return -wide, position_to_mujoco(facing)

    def unknown(self, name: str) -> InputError:
        """Word the error for a name that no object has ever had."""
        if isinstance(self._app, WebXRApp):
            known = _names_in(self._app, name)
        else:
            paths = [one.path.rpartition("/")[2] for one in self._app.scene().objects]
            known = list(dict.fromkeys(paths))
        best = closest(name, known)
        hint = f" (did you mean {best!r}?)" if best else ""
        listed = ", ".join(known[:_SHOWN]) or "none"
        return InputError("--user", f"no object {name!r}", f"one of {listed}{hint}")


def _names_in(page: WebXRApp, name: str) -> list[str]:
    """Return the names in the page's refusal."""
    try:
        page.locate(name)
    except AppRefused as error:
        _, _, listed = str(error).partition("objects with names: ")
        return [] if listed in ("", "none") else listed.split(", ")
    return [name]


@lru_cache(maxsize=256)
def _extents(mesh: SceneMesh) -> FloatArray:
    return np.ptp(mesh.vertices, axis=0)


def _size(scene: AppScene, one: SceneObject) -> FloatArray:
    """(3,) extents of what an object shows along its own axes, the least first, m."""
    assert one.mesh is not None
    return np.sort(_extents(scene.meshes[one.mesh]) * np.abs(one.scale))


def _lit(scene: AppScene) -> SceneObject | None:
    """Return the object that alone has another colour than all others of its size and parent.

    The brightest, if there are several such; None: there is none.
    """
    alike: dict[tuple[object, ...], dict[tuple[float, ...], list[SceneObject]]] = {}
    for one in scene.drawn():
        parent, _, name = one.path.rpartition("/")
        if name in POINTERS:
            continue
        size = (parent, *np.round(_size(scene, one), 3).tolist())
        colour = tuple(np.round(one.color, 2).tolist())
        alike.setdefault(size, {}).setdefault(colour, []).append(one)
    alone = [
        objects[0]
        for colours in alike.values()
        if len(colours) == 2 and sum(map(len, colours.values())) >= _ALIKE
        for objects in colours.values()
        if len(objects) == 1
    ]
    return max(alone, key=lambda one: float(one.color[:3].sum()), default=None)
