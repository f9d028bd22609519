"""A hierarchical policy of a person: late pictures, a refractory period, human movements."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from sim2vr_harness.policies.hierarchical.action_value_map import ActionValueMap
from sim2vr_harness.policies.hierarchical.human_motor import (
    HumanHands,
    HumanMotorPolicy,
    people_policy,
)
from sim2vr_harness.policies.hierarchical.option_policy import (
    HierarchicalPolicy,
    Intention,
    as_reported,
)
from sim2vr_harness.policies.hierarchical.person_layer import human_goals
from sim2vr_harness.policies.hierarchical.pointing import AIM_RAYS
from sim2vr_harness.policies.hierarchical.primitives import PERSONS, OptionChoice
from sim2vr_harness.policies.hierarchical.ray_turning import far_off
from sim2vr_harness.policies.protocol import Observation
from sim2vr_harness.runs.option_config import PeopleTraining
from sim2vr_harness.users import FEATURES
from sim2vr_harness.users.kinematics.forward_torch import Chains
from sim2vr_harness.world_models.transitions import Motion

if TYPE_CHECKING:
    from sim2vr_harness.runs.config import TrainingConfig

RECOGNITION_S = 0.1
"""From what is seen to a decision by it, beside the visual delay (docs/concepts/people.md)."""
REFRACTORY_S = 0.15
"""Psychological refractory period: least time between two decisions (Pashler 1994)."""
_TRAINING = PeopleTraining()
_SAME_M = 0.06
"""A target that has moved less is followed without a new decision."""


def seen_late_steps(visual_delay_s: float, step_s: float) -> int:
    """Return by how many user steps pictures are late that decisions are made by."""
    return round((visual_delay_s + RECOGNITION_S) / step_s)


Seen = tuple[NDArray[np.uint8], Tensor]
"""A picture, and the (1, 4, 4) headset that it was drawn for."""


@dataclass
class PersonMemory(Intention):
    """What a person has decided, seen and felt.

    Attributes:
        hands: what it feels and does.
        pictures: the last pictures and the heads that saw them, the newest last.
        seen: the picture that is seen now, and the head.
        recognised: the picture that decisions are made by now, and the head.
        decided: user steps since the last new decision.
        goal: (1, H, 3) of the last user step.
    """

    hands: HumanHands | None = None
    pictures: list[Seen] = field(default_factory=list)
    seen: Seen | None = None
    recognised: Seen | None = None
    decided: int = 1000
    goal: Tensor | None = None


class PersonPolicy(HierarchicalPolicy):
    """Decides by late pictures and moves as a person; see :class:`HierarchicalPolicy`.

    Args:
        config: of the run, with people and the sense ``person``.
    """

    manner = PERSONS
    vigour: Tensor
    """(1,) what weights of effort are divided by: what earned most (docs/concepts/people.md)."""

    def __init__(self, config: TrainingConfig) -> None:
        super().__init__(config)
        training = _TRAINING
        self.human: HumanMotorPolicy = people_policy(
            config.env.user,
            self.layer.step_s,
            width=training.width,
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

    def learned_by(
        self,
        human: HumanMotorPolicy,
        values: ActionValueMap,
        tool: Tensor,
        hold: int,
        *,
        lifts: bool = True,
        vigour: float = 1.0,
        rays: Tensor = AIM_RAYS,
    ) -> None:
        """Take over what was learned."""
        self.vigour.fill_(vigour)
        self.lifts.fill_(lifts)
        self.human.take(human.weights())
        self.values.load_state_dict(values.state_dict())
        self.tool.copy_(tool)
        self.rays.copy_(rays)
        self.hold.fill_(hold)
        self._primitives = None

    def _begun(self) -> PersonMemory:
        generator = torch.Generator().manual_seed(self._seed)
        hands = HumanHands(self.human, 1, self.human.perception(1, generator))
        hands.vigour = float(self.vigour)
        return PersonMemory(OptionChoice(1, len(self.layer.hands)), hands=hands)

    def _act(self, observation: Observation, memory: Intention) -> NDArray[np.float32]:
        assert isinstance(memory, PersonMemory) and memory.hands is not None
        with torch.no_grad():
            who = self.human.persons.told(observation["person"])
            motion = self._read(observation["proprioception"])
            now = Motion(*motion, torch.from_numpy(who[None]).float())
            placed = self.human.places(now)
            head = self._head(motion[0], self.human.persons.sizes(now.persons))[:, 0]
            head = as_reported(head, observation)
            self._look((np.array(observation["vision"]), head), memory, who)
            if memory.left == 0:
                self._reconsider(memory, placed)
                memory.left = int(self.hold)
            memory.left -= 1
            memory.decided += 1
            goals = self.primitives.goals(memory.choice, head[:, :3, 3], *placed)
            wanted = human_goals(goals)
            if memory.goal is None or float((goals.place - memory.goal).norm()) > _SAME_M:
                memory.hands.aim_anew(torch.arange(1), far_off(wanted, placed[0]))
            memory.goal = goals.place.clone()
            body = memory.hands.act(now, wanted)[0][0]
            return self._with_fingers(body, memory.choice, placed[0])

    def _look(self, now: Seen, memory: PersonMemory, who: NDArray[np.float64]) -> None:
        delay_s, step_s = self.human.persons.visual_delay_s(who), self.layer.step_s
        late = seen_late_steps(delay_s, step_s)
        memory.pictures = [*memory.pictures, now][-1 - late :]
        seen = min(len(memory.pictures), 1 + round(delay_s / step_s))
        memory.seen, memory.recognised = memory.pictures[-seen], memory.pictures[0]

    def _reconsider(self, memory: PersonMemory, placed: tuple[Tensor, Tensor]) -> None:
        """Follow the target by what is seen, or decide anew by what is recognised.

        A decision that follows the last one too soon is not made.
        """
        before, followed = memory.choice, memory.choice.copy()
        assert memory.seen is not None and memory.recognised is not None
        self._decide(memory.seen[0], followed, memory.seen[1], placed)
        if not _differs(followed, before):
            memory.choice = followed
            return
        if memory.decided * self.layer.step_s < REFRACTORY_S - 1e-9:
            return
        anew = before.copy()
        self._decide(memory.recognised[0], anew, memory.recognised[1], placed)
        memory.choice = anew
        if _differs(anew, before):
            memory.decided = 0


def _differs(after: OptionChoice, before: OptionChoice) -> bool:
    """Whether a choice is another decision: another move, or another target."""
    moved = (after.place - before.place).norm(dim=-1) > _SAME_M
    return bool(((after.move != before.move) | (moved & (after.move >= 0))).any())
