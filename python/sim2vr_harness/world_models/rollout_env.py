"""B imagined users: bodies of a learned model, moved by a policy's actions."""

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.state import State
from sim2vr_harness.users import Body, held
from sim2vr_harness.users.noise import MotorNoiseSettings
from sim2vr_harness.world_models.actuator_state import REST_ACT
from sim2vr_harness.world_models.body_dynamics import BodyModel
from sim2vr_harness.world_models.effort import Effort
from sim2vr_harness.world_models.gradient_clipping import limited
from sim2vr_harness.world_models.person_features import ImaginedPersons
from sim2vr_harness.world_models.transitions import Motion


class ImaginedNoise(State):
    """Differentiable version of :class:`~sim2vr_harness.users.noise.MotorNoise`.

    It samples from torch's global generator. Red noise starts at 0 when a rollout starts from a
    state of the true game.

    Args:
        settings: settings of the noise.
        n: number of users B.
        muscles: number of muscles M.
    """

    _state = ("_signal_red", "_constant_red")

    def __init__(self, settings: MotorNoiseSettings, n: int, muscles: int) -> None:
        self._settings = settings
        self._signal_red, self._constant_red = torch.zeros(n, muscles), torch.zeros(n, 1)

    def apply(self, control: Tensor, factor: Tensor | float = 1.0) -> Tensor:
        """Return (B, M) noisy controls, in [0, 1] as ``control``.

        Args:
            control: (B, M).
            factor: (B, 1) on the noise of each user.
        """
        settings, noisy = self._settings, control
        if settings.signal_dependent is not None:
            drawn = settings.signal_dependent_level * factor * control * torch.randn_like(control)
            if settings.signal_dependent == "red":
                drawn = self._signal_red + drawn
                self._signal_red = drawn.detach()
            noisy = noisy + drawn
        if settings.constant is not None:
            shared = settings.constant_level * factor * torch.randn(len(control), 1)
            if settings.constant == "red":
                shared = self._constant_red + shared
                self._constant_red = shared
            noisy = noisy + shared
        return noisy.clamp(0.0, 1.0)

    def forget(self, ids: Tensor) -> None:
        """Reset the accumulated noise of some users."""
        self._signal_red[ids], self._constant_red[ids] = 0.0, 0.0


_BROKEN_RADPS, _WILD_RADPS = 40.0, 15.0
_BEYOND_COST, _WILD_COST = 0.5, 0.02


class ImaginedUsers(State):
    """Users whose next motion is what a body model says; differentiable by their actions.

    Args:
        user: the body.
        body: its model.
        n: number of users B.
        effort: what a user step costs them.
        noise: of the muscles' controls; None for none.
        persons: tensor representation of persons; None: all are `user`.
        actuator_range_cost: cost of actuator targets beyond their ranges; above 0 gradients point
            back into the range.
        activation_cost: cost of the deviation of drives from :attr:`rest`.
        action_rate_cost: cost of the change of drives by actions.
        movement_cost: cost of hand movement, in proportion to the squared speed, m^2/s^2.

    Raises:
        InputError: a cost of carrying where hands hold nothing.
    """

    _state = ("motion", "_control", "_noise")

    def __init__(
        self,
        user: Body,
        body: BodyModel,
        n: int,
        *,
        effort: Effort,
        noise: MotorNoiseSettings | None = None,
        persons: ImaginedPersons | None = None,
        actuator_range_cost: float = 0.0,
        activation_cost: float = 0.0,
        action_rate_cost: float = 0.0,
        movement_cost: float = 0.0,
    ) -> None:
        self._actuator_range_cost, self._activation_cost = actuator_range_cost, activation_cost
        self._action_rate_cost, self._movement_cost = action_rate_cost, movement_cost
        hands = [body.devices.index(name) for name in held(body.devices)]
        self._hands = torch.tensor(hands, dtype=torch.long)
        if movement_cost > 0.0 and not hands:
            got = f"{movement_cost:g}, where hands hold nothing"
            raise InputError("teacher.imagined.movement_cost", got, "0")
        self.n, self.body, self._effort, self._drives = n, body, effort, body.drives
        self._persons = persons
        joints, drives = len(user.independent_joints), self._drives.count
        self.names: tuple[str, ...] = (
            *(f"{joint} qpos" for joint in user.independent_joints),
            *(f"{joint} qvel" for joint in user.independent_joints),
            *self._drives.names,
            *(() if persons is None else persons.names),
        )
        """Names of the values of :meth:`observe`, as in the proprioception."""
        self.actions = drives
        """A, of a user step."""
        self._low, self._high = torch.tensor(user.joint_ranges.T.copy(), dtype=torch.float32)
        who = 0 if persons is None else persons.count
        self.motion = Motion(*(torch.zeros(n, size) for size in (joints, joints, drives, who)))
        self._control = torch.zeros(n, drives)
        self._aimed_beyond, self._changed, self._carried = (torch.zeros(n) for _ in range(3))
        self.rest = torch.full((drives,), 0.5)
        """(A,) drives of a body that has nothing to do."""
        self._noise = None if noise is None else ImaginedNoise(noise, n, len(user.muscles))
        self.noise_share = 1.0
        """Factor on every user's motor noise."""
        self.cost_share = 1.0
        """Factor on the costs of effort and of carrying."""
        self.gradient_limit: float | None = None
        """Longest gradient of a user by the angles, 1/rad; see :func:`~.gradients.limited`."""
        self._muscles = self._drives.muscle_columns
        self._placed: tuple[Motion, Tensor] | None = None
        self._before = self.motion

    @property
    def place(self) -> Tensor:
        """(B, D, 4, 4) current device poses in MuJoCo's world frame; one tensor per motion."""
        if self._placed is None or self._placed[0] is not self.motion:
            self._placed = (self.motion, self.body.places(self.motion.angles, self.motion.persons))
        return self._placed[1]

    def _hands_at(self) -> Tensor:
        """Return (B, H, 3) current positions of the hands' devices, m."""
        return self.place[:, :, :3, 3].index_select(1, self._hands)

    def places(self, frames: int) -> Tensor:
        """Return (B, F, D, 4, 4) device poses in the F app frames of the last user step.

        Joint angles within the step are a cubic Hermite interpolation of angles and speeds at its
        ends.
        """
        before, after, step_s = self._before, self.motion, self.body.step_s
        between = []
        for k in range(1, frames):
            t = k / frames
            between.append(
                (1.0 + 2.0 * t) * (1.0 - t) ** 2 * before.angles
                + t * (1.0 - t) ** 2 * step_s * before.speeds
                + t**2 * (3.0 - 2.0 * t) * after.angles
                - t**2 * (1.0 - t) * step_s * after.speeds
            )
        if not between:
            return self.place[:, None]
        angles = torch.stack(between, 1).flatten(0, 1)
        who = after.persons.repeat_interleave(frames - 1, 0)
        on_the_way = self.body.places(angles, who)
        on_the_way = on_the_way.reshape(self.n, frames - 1, *on_the_way.shape[1:])
        return torch.cat([on_the_way, self.place[:, None]], 1)

    def start(self, ids: Tensor, motion: Motion) -> None:
        """Set users ``ids`` (K,) to ``motion``, of K users."""
        self._placed = None
        with torch.no_grad():
            for name in ("angles", "speeds", "drives", "persons"):
                getattr(self.motion, name)[ids] = getattr(motion, name)
            self._control = self._control.clone()
            self._control[ids] = motion.drives
            self._before = self.motion
            if self._noise is not None:
                self._noise.forget(ids)

    def cut(self) -> None:
        """Forget what led to the present: gradients end here."""
        self.motion, self._control = self.motion.detach(), self._control.detach()
        self._before = self._before.detach()

    def step(self, actions: Tensor, *, error_share: float) -> None:
        """Advance everyone by one user step.

        Args:
            actions: (B, A); what they do is their actuators' rule.
            error_share: noise on the motion, in units of the body model's error.
        """
        before = self.motion.drives
        control = self._drives.control(before, actions, inwards=self._actuator_range_cost > 0.0)
        if self._actuator_range_cost > 0.0:
            self._aimed_beyond = self._drives.beyond(before, actions)
        if self._action_rate_cost > 0.0:
            self._changed = (control - before).square().mean(1)
        if self._noise is not None:
            factor: Tensor | float = self.noise_share
            if self._persons is not None:
                factor = factor * self._persons.motor_noise(self.motion.persons)
            noisy = self._noise.apply(control[:, self._muscles], factor)
            control = control.index_copy(1, self._muscles, noisy)
        self._control = control
        self._before = self.motion
        begun = self._hands_at() if self._movement_cost > 0.0 else None
        after = self.body(self.motion, control)
        if self.gradient_limit is not None:
            limited(after.angles, self.gradient_limit)
            limited(after.speeds, self.gradient_limit * self.body.step_s)
        self.motion = self.body.disturbed(after, error_share) if error_share > 0.0 else after
        if begun is not None:
            way = self._hands_at() - begun
            self._carried = way.square().sum(-1).mean(-1) / self.body.step_s**2

    def rest_as(self, drives: Tensor) -> None:
        """Set :attr:`rest` by (N, A) drives of bodies that moved at random.

        Motors come back to where they rest again and again. Muscles do so as well, but are driven
        about the middle of their range: their mean would be a cramp.
        """
        self.rest = drives.mean(0)
        self.rest[self._muscles] = REST_ACT

    def costs(self) -> tuple[Tensor, Tensor, Tensor]:
        """(B,) each: of effort; of limits, rest left, abruptness and ways; of speeds."""
        motion = self.motion
        unit = 2.0 * (motion.angles - self._low) / (self._high - self._low) - 1.0
        beyond = torch.relu(unit.abs() - 1.0).sum(1)
        wild = torch.relu(motion.speeds.abs() - _WILD_RADPS).sum(1)
        effort = self._effort(motion.drives, self._control)
        if self._persons is not None:
            effort = effort * self._persons.effort(motion.persons)
        effort = self.cost_share * effort
        limits = _BEYOND_COST * beyond
        if self._actuator_range_cost > 0.0:
            limits = limits + self._actuator_range_cost * self._aimed_beyond
        if self._activation_cost > 0.0:
            away = (motion.drives - self.rest).square().mean(1)
            limits = limits + self._activation_cost * away
        if self._action_rate_cost > 0.0:
            limits = limits + self._action_rate_cost * self._changed
        if self._movement_cost > 0.0:
            limits = limits + self.cost_share * self._movement_cost * self._carried
        return effort, limits, _WILD_COST * wild

    def broken(self) -> Tensor:
        """Return (B,) True for users whose motion is beyond the limits of a body."""
        motion = self.motion
        wild = motion.speeds.detach().abs().amax(1) > _BROKEN_RADPS
        return wild | ~torch.isfinite(motion.angles.detach()).all(1)

    def observe(self) -> Tensor:
        """Return (B, F) in the order of :attr:`names`, differentiable by the motion."""
        motion = self.motion
        parts = [
            2.0 * (motion.angles - self._low) / (self._high - self._low) - 1.0,
            motion.speeds,
            self._drives.observe(motion.drives),
        ]
        if self._persons is not None:
            parts.append(self._persons.features(motion.persons))
        return torch.cat(parts, 1)

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restore a state of :meth:`state_dict`, except the body model."""
        super().load_state_dict(state)
        self._placed = None
        self._before = self.motion
