"""Planning of muscles ahead: its parts against other ways to the same numbers."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from sim2vr_harness.tools.track.trajectory_optimisation import Refinement, _apart, least_within
from sim2vr_harness.users import UserBatch, load_body
from sim2vr_harness.world_models.actuator_state import ActuatorState

FloatArray = NDArray[np.float64]


def hand(bodies: UserBatch, step: int) -> FloatArray:
    """(N, 3) where the right controllers are, m."""
    return bodies.device_poses("controller_right")[0]


def many(name: str = "mobl_arms_wrist") -> Callable[[int], UserBatch]:
    body = load_body(name)
    return lambda n: UserBatch(body, n, threads=1, effort="neural")


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
