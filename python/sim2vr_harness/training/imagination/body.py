"""A differentiable body, learned from what the simulated one did.

One user step (25 substeps of physics, muscles included) as a function whose gradient is known:
where the hammer goes when a muscle pulls a little more. Activation and acceleration are learned;
how joint angles place the hand is exact, from the body model's chain of joints.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import mujoco
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from sim2vr_harness.users import Body

__all__ = ["BodyModel", "Experience", "Motion", "fit_body", "mlp"]

_LIMIT_RAD = 0.02
"""Over which a joint's limit is felt: its sharp stop, as a network can learn it."""


@dataclass(frozen=True)
class Motion:
    """What the users' joints and muscles do, of B users.

    Attributes:
        angles: (B, J) independent joints, rad.
        speeds: (B, J) rad/s.
        act: (B, M) muscle activations in [0, 1].
    """

    angles: Tensor
    speeds: Tensor
    act: Tensor

    def detach(self) -> Motion:
        """The same, cut off from what led to it."""
        return Motion(self.angles.detach(), self.speeds.detach(), self.act.detach())

    def rows(self, ids: Tensor) -> Motion:
        """Of some users."""
        return Motion(self.angles[ids], self.speeds[ids], self.act[ids])


@dataclass(frozen=True)
class Experience:
    """User steps that were taken, K of them.

    Attributes:
        before: the motion before a step.
        control: (K, M) muscle controls of the step.
        after: the motion after it.
        fields: (K, F) the game's privileged numbers after it.
    """

    before: Motion
    control: Tensor
    after: Motion
    fields: Tensor

    def __len__(self) -> int:
        return len(self.control)

    def tensors(self) -> list[Tensor]:
        """Everything, in the order that :meth:`of` takes."""
        before, after = self.before, self.after
        return [
            *(before.angles, before.speeds, before.act, self.control),
            *(after.angles, after.speeds, after.act, self.fields),
        ]

    @staticmethod
    def of(tensors: Sequence[Tensor]) -> Experience:
        """Of what :meth:`tensors` gave."""
        return Experience(Motion(*tensors[:3]), tensors[3], Motion(*tensors[4:7]), tensors[7])

    def rows(self, ids: Tensor) -> Experience:
        """Some of the steps."""
        return Experience.of([values[ids] for values in self.tensors()])

    @staticmethod
    def joined(parts: Sequence[Experience]) -> Experience:
        """All steps of all parts."""
        columns = zip(*(part.tensors() for part in parts), strict=True)
        return Experience.of([torch.cat(column) for column in columns])


def mlp(*widths: int) -> nn.Sequential:
    """Linear layers of these widths, SiLU between them."""
    layers: list[nn.Module] = []
    for into, out in pairwise(widths):
        layers += [nn.Linear(into, out), nn.SiLU()]
    return nn.Sequential(*layers[:-1])


class _Activation(nn.Module):
    """How far activations have followed their controls after a user step."""

    def __init__(self) -> None:
        super().__init__()
        self._share = mlp(2, 16, 16, 1)

    def forward(self, act: Tensor, control: Tensor) -> Tensor:
        share = torch.sigmoid(self._share(torch.stack([act, control], -1)).squeeze(-1))
        return act + share * (control - act)


class _Acceleration(nn.Module):
    """Angles and speeds after a user step.

    Acceleration is linear in the activations, with coefficients that depend on angles and speeds,
    as muscles' is within a substep; a second network learns the rest, and is told how far joints
    would go beyond their limits.
    """

    mean: Tensor
    spread: Tensor
    speed: Tensor
    gain: Tensor
    remainder: Tensor
    low: Tensor
    high: Tensor

    def __init__(self, user: Body, step_s: float, width: int) -> None:
        super().__init__()
        joints, self._muscles = len(user.independent_joints), len(user.muscles)
        self._joints, self._step_s = joints, step_s
        for name in ("mean", "spread", "speed", "gain", "remainder"):
            self.register_buffer(name, torch.ones(joints))
        low, high = torch.tensor(user.joint_ranges.T.copy(), dtype=torch.float32)
        self.register_buffer("low", low)
        self.register_buffer("high", high)
        self._linear = mlp(6 * joints, width, width, joints * (2 * self._muscles + 1))
        self._rest = mlp(8 * joints + 2 * self._muscles, width, width, 2 * joints)

    def scale_by(self, steps: Experience) -> None:
        """Take the units of inputs and outputs from what happened."""
        before, after = steps.before, steps.after
        free = before.angles + 0.5 * self._step_s * (before.speeds + after.speeds)
        self.mean.copy_(before.angles.mean(0))
        self.spread.copy_(before.angles.std(0))
        self.speed.copy_(before.speeds.std(0))
        self.gain.copy_((after.speeds - before.speeds).std(0))
        self.remainder.copy_((after.angles - free).std(0))

    def forward(self, before: Motion, act: Tensor) -> tuple[Tensor, Tensor]:
        q, v = before.angles, before.speeds
        state = torch.cat(
            [
                (q - self.mean) / self.spread,
                v / self.speed,
                q.sin(),
                q.cos(),
                torch.relu(q + 0.03 - self.high) * 30.0,
                torch.relu(self.low + 0.03 - q) * 30.0,
            ],
            -1,
        )
        both = torch.cat([before.act, act], -1)
        terms = self._linear(state)
        effect = terms[:, : -self._joints].reshape(-1, self._joints, 2 * self._muscles)
        pulled = 0.2 * (effect @ both[..., None])[..., 0] + terms[:, -self._joints :]
        free_v = v + pulled * self.gain
        free_q = q + 0.5 * self._step_s * (v + free_v)
        beyond = [
            nn.functional.softplus((free_q - self.high) / _LIMIT_RAD),
            nn.functional.softplus((self.low - free_q) / _LIMIT_RAD),
        ]
        rest = self._rest(torch.cat([state, 2.0 * both - 1.0, *(0.4 * b for b in beyond)], -1))
        more_v, more_q = rest.chunk(2, -1)
        speeds = free_v + more_v * self.gain
        angles = q + 0.5 * self._step_s * (v + speeds) + more_q * self.remainder
        return angles, speeds


class _Chain(nn.Module):
    """Where a device is, exactly: the joints between world and hand, one rotation each.

    A joint's transform is linear in 1, sin and cos of its angle, and dependent joints are
    polynomials of independent ones.
    """

    fixed: Tensor
    by_sin: Tensor
    by_cos: Tensor
    polynomials: Tensor
    tail: Tensor

    def __init__(self, user: Body, device: str) -> None:
        super().__init__()
        model = user.physics_model
        site = model.site(device)
        bodies: list[int] = []
        body = int(site.bodyid[0])
        while body != 0:
            bodies.insert(0, body)
            body = int(model.body_parentid[body])
        couplings = {coupling.dependent: coupling for coupling in user.couplings}
        independent = {name: k for k, name in enumerate(user.independent_joints)}
        before = np.eye(4)
        parts: list[tuple[NDArray[np.float64], ...]] = []
        self._drivers: list[int] = []
        polynomials = []
        for body in bodies:
            before = before @ _placed(model.body_pos[body], model.body_quat[body])
            first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
            for joint in range(first, first + count):
                parts.append(tuple(before @ part for part in _hinge(model, joint)))
                before = np.eye(4)
                name = model.joint(joint).name
                coefficients = np.zeros(5)
                if name in independent:
                    coefficients[1] = 1.0
                    self._drivers.append(independent[name])
                else:
                    coupling = couplings[name]
                    coefficients[: len(coupling.coefficients)] = coupling.coefficients
                    driver = coupling.driver
                    self._drivers.append(independent[driver] if driver else 0)
                coefficients[0] -= model.qpos0[model.jnt_qposadr[joint]]
                polynomials.append(coefficients)
        tail = before @ _placed(model.site_pos[site.id], model.site_quat[site.id])
        fixed, by_sin, by_cos = (np.array([part[k] for part in parts]) for k in range(3))
        for buffer, values in {
            "fixed": fixed,
            "by_sin": by_sin,
            "by_cos": by_cos,
            "polynomials": np.array(polynomials),
            "tail": tail,
        }.items():
            self.register_buffer(buffer, torch.tensor(values, dtype=torch.float32))

    def forward(self, angles: Tensor) -> Tensor:
        """(B, 4, 4) the device's transform, MuJoCo world frame, for independent angles (B, J)."""
        x = angles[:, self._drivers]
        turned = self.polynomials[:, 4]
        for power in (3, 2, 1, 0):
            turned = turned * x + self.polynomials[:, power]
        links = (
            self.fixed
            + turned.sin()[..., None, None] * self.by_sin
            + turned.cos()[..., None, None] * self.by_cos
        )
        while links.shape[1] > 1:  # neighbours first: few products of many matrices
            even = links.shape[1] // 2 * 2
            links = torch.cat([links[:, 0:even:2] @ links[:, 1:even:2], links[:, even:]], 1)
        placed: Tensor = links[:, 0] @ self.tail
        return placed


def _placed(position: NDArray[np.float64], quaternion: NDArray[np.float64]) -> NDArray[np.float64]:
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, np.asarray(quaternion, dtype=np.float64))
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = rotation.reshape(3, 3), position
    return transform


def _hinge(model: mujoco.MjModel, joint: int) -> tuple[NDArray[np.float64], ...]:
    """Rodrigues' formula about the joint's anchor: constant part, and those of sin and cos."""
    x, y, z = model.jnt_axis[joint]
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    there, back = np.eye(4), np.eye(4)
    there[:3, 3], back[:3, 3] = model.jnt_pos[joint], -model.jnt_pos[joint]
    parts = []
    for rotation, last in ((np.eye(3) + cross @ cross, 1.0), (cross, 0.0), (-cross @ cross, 0.0)):
        part = np.zeros((4, 4))
        part[:3, :3], part[3, 3] = rotation, last
        parts.append(there @ part @ back)
    return tuple(parts)


class BodyModel(nn.Module):
    """One user step of a body, differentiable.

    Args:
        user: the body.
        device: the worn device whose place is wanted.
        step_s: duration of a user step.
        width: of the hidden layers.
    """

    error: Tensor
    """(J,) standard deviation of what the model gets wrong of the speeds after a step, rad/s."""

    def __init__(self, user: Body, device: str, step_s: float, *, width: int = 256) -> None:
        super().__init__()
        self.activation = _Activation()
        self.acceleration = _Acceleration(user, step_s, width)
        self.chain = _Chain(user, device)
        self.register_buffer("error", torch.zeros(len(user.independent_joints)))
        self._step_s = step_s

    def forward(self, before: Motion, control: Tensor) -> Motion:
        """The motion after a user step with these controls, (B, M) in [0, 1]."""
        act = self.activation(before.act, control)
        angles, speeds = self.acceleration(before, act)
        return Motion(angles, speeds, act)

    def disturbed(self, motion: Motion, share: float) -> Motion:
        """``motion`` with noise of ``share`` times what the model gets wrong in a step."""
        noise = share * self.error * torch.randn_like(motion.speeds)
        angles = motion.angles + 0.5 * self._step_s * noise
        return Motion(angles, motion.speeds + noise, motion.act)


def fit_body(
    body: BodyModel,
    steps: Experience,
    *,
    minibatches: int,
    learning_rate: float,
    batch_size: int = 1024,
    held_out: int = 4096,
    tell: Callable[[float], None] = lambda share: None,
) -> dict[str, float]:
    """Fit a body model to user steps; the learning rate rises and falls once.

    Args:
        body: changed.
        steps: in any order; some are held out to measure with.
        minibatches: how many to learn from.
        learning_rate: the highest.
        batch_size: steps in a minibatch.
        held_out: at most so many, and at most a tenth, are not learned from.
        tell: is told which share of the minibatches is done.

    Returns:
        ``speed``: root mean square error of the speeds after a step, in units of their change's
        spread; ``act``: mean absolute error of the activations; ``place_m``: mean error of the
        device's place after a step; ``moved_m``: how far it moved on average. Of held out steps.
    """
    order = torch.randperm(len(steps))
    aside = min(held_out, len(steps) // 10)
    test, known = steps.rows(order[:aside]), order[aside:]
    learned = [*body.activation.parameters(), *body.acceleration.parameters()]
    for parameter in learned:
        parameter.requires_grad_(True)
    optimizer = torch.optim.Adam(learned, lr=learning_rate)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimizer, learning_rate, total_steps=minibatches, pct_start=0.1
    )
    for done in range(minibatches):
        tell(done / minibatches)
        batch = steps.rows(known[torch.randint(len(known), (batch_size,))])
        loss = _loss(body, batch)
        optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        nn.utils.clip_grad_norm_(learned, 5.0)
        optimizer.step()
        schedule.step()
    for parameter in learned:
        parameter.requires_grad_(False)
    return _measure(body, test)


def _loss(body: BodyModel, batch: Experience) -> Tensor:
    after, wanted = body.acceleration, batch.after
    act = body.activation(batch.before.act, batch.control)
    angles, speeds = after(batch.before, wanted.act)
    return (
        ((speeds - wanted.speeds) / after.gain).square().mean()
        + ((angles - wanted.angles) / after.remainder).square().mean()
        + 1000.0 * (act - wanted.act).square().mean()
    )


def _measure(body: BodyModel, test: Experience) -> dict[str, float]:
    with torch.no_grad():
        told = body(test.before, test.control)
        wrong = told.speeds - test.after.speeds
        body.error.copy_(wrong.std(0))
        place = body.chain(torch.cat([told.angles, test.after.angles, test.before.angles]))
        told_at, was_at, from_ = place[:, :3, 3].chunk(3)
        values = {
            "speed": (wrong / body.acceleration.gain).square().mean().sqrt(),
            "act": (told.act - test.after.act).abs().mean(),
            "place_m": (told_at - was_at).norm(dim=1).mean(),
            "moved_m": (from_ - was_at).norm(dim=1).mean(),
        }
    return {name: float(value) for name, value in values.items()}
