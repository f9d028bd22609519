"""Exertion as people rate it: endurance times and two measures of arm fatigue."""

from sim2vr_harness.users.exertion.arms import Arm, ArmDynamics, ArmLoad, arms_of
from sim2vr_harness.users.exertion.models import (
    ConsumedEnduranceMeter,
    NicerMeter,
    Strength,
    consumed_endurance_time,
    endurance_time,
    fatigue_endurance_time,
    nicer_correction,
)

__all__ = [
    "Arm",
    "ArmDynamics",
    "ArmLoad",
    "ConsumedEnduranceMeter",
    "NicerMeter",
    "Strength",
    "arms_of",
    "consumed_endurance_time",
    "endurance_time",
    "fatigue_endurance_time",
    "nicer_correction",
]
