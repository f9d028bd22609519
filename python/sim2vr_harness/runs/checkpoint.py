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
import struct
import zipfile
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from pickle import UnpicklingError
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from sim2vr_harness import __version__
from sim2vr_harness.base import files
from sim2vr_harness.client.errors import AppDied, AppTimeout
from sim2vr_harness.base.errors import InputError, UnusableFile, reason
from sim2vr_harness.base.finite import NotFinite, first_not_finite, require_finite
from sim2vr_harness.base.signals import interrupts_deferred
from sim2vr_harness.training.ppo.ppo import PPO
from sim2vr_harness.runs.run_folder import checkpoints_in, step_of, write_atomically
from sim2vr_harness.training.ppo.vec_env import SimulationVecEnv

__all__ = [
    "Snapshot",
    "last_good",
    "load_policy_weights",
    "preserved_random_state",
    "read_tensors",
    "require_readable",
    "restore",
    "take",
    "write_tensors",
    "write_user",
]

FORMAT = 1
_EXPECTED = "a checkpoint written by sim2vr-harness train"
_RESUME = "resume.npz"
_MEMBERS = ("policy.pth", "policy.optimizer.pth", _RESUME)


DAMAGE = (
    *(ArithmeticError, AssertionError, AttributeError, EOFError, LookupError, RuntimeError),
    *(TypeError, ValueError, UnpicklingError, struct.error),
)
"""What taking in a state that can be decoded, and is of something else, may raise."""


def in_words(error: Exception) -> str:
    """Return why a file cannot be used, on one line."""
    return error.got if isinstance(error, InputError) else reason(error)


def write_tensors(path: Path, content: Mapping[str, Any]) -> None:
    """Write tensors so that the file is either complete or not there."""
    stream = io.BytesIO()
    with interrupts_deferred():
        torch.save(dict(content), stream)
    write_atomically(path, stream.getvalue())


def read_tensors(path: Path, expected: str) -> dict[str, Any]:
    """Read what :func:`write_tensors` has written, onto the CPU: tensors and plain values only.

    Args:
        path: the file.
        expected: what it should be, for people.

    Raises:
        UnusableFile: it is something else, or damaged.
    """
    try:
        return files.read_tensors(path, expected)
    except InputError as error:
        raise UnusableFile(path, error.got, expected) from error


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
            members.writestr(_RESUME, arrays.getvalue(), zipfile.ZIP_DEFLATED)
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
        UnusableFile: The file is no checkpoint, is damaged or belongs to another configuration. The
            learner and its environment may be at no moment at all then: they are to be made anew.
    """
    weights, optimizer, header, arrays = _good(path, model.policy, model.device)
    env = model.get_env()
    assert isinstance(env, SimulationVecEnv)
    try:
        model.policy.load_state_dict(weights)
        model.policy.optimizer.load_state_dict(optimizer)
        _require_same_shapes(model.policy.optimizer)
        model.num_timesteps = int(header["num_timesteps"])
        model._n_updates = int(header["n_updates"])
        model._current_progress_remaining = float(header["progress_remaining"])
        anew = env.load_state(arrays["environment"].tobytes())
        observation = {
            key.removeprefix("observation."): value
            for key, value in arrays.items()
            if key.startswith("observation.")
        }
        starts = arrays["episode_starts"]
        if anew:
            starts[anew] = True
            for key, value in env.simulation.observation().items():
                observation[key][anew] = value[anew]
        model._last_obs, model._last_episode_starts = observation, starts
        # SB3 makes the statistics' buffers when it starts learning, unless they are there.
        model.ep_info_buffer = deque(header["episodes"], maxlen=model._stats_window_size)
        model.ep_success_buffer = deque(maxlen=model._stats_window_size)
        _set_random_state(header["random"], arrays)
    except (AppDied, AppTimeout):
        raise  # the file may be good
    except DAMAGE as error:
        instead = last_good(path, model.policy)
        raise UnusableFile(path, in_words(error), _EXPECTED, instead) from error


def load_policy_weights(path: Path, policy: torch.nn.Module) -> int:
    """Load a checkpoint's weights into a policy and return the checkpoint's step.

    Raises:
        UnusableFile: The file is no checkpoint, is damaged or its network has other shapes.
    """
    weights, _, header, _ = _good(path, policy, torch.device("cpu"))
    policy.load_state_dict(weights)
    return int(header["num_timesteps"])


def write_user(path: Path, policy: torch.nn.Module, step: int) -> None:
    """Write a user who does not learn on: a checkpoint that holds weights and the step only."""
    archive, arrays = io.BytesIO(), io.BytesIO()
    header = {"format": FORMAT, "version": __version__, "num_timesteps": step}
    np.savez(arrays, header=np.frombuffer(json.dumps(header).encode(), dtype=np.uint8))
    contents: tuple[dict[str, Any], ...] = (dict(policy.state_dict()), {})
    with interrupts_deferred(), zipfile.ZipFile(archive, "w") as members:
        for name, content in zip(_MEMBERS, contents, strict=False):
            stream = io.BytesIO()
            torch.save(content, stream)
            members.writestr(name, stream.getvalue())
        members.writestr(_RESUME, arrays.getvalue(), zipfile.ZIP_DEFLATED)
    write_atomically(path, archive.getvalue())


def require_readable(path: Path) -> None:
    """Check a checkpoint of which nothing is needed now.

    Raises:
        UnusableFile: It is damaged, or not finite.
    """
    _good(path, None, torch.device("cpu"))


def last_good(path: Path, policy: torch.nn.Module | None) -> Path | None:
    """Return the newest checkpoint before this one that can be read, or None.

    Args:
        path: of a checkpoint.
        policy: the network that it is for; None takes any.
    """
    before = [file for file in checkpoints_in(path.parent) if step_of(file) < step_of(path)]
    for file in reversed(before):
        with suppress(UnusableFile):
            _checked(file, policy, torch.device("cpu"))
            return file
    return None


@contextmanager
def preserved_random_state() -> Iterator[None]:
    """Put every global random generator back where it was, whatever the block draws."""
    generators, arrays = _random_state()
    try:
        yield
    finally:
        _set_random_state(generators, arrays)


_Parts = tuple[dict[str, torch.Tensor], dict[str, Any], dict[str, Any], dict[str, NDArray]]
"""Weights, optimiser, header and arrays of a checkpoint."""


def _good(path: Path, policy: torch.nn.Module | None, device: torch.device) -> _Parts:
    """Read a checkpoint, or say what is wrong with it and which one before it is not."""
    try:
        return _checked(path, policy, device)
    except UnusableFile as error:
        instead = last_good(path, policy)
        expected = error.expected
        raise UnusableFile(path, error.reason, expected, instead) from error


def take_in(path: Path, what: str, take: Callable[[dict[str, Any]], object]) -> None:
    """Read a state that :func:`write_tensors` wrote, and let somebody go on from it.

    Raises:
        UnusableFile: it cannot be read, is of something else, or is not finite.
    """
    state = read_tensors(path, what)
    try:
        take(state)
    except (*DAMAGE, NotFinite) as error:
        raise UnusableFile(path, in_words(error), what) from error


def _checked(path: Path, policy: torch.nn.Module | None, device: torch.device) -> _Parts:
    """Read a checkpoint of this network; see :func:`restore`."""
    if not path.exists():
        raise InputError("RUN", f"{str(path)!r}, which does not exist", _EXPECTED)
    try:
        parts = _read(path, device)
        weights, optimizer, header, _ = parts
        if header["format"] != FORMAT:
            raise ValueError(
                f"format {header['format']}, written by sim2vr-harness {header['version']}, "
                f"expected format {FORMAT}"
            )
        found = first_not_finite({"policy": weights, "optimizer": optimizer})
        if found is not None:
            raise ValueError(f"{found} is not finite")
    except DAMAGE as error:
        raise UnusableFile(path, in_words(error), _EXPECTED) from error
    difference = None if policy is None else _different_network(weights, policy)
    if difference is not None:
        why = f"whose network differs: {difference}"
        raise UnusableFile(path, why, "the network of config.yaml")
    return parts


def _read(path: Path, device: torch.device) -> _Parts:
    weights, optimizer, resume = _MEMBERS
    members = files.read_members(path, _MEMBERS, _EXPECTED)
    arrays = files.parse_arrays(members[resume], resume, _EXPECTED)
    header = files.parse_json(arrays.pop("header").tobytes(), resume, _EXPECTED)
    return (
        files.parse_tensors(members[weights], weights, _EXPECTED, device),
        files.parse_tensors(members[optimizer], optimizer, _EXPECTED, device),
        header,
        arrays,
    )


def _different_network(weights: Mapping[str, torch.Tensor], policy: torch.nn.Module) -> str | None:
    """Return the first weight that a network lacks, has in excess or has in another shape."""
    own = policy.state_dict()
    for name in [*own, *(name for name in weights if name not in own)]:
        have, want = weights.get(name), own.get(name)
        if have is None or want is None or have.shape != want.shape:
            shapes = ["none" if part is None else tuple(part.shape) for part in (have, want)]
            return f"{name} of shape {shapes[0]}, expected {shapes[1]}"
    return None


def _require_same_shapes(optimizer: torch.optim.Optimizer) -> None:
    """Check what torch does not: that moments have the shape of their weights."""
    for weight, state in optimizer.state.items():
        for name, value in state.items():
            if isinstance(value, torch.Tensor) and value.dim() and value.shape != weight.shape:
                shapes = f"{tuple(value.shape)}, expected {tuple(weight.shape)}"
                raise ValueError(f"{name} of the optimiser of shape {shapes}")


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
