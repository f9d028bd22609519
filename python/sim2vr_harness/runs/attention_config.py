"""Settings of attention crops (``policies/attention_crops.py``), readable without torch."""

from pydantic import Field

from sim2vr_harness.base.settings import Settings
from sim2vr_harness.envs.config import EnvConfig

FOVEA_ZOOM = 3
"""Magnification of ``fovea``, with which crops of 32 pixels contain whole objects."""


class AttentionCropConfig(Settings):
    """Cut-outs of ``vision``, and of ``fovea`` where there is one, encoded on their own."""

    count: int = Field(default=1, ge=1, le=64)
    """Number of crops, one for each object in the order of ``ImaginedGame.attention_targets``."""


def check_attention(recipe: str, env: EnvConfig) -> None:
    """Raise ValueError unless users of this environment can learn where to look."""
    if recipe not in ("distill", "adapt"):
        raise ValueError(
            f"policy.attention_crops: got some with recipe {recipe!r}, expected recipe 'distill', "
            "whose student learns where to look"
        )
    senses = {sense.sense: sense for sense in env.senses}
    if "vision" not in senses or senses["vision"].delay_ms:
        got = "it late" if "vision" in senses else "none"
        raise ValueError(
            f"policy.attention_crops: got {got}, expected the sense vision, not delayed"
        )
    eye = env.vision.fovea
    if "fovea" in senses and eye is not None and eye.magnification != FOVEA_ZOOM:
        raise ValueError(
            f"env.vision.fovea.magnification: got {eye.magnification:g}, expected {FOVEA_ZOOM} "
            "with policy.attention_crops and the sense fovea"
        )
