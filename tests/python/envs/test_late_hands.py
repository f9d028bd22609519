"""The option hand_lag_s: apps see controllers where they were, and heads where they are."""

import numpy as np
import pytest

from sim2vr_harness.envs.config import AppConfig, EnvConfig, SenseConfig
from sim2vr_harness.envs.simulation import Simulation

STEPS = 12


def _config(**options: float) -> EnvConfig:
    app = AppConfig(game="pointing", renderer="null", options=options)
    return EnvConfig(app=app, senses=(SenseConfig(sense="proprioception"),))


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


def test_the_app_sees_the_hand_three_user_steps_late() -> None:
    now, late = Simulation(_config(), 2), Simulation(_config(hand_lag_s=0.15), 2)
    for simulation in (now, late):
        simulation.reset(seeds=[1, 2])
    here, there = _tips(now), _tips(late)
    assert np.abs(np.diff(here, axis=0)).max() > 1e-3
    # The head hardly moves, so the tip alone is late: 0.15 s are three user steps of 0.05 s.
    assert there[3:] == pytest.approx(here[:-3], abs=1e-4)
    assert there[0] == pytest.approx(here[0], abs=1e-6)


def test_a_saved_state_holds_the_hands_past() -> None:
    config = _config(hand_lag_s=0.2)
    one, other = Simulation(config, 1), Simulation(config, 1)
    one.reset(seeds=[3])
    for _ in range(5):
        one.step(np.full((1, one.action_space.shape[0]), 0.4))
    state = one.state_dict()
    other.reset(seeds=[9])
    other.load_state_dict(state)
    assert _tips(one)[:6].tolist() == _tips(other)[:6].tolist()


@pytest.mark.parametrize("value", [-0.1, 3.0, "late", True])
def test_a_lag_that_cannot_be_is_refused(value: object) -> None:
    with pytest.raises(ValueError, match=r"hand_lag_s: got .*, expected 0 to 2 s"):
        Simulation(_config(hand_lag_s=value), 1)  # type: ignore[arg-type]
