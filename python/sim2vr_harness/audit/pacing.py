"""Exertion at the app's pace: minutes until exhaustion with breaks, and paths between targets."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.audit.population import Limitation, Subject
from sim2vr_harness.users import FATIGUE_PRESETS
from sim2vr_harness.users.exertion import (
    ArmDynamics,
    ConsumedEnduranceMeter,
    NicerMeter,
    Strength,
    arms_of,
)

FloatArray = NDArray[np.float64]

MOST_MINUTES = 30.0
"""After so long without exhaustion the time is taken as endless."""
REACH_S = 0.5
"""The arm is raised so long before and after a target is held, as one movement takes."""
_STEP_S = 0.25
_HANGING_DEG = (0.0, 170.0)
"""Shoulder and elbow of an arm that rests; its own weight asks nothing of the shoulder."""
_POINTS = 11
"""Of a path."""


@dataclass(frozen=True)
class Paced:
    """Arms that are used at a pace, B of them.

    Attributes:
        share: (B,) activation of the shoulder's muscles while raised.
        torque: (B,) at the shoulder while raised, Nm.
        shoulder_deg, elbow_deg: (B,) posture while raised.
        strength: Of the shoulders, (B,).
        raised_s: (B,) how long the arm is raised each time.
        cycle_s: (B,) from one use to the next.
    """

    share: FloatArray
    torque: FloatArray
    shoulder_deg: FloatArray
    elbow_deg: FloatArray
    strength: Strength
    raised_s: FloatArray
    cycle_s: FloatArray


def minutes_at_pace(arms: Paced) -> dict[str, FloatArray]:
    """Return minutes until exhaustion by model, (B,) each; infinite: more than half an hour.

    In each cycle the arm is raised for some time and hangs for the rest. 3CC-r is exhausted when
    it cannot meet the load, NICER and Consumed Endurance at 100 %.
    """
    # Looft, Herkert, Frey-Law (2018), the active units following the load at once.
    rates = FATIGUE_PRESETS["shoulder"]
    tired = np.zeros(len(arms.share))
    found = np.where(arms.share > 1.0, 0.0, np.inf)
    for step in _steps():
        load = np.where(_raised(arms, step), arms.share, 0.0)
        spent = (1.0 - tired < load) & ~np.isfinite(found)
        found[spent] = step * _STEP_S / 60.0
        if np.isfinite(found).all():
            break
        active = np.minimum(load, 1.0 - tired)
        faster = np.where(load > 0.0, 1.0, rates["r"])
        change = rates["fatigue"] * active - faster * rates["recovery"] * tired
        tired = np.clip(tired + _STEP_S * change, 0.0, 1.0)
    return {
        "3CC-r, shoulder": found,
        **_meters(arms),
    }


def _raised(arms: Paced, step: int) -> NDArray[np.bool_]:
    """(B,) whether the arm is raised in a time step."""
    return np.asarray((step * _STEP_S) % arms.cycle_s < arms.raised_s)


def _steps() -> range:
    return range(round(60.0 * MOST_MINUTES / _STEP_S))


def _meters(arms: Paced) -> dict[str, FloatArray]:
    found = {name: np.full(len(arms.share), np.inf) for name in ("NICER", "Consumed Endurance")}
    nicer = NicerMeter(len(arms.share), arms.strength)
    consumed = ConsumedEnduranceMeter(len(arms.share), arms.strength)
    for step in _steps():
        raised = _raised(arms, step)
        torque = np.where(raised, arms.torque, 0.0)
        shoulder = np.where(raised, arms.shoulder_deg, _HANGING_DEG[0])
        elbow = np.where(raised, arms.elbow_deg, _HANGING_DEG[1])
        nicer.update(torque, shoulder, elbow, _STEP_S)
        consumed.update(torque, _STEP_S)
        for name, value in (("NICER", nicer.value), ("Consumed Endurance", consumed.value)):
            spent = (value >= 100.0) & ~np.isfinite(found[name])
            found[name][spent] = (step + 1) * _STEP_S / 60.0
    return found


def path_loads(
    subject: Subject, postures: Sequence[FloatArray], limitation: Limitation
) -> list[tuple[float, float]]:
    """Return mean and peak torque at the shoulder along paths between postures, each to the next.

    Joints follow minimum-jerk curves of :data:`REACH_S`. Torques are shares of the published
    strength where they act.

    Args:
        subject: Whose arm.
        postures: (J,) each.
        limitation: Of the person.
    """
    body, arm = subject.body, arms_of(subject.body)[0]
    dynamics = ArmDynamics(body.physics_model, arm)
    factor = np.asarray(subject.strength.factor) * limitation.strength
    strength = Strength(subject.strength.man, factor)
    t = np.linspace(0.0, 1.0, _POINTS)
    place = 10.0 * t**3 - 15.0 * t**4 + 6.0 * t**5
    found = []
    for first, second in pairwise(postures):
        qpos = body.coupled_qpos(first + place[:, None] * (second - first))
        qvel = np.gradient(qpos, REACH_S * t, axis=0)
        qacc = np.gradient(qvel, REACH_S * t, axis=0)
        loads = [dynamics.load(*row) for row in zip(qpos, qvel, qacc, strict=True)]
        shares = [
            each.torque / float(strength.shoulder_torque(each.shoulder_deg, each.elbow_deg))
            for each in loads
        ]
        found.append((float(np.mean(shares)), float(np.max(shares))))
    return found
