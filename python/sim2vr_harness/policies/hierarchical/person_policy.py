"""A hierarchical policy of a person: late pictures, a refractory period, human movements."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from sim2vr_harness.policies.hierarchical.human_motor import (
    RECOGNITION_S,
    SAME_M,
    HumanHands,
    HumanMotorPolicy,
    far_off,
    people_policy,
)
from sim2vr_harness.policies.hierarchical.motor_policy import MotorGoals
from sim2vr_harness.policies.hierarchical.option_policy import (
    HierarchicalPolicy,
    Memory,
    Moment,
    as_reported,
)
from sim2vr_harness.policies.hierarchical.primitives import PERSONS, OptionChoice
from sim2vr_harness.policies.protocol import Observation
from sim2vr_harness.runs.option_config import PeopleTraining
from sim2vr_harness.users import FEATURES
from sim2vr_harness.users.kinematics.forward_torch import Chains
from sim2vr_harness.world_models.transitions import Motion

if TYPE_CHECKING:
    from sim2vr_harness.runs.config import TrainingConfig

REFRACTORY_S = 0.15
"""Psychological refractory period: least time between two decisions (Pashler 1994)."""
_TRAINING = PeopleTraining()
_LONG_AGO = 1000


def seen_late_steps(visual_delay_s: float, step_s: float) -> int:
    """Return by how many user steps pictures are late that decisions are made by."""
    return round((visual_delay_s + RECOGNITION_S) / step_s)


class PersonMemory(Memory):
    """Decisions, images and proprioception of N persons in their episodes.

    Attributes:
        bodies: proprioception and motor state of the persons.
        decided: (N,) user steps since the last new decision.
        goal: (N, H, 3) goals of the last user step.
    """

    def __init__(self, n: int, bodies: HumanHands) -> None:
        super().__init__(n, len(bodies.policy.hands))
        self.bodies = bodies
        self.decided = np.full(n, _LONG_AGO)
        self.goal = torch.full_like(self.choice.place, torch.inf)

    def forget(self, users: list[int]) -> None:
        """Reset the memory of these users for a new episode."""
        super().forget(users)
        self.bodies.forget(users)
        self.decided[users], self.goal[users] = _LONG_AGO, torch.inf

    def state_dict(self) -> dict[str, Any]:
        """Return a copy of all of it as tensors."""
        own = {"decided": torch.tensor(self.decided), "goal": self.goal.clone()}
        return super().state_dict() | own | {"bodies": self.bodies.state_dict()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from :meth:`state_dict`."""
        super().load_state_dict(state)
        self.decided, self.goal = state["decided"].numpy().copy(), state["goal"].clone()
        self.bodies.load_state_dict(state["bodies"])


class PersonPolicy(HierarchicalPolicy):
    """Decides by late pictures and moves as a person; see :class:`HierarchicalPolicy`.

    Args:
        config: of the run, with people and the sense ``person``.
    """

    manner = PERSONS
    vigour: Tensor
    """(1,) divisor of effort weights, the one with the highest score (docs/concepts/people.md)."""
    draws: np.random.Generator | None = None
    """Draws the seeds of what users misjudge in each episode; None: all of them are the run's."""

    def __init__(self, config: TrainingConfig) -> None:
        super().__init__(config)
        training = _TRAINING
        self.human: HumanMotorPolicy = people_policy(
            config.env.user,
            self.layer.step_s,
            body_width=training.body_width,
            perception=training.perception,
        ).requires_grad_(False)
        # Persons move by ``human``: the other motor layer's weights only keep their place.
        for weight in self.motor.parameters():
            nn.init.zeros_(weight)
        # Eyes of tall persons are higher.
        chains = Chains(self.human.body, ("headset",), self.human.persons.references)
        object.__setattr__(self, "_head", chains)
        self._seed = config.seed
        self.register_buffer("vigour", torch.ones(1))
        self._wanted["person"] = (len(FEATURES),)

    def _begun(self, n: int) -> PersonMemory:
        generators = [torch.Generator() for _ in range(n)]
        bodies = HumanHands(self.human, n, self.human.perception(n, generators))
        bodies.vigour = float(self.vigour)
        memory = PersonMemory(n, bodies)
        self._forget(memory, list(range(n)))
        return memory

    def _forget(self, memory: Memory, users: list[int]) -> None:
        super()._forget(memory, users)
        assert isinstance(memory, PersonMemory)
        generators = getattr(memory.bodies.perception, "generators", None) or ()
        for user in users:
            seed = self._seed if self.draws is None else int(self.draws.integers(2**31))
            generators[user].manual_seed(seed)

    def _feel(self, observations: Observation) -> Moment:
        persons, step_s = self.human.persons, self.layer.step_s
        who = [persons.told(each) for each in observations["person"]]
        delays_s = [persons.visual_delay_s(each) for each in who]
        felt = self._read(observations["proprioception"])
        motion = Motion(*felt, torch.from_numpy(np.stack(who)).float())
        head = self._head(motion.angles, persons.sizes(motion.persons))[:, 0]
        return Moment(
            motion,
            self.human.places(motion),
            as_reported(head, observations),
            np.array([round(delay_s / step_s) for delay_s in delays_s]),
            np.array([seen_late_steps(delay_s, step_s) for delay_s in delays_s]),
        )

    def _reconsider(self, moment: Moment, memory: Memory, due: NDArray[np.bool_]) -> None:
        """Follow the target by what is seen, or decide anew by what is recognised.

        A decision that follows the last one too soon is not made.
        """
        assert isinstance(memory, PersonMemory)
        before = memory.choice.copy()
        followed = self._best(self.scene(moment, memory, moment.follows), before)
        other = _differs(followed, before)
        memory.choice.put(due & ~other, followed)
        ready = memory.decided * self.layer.step_s >= REFRACTORY_S - 1e-9
        due = due & other & ready
        if due.any():
            anew = self._best(self.scene(moment, memory, moment.decides), before)
            memory.choice.put(due, anew)
            memory.decided[due & _differs(anew, before)] = 0

    def _drive(self, moment: Moment, goals: MotorGoals, memory: Memory) -> NDArray[np.float32]:
        assert isinstance(memory, PersonMemory)
        memory.decided += 1
        moved = (goals.place - memory.goal).flatten(1).norm(dim=1) > SAME_M
        users = torch.nonzero(moved).flatten()
        memory.bodies.aim_anew(users, far_off(goals, moment.placed[0])[users])
        memory.goal = goals.place.clone()
        return memory.bodies.act(moment.motion, goals)[0]


def _differs(after: OptionChoice, before: OptionChoice) -> NDArray[np.bool_]:
    """Return (N,) True for users with a new decision: another move, or another target."""
    moved = (after.place - before.place).norm(dim=-1) > SAME_M
    found: NDArray[np.bool_] = (
        ((after.move != before.move) | (moved & (after.move >= 0))).any(1).numpy()
    )
    return found
