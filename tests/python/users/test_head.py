"""The reflex that moves heads: what it does to the headset, and that it does it to nothing else."""

import numpy as np
import pytest

from python.users.bodies import body
from sim2vr_harness.base.rotations import turned
from sim2vr_harness.users import UserBatch
from sim2vr_harness.users.head_reflex import (
    EYES_FORWARD_M,
    EYES_UP_M,
    FOLLOWS,
    RECOIL,
    TURNS_HZ,
    HeadReflex,
    moved_head,
)

BODY = body()
STEP_S, SUBSTEPS = 0.002, 25
AHEAD = (np.array([0.1, 0.0, 1.2]), np.array([1.0, 0.0, 0.0, 0.0]))
FRONT_M = np.array([0.6, 0.0, 1.2])


def users(n: int = 1, head: str = "reflex") -> UserBatch:
    batch = UserBatch(BODY, n, threads=1, head=head)  # type: ignore[arg-type]
    batch.reset(range(n), [np.random.default_rng(5 + i) for i in range(n)])
    return batch


def actions(step: int, n: int = 1) -> np.ndarray:
    return np.tile(np.random.default_rng(step).uniform(-1, 1, 32), (n, 1))


class Heads:
    """Heads without bodies, which look straight ahead."""

    def __init__(self, n: int, factor: float = 1.0) -> None:
        self.reflex, self.ids = HeadReflex(n, STEP_S, SUBSTEPS), np.arange(n)
        self.factors = np.full(n, factor)
        self.base = tuple(np.tile(part, (n, 1)) for part in AHEAD)
        self.reflex.reset(self.ids, list(range(n)), self.hands(FRONT_M))

    def hands(self, hand_m: np.ndarray) -> np.ndarray:
        return np.tile(hand_m, (len(self.ids), 1))

    def step(self, hand_m: np.ndarray = FRONT_M) -> tuple[np.ndarray, np.ndarray]:
        self.reflex.begin(self.ids, self.base, self.hands(hand_m), self.factors)  # type: ignore[arg-type]
        return moved_head(*self.base, self.reflex.offsets(self.hands(hand_m), SUBSTEPS))  # type: ignore[arg-type]


def test_the_arm_does_not_notice() -> None:
    fixed, moving = users(head="fixed"), users()
    for at_rest, reflex in zip(
        fixed.device_poses("headset"), moving.device_poses("headset"), strict=True
    ):
        np.testing.assert_allclose(reflex, at_rest, atol=1e-15)
    for step in range(6):
        fixed.step(actions(step))
        moving.step(actions(step))
    np.testing.assert_array_equal(fixed.qpos, moving.qpos)
    np.testing.assert_array_equal(fixed.effort_cost, moving.effort_cost)
    still, moved = (batch.device_poses("headset")[0] for batch in (fixed, moving))
    assert 1e-3 < np.linalg.norm(moved - still) < 0.05
    assert not any(key.startswith("head/") for key in fixed.state_dict(0))


def test_its_own_motion_has_the_stated_deviations_and_speeds() -> None:
    heads = Heads(300)
    for _ in range(120):  # 6 s, longer than everything that swings here
        heads.step()
    steps = [heads.step() for _ in range(40)]
    quat = np.array([quat for _, quat in steps])
    turns_deg = np.degrees(2.0 * quat[..., 1:])  # small angles: tilt, down, left
    np.testing.assert_allclose(turns_deg.std(axis=(0, 1)), [1.6, 2.0, 2.4], rtol=0.08)
    speed = np.diff(turns_deg, axis=0).std(axis=(0, 1)) / 0.05
    # Speed is 2 pi f times the deviation, less what differences over a step lose (7 %).
    np.testing.assert_allclose(speed / [1.6, 2.0, 2.4], 2.0 * np.pi * TURNS_HZ, rtol=0.15)
    lever = np.array([EYES_FORWARD_M, 0.0, EYES_UP_M])
    neck = np.array([pos - turned(quat[:, 1:], quat[:, :1], lever) for pos, quat in steps])
    np.testing.assert_allclose(neck.std(axis=(0, 1)), [0.007, 0.005, 0.0], rtol=0.1, atol=1e-9)


def test_it_turns_a_share_of_the_way_to_the_hand() -> None:
    heads = Heads(300)
    hand = AHEAD[0] + [1.0, np.tan(0.2), 0.0]  # 0.2 rad to the left
    for _ in range(60):
        _, quat = heads.step(hand)
    left = 2.0 * quat[:, 3]
    assert left.mean() == pytest.approx(FOLLOWS * 0.2, abs=4 * np.radians(2.4) / np.sqrt(300))
    assert (2.0 * quat[:, 2]).mean() == pytest.approx(0.0, abs=4 * np.radians(2.0) / np.sqrt(300))
    far = Heads(300)
    for _ in range(60):
        _, quat = far.step(AHEAD[0] + [-1.0, 1.0, 0.0])  # behind: no farther than 30 degrees
    assert (2.0 * quat[:, 3]).mean() == pytest.approx(FOLLOWS * np.radians(30.0), abs=0.01)


def test_it_gives_way_where_the_hand_goes_and_comes_back() -> None:
    heads = Heads(1, factor=0.0)  # nothing of its own accord
    pos, quat = heads.step()
    np.testing.assert_allclose(pos[0], AHEAD[0], atol=1e-15)
    struck = FRONT_M + np.array([0.2, -0.1, 0.3])
    pos, quat = heads.step(struck)
    first = pos[0] - AHEAD[0]
    # At once the other way by the share, of which swaying has taken little back after 0.05 s.
    share = -RECOIL * np.array([0.2, -0.1, 0.0])
    np.testing.assert_allclose(first, share, atol=0.02 * np.abs(share).max())
    for _ in range(200):
        pos, quat = heads.step(struck)
    np.testing.assert_allclose(pos[0], AHEAD[0], atol=1e-4)
    np.testing.assert_array_equal(quat[0], [1.0, 0.0, 0.0, 0.0])
