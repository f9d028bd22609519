"""The users' senses and actions as a configuration asks for them."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.client import HapticPulse, SoundEvent
from sim2vr_harness.client.frames import pose_to_app
from sim2vr_harness.envs.actions import Actions
from sim2vr_harness.envs.app_group import AppGroup
from sim2vr_harness.envs.config import EnvConfig, people_of
from sim2vr_harness.perception import (
    OwnDelays,
    Perception,
    Proprioception,
    StepContext,
    Surroundings,
    make_sense,
)
from sim2vr_harness.users import Body, Persons
from sim2vr_harness.users.batch import UserBatch


def make_actions(config: EnvConfig, n: int, body: Body) -> Actions:
    """The actions of N users with such bodies.

    Raises:
        ValueError: fingers work the inputs of a controller that is not worn.
    """
    for name in config.user.inputs:
        worn = f"controller_{name.partition('.')[0]}"
        if worn not in body.devices:
            raise ValueError(
                f"user.inputs: got {name!r}, expected inputs of what the body wears: "
                f"{', '.join(body.devices)}"
            )
    step_s = 1.0 / config.action_frequency_hz
    return Actions(n, body.action_names, config.user.inputs, config.gaze_range_deg, step_s)


def make_perception(
    config: EnvConfig,
    n: int,
    proprioception: Proprioception,
    substeps: int,
    actions: int,
    who: Persons | None = None,
) -> Perception:
    """Return the senses of N users.

    Args:
        config: settings of the senses.
        proprioception: of their bodies.
        substeps: physics steps per user step.
        actions: number of actions of each user.
        who: the users' persons; None: only the spaces are needed.

    Raises:
        ValueError: a setting that cannot be used; names it, the given and the expected value.
    """
    vision = config.vision
    around = Surroundings(
        n=n,
        proprioception=proprioception,
        timestep_s=proprioception.body.timestep,
        substeps=substeps,
        frames_per_step=config.frames_per_step,
        channels=vision.channels,
        eyes=vision.eyes,
        height=vision.height,
        width=vision.width,
        fovea=None if vision.fovea is None else (vision.fovea.height, vision.fovea.width),
        inputs=config.user.inputs,
        gaze_range_deg=config.gaze_range_deg,
        actions=actions,
        head_moves=config.user.head == "reflex",
        person_delays=_person_delays(config, n, who),
    )
    return Perception([make_sense(sense, around) for sense in config.senses])


def _person_delays(config: EnvConfig, n: int, who: Persons | None) -> dict[str, OwnDelays]:
    people = people_of(config.user)
    if people is None:
        return {}

    def own(name: str) -> OwnDelays:
        def now_s() -> NDArray[np.float64]:
            return np.zeros(n) if who is None else who.delays_s[name]

        return OwnDelays(now_s, people.longest(name))

    return {name: own(name) for name in ("visual_delay_s", "proprioceptive_delay_s")}


class Senses:
    """Perception of N users: their bodies and apps.

    Args:
        perception: the senses.
        actions: supplies the positions of fingers and eyes.

    Raises:
        AppUnsupported: an app lacks what a sense needs.
    """

    def __init__(
        self, perception: Perception, users: UserBatch, group: AppGroup, actions: Actions
    ) -> None:
        self.perception = perception
        self._group = group
        for capability in perception.needs:
            for app in group.apps:
                app.require(capability)
        self._moment = StepContext(
            users=users,
            pictures=group.pictures,
            fovea=group.fovea,
            fovea_depth=group.fovea_depth,
            blind=actions.blind,
            time_feature=np.zeros(users.n, dtype=np.float32),
            head_poses=lambda: pose_to_app(*users.device_poses("headset")),
            replied_s=np.zeros(users.n),
            inputs=actions.input_values,
            gaze_deg=actions.gaze_deg,
            actions=actions.last,
        )
        self._events = bool({"haptics", "sounds"} & perception.needs.keys())

    @property
    def pauses(self) -> dict[int, Callable[[], None]]:
        """Return the callbacks by substep of the next user step; see :meth:`UserBatch.step`."""
        return self.perception.pauses(self._moment)

    def reset(self, ids: NDArray[np.int64], seeds: NDArray[np.int64]) -> None:
        """Reset these users, whose apps have shown their first frame."""
        self.perception.reset(ids, seeds)
        self.take(ids)

    def take(self, ids: NDArray[np.int64]) -> None:
        """Update the senses from these users' bodies and their apps' replies."""
        if len(ids) == 0:
            return
        moment = self._moment
        moment.time_feature[ids] = self._group.time_feature[ids]
        if self._events:
            moment.haptics = _replaced(moment.haptics, self._group.haptics, ids)
            moment.sounds = _replaced(moment.sounds, self._group.sounds, ids)
            moment.replied_s[ids] = moment.users.time[ids]
        self.perception.take(moment, None if len(ids) == moment.users.n else ids)

    def state_dict(self, i: int) -> dict[str, Any]:
        """Everything that user i's future perception depends on."""
        moment = self._moment
        return {
            "senses": self.perception.state_dict(i),
            "time_feature": float(moment.time_feature[i]),
            "replied_s": float(moment.replied_s[i]),
            "haptics": [
                (one.hand, one.amplitude, one.frequency_hz, one.duration_s)
                for one in moment.haptics.get(i, ())
            ],
            "sounds": [(one.name, one.position_m, one.gain) for one in moment.sounds.get(i, ())],
        }

    def load_state_dict(self, i: int, state: Mapping[str, Any]) -> None:
        """Restore a state of :meth:`state_dict`."""
        moment = self._moment
        self.perception.load_state_dict(i, state["senses"])
        moment.time_feature[i] = state["time_feature"]
        moment.replied_s[i] = state["replied_s"]
        haptics = {i: tuple(HapticPulse(*one) for one in state["haptics"])}
        sounds = {i: tuple(SoundEvent(*one) for one in state["sounds"])}
        moment.haptics = _replaced(moment.haptics, haptics, np.array([i]))
        moment.sounds = _replaced(moment.sounds, sounds, np.array([i]))


def _replaced(
    kept: Mapping[int, Sequence[Any]], new: Mapping[int, Sequence[Any]], ids: NDArray[np.int64]
) -> dict[int, Sequence[Any]]:
    """Return events by user: new ones for these users, the kept ones for the others."""
    moved = set(ids.tolist())
    events = {i: found for i, found in kept.items() if i not in moved}
    return events | {i: found for i, found in new.items() if i in moved and found}
