"""Scripted users: they need no training."""

from sim2vr_harness.policies.scripted.baselines import USERS, scripted_policy, with_inputs
from sim2vr_harness.policies.scripted.outcomes import StepOutcome
from sim2vr_harness.policies.scripted.player import ScriptedPolicy
from sim2vr_harness.policies.scripted.steps import Step, is_script, parse_step, read_steps

__all__ = [
    "USERS",
    "ScriptedPolicy",
    "Step",
    "StepOutcome",
    "is_script",
    "parse_step",
    "read_steps",
    "scripted_policy",
    "with_inputs",
]
