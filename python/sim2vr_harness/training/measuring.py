"""What the benchmark needs of Stable-Baselines3."""

from __future__ import annotations

from stable_baselines3.common.logger import Logger

__all__ = ["silent_logger"]


def silent_logger() -> Logger:
    """A logger that writes nothing."""
    return Logger(folder=None, output_formats=[])
