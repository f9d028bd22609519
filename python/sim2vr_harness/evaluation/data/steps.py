"""Table of user steps: poses, joints, muscles, fatigue, rewards."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.client import GameFacts
from sim2vr_harness.client.frames import pose_to_app
from sim2vr_harness.envs.simulation import Simulation
from sim2vr_harness.evaluation.data.columns import Column, column_name, number_table
from sim2vr_harness.play.player import Job, Watcher
from sim2vr_harness.play.round import Round
from sim2vr_harness.users.batch import UserBatch

_PARTS = ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")
_DEVICE_NAMES = {"headset": "head", "controller_right": "right", "controller_left": "left"}
"""As the games' logs call them."""
_FATIGUE = {
    "MA": ("active", "Share of its motor units that are active"),
    "MR": ("resting", "Share of its motor units that rest"),
    "MF": ("fatigued", "Share of its motor units that are fatigued"),
    "max_MF": ("most_fatigued", "Largest share of fatigued motor units in the round so far"),
}
"""Arrays of the model 3CC-r: name -> prefix of the columns, and description."""
_AID = "aid."
"""Prefix of privileged numbers that only training uses."""

Take = Callable[[], NDArray[Any]]


def pose_columns(name: str, whose: str) -> list[Column]:
    """Return the seven columns of a pose in the app's frame."""
    words = ("right", "up", "forward")
    places = [
        Column(f"{name}_{part}", "single", "m", f"Position of {whose}, {word}; app's world")
        for part, word in zip(_PARTS[:3], words, strict=True)
    ]
    turns = [
        Column(f"{name}_{part}", "single", "", f"Rotation of {whose}, quaternion {part[1]}")
        for part in _PARTS[3:]
    ]
    return [*places, *turns]


class StepRecorder(Watcher):
    """A watcher that records every step of each user until the round is over.

    Args:
        write: Receives the name of the finished round's job and its table.

    Simulations without a :class:`~sim2vr_harness.users.batch.UserBatch`, stand-ins, have no steps.
    """

    def __init__(
        self, facts: GameFacts, write: Callable[[Round, Callable[[str], Any]], None]
    ) -> None:
        self._facts, self._write = facts, write
        self._source: _Source | None = None
        self._blocks: list[NDArray[np.float32]] = []

    def started(self, simulation: Any, jobs: Sequence[Job]) -> None:
        """Start a new recording."""
        self._blocks = []
        bodies = isinstance(getattr(simulation, "users", None), UserBatch)
        self._source = _Source(simulation, self._facts) if bodies else None

    def stepped(self, reward: NDArray, infos: Sequence[Mapping[str, Any]]) -> None:
        """Record the numbers of all users."""
        if self._source is not None:
            self._blocks.append(self._source.numbers(reward, infos))

    def ended(self, index: int, result: Round) -> None:
        """Write the recorded steps of the user."""
        if self._source is None:
            return
        values = np.stack([block[index] for block in self._blocks])
        columns, dt_s = self._source.columns, self._source.dt_s
        steps = np.arange(1, len(values) + 1)
        counts = [
            (Column("step", "integer", "", "User step of the round, from 1; a key"), steps),
            (Column("time_s", "number", "s", "Game time at the step's end"), steps * dt_s),
        ]
        self._write(result, lambda episode: number_table(episode, counts, values, columns))


class BodySource:
    """Current numbers of N bodies, with descriptions of their columns.

    Args:
        users: The bodies.
    """

    def __init__(self, users: UserBatch) -> None:
        self._users = users
        self.columns: list[Column] = []
        self._takes: list[Take] = []
        self._add_devices()
        model = self._users.body.physics_model
        simple = (mujoco.mjtJoint.mjJNT_HINGE.value, mujoco.mjtJoint.mjJNT_SLIDE.value)
        joints = [model.joint(i) for i in range(model.njnt) if model.jnt_type[i] in simple]
        for joint in joints:
            slide = model.jnt_type[joint.id] == simple[1]
            unit = "m" if slide else "rad"
            what = "Position" if slide else "Angle"
            self.columns.append(
                Column(f"q_{joint.name}", "single", unit, f"{what} of the joint {joint.name}")
            )
        for joint in joints:
            unit = "m/s" if model.jnt_type[joint.id] == simple[1] else "rad/s"
            self.columns.append(
                Column(f"qd_{joint.name}", "single", unit, f"Velocity of the joint {joint.name}")
            )
        angles = np.array([int(model.jnt_qposadr[joint.id]) for joint in joints])
        speeds = np.array([int(model.jnt_dofadr[joint.id]) for joint in joints])
        self._takes += [lambda: self._users.qpos[:, angles], lambda: self._users.qvel[:, speeds]]
        self._add_muscles()

    def take(self) -> NDArray[Any]:
        """Return the present numbers, (N, C), a new array."""
        return np.concatenate([take() for take in self._takes], axis=1)

    def _add_devices(self) -> None:
        for device in self._users.body.devices:
            name = _DEVICE_NAMES.get(device, device)
            self.columns += pose_columns(name, f"the {device.replace('_', ' ')}")

            def take(device: str = device) -> NDArray[Any]:
                return pose_to_app(*self._users.device_poses(device))

            self._takes.append(take)

    def _add_muscles(self) -> None:
        body = self._users.body
        self.columns += [
            Column(f"act_{name}", "single", "", f"Activation of the muscle {name}, 0 to 1")
            for name in body.muscles
        ]
        self._takes.append(lambda: self._users.act)
        for name in body.action_names:
            muscle = name in body.muscles
            what = f"Force of the muscle {name}" if muscle else f"Torque of the motor {name}"
            unit = "N" if muscle else "Nm"
            self.columns.append(
                Column(f"force_{name}", "single", unit, f"{what} at the step's end; pulling: < 0")
            )
        self._takes.append(lambda: self._users.actuator_force)
        loads = (*body.muscles, *body.effort_inputs.loads)
        for key in self._users.effort.state_dict():
            prefix, what = _FATIGUE.get(key, (key.lower(), f"{key} of the effort model"))
            self.columns += [Column(f"{prefix}_{n}", "single", "", f"{n}: {what}") for n in loads]

            def take(key: str = key) -> NDArray[Any]:
                return self._users.effort.state_dict()[key]

            self._takes.append(take)


class _Source:
    """Sources of N users' numbers, with descriptions of their columns."""

    def __init__(self, simulation: Simulation, facts: GameFacts) -> None:
        self.dt_s = simulation.users.dt
        body = BodySource(simulation.users)
        self.columns: list[Column] = list(body.columns)
        self._takes: list[Take] = [body.take]
        self._terms = [term.log_key for term in facts.reward_terms]
        # The controllers' inputs that the user's fingers work.
        names = simulation.config.user.inputs
        if names:
            self.columns += [
                Column(f"input_{column_name(name)}", "single", "", f"The input {name}, -1 to 1")
                for name in names
            ]
            self._takes.append(lambda: simulation.actions.input_values.copy())
        self._add_game(simulation)
        self.columns += [
            Column("reward", "single", "reward", "Game's reward minus effort cost, of the step"),
            Column("game_reward", "single", "reward", "Reward that the game gave for the step"),
            Column("effort_cost", "single", "reward", "What the effort model took off"),
            *(
                Column(
                    f"term_{column_name(term.log_key)}",
                    "single",
                    "reward",
                    f"Part of the game's reward: {term.label}",
                )
                for term in facts.reward_terms
            ),
        ]

    def numbers(
        self, reward: NDArray[Any], infos: Sequence[Mapping[str, Any]]
    ) -> NDArray[np.float32]:
        """(N, C) float32, fresh."""
        rewards = [
            [
                total,
                info["game_reward"],
                info["effort_cost"],
                *(info.get("log", {}).get(key, np.nan) for key in self._terms),
            ]
            for total, info in zip(reward.tolist(), infos, strict=True)
        ]
        parts = [take() for take in self._takes]
        return np.concatenate([*parts, np.array(rewards)], axis=1, dtype=np.float32)

    def _add_game(self, simulation: Simulation) -> None:
        """Add the game's privileged numbers, of apps in this process."""
        batch: Any = getattr(simulation.apps[0], "batch", None)
        names = () if batch is None else batch.privileged_names
        shown = [i for i, name in enumerate(names) if not name.startswith(_AID)]
        if not shown:
            return
        self.columns += [
            Column(
                f"game_{column_name(names[i])}",
                "single",
                _UNITS.get(names[i].rpartition("_")[2], ""),
                f"The game's privileged number {names[i]} (its page or game.hpp explains it)",
            )
            for i in shown
        ]
        self._takes.append(lambda: batch.privileged[:, shown])


_UNITS = {"mps": "m/s", "m": "m", "s": "s", "deg": "deg", "bits": "bit", "bps": "bit/s"}
