import numpy as np
import pytest
import torch
from gymnasium import spaces
from stable_baselines3.common.buffers import DictRolloutBuffer

from sim2vr_harness.training.ppo.rollout_buffer import FrameRolloutBuffer, buffer_bytes

SPACE = spaces.Dict(
    {
        "vision": spaces.Box(0, 255, (2, 3, 4), np.uint8),
        "proprioception": spaces.Box(-np.inf, np.inf, (5,), np.float32),
    }
)
ACTIONS = spaces.Box(-1, 1, (3,), np.float32)
STEPS, ENVS = 8, 3


def fill(buffer: DictRolloutBuffer, seed: int, turned: bool = False) -> None:
    rng = np.random.default_rng(seed)
    buffer.reset()
    for _ in range(STEPS):
        buffer.add(
            {
                "vision": images(rng, turned),
                "proprioception": rng.standard_normal((ENVS, 5), dtype=np.float32),
            },
            rng.standard_normal((ENVS, 3), dtype=np.float32),
            rng.standard_normal(ENVS).astype(np.float32),
            rng.integers(0, 2, ENVS).astype(bool),
            torch.from_numpy(rng.standard_normal((ENVS, 1), dtype=np.float32)),
            torch.from_numpy(rng.standard_normal(ENVS, dtype=np.float32)),
        )
    buffer.compute_returns_and_advantage(torch.ones(ENVS), np.array([False, True, False]))


def images(rng: np.random.Generator, turned: bool) -> np.ndarray:
    """(ENVS, 2, 3, 4); ``turned``: the same images, channels last in memory."""
    drawn = rng.integers(0, 256, (ENVS, 2, 3, 4), dtype=np.uint8)
    return np.moveaxis(np.moveaxis(drawn, 1, -1).copy(), -1, 1) if turned else drawn


@pytest.mark.parametrize("turned", [False, True])
def test_minibatches_equal_stable_baselines3_bit_for_bit(turned: bool) -> None:
    arguments = (STEPS, SPACE, ACTIONS, "cpu", 0.95, 0.99, ENVS)
    theirs, ours = DictRolloutBuffer(*arguments), FrameRolloutBuffer(*arguments)
    for seed in (1, 2):  # the second time over used memory
        fill(theirs, seed)
        fill(ours, seed, turned)
        for epoch in (3, 4):
            np.random.seed(epoch)  # noqa: NPY002
            expected = list(theirs.get(5))
            np.random.seed(epoch)  # noqa: NPY002
            found = list(ours.get(5))
            assert len(found) == len(expected) == 5
            for ours_batch, theirs_batch in zip(found, expected, strict=True):
                for key, value in theirs_batch.observations.items():
                    assert ours_batch.observations[key].dtype == value.dtype
                    assert torch.equal(ours_batch.observations[key], value)
                vision = ours_batch.observations["vision"]
                assert vision.is_contiguous(memory_format=torch.channels_last)
                for name in ("actions", "old_values", "old_log_prob", "advantages", "returns"):
                    assert torch.equal(getattr(ours_batch, name), getattr(theirs_batch, name)), name
        assert np.array_equal(ours.values, theirs.values)
        assert np.array_equal(ours.returns, theirs.returns)


def test_images_are_bytes_and_their_memory_is_kept() -> None:
    buffer = FrameRolloutBuffer(STEPS, SPACE, ACTIONS, "cpu", n_envs=ENVS)
    fill(buffer, 1)
    images = buffer.observations["vision"]
    assert images.dtype == np.uint8
    assert images.nbytes + buffer.observations["proprioception"].nbytes == buffer_bytes(
        SPACE, STEPS * ENVS
    )
    list(buffer.get(6))
    fill(buffer, 2)
    assert buffer.observations["vision"] is images


def test_an_incomplete_rollout_is_refused() -> None:
    buffer = FrameRolloutBuffer(STEPS, SPACE, ACTIONS, "cpu", n_envs=ENVS)
    with pytest.raises(RuntimeError, match="0 of 8 steps"):
        next(buffer.get(2))
