"""Simulated users: body models with muscles, VR hardware, effort and motor noise."""

from sim2vr_harness.users.batch import UserBatch
from sim2vr_harness.users.effort import (
    ConsumedEndurance,
    CumulativeFatigue3CCr,
    EffortModel,
    MuscleState,
    Neural,
    Zero,
    list_efforts,
    make_effort,
)
from sim2vr_harness.users.noise import MotorNoise, MotorNoiseSettings
from sim2vr_harness.users.user import HEAD_10_DEG_DOWN_WXYZ, User, list_users, load_user

__all__ = [
    "HEAD_10_DEG_DOWN_WXYZ",
    "ConsumedEndurance",
    "CumulativeFatigue3CCr",
    "EffortModel",
    "MotorNoise",
    "MotorNoiseSettings",
    "MuscleState",
    "Neural",
    "User",
    "UserBatch",
    "Zero",
    "list_efforts",
    "list_users",
    "load_user",
    "make_effort",
]
