"""Means over finished episodes, and what they are called in logs."""

from typing import Any

import numpy as np

from sim2vr_harness.client import GameFacts
from sim2vr_harness.runs.run_folder import metric_key


def episode_means(episodes: list[dict[str, Any]], facts: GameFacts) -> dict[str, float]:
    """Return the means of finished episodes' values, keyed as :func:`metric_key` says.

    Args:
        episodes: ``info["episode"]`` of ``SimulationVecEnv``.
        facts: What the game publishes: its shares, such as a hit rate, are ratios of means.
    """
    if not episodes:
        return {}
    means = {
        "ep_rew_mean": float(np.mean([episode["r"] for episode in episodes])),
        "ep_len_mean": float(np.mean([episode["l"] for episode in episodes])),
    }
    for key in ("game_reward", "effort_cost", "max_fatigued"):
        values = [episode[key] for episode in episodes if key in episode]
        if values:
            means[f"ep_{key}_mean"] = float(np.mean(values))
    log: dict[str, float] = {}
    for key in episodes[-1].get("log", {}):
        values = [episode["log"][key] for episode in episodes if key in episode["log"]]
        log[key] = means[f"ep_{key}_mean"] = float(np.mean(values))
    for measure in facts.scalars:
        if measure.only_if is not None and measure.rate_with is None and measure.log_key in log:
            # Episodes without the number (no hit, no hit speed) are left out, as in evaluations.
            own = [measure.value(episode.get("log", {})) for episode in episodes]
            known = [value for value in own if value is not None]
            del means[metric_key(measure)]
            if known:
                means[metric_key(measure)] = float(np.mean(known))
    for measure in facts.scalars:
        share = measure.value(log) if measure.rate_with is not None else None
        if share is not None:
            means[metric_key(measure)] = share
    return means
