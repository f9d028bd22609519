"""The human motor policy: planned movements, an internal model of the body, and late senses.

The user feels its body late. A learned forward model predicts the present from what is felt and
from the user's own last commands (Wolpert and Ghahramani 2000, Nature Neuroscience 3). A movement
is planned to its end from that prediction, in every user step anew; an inverse model finds the
muscle commands.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
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
from sim2vr_harness.world_models.body_dynamics import BodyModel
from sim2vr_harness.world_models.effort import volume_shares
from sim2vr_harness.world_models.person_features import ImaginedPersons
from sim2vr_harness.world_models.transitions import Motion

RECOGNITION_S = 0.1
"""Visual recognition latency of a decision, added to the visual delay (docs/concepts/people.md)."""
SAME_M = 0.06
"""Movement of a target up to which the hand follows it without a new decision."""
_FIXATION_S = 0.2
"""Correlation time of the errors in perceived goals, about the duration of a fixation."""


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

    def __init__(self, goals: MotorGoals, hand: Tensor, tip: Tensor) -> None:
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
        self, way: Tensor, velocity: Tensor, goals: MotorGoals
    ) -> tuple[Tensor, Tensor, MotorGoals]:
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


def far_off(goals: MotorGoals, place: Tensor) -> Tensor:
    """Return (B, H) distances of devices at (B, H, 4, 4) from goals, for the policy in space."""
    hand, tip = place[..., :3, 3], tips(place, goals.tip)
    way = Turning(goals, hand, tip).seen(goals.place - tip, tip, goals)[0]
    return way.norm(dim=-1)


@dataclass(frozen=True)
class PlanSettings:
    """Costs by which a movement's duration is chosen, and limits of its feedback.

    Attributes:
        time: cost of time, 1/s.
        effort: cost of the time integral of the squared acceleration, s^3/m^2.
        miss: cost of a movement that ends beside its target.
        noise_s: standard deviation of end points by the mean speed, m per m/s.
        least_m: the same of a hand that hardly moves, m.
        shortest_s: shortest time in which a deviation is corrected.
        longest_s: longest planned movement.
        follow_s: time for which a hand that passes goes on beyond its goal.
        extends: part of a lag that a movement that stops is prolonged by, per user step.
        gain: factor on the planned change of velocity of hands that stop. Muscles execute a part
            of it within a user step.
    """

    time: float = 7.0
    effort: float = 0.15
    miss: float = 8.0
    noise_s: float = 0.013
    least_m: float = 0.002
    shortest_s: float = 0.15
    longest_s: float = 1.6
    follow_s: float = 0.1
    extends: float = 0.2
    gain: float = 1.3


PLAN = PlanSettings()
_DURATIONS_S = torch.linspace(0.1, PLAN.longest_s, 31)
_NODES = torch.tensor([0.0694318, 0.3300095, 0.6699905, 0.9305682])
_GAUSS = torch.tensor([0.1739274, 0.3260726, 0.3260726, 0.1739274])
"""Nodes and weights of Gauss and Legendre's quadrature on [0, 1], exact for squared accelerations
of quintics."""


def quintic(
    way: Tensor, velocity: Tensor, acceleration: Tensor, final: Tensor, time_s: Tensor
) -> Tensor:
    """(..., 3, 6) coefficients of the minimum-jerk movement, of powers of the time in s.

    Its position is measured from the hand (Flash and Hogan 1985).

    Args:
        way: (..., 3) to the goal, m.
        velocity: (..., 3) of the hand, m/s.
        acceleration: (..., 3) of the hand, m/s^2.
        final: (..., 3) velocity at the goal, m/s.
        time_s: (...) until it is there; the acceleration is 0 then.
    """
    t = time_s[..., None]
    far = way - velocity * t - 0.5 * acceleration * t**2
    fast = (final - velocity - acceleration * t) * t
    push = -acceleration * t**2
    third = (10.0 * far - 4.0 * fast + 0.5 * push) / t**3
    fourth = (-15.0 * far + 7.0 * fast - push) / t**4
    fifth = (6.0 * far - 3.0 * fast + 0.5 * push) / t**5
    parts = [torch.zeros_like(far), velocity, 0.5 * acceleration, third, fourth, fifth]
    return torch.stack([part.expand_as(far) for part in parts], -1)


def moved(coefficients: Tensor, time_s: Tensor, order: int) -> Tensor:
    """(..., 3) derivative of quintics (..., 3, 6) of an order at times (...)."""
    powers = range(order, 6)
    scale = [float(np.prod(range(k - order + 1, k + 1))) for k in powers]
    terms = torch.stack([f * time_s ** (k - order) for f, k in zip(scale, powers, strict=True)], -1)
    return (coefficients[..., order:] * terms[..., None, :]).sum(-1)


def duration(
    way: Tensor,
    velocity: Tensor,
    acceleration: Tensor,
    goals: MotorGoals,
    noise: Tensor,
    effort: Tensor,
) -> Tensor:
    """(B, H) best durations of movements, s: their cost is of time, effort and misses.

    Args:
        noise: (B, 1) the persons' factors on motor noise.
        effort: (B, 1) their factors on the cost of effort.
    """
    t = _DURATIONS_S.expand(*way.shape[:-1], -1)
    begin, moving, pushed, final = (
        each[..., None, :] for each in (way, velocity, acceleration, goals.velocity)
    )
    path = quintic(begin, moving, pushed, final, t)
    at = _NODES * t[..., None]
    pushes = moved(path[..., None, :, :], at, 2).square().sum(-1)
    work = t * (_GAUSS * pushes).sum(-1)
    mean = way.norm(dim=-1, keepdim=True) / t
    spread = noise[..., None] * (PLAN.least_m + PLAN.noise_s * mean)
    misses = torch.exp(-0.5 * (0.5 * goals.width[..., None] / spread).square())
    cost = PLAN.time * t + PLAN.effort * effort[..., None] * work + PLAN.miss * misses
    return _DURATIONS_S[cost.argmin(-1)]


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
        passes: number of times that the body is made linear, the first time at the present.
    """

    velocity_mps: float = 0.01
    speed_radps: float = 1.0
    return_hz: float = 1.5
    limit: float = 3.0
    effort: float = 0.2
    change: float = 0.1
    passes: int = 2


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
        self._model, self._shares, self.settings = model, shares, settings
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
        costs, start = self.settings, now.drives.detach()
        back = costs.return_hz * (self._middle - now.angles)
        away = ((now.angles - self._middle) / self._half).clamp(-1.2, 1.2)
        counts = (1.0 + (costs.limit - 1.0) * away**6) / costs.speed_radps
        weight = (active / costs.velocity_mps)[..., None]
        effort, controls = costs.effort * self._shares, start
        for _ in range(costs.passes):
            after, by_control = self._after(now, controls)
            then = Motion(after.angles, after.speeds + bias, start, now.persons)
            _, jacobian = self.jacobian(then, tip)
            jacobian = jacobian if seen is None else seen @ jacobian
            reached = (jacobian @ then.speeds[:, None, :, None])[..., 0]
            wrong = torch.cat(
                [((velocity - reached) * weight).flatten(1), (back - then.speeds) * counts], 1
            )
            moved = (jacobian * weight[..., None]).flatten(1, 2) @ by_control
            rows = torch.cat([moved, by_control * counts[..., None]], 1)
            square = rows.transpose(1, 2) @ rows + torch.diag(effort + costs.change)
            pull = (rows.transpose(1, 2) @ wrong[..., None])[..., 0]
            pull = pull - effort * controls - costs.change * (controls - start)
            controls = _within_range(square, pull, controls)
        return controls

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


_ADAPTS = 0.3
"""Share of the forward model's last error by which its correction changes, per user step."""

_REMEMBERED = ("_did", "_bias", "_new", "_fresh", "left_s", "_pushed", "velocity", "wanted")
"""Tensors that users remember from one user step to the next."""


class HumanMotorPolicy(nn.Module):
    """Motor policy that all persons of a population share.

    Args:
        body: the body model that persons share.
        persons: representation of persons in tensors.
        body_width: size of the forward model's hidden layers.
        perception: arguments of :class:`GoalPerception`, the errors in perceived goals.
    """

    def __init__(
        self,
        body: Body,
        step_s: float,
        persons: ImaginedPersons,
        *,
        body_width: int = 128,
        perception: Mapping[str, float] | None = None,
    ) -> None:
        super().__init__()
        self.body, self.step_s, self.hands = body, step_s, held(body.devices)
        self.persons, self.body_width = persons, body_width
        self._misjudged = dict(perception or {})
        self.forward_model = BodyModel(
            body, self.hands, step_s, width=body_width, persons=persons
        ).requires_grad_(False)
        self.drives = self.forward_model.drives
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
    body_width: int = 128,
    perception: Mapping[str, float] | None = None,
) -> HumanMotorPolicy:
    """Return an untrained policy for the persons of a configuration."""
    env = ResolvedEnv.of_user(user)
    persons = ImaginedPersons(env)
    return HumanMotorPolicy(env.body, step_s, persons, body_width=body_width, perception=perception)


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
        self.left_s = torch.zeros(n, len(policy.hands))
        """Time until the hands are at their goals, s; below 0: since then."""
        self._pushed = torch.zeros_like(self.velocity)
        """Planned accelerations at the end of the last user step, m/s^2."""
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
        rows = torch.as_tensor(ids, dtype=torch.long)
        self._new[rows], self.left_s[rows], self._pushed[rows] = True, torch.nan, 0.0

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
        """Set new goals of users (K,), at distances (K, H) from their hands.

        Accelerations of the last plan end: those of short corrections would lead far from a longer
        movement's path.
        """
        self.left_s[ids], self._pushed[ids] = torch.nan, 0.0
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

    def act(self, now: Motion, goals: MotorGoals) -> tuple[NDArray[np.float32], Tensor]:
        """(N, A) actions of a user step, and (N, H) 1 for hands whose movement is over.

        Args:
            now: the true motion; users feel it a user step later.
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
            step_s, passes = policy.step_s, goals.velocity.abs().sum(-1) > 0.0
            best = duration(
                way, velocity, self._pushed, goals, noise, effort[:, None] / self.vigour
            )
            far = way.norm(dim=-1)
            outside = (far > 0.5 * goals.width) & ~passes
            done = torch.where(
                passes, self.left_s <= -PLAN.follow_s, outside & (self.left_s <= 0.0)
            )
            lag = torch.relu(best - self.left_s) * ~passes
            later = self.left_s + PLAN.extends * lag
            left = torch.where(self.left_s.isnan() | done, best, later)
            left = torch.where(goals.due_s.isnan(), left, goals.due_s)
            over = ((left <= 0.5 * step_s) & ~passes & (far < 0.5 * goals.width)).float()
            # Late errors are corrected beyond the goal.
            time_s = left.clamp(min=PLAN.shortest_s)
            beyond = (time_s - left)[..., None] * goals.velocity
            path = quintic(way + beyond, velocity, self._pushed, goals.velocity, time_s)
            at = torch.minimum(torch.tensor(step_s), time_s)
            ahead, moves = moved(path, at, 1), goals.active > 0.0
            self._pushed = moved(path, at, 2) * moves[..., None]
            self.left_s = torch.where(moves, left - step_s, torch.nan)
            gain = torch.where(passes | (goals.rays > 0.0), 1.0, PLAN.gain)[..., None]
            self.wanted = velocity + gain * (ahead - velocity)
            rows = None if turning is None else turning.rows
            if turning is not None:
                self.wanted = turning.taken(self.wanted, velocity)
            controls = policy.inverse.controls(
                believed, goals.tip, self.wanted, goals.active, self._bias, rows
            )
            actions = policy.drives.actions(believed.drives.numpy(), controls.numpy())
            self._did = torch.from_numpy(actions).float()
            self._felt, self._new = now, torch.zeros_like(self._new)
        return self._did.numpy(), over
