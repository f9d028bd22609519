"""The human motor policy: feedback in space, an internal model of the body, and late senses.

The user feels its body late. A learned forward model predicts the present from what is felt and
from the user's own last commands (Wolpert and Ghahramani 2000, Nature Neuroscience 3). A policy in
space chooses the next velocity of the hand from that prediction and decides when a movement is
over; an inverse model finds the muscle commands.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from sim2vr_harness.envs.config import UserConfig
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.policies.hierarchical.motor_policy import MOMENT_S, MotorGoals, tips
from sim2vr_harness.users import Body, UserBatch, held
from sim2vr_harness.world_models.body_dynamics import BodyModel, mlp
from sim2vr_harness.world_models.effort import volume_shares
from sim2vr_harness.world_models.person_features import ImaginedPersons
from sim2vr_harness.world_models.transitions import Motion

RECOGNITION_S = 0.1
"""Visual recognition latency of a decision, added to the visual delay (docs/concepts/people.md)."""
SAME_M = 0.06
"""Movement of a target up to which the hand follows it without a new decision."""
_FIXATION_S = 0.2
"""Correlation time of the errors in perceived goals, about the duration of a fixation."""


@dataclass
class HumanGoals(MotorGoals):
    """Goals of B users' H hands.

    Attributes:
        stops: (B, H) 1 for hands that come to rest in the target, 0 for those that select or pass.
    """

    stops: Tensor

    @staticmethod
    def none(users: int, hands: int) -> HumanGoals:
        """Return goals of hands that rest."""
        plain = MotorGoals.none(users, hands)
        return HumanGoals(**plain.tensors(), stops=torch.ones(users, hands))

    @staticmethod
    def of(goals: MotorGoals) -> HumanGoals:
        """Return goals without their durations; those without a velocity are to stop at."""
        stops = (goals.velocity.abs().sum(-1) == 0.0).float()
        return HumanGoals(**goals.tensors(), stops=stops)


class GoalPerception:
    """Perceived positions of goals, with errors in proportion to the distance last seen.

    Args:
        weber: standard deviation of the error along each axis, as a proportion of the distance
            from the hand.
        least_m: standard deviation of the error of a goal at the hand, m.
        late_steps: observation delay of the distance, in user steps.
        generators: random generators of the users' errors; None: torch's global one.
    """

    def __init__(
        self,
        n: int,
        hands: int,
        step_s: float,
        *,
        weber: float,
        least_m: float,
        late_steps: int,
        generators: Sequence[torch.Generator] | None = None,
    ) -> None:
        self._weber, self._least_m, self.generators = weber, least_m, generators
        self._keep = float(torch.exp(torch.tensor(-step_s / _FIXATION_S)))
        self._error = torch.zeros(n, hands, 3)
        """(B, H, 3) errors in standard deviations."""
        self._seen_m = torch.zeros(late_steps + 1, n, hands)

    def _drawn(self, users: Sequence[int]) -> Tensor:
        shape = self._error.shape[1:]
        if self.generators is None:
            return torch.randn(len(users), *shape)
        return torch.stack([torch.randn(shape, generator=self.generators[i]) for i in users])

    def forget(self, ids: Tensor, far: Tensor) -> None:
        """Set new goals of users (K,), at distances (K, H) from their hands."""
        self._error = self._error.clone()
        self._error[ids] = self._drawn(ids.tolist())
        self._seen_m = self._seen_m.clone()
        self._seen_m[:, ids] = far

    def look(self, far: Tensor) -> None:
        """Take in a user step, at whose end the goals are (B, H) from the hands."""
        fresh = (1.0 - self._keep**2) ** 0.5
        self._error = self._keep * self._error + fresh * self._drawn(range(len(self._error)))
        self._seen_m = torch.cat([self._seen_m[1:], far[None]])

    def error(self) -> Tensor:
        """Return (B, H, 3) errors of the perceived goals, m."""
        return (self._least_m + self._weber * self._seen_m[0])[..., None] * self._error

    def state_dict(self) -> dict[str, Any]:
        """Return the complete state, except torch's global generator."""
        own = {"error": self._error.clone(), "seen_m": self._seen_m.clone()}
        return own | {"drawn": [each.get_state() for each in self.generators or ()]}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from :meth:`state_dict`."""
        self._error, self._seen_m = state["error"].clone(), state["seen_m"].clone()
        for each, drawn in zip(self.generators or (), state["drawn"], strict=True):
            each.set_state(drawn)


REFERENCE_M = 0.4
"""Length by which angles of rays are lengths of reaches."""
_TAKEN = 0.6
"""Share of a wanted change of a ray's velocity that is taken up in a user step: what a light wrist
does is predicted badly, and all of it would shake the ray."""


class Turning:
    """Rays that hands turn to their places, of B users' H hands; other hands stay as they are.

    Args:
        hand: (B, H, 3) where the devices are.
        tip: (B, H, 3) where the tips of the goals are.

    Attributes:
        rows: (B, H, 3, 3) from velocities of tips to those of the policy in space.
    """

    def __init__(self, goals: HumanGoals, hand: Tensor, tip: Tensor) -> None:
        self._turns = goals.rays[..., None] > 0.0
        ray, to = tip - hand, goals.place - hand
        far = ray.norm(dim=-1, keepdim=True).clamp(min=1e-6)
        ray = ray / far
        self._plane = (
            torch.eye(3) - goals.rays[..., None, None] * ray[..., None] * ray[..., None, :]
        )
        scale = torch.where(self._turns, REFERENCE_M / far, torch.ones(()))
        self._scale, self.rows = scale, scale[..., None] * self._plane
        along = (to * ray).sum(-1, keepdim=True)
        beside = to - along * ray
        off = beside.norm(dim=-1, keepdim=True)
        self._way = REFERENCE_M * torch.atan2(off, along) * beside / off.clamp(min=1e-6)

    def seen(
        self, way: Tensor, velocity: Tensor, goals: HumanGoals
    ) -> tuple[Tensor, Tensor, HumanGoals]:
        """Return ways and velocities (B, H, 3), and goals, with those of rays in angles."""
        way = torch.where(self._turns, self._way, way)
        velocity = (self.rows @ velocity[..., None])[..., 0]
        return way, velocity, replace(goals, width=goals.width * self._scale[..., 0])

    def taken(self, wanted: Tensor, velocity: Tensor) -> Tensor:
        """(B, H, 3) wanted velocities, to which those of rays come little by little."""
        return torch.where(self._turns, velocity + _TAKEN * (wanted - velocity), wanted)

    def across(self, error: Tensor) -> Tensor:
        """Return (B, H, 3) the error without its component along rays."""
        return (self._plane @ error[..., None])[..., 0]


def far_off(goals: HumanGoals, place: Tensor) -> Tensor:
    """Return (B, H) distances of devices at (B, H, 4, 4) from goals, for the policy in space."""
    hand, tip = place[..., :3, 3], tips(place, goals.tip)
    way = Turning(goals, hand, tip).seen(goals.place - tip, tip, goals)[0]
    return way.norm(dim=-1)


_WIDTH_M, _LEAST_M, _NEAR_M = 0.04, 0.002, 0.02
_INPUTS = 13
_MOST_MPS = 2.0
"""Largest change of velocity in a user step."""
_LOGIT, _FIRST_LOGIT = 3.0, -0.8
"""Logit of the decision to end a movement: factor on the network's output, and initial bias."""


class HandPolicy(nn.Module):
    """A feedback policy of hands in space, for all bodies and persons.

    Args:
        width: of the two hidden layers.
    """

    def __init__(self, width: int = 64) -> None:
        super().__init__()
        self.net = mlp(_INPUTS, width, width, 4)
        last = self.net[-1]
        assert isinstance(last, nn.Linear)
        with torch.no_grad():
            last.weight.mul_(0.1)
            last.bias.copy_(torch.tensor([0.1, -0.3, 0.0, _FIRST_LOGIT]))

    def forward(
        self, way: Tensor, velocity: Tensor, goals: HumanGoals, noise: Tensor, effort: Tensor
    ) -> tuple[Tensor, Tensor]:
        """(B, H, 3) velocities wanted at the end of a user step, and (B, H) logits of its end.

        Args:
            way: (B, H, 3) from the hands to their goals as believed, m.
            velocity: (B, H, 3) of the hands as believed, m/s.
            goals: for widths, velocities and whether to stop.
            noise: (B, 1) the persons' factors on motor noise.
            effort: (B, 1) their factors on the cost of effort.
        """
        far = way.square().sum(-1).add(1e-8).sqrt()
        ahead = way / (far[..., None] + _NEAR_M)
        wanted = goals.velocity
        speed, through = (x.square().sum(-1).add(1e-6).sqrt() for x in (velocity, wanted))
        passes = (through > 2e-3).float()
        inputs = [
            far / 0.3,
            (far + 0.01).log() + 2.0,
            ((far + _LEAST_M) / (0.5 * goals.width + _LEAST_M)).log(),
            (goals.width / _WIDTH_M).log(),
            speed,
            (velocity * ahead).sum(-1),
            through,
            (wanted * ahead).sum(-1),
            (wanted * velocity).sum(-1),
            goals.stops,
            passes,
            noise.log().expand_as(far) * 4.0,
            effort.log().expand_as(far),
        ]
        out = self.net(torch.stack(inputs, -1))
        onwards, keeps, takes, over = out.unbind(-1)
        change = (
            onwards[..., None] * ahead + keeps[..., None] * velocity + takes[..., None] * wanted
        )
        size = change.square().sum(-1, keepdim=True)
        return velocity + change / (1.0 + size / _MOST_MPS**2).sqrt(), _LOGIT * over


_MOMENT_RAD = 1e-3
_PASSES = 3


@dataclass(frozen=True)
class InverseSettings:
    """Scales and weights of the squared costs that determine the controls.

    Attributes:
        velocity_mps: error of the hand's velocity that costs 1.
        speed_radps: deviation from the joint speed of the return movement that costs 1.
        return_hz: rate at which joints return to the middle of their ranges if no other cost acts.
        limit: weight of this return at the ends of the ranges, relative to the middle.
        effort: cost of the sum of squared controls, weighted by muscle volume.
        change: cost of the sum of squared changes of activation.
    """

    velocity_mps: float = 0.01
    speed_radps: float = 1.0
    return_hz: float = 1.5
    limit: float = 3.0
    effort: float = 0.2
    change: float = 0.1


class InverseModel:
    """Finds controls of a body for velocities of its hands.

    Args:
        model: the forward model of the body, of its hands.
        low: (J,) least joint angles, rad; in the middle of their ranges joints are comfortable.
        high: (J,) greatest joint angles, rad.
        shares: (A,) relative volume of the muscles.
    """

    def __init__(
        self,
        model: BodyModel,
        low: Tensor,
        high: Tensor,
        shares: Tensor,
        settings: InverseSettings,
    ) -> None:
        self._model, self._shares, self._settings = model, shares, settings
        self._middle, self._half = 0.5 * (low + high), 0.5 * (high - low)

    def velocities(self, motion: Motion, tip: Tensor) -> tuple[Tensor, Tensor]:
        """(B, H, 3) each: where points (B, H, 3) of the devices are, and how they move."""
        place, jacobian = self.jacobian(motion, tip)
        return place, (jacobian @ motion.speeds[:, None, :, None])[..., 0]

    def jacobian(self, motion: Motion, tip: Tensor) -> tuple[Tensor, Tensor]:
        """Return (B, H, 3) positions of points, and (B, H, 3, J) their Jacobians by the joints."""
        count, joints = motion.angles.shape
        each = joints + 1
        away = torch.cat([torch.zeros(1, joints), _MOMENT_RAD * torch.eye(joints)])
        angles = (motion.angles[:, None] + away).flatten(0, 1)
        persons = motion.persons.repeat_interleave(each, 0)
        with torch.no_grad():
            placed = self._model.places(angles, persons)
            every = tips(placed, tip.repeat_interleave(each, 0)).reshape(count, each, -1, 3)
        moved = (every[:, 1:] - every[:, :1]) / _MOMENT_RAD
        return every[:, 0], moved.permute(0, 2, 3, 1)

    def controls(
        self,
        now: Motion,
        tip: Tensor,
        velocity: Tensor,
        active: Tensor,
        bias: Tensor,
        seen: Tensor | None = None,
    ) -> Tensor:
        """(B, A) controls, shares of their ranges, of the user step that begins.

        Args:
            now: the present.
            tip: (B, H, 3) points of the devices.
            velocity: (B, H, 3) wanted at the end of the user step, m/s.
            active: (B, H) 1 for hands that move, 0 for those that rest.
            bias: (B, J) what the forward model has got wrong of joint speeds lately, rad/s.
            seen: (B, H, 3, 3) what of the points' velocities is wanted; None: all of it.
        """
        start, costs = now.drives.detach(), self._settings
        after, by_control = self._after(now, start)
        then = Motion(after.angles, after.speeds + bias, start, now.persons)
        _, jacobian = self.jacobian(then, tip)
        jacobian = jacobian if seen is None else seen @ jacobian
        weight = (active / costs.velocity_mps)[..., None]
        reached = (jacobian @ then.speeds[:, None, :, None])[..., 0]
        back = costs.return_hz * (self._middle - now.angles)
        away = ((now.angles - self._middle) / self._half).clamp(-1.2, 1.2)
        counts = (1.0 + (costs.limit - 1.0) * away**6) / costs.speed_radps
        wrong = torch.cat(
            [((velocity - reached) * weight).flatten(1), (back - then.speeds) * counts],
            1,
        )
        moved = (jacobian * weight[..., None]).flatten(1, 2) @ by_control
        rows = torch.cat([moved, by_control * counts[..., None]], 1)
        effort = costs.effort * self._shares
        square = rows.transpose(1, 2) @ rows + torch.diag(effort + costs.change)
        pull = (rows.transpose(1, 2) @ wrong[..., None])[..., 0] - effort * start
        return _within_range(square, pull, start)

    def _after(self, now: Motion, start: Tensor) -> tuple[Motion, Tensor]:
        """Motion after a user step with controls (B, A), and (B, J, A) its speeds by the controls.

        A row of a larger batch for each joint: one way back through the network for all of them.
        """
        count, joints = now.angles.shape
        rows = torch.arange(count).repeat_interleave(joints)
        each = start[rows].requires_grad_(True)
        with torch.enable_grad():
            after = self._model(now.rows(rows), each)
            speeds = after.speeds.reshape(count, joints, joints)
            own = speeds.diagonal(dim1=1, dim2=2).sum()
            by_control = torch.autograd.grad(own, each)[0]
        first = after.detach().rows(torch.arange(0, count * joints, joints))
        return first, by_control.reshape(count, joints, -1)


def _within_range(square: Tensor, pull: Tensor, start: Tensor) -> Tensor:
    """(B, A) least squares between 0 and 1: those beyond are held there, the others solved anew."""
    held = torch.zeros_like(start, dtype=torch.bool)
    change = limit = torch.zeros_like(start)
    for _ in range(_PASSES):
        free = (~held).float()
        known = (pull - (square @ limit[..., None])[..., 0]) * free
        part = square * free[:, None] * free[:, :, None] + torch.diag_embed(1.0 - free)
        change = torch.linalg.solve(part, known[..., None])[..., 0] + limit
        wanted = start + change
        beyond = ((wanted < 0.0) | (wanted > 1.0)) & ~held
        if not beyond.any():  # another pass would find the same
            break
        limit = torch.where(beyond, wanted.clamp(0.0, 1.0) - start, limit)
        held = held | beyond
    return (start + change).clamp(0.0, 1.0)


Rule = Callable[[Tensor, Tensor], Tensor]
"""(B, H, 3) velocities wanted, by the ways to the goals and by the hands' velocities."""

_ADAPTS = 0.3
"""Share of the forward model's last error by which its correction changes, per user step."""

_REMEMBERED = ("_did", "_bias", "_new", "_fresh", "velocity", "wanted")
"""Tensors that users remember from one user step to the next."""


class HumanMotorPolicy(nn.Module):
    """Motor policy that all persons of a population share.

    Args:
        body: the body model that persons share.
        persons: representation of persons in tensors.
        width: size of the hidden layers of the policy in Cartesian space.
        body_width: size of the forward model's hidden layers.
        perception: arguments of :class:`GoalPerception`, the errors in perceived goals.
    """

    def __init__(
        self,
        body: Body,
        step_s: float,
        persons: ImaginedPersons,
        *,
        width: int = 64,
        body_width: int = 128,
        perception: Mapping[str, float] | None = None,
    ) -> None:
        super().__init__()
        self.body, self.step_s, self.hands = body, step_s, held(body.devices)
        self.persons, self.width, self.body_width = persons, width, body_width
        self._misjudged = dict(perception or {})
        self.forward_model = BodyModel(
            body, self.hands, step_s, width=body_width, persons=persons
        ).requires_grad_(False)
        self.drives = self.forward_model.drives
        self.hand_policy = HandPolicy(width)
        low, high = torch.tensor(body.joint_ranges.T.copy()).float()
        shares = torch.ones(self.drives.count)
        if len(self.drives.muscles):
            shares[self.drives.muscle_columns] = volume_shares(body)
        self.inverse = InverseModel(self.forward_model, low, high, shares, InverseSettings())

    def __repr__(self) -> str:
        """Return the body, the hands and the number of actions."""
        hands = " and ".join(self.hands)
        return f"HumanMotorPolicy({self.body.name}, {hands}: {self.drives.count} actions)"

    def places(self, motion: Motion) -> tuple[Tensor, Tensor]:
        """(B, H, 4, 4) each: where the hands' devices are, and ``MOMENT_S`` later."""
        angles = torch.cat([motion.angles, motion.angles + MOMENT_S * motion.speeds])
        both = self.forward_model.places(angles, motion.persons.repeat(2, 1))
        now, soon = both.chunk(2)
        return now, soon

    def perception(
        self, n: int, generators: Sequence[torch.Generator] | None = None
    ) -> GoalPerception:
        """Return where N users believe that goals are; errors are drawn from the generators."""
        known = self._misjudged
        return GoalPerception(
            n,
            len(self.hands),
            self.step_s,
            weber=known.get("weber", 0.0),
            least_m=known.get("least_m", 0.0),
            late_steps=int(known.get("late_steps", 0)),
            generators=generators,
        )

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


def people_policy(
    user: UserConfig,
    step_s: float,
    *,
    width: int = 64,
    body_width: int = 128,
    perception: Mapping[str, float] | None = None,
) -> HumanMotorPolicy:
    """Return an untrained policy for the persons of a configuration."""
    env = ResolvedEnv.of_user(user)
    persons = ImaginedPersons(env)
    return HumanMotorPolicy(
        env.body, step_s, persons, width=width, body_width=body_width, perception=perception
    )


class HumanHands:
    """N simulated users that move by a human motor policy, one user step after the other.

    Args:
        perception: of their goals; None: they see goals where they are.
    """

    def __init__(
        self, policy: HumanMotorPolicy, n: int, perception: GoalPerception | None = None
    ) -> None:
        self.policy, self.perception = policy, perception
        self.vigour = 1.0
        """Divisor of the users' effort weights."""
        self._felt: Motion | None = None
        self._predicted: Motion | None = None
        """Prediction of the last user step, without correction."""
        self._did = torch.zeros(n, policy.drives.count)
        self._bias = torch.zeros(n, len(policy.body.independent_joints))
        """Running mean of the forward model's errors in joint speed, rad/s."""
        self._new = torch.ones(n, dtype=torch.bool)
        self._fresh = torch.ones(n, dtype=torch.bool)
        """(N,) True for users that have not yet sensed a movement of their own."""
        self.velocity = torch.zeros(n, len(policy.hands), 3)
        """Velocities that hands were believed to have when they were chosen, m/s."""
        self.wanted = torch.zeros_like(self.velocity)
        """Velocities that hands were to have at the end of the last user step, m/s."""

    def __deepcopy__(self, memo: dict[int, Any]) -> HumanHands:
        """Return a copy with the same policy: the memory of an episode is copied, no weights."""
        new = copy.copy(self)
        for name, value in vars(self).items():
            if name != "policy":
                setattr(new, name, copy.deepcopy(value, memo))
        return new

    def forget(self, ids: Sequence[int] | NDArray[np.int64]) -> None:
        """Reset users (K,) for new episodes; their first posture is known."""
        self._new[torch.as_tensor(ids, dtype=torch.long)] = True

    def state_dict(self) -> dict[str, Any]:
        """Return what the users have felt and done."""
        kept: dict[str, Any] = {name: getattr(self, name).clone() for name in _REMEMBERED}
        for name in ("_felt", "_predicted"):
            motion = getattr(self, name)
            kept |= {} if motion is None else {name: dict(vars(motion))}
        return kept | {"goals": {} if self.perception is None else self.perception.state_dict()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from :meth:`state_dict`."""
        for name in _REMEMBERED:
            setattr(self, name, state[name].clone())
        for name in ("_felt", "_predicted"):
            setattr(self, name, Motion(**state[name]) if name in state else None)
        if self.perception is not None:
            self.perception.load_state_dict(state["goals"])

    def aim_anew(self, ids: Tensor, far: Tensor) -> None:
        """Set new goals of users (K,), at distances (K, H) from their hands."""
        if self.perception is not None and len(ids):
            self.perception.forget(ids, far)

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

    def act(
        self, now: Motion, goals: HumanGoals, rule: Rule | None = None
    ) -> tuple[NDArray[np.float32], Tensor]:
        """(N, A) actions of a user step, and (N, H) probabilities that movements are over.

        Args:
            now: the true motion; users feel it a user step later.
            rule: what chooses velocities in the place of the policy.
        """
        policy = self.policy
        with torch.no_grad():
            # The present as users believe it to be, with what their model gets wrong taken off.
            if self._felt is None:
                self._felt = now
            new, felt = self._new[:, None], self._felt
            if self._predicted is not None:
                believed_error = felt.speeds - self._predicted.speeds
                adapted = self._bias + _ADAPTS * (believed_error - self._bias)
                self._bias = torch.where(self._fresh[:, None], self._bias, adapted)
            self._bias = torch.where(new, torch.zeros(()), self._bias)
            self._fresh = self._new
            raw = self._predicted = self.policy.predicted(felt, self._did)
            half = 0.5 * self.policy.step_s
            believed = Motion(
                torch.where(new, now.angles, raw.angles + half * self._bias),
                torch.where(new, now.speeds, raw.speeds + self._bias),
                torch.where(new, now.drives, raw.drives),
                now.persons,
            )
            place, velocity = policy.inverse.velocities(believed, goals.tip)
            way, turning = goals.place - place, None
            if goals.rays.any():
                at = policy.forward_model.places(believed.angles, now.persons)
                turning = Turning(goals, at[..., :3, 3], place)
                way, velocity, goals = turning.seen(way, velocity, goals)
            self.velocity = velocity
            if self.perception is not None:
                self.perception.look(way.norm(dim=-1))
                error = self.perception.error()
                way = way + (error if turning is None else turning.across(error))
            noise = policy.persons.motor_noise(now.persons)
            effort = policy.persons.effort(now.persons)
            assert isinstance(noise, Tensor) and isinstance(effort, Tensor)
            self.wanted, over = policy.hand_policy(
                way, velocity, goals, noise, effort[:, None] / self.vigour
            )
            if rule is not None:
                self.wanted = rule(way, velocity)
            rows = None if turning is None else turning.rows
            if turning is not None:
                self.wanted = turning.taken(self.wanted, velocity)
            controls = policy.inverse.controls(
                believed, goals.tip, self.wanted, goals.active, self._bias, rows
            )
            done = policy.drives.actions(believed.drives.numpy(), controls.numpy())
            self._did = torch.from_numpy(done).float()
            self._felt, self._new = now, torch.zeros_like(self._new)
        return self._did.numpy(), torch.sigmoid(over)
