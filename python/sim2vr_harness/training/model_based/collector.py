"""User steps of simulated users, which the body model is fitted to."""

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from sim2vr_harness.training.model_based.task import Task
from sim2vr_harness.world_models.transitions import TransitionStore

_KEPT = (0.0, 0.6, 0.9)
"""Proportion of random noise that lasts from one user step to the next; drawn per user."""
_RETURN = 0.3
"""Proportion of their way to rest that actuators of such users return in a user step."""


def collect(
    task: Task,
    steps: int,
    *,
    action_noise: float,
    randomly: bool,
    on_progress: Callable[[float], None],
) -> TransitionStore:
    """Return user steps that simulated users have taken.

    Args:
        task: the users.
        steps: of each.
        action_noise: standard deviation on the policy's actions.
        randomly: move at random, in short episodes, instead of acting by the policy.
        on_progress: called with the proportion of the steps that is taken.
    """
    rng, batch, drives = task.rng, task.batch, task.body.drives
    task.begin_collecting(randomly=randomly)
    noise = np.zeros((batch.n, drives.count))
    rest = drives.rest(drives.of(batch))
    keep = rng.choice(_KEPT, (batch.n, 1))
    size = rng.uniform(*task.random_size, (batch.n, 1))
    task.stagger()
    rows: list[tuple[NDArray[Any], ...]] = []
    for step in range(steps):
        on_progress(step / steps)
        before = task.motion()
        if randomly:
            noise = keep * noise + np.sqrt(1.0 - keep**2) * rng.standard_normal(noise.shape)
            actions = size * noise + _RETURN * (rest - before[-1])
        else:
            mean = task.policy_actions()
            actions = mean + action_noise * rng.standard_normal(mean.shape)
        kept, over, persons, fields = task.simulate(actions)
        control = drives.controls(batch)  # motor noise included
        rows.append(tuple(a[kept] for a in (*before, control, *task.motion(), persons, fields)))
        ids = np.flatnonzero(over)
        if len(ids):
            task.restart(ids)
            rest[ids] = drives.rest(drives.of(batch))[ids]
    task.end_collecting()
    columns = (np.concatenate(column) for column in zip(*rows, strict=True))
    return TransitionStore.of([torch.tensor(c, dtype=torch.float32) for c in columns])
