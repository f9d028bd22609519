"""The option hand_lag_s: apps see controllers where they were, and heads where they are."""

import numpy as np
import pytest

from sim2vr_harness.envs.config import AppConfig, EnvConfig, SenseConfig
from sim2vr_harness.envs.simulation import Simulation

STEPS = 12


def _config(frames: int, **options: float) -> EnvConfig:
    app = AppConfig(game="pointing", renderer="null", options=options)
    senses = (SenseConfig(sense="proprioception"),)
    return EnvConfig(app=app, senses=senses, frames_per_step=frames)


def _tips(simulation: Simulation, first: int = 0) -> np.ndarray:
    """(STEPS, N) heights of the stylus' tip above the head, from a user step on."""
    batch = simulation.apps[0].batch  # type: ignore[attr-defined]
    column = batch.privileged_names.index("tip.y_m")
    rng = np.random.default_rng(5)
    actions = rng.uniform(-1, 1, (STEPS, simulation.n, simulation.action_space.shape[0]))
    found = []
    for action in actions[first:]:
        simulation.step(action)
        found.append(batch.privileged[:, column].copy())
    return np.array(found)


@pytest.mark.parametrize("frames", [1, 5])
def test_the_app_sees_the_hand_three_user_steps_late(frames: int) -> None:
    now, late = Simulation(_config(frames), 2), Simulation(_config(frames, hand_lag_s=0.15), 2)
    for simulation in (now, late):
        simulation.reset(seeds=[1, 2])
    here, there = _tips(now), _tips(late)
    assert np.abs(np.diff(here, axis=0)).max() > 1e-3
    # The head hardly moves, so the tip alone is late: 0.15 s are three user steps of 0.05 s.
    assert there[3:] == pytest.approx(here[:-3], abs=1e-4)
    assert there[1] == pytest.approx(there[0], abs=1e-4)  # their first place fills the past
