"""A differentiable body, learned from what the simulated one did.

One user step (25 substeps of physics, actuators included) as a function whose gradient is known:
where a tool goes when a muscle pulls a little more. Activation and acceleration are learned, of
every limb by itself; motors' targets and how joint angles place the hands are exact, from the
action rules and the body's chains of joints.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import mujoco
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from sim2vr_harness.base.torch_threads import FastestThreads
from sim2vr_harness.users import Body
from sim2vr_harness.users.bodies.rules import moment_arms
from sim2vr_harness.users.kinematics.forward_torch import Chains
from sim2vr_harness.world_models.actuator_state import ActuatorState
from sim2vr_harness.world_models.columns import Columns
from sim2vr_harness.world_models.learning_device import LearningDevice
from sim2vr_harness.world_models.person_features import ImaginedPersons
from sim2vr_harness.world_models.transitions import Motion, TransitionStore

_TRIALS, _ALIKE = 4, 0.1
"""States in which limbs are compared, and how far their accelerations may differ, as a share."""


@dataclass(frozen=True)
class JointGroup:
    """Independent joints that are moved together, and all that they depend on.

    Attributes:
        joints: which of the body's independent joints.
        actuators: which of the body's actions work on them.
        seen: other joints whose angles and speeds matter.
        base: those of them that carry the limb: how their speeds change matters too.
    """

    joints: tuple[int, ...]
    actuators: tuple[int, ...]
    seen: tuple[int, ...] = ()
    base: tuple[int, ...] = ()


def limbs_of(body: Body) -> list[list[JointGroup]]:
    """Return the limbs of a body, what carries before what is carried.

    They are in groups of those that are nearly alike.
    """
    groups: list[list[JointGroup]] = []
    for limb in [part for whole in _apart(body) for part in _divided(body, whole)]:
        for group in groups:
            if _alike(body, group[0], limb):
                group.append(limb)
                break
        else:
            groups.append([limb])
    return groups


def _apart(body: Body, without: tuple[int, ...] = ()) -> list[JointGroup]:
    """Return the independent groups of joints if the joints ``without`` are fixed and left out."""
    model = body.physics_model
    root = list(range(model.njnt))
    """Parent of each joint in a union-find forest; joints of one limb share a root."""

    def find(joint: int) -> int:
        while root[joint] != joint:
            joint = root[joint]
        return joint

    def join(joints: list[int]) -> None:
        for other in joints[1:]:
            root[find(other)] = find(joints[0])

    locked = {c.dependent for c in body.couplings if not any(c.coefficients[1:])}
    still = {_joint_id(body, j) for j in without}
    moves = [model.joint(i).name not in locked and i not in still for i in range(model.njnt)]
    for i in range(1, model.nbody):  # a joint, and the nearest one above it
        own = _own(model, i, moves)
        if own:
            join([*own, *_above(model, i, moves)])
    for coupling in body.couplings:
        if coupling.dependent not in locked:
            join([model.joint(coupling.dependent).id, model.joint(coupling.driver).id])
    pulled = _pulled(body)
    for joints in pulled:
        join([j for j in joints if moves[j]])
    limbs: dict[int, list[int]] = {}
    for number in range(len(body.independent_joints)):
        if number not in without:
            limbs.setdefault(find(_joint_id(body, number)), []).append(number)
    works_on = [find(joints[0]) if joints else -1 for joints in pulled]
    return [
        JointGroup(tuple(joints), tuple(a for a, limb in enumerate(works_on) if limb == which))
        for which, joints in limbs.items()
    ]


def _divided(body: Body, whole: JointGroup) -> list[JointGroup]:
    """Divide a limb where it branches: what carries the branches, and each of them.

    A limb without branches, or with an actuator or a coupling from what carries to what is carried,
    stays whole.
    """
    stem = _stem(body, whole.joints)
    if len(stem) in (0, len(whole.joints)):
        return [whole]
    branches = [limb for limb in _apart(body, stem) if set(limb.joints) <= set(whole.joints)]
    if len(branches) < 2 or _is_bridged(body, stem):
        return [whole]
    carried = tuple(joint for branch in branches for joint in branch.joints)
    return [
        JointGroup(stem, whole.actuators, seen=carried),
        *(replace(branch, seen=stem, base=stem) for branch in branches),
    ]


def _stem(body: Body, joints: tuple[int, ...]) -> tuple[int, ...]:
    """Those of a limb's joints that carry, or are carried by, every other one."""
    model = body.physics_model
    owner = {j: int(model.jnt_bodyid[_joint_id(body, j)]) for j in joints}

    def carries(lower: int, upper: int) -> bool:
        while upper > lower:
            upper = int(model.body_parentid[upper])
        return upper == lower

    return tuple(
        j
        for j in joints
        if all(carries(owner[j], owner[k]) or carries(owner[k], owner[j]) for k in joints)
    )


def _is_bridged(body: Body, stem: tuple[int, ...]) -> bool:
    """Return True if an actuator or a coupling links joints of the stem to others."""
    model = body.physics_model
    inside = {_joint_id(body, j) for j in stem}
    together = [set(joints) for joints in _pulled(body)]
    together += [{model.joint(c.dependent).id, model.joint(c.driver).id} for c in body.couplings]
    return any(joints & inside and joints - inside for joints in together)


def _joint_id(body: Body, independent: int) -> int:
    return int(body.physics_model.joint(body.independent_joints[independent]).id)


def _own(model: mujoco.MjModel, body: int, moves: list[bool]) -> list[int]:
    """The joints of a body that move."""
    first = int(model.body_jntadr[body])
    return [j for j in range(first, first + int(model.body_jntnum[body])) if moves[j]]


def _above(model: mujoco.MjModel, body: int, moves: list[bool]) -> list[int]:
    """The nearest moving joint above a body; empty if there is none."""
    above = int(model.body_parentid[body])
    while above != 0:
        own = _own(model, above, moves)
        if own:
            return own[-1:]
        above = int(model.body_parentid[above])
    return []


def _pulled(body: Body) -> list[list[int]]:
    """Return for every action the joints on which its actuator acts in some posture."""
    model = body.physics_model
    data = mujoco.MjData(model)
    rng, (low, high) = np.random.default_rng(0), body.joint_ranges.T
    pulls = np.zeros((model.nu, model.nv), dtype=bool)
    for _ in range(_TRIALS):
        data.qpos[:] = body.coupled_qpos(rng.uniform(low, high))
        mujoco.mj_forward(model, data)
        moment = moment_arms(model, data)
        pulls |= np.abs(moment) > 1e-9
    joint_of = np.array(model.dof_jntid)
    ids = [model.actuator(name).id for name in body.action_names]
    return [sorted({int(joint_of[dof]) for dof in np.flatnonzero(pulls[i])}) for i in ids]


def _alike(body: Body, one: JointGroup, other: JointGroup) -> bool:
    """Return True if two limbs on a fixed base have nearly equal accelerations in equal states."""
    if (len(one.joints), len(one.actuators)) != (len(other.joints), len(other.actuators)):
        return False
    if one.seen or other.seen:
        return False
    ranges = body.joint_ranges
    if not np.allclose(ranges[list(one.joints)], ranges[list(other.joints)]):
        return False
    rng, (low, high) = np.random.default_rng(1), ranges.T
    for _ in range(_TRIALS):
        angles, speeds = rng.uniform(low, high), rng.normal(0.0, 2.0, len(low))
        drives = rng.uniform(0.0, 1.0, body.action_size)
        for values, first, second in (
            (angles, one.joints, other.joints),
            (speeds, one.joints, other.joints),
            (drives, one.actuators, other.actuators),
        ):
            values[list(second)] = values[list(first)]
        # (J,) of the independent joints, rad/s^2, with the dependent joints at rest.
        model = body.physics_model
        data = mujoco.MjData(model)
        data.qpos[:] = body.coupled_qpos(angles)
        data.qvel[body.qvel_independent] = speeds
        for name, drive in zip(body.action_names, drives, strict=True):
            i = model.actuator(name).id
            accelerations_low, accelerations_high = (
                model.actuator_ctrlrange[i] if model.actuator_ctrllimited[i] else (0.0, 1.0)
            )
            data.ctrl[i] = accelerations_low + drive * (accelerations_high - accelerations_low)
            if model.actuator_actadr[i] >= 0:
                data.act[model.actuator_actadr[i]] = drive
        mujoco.mj_forward(model, data)
        accelerations: NDArray[np.float64] = data.qacc[body.qvel_independent].copy()
        moved = accelerations
        mine, others = moved[list(one.joints)], moved[list(other.joints)]
        if np.abs(mine - others).max() > _ALIKE * np.abs(mine).max():
            return False
    return True


_LIMIT_RAD = 0.02
"""Distance from a joint's limit over which the limit acts, so that a network can learn the stop."""
_BEYOND_RAD, _FASTEST_RADPS = 0.3, 40.0
"""Bounds of predictions: angle beyond a joint's limits, and joint speed. Without them a model with
few data would accelerate bodies at every step."""
_MOST_HELD_OUT = 4096
"""Largest number of transitions that are held out of the fit."""


def mlp(*widths: int) -> nn.Sequential:
    """Linear layers of these widths, SiLU between them."""
    layers: list[nn.Module] = []
    for into, out in pairwise(widths):
        layers += [nn.Linear(into, out), nn.SiLU()]
    return nn.Sequential(*layers[:-1])


class _Activation(nn.Module):
    """Network that predicts activations after a user step from activations and controls."""

    def __init__(self) -> None:
        super().__init__()
        self._share = mlp(2, 16, 16, 1)

    def forward(self, act: Tensor, control: Tensor) -> Tensor:
        share = torch.sigmoid(self._share(torch.stack([act, control], -1)).squeeze(-1))
        return act + share * (control - act)


class _Acceleration(nn.Module):
    """Network that predicts angles and speeds after a user step, for limbs that are nearly alike.

    Acceleration is linear in the drives, with coefficients that depend on angles and speeds,
    as it is within a substep (a muscle's force in its activation, a motor's torque in its target);
    a second network learns the rest, with how far joints would go beyond their limits among its
    inputs. Which limb it is is one of the inputs; of limbs that are carried so is how what carries
    them moves, its change of speed as one drive more for each joint.

    Args:
        user: the body.
        limbs: L limbs with as many joints and actuators each.
        step_s: duration of a user step.
        width: size of the hidden layers.
        persons: tensor representation of persons.
    """

    mean: Tensor
    spread: Tensor
    speed: Tensor
    gain: Tensor
    remainder: Tensor
    seen_mean: Tensor
    seen_spread: Tensor
    seen_speed: Tensor
    base_gain: Tensor
    low: Tensor
    high: Tensor

    def __init__(
        self,
        user: Body,
        limbs: Sequence[JointGroup],
        step_s: float,
        width: int,
        persons: ImaginedPersons | None,
    ) -> None:
        super().__init__()
        joints, drives = len(limbs[0].joints), len(limbs[0].actuators)
        seen, base = limbs[0].seen, limbs[0].base
        self._joints, self._drives, self._limbs = joints, drives, len(limbs)
        self._step_s, self._persons = step_s, persons
        self.joint_columns = [j for limb in limbs for j in limb.joints]
        self.seen_columns, self.base_columns = list(seen), list(base)
        drive_columns = [a for limb in limbs for a in limb.actuators]
        self._of_joint = Columns(self.joint_columns, len(user.independent_joints))
        self._of_drive = Columns(drive_columns, len(user.action_names))
        self._of_seen, self._of_base = (
            torch.tensor(columns, dtype=torch.long) for columns in (self.seen_columns, base)
        )
        """Columns of other observed joints, which groups of several limbs lack, and of the base."""
        for name in ("mean", "spread", "speed", "gain", "remainder"):
            self.register_buffer(name, torch.ones(joints))
        for name in ("seen_mean", "seen_spread", "seen_speed"):
            self.register_buffer(name, torch.ones(len(seen)))
        self.register_buffer("base_gain", torch.ones(len(base)))
        low, high = torch.tensor(user.joint_ranges.T.copy(), dtype=torch.float32)
        self.register_buffer("low", self._of_joints(low[None]))
        self.register_buffer("high", self._of_joints(high[None]))
        which = len(limbs) if len(limbs) > 1 else 0
        which += 0 if persons is None else len(persons.names)
        inputs = 6 * joints + 4 * len(seen) + which
        pulls = 2 * drives + len(base)
        self._linear = mlp(inputs, width, width, joints * (pulls + 1))
        self._rest = mlp(inputs + 2 * joints + pulls, width, width, 2 * joints)

    def _of_joints(self, values: Tensor) -> Tensor:
        """(B, J) of a body -> (B L, joints), limb by limb of every user."""
        return self._of_joint(values).reshape(-1, self._joints)

    def _of_drives(self, values: Tensor) -> Tensor:
        return self._of_drive(values).reshape(-1, self._drives)

    def scale_by(self, steps: TransitionStore) -> None:
        """Take the units of inputs and outputs from what happened."""
        q, v, after_q, after_v = (
            self._of_joints(values)
            for motion in (steps.before, steps.after)
            for values in (motion.angles, motion.speeds)
        )
        free = q + 0.5 * self._step_s * (v + after_v)
        self.mean.copy_(q.mean(0))
        self.spread.copy_(q.std(0))
        self.speed.copy_(v.std(0))
        self.gain.copy_((after_v - v).std(0))
        self.remainder.copy_((after_q - free).std(0))
        seen, base = self._of_seen, self._of_base
        if not self.seen_columns:
            return
        self.seen_mean.copy_(steps.before.angles[:, seen].mean(0))
        self.seen_spread.copy_(steps.before.angles[:, seen].std(0))
        self.seen_speed.copy_(steps.before.speeds[:, seen].std(0))
        if self.base_columns:
            self.base_gain.copy_((steps.after.speeds - steps.before.speeds)[:, base].std(0))

    def loss(self, before: Motion, wanted: Motion) -> Tensor:
        """Mean squared error of the motion after a step, in units of what happens."""
        base = self._of_base
        carried = wanted.speeds[:, base] - before.speeds[:, base]
        angles, speeds = self(before, wanted.drives, carried)
        wrong_v = (speeds - self._of_joints(wanted.speeds)) / self.gain
        wrong_q = (angles - self._of_joints(wanted.angles)) / self.remainder
        return wrong_v.square().mean() + wrong_q.square().mean()

    def forward(self, before: Motion, drives: Tensor, carried: Tensor) -> tuple[Tensor, Tensor]:
        """Angles and speeds (B L, joints) each after a step that ends with drives (B, A).

        ``carried`` (B, base) is how the speeds of what carries the limb change, rad/s.
        """
        users = len(drives)
        q, v = self._of_joints(before.angles), self._of_joints(before.speeds)
        both = torch.cat([self._of_drives(before.drives), self._of_drives(drives)], -1)
        low, high = (
            bound if self._limbs == 1 else bound.repeat(users, 1) for bound in (self.low, self.high)
        )
        parts = [
            (q - self.mean) / self.spread,
            v / self.speed,
            q.sin(),
            q.cos(),
            torch.relu(q + 0.03 - high) * 30.0,
            torch.relu(low + 0.03 - q) * 30.0,
        ]
        if self.seen_columns:
            seen_q = before.angles[:, self._of_seen]
            seen_v = before.speeds[:, self._of_seen]
            scaled = (seen_q - self.seen_mean) / self.seen_spread
            parts += [scaled, seen_v / self.seen_speed, seen_q.sin(), seen_q.cos()]
        if self._limbs > 1:
            parts.append(torch.eye(self._limbs).repeat(users, 1))
        if self._persons is not None:
            told = self._persons.features(before.persons)
            parts.append(told.repeat_interleave(self._limbs, 0))
        state = torch.cat(parts, -1)
        terms = self._linear(state)
        pulls, felt = both, 2.0 * both - 1.0
        if self.base_columns:
            moved = carried / self.base_gain
            pulls, felt = torch.cat([pulls, moved], -1), torch.cat([felt, moved], -1)
        by_pull, by_itself = terms.split([self._joints * pulls.shape[1], self._joints], -1)
        effect = by_pull.reshape(-1, self._joints, pulls.shape[1])
        pulled = 0.2 * (effect @ pulls[..., None])[..., 0] + by_itself
        free_v = v + pulled * self.gain
        free_q = q + 0.5 * self._step_s * (v + free_v)
        beyond = [
            nn.functional.softplus((free_q - high) / _LIMIT_RAD),
            nn.functional.softplus((low - free_q) / _LIMIT_RAD),
        ]
        rest = self._rest(torch.cat([state, felt, *(0.4 * b for b in beyond)], -1))
        more_v, more_q = rest.chunk(2, -1)
        speeds = free_v + more_v * self.gain
        angles = q + 0.5 * self._step_s * (v + speeds) + more_q * self.remainder
        return angles, speeds


class BodyModel(nn.Module):
    """One user step of a body, differentiable.

    Args:
        user: the body.
        devices: the worn devices whose poses are predicted.
        step_s: duration of a user step.
        width: size of the hidden layers.
        persons: tensor representation of persons; None: all are `user`.
    """

    error: Tensor
    """(J,) standard deviation of the model's error in the speeds after a step, rad/s."""
    gain: Tensor
    """(J,) standard deviation of how speeds change in a step, rad/s."""

    def __init__(
        self,
        user: Body,
        devices: Sequence[str],
        step_s: float,
        *,
        width: int = 256,
        persons: ImaginedPersons | None = None,
    ) -> None:
        super().__init__()
        self.devices = tuple(devices)
        self.drives = ActuatorState(user)
        self.activation = _Activation()
        groups = limbs_of(user)
        self.accelerations = nn.ModuleList(
            [_Acceleration(user, limbs, step_s, width, persons) for limbs in groups]
        )
        columns = [j for each in self._each() for j in each.joint_columns]
        self._order = torch.tensor([columns.index(j) for j in range(len(columns))])
        self._in_order = columns == sorted(columns)
        self._persons = persons
        self._chains = Chains(user, devices, persons.references if persons else ())
        self.register_buffer("error", torch.zeros(len(user.independent_joints)))
        self.register_buffer("gain", torch.ones(len(user.independent_joints)))
        low, high = torch.tensor(user.joint_ranges.T.copy(), dtype=torch.float32)
        self._low, self._high = low - _BEYOND_RAD, high + _BEYOND_RAD
        self.step_s = step_s

    def _each(self) -> list[_Acceleration]:
        return [each for each in self.accelerations if isinstance(each, _Acceleration)]

    def scale_by(self, steps: TransitionStore) -> None:
        """Take the units of inputs and outputs from what happened."""
        for each in self._each():
            each.scale_by(steps)
        self.gain.copy_((steps.after.speeds - steps.before.speeds).std(0))

    def places(self, angles: Tensor, persons: Tensor) -> Tensor:
        """Return (B, D, 4, 4) device poses of persons (B, P) at angles (B, J)."""
        sizes = None if self._persons is None else self._persons.sizes(persons)
        placed: Tensor = self._chains(angles, sizes)
        return placed

    def learned(self) -> list[nn.Parameter]:
        """Return the fitted parameters, with those of activation only for bodies with muscles."""
        activation = self.activation.parameters() if len(self.drives.muscles) else ()
        return [*activation, *self.accelerations.parameters()]

    def loss(self, steps: TransitionStore) -> Tensor:
        """Return the loss of the fit: errors in the predicted motion after steps."""
        wanted = steps.after
        motion = [each.loss(steps.before, wanted) for each in self._each()]
        loss = torch.stack(motion).mean()
        if not len(self.drives.muscles):
            return loss
        drives = self.drives_after(steps.before, steps.control)
        wrong = (drives - wanted.drives)[:, self.drives.muscle_columns]
        return loss + 1000.0 * wrong.square().mean()

    def drives_after(self, before: Motion, control: Tensor) -> Tensor:
        """Return (B, A) drives: muscles follow their controls, others are equal to them."""
        muscles = self.drives.muscle_columns
        if len(muscles) == self.drives.count:
            after: Tensor = self.activation(before.drives, control)
            return after
        if not len(muscles):
            return control
        followed = self.activation(before.drives[:, muscles], control[:, muscles])
        return control.index_copy(1, muscles, followed)

    def forward(self, before: Motion, control: Tensor) -> Motion:
        """Return the motion after a user step with these controls, (B, A) in [0, 1]."""
        drives = self.drives_after(before, control)
        angles: list[Tensor] = []
        speeds: list[Tensor] = []
        changed: dict[int, Tensor] = {}
        """Speed changes of joints that carry other joints."""
        for each in self._each():
            base = [changed[j] for j in each.base_columns]
            carried = torch.stack(base, 1) if base else drives[:, :0]
            after_q, after_v = (v.reshape(len(drives), -1) for v in each(before, drives, carried))
            angles.append(after_q)
            speeds.append(after_v)
            if each.seen_columns and not base:
                change = after_v - before.speeds[:, each.joint_columns]
                changed |= dict(zip(each.joint_columns, change.unbind(1), strict=True))
        all_angles, all_speeds = (
            torch.cat(parts, 1) if self._in_order else torch.cat(parts, 1)[:, self._order]
            for parts in (angles, speeds)
        )
        all_angles = all_angles.clamp(self._low, self._high)
        all_speeds = all_speeds.clamp(-_FASTEST_RADPS, _FASTEST_RADPS)
        return Motion(all_angles, all_speeds, drives, before.persons)

    def disturbed(self, motion: Motion, share: float) -> Motion:
        """``motion`` with noise of ``share`` times what the model gets wrong in a step."""
        noise = share * self.error * torch.randn_like(motion.speeds)
        angles = motion.angles + 0.5 * self.step_s * noise
        return Motion(angles, motion.speeds + noise, motion.drives, motion.persons)


def fit_body(
    body: BodyModel,
    steps: TransitionStore,
    *,
    minibatches: int,
    learning_rate: float,
    batch_size: int = 1024,
    device: LearningDevice | None = None,
    threads: FastestThreads | None = None,
    on_progress: Callable[[float], None] = lambda share: None,
) -> dict[str, float]:
    """Fit a body model to user steps; the learning rate rises and falls once.

    Args:
        body: changed.
        steps: in any order; a tenth, at most 4,096, are held out to measure with.
        minibatches: how many to learn from.
        learning_rate: the highest.
        batch_size: steps in a minibatch.
        device: where the model and the steps are; None: the CPU.
        threads: finds how many of torch's threads a minibatch is computed by; None: all.

    Returns:
        ``speed``: root mean square error of the speeds after a step, in units of their change's
        spread; ``drives``: mean absolute error of the drives; ``place_m``: mean error of devices'
        places after a step; ``moved_m``: their mean way. Of held out steps and moving devices.
    """
    aside = min(_MOST_HELD_OUT, len(steps) // 10)
    test, known = torch.randperm(len(steps)).tensor_split([aside])
    learned = nn.ParameterList(body.learned()).requires_grad_(True)
    device = device or LearningDevice("cpu")
    optimizer = torch.optim.Adam(learned, lr=learning_rate, fused=device.is_gpu or None)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimizer, learning_rate, total_steps=minibatches, pct_start=0.1
    )

    def set_gradients() -> None:
        loss = body.loss(steps.rows(known[torch.randint(len(known), (batch_size,))]))
        optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        nn.utils.clip_grad_norm_(learned, 5.0)

    minibatch = device.window(set_gradients, [])
    threads = threads or FastestThreads([torch.get_num_threads()])
    for done in range(minibatches):
        on_progress(done / minibatches)
        with threads.turn():
            minibatch()
            optimizer.step()
        schedule.step()
    learned.requires_grad_(False)
    return _measure(body, steps.rows(test))


def _measure(body: BodyModel, test: TransitionStore) -> dict[str, float]:
    with torch.no_grad():
        predicted = body(test.before, test.control)
        wrong = predicted.speeds - test.after.speeds
        body.error.copy_(wrong.std(0))
        angles = torch.cat([predicted.angles, test.after.angles, test.before.angles])
        place = body.places(angles, test.before.persons.repeat(3, 1))
        put_at, was_at, from_ = place[:, :, :3, 3].chunk(3)
        moved = (from_ - was_at).norm(dim=2).mean(0)
        moving = moved > 0.0
        values = {
            "speed": (wrong / body.gain).square().mean().sqrt(),
            "drives": (predicted.drives - test.after.drives).abs().mean(),
            "place_m": (put_at - was_at).norm(dim=2).mean(0)[moving].mean(),
            "moved_m": moved[moving].mean(),
        }
    return {name: float(value) for name, value in values.items()}
