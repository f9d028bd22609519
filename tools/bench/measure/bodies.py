"""The bodies that a game can be played with, with and without a trunk that moves."""

from sim2vr_harness.envs.config import EffortConfig, EnvConfig, body_of
from sim2vr_harness.envs.games import with_hand
from sim2vr_harness.runs.config import TrainingConfig
from sim2vr_harness.users import list_bodies


def body_variants(config: TrainingConfig) -> list[tuple[str, TrainingConfig]]:
    """The configuration with every body that there is, wears what the game needs and can begin so.

    Their effort is ``neural``, which bodies with and without muscles have.

    Returns:
        Pairs of the variant's name, such as ``mobl_arms_bimanual+torso``, and its configuration.
    """
    found = []
    for name in list_bodies():
        for torso in (False, True):
            env = _with_body(config.env, name, torso)
            try:
                with_hand(env, body_of(env.user))
            except ValueError:  # not for this game, without a torso, or of a package not installed
                continue
            found.append((name + "+torso" * torso, config.model_copy(update={"env": env})))
    return found


def _with_body(env: EnvConfig, name: str, torso: bool) -> EnvConfig:
    effort = EffortConfig(model="neural")
    user = env.user.model_copy(update={"model": name, "torso": torso, "effort": effort})
    return env.model_copy(update={"user": user})
