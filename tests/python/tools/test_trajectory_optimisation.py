"""Planning of muscles ahead: its parts against other ways to the same numbers."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from sim2vr_harness.tools.track.trajectory_optimisation import (
    DynamicsState,
    Perturbations,
    Refinement,
    _apart,
    least_within,
    motion_of,
)
from sim2vr_harness.users import UserBatch, load_body
from sim2vr_harness.world_models.actuator_state import ActuatorState

FloatArray = NDArray[np.float64]


def hand(bodies: UserBatch, step: int) -> FloatArray:
    """(N, 3) where the right controllers are, m."""
    return bodies.device_poses("controller_right")[0]


def swinging(bodies: UserBatch) -> None:
    """Half a second of controls that change, so that nothing is at rest."""
    rng = np.random.default_rng(5)
    for _ in range(10):
        bodies.step(np.repeat(rng.uniform(-0.3, 0.3, (1, bodies.action_size)), bodies.n, 0))


def many(name: str = "mobl_arms_wrist") -> Callable[[int], UserBatch]:
    body = load_body(name)
    return lambda n: UserBatch(body, n, threads=1, effort="neural")


def inwards(shares: FloatArray, sizes: FloatArray) -> FloatArray:
    """Changes of shares of these sizes that stay between 0 and 1."""
    return np.where(shares > 0.5, -sizes, sizes)


# --- least within a box --------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(5))
def test_the_least_within_a_box_is_what_bounded_least_squares_finds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    matrix, aim = rng.normal(size=(40, 12)), rng.normal(size=40) * 2.0
    low, high = -rng.uniform(0.0, 0.3, 12), rng.uniform(0.0, 0.3, 12)
    found, free = least_within(matrix.T @ matrix, -matrix.T @ aim, low, high)
    expected = lsq_linear(matrix, aim, (low - 1e-12, high + 1e-12), tol=1e-14)
    np.testing.assert_allclose(found, expected.x, atol=1e-6)
    held = (found <= low) | (found >= high)
    assert np.array_equal(free, ~held)
    assert 0 < held.sum() < 12


# --- what a step responds -------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["mobl_arms_bimanual_motor"])
def test_a_response_foretells_a_step(name: str) -> None:
    """Small changes of posture, speed, activation and control at once; 20 of them."""
    make = many(name)
    one = make(1)
    body = one.body
    one.reset([0], [np.random.default_rng(1)], [body.joint_ranges.mean(1)])
    swinging(one)
    at, drives = DynamicsState.of(one).row(0), ActuatorState(body)
    shares = drives.shares(drives.of(one), np.full((1, drives.count), 0.05))[0]
    response = Perturbations(make, hand).response(at, shares, 0)
    joints, size = len(body.independent_joints), len(response.by_motion)
    rng = np.random.default_rng(2)
    turned, faster = rng.normal(0.0, 2e-3, (20, joints)), rng.normal(0.0, 0.05, (20, joints))
    more = inwards(shares, rng.uniform(0.0, 0.03, (20, drives.count)))
    pulled = inwards(at.act, rng.uniform(0.0, 0.03, (20, size - 2 * joints)))

    tried = make(21)
    changed, angles = at.times(21), at.qpos[body.qpos_independent]
    there = body.coupled_qpos(angles)
    changed.qpos[1:] += body.coupled_qpos(angles + turned) - there
    changed.qvel[1:] += (body.coupled_qpos(angles + 1e-4 * faster) - there) / 1e-4
    changed.act[1:] += pulled
    changed.put(tried)
    controls = np.concatenate([shares[None], shares + more])
    tried.step(drives.actions(drives.of(tried), controls))
    after = motion_of(DynamicsState.of(tried), tried)
    moved, places = after[1:] - after[0], hand(tried, 0)[1:] - hand(tried, 0)[0]

    beside = np.concatenate([turned, faster, pulled], 1)
    told = beside @ response.by_motion.T + more @ response.by_control.T
    told_places = beside @ response.error_by_motion.T + more @ response.error_by_control.T
    assert np.linalg.norm(told_places - places) < 0.03 * np.linalg.norm(places)
    for part in (slice(0, joints), slice(joints, 2 * joints), slice(2 * joints, size)):
        apart = np.linalg.norm(told[:, part] - moved[:, part])
        assert apart <= 0.05 * np.linalg.norm(moved[:, part])


# --- all of it -----------------------------------------------------------------------------------

HELD = 0.35
"""Control of every muscle of an arm that is held."""


def held_arm(steps: int) -> tuple[UserBatch, FloatArray, Refinement]:
    """An arm that all muscles hold alike, its hand's place, and who plans that it stays there."""
    make = many()
    users = make(1)
    drives = ActuatorState(users.body)

    def stay(bodies: UserBatch, step: int) -> FloatArray:
        return drives.actions(drives.of(bodies), np.full((bodies.n, drives.count), HELD))

    for step in range(30):
        users.step(stay(users, step))
    place = hand(users, 0)
    return (
        users,
        place,
        Refinement(make, stay, lambda bodies, step: hand(bodies, step) - place, steps),
    )


def test_a_hand_is_held_where_it_is_with_less_effort() -> None:
    """The plan begins from controls that hold the posture and pull muscles against each other."""
    users, place, refinement = held_arm(40)
    errors, acts = [], []
    for step in range(40):
        users.step(refinement.action(users, step))
        errors.append(np.linalg.norm(hand(users, step) - place))
        acts.append((users.act**2).mean())
    assert np.mean(acts[10:]) < 0.5 * HELD**2
    assert np.max(errors) < 0.02


def test_what_is_far_off_counts_more_than_its_square() -> None:
    """Slope and bend of the cost that plans are made by, beside differences of it."""
    errors = np.array([0.0, 0.01, -0.04, 0.1])
    small = 1e-5
    before, now, after = (_apart(errors + step)[0] for step in (-small, 0.0, small))
    _, slope, bend = _apart(errors)
    np.testing.assert_allclose(slope, (after - before) / (2 * small), rtol=1e-5, atol=1e-9)
    np.testing.assert_allclose(bend, (after - 2 * now + before) / small**2, rtol=1e-3)
    np.testing.assert_allclose(now, errors**2 * [1.0, 1.03125, 1.5, 4.125])
