"""Detection of held tools: image points that move as a device does.

Apps do not report the objects that they attach to a controller. While the hands move, every visible
point is transformed into each device's frame. A point that keeps its position in that frame belongs
to the device; points that stand in the world do not keep it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import KDTree
from torch import Tensor

from sim2vr_harness.policies.hierarchical.depth_grid import FAR_M, rotation
from sim2vr_harness.policies.hierarchical.goal_sampler import GoalSampler
from sim2vr_harness.policies.hierarchical.motor_policy import MotorPolicy
from sim2vr_harness.policies.hierarchical.pointing import AIM_RAYS

_EVERY, _LOOKS, _PICTURES = 3, 30, 960
"""Users look every so many user steps, so often, and oftener where they are so few that there would
be fewer pictures."""
_NEAR_M = 2.5
_CERTAIN = (0.03, 0.3, 0.5)
_LIKELY = (0.02, 0.1, 0.15)
"""Lowest frequencies with which certain and probable parts of a tool are visible: in all images,
relative to the most visible part, and in the images in which the part can be visible. Hands that
move through all their reach are visible only now and then. Probable parts count if they continue
certain ones: the end of a long blade is less visible than its root, and thinner than a pixel; just
beyond the end both frequencies are a third of that."""
_STANDS_LOOKS = 3
"""Number of sightings from which on a cell counts as part of a static object."""
_MARGIN_M = 0.08
_JOINED_M, _AT_HAND_M, _AHEAD_M = 0.1, 0.15, 0.05
"""Criteria for a tool in the hand: its points are connected, with gaps of at most _JOINED_M, and
begin within _AT_HAND_M of the hand. Probable points lie within _AHEAD_M of the line of the certain
ones."""
_HANDLE = 0.25
"""Proportion of a tool, from the hand on, that is not used to hit objects."""
_RAY_M, _ENDLESS_M = 0.6, 1.2
"""Lengths that separate rays from tools. From the first on, points on the aim ray are a ray if the
app uses a trigger. From the second on, anything is a ray, because few tools are that long."""
_ON_RAY = 0.8
"""Lowest proportion of a ray's points that lie on the aim ray."""
_END_M = 0.045
"""Length of the end of a tool whose mean position is the tip, m."""
_THIN_M, _THIN_END_M = 0.03, 0.01
"""Distance from its axis below which the end of a tool is thin, and the length of a thin tool's end
whose mean position is the tip, m."""


@dataclass(frozen=True)
class _Grid:
    """Cubes about the middle of a frame, numbered.

    Attributes:
        edge_m: edge of a cube.
        side: number of cubes along each axis.
    """

    edge_m: float
    side: int

    def numbers(self, points: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return (...) numbers of the cubes that contain points (..., 3); -1 outside."""
        index = np.floor(points / self.edge_m + 0.5 * self.side).astype(np.int64)
        x, y, z = np.moveaxis(index, -1, 0)
        inside = ((index >= 0) & (index < self.side)).all(-1)
        numbers: NDArray[np.int64] = np.where(inside, (x * self.side + y) * self.side + z, -1)
        return numbers

    def centers(self, numbers: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return (K, 3) middles of cubes (K,), m."""
        index = np.stack(np.unravel_index(numbers, (self.side,) * 3), 1)
        return np.asarray((index + 0.5 - 0.5 * self.side) * self.edge_m, dtype=np.float64)


_VOXELS, _BLOCKS = _Grid(0.03, 90), _Grid(0.06, 2000)
"""Cubes in a device's frame, and in the world for the test for static surfaces."""


class Tool:
    """Visible object that is fixed to a device.

    Attributes:
        points: (K, 3) its points in the device's frame (x forward, y left, z up), m.
        tip: (3,) the middle of its far end; 0 if no tool is visible in the hand.
        middle: (3,) the middle of its outer three quarters. A long blade that strikes with its
            tip misses if it is a little short.
        why: explanation for readers: the class of the object, and the criterion.
    """

    def __init__(self, points: NDArray[np.float64], why: str = "") -> None:
        self.points, self.why = points, why
        self.tip: NDArray[np.float64] = np.zeros(3)
        self.middle: NDArray[np.float64] = np.zeros(3)
        if len(points):
            far = np.linalg.norm(points, axis=1)
            end = points[far > far.max() - _END_M]
            axis = end.mean(0) / np.linalg.norm(end.mean(0))
            beside = np.linalg.norm(end - (end @ axis)[:, None] * axis, axis=1)
            last = _THIN_END_M if beside.max() < _THIN_M else _END_M
            self.tip = np.asarray(points[far > far.max() - last].mean(0))
            self.middle = np.asarray(points[far > _HANDLE * far.max()].mean(0))


def straight_tool(length_m: float) -> Tool:
    """Return a tool of a length that goes on forward from the controller."""
    points = np.linspace(0.0, length_m, 101)[1:, None] * np.array([1.0, 0.0, 0.0])
    return Tool(points, f"a tool of {100 * length_m:.0f} cm, as skills.tool says")


def find_tools(
    simulation: Any, layer: MotorPolicy, poses: Tensor, *, seed: int, rays: Tensor = AIM_RAYS
) -> list[Tool]:
    """Return what each hand holds, of users who move their hands about for some seconds.

    The users' present rounds are lost.

    Args:
        poses: (P, H, 4, 4) places that the devices can be at.
        rays: with which they point.
    """
    n = simulation.n
    simulation.reset(seeds=[seed + i for i in range(n)])
    exercises = GoalSampler(poses, n, layer.step_s, seed)
    exercises.tools = False
    exercises.start(torch.arange(n), _placed(simulation, layer)[0])
    looks = []
    every = max(1, round(_PICTURES / (_LOOKS * n)))
    for step in range(_EVERY * _LOOKS * every):
        body = layer.act(simulation.users, exercises.goals)
        actions = np.tile(simulation.resting_action, (n, 1))
        actions[:, : body.shape[1]] = body
        result = simulation.step(actions)
        exercises.step(*_placed(simulation, layer))
        simulation.renew(result)
        if step % _EVERY == 0:
            looks.append(_look(simulation, _placed(simulation, layer)[0]))
    pointed = any(name.endswith(".trigger") for name in simulation.config.user.inputs)
    tools = tools_in(looks)
    each = rays.expand(len(tools), 2, 3).numpy().astype(np.float64)
    return [_judged(tool, ray, pointed=pointed) for tool, ray in zip(tools, each, strict=True)]


@dataclass(frozen=True)
class ToolView:
    """A picture of each user.

    Attributes:
        far: (N, height, width) how far what is seen is away, m.
        cameras: (N, 4, 4) where the head is, in the world.
        places: (N, H, 4, 4) where the devices are.
    """

    far: NDArray[np.float32]
    cameras: NDArray[np.float64]
    places: NDArray[np.float64]

    def of(self, user: int) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """(height, width) and (4, 4) what a user sees, and from where."""
        return self.far[user], self.cameras[user]


def tools_in(looks: Sequence[ToolView]) -> list[Tool]:
    """Return each hand's tool, found in pictures taken while hands and heads move about."""
    users, hands = looks[0].places.shape[:2]
    stands = np.stack([_stands([look.of(i) for look in looks]) for i in range(users)], 1)
    return [_found(looks, stands, hand) for hand in range(hands)]


def _judged(found: Tool, ray: NDArray[np.float64], *, pointed: bool) -> Tool:
    """Tell tools from rays that an app draws at a controller, and say what was found.

    Args:
        found: what moves with the controller.
        ray: (2, 3) origin and direction with which it points.
        pointed: whether the user works a trigger, as with a ray.
    """
    if not len(found.points):
        return Tool(found.points, "nothing: no surface moves with it")
    ways, aim = found.points - ray[0], ray[1]
    along = ways @ aim
    beside = np.linalg.norm(ways - along[:, None] * aim, axis=1)
    on_ray = float(((along > 0.0) & (beside < _AHEAD_M)).mean())
    length = float(np.linalg.norm(found.points, axis=1).max())
    seen = f"{100 * length:.0f} cm long"
    if length >= _ENDLESS_M:
        return Tool(found.points[:0], f"nothing: what moves with it is {seen}, a ray")
    if pointed and length >= _RAY_M and on_ray > _ON_RAY:
        return Tool(found.points[:0], f"nothing: what moves with it lies on the aim ray, {seen}")
    tip_cm = 100 * np.linalg.norm(found.tip)
    return Tool(found.points, f"a tool of {tip_cm:.0f} cm: surfaces that move with it")


def _look(simulation: Any, places: Tensor) -> ToolView:
    depth = np.stack([np.asarray(app.image)[..., 3] for app in simulation.apps])
    head, quaternion = simulation.users.device_poses("headset")
    cameras = np.tile(np.eye(4), (len(head), 1, 1))
    cameras[:, :3, :3], cameras[:, :3, 3] = rotation(quaternion).numpy(), head
    far = depth.astype(np.float32) * (FAR_M / 255.0)  # rounded by apps: no error on average
    return ToolView(far, cameras, places.numpy().astype(np.float64))


def _placed(simulation: Any, layer: MotorPolicy) -> tuple[Tensor, Tensor]:
    angles, speeds, _ = layer.motion(simulation.users)
    with torch.inference_mode():
        return layer.places(angles, speeds)


def _stands(
    looks: Sequence[tuple[NDArray[np.float32], NDArray[np.float64]]],
) -> NDArray[np.bool_]:
    """Return (looks, height, width) True for pixels of one user that show static surfaces.

    A surface is static if it is visible in half of all looks at its place. A wall is often near the
    hand, and is visible wherever the hand is; a tool moves with the hand.
    """
    blocks = []
    for far, camera in looks:
        block = _BLOCKS.numbers(_moved(_points(far), camera))
        blocks.append(np.where(far < _NEAR_M, block, -1))
    each = np.concatenate([np.unique(block[block >= 0]) for block in blocks])
    found, seen = np.unique(each, return_counts=True)
    centers = _BLOCKS.centers(found)
    through = np.zeros(len(found))
    for far, camera in looks:
        through += _seen_through(far, _moved(centers, np.linalg.inv(camera)))
    standing = found[(seen > through) & (seen >= _STANDS_LOOKS)]
    return np.isin(np.stack(blocks), standing)


def _found(looks: Sequence[ToolView], stands: NDArray[np.bool_], hand: int) -> Tool:
    hits, pixels = np.zeros(_VOXELS.side**3), np.zeros(_VOXELS.side**3)
    sums = np.zeros((_VOXELS.side**3, 3))
    pictures = 0
    views = []
    for look, still in zip(looks, stands, strict=True):
        for i, place in enumerate(look.places[:, hand]):
            far, camera = look.of(i)
            moves = (far < _NEAR_M) & ~still[i]
            there = _moved(_points(far)[moves], np.linalg.inv(place) @ camera)
            voxels = _VOXELS.numbers(there)
            there, voxels = there[voxels >= 0], voxels[voxels >= 0]
            hits[np.unique(voxels)] += 1.0
            np.add.at(sums, voxels, there)
            np.add.at(pixels, voxels, 1.0)
            views.append((far, np.linalg.inv(camera) @ place))
            pictures += 1
    often = np.flatnonzero(hits > _LIKELY[0] * pictures)
    if not len(often):
        return Tool(np.zeros((0, 3)))
    # Where it is seen, on average: a thin tool passes beside the middle of a cube.
    centers = sums[often] / pixels[often, None]
    through = np.zeros(len(often))
    for far, to_camera in views:
        through += _seen_through(far, _moved(centers, to_camera))
    stays = hits[often] / np.maximum(1.0, hits[often] + through)

    def seen_so(share: float, beside_most: float, staying: float) -> NDArray[np.bool_]:
        kept: NDArray[np.bool_] = (hits[often] > share * pictures) & (stays > staying)
        return kept & (hits[often] > beside_most * hits[often][kept].max(initial=0.0))

    at_hand = np.linalg.norm(centers, axis=1) < _AT_HAND_M
    certain = _joined(centers, seen_so(*_CERTAIN), at_hand)
    tip = Tool(centers[certain]).tip
    axis = tip / max(1e-9, float(np.linalg.norm(tip)))
    along = centers @ axis
    beside = np.linalg.norm(centers - along[:, None] * axis, axis=1)
    # Likely parts lie where a tool goes on, seen from the hand.
    in_line = certain | ((along > 0.0) & (beside < _AHEAD_M))
    return Tool(centers[_joined(centers, seen_so(*_LIKELY) & in_line, certain)])


def _joined(
    points: NDArray[np.float64], kept: NDArray[np.bool_], known: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """(K,) those of points (K, 3) that are kept and hang together with known ones."""
    joined = known & kept
    edge = joined
    while edge.any() and (left := np.flatnonzero(kept & ~joined)).size:
        off, _ = KDTree(points[edge]).query(points[left], distance_upper_bound=_JOINED_M)
        edge = np.zeros_like(joined)
        edge[left[np.isfinite(off)]] = True
        joined = joined | edge
    return joined


def _points(far: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return (height, width, 3) positions of the visible surfaces in the camera's frame, m."""
    height, width = far.shape
    focal = 0.5 * height
    y, x = np.mgrid[0:height, 0:width] + 0.5
    d = far.astype(np.float64)
    points: NDArray[np.float64] = np.stack(
        [d, -(x - 0.5 * width) / focal * d, -(y - 0.5 * height) / focal * d], 2
    )
    return points


def _moved(points: NDArray[np.float64], pose: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """(..., 3) points (..., 3) of a frame in the frame of its pose (4, 4)."""
    return np.asarray(points @ pose[:3, :3].T + pose[:3, 3], dtype=np.float64)


def _seen_through(far: NDArray[np.float32], points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return (K,) True for camera-frame points (K, 3) behind which the image shows a surface."""
    height, width = far.shape
    focal = 0.5 * height
    ahead = points[:, 0] > 0.05
    depth = np.where(ahead, points[:, 0], 1.0)
    column = np.floor(0.5 * width - points[:, 1] / depth * focal).astype(np.int64)
    row = np.floor(0.5 * height - points[:, 2] / depth * focal).astype(np.int64)
    visible = ahead & (column >= 0) & (column < width) & (row >= 0) & (row < height)
    behind = far[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)]
    through: NDArray[np.bool_] = visible & (behind > depth + _MARGIN_M)
    return through
