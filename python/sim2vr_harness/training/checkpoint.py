"""Checkpoints that continue a run exactly.

A checkpoint is taken between two iterations, where the rollout buffer is empty. It is one zip
file: what ``stable_baselines3.PPO.load`` reads, plus ``resume.npz`` with everything else that the
next iteration depends on: random generators, last observation, episode statistics, and the
environment. Resuming reads tensors, arrays and JSON only, never a pickle.
"""

from __future__ import annotations

import copy
import io
import json
import random
import zipfile
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from sim2vr_harness import __version__
from sim2vr_harness.training.errors import InputError
from sim2vr_harness.training.ppo import PPO
from sim2vr_harness.training.run_folder import write_atomically
from sim2vr_harness.training.vec_env import SimulationVecEnv

__all__ = [
    "Snapshot",
    "load_policy_weights",
    "preserved_random_state",
    "restore",
    "take",
    "write_tensors",
]

FORMAT = 1
_RESUME = "resume.npz"


def write_tensors(path: Path, content: Mapping[str, Any]) -> None:
    """Write tensors so that the file is either complete or not there; ``torch.load`` reads it."""
    stream = io.BytesIO()
    torch.save(dict(content), stream)
    write_atomically(path, stream.getvalue())


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
        with _holding(model, self):
            model.save(archive)
        header = np.frombuffer(json.dumps(self.header).encode(), dtype=np.uint8)
        arrays = io.BytesIO()
        np.savez(arrays, allow_pickle=False, header=header, **self.arrays)
        with zipfile.ZipFile(archive, "a") as members:
            members.writestr(_RESUME, arrays.getvalue(), zipfile.ZIP_DEFLATED)
        write_atomically(path, archive.getvalue())


def take(model: PPO) -> Snapshot:
    """Copy the state of a learner between two iterations."""
    env = model.get_env()
    assert isinstance(env, SimulationVecEnv)
    arrays: dict[str, NDArray] = {
        "environment": np.frombuffer(env.save_state(), dtype=np.uint8),
        "episode_starts": np.array(model._last_episode_starts),
    }
    last_observation = model._last_obs
    assert isinstance(last_observation, dict)
    for key, value in last_observation.items():
        arrays[f"observation.{key}"] = np.array(value)
    generators, generator_arrays = _random_state()
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
        InputError: The file is no checkpoint or belongs to another configuration.
    """
    weights, optimizer, header, arrays = _read(path, model.device)
    env = model.get_env()
    assert isinstance(env, SimulationVecEnv)
    _load_weights(path, model, weights)
    model.policy.optimizer.load_state_dict(optimizer)
    model.num_timesteps = int(header["num_timesteps"])
    model._n_updates = int(header["n_updates"])
    model._current_progress_remaining = float(header["progress_remaining"])
    anew = env.load_state(arrays["environment"].tobytes())
    observation = {
        key.removeprefix("observation."): value
        for key, value in arrays.items()
        if key.startswith("observation.")
    }
    if anew:
        arrays["episode_starts"][anew] = True
        for key, value in env.simulation.observation().items():
            observation[key][anew] = value[anew]
    model._last_obs = observation
    model._last_episode_starts = arrays["episode_starts"]
    # SB3 makes the statistics' buffers when it starts learning, unless they are there.
    model.ep_info_buffer = deque(header["episodes"], maxlen=model._stats_window_size)
    model.ep_success_buffer = deque(maxlen=model._stats_window_size)
    _set_random_state(header["random"], arrays)


def load_policy_weights(path: Path, policy: torch.nn.Module) -> int:
    """Load a checkpoint's weights into a policy and return the checkpoint's step.

    Raises:
        InputError: The file is no checkpoint or its network has other shapes.
    """
    weights, _, header, _ = _read(path, torch.device("cpu"))
    try:
        policy.load_state_dict(weights)
    except RuntimeError as error:
        raise _other_network(path, error) from error
    return int(header["num_timesteps"])


@contextmanager
def preserved_random_state() -> Iterator[None]:
    """Put every global random generator back where it was, whatever the block draws."""
    generators, arrays = _random_state()
    try:
        yield
    finally:
        _set_random_state(generators, arrays)


def _read(
    path: Path, device: torch.device
) -> tuple[dict[str, torch.Tensor], dict[str, Any], dict[str, Any], dict[str, NDArray]]:
    expected = "a checkpoint written by sim2vr-harness train"
    try:
        with zipfile.ZipFile(path) as archive:
            weights = _tensors(archive, "policy.pth", device)
            optimizer = _tensors(archive, "policy.optimizer.pth", device)
            with np.load(io.BytesIO(archive.read(_RESUME)), allow_pickle=False) as loaded:
                arrays = {key: loaded[key] for key in loaded.files}
    except FileNotFoundError as error:
        raise InputError("RUN", f"{str(path)!r}, which does not exist", expected) from error
    except (zipfile.BadZipFile, KeyError, OSError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise InputError("RUN", f"{str(path)!r} ({reason})", expected) from error
    header = json.loads(arrays.pop("header").tobytes())
    if header["format"] != FORMAT:
        raise InputError(
            "RUN",
            f"{str(path)!r} of format {header['format']} (written by {header['version']})",
            f"format {FORMAT}; use that version of sim2vr-harness",
        )
    return weights, optimizer, header, arrays


def _tensors(archive: zipfile.ZipFile, name: str, device: torch.device) -> dict[str, Any]:
    content = io.BytesIO(archive.read(name))
    tensors: dict[str, Any] = torch.load(content, map_location=device, weights_only=True)
    return tensors


def _load_weights(path: Path, model: PPO, weights: dict[str, torch.Tensor]) -> None:
    try:
        model.policy.load_state_dict(weights)
    except RuntimeError as error:
        raise _other_network(path, error) from error


def _other_network(path: Path, error: RuntimeError) -> InputError:
    reason = " ".join(str(error).split())
    return InputError(
        "RUN", f"{str(path)!r}, whose network differs ({reason})", "the network of config.yaml"
    )


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


def _random_state() -> tuple[dict[str, Any], dict[str, NDArray]]:
    name, keys, position, has_gauss, gauss = np.random.get_state(legacy=True)  # noqa: NPY002
    python = random.getstate()
    header = {
        "python": [python[0], list(python[1]), python[2]],
        "numpy": [str(name), int(position), int(has_gauss), float(gauss).hex()],
    }
    arrays = {"random.numpy": np.array(keys), "random.torch": torch.get_rng_state().numpy().copy()}
    if torch.cuda.is_available():
        arrays["random.cuda"] = torch.cuda.get_rng_state().numpy().copy()
    return header, arrays


def _set_random_state(header: dict[str, Any], arrays: dict[str, NDArray]) -> None:
    version, internal, gauss_next = header["python"]
    random.setstate((version, tuple(internal), gauss_next))
    name, position, has_gauss, gauss = header["numpy"]
    state = (name, arrays["random.numpy"], position, has_gauss, float.fromhex(gauss))
    np.random.set_state(state)  # noqa: NPY002
    torch.set_rng_state(torch.from_numpy(arrays["random.torch"].copy()))
    if "random.cuda" in arrays and torch.cuda.is_available():
        torch.cuda.set_rng_state(torch.from_numpy(arrays["random.cuda"].copy()))
