"""What is to be seen of play, without a browser."""

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest

from sim2vr_harness.client import AppScene, SceneMesh, SceneObject
from sim2vr_harness.client.frames import pose_to_mujoco
from sim2vr_harness.tools.watch import browser
from sim2vr_harness.tools.watch import selection as choosing
from sim2vr_harness.tools.watch.browser import Playback, Poser
from sim2vr_harness.tools.watch.frames import Hands, Playlist, ViewerFrame
from sim2vr_harness.users import Body, load_body

SHEET = SceneMesh("sheet", np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))


def ball(number: int, color: list[float], x: float = 0.0) -> SceneObject:
    pose = np.array([x, 1.0, 0.5, 0.0, 0.0, 0.0, 1.0])
    rgba = np.array(color, np.float32)
    return SceneObject(number, f"Ball {number}", 0, 0, pose, np.array([1.0, 2.0, 3.0]), rgba, False)


def moment(k: int, *objects: SceneObject, **more: Any) -> ViewerFrame:
    picture = np.zeros((4, 6, 3), np.uint8)
    return ViewerFrame(k / 20.0, AppScene(objects, (SHEET,)), picture, f"Hits {k}", **more)


def show_of(count: int, made: list[int]) -> Playlist:
    def moments() -> Iterator[ViewerFrame]:
        for k in range(1, count + 1):
            made.append(k)
            yield moment(k)

    return Playlist("a round", 20.0, moments)


def test_pause_step_speed_and_scrub() -> None:
    made: list[int] = []
    playback = Playback(show_of(6, made))
    assert not playback.tick(0.04), "not due yet"
    assert playback.tick(0.02)
    assert (playback.at, made) == (0, [1])
    playback.speed = 0.5
    assert not playback.tick(0.05)
    assert playback.tick(0.05)
    playback.playing = False
    assert not playback.tick(10.0)
    assert playback.step()
    assert made == [1, 2, 3]
    assert playback.seek(0)
    assert not playback.seek(0)
    assert playback.now is not None
    assert playback.now.text == "Hits 1"
    playback.playing, playback.speed = True, 2.0
    assert playback.tick(0.05), "two moments that are known already"
    assert (playback.at, made) == (2, [1, 2, 3])
    assert playback.tick(5.0), "new ones come one by one, however late"
    assert made == [1, 2, 3, 4]
    while playback.step():
        pass
    assert playback.over
    assert made == [1, 2, 3, 4, 5, 6]
    assert not playback.tick(1.0)
    playback.restart()
    assert playback.step()
    assert (len(playback.moments), made[-1]) == (1, 1)


class FakeScene:
    """Notes what viser is told."""

    def __init__(self) -> None:
        self.handles: dict[str, SimpleNamespace] = {}

    def set_up_direction(self, _way: str) -> None: ...

    def configure_default_lights(self, **_: Any) -> None: ...

    def add_grid(self, _name: str, **_: Any) -> None: ...

    def _add(self, name: str, **given: Any) -> SimpleNamespace:
        handle = SimpleNamespace(visible=True, removed=False, **given)
        handle.remove = lambda: setattr(handle, "removed", True)
        self.handles[name] = handle
        return handle

    def add_mesh_simple(self, name: str, vertices: Any, faces: Any, **_: Any) -> SimpleNamespace:
        return self._add(name, vertices=vertices, faces=faces)

    def add_line_segments(self, name: str, points: Any, colors: Any, **_: Any) -> SimpleNamespace:
        return self._add(name, points=points, colors=colors)


def test_objects_come_move_change_colour_and_go() -> None:
    scene = FakeScene()
    stage = browser.ViewerStage(scene, show_of(1, []))
    stage.draw(moment(1, ball(7, [0, 1, 0, 1]), ball(8, [1, 1, 1, 0.25])))
    one, other = scene.handles["/app/7_0"], scene.handles["/app/8_0"]
    # Right 0, up 1, ahead 0.5 is ahead 0.5, left 0, up 1 in MuJoCo's world.
    np.testing.assert_allclose(one.position, [0.5, 0.0, 1.0])
    assert one.scale == (3.0, 1.0, 2.0)
    assert (one.color, one.opacity, other.opacity) == ((0, 255, 0), None, 0.25)
    stage.draw(moment(2, ball(7, [1, 0, 0, 1], x=0.2)))
    np.testing.assert_allclose(one.position, [0.5, -0.2, 1.0])
    assert one.color == (255, 0, 0)
    assert (one.visible, other.visible) == (True, False)
    stage.draw(moment(3, ball(8, [1, 1, 1, 1])))
    assert (one.visible, other.visible) == (False, True)


@pytest.fixture(scope="module")
def body() -> Body:
    return load_body("mobl_arms_wrist")


def test_the_body_stands_as_in_mujoco_and_muscles_have_colours(body: Body) -> None:
    qpos = body.coupled_qpos(np.array([0.5, 1.0, 0.0, 0.7, 0.0, 0.0, 0.0]))
    act = np.zeros(32)
    act[body.muscles.index("DELT1")] = 1.0
    posture = Poser(body).pose(qpos, act)
    data = mujoco.MjData(body.model)
    data.qpos[:] = qpos
    mujoco.mj_fwdPosition(body.model, data)
    np.testing.assert_allclose(posture.positions, data.xpos, atol=1e-12)
    np.testing.assert_allclose(posture.quats, data.xquat, atol=1e-12)
    lengths = np.linalg.norm(np.diff(posture.muscles, axis=1)[:, 0], axis=1)
    assert lengths.sum() == pytest.approx(data.ten_length.sum())
    red = posture.colors[:, 0, 0].astype(int) - posture.colors[:, 0, 1] > 100  # else skin
    tendon = body.model.tendon("DELT1_tendon").id
    assert lengths[red].sum() == pytest.approx(data.ten_length[tendon])
    scene = FakeScene()
    stage = browser.ViewerStage(scene, Playlist("s", 20.0, lambda: iter(()), body))
    stage.draw(moment(1, qpos=qpos, activations=act))
    hands = [handle for name, handle in scene.handles.items() if name.startswith("/body/hand_")]
    for handle in hands:
        np.testing.assert_allclose(handle.position, data.body("hand").xpos)
    assert hands
    assert scene.handles["/body/muscles"].points.shape == (len(lengths), 2, 3)


def test_a_person_s_hand_and_head_move_by_keys() -> None:
    pose = np.array([0.0, 1.0, 0.3, 0.0, 0.0, 0.0, 1.0])
    ahead = browser.moved(pose, np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(ahead[:3], [0.0, 1.0, 0.34])
    right = browser.turned(pose, np.array([0.0, 1.0, 0.0]))
    for _ in range(17):
        right = browser.turned(right, np.array([0.0, 1.0, 0.0]))
    # 18 times 5 degrees: ahead (MuJoCo's x) has become right (its -y).
    _, quat = pose_to_mujoco(right)
    looks = np.empty(3)
    mujoco.mju_rotVecQuat(looks, np.array([1.0, 0.0, 0.0]), quat)
    np.testing.assert_allclose(looks, [0.0, -1.0, 0.0], atol=1e-9)
    up = browser.turned(right, np.array([-1.0, 0.0, 0.0]))
    mujoco.mju_rotVecQuat(looks, np.array([1.0, 0.0, 0.0]), pose_to_mujoco(up)[1])
    assert looks[2] == pytest.approx(np.sin(np.radians(5.0)))
    hands = Hands({"head": pose, "right_controller": ahead})
    assert hands.devices().left_controller is None
    np.testing.assert_array_equal(hands.devices().right_controller, ahead)


def test_a_person_plays_a_round() -> None:
    show = choosing.choose(None, played=True, game="sample")
    assert show.hands is not None
    moments = show.moments()
    first = next(moments)
    (ball_seen,) = first.scene.named("Ball")
    # The hand goes where the ball is: it is touched in the next frame or the one after.
    show.hands.poses["right_controller"][:3] = ball_seen.pose[:3]
    seen = [line for _ in range(3) for line in next(moments).events]
    moments.close()  # type: ignore[attr-defined]
    assert any("Points 1" in line for line in seen), seen
    assert first.headset.shape == (160, 240, 3)
