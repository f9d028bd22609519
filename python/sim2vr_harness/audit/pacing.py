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

MODELS = ("3CC-r, shoulder", "NICER", "Consumed Endurance")
"""Models of exertion in reports; NICER decides whether a posture is held long enough."""


@dataclass(frozen=True)
class PaceSettings:
    """Settings of an arm's use at a given pace."""

    most_minutes: float = 30.0
    """Time without exhaustion after which the endurance counts as unlimited."""
    reach_s: float = 0.5
    """Duration of raising the arm before a target is held, and of lowering it afterwards."""
    step_s: float = 0.25
    """Of the simulation of fatigue."""
    hanging_deg: tuple[float, float] = (0.0, 170.0)
    """Angles of shoulder and elbow of a resting arm; its weight causes no torque at the
    shoulder."""
    path_points: int = 11
    """Number of postures of a path whose torques are computed."""


PACING = PaceSettings()


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
    rates, dt, n = FATIGUE_PRESETS["shoulder"], PACING.step_s, len(arms.share)
    tired = np.zeros(n)
    nicer, consumed = NicerMeter(n, arms.strength), ConsumedEnduranceMeter(n, arms.strength)
    minutes = np.full((len(MODELS), n), np.inf)
    minutes[0, arms.share > 1.0] = 0.0
    for step in range(round(60.0 * PACING.most_minutes / dt)):
        raised = (step * dt) % arms.cycle_s < arms.raised_s
        load = np.where(raised, arms.share, 0.0)
        failed = 1.0 - tired < load
        active = np.minimum(load, 1.0 - tired)
        faster = np.where(load > 0.0, 1.0, rates["r"])
        change = rates["fatigue"] * active - faster * rates["recovery"] * tired
        tired = np.clip(tired + dt * change, 0.0, 1.0)
        torque = np.where(raised, arms.torque, 0.0)
        shoulder = np.where(raised, arms.shoulder_deg, PACING.hanging_deg[0])
        elbow = np.where(raised, arms.elbow_deg, PACING.hanging_deg[1])
        nicer.update(torque, shoulder, elbow, dt)
        consumed.update(torque, dt)
        spent = np.stack([failed, nicer.value >= 100.0, consumed.value >= 100.0])
        now = np.array([step, step + 1, step + 1])[:, None] * dt / 60.0
        minutes = np.where(spent & ~np.isfinite(minutes), now, minutes)
        if np.isfinite(minutes).all():
            break
    return dict(zip(MODELS, minutes, strict=True))


def path_loads(
    subject: Subject, postures: Sequence[FloatArray], limitation: Limitation
) -> list[tuple[float, float]]:
    """Return mean and peak torque at the shoulder along paths between consecutive postures.

    Joints follow minimum-jerk curves of :attr:`PaceSettings.reach_s`. Torques are shares of the
    published strength in the posture in which they act.

    Args:
        subject: The participant.
        postures: (J,) each.
        limitation: Of the participant.
    """
    body, strength = subject.body, subject.shoulder(limitation)
    dynamics = ArmDynamics(body.physics_model, arms_of(body)[0])
    t = np.linspace(0.0, 1.0, PACING.path_points)
    place = 10.0 * t**3 - 15.0 * t**4 + 6.0 * t**5
    found = []
    for first, second in pairwise(postures):
        qpos = body.coupled_qpos(first + place[:, None] * (second - first))
        qvel = np.gradient(qpos, PACING.reach_s * t, axis=0)
        qacc = np.gradient(qvel, PACING.reach_s * t, axis=0)
        loads = [dynamics.load(*row) for row in zip(qpos, qvel, qacc, strict=True)]
        shares = [
            each.torque / float(strength.shoulder_torque(each.shoulder_deg, each.elbow_deg))
            for each in loads
        ]
        found.append((float(np.mean(shares)), float(np.max(shares))))
    return found
