"""Left-handers who are right-handers' mirror images, in one crowd."""

from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim2vr_harness.client import DevicePoses
from sim2vr_harness.envs import AppConfig, EnvConfig, Simulation
from sim2vr_harness.envs.app_group import mirrored_poses
from sim2vr_harness.sessions import read_sessions
from sim2vr_harness.sessions.logs import target_events
from sim2vr_harness.sessions.replay import replay_session
from sim2vr_harness.sessions.whacamole import with_clock
from sim2vr_harness.users import PeopleSettings, Population

ALIKE = {"vary": ["head_movement"], "spread": 0.0}
"""Nobody differs from the body, but for the hand."""
CELLS = [3, 4, 7, 6]
MIRRORED_CELLS = [5, 4, 7, 8]


def config(user: dict[str, Any], cells: list[int], **changes: Any) -> EnvConfig:
    options: dict[str, Any] = {
        "condition": "medium-unconstrained",
        "round_seconds": 2.5,
        "spawn_times": [0.1, 0.4, 1.2, 1.6],
        "spawn_cells": cells,
        "hammer_margin_m": 0.1,  # so that flailing hits
    }
    return EnvConfig(
        app=AppConfig(options=options),
        user={"head": "reflex", **user},  # type: ignore[arg-type]
        vision={"width": 60, "height": 40},  # type: ignore[arg-type]
        cores=1,
        **changes,
    )


def play(
    settings: EnvConfig, log_dir: Path | None = None, n: int = 1
) -> tuple[dict[str, float], list[dict[str, np.ndarray]]]:
    """The last user flails about; what the game says in the end, and what was sensed."""
    seen = []
    with closing(Simulation(settings, n, log_dir=log_dir)) as users:
        users.reset(seeds=[5] * n)
        random = np.random.default_rng(2)
        while not users.over.any():
            action = random.uniform(-1, 1, users.action_space.shape[0])
            users.step(np.tile(action, (n, 1)))
            seen.append({key: value[-1] for key, value in users.observation().items()})
        return dict(users.logs[n - 1]), seen


def test_a_left_hander_senses_what_a_right_hander_does_in_the_mirror_image() -> None:
    right, seen = play(config({"people": ALIKE}, CELLS))
    left, mirrored = play(config({"people": {**ALIKE, "left_handed": 1.0}}, MIRRORED_CELLS))
    assert right["Points"] > 0
    for key in ("Points", "Misses", "DistanceRewardSum"):
        assert left[key] == pytest.approx(right[key], abs=1e-4), key
    for mine, other in zip(mirrored, seen, strict=True):
        np.testing.assert_array_equal(mine["proprioception"], other["proprioception"])
        # Green, and depth.
        np.testing.assert_allclose(mine["vision"][1].astype(int), other["vision"][1], atol=1)
        assert np.abs(mine["vision"][0].astype(int) - other["vision"][0]).mean() < 0.5
    assert (seen[20]["vision"][1, :, ::-1] != seen[20]["vision"][1]).any(), "else it tells nothing"


def test_a_crowd_of_both_hands(tmp_path: Path) -> None:
    people = Population(PeopleSettings(left_handed=0.5))
    hands = [people.number(k).handedness for k in range(40)]
    assert 8 <= hands.count("left") <= 32
    left, right = hands.index("left"), hands.index("right")
    settings = config({"people": {"left_handed": 0.5}}, CELLS)
    alone = {}
    for number in (left, right):
        with closing(Simulation(settings, 1)) as users:
            users.reset(seeds=[3], persons=[number])
            users.step(np.zeros((1, users.action_space.shape[0])))
            alone[number] = users.observation()
    with closing(Simulation(settings, 3, log_dir=tmp_path)) as users:
        users.reset(seeds=[3, 3, 3], persons=[left, right, left])
        users.step(np.zeros((3, users.action_space.shape[0])))
        told = users.observation()
        for i, number in enumerate((left, right, left)):
            for key, value in alone[number].items():
                np.testing.assert_array_equal(told[key][i], value[0], err_msg=f"{key} of {i}")
        state = users.state_dict()
        users.step(np.full((3, users.action_space.shape[0]), 0.2))
        later = users.observation()
        users.load_state_dict(state)
        np.testing.assert_array_equal(users.observation()["vision"], told["vision"])
        users.step(np.full((3, users.action_space.shape[0]), 0.2))
        for key, value in users.observation().items():
            np.testing.assert_array_equal(value, later[key], err_msg=key)
        users.reset(seeds=[3, 3, 3], persons=[right, left, left])
        while not users.over.all():
            users.step(np.zeros((3, users.action_space.shape[0])))
    whole = [recording for recording in read_sessions(tmp_path) if len(recording) > 40]
    played = [recording.app.options.get("hand", "right") for recording in whole]
    assert sorted(played) == ["left", "left", "right"]
    for recording in whole:
        again = replay_session(with_clock(recording, closed_loop=False)).session
        assert target_events(again) == target_events(recording)


def test_poses_change_sides() -> None:
    # Turned by 90 degrees to the right about the vertical: to the left, in the mirror.
    half = np.sqrt(0.5)
    poses = DevicePoses(
        head=np.array([[0.1, 1.5, 0.2, 0.0, half, 0.0, half]]),
        right_controller=np.array([[0.3, 1.0, 0.4, half, 0.0, 0.0, half]]),
        right_inputs=np.array([[1.0, 0.0]]),
    )
    seen = mirrored_poses(poses)
    np.testing.assert_allclose(seen.head, [[-0.1, 1.5, 0.2, 0.0, -half, 0.0, half]])
    assert seen.right_controller is None
    np.testing.assert_allclose(seen.left_controller, [[-0.3, 1.0, 0.4, half, 0.0, 0.0, half]])  # type: ignore[arg-type]
    np.testing.assert_allclose(seen.left_inputs, [[1.0, 0.0]])  # type: ignore[arg-type]


def test_who_cannot_be_left_handed() -> None:
    settings = EnvConfig(
        app=AppConfig(game="sample"),
        user={"people": {"left_handed": 0.1}},  # type: ignore[arg-type]
        cores=1,
    )
    with pytest.raises(
        ValueError, match=r"left_handed: got 0.1 with the game 'sample', expected 0"
    ):
        Simulation(settings, 1)
