"""What is in the hand, told from pictures drawn by hand: a wall, and a stick or nothing."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from sim2vr_harness.policies.hierarchical.depth_grid import FAR_M
from sim2vr_harness.policies.hierarchical.tool_detection import ToolView, tools_in

HEIGHT, WIDTH = 80, 120
WALL_M = 0.6


def looks_at(wall: bool, stick_m: float, users: int = 8, number: int = 60) -> list[ToolView]:
    """Pictures of users whose hand moves about with a stick 2 cm thick along its x axis, before a
    wall if there is one."""
    random = np.random.default_rng(1)
    taken = []
    for _ in range(number):
        far = np.full((users, HEIGHT, WIDTH), 9.0)
        cameras, places = np.tile(np.eye(4), (users, 1, 1)), np.tile(np.eye(4), (users, 1, 1))
        cameras[:, :3, :3] = turns(random.normal(0.0, 0.15, (users, 3)))
        cameras[:, :3, 3] = random.normal(0.0, 0.02, (users, 3))
        places[:, :3, :3] = turns(random.normal(0.0, 0.6, (users, 3)))
        places[:, :3, 3] = random.uniform([0.15, -0.25, -0.3], [0.5, 0.25, 0.0], (users, 3))
        for i in range(users):
            draw(far[i], cameras[i], places[i], wall, stick_m)
        level = np.floor(far * 255.0 / FAR_M)
        depth = ((level + 0.5) * FAR_M / 255.0).astype(np.float32)
        taken.append(ToolView(depth, cameras, places[:, None]))
    return taken


def turns(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 3, 3) by rotation vectors (N, 3)."""
    return np.asarray(Rotation.from_rotvec(vectors).as_matrix())


def draw(
    far: NDArray[np.float64],
    camera: NDArray[np.float64],
    place: NDArray[np.float64],
    wall: bool,
    stick_m: float,
) -> None:
    """Write how far away what is seen is into ``far`` (height, width)."""
    focal = 0.5 * HEIGHT
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH] + 0.5
    rays = np.stack([np.ones_like(x), (0.5 * WIDTH - x) / focal, (0.5 * HEIGHT - y) / focal], 2)
    if wall:
        far[:] = (WALL_M - camera[0, 3]) / (rays @ camera[0, :3])
    if stick_m == 0.0:
        return
    along = np.linspace(0.0, stick_m, 200)[:, None] * [1.0, 0.0, 0.0]
    for aside in (-0.01, 0.0, 0.01):
        world = (along + np.array([0.0, aside, 0.0])) @ place[:3, :3].T + place[:3, 3]
        seen = (world - camera[:3, 3]) @ camera[:3, :3]
        seen = seen[seen[:, 0] > 0.05]
        column = np.floor(0.5 * WIDTH - seen[:, 1] / seen[:, 0] * focal).astype(int)
        row = np.floor(0.5 * HEIGHT - seen[:, 2] / seen[:, 0] * focal).astype(int)
        kept = (row >= 0) & (row < HEIGHT) & (column >= 0) & (column < WIDTH)
        np.minimum.at(far, (row[kept], column[kept]), seen[kept, 0])


@pytest.mark.parametrize(("wall", "stick_m"), [(False, 0.25), (True, 0.25), (True, 0.12)])
def test_a_stick_is_found_to_its_end(wall: bool, stick_m: float) -> None:
    (tool,) = tools_in(looks_at(wall, stick_m))
    assert tool.tip[0] == pytest.approx(stick_m, abs=0.02)
    assert np.linalg.norm(tool.tip[1:]) < 0.02


def test_a_wall_that_hands_come_near_is_not_in_the_hand() -> None:
    (tool,) = tools_in(looks_at(True, 0.0))
    assert not len(tool.points)


def test_nothing_is_found_in_an_empty_world() -> None:
    (tool,) = tools_in(looks_at(False, 0.0))
    assert not len(tool.points)
