"""Simulated users: bodies with muscles and motors, VR hardware, effort and motor noise."""

from sim2vr_harness.users.batch import UserBatch
from sim2vr_harness.users.bodies import (
    ActuatorGroup,
    Body,
    Coupling,
    EffortInputs,
    Physique,
    Plan,
    ResetOptions,
    ResetRule,
    SpecBody,
    list_bodies,
    load_body,
)
from sim2vr_harness.users.effort import (
    ConsumedEndurance,
    CumulativeFatigue3CCr,
    EffortModel,
    EffortName,
    MuscleState,
    Neural,
    Zero,
    effort_options,
    list_efforts,
    make_effort,
)
from sim2vr_harness.users.noise import MotorNoise, MotorNoiseSettings

__all__ = [
    "ActuatorGroup",
    "Body",
    "ConsumedEndurance",
    "Coupling",
    "CumulativeFatigue3CCr",
    "EffortInputs",
    "EffortModel",
    "EffortName",
    "MotorNoise",
    "MotorNoiseSettings",
    "MuscleState",
    "Neural",
    "Physique",
    "Plan",
    "ResetOptions",
    "ResetRule",
    "SpecBody",
    "UserBatch",
    "Zero",
    "effort_options",
    "list_bodies",
    "list_efforts",
    "load_body",
    "make_effort",
]
