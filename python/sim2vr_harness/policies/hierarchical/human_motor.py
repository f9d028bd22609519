"""The human motor policy: moves hands by a delayed sense of the body and an internal model.

The user feels its body late. A learned forward model of the body predicts the present from what is
felt and from the user's own last commands (Wolpert and Ghahramani 2000, Nature Neuroscience 3).
The policy acts on that prediction, and decides when a movement is over.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from sim2vr_harness.envs.config import UserConfig, body_of, people_of
from sim2vr_harness.policies.hierarchical.human_goals import (
    HUMAN_GOAL_SIZE,
    GoalPerception,
    HumanGoals,
    describe_human,
)
from sim2vr_harness.policies.hierarchical.motor_goals import MOMENT_S, tips
from sim2vr_harness.policies.hierarchical.motor_policy import MotorPolicy
from sim2vr_harness.users import Body, Physique, UserBatch, held
from sim2vr_harness.world_models.body_dynamics import BodyModel, mlp
from sim2vr_harness.world_models.person_features import ImaginedPersons
from sim2vr_harness.world_models.transitions import Motion

__all__ = ["HumanHands", "HumanMotorPolicy", "people_policy"]

_CLIP = 8.0
_LOGIT, _FIRST_LOGIT = 4.0, -0.6
"""Of the decision that a movement is over: factor on the network's output, and its first bias."""


class HumanMotorPolicy(nn.Module):
    """A motor policy for all persons of a population.

    Args:
        body: what persons share.
        step_s: duration of a user step.
        persons: how persons stand in tensors.
        width: of the two hidden layers.
        body_width: of the forward model's hidden layers.
        perception: arguments of :class:`GoalPerception`: how users misjudge goals.
    """

    mean: Tensor
    std: Tensor

    def __init__(
        self,
        body: Body,
        step_s: float,
        persons: ImaginedPersons,
        *,
        width: int = 256,
        body_width: int = 128,
        perception: Mapping[str, float] | None = None,
    ) -> None:
        super().__init__()
        self._misjudged = dict(perception or {})
        self.body, self.step_s, self.hands = body, step_s, held(body.devices)
        self.persons, self.width, self.body_width = persons, width, body_width
        self.forward_model = BodyModel(
            body, self.hands, step_s, width=body_width, persons=persons
        ).requires_grad_(False)
        self.drives = self.forward_model.drives
        low, high = torch.tensor(body.joint_ranges.T.copy(), dtype=torch.float32)
        self._low, self._span = low, high - low
        self.motion_size = 2 * len(body.independent_joints) + len(self.drives.names)
        self.size = self.motion_size + HUMAN_GOAL_SIZE * len(self.hands) + len(persons.names)
        self.register_buffer("mean", torch.zeros(self.size))
        self.register_buffer("std", torch.ones(self.size))
        self.net = mlp(self.size, width, width, self.drives.count + len(self.hands))
        with torch.no_grad():
            last = self.net[-1]
            assert isinstance(last, nn.Linear)
            last.weight.mul_(0.1)
            last.bias.zero_()
            last.bias[self.drives.count :] = _FIRST_LOGIT

    def __repr__(self) -> str:
        """Return the body, the hands and the sizes of observation and action."""
        sizes = f"{self.size} numbers observed, {self.drives.count} actions"
        return f"HumanMotorPolicy({self.body.name}, {' and '.join(self.hands)}: {sizes})"

    def begin_with(self, plain: MotorPolicy) -> None:
        """Take over a plain motor policy of the body; what is new counts nothing yet."""
        hands, motion, count = len(self.hands), self.motion_size, self.drives.count
        goal = (plain.size - motion) // hands
        columns = list(range(motion))
        for hand in range(hands):
            first = motion + hand * HUMAN_GOAL_SIZE
            columns += range(first, first + goal)
        old, new = plain.net.state_dict(), self.net.state_dict()
        new["0.weight"].zero_()[:, columns] = old["0.weight"]
        new["4.weight"][count:] = 0.0
        new["4.weight"][:count], new["4.bias"][:count] = old["4.weight"], old["4.bias"]
        for name in ("0.bias", "2.weight", "2.bias"):
            new[name] = old[name]
        self.net.load_state_dict(new)
        self.mean[columns], self.std[columns] = plain.mean, plain.std

    def places(self, motion: Motion) -> tuple[Tensor, Tensor]:
        """(B, H, 4, 4) each: where the hands' devices are, and ``MOMENT_S`` later."""
        angles = torch.cat([motion.angles, motion.angles + MOMENT_S * motion.speeds])
        both = self.forward_model.places(angles, motion.persons.repeat(2, 1))
        now, soon = both.chunk(2)
        return now, soon

    def perception(self, n: int, generator: torch.Generator | None = None) -> GoalPerception:
        """Return where N users believe that goals are; errors are drawn from the generator."""
        known = self._misjudged
        return GoalPerception(
            n,
            len(self.hands),
            self.step_s,
            weber=known.get("weber", 0.0),
            least_m=known.get("least_m", 0.0),
            late_steps=int(known.get("late_steps", 0)),
            generator=generator,
        )

    def observe(self, believed: Motion, goals: Tensor) -> Tensor:
        """(B, size) what it acts on; ``goals`` as :func:`describe_human` returns them."""
        unit = 2.0 * (believed.angles - self._low) / self._span - 1.0
        parts = [unit, believed.speeds, self.drives.observe(believed.drives), goals.flatten(1)]
        return torch.cat([*parts, self.persons.features(believed.persons)], 1)

    def normalised(self, observation: Tensor) -> Tensor:
        """(B, size) observations in units of what is usual."""
        return ((observation - self.mean) / self.std).clamp(-_CLIP, _CLIP)

    def forward(self, observation: Tensor) -> Tensor:
        """(B, A + H) actions, not clipped, and logits of movements that are over."""
        out: Tensor = self.net(self.normalised(observation))
        actions, over = out[:, : self.drives.count], out[:, self.drives.count :]
        return torch.cat([0.5 * actions, _LOGIT * over], 1)

    def predicted(self, felt: Motion, actions: Tensor) -> Motion:
        """Return the present, as predicted from the motion a step ago and the actions since."""
        motion: Motion = self.forward_model(felt, self.drives.control(felt.drives, actions))
        return motion

    def header(self) -> dict[str, Any]:
        """Return what it is made for."""
        return {
            "actions": list(self.body.action_names),
            "joints": list(self.body.independent_joints),
            "hands": list(self.hands),
            "step_s": self.step_s,
            "width": self.width,
            "body_width": self.body_width,
            "people": True,
            "perception": self._misjudged,
        }

    def weights(self) -> Mapping[str, Tensor]:
        """Return what is learned; where the hands are follows from the body."""
        own = self.state_dict()
        return {name: own[name] for name in own if "._chains." not in name}

    def take(self, weights: Mapping[str, Tensor]) -> None:
        """Take over :meth:`weights` of a policy of the same body, step and widths."""
        self.load_state_dict({**self.state_dict(), **weights})


class _Cut:
    """The bodies of a configuration's persons, as :class:`ImaginedPersons` reads them."""

    def __init__(self, user: UserConfig) -> None:
        self._user, self.people = user, people_of(user)

    def body_for(self, physique: Physique) -> Body:
        return body_of(self._user.model_copy(update={"person": physique}))


def people_policy(
    user: UserConfig,
    step_s: float,
    *,
    width: int = 256,
    body_width: int = 128,
    perception: Mapping[str, float] | None = None,
) -> HumanMotorPolicy:
    """Return an untrained policy for the persons of a configuration."""
    persons = ImaginedPersons(_Cut(user))  # type: ignore[arg-type]
    return HumanMotorPolicy(
        body_of(user), step_s, persons, width=width, body_width=body_width, perception=perception
    )


class HumanHands:
    """N simulated users that move by a human motor policy, one user step after the other.

    Args:
        policy: of the body.
        n: number of users.
        perception: of their goals; None: they see goals where they are.
    """

    def __init__(
        self, policy: HumanMotorPolicy, n: int, perception: GoalPerception | None = None
    ) -> None:
        self.policy, self._perception = policy, perception
        self._felt: Motion | None = None
        self._did = torch.zeros(n, policy.drives.count)
        self._new = torch.ones(n, dtype=torch.bool)
        self._placed: tuple[Tensor, Tensor] | None = None

    def __deepcopy__(self, memo: dict[int, Any]) -> HumanHands:
        """Return a copy with the same policy: the memory of an episode is copied, no weights."""
        new = copy.copy(self)
        for name, value in vars(self).items():
            if name != "policy":
                setattr(new, name, copy.deepcopy(value, memo))
        return new

    def aim_anew(self, ids: Tensor, far: Tensor) -> None:
        """Let goals of users (K,) be new ones, at distances (K, H) from their hands."""
        if self._perception is not None and len(ids):
            self._perception.forget(ids, far)

    def forget(self, ids: NDArray[np.int64]) -> None:
        """Let users (K,) be in new episodes: they know their first posture."""
        self._new[torch.from_numpy(ids)] = True

    def motion(self, users: UserBatch, persons: NDArray[np.float64]) -> Motion:
        """Return the true motion of simulated users who are persons (N, P)."""
        body = self.policy.body
        parts = (
            users.qpos[:, body.qpos_independent],
            users.qvel[:, body.qvel_independent],
            self.policy.drives.of(users),
            persons,
        )
        return Motion(*(torch.from_numpy(np.asarray(part)).float() for part in parts))

    def act(self, now: Motion, goals: HumanGoals) -> tuple[NDArray[np.float32], Tensor]:
        """(N, A) actions of a user step, and (N, H) probabilities that movements are over.

        Args:
            now: the true motion; users feel it a user step later.
            goals: of this user step.
        """
        policy = self.policy
        with torch.no_grad():
            believed = now if self._felt is None else policy.predicted(self._felt, self._did)
            new = self._new[:, None]
            believed = Motion(
                torch.where(new, now.angles, believed.angles),
                torch.where(new, now.speeds, believed.speeds),
                torch.where(new, now.drives, believed.drives),
                now.persons,
            )
            placed = policy.places(believed)
            seen = self._seen(goals, placed[0])
            observed = policy.observe(believed, describe_human(seen, *placed))
            actions, over = policy(observed).split([policy.drives.count, len(policy.hands)], 1)
            self._did = actions.clamp(-1.0, 1.0)
            self._felt, self._new = now, torch.zeros_like(self._new)
        return self._did.numpy(), torch.sigmoid(over)

    def _seen(self, goals: HumanGoals, place: Tensor) -> HumanGoals:
        if self._perception is None:
            return goals
        far = (goals.place - tips(place, goals.tip)).norm(dim=-1)
        self._perception.look(far)
        return replace(goals, place=goals.place + self._perception.error())
