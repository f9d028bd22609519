"""A left-handed user plays with the left hand."""

from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim2vr_harness.envs import EnvConfig
from sim2vr_harness.envs.simulation import Simulation

LEFT = {"person": {"handedness": "left"}}


def simulation(log_dir: Path | None = None, **settings: Any) -> Simulation:
    return Simulation(EnvConfig(cores=1, **settings), log_dir=log_dir)


def play(user: dict[str, Any], cells: list[float], log_dir: Path) -> dict[str, float]:
    """A user who flails about next to targets."""
    spawns = {"spawn_times": [0.1, 0.4, 1.6, 1.9], "spawn_cells": cells}
    options: dict[str, Any] = {"condition": "medium-unconstrained", "round_seconds": 3.0, **spawns}
    options["hammer_margin_m"] = 0.1  # so that flailing hits
    with closing(simulation(log_dir, user=user, app={"options": options})) as users:
        users.reset(seeds=[5])
        random = np.random.default_rng(2)
        while not users.over.all():
            users.step(random.uniform(-1, 1, (1, users.action_space.shape[0])))
        return dict(users.logs[0])


def test_a_left_handers_round_is_the_mirror_image(tmp_path: Path) -> None:
    right = play({}, [3, 4, 7, 6], tmp_path / "right")
    left = play(LEFT, [5, 4, 7, 8], tmp_path / "left")
    assert right["Points"] > 0
    for key in ("Points", "Misses", "Contacts", "DistanceRewardSum", "HammerDepthZ"):
        assert left[key] == pytest.approx(right[key], abs=1e-4), key


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({"app": {"game": "sample"}, "user": LEFT}, "controller_right, which sample is played"),
        ({"user": LEFT, "app": {"options": {"hand": "right"}}}, "expected controller_right"),
        ({"app": {"options": {"hand": "left"}}}, "expected controller_left, which whacamole with"),
    ],
)
def test_a_user_who_could_never_play_is_refused(settings: dict[str, Any], expected: str) -> None:
    with pytest.raises(ValueError, match=expected):
        simulation(**settings)


def test_with_both_controllers_the_person_decides() -> None:
    two_arms = {"model": "mobl_arms_bimanual_motor", "effort": {"model": "neural"}}
    for person, options in ({}, {}), (LEFT, {"hand": "left"}):
        with closing(simulation(user={**two_arms, **person})) as users:
            assert users.config.app.options == options
