"""A trained teacher beside a student: what it would do, and what the picture shows."""

import fnmatch
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from sim2vr_harness.client.frames import pose_to_app
from sim2vr_harness.envs.privileged import OBSERVATION
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.policies.teacher import load_teacher
from sim2vr_harness.runs.teacher_config import TeacherConfig
from sim2vr_harness.training.teacher.env import game_of, privileged_senses

_FARTHEST = 3.0
"""Deviations from the mean at which numbers are cut."""
_TARGET_FIELDS = ("present", "x_m", "y_m", "z_m")
_NEAREST_M = 0.1
"""What is nearer to the eyes, or behind them, is not looked at."""
SCALE_STEPS, SCALE_EVERY = 120, 4
"""User steps in which the teacher shows what a body goes through."""


class TeacherExpert:
    """See :class:`~sim2vr_harness.training.dagger.dagger.Guide`.

    Args:
        file: the teacher's weights.
        config: the teacher's.
        simulation: the student's users, in this process.
    """

    def __init__(self, file: Path, config: TeacherConfig, simulation: Simulation) -> None:
        game = game_of(simulation.config)
        self._senses = privileged_senses(simulation, config, game, simulation.config)
        self._policy = load_teacher(file, self._senses.space, simulation.action_space)
        known = {f"felt {name}" for name in self._senses.names} | set(self._senses.names)
        self._game = [i for i, name in enumerate(self._senses.observed_names) if name in known]
        self._attention_targets = game.attention_targets
        told = [self._senses.observed_names[i].removeprefix("felt ") for i in self._game]
        self.crop_columns = tuple(
            tuple(i for i, name in enumerate(told) if name.startswith(f"{target}."))
            for target in self._attention_targets
        )
        self._facts = [name for name in self._senses.names if fnmatch.fnmatchcase(name, game.facts)]

    def actions(self, simulation: Any) -> NDArray[np.float32]:
        return self._policy.act({OBSERVATION: self._senses.observe()})

    def facts(self, simulation: Any) -> NDArray[np.float32]:
        """See the protocol: which places have a target."""
        columns = [self._senses.seen(name) for name in self._facts]
        if not columns:
            return np.zeros((simulation.n, 0), np.float32)
        return np.clip(np.stack(columns, axis=1), 0.0, 1.0)

    def numbers(self, simulation: Any) -> NDArray[np.float32]:
        """See the protocol: what the teacher observes of the game, as its network takes it."""
        with torch.inference_mode():
            told = {OBSERVATION: torch.from_numpy(self._senses.observe())}
            scaled: NDArray[np.float32] = self._policy.normaliser(told).numpy()
        return np.clip(scaled[:, self._game], -_FARTHEST, _FARTHEST)

    def crop_places(self, simulation: Any) -> NDArray[np.float32]:
        """See the protocol: places of the game's ``attention_targets``, as the head is now."""
        heads = pose_to_app(*simulation.users.device_poses("headset"))
        told = [
            np.stack([self._senses.field(f"{name}.{part}") for part in _TARGET_FIELDS], 1)
            for name in self._attention_targets
        ]
        return seen_at(np.stack(told, 1), heads[:, 3:])

    def proprioception_scale(
        self, simulation: Simulation
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return proprioception_scale(self, simulation)


def seen_at(told: NDArray[np.floating[Any]], head_xyzw: NDArray[np.float64]) -> NDArray[np.float32]:
    """Where in the picture things are.

    Args:
        told: (N, G, 4) whether there is one, and where it is from the head, m, in the app's frame.
        head_xyzw: (N, 4) how the heads are turned, app frame.

    Returns:
        (N, G, 3) tangents of the angles right and up of straight ahead, at most 10, and 1 if there
        is one before the eyes, else 0.
    """
    # In the frame of the head: turned back by the conjugate.
    axis, w = -head_xyzw[:, None, :3], head_xyzw[:, None, 3:]
    off = told[..., 1:].astype(np.float64)
    off = off + 2.0 * np.cross(axis, np.cross(axis, off) + w * off)
    ahead = off[..., 2]
    there = (told[..., 0] > 0.0) & (ahead > _NEAREST_M)
    place = np.clip(off[..., :2] / np.maximum(ahead, _NEAREST_M)[..., None], -10.0, 10.0)
    place *= there[..., None]
    return np.concatenate([place, there[..., None]], 2).astype(np.float32)


def proprioception_scale(
    guide: Any, simulation: Simulation
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean and standard deviation of the proprioception while a guide plays, (P,) each.

    The users' present rounds are lost.
    """
    simulation.reset(seeds=list(range(simulation.n)))
    seen = []
    for step in range(SCALE_STEPS):
        if step % SCALE_EVERY == 0:
            seen.append(simulation.proprioception.observe(simulation.users))
        simulation.renew(simulation.step(guide.actions(simulation)))
    values = np.concatenate(seen).astype(np.float64)
    return values.mean(0), values.std(0)
