"""A differentiable body, learned from what the simulated one did.

One user step (25 substeps of physics, muscles included) as a function whose gradient is known:
where the hammer goes when a muscle pulls a little more. Activation and acceleration are learned;
how joint angles place the hand is exact, from the body model's chain of joints.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import torch
from torch import Tensor, nn

from sim2vr_harness.training.imagined.chain import Chain
from sim2vr_harness.training.imagined.experience import Experience, Motion
from sim2vr_harness.users import Body

__all__ = ["BodyModel", "fit_body", "mlp"]

_LIMIT_RAD = 0.02
"""Over which a joint's limit is felt: its sharp stop, as a network can learn it."""


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
    as muscles' is within a substep; a second network learns the rest, with how far joints would
    go beyond their limits among its inputs.
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
        self.chain = Chain(user, device)
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
    on_progress: Callable[[float], None] = lambda share: None,
) -> dict[str, float]:
    """Fit a body model to user steps; the learning rate rises and falls once.

    Args:
        body: changed.
        steps: in any order; some are held out to measure with.
        minibatches: how many to learn from.
        learning_rate: the highest.
        batch_size: steps in a minibatch.
        held_out: at most so many, and at most a tenth, are not learned from.
        on_progress: called with the share of the minibatches that is done.

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
        on_progress(done / minibatches)
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
        predicted = body(test.before, test.control)
        wrong = predicted.speeds - test.after.speeds
        body.error.copy_(wrong.std(0))
        place = body.chain(torch.cat([predicted.angles, test.after.angles, test.before.angles]))
        put_at, was_at, from_ = place[:, :3, 3].chunk(3)
        values = {
            "speed": (wrong / body.acceleration.gain).square().mean().sqrt(),
            "act": (predicted.act - test.after.act).abs().mean(),
            "place_m": (put_at - was_at).norm(dim=1).mean(),
            "moved_m": (from_ - was_at).norm(dim=1).mean(),
        }
    return {name: float(value) for name, value in values.items()}
