"""Users without training by name: idle, random, or a script."""

from typing import Any

import numpy as np

from sim2vr_harness.base.errors import unknown_name
from sim2vr_harness.client.tasks import load_task
from sim2vr_harness.envs.apps import judged
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.policies.protocol import FunctionPolicy, Observation, Policy
from sim2vr_harness.policies.scripted.player import (
    ScriptedPolicy,
    hand_of,
    inputs_of,
)
from sim2vr_harness.policies.scripted.steps import FORMS, is_script, read_steps

USERS = ("still", "random", *FORMS)
"""Forms of ``--user`` for users without training."""


def scripted_policy(user: str, simulation: Any) -> Policy:
    """Return the policy of a user without training.

    Args:
        user: One of :data:`USERS`: ``still`` relaxes all muscles, so that the arms hang;
            ``random`` changes activations at random, as a policy before its training; others follow
            a script.
        simulation: Of the users.

    Raises:
        InputError: There is no such user, or the app cannot say where an object is.
    """
    if is_script(user):
        return ScriptedPolicy(simulation, read_steps(user))
    if user not in ("still", "random"):
        raise unknown_name("--user", user, USERS)
    actions = simulation.action_space.shape[0]

    def act(observation: Observation, rng: np.random.Generator | None) -> Any:
        if user == "still" or rng is None:
            return simulation.resting_action
        return np.clip(rng.standard_normal(actions), -1.0, 1.0).astype(np.float32)

    return FunctionPolicy(act)


def with_inputs(env: ResolvedEnv, user: str) -> ResolvedEnv:
    """Return the environment with the controller inputs that a script works.

    Raises:
        InputError: The script cannot be used.
    """
    if not is_script(user):
        return env
    config = env.config
    task = load_task(config.app.task) if judged(config.app) else None
    given, devices = config.user.inputs, env.body.devices
    needed = [
        name
        for step in read_steps(user)
        for name in inputs_of(step, task, hand_of(step, task, devices))
    ]
    inputs = tuple(dict.fromkeys([*given, *needed]))
    return env.changed(user=config.user.model_copy(update={"inputs": inputs}))
