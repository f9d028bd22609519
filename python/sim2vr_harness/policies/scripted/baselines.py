"""Users without training by name: idle, random, or a script."""

from __future__ import annotations

from contextlib import closing
from typing import Any

import numpy as np

from sim2vr_harness.base.errors import unknown_name
from sim2vr_harness.client.tasks import load_task
from sim2vr_harness.envs.apps import judged
from sim2vr_harness.envs.config import EnvConfig, body_of
from sim2vr_harness.policies.protocol import FunctionPolicy, Observation, Policy
from sim2vr_harness.policies.scripted.player import (
    ScriptedPolicy,
    hand_of,
    inputs_of,
)
from sim2vr_harness.policies.scripted.steps import FORMS, is_script, read_steps

USERS = ("still", "random", *FORMS)
"""What plays without training; a script needs one user in the simulation."""

BASELINE_S = 6.0
"""How long users are idle, and then move at random, to compare with: a few targets of a game."""
_COMPARED = 8
"""Users that are idle and that move at random where doing nothing is judged."""


def scripted_policy(user: str, simulation: Any) -> Policy:
    """Return the policy of a user without training.

    Args:
        user: One of :data:`USERS`: ``still`` relaxes all muscles, so that the arms hang;
            ``random`` changes activations at random, as a policy before its training; others follow
            a script.
        simulation: Of the users; of one for a script.

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


def with_inputs(config: EnvConfig, user: str) -> EnvConfig:
    """Return the configuration with the controller inputs that a script works.

    Raises:
        InputError: The script cannot be used.
    """
    if not is_script(user):
        return config
    task = load_task(config.app.task) if judged(config.app) else None
    given, devices = config.user.inputs, body_of(config.user).devices
    needed = [
        name
        for step in read_steps(user)
        for name in inputs_of(step, task, hand_of(step, task, devices))
    ]
    inputs = tuple(dict.fromkeys([*given, *needed]))
    return config.model_copy(update={"user": config.user.model_copy(update={"inputs": inputs})})


def baseline_reward(simulation: Any, user: str, seed: int) -> tuple[float, float]:
    """Let all users play for :data:`BASELINE_S` without training.

    Args:
        simulation: Of the users; it is reset.
        user: ``still`` or ``random``.
        seed: Of rounds and actions.

    Returns:
        Mean reward of the app and mean cost of effort, both per minute.
    """
    n, rng = simulation.n, np.random.default_rng([seed, 57])
    simulation.reset(seeds=[int(rng.integers(2**31)) for _ in range(n)])
    size = simulation.action_space.shape[0]
    still = np.tile(simulation.resting_action, (n, 1))
    reward = effort = 0.0
    for _ in range(round(BASELINE_S * simulation.config.action_frequency_hz)):
        moving = user == "random"
        action = np.clip(rng.standard_normal((n, size)), -1.0, 1.0) if moving else still
        result = simulation.step(action.astype(np.float32))
        reward += float(result.game_reward.mean())
        effort += float(result.effort_cost.mean())
        simulation.renew(result)
    return reward * 60.0 / BASELINE_S, effort * 60.0 / BASELINE_S


def doing_nothing_pays(env: EnvConfig) -> str | None:
    """Return a sentence if an app pays idle users more than ones that move at random, else None.

    The cost of effort does not decide: random activation of all muscles costs more than any
    strategy that a user learns. Apps that are not of this package are not started for this: None.
    """
    from sim2vr_harness.envs.simulation import Simulation

    app = env.app
    if app.connect is not None or app.executable is not None or app.page is not None:
        return None
    blind = env.model_copy(update={"app": app.model_copy(update={"renderer": "null"})})
    with closing(Simulation(blind, _COMPARED)) as simulation:
        idle, rest = baseline_reward(simulation, "still", 1)
        moved, effort = baseline_reward(simulation, "random", 1)
    if idle <= moved:
        return None
    return (
        f"doing nothing pays: an idle user earns {idle:.2f} per minute (effort {rest:.2f}), a user "
        f"that moves at random {moved:.2f} (effort {effort:.2f})"
    )
