from collections.abc import Iterator
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from sim2vr_harness.client import PLAYER_LAYER, AppScene, Observed, SceneMesh, SceneObject
from sim2vr_harness.users import Body, load_body
from sim2vr_harness.users.rendering import OrbitView, UserRenderer


@pytest.fixture(scope="module")
def user() -> Body:
    return load_body("mobl_arms_wrist")


@pytest.fixture(scope="module")
def renderer(user: Body) -> Iterator[UserRenderer]:
    with UserRenderer(user, 96, 72) as made:
        yield made


def test_pictures(user: Body, renderer: UserRenderer) -> None:
    hanging = renderer.render(np.zeros(21), "side")
    assert hanging.shape == (72, 96, 3)
    assert hanging.dtype == np.uint8
    assert hanging.flags.writeable
    reaching = user.coupled_qpos(np.array([1.2, 1.2, 0, 0.4, 0, 0, 0]))
    picture = renderer.render(reaching, "side")
    assert np.abs(picture.astype(int) - hanging).max() > 50
    np.testing.assert_array_equal(picture, renderer.render(reaching, "side"))
    assert np.abs(picture.astype(int) - renderer.render(reaching, "front")).max() > 50


def test_active_muscles_are_redder(user: Body, renderer: UserRenderer) -> None:
    data = mujoco.MjData(user.model)
    relaxed = renderer.render(data, "arm").astype(int)
    data.act[:] = 1.0
    active = renderer.render(data, "arm").astype(int)
    redness = [(p[..., 0] - p[..., 2]).sum() for p in (relaxed, active)]
    assert redness[1] > redness[0]


def test_the_body_is_put_into_an_app_s_picture_by_depth(user: Body) -> None:
    with UserRenderer(user, 96, 72) as renderer:
        observer = renderer.observer("play", 48, 36)
        # (-1.05, -1.65, 1.65) forward, left, up is 1.65 right, 1.65 up, 1.05 behind the origin.
        assert observer.pose is not None
        assert observer.pose[:3] == pytest.approx((1.65, 1.65, -1.05))
        green = np.zeros((36, 48, 3), np.uint8)
        green[..., 1] = 255
        shares = []
        for depth_m in (np.inf, 2.3, 0.5):
            behind = Observed(green, np.full((36, 48), depth_m))
            picture = renderer.render(np.zeros(21), "play", behind=behind)
            shares.append((picture != [0, 255, 0]).any(axis=2).mean())
    # No floor or sky; the camera is 2.8 m from its middle, so the left side is further than 2.3 m.
    assert 0.5 > shares[0] > shares[1] > shares[2] == 0.0


def test_places_are_projected_to_where_they_are_drawn(user: Body) -> None:
    view = OrbitView((0.5, 0.2, 1.0), 2.0, 30.0, -20.0)
    place = np.array([1.3, 0.5, 1.4])  # forward, left, up
    ball = shown([-0.5, 1.4, 1.3], [0.0, 0.0, 0.0, 1.0], [1, 0, 1, 1])
    scene = AppScene((replace(ball, scale=np.full(3, 0.1)),), (tetrahedron(),))
    with UserRenderer(user, 160, 120) as renderer:
        picture = renderer.render(np.zeros(21), view, scene=scene).astype(int)
        (found,) = renderer.project(place[None], view)
    magenta = (picture[..., 0] > 120) & (picture[..., 1] < 80) & (picture[..., 2] > 120)
    assert np.argwhere(magenta).mean(axis=0)[::-1] == pytest.approx(found, abs=1.5)


def tetrahedron() -> SceneMesh:
    corners = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], np.float32) / 2
    return SceneMesh("t", corners, np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]))


def wedge(name: str) -> SceneMesh:
    """A pyramid of 20 cm whose middle is far from its own origin, app frame."""
    corners = np.array([[0, 0, 0], [0.2, 0, 0], [0, 0.2, 0], [0, 0, 0.2]], np.float32)
    triangles = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    return SceneMesh(name, corners + np.float32([1.0, 0.0, 0.0]), triangles)


def shown(place: list[float], turn: list[float], color: list[float], layer: int = 0) -> SceneObject:
    pose = np.array([*place, *turn])
    scale = np.array([0.5, 0.5, 0.5])
    return SceneObject(1, "Wedge", layer, 0, pose, scale, np.array(color, np.float32), True)


def test_an_app_s_objects_are_drawn_where_they_are(user: Body) -> None:
    level = [0.0, 0.0, 0.0, 1.0]
    # A view from 2 m behind, level, at the place 1 m ahead and 1.2 m up.
    view = OrbitView((1.0, 0.0, 1.2), 2.0, 0.0, 0.0)
    # The mesh's middle lies 0.5 * (1.05, 0.05, 0.05) from its object: to the right of the middle.
    scene = AppScene((shown([0.0, 1.2, 1.0], level, [1, 0, 1, 1]),), (wedge("w"),))
    with UserRenderer(user, 160, 120) as renderer:

        def magenta(scene: AppScene) -> np.ndarray:
            picture = renderer.render(np.zeros(21), view, scene=scene).astype(int)
            rows = np.argwhere((picture[..., 0] > 120) & (picture[..., 1] < 80))
            return rows[picture[tuple(rows.T)][:, 2] > 120]

        pixels = magenta(scene)
        fov = np.radians(renderer._model.vis.global_.fovy)
        focal = 60.0 / np.tan(fov / 2.0)
        middle = pixels.mean(axis=0)
        assert abs(middle[1] - (80 + focal * 0.525 / 2.025)) < 3.0
        assert abs(middle[0] - (60 - focal * 0.025 / 2.025)) < 3.0
        # Half a turn about the vertical: to the left.
        turned = AppScene((shown([0.0, 1.2, 1.0], [0, 1, 0, 0], [1, 0, 1, 1]),), scene.meshes)
        assert abs(magenta(turned).mean(axis=0)[1] - (80 - focal * 0.525 / 1.975)) < 3.0
        # What stands for the player is not drawn beside the body; a new shape is taken in.
        player = AppScene((shown([0, 1.2, 1], level, [1, 0, 1, 1], PLAYER_LAYER),), scene.meshes)
        assert len(magenta(player)) == 0
        twice = AppScene(scene.objects, (*scene.meshes, wedge("other")))
        np.testing.assert_array_equal(magenta(twice), pixels)
