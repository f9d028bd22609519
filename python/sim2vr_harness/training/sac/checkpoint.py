"""Checkpoints of SAC: what is learned, the replay buffer and the environment's state."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import SAC
from stable_baselines3.common.buffers import DictReplayBuffer

from sim2vr_harness import __version__
from sim2vr_harness.runs.checkpoint import FORMAT, RESUME, random_state
from sim2vr_harness.training.ppo.vec_env import SimulationVecEnv


def _optimizers(model: SAC) -> dict[str, torch.optim.Optimizer]:
    found = {"actor": model.actor.optimizer, "critic": model.critic.optimizer}
    return found | ({"ent_coef": model.ent_coef_optimizer} if model.ent_coef_optimizer else {})


def learner_state(model: SAC) -> dict[str, Any]:
    """Return all that is learned beside the actor."""
    return {
        "critic": model.critic.state_dict(),
        "critic_target": model.critic_target.state_dict(),
        "optimizers": {name: each.state_dict() for name, each in _optimizers(model).items()},
        "log_ent_coef": None if model.log_ent_coef is None else model.log_ent_coef.detach(),
    }


def load_learner_state(model: SAC, learner: Mapping[str, Any]) -> None:
    """Take over what :func:`learner_state` returned."""
    model.critic.load_state_dict(learner["critic"])
    model.critic_target.load_state_dict(learner["critic_target"])
    for name, optimizer in _optimizers(model).items():
        optimizer.load_state_dict(learner["optimizers"][name])
    if model.log_ent_coef is not None:
        with torch.no_grad():
            model.log_ent_coef.copy_(learner["log_ent_coef"])


def archive(model: SAC, env: SimulationVecEnv) -> bytes:
    """Return the bytes of a checkpoint, the replay buffer left out."""
    generators, arrays = random_state()
    header = {
        "format": FORMAT,
        "version": __version__,
        "num_timesteps": model.num_timesteps,
        "n_updates": model._n_updates,
        "episode_num": model._episode_num,
        "episodes": list(model.ep_info_buffer or []),
        "warm_up": model.action_space.np_random.bit_generator.state,
        "random": generators,
    }
    last: Any = model._last_obs
    arrays |= {f"observation.{key}": np.array(value) for key, value in last.items()}
    arrays["episode_starts"] = np.array(model._last_episode_starts)
    arrays["environment"] = np.frombuffer(env.save_state(), dtype=np.uint8)
    arrays["header"] = np.frombuffer(json.dumps(header).encode(), dtype=np.uint8)
    parts = {"policy.pth": model.actor.state_dict(), "policy.optimizer.pth": learner_state(model)}
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as members:
        for name, content in parts.items():
            stream = io.BytesIO()
            torch.save(content, stream)
            members.writestr(name, stream.getvalue())
        members.writestr(RESUME, npz(arrays), zipfile.ZIP_DEFLATED)
    return archive.getvalue()


def npz(arrays: Mapping[str, NDArray]) -> bytes:
    """Return arrays as the bytes of an npz file."""
    stream = io.BytesIO()
    np.savez(stream, allow_pickle=False, **arrays)
    return stream.getvalue()


_PLAIN = ("actions", "rewards", "dones", "timeouts")
_KEYED = ("observations", "next_observations")


def buffer_arrays(model: SAC) -> dict[str, NDArray]:
    """Return what the replay buffer holds, the part that is filled."""
    buffer = model.replay_buffer
    assert isinstance(buffer, DictReplayBuffer)
    filled = buffer.size()
    arrays = {name: getattr(buffer, name)[:filled] for name in _PLAIN}
    for name in _KEYED:
        arrays |= {f"{name}.{k}": each[:filled] for k, each in getattr(buffer, name).items()}
    return arrays | {"position": np.array([buffer.pos, buffer.full], dtype=np.int64)}


def load_buffer(model: SAC, arrays: Mapping[str, NDArray]) -> None:
    """Fill the replay buffer with what :func:`buffer_arrays` returned."""
    buffer = model.replay_buffer
    assert isinstance(buffer, DictReplayBuffer)
    position, full = (int(value) for value in arrays["position"])
    filled = buffer.buffer_size if full else position
    if not 0 <= position < buffer.buffer_size:
        raise ValueError(f"position {position} of {buffer.buffer_size}")
    for name in _PLAIN:
        getattr(buffer, name)[:filled] = arrays[name]
    for name in _KEYED:
        for key, each in getattr(buffer, name).items():
            each[:filled] = arrays[f"{name}.{key}"]
    buffer.pos, buffer.full = position, bool(full)
