"""A body follows a hand's path: its motor policy receives where the hand shall be next."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.evaluation.data.columns import Column
from sim2vr_harness.evaluation.data.steps import BodySource
from sim2vr_harness.policies.hierarchical.goal_sampler import LEAD_STEPS
from sim2vr_harness.policies.hierarchical.motor_policy import MotorGoals, MotorPolicy
from sim2vr_harness.tools.track.paths import RecordedPath
from sim2vr_harness.tools.track.postures import posture_at
from sim2vr_harness.tools.track.registration import Placement
from sim2vr_harness.tools.track.trajectory_optimisation import AHEAD, Refinement
from sim2vr_harness.users import UserBatch

FloatArray = NDArray[np.float64]

WARM_UP_S = 1.5
"""Time for which the body holds the first place before the recording begins."""
POSE_SAMPLES = 5
"""Poses of the devices kept of every user step."""
_REFINED_TAKES = 150
"""Duration of trajectory optimisation, as a number of tracking passes."""
_LEVER_M = 0.1
"""Lever arm that converts the direction error of a hand to a distance, about a hand's length."""
_SLOPE_S = 0.02
"""Half the time step of the central differences for velocities of the recording."""


@dataclass(frozen=True)
class Wanted:
    """Reference trajectories of a body's H hands, in its world, per user step from the warm-up on.

    Attributes:
        hands: names of the devices.
        followed: (H,) True if the hand was recorded; the others rest.
        times_s: (J,) since the recording's first frame; less than 0 during the warm-up.
        places: (J, H, 3) m.
        velocities: (J, H, 3) m/s.
        axes: (J, H, 3) directions in which the devices point; zeros if the direction is free.
        first: the row at time 0.
    """

    hands: tuple[str, ...]
    followed: NDArray[np.bool_]
    times_s: FloatArray
    places: FloatArray
    velocities: FloatArray
    axes: FloatArray
    first: int

    @property
    def steps(self) -> int:
        """User steps from the beginning of the warm-up to the recording's end."""
        return len(self.times_s) - 1 - LEAD_STEPS


@dataclass(frozen=True)
class Pass:
    """Tracking error of the hands in one pass over the whole recording.

    Attributes:
        median_m: median position error of the hands.
        most_m: 95th percentile over the steps.
    """

    median_m: float
    most_m: float


@dataclass(frozen=True)
class Followed:
    """Motion of a body that tracks a recording, from the recording's first frame on; K user steps.

    Attributes:
        wanted: the reference trajectories.
        places: (K + 1, H, 3) positions of the hands; row 0 is time 0.
        columns: of ``values``: devices, joints, muscles, fatigue, as in evaluations.
        values: (K, C) at the ends of the steps.
        effort: (K,) cost of the steps, weighted.
        angles: (K, J) of the independent joints.
        qpos: (K, nq) postures.
        activations: (K, M).
        fatigued: (K, M) proportions of fatigued motor units (3CC-r), or None if unknown.
        sampled_s: (S,) since the recording's first frame, several times a step.
        sampled: device -> positions (S, 3) and rotations w x y z (S, 4) at these times.
        passes: errors of every pass; the motion is that of the pass with the least mean error.
    """

    wanted: Wanted
    places: FloatArray
    columns: tuple[Column, ...]
    values: FloatArray
    effort: FloatArray
    angles: FloatArray
    qpos: FloatArray
    activations: FloatArray
    fatigued: FloatArray | None
    sampled_s: FloatArray
    sampled: Mapping[str, tuple[FloatArray, FloatArray]]
    passes: tuple[Pass, ...]

    @property
    def times_s(self) -> FloatArray:
        """(K,) ends of the user steps."""
        first = self.wanted.first
        return self.wanted.times_s[first + 1 : first + 1 + len(self.values)]

    @property
    def targets(self) -> FloatArray:
        """(K, H, 3) reference positions of the hands at the ends of the steps."""
        first = self.wanted.first
        return self.wanted.places[first + 1 : first + 1 + len(self.values)]

    @property
    def errors_m(self) -> FloatArray:
        """(K, H) distances of the hands from these."""
        return np.asarray(np.linalg.norm(self.places[1:] - self.targets, axis=-1))


def wanted_of(
    path: RecordedPath,
    placement: Placement,
    hands: tuple[str, ...],
    step_s: float,
    *,
    pointed: bool = False,
) -> Wanted:
    """Return the reference trajectories of a body's hands for a recording.

    Args:
        path: the recording.
        placement: of the recorded world in the body's.
        hands: the body's devices.
        step_s: duration of a user step.
        pointed: True: the directions of the devices are tracked, too.

    Raises:
        InputError: the body has none of the recorded hands, or the recording is too short.
    """
    followed = np.array([name in path.hands for name in hands])
    if not followed.any():
        got = f"a path of {', '.join(path.hands)}"
        raise InputError(path.name, got, f"one of {', '.join(hands)}, which the body has")
    steps = int(np.floor(path.duration_s / step_s + 1e-6))
    if steps < 4:
        raise InputError(path.name, f"{path.duration_s:.3g} s", f"at least {4 * step_s:g} s")
    first = round(WARM_UP_S / step_s)
    rows = np.arange(first + steps + 1 + LEAD_STEPS, dtype=np.float64)
    times_s: FloatArray = np.asarray((rows - first) * step_s)
    clock = path.times_s - path.times_s[0]
    shape = (len(times_s), len(hands), 3)
    places, velocities, axes = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    for hand in np.flatnonzero(followed):
        poses = path.hands[hands[hand]]
        points = placement.places(poses)
        places[:, hand] = _at(clock, points, times_s)
        before, after = (_at(clock, points, times_s + d) for d in (-_SLOPE_S, _SLOPE_S))
        velocities[:, hand] = (after - before) / (2.0 * _SLOPE_S)
        if pointed and path.turned:
            vectors = _at(clock, _forward(placement.turns(poses)), times_s)
            axes[:, hand] = np.asarray(
                vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-9)
            )
    return Wanted(hands, followed, times_s, places, velocities, axes, first)


def follow(
    users: UserBatch,
    layer: MotorPolicy,
    wanted: Wanted,
    *,
    many: Callable[[int], UserBatch] | None = None,
    seed: int = 1,
    on_progress: Callable[[float], None] = lambda share: None,
) -> Followed:
    """Track a recording with a body: by its motor layer, then by trajectory optimisation.

    Plans (:class:`~sim2vr_harness.tools.track.trajectory_optimisation.Refinement`) start from the
    motor layer's actions. The result is the pass with the least mean error.

    Args:
        users: one body.
        layer: of that body.
        wanted: the reference trajectories.
        many: makes N copies of the body for perturbations; None: no optimisation.
        seed: of the body's first activations.

    Raises:
        InputError: the simulation of the body broke.
    """
    start = posture_at(layer, wanted.places[0], wanted.axes[0], wanted.followed, seed)
    follower = _Follower(users, layer, wanted, start, seed)
    goes = 1 + (0 if many is None else _REFINED_TAKES)

    def tell(done: int, takes: int) -> Callable[[float], None]:
        return lambda share: on_progress((done + takes * share) / goes)

    found = [follower.go(tell(0, 1))]
    if many is not None:
        found.append(follower.go(tell(1, _REFINED_TAKES), follower.refinement(many)))
    best = min(found, key=lambda went: went.missed_m)
    return replace(best.followed, passes=tuple(went.error for went in found))


@dataclass(frozen=True)
class _Went:
    """Result of one tracking pass.

    Attributes:
        missed_m: mean error, including the direction of the hands if it is tracked.
        followed: motion of the body.
    """

    missed_m: float
    followed: Followed

    @property
    def error(self) -> Pass:
        """Return the tracking error of the recorded hands."""
        errors = self.followed.errors_m[:, self.followed.wanted.followed]
        return Pass(float(np.median(errors)), float(np.quantile(errors, 0.95)))


@dataclass(frozen=True)
class _Follower:
    """A body that tracks a recording; fields as the arguments of :func:`follow`, and a posture."""

    users: UserBatch
    layer: MotorPolicy
    wanted: Wanted
    start: FloatArray
    seed: int

    def go(
        self,
        on_progress: Callable[[float], None],
        refinement: Refinement | None = None,
    ) -> _Went:
        """Follow once.

        Raises:
            InputError: the simulation of the body broke.
        """
        users, wanted = self.users, self.wanted
        users.reset([0], [np.random.default_rng([self.seed, 77])], [self.start])
        record = _Record(users, wanted)
        for step in range(wanted.steps):
            if step == wanted.first:
                users.effort.reset([0])  # fatigue counts from the recording's beginning
            if step % 20 == 0:
                on_progress(step / wanted.steps)
            if refinement is not None and step >= wanted.first - AHEAD:
                actions = refinement.action(users, step)
            else:
                actions = _actions(self.layer, users, wanted, step)
            users.step(actions, pose_samples=POSE_SAMPLES)
            if users.diverged[0]:
                got = f"a simulation that broke at {wanted.times_s[step]:.2f} s"
                raise InputError("RECORDING", got, "movement that the body can follow")
            record.take(step)
        missed_m = float(np.mean(record.missed))
        return _Went(missed_m, record.followed(self.layer.step_s))

    def refinement(self, many: Callable[[int], UserBatch]) -> Refinement:
        """Return the trajectory optimisation that starts from the motor layer's actions."""
        return Refinement(
            many,
            lambda bodies, step: _actions(self.layer, bodies, self.wanted, step),
            lambda bodies, step: _misses(bodies, self.wanted, step),
            self.wanted.steps,
        )


class _Record:
    """Recorder of a pass: the hands from now on, the rest from the recording's beginning."""

    def __init__(self, users: UserBatch, wanted: Wanted) -> None:
        self._users, self._wanted = users, wanted
        self._source = BodySource(users)
        self.places = [self._hands()]
        self.missed: list[Any] = []
        self._rows: list[Any] = []
        self._kept: dict[str, list[Any]] = {k: [] for k in ("effort", "qpos", "act", "fatigued")}
        self._samples: dict[str, tuple[list[Any], list[Any]]] = {n: ([], []) for n in wanted.hands}

    def _hands(self) -> FloatArray:
        return np.stack([self._users.device_poses(name)[0][0] for name in self._wanted.hands])

    def take(self, step: int) -> None:
        """Record the users' state after a step."""
        users = self._users
        self.places.append(self._hands())
        if step < self._wanted.first:
            return
        self.missed.append(np.linalg.norm(_misses(users, self._wanted, step)))
        self._rows.append(self._source.take()[0])
        self._kept["effort"].append(users.effort_cost[0])
        self._kept["qpos"].append(users.qpos[0])
        self._kept["act"].append(users.act[0])
        if "MF" in (state := users.effort.state_dict()):
            self._kept["fatigued"].append(state["MF"][0, : users.muscle_count])
        for name, (positions, turns) in self._samples.items():
            for sample in range(POSE_SAMPLES):
                position, turn = users.device_poses(name, sample)
                positions.append(position[0])
                turns.append(turn[0])

    def followed(self, step_s: float) -> Followed:
        """Return all of it, for user steps of this duration."""
        kept, steps = {name: np.array(rows) for name, rows in self._kept.items()}, len(self._rows)
        return Followed(
            wanted=self._wanted,
            places=np.array(self.places)[self._wanted.first :],
            columns=tuple(self._source.columns),
            values=np.array(self._rows),
            effort=kept["effort"],
            angles=kept["qpos"][:, self._users.body.qpos_independent],
            qpos=kept["qpos"],
            activations=kept["act"].reshape(steps, -1),
            fatigued=kept["fatigued"] if len(kept["fatigued"]) else None,
            sampled_s=(np.arange(steps * POSE_SAMPLES) + 1) * step_s / POSE_SAMPLES,
            sampled={name: (np.array(p), np.array(t)) for name, (p, t) in self._samples.items()},
            passes=(),
        )


def _actions(layer: MotorPolicy, users: UserBatch, wanted: Wanted, step: int) -> FloatArray:
    """Return the layer's actions (N, A) for the reference ``LEAD_STEPS`` steps from now."""
    row, shape = step + LEAD_STEPS, (users.n, len(wanted.hands))
    goals = MotorGoals.none(*shape)
    goals.place = _for_each(wanted.places[row], users.n)
    goals.velocity = _for_each(wanted.velocities[row], users.n)
    goals.left_s = torch.full(shape, LEAD_STEPS * layer.step_s)
    goals.axis = _for_each(wanted.axes[row], users.n)
    goals.active = _for_each(wanted.followed, users.n)
    return np.asarray(layer.act(users, goals), dtype=np.float64)


def _for_each(values: NDArray[Any], n: int) -> torch.Tensor:
    return torch.from_numpy(np.repeat(values[None], n, 0)).float()


def _misses(users: UserBatch, wanted: Wanted, step: int) -> FloatArray:
    """Return the errors (N, E) of the hands after a step, m.

    There are three numbers for each tracked hand, and three more if its direction is tracked: the
    error of a point ``_LEVER_M`` ahead of it.
    """
    parts = []
    for hand in np.flatnonzero(wanted.followed):
        place, turn = users.device_poses(wanted.hands[hand])
        parts.append(place - wanted.places[step + 1, hand])
        if (axis := wanted.axes[step + 1, hand]).any():
            parts.append(_LEVER_M * (_forward(turn) - axis))
    return np.concatenate(parts, 1)


def _at(clock: FloatArray, values: FloatArray, times_s: FloatArray) -> FloatArray:
    """(J, 3) values (N, 3) at times, between moments in proportion; before and after as there."""
    return np.stack([np.interp(times_s, clock, column) for column in values.T], axis=1)


def _forward(quats: FloatArray) -> FloatArray:
    """(N, 3) x axes of rotations w x y z."""
    w, x, y, z = quats.T
    return np.stack(
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)], axis=1
    )
