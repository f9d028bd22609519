"""What attention crops are made of (``policies/attention_crops.py``), readable without torch."""

from __future__ import annotations

from pydantic import Field

from sim2vr_harness.base.settings import Settings, Width
from sim2vr_harness.envs.config import EnvConfig

__all__ = ["AttentionCropConfig", "check_attention"]


class AttentionCropConfig(Settings):
    """Cut-outs of ``vision``, and of ``fovea`` where there is one, encoded on their own."""

    count: int = Field(default=1, ge=1, le=64)
    """How many things are looked at, in the game's order (``ImaginedGame.glances``)."""
    vision_pixels: int = Field(default=24, ge=1, le=1024)
    """Side of the cut-out of ``vision``."""
    fovea_zoom: int = Field(default=3, ge=1, le=5)
    """How many times as large things are in ``fovea``: ``env.vision.zoom``."""
    features: Width = 96
    """Features of each crop."""


def check_attention(crops: AttentionCropConfig, recipe: str, env: EnvConfig) -> None:
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
    if "fovea" in senses and crops.fovea_zoom != env.vision.zoom:
        raise ValueError(
            f"policy.attention_crops.fovea_zoom: got {crops.fovea_zoom}, expected "
            f"env.vision.zoom, {env.vision.zoom}"
        )
