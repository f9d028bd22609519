"""Environments of another game or task."""

from collections.abc import Sequence
from functools import cache
from typing import Any

from sim2vr_harness.client.tasks import load_task
from sim2vr_harness.envs.apps import judged
from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.users import installed_bodies, load_body


def with_game(config: EnvConfig, game: str | None, condition: str | None = None) -> EnvConfig:
    """The configuration with another game and a condition of it; None leaves it.

    A configuration that names no body gets one that wears what the game is played with, and one
    that names no inputs those that the game reads.

    Raises:
        ValueError: the game has no such condition; names the nearest.
    """
    if game is not None and game != config.app.game:
        config = config.model_copy(update={"app": config.app.model_copy(update={"game": game})})
        facts, user = ResolvedEnv(config).facts_unasked, config.user
        changes: dict[str, Any] = {}
        if facts.inputs and "inputs" not in user.model_fields_set:
            changes["inputs"] = facts.inputs
        if "model" not in user.model_fields_set:
            changes["model"] = _body_wearing(facts.needs("right"), user.model)
        config = config.model_copy(update={"user": user.model_copy(update=changes)})
    return ResolvedEnv(config).with_condition(condition)


def with_task(config: EnvConfig) -> EnvConfig:
    """The configuration with the inputs that the app reads, and a body for its task.

    As far as the configuration does not say which itself.

    Raises:
        InputError: the task cannot be used.
    """
    user, changes = config.user, dict[str, Any]()
    if judged(config.app):
        task = load_task(config.app.task)
        inputs = tuple(task.inputs)
        if "model" not in user.model_fields_set:
            changes["model"] = _body_wearing(tuple(task.devices), user.model)
    else:
        inputs = ResolvedEnv(config).facts_unasked.inputs
    if inputs and "inputs" not in user.model_fields_set:
        changes["inputs"] = inputs
    return (
        config.model_copy(update={"user": user.model_copy(update=changes)}) if changes else config
    )


def without_training(config: EnvConfig, overrides: Sequence[str] = ()) -> EnvConfig:
    """:func:`with_task` for a user who needs no depth, which few OpenXR programs submit.

    Args:
        config: of the environment.
        overrides: ``KEY=VALUE`` that were given; channels among them stay.
    """
    vision = config.vision
    if config.app.transport == "openxr" and not any("vision.channels" in one for one in overrides):
        colours = tuple(name for name in vision.channels if name != "depth")
        vision = vision.model_copy(update={"channels": colours})
    return with_task(config.model_copy(update={"vision": vision}))


@cache
def _body_wearing(devices: tuple[str, ...], usual: str) -> str:
    """The usual body; where it cannot wear the devices, the one with the fewest muscles that can.

    The usual one, too, when no one can. Without muscles the usual effort has nothing to go by.
    """
    if set(devices) <= set(load_body(usual).devices):
        return usual
    able = {}
    for name in installed_bodies():
        body = load_body(name)
        if body.muscles and set(devices) <= set(body.devices):
            able[name] = len(body.muscles)
    return min(able, key=able.__getitem__, default=usual)
