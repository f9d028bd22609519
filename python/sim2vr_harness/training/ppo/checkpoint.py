"""PPO's checkpoints: take a learner's state between two iterations, and restore it exactly.

The rollout buffer is empty between two iterations. Besides the weights, a checkpoint holds random
generators, the last observation, episode statistics and the environment's state.
"""

import copy
import io
import json
import zipfile
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm

from sim2vr_harness import __version__
from sim2vr_harness.base.errors import UnusableFile
from sim2vr_harness.base.files import write_atomically
from sim2vr_harness.base.finite import require_finite
from sim2vr_harness.base.signals import interrupts_deferred
from sim2vr_harness.client.errors import AppDied, AppTimeout
from sim2vr_harness.runs.checkpoint import (
    DAMAGE,
    EXPECTED,
    FORMAT,
    RESUME,
    good_parts,
    in_words,
    last_good,
    random_state,
    set_random_state,
)
from sim2vr_harness.training.ppo.ppo import PPO
from sim2vr_harness.training.ppo.vec_env import SimulationVecEnv


@dataclass(frozen=True)
class Snapshot:
    """A moment between two iterations.

    Attributes:
        step: User steps taken so far.
        weights: The policy's state.
        optimizer: The optimiser's state.
        header: Counters, random generators and episode statistics, as JSON.
        arrays: Arrays of the learner and the bytes of the environment.
    """

    step: int
    weights: dict[str, torch.Tensor]
    optimizer: dict[str, Any]
    header: dict[str, Any]
    arrays: dict[str, NDArray]

    def write(self, path: Path, model: PPO) -> None:
        """Write the checkpoint; ``model`` gives the parts that never change."""
        archive = io.BytesIO()
        with interrupts_deferred(), _holding(model, self):
            model.save(archive)
        header = np.frombuffer(json.dumps(self.header).encode(), dtype=np.uint8)
        arrays = io.BytesIO()
        np.savez(arrays, allow_pickle=False, header=header, **self.arrays)
        with zipfile.ZipFile(archive, "a") as members:
            members.writestr(RESUME, arrays.getvalue(), zipfile.ZIP_DEFLATED)
        write_atomically(path, archive.getvalue())


def require_finite_learner(model: PPO, last_good: Path | None) -> None:
    """Check that what a learner has learned may be saved.

    Raises:
        NotFinite: a weight or a moment of its optimiser is NaN or infinite.
    """
    learned = {
        "policy": model.policy.state_dict(),
        "optimizer": model.policy.optimizer.state_dict(),
    }
    require_finite(learned, f"after {model.num_timesteps:,} user steps", last_good)


def take(model: PPO) -> Snapshot:
    """Copy the state of a learner between two iterations."""
    env = model.get_env()
    assert isinstance(env, SimulationVecEnv)
    arrays: dict[str, NDArray] = {
        **{f"environment.{key}": value for key, value in env.state_dict().items()},
        "episode_starts": np.array(model._last_episode_starts),
    }
    last_observation = model._last_obs
    assert isinstance(last_observation, dict)
    for key, value in last_observation.items():
        arrays[f"observation.{key}"] = np.array(value)
    generators, generator_arrays = random_state()
    header = {
        "format": FORMAT,
        "version": __version__,
        "num_timesteps": model.num_timesteps,
        "n_updates": model._n_updates,
        "progress_remaining": model._current_progress_remaining,
        "episodes": list(model.ep_info_buffer or []),
        "random": generators,
    }
    return Snapshot(
        step=model.num_timesteps,
        weights=copy.deepcopy(model.policy.state_dict()),
        optimizer=copy.deepcopy(model.policy.optimizer.state_dict()),
        header=header,
        arrays=arrays | generator_arrays,
    )


def restore(path: Path, model: PPO) -> None:
    """Bring a freshly built learner and its environment to the state of a checkpoint.

    Raises:
        UnusableFile: The file is no checkpoint, is damaged or belongs to another configuration. The
            learner and its environment may be at no moment at all then: they are to be made anew.
    """
    weights, optimizer, header, arrays = good_parts(path, model.policy, model.device)
    env = model.get_env()
    assert isinstance(env, SimulationVecEnv)
    try:
        model.policy.load_state_dict(weights)
        model.policy.optimizer.load_state_dict(optimizer)
        # Check what torch does not: that moments have the shape of their weights.
        for weight, state in model.policy.optimizer.state.items():
            for name, value in state.items():
                if isinstance(value, torch.Tensor) and value.dim() and value.shape != weight.shape:
                    shapes = f"{tuple(value.shape)}, expected {tuple(weight.shape)}"
                    raise ValueError(f"{name} of the optimiser of shape {shapes}")
        model.num_timesteps = int(header["num_timesteps"])
        model._n_updates = int(header["n_updates"])
        model._current_progress_remaining = float(header["progress_remaining"])
        load_moment(model, env, arrays)
        # SB3 makes the statistics' buffers when it starts learning, unless they are there.
        model.ep_info_buffer = deque(header["episodes"], maxlen=model._stats_window_size)
        model.ep_success_buffer = deque(maxlen=model._stats_window_size)
        set_random_state(header["random"], arrays)
    except (AppDied, AppTimeout):
        raise  # the file may be good
    except DAMAGE as error:
        instead = last_good(path, model.policy)
        raise UnusableFile(path, in_words(error), EXPECTED, instead) from error


def load_moment(model: BaseAlgorithm, env: SimulationVecEnv, arrays: dict[str, NDArray]) -> None:
    """Bring the environment and what was last seen of it to a checkpoint's moment."""
    parts: dict[str, dict[str, NDArray]] = {"environment": {}, "observation": {}}
    for key, value in arrays.items():
        part, _, name = key.partition(".")
        if part in parts:
            parts[part][name] = value
    anew, observation = env.load_state_dict(parts["environment"]), parts["observation"]
    starts = arrays["episode_starts"]
    if anew:
        starts[anew] = True
        for key, value in env.simulation.observation().items():
            observation[key][anew] = value[anew]
    model._last_obs, model._last_episode_starts = observation, starts


@contextmanager
def _holding(model: PPO, snapshot: Snapshot) -> Iterator[None]:
    """Let ``model`` hold a snapshot's weights and counters for a moment."""
    now = (
        copy.deepcopy(model.policy.state_dict()),
        copy.deepcopy(model.policy.optimizer.state_dict()),
        model.num_timesteps,
        model._n_updates,
    )

    def hold(weights: Any, optimizer: Any, step: int, updates: int) -> None:
        model.policy.load_state_dict(weights)
        # A copy: loading does not copy every tensor, and later steps would write into them.
        model.policy.optimizer.load_state_dict(copy.deepcopy(optimizer))
        model.num_timesteps, model._n_updates = step, updates

    hold(snapshot.weights, snapshot.optimizer, snapshot.step, snapshot.header["n_updates"])
    try:
        yield
    finally:
        hold(*now)
