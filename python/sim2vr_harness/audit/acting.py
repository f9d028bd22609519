"""Act it out: a person's muscles and trunk bring the hand, or its ray, to a place."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.audit.judging import Judged
from sim2vr_harness.audit.population import Subject
from sim2vr_harness.audit.postures import BALANCE
from sim2vr_harness.audit.reaching import MIRROR, Crowd
from sim2vr_harness.audit.targets import Target
from sim2vr_harness.users import UserBatch
from sim2vr_harness.users.kinematics.forward import rotation_matrix
from sim2vr_harness.users.kinematics.posture_controller import DeviceRay, PostureController

FloatArray = NDArray[np.float64]
Watch = Callable[[FloatArray, FloatArray], None]

NEAR_DEG = 1.0
_SETTLED = 3
"""User steps in a row that the hand has to be near."""
_DEVICE = "controller_right"
_SECONDS = 6.0
"""Of an attempt, at most."""
_IDLE_S, _NEARER = 1.5, 0.01
"""Time and proportion: an attempt ends when the error has decreased by less within this time."""


@dataclass(frozen=True)
class Acted:
    """Outcome of a simulated reach.

    Attributes:
        seconds: Time until the hand arrived, over all attempts; None: it did not arrive.
        attempts: Number of attempts.
        gap: Least distance, m; for a ray the least angle, degrees.
    """

    seconds: float | None
    attempts: int
    gap: float

    @property
    def done(self) -> bool:
        """Return whether the hand arrived."""
        return self.seconds is not None


class Actor:
    """A person's body in motion.

    Args:
        subject: The person.
        seed: Of the posture in which attempts begin.
        watch: Receives posture (nq,) and activations (M,) after each user step.
    """

    def __init__(self, subject: Subject, seed: int = 1, watch: Watch | None = None) -> None:
        self._users = UserBatch(subject.body, 1, threads=1)
        self._controller = PostureController(subject.body, _DEVICE)
        self._seed, self._watch = seed, watch

    def act(
        self,
        place: FloatArray,
        postures: FloatArray,
        *,
        ray: DeviceRay | None = None,
        near: float | None = None,
    ) -> Acted:
        """Bring the right hand to a place, in the body's own frame, from its rest.

        The first attempts try postures that were found before, the last one searches by itself.

        Args:
            place: (3,) MuJoCo's world, m.
            postures: (C, J) of the independent joints; an attempt each.
            ray: That has to get there, not the hand.
            near: How near is enough, m or degrees.
        """
        enough = near if near is not None else BALANCE.near_m if ray is None else NEAR_DEG
        gap, steps = np.inf, 0
        for attempt, posture in enumerate([*postures, None]):
            arrived, least, passed = self._attempt(place, posture, ray, enough)
            gap, steps = min(gap, least), steps + passed
            if arrived:
                return Acted(steps * self._users.dt, attempt + 1, gap)
        return Acted(None, 1 + len(postures), gap)

    def _attempt(
        self, place: FloatArray, posture: FloatArray | None, ray: DeviceRay | None, enough: float
    ) -> tuple[bool, float, int]:
        """Return whether the hand got there, the least error, and the user steps."""
        users, controller = self._users, self._controller
        users.reset([0], [np.random.default_rng(self._seed)])
        controller.begin()
        if posture is None:
            start = controller.angles(users.qpos[0])
            posture = (
                controller.find(start, place=place)
                if ray is None
                else controller.find(start, aim_at=place, ray=ray)
            ).angles
        least, settled, nearer = np.inf, 0, 0
        errors: list[float] = []
        count, idle = round(_SECONDS / users.dt), round(_IDLE_S / users.dt)
        for step in range(count):
            positions, quats = self._users.device_poses(_DEVICE)
            if ray is None:
                error = float(np.linalg.norm(place - positions[0]))
            else:
                turn = rotation_matrix(quats[0])
                gap = place - positions[0] - turn @ ray.origin_m
                along = float(turn @ ray.direction @ gap) / max(float(np.linalg.norm(gap)), 1e-9)
                error = float(np.degrees(np.arccos(np.clip(along, -1.0, 1.0))))
            least = min(least, error)
            settled = settled + 1 if error <= enough else 0
            if settled == _SETTLED:
                return True, least, step - _SETTLED + 1
            errors.append(error)
            if step < idle or error < (1.0 - _NEARER) * errors[step - idle]:
                nearer = step
            if step - nearer >= idle:
                return False, least, step
            action = controller.towards(users.qpos[0], users.qvel[0], users.act[0], posture)
            users.step(action[None])
            if self._watch is not None:
                self._watch(users.qpos[0], users.act[0])
        return False, least, count


def act_out(
    crowd: Crowd, person: int, targets: Sequence[Target], judged: Judged
) -> list[Acted | None]:
    """Simulate a person's reaches: to all targets with the judged hand, rays with the preferred.

    The result is None for targets that need no hand, or both.

    Args:
        crowd: The persons.
        person: Number.
        targets: Of the audit.
        judged: Postures that were found; first attempts.
    """
    actor = Actor(crowd.subjects[person])
    who, mirrored = np.array([person]), np.array([crowd.subjects[person].mirrored])
    found: list[Acted | None] = []
    for column, target in enumerate(targets):
        if target.how == "look" or target.hand == "both":
            found.append(None)
            continue
        place = crowd.local(crowd.places(target, who), who, mirrored)[0]
        posture = judged.postures[person, column]
        further = posture[None] if not np.isnan(posture).any() else np.zeros((0, 0))
        if len(further) and target.how != "point":
            place = min(
                (place, place * MIRROR),
                key=lambda each: float(np.linalg.norm(each - crowd.hand(person, posture))),
            )
        ray, near = None, max(BALANCE.near_m, target.radius_m)
        if target.how == "point":
            ray, size = target.ray, np.arctan2(target.radius_m, np.linalg.norm(place))
            near = max(NEAR_DEG, float(np.degrees(size)))
        found.append(actor.act(place, further, ray=ray, near=near))
    return found
