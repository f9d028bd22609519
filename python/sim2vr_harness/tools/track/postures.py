"""A posture to begin in, and whether places can be reached at all."""

import numpy as np
import torch
from numpy.typing import NDArray

from sim2vr_harness.policies.hierarchical.motor_policy import MotorPolicy
from sim2vr_harness.users import Body
from sim2vr_harness.users.kinematics.forward import Linkage, Point
from sim2vr_harness.users.kinematics.inverse import solve

FloatArray = NDArray[np.float64]

REACHED_M = 0.01
"""Distance between controller and place within which the place counts as reachable."""
_TRIES = 200
_DRAWN = 2
"""Number of random initial postures per place, in addition to the body's own."""
_AS_NEAR_M = 2e-3
_AXIS_WEIGHT = 4.0


def posture_at(
    layer: MotorPolicy,
    places: FloatArray,
    axes: FloatArray,
    followed: NDArray[np.bool_],
    seed: int,
) -> FloatArray:
    """Return angles (J,) of a posture whose hands are at their places, or as near as possible.

    Of all such postures it is one in the middle of the joints' ranges, with the requested
    directions of the hands.

    Args:
        layer: of the body.
        places: (H, 3) MuJoCo's world, m.
        axes: (H, 3) desired directions of the devices; zeros: any.
        followed: (H,) True if the hand has a place.
        seed: of the random initial postures.
    """
    body = layer.body
    rng = np.random.default_rng([seed, 41])
    middle = body.joint_ranges.mean(axis=1)
    posture = np.array([body.reset_rule.posture.get(j, 0.0) for j in body.independent_joints])
    posture = np.clip(posture, *body.joint_ranges.T)
    for hand in np.flatnonzero(followed):
        linkage = Linkage(body, Point(layer.hands[hand]))
        columns = [body.independent_joints.index(joint) for joint in linkage.joints]
        low, high = linkage.limits.T
        start = rng.uniform(low, high, (_TRIES, len(low)))
        angles, far = solve(linkage, np.repeat(places[hand][None], _TRIES, axis=0), start)
        tried = np.repeat(posture[None], _TRIES, axis=0)
        tried[:, columns] = angles
        strain = (((angles - middle[columns]) / (high - low)) ** 2).sum(axis=1)
        if axes[hand].any():
            with torch.no_grad():
                flat = torch.from_numpy(tried).float()
                poses = layer.places(flat, torch.zeros_like(flat))[0][:, hand]
            forward = poses[:, :3, 0].double().numpy()
            strain += _AXIS_WEIGHT * (1.0 - forward @ axes[hand])
        strain[far > far.min() + _AS_NEAR_M] = np.inf
        posture = tried[int(np.argmin(strain))]
    return posture


def beyond_reach_m(
    body: Body, device: str, places: FloatArray, postures: FloatArray, seed: int = 1
) -> FloatArray:
    """Return distances (K,) of places from the reach of a hand within joint limits; 0: inside.

    Strength, speed and collisions are not considered. The search starts from the body's postures
    and from random ones.

    Args:
        device: of the hand.
        places: (K, 3) MuJoCo's world, m.
        postures: (K, J) angles of the independent joints, near by.
        seed: of the random postures.
    """
    linkage = Linkage(body, Point(device))
    columns = [body.independent_joints.index(joint) for joint in linkage.joints]
    rng = np.random.default_rng([seed, 43])
    _, far = solve(linkage, places, postures[:, columns], close_m=1e-4)
    for _ in range(_DRAWN):
        rows = np.flatnonzero(far > 0.5 * REACHED_M)
        if len(rows):
            low, high = linkage.limits.T
            start = rng.uniform(low, high, (len(rows), len(columns)))
            far[rows] = np.minimum(far[rows], solve(linkage, places[rows], start)[1])
    return np.where(far < 1e-3, 0.0, far)
