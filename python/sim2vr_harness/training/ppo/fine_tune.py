"""Continued training of users: the recipe ``adapt``, and the configuration that it needs.

A user that plays one app well learns a changed app in minutes: PPO begins with the user's weights,
including its critic's, and needs some thousand further user steps. The policy's senses and actions
stay the same (:mod:`sim2vr_harness.envs.resolved`). Effort, noise and the game's options may
change.
"""

from collections.abc import Sequence
from pathlib import Path

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.envs.config import EnvConfig
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.policies.store import TrainedUser, find_user, require_contract
from sim2vr_harness.runs.config import TrainingConfig, apply_overrides, parse_config

_NOT_ITS_OWN = ("teacher", "student", "skills")
"""Of stages that it does not have."""


def adapting(
    user: TrainedUser, name: str, overrides: Sequence[str] = (), *, env: EnvConfig | None = None
) -> TrainingConfig:
    """Return the configuration to continue a trained user: its own, with the given changes.

    Args:
        user: The trained user.
        name: Its name for :func:`.find_user`.
        overrides: ``key=value`` with dotted keys, such as ``total_timesteps=60000``.
        env: Environment in which it continues; None: the one of its training.

    Raises:
        InputError: A key or value cannot be used, or the user cannot act in the environment.
    """
    tree = user.config.model_dump(mode="json", exclude=set(_NOT_ITS_OWN))
    where = str(Path(name).resolve()) if Path(name).exists() else name
    tree |= {"recipe": "adapt", "from_user": where}
    # Its critic has learned already.
    tree["ppo"]["critic_first_updates"] = 0
    if env is not None:
        tree["env"] = env.model_dump(mode="json")
    config = parse_config(apply_overrides(tree, overrides))
    _require_same(user, config)
    return config


def user_to_adapt(config: TrainingConfig) -> TrainedUser:
    """Return the user that a run of the recipe ``adapt`` begins with.

    Raises:
        InputError: There is none of that name, or it cannot act with this configuration.
    """
    assert config.from_user is not None
    user = find_user(config.from_user)
    _require_same(user, config)
    return user


def _require_same(user: TrainedUser, config: TrainingConfig) -> None:
    """Reject a configuration whose network, senses or actions differ from the user's."""
    if user.config.policy_kind == "hierarchical":
        got = f"{user.config.name!r}, whose policy is hierarchical"
        raise InputError("from_user", got, "a user whose policy goes from senses to muscles")
    require_contract(user, ResolvedEnv(config.env))
    own, wanted = user.config.policy.model_dump(), config.policy.model_dump()
    for key in wanted:
        # What vision computes in, and what noise actions began with, is no part of the weights.
        if key not in ("vision_precision", "log_std_init") and own[key] != wanted[key]:
            expected = f"{own[key]!r}: the network of a user that goes on stays as it is"
            raise InputError(f"policy.{key}", repr(wanted[key]), expected)
