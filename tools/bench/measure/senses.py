"""Variants of whole users with one more sense, or one thing done to a sense: what each costs."""

from typing import Any

from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.perception import SENSES, WRAPPERS
from sim2vr_harness.runs.config import TrainingConfig

_NEEDS: dict[str, dict[str, Any]] = {
    "fovea": {"vision": {"fovea": {}}},
    "fovea_depth": {"vision": {"fovea": {}}},
    "fingers": {"user": {"inputs": ["right.trigger"]}},
    "gaze": {"vision": {"fovea": {"gaze": "moves"}}},
    "head": {"user": {"head": "reflex"}},
}
"""What else must be there for a sense to have something to sense."""

_WRAPPED = {"delay_ms": 100.0, "noise": 0.05, "history_s": 0.2, "stack_s": 0.2}
"""What is done to the picture, the largest of the senses."""

_PICTURES: dict[str, dict[str, Any]] = {"eyes=2": {"eyes": 2}}


def sense_variants(config: TrainingConfig) -> list[tuple[str, TrainingConfig]]:
    """The configuration with each sense it does not have, each wrapper and each image option.

    Returns:
        Pairs of the variant's name and its configuration. ``sense=fingers`` and ``sense=gaze``
        have further actions and ``sense=head`` a head that moves, so that their users move
        otherwise.
    """
    env = config.env
    senses = [sense.model_dump() for sense in env.senses]
    had = {sense.sense for sense in env.senses}
    found = [
        (f"sense={name}", {"senses": [*senses, {"sense": name}], **_NEEDS.get(name, {})})
        for name in SENSES
        if name not in had
    ]
    for wrapper in WRAPPERS if "vision" in had else ():
        wrapped = [
            {**sense, wrapper: _WRAPPED[wrapper]} if sense["sense"] == "vision" else sense
            for sense in senses
        ]
        found.append((f"vision {wrapper}={_WRAPPED[wrapper]:g}", {"senses": wrapped}))
    found += [(f"vision {name}", {"vision": change}) for name, change in _PICTURES.items()]
    return [(name, config.model_copy(update={"env": _changed(env, x)})) for name, x in found]


def _changed(env: EnvConfig, change: dict[str, Any]) -> EnvConfig:
    settings = env.model_dump()
    for key, value in change.items():
        settings[key] = settings[key] | value if isinstance(value, dict) else value
    return EnvConfig.model_validate(settings)
