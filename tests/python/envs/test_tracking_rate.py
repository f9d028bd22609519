"""Several app frames per user step: the app sees the hand more often than the user acts."""

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest

from sim2vr_harness.client import DevicePoses, InProcessApp
from sim2vr_harness.client.frames import pose_to_app, position_to_mujoco, rotation_to_app
from sim2vr_harness.envs import AppConfig, EnvConfig, Simulation
from sim2vr_harness.users import UserBatch

GAME = AppConfig(options={"condition": "medium"})
CONFIG = EnvConfig(app=GAME, frames_per_step=5)

# docs/reference/games/whacamole.md: the middle area from the head, the hammer in its controller.
HEAD = np.array([0.0, 1.17, 0.0])
AREA = HEAD + np.array([0.15, -0.10, 0.40])
HAMMER_HEAD = np.array([0.0094392, 0.0393488, 0.0537127])


def actions(n: int, step: int) -> np.ndarray:
    return np.repeat(np.random.default_rng(step).uniform(-1, 1, (1, 32)), n, axis=0)


def trace(simulation: Simulation, steps: int, start: int = 0) -> list[tuple[float, bytes, int]]:
    """(reward, observation bytes, app state) of user 0, whose actions do not depend on N."""
    rows = []
    for step in range(start, start + steps):
        batch = simulation.step(actions(simulation.n, step))
        seen = b"".join(rows[0].tobytes() for rows in simulation.observation().values())
        rows.append((float(batch.reward[0]), seen, simulation.apps[0].state_hash()))
    return rows


def frame_time_ns(frame: int, rate_hz: int) -> int:
    """n times the largest binary32 below the frame period, in ns."""
    period_s = np.float32(1.0 / rate_hz)
    if float(period_s) >= 1.0 / rate_hz:
        period_s = np.nextafter(period_s, np.float32(0.0))
    return round(frame * float(period_s) * 1e9)


class BodyByHand:
    """A user's body in plain MuJoCo, from the start that a seed gives it."""

    head_pitch_deg: float | None = None

    def __init__(self, simulation: Simulation, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.round_seed = int(rng.integers(2**32))
        start = UserBatch(simulation.body, 1, threads=1)
        start.reset([0], [rng])
        self.model = simulation.body.model
        self.data = mujoco.MjData(self.model)
        self.data.qpos[:], self.data.qvel[:] = start.qpos[0], start.qvel[0]
        self.data.act[:] = start.act[0]
        mujoco.mj_forward(self.model, self.data)

    def control(self, action: np.ndarray) -> None:
        self.data.ctrl[:] = np.clip(self.data.act + action, 0.0, 1.0)

    def advance(self, substeps: int) -> None:
        mujoco.mj_step(self.model, self.data, substeps)

    def poses(self) -> DevicePoses:
        # Kinematics of the present moment, in a copy: the simulation goes on from its own.
        now = mujoco.MjData(self.model)
        now.qpos[:] = self.data.qpos
        mujoco.mj_kinematics(self.model, now)
        head, right = (
            pose_to_app(now.site(name).xpos, now.body(name).xquat)
            for name in ("headset", "controller_right")
        )
        if self.head_pitch_deg is not None:
            half = np.radians(self.head_pitch_deg) / 2.0
            head[3:] = rotation_to_app([np.cos(half), 0.0, -np.sin(half), 0.0])
        return DevicePoses(head, right)


@pytest.mark.parametrize("frames", [1, 5])
def test_equals_stepping_body_and_app_by_hand(frames: int) -> None:
    config = CONFIG.model_copy(update={"frames_per_step": frames})
    simulation = Simulation(config, 1)
    simulation.reset(seeds=[8])
    body = BodyByHand(simulation, 8)
    app = InProcessApp("whacamole", GAME.options)
    body.head_pitch_deg = app.head_request(body.round_seed)
    assert body.head_pitch_deg is not None
    app.reset(body.round_seed, body.poses())
    total = 0.0
    for step in range(12):
        body.control(actions(1, step)[0])
        events, distance, contacts = 0.0, 0.0, 0.0
        for frame in range(step * frames + 1, (step + 1) * frames + 1):
            body.advance(25 // frames)
            reply = app.step(frame_time_ns(frame, 20 * frames), body.poses())
            # Alone, a frame is worth a whole step of the distance term.
            distance += reply.log["DistanceReward"]
            contacts += reply.log["RewardUnsuccessfulContact"]
            events += reply.reward - reply.log["DistanceReward"]
        info = simulation.step(actions(1, step)).infos[0]
        assert info["game_reward"] == pytest.approx(events + distance / frames, abs=1e-6)
        total += distance / frames
        terms = {
            "DistanceReward": pytest.approx(distance / frames, abs=1e-9),
            "DistanceRewardSum": pytest.approx(total, abs=1e-9),
            "RewardUnsuccessfulContact": pytest.approx(contacts, abs=1e-9),
        }
        assert info["log"] == reply.log | terms
        np.testing.assert_array_equal(simulation.apps[0].image, app.image)
    assert total < -0.1  # some target was alive
    app.close()
    simulation.close()


def test_an_episode_depends_on_its_seed_only() -> None:
    alone = Simulation(CONFIG, 1)
    alone.reset(seeds=[5])
    expected = trace(alone, 12)
    alone.close()
    for n, threads in ((3, 1), (2, 2)):
        together = Simulation(CONFIG.model_copy(update={"cores": threads}), n)
        together.reset(seeds=[5, *range(100, 99 + n)])
        assert trace(together, 12) == expected
        together.close()


def test_save_and_load_mid_episode() -> None:
    one, two = Simulation(CONFIG, 2), Simulation(CONFIG, 2)
    one.reset(seeds=[1, 2])
    trace(one, 10)
    two.load_state_dict(one.state_dict())
    assert [two.logs[i] for i in range(2)] == [one.logs[i] for i in range(2)]
    assert trace(two, 15, start=10) == trace(one, 15, start=10)
    one.close()
    two.close()


def test_the_log_has_every_frame(tmp_path) -> None:
    simulation = Simulation(CONFIG, 1, log_dir=tmp_path)
    simulation.reset(seeds=[3])
    for step in range(4):
        simulation.step(actions(1, step))
    expected = pose_to_app(*simulation.users.device_poses("controller_right", 1))[0]
    simulation.close()
    rows = next(tmp_path.rglob("states.csv")).read_text().splitlines()
    column = [name.strip() for name in rows[1].split(",")].index("right_pos_x")
    states = np.array([[float(x) for x in row.split(",")] for row in rows[2:]])
    np.testing.assert_allclose(states[:, 0], np.arange(21) * 0.01, atol=1e-6)
    # The second of the last step's five.
    np.testing.assert_allclose(states[17, column : column + 3], expected[:3], atol=2e-6)


@pytest.mark.parametrize("frames", [1, 5])
def test_a_round_of_two_seconds_ends_in_the_same_step(frames: int) -> None:
    app = AppConfig(options={"condition": "easy", "round_seconds": 2.0}, renderer="null")
    simulation = Simulation(EnvConfig(app=app, frames_per_step=frames), 1)
    simulation.reset(seeds=[1])
    steps = 1
    while not simulation.step(np.zeros((1, 32))).terminated[0]:
        steps += 1
    # The step of the first frame after 2 s: frame 41 at 20 Hz, 201 at 100 Hz, 1001 at 500 Hz.
    assert steps == 41
    with pytest.raises(RuntimeError, match="reset them first"):
        simulation.step(np.zeros((1, 32)))
    simulation.close()


def with_scripted_hand(
    frames: int, hand: Callable[[float], np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> Simulation:
    """A simulation whose controller is at ``hand(t)`` (app frame, unrotated), t in s."""
    options: dict[str, Any] = {"condition": "medium", "spawn_times": [0.0], "spawn_cells": [4]}
    config = EnvConfig(app=AppConfig(options=options, renderer="null"), frames_per_step=frames)
    simulation = Simulation(config, 1)

    def device_poses(name: str, sample: int = -1) -> tuple[np.ndarray, np.ndarray]:
        end_s = 0.05 * int(simulation._steps[0])
        t = end_s if sample == -1 else end_s - 0.05 + 0.05 * (sample + 1) / frames
        position = HEAD if name == "headset" else hand(t)
        return position_to_mujoco(position)[None], np.array([[1.0, 0.0, 0.0, 0.0]])

    monkeypatch.setattr(simulation.users, "device_poses", device_poses)
    simulation.reset(seeds=[1])
    return simulation


def jump_through(t: float) -> np.ndarray:
    """The hammer's head goes from 15 cm before the target to 15 cm behind it, at 6 m/s.

    It leaves at 0.5 s and arrives at 0.55 s, both moments of the 20 Hz clock.
    """
    depth = np.clip(-0.15 + 6.0 * (t - 0.5), -0.15, 0.15)
    return AREA + np.array([0.0, 0.0, depth]) - HAMMER_HEAD


def test_five_frames_find_the_hit_that_one_frame_jumps_over(monkeypatch) -> None:
    rewards = {}
    for frames in (1, 5):
        simulation = with_scripted_hand(frames, jump_through, monkeypatch)
        infos = [simulation.step(np.zeros((1, 32))).infos[0] for _ in range(12)]
        log = infos[-1]["log"]
        rewards[frames] = [info["game_reward"] for info in infos]
        if frames == 1:
            # Hammer and target together are 13 cm deep, one frame's way is 30 cm.
            assert (log["Points"], log["Contacts"]) == (0, 0)
        else:
            # Found 3 cm before the plane, in the second frame of the way: v = 6 (1 - 0.5^2) m/s.
            assert (log["Points"], log["Contacts"]) == (1, 0)
            assert log["HitSpeed"] == pytest.approx(4.5, abs=1e-5)
        simulation.close()
    # The point is in the reward of the step that ends at 0.55 s, less some distance term.
    assert np.argmax(rewards[5]) == 10
    assert 9.8 < rewards[5][10] <= 10.0
    assert max(rewards[1]) <= 0.0
