"""Users who decide what to do with what they see, and leave the doing to their motor layer.

Training and evaluation act by the same three steps, on the users' senses alone: :meth:`sense
<HierarchicalPolicy.sense>`, :meth:`decide <HierarchicalPolicy.decide>` and :meth:`move
<HierarchicalPolicy.move>`. Training puts tries in the place of decisions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.envs.actions import gaze_slopes
from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.perception.proprioception import Proprioception
from sim2vr_harness.policies.hierarchical.action_selection import (
    BEFORE_S,
    OptionScene,
    choose,
    committed,
    mask_unreached,
)
from sim2vr_harness.policies.hierarchical.action_value_map import ActionValueMap
from sim2vr_harness.policies.hierarchical.depth_grid import DepthGrid, Fovea, rotation
from sim2vr_harness.policies.hierarchical.motor_policy import (
    MotorGoals,
    MotorPolicy,
    reachable_poses,
)
from sim2vr_harness.policies.hierarchical.options import option_set
from sim2vr_harness.policies.hierarchical.pointing import AIM_RAYS
from sim2vr_harness.policies.hierarchical.primitives import (
    Manner,
    OptionChoice,
    PrimitiveController,
)
from sim2vr_harness.policies.protocol import (
    Observation,
    require_observation,
    shapes_in_words,
)
from sim2vr_harness.users import Body, held
from sim2vr_harness.users.kinematics.forward_torch import Chains
from sim2vr_harness.world_models.transitions import Motion

if TYPE_CHECKING:
    from sim2vr_harness.runs.config import TrainingConfig

_QUIET = -20.0
"""Logarithm of the deviation of actions: what is decided is done."""


@dataclass
class Moment:
    """Observations of N users in a user step.

    Attributes:
        motion: motion of the bodies, and their persons.
        placed: two arrays (N, H, 4, 4), poses of the hands' devices now and ``MOMENT_S`` later.
        head: (N, 4, 4) poses of the headsets.
        follows: (N,) observation delay of targets that are already pursued, in user steps.
        decides: (N,) observation delay of the image for new decisions, in user steps.
    """

    motion: Motion
    placed: tuple[Tensor, Tensor]
    head: Tensor
    follows: NDArray[np.int64]
    decides: NDArray[np.int64]


class Memory:
    """Decisions and past images of N users in their episodes.

    Attributes:
        choice: options that the users execute.
        left: (N,) remaining user steps of these options.
        age: (N,) user steps since the first one.
        seen: images (N, 8, H, W) of the last user steps and poses of the headsets (N, 4, 4) at
            which they were rendered, the newest last; with a fovea also its pictures, depths and
            middles (:class:`~.depth_grid.Fovea`).
        gaze: (N, 2) direction of gaze that was chosen last, a proportion of the eyes' range.
    """

    def __init__(self, n: int, hands: int) -> None:
        self.n, self.choice = n, OptionChoice(n, hands)
        self.left = np.zeros(n, np.int64)
        self.age = np.full(n, -1)
        self.seen: list[tuple[Tensor, ...]] = []
        self.gaze = torch.zeros(n, 2)

    def forget(self, users: list[int]) -> None:
        """Reset the memory of these users for a new episode."""
        self.choice.forget(users)
        self.left[users], self.age[users], self.gaze[users] = 0, -1, 0.0

    def state_dict(self) -> dict[str, Any]:
        """Return a copy of all of it as tensors."""
        return {
            "choice": {name: value.clone() for name, value in vars(self.choice).items()},
            "left": torch.tensor(self.left),
            "age": torch.tensor(self.age),
            "gaze": self.gaze.clone(),
            "seen": [list(each) for each in self.seen],
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from :meth:`state_dict`."""
        vars(self.choice).update({name: v.clone() for name, v in state["choice"].items()})
        self.left, self.age = state["left"].numpy().copy(), state["age"].numpy().copy()
        self.gaze, self.seen = state["gaze"].clone(), [tuple(each) for each in state["seen"]]


def require_senses(env: EnvConfig) -> None:
    """Check that a user has the senses that the high-level policy observes.

    Raises:
        InputError: names the sense.
    """
    why = "by which a user decides"
    vision = env.vision
    got = [str(channel) for channel in vision.channels]
    if got != ["red", "green", "blue", "depth"] or vision.eyes != 1:
        wanted = "[red, green, blue, depth] of one eye"
        raise InputError("env.vision", f"{got}", f"{wanted}, {why}")
    senses = {sense.sense: sense for sense in env.senses}
    if env.user.head != "fixed" and "headset" not in senses:
        wanted = f"'fixed', or the sense headset, {why}"
        raise InputError("env.user.head", repr(env.user.head), wanted)
    eyes = ("fovea", "fovea_depth", "gaze")
    if vision.fovea is not None and (not env.gaze_moves or set(eyes) - set(senses)):
        wanted = f"one with gaze: moves, and the senses {', '.join(eyes)}, {why}"
        raise InputError("env.vision.fovea", "another", wanted)
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


def as_reported(head: Tensor, observations: Observation) -> Tensor:
    """(N, 4, 4) headsets (N, 4, 4) by the bodies' joints, or where they say that they are.

    Apps may ask for a pitch of their own, and reflexes move heads.
    """
    if "headset" not in observations:
        return head
    said, head = observations["headset"], head.clone()
    head[:, :3, :3] = rotation(said[:, 3:])
    head[:, :3, 3] = torch.from_numpy(said[:, :3])
    return head


class HierarchicalPolicy(nn.Module):
    """Policy that selects options from images and executes them with a motor policy.

    Args:
        config: configuration of the run, with the senses that :func:`require_senses` demands.
    """

    manner = Manner()
    """Parameters with which the hands execute options."""
    late_steps = 0
    """Observation delay of the images for decisions, in user steps."""
    together = 1
    """Number of users per matrix multiplication; the last bits of results depend on it."""
    layer: MotorPolicy
    tool: Tensor
    hold: Tensor
    """(1,) user steps for which an option is executed before the next decision."""
    lifts: Tensor
    """(1, 1, 1) 1 for hands that stay before surfaces until they are beside the place, else 0."""
    rays: Tensor
    """(H, 2, 3) with which hands point (:mod:`~.pointing`). Only pages have rays of their own."""
    log_std: Tensor
    _head: Chains

    def __init__(self, config: TrainingConfig) -> None:
        super().__init__()
        env, skills = config.env, config.skills
        body = ResolvedEnv(env).body
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
        self.poses = reachable_poses(layer, config.seed)
        self._primitives: PrimitiveController | None = None
        self._read = _Read(body, layer)
        self._wanted: dict[str, tuple[int, ...]] = {
            "proprioception": (len(Proprioception(body).names),),
            "vision": (4, vision.height, vision.width),
        }
        self._fovea_pixel_m, self._gaze_range_deg = 0.0, env.gaze_range_deg
        if self._gaze_range_deg and (eye := vision.fovea) is not None:
            self._fovea_pixel_m = vision.fovea_pixel_m
            self._wanted |= {"fovea": (4, eye.height, eye.width), "gaze": (2,)}
            self._wanted |= {"fovea_depth": (1, eye.height, eye.width)}

    def __repr__(self) -> str:
        """Return the body, what it observes and the size of its action."""
        actions = self.layer.drives.count + len(self.values.options.inputs)
        actions += 2 if self._gaze_range_deg else 0
        sizes = f"{shapes_in_words(self._wanted)}; {actions} actions"
        return f"HierarchicalPolicy({self.layer.body.name}: {sizes})"

    @property
    def primitives(self) -> PrimitiveController:
        """Turns decisions into goals; made of the weights when it is first needed."""
        if self._primitives is None:
            self._primitives = PrimitiveController(
                self.layer, self.tool, self.poses, self.values.options, self.manner, self.rays
            )
            self._primitives.lifts = self.lifts
        return self._primitives

    def begin(self, n: int) -> list[Memory]:
        """Return the memory of users whose episodes begin: no option is chosen yet."""
        return [self._begun(min(self.together, n - k)) for k in range(0, n, self.together)]

    def _begun(self, n: int) -> Memory:
        return Memory(n, len(self.layer.hands))

    def restart(self, memory: list[Memory], users: Sequence[int]) -> None:
        """Reset these users for a new episode."""
        for number, part in enumerate(memory):
            own = [user - number * self.together for user in users]
            self._forget(part, [user for user in own if 0 <= user < part.n])

    def _forget(self, memory: Memory, users: list[int]) -> None:
        memory.forget(users)

    def act(
        self,
        observations: Observation,
        memory: list[Memory],
        rngs: Sequence[np.random.Generator | None],
    ) -> NDArray[np.float32]:
        """Return the actions, (N, A) in [-1, 1]; they are deterministic."""
        actions, first = [], 0
        for part in memory:
            rows = slice(first, first + part.n)
            moment = self.sense({key: each[rows] for key, each in observations.items()}, part)
            self.decide(moment, part)
            actions.append(self.move(moment, part))
            first += part.n
        return np.concatenate(actions)

    def sense(self, observations: Observation, memory: Memory) -> Moment:
        """Take in what users sense, once in a user step.

        Args:
            observations: key -> (N, ...).
        """
        # Check one user's observation; of frames an image may hold more than the newest.
        observation = {key: value[0] for key, value in observations.items()}
        vision = observation.get("vision")
        image: tuple[int, ...] = () if vision is None else vision.shape
        newest = self._wanted["vision"]
        channels = max(newest[0], image[0] if len(image) == 3 else 0)
        require_observation({**self._wanted, "vision": (channels, *newest[1:])}, observation)
        with torch.no_grad():
            moment = self._feel(observations)
        memory.age += 1
        pictures = torch.from_numpy(np.array(observations["vision"]))
        seen: tuple[Tensor, ...] = (pictures, moment.head)
        if self._fovea_pixel_m:
            keys = ("fovea", "fovea_depth", "gaze")
            fovea, depth, gaze = (torch.from_numpy(np.array(observations[key])) for key in keys)
            middle = torch.from_numpy(gaze_slopes(gaze.numpy() * self._gaze_range_deg))
            seen = (*seen, fovea, depth[:, 0], middle.float())
        kept = 1 + int(moment.decides.max()) + round(BEFORE_S / self.layer.step_s)
        memory.seen = [*memory.seen, seen][-kept:]
        return moment

    def _feel(self, observations: Observation) -> Moment:
        angles, speeds, drives = self._read(observations["proprioception"])
        unknown, late = torch.zeros(len(angles), 0), np.full(len(angles), self.late_steps)
        head = as_reported(self._head(angles)[:, 0], observations)
        motion = Motion(angles, speeds, drives, unknown)
        return Moment(motion, self.layer.places(angles, speeds), head, late, late)

    def scene(self, moment: Moment, memory: Memory, late: NDArray[np.int64]) -> OptionScene:
        """Return what users see who see (N,) user steps late; at first they see what is there."""
        ago = np.minimum(late, memory.age)
        seen = memory.seen[-1 - int(ago[0])]
        if (ago != ago[0]).any():
            each = [memory.seen[-1 - int(k)] for k in ago]
            parts = zip(*each, strict=True)
            seen = tuple(torch.stack([one[i] for i, one in enumerate(part)]) for part in parts)
        pictures, head, *fovea = seen
        earlier = np.minimum(ago + round(BEFORE_S / self.layer.step_s), memory.age)
        before = torch.stack([memory.seen[-1 - int(k)][1][i] for i, k in enumerate(earlier)])
        at, turned = head[:, :3, 3], head[:, :3, :3]
        moving = self.primitives.tips(*moment.placed)
        eye = Fovea(self._fovea_pixel_m, *fovea) if fovea else None
        late_s = torch.from_numpy(ago).float() * self.layer.step_s
        return OptionScene(self.values.sight, pictures, at, turned, *moving, eye, before, late_s)

    def decide(self, moment: Moment, memory: Memory) -> None:
        """Select new options for the users whose last option is finished."""
        due = memory.left <= 0
        if due.any():
            with torch.no_grad():
                self._reconsider(moment, memory, due)
            memory.left[due] = int(self.hold)

    def _reconsider(self, moment: Moment, memory: Memory, due: NDArray[np.bool_]) -> None:
        memory.choice.put(
            due, self._best(self.scene(moment, memory, moment.decides), memory.choice)
        )

    def _best(self, scene: OptionScene, before: OptionChoice) -> OptionChoice:
        """Return what is worth most to users who do something."""
        choice = before.copy()
        hold, primitives = int(self.hold), self.primitives
        values = self.values.values(*scene.inputs(self.values))
        something = mask_unreached(
            choice, scene.tips, scene.something, scene.places, hold, primitives
        )
        chosen = committed(values, something, choice, scene.places, primitives).numpy()
        aims = scene.aims(choice, chosen, primitives.options)
        choose(choice, chosen, scene.places, primitives, aims=aims, late_s=scene.late_s)
        return choice

    def move(self, moment: Moment, memory: Memory) -> NDArray[np.float32]:
        """Return the actions, (N, A), for what users have decided."""
        memory.left -= 1
        with torch.no_grad():
            goals = self.primitives.goals(memory.choice, moment.head[:, :3, 3], *moment.placed)
            body = self._drive(moment, goals, memory)
            fingers = self.primitives.inputs(memory.choice, moment.placed[0])
            if self._gaze_range_deg:
                # Look at the target of the hand that is farthest from its own.
                choice, head, active = memory.choice, moment.head, memory.choice.move >= 0
                left = (choice.seen - self.primitives.tips(*moment.placed)[0]).norm(dim=-1)
                hand = left.masked_fill(~active, -1.0).argmax(1)
                way = choice.seen[torch.arange(len(hand)), hand] - head[:, :3, 3]
                ahead, to_left, up = torch.einsum("nji,nj->in", head[:, :3, :3], way)
                gaze = torch.atan2(
                    torch.stack([-to_left, up], 1), torch.stack([ahead, ahead.hypot(to_left)], 1)
                )
                gaze = (torch.rad2deg(gaze) / self._gaze_range_deg).clamp(-1.0, 1.0)
                memory.gaze = torch.where(active.any(1, keepdim=True), gaze, memory.gaze)
        if not self._gaze_range_deg:
            return np.concatenate([body, fingers], 1)
        return np.concatenate([body, fingers, memory.gaze.numpy()], 1)

    def _drive(self, moment: Moment, goals: MotorGoals, memory: Memory) -> NDArray[np.float32]:
        """(N, A) actions of the bodies."""
        motion = (moment.motion.angles, moment.motion.speeds, moment.motion.drives)
        return self.layer.decide(motion, moment.placed, goals)


class _Read:
    """Angles, speeds and drives of bodies, from their proprioception.

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
        """(N, J) rad, (N, J) rad/s and (N, A), of proprioception (N, P)."""
        numbers = felt.astype(np.float64)
        angles = self._low + 0.5 * (numbers[:, self._angles] + 1.0) * self._span
        drives = np.zeros((len(felt), self._count))
        drives[:, self._known] = 0.5 * (numbers[:, self._drives] + 1.0)
        parts = (angles, numbers[:, self._speeds], drives)
        one, two, three = (torch.from_numpy(part).float() for part in parts)
        return one, two, three
