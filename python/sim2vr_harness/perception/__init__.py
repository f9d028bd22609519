"""Senses of the simulated user, and the wrappers around them.

:data:`SENSES` and :data:`WRAPPERS` list them (``docs/reference/senses.md``).
"""

from sim2vr_harness.perception.proprioception import Proprioception
from sim2vr_harness.perception.registry import (
    SENSES,
    WRAPPERS,
    Perception,
    SenseConfig,
    SenseKind,
    Surroundings,
    check_list,
    make_sense,
)
from sim2vr_harness.perception.sense import Sense, Sensed, StepContext
from sim2vr_harness.perception.vision import CHANNELS, channel_indices, pick_channels
from sim2vr_harness.perception.wrappers import Delayed, History, Noisy, OwnDelays, Stacked

__all__ = [
    "CHANNELS",
    "SENSES",
    "WRAPPERS",
    "Delayed",
    "History",
    "Noisy",
    "OwnDelays",
    "Perception",
    "Proprioception",
    "Sense",
    "SenseConfig",
    "SenseKind",
    "Sensed",
    "Stacked",
    "StepContext",
    "Surroundings",
    "channel_indices",
    "check_list",
    "make_sense",
    "pick_channels",
]
