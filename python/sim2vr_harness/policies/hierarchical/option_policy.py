"""Users who decide what to do with what they see, and leave the doing to their motor layer.

Such a user is the network of ``looking`` itself: no student learns to do the same. It remembers
what it has decided, and sees it through; a policy from senses to muscles has nothing to remember
that with, and loses what takes longer than a user step (docs/concepts/training.md).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.envs.config import EnvConfig, body_of
from sim2vr_harness.perception.proprioception import Proprioception
from sim2vr_harness.policies.hierarchical.action_selection import (
    aims_of,
    choose,
    committed,
    mask_unreached,
    remembered,
)
from sim2vr_harness.policies.hierarchical.action_value_map import ActionValueMap
from sim2vr_harness.policies.hierarchical.depth_grid import DepthGrid, rotation
from sim2vr_harness.policies.hierarchical.frame_history import BEFORE_S
from sim2vr_harness.policies.hierarchical.motor_policy import MotorPolicy
from sim2vr_harness.policies.hierarchical.options import option_set
from sim2vr_harness.policies.hierarchical.pointing import AIM_RAYS
from sim2vr_harness.policies.hierarchical.primitives import (
    Manner,
    OptionChoice,
    PrimitiveController,
)
from sim2vr_harness.policies.hierarchical.workspace import reachable_poses
from sim2vr_harness.policies.protocol import (
    Observation,
    Shapes,
    require_observation,
    shapes_in_words,
)
from sim2vr_harness.users import Body, held
from sim2vr_harness.users.kinematics.forward_torch import Chains

if TYPE_CHECKING:
    from sim2vr_harness.runs.config import TrainingConfig

_QUIET = -20.0
"""Logarithm of the deviation of actions: what is decided is done."""


@dataclass
class Intention:
    """What a user has decided.

    Attributes:
        choice: of one user.
        left: user steps for which it is seen through still.
    """

    choice: OptionChoice
    left: int = 0


def require_senses(env: EnvConfig) -> None:
    """Check that a user has the senses that the high-level policy observes.

    Raises:
        InputError: names the sense.
    """
    why = "by which a user decides"
    vision = env.vision
    got = [str(channel) for channel in vision.channels]
    if got != ["red", "green", "blue", "depth"] or vision.eyes != 1 or vision.foveation is not None:
        wanted = "[red, green, blue, depth] of one eye, without foveation"
        raise InputError("env.vision", f"{got}", f"{wanted}, {why}")
    senses = {sense.sense: sense for sense in env.senses}
    if env.user.head != "fixed" and "headset" not in senses:
        wanted = f"'fixed', or the sense headset, {why}"
        raise InputError("env.user.head", repr(env.user.head), wanted)
    seen, felt = senses.get("vision"), senses.get("proprioception")
    if seen is None or felt is None:
        wanted = f"vision and proprioception, {why}"
        raise InputError("env.senses", f"{sorted(senses)}", wanted)
    if seen.history_s != BEFORE_S or seen.delay_ms or seen.noise:
        wanted = f"{{sense: vision, history_s: {BEFORE_S}}}, {why}"
        raise InputError("env.senses", "another vision", wanted)
    if felt.delay_ms or felt.noise or felt.history_s or felt.stack_s:
        wanted = f"{{sense: proprioception}}, {why}"
        raise InputError("env.senses", "another proprioception", wanted)


def as_reported(head: Tensor, observation: Observation) -> Tensor:
    """(1, 4, 4) a headset (1, 4, 4) by the body's joints, or where it says that it is.

    Apps may ask for a pitch of their own, and reflexes move heads.
    """
    if "headset" not in observation:
        return head
    said, head = observation["headset"], head.clone()
    head[:, :3, :3] = rotation(said[None, 3:])
    head[:, :3, 3] = torch.from_numpy(said[:3])
    return head


class HierarchicalPolicy(nn.Module):
    """What is worth doing, and the hands that do it, from what a user senses.

    Args:
        config: of the run; its senses as :func:`require_senses` has them.
    """

    manner = Manner()
    """How hands do what is chosen."""
    layer: MotorPolicy
    tool: Tensor
    hold: Tensor
    """(1,) user steps for which a decision is seen through."""
    lifts: Tensor
    """(1, 1, 1) whether hands stay before surfaces until they are there, 1 or 0."""
    rays: Tensor
    """(H, 2, 3) with which hands point (:mod:`~.pointing`). Only pages have rays of their own."""
    log_std: Tensor
    _head: Chains

    def __init__(self, config: TrainingConfig) -> None:
        super().__init__()
        env, skills = config.env, config.skills
        body = body_of(env.user)
        hands = held(body.devices)
        layer = MotorPolicy(body, 1.0 / env.action_frequency_hz, width=skills.motor_training.width)
        # Not as parts: where the joints are follows from the body, and is no weight.
        object.__setattr__(self, "layer", layer.requires_grad_(False))
        self.motor = layer.net
        self.register_buffer("motor_mean", layer.mean)
        self.register_buffer("motor_std", layer.std)
        vision = env.vision
        options = option_set(env.user.inputs, skills.options)
        self.values = ActionValueMap(DepthGrid(vision.height, vision.width), len(hands), options)
        self.register_buffer("tool", torch.zeros(len(hands), 2, 3))
        rays = AIM_RAYS.repeat(len(hands), 1, 1)
        self.register_buffer("rays", rays, persistent=env.app.page is not None)
        self.register_buffer("hold", torch.ones(1))
        self.register_buffer("lifts", torch.ones(1, 1, 1))
        self.register_buffer("log_std", torch.full((1,), _QUIET), persistent=False)
        object.__setattr__(self, "_head", Chains(body, ("headset",)))
        self._poses = reachable_poses(layer, config.seed)
        self._primitives: PrimitiveController | None = None
        self._read = _Read(body, layer)
        self._wanted = {
            "proprioception": (len(Proprioception(body).names),),
            "vision": (4, vision.height, vision.width),
        }

    def __repr__(self) -> str:
        """Return the body, what it observes and the size of its action."""
        actions = self.layer.drives.count + len(self.values.options.inputs)
        sizes = f"{shapes_in_words(self._wanted)}; {actions} actions"
        return f"HierarchicalPolicy({self.layer.body.name}: {sizes})"

    def learned(
        self,
        layer: MotorPolicy,
        values: ActionValueMap,
        tool: Tensor,
        hold: int,
        *,
        lifts: bool = True,
        rays: Tensor = AIM_RAYS,
    ) -> None:
        """Take over what was learned."""
        self.layer.take(layer.weights())
        self.values.load_state_dict(values.state_dict())
        self.tool.copy_(tool)
        self.rays.copy_(rays)
        self.hold.fill_(hold)
        self.lifts.fill_(lifts)
        self._primitives = None

    def begin(self, n: int) -> list[Intention]:
        """Return the memory of users whose episodes begin: no option is chosen yet."""
        return [self._begun() for _ in range(n)]

    def restart(self, memory: list[Intention], users: Sequence[int]) -> None:
        """Let the episodes of these users begin anew."""
        for user in users:
            memory[user] = self._begun()

    def _begun(self) -> Intention:
        return Intention(OptionChoice(1, len(self.layer.hands)))

    @property
    def primitives(self) -> PrimitiveController:
        """Turns decisions into goals; made of the weights when it is first needed."""
        if self._primitives is None:
            self._primitives = PrimitiveController(
                self.layer, self.tool, self._poses, self.values.options, self.manner, self.rays
            )
            self._primitives.lifts = self.lifts
        return self._primitives

    def act(
        self,
        observations: Observation,
        memory: list[Intention],
        rngs: Sequence[np.random.Generator | None],
    ) -> NDArray[np.float32]:
        """Return the actions, (N, A) in [-1, 1]; they are deterministic."""
        first = {key: value[0] for key, value in observations.items()}
        require_observation(self._shapes(first), first)
        actions = [
            self._act({key: value[i] for key, value in observations.items()}, own)
            for i, own in enumerate(memory)
        ]
        return np.stack(actions)

    def _act(self, observation: Observation, intention: Intention) -> NDArray[np.float32]:
        with torch.inference_mode():
            motion = self._read(observation["proprioception"])
            placed = self.layer.places(*motion[:2])
            head = as_reported(self._head(motion[0])[:, 0], observation)
            if intention.left == 0:
                self._decide(observation["vision"], intention.choice, head, placed)
                intention.left = int(self.hold)
            intention.left -= 1
            goals = self.primitives.goals(intention.choice, head[:, :3, 3], *placed)
            body = self.layer.decide(motion, placed, goals)[0]
            return self._with_fingers(body, intention.choice, placed[0])

    def _with_fingers(
        self, body: NDArray[np.float32], choice: OptionChoice, place: Tensor
    ) -> NDArray[np.float32]:
        """(A + F,) action of a body (A,) and of its fingers, of devices at (1, H, 4, 4)."""
        return np.concatenate([body, self.primitives.inputs(choice, place)[0]])

    def _shapes(self, observation: Observation) -> Shapes:
        """What it takes; of frames that an image holds besides the newest any number."""
        vision = observation.get("vision")
        image = () if vision is None else vision.shape
        newest = self._wanted["vision"]
        channels = max(newest[0], image[0] if len(image) == 3 else 0)
        return {**self._wanted, "vision": (channels, *newest[1:])}

    def _decide(
        self,
        picture: NDArray[np.uint8],
        choice: OptionChoice,
        head: Tensor,
        placed: tuple[Tensor, Tensor],
    ) -> None:
        pictures = torch.from_numpy(np.ascontiguousarray(picture)[None])
        places = self.values.sight.places(pictures[:, 3], head[:, :3, 3], head[:, :3, :3])
        moving = self.primitives.tips(*placed)
        values = self.values(pictures, places, head[:, :3, 3], *moving)
        something = self.values.sight.something(pictures[:, 3])
        something = mask_unreached(
            choice, moving[0], something, places, int(self.hold), self.primitives
        )
        chosen = committed(values, something, choice, places, self.primitives).numpy()
        aims = aims_of(self.values.sight, chosen, pictures, head[:, :3, 3], head[:, :3, :3])
        aims = remembered(choice, aims, head[:, :3, 3], moving[0])
        choose(choice, chosen, places, self.primitives, aims=aims)


class _Read:
    """Angles, speeds and drives of a body, from its proprioception.

    Args:
        body: whose.
        layer: which acts on them.

    Raises:
        InputError: the body does not feel one of its joints.
    """

    def __init__(self, body: Body, layer: MotorPolicy) -> None:
        where = {name: column for column, name in enumerate(Proprioception(body).names)}
        joints = body.independent_joints
        missing = [name for name in joints if f"{name} qpos" not in where]
        if missing:
            got = f"{body.name!r}, which does not observe {missing[0]}"
            raise InputError("env.user.model", got, "a body that observes all of its joints")
        self._angles = [where[f"{name} qpos"] for name in joints]
        self._speeds = [where[f"{name} qvel"] for name in joints]
        ranges = dict(zip(body.observed_joints, body.observed_ranges, strict=True))
        self._low, high = np.array([ranges[name] for name in joints]).T
        self._span = high - self._low
        drives = layer.drives
        self._count, self._known = drives.count, [*drives.muscles, *drives.motors]
        self._drives = [where[name] for name in drives.names]

    def __call__(self, felt: NDArray[np.float32]) -> tuple[Tensor, Tensor, Tensor]:
        """(1, J) rad, (1, J) rad/s and (1, A), of one user's proprioception."""
        numbers = felt.astype(np.float64)
        angles = self._low + 0.5 * (numbers[self._angles] + 1.0) * self._span
        drives = np.zeros(self._count)
        drives[self._known] = 0.5 * (numbers[self._drives] + 1.0)
        parts = (angles, numbers[self._speeds], drives)
        one, two, three = (torch.from_numpy(part[None]).float() for part in parts)
        return one, two, three
