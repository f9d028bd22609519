"""The script that strikes: what the hand shall do, worked out by hand, and how it plays."""

from __future__ import annotations

import numpy as np
import pytest

from sim2vr_harness.envs.config import AppConfig, EnvConfig
from sim2vr_harness.training.strokes import Strokes
from sim2vr_harness.training.teacher_config import STROKES, StrokeConfig, TeacherConfig
from sim2vr_harness.training.teacher_evaluation import evaluate_teacher

CONFIG = StrokeConfig(
    run_up_m=0.1,
    lateral_m=0.03,
    lateral_under_way_m=0.05,
    begin_m=0.04,
    follow_through_m=0.05,
    approach_per_s2=100.0,
    approach_damping_per_s=10.0,
    stroke_mps=2.0,
    stroke_per_s=20.0,
    steering_per_s2=50.0,
    greatest_mps2=40.0,
    cost_per_m=1.0,
    cost_per_s=0.5,
    cost_per_mps=0.0,
    least_life_s=0.1,
    life_s_per_m=1.0,
    posture_rad=(0.1,) * 7,
    posture_stiffness_per_s2=10.0,
    joint_damping_per_s=2.0,
)


class Fields:
    """Two users, at mid and low, with nothing around unless it is set."""

    def __init__(self) -> None:
        self.values = {"round.mid": [1.0, 0.0], "round.low": [0.0, 1.0]}

    def place(self, name: str, *metres: tuple[float, float, float]) -> None:
        for axis, values in zip("xyz", zip(*metres, strict=True), strict=True):
            self.values[f"{name}{axis}_m"] = list(values)

    def target(self, cell: int, life_s: float, *metres: tuple[float, float, float]) -> None:
        self.values[f"cell{cell}.present"] = [1.0, 1.0]
        self.values[f"cell{cell}.life_s"] = [life_s, life_s]
        self.place(f"cell{cell}.", *metres)

    def field(self, name: str) -> np.ndarray:
        return np.array(self.values.get(name, [0.0, 0.0]), np.float32)


def script(fields: Fields) -> Strokes:
    return Strokes(fields, {"round.low": CONFIG, "round.mid": CONFIG})


def test_without_a_target_the_hand_waits_where_the_game_says() -> None:
    fields = Fields()
    fields.place("aid.home_", (0.1, 0.0, 0.2), (0.0, -0.1, 0.0))
    # Half the approach's stiffness: 50 per s^2.
    np.testing.assert_allclose(
        script(fields).hand_mps2(), [[5.0, 0.0, 10.0], [0.0, -5.0, 0.0]], atol=1e-5
    )


def test_it_goes_in_front_of_a_target_and_then_through_it() -> None:
    fields = Fields()
    # Beside the target: 0.2 m to the right of where it must be, at the right distance.
    fields.target(3, 0.8, (0.2, 0.0, 0.1), (0.2, -0.1, 0.0))
    np.testing.assert_allclose(
        script(fields).hand_mps2(), [[20.0, 0.0, 0.0], [20.0, 0.0, 0.0]], atol=1e-5
    )
    # In front of it, 1 cm beside: 20 / s * 2 m/s forwards, which at low is down, and 50 * 0.01.
    fields.target(3, 0.8, (0.01, 0.0, 0.1), (0.01, -0.1, 0.0))
    np.testing.assert_allclose(
        script(fields).hand_mps2(), [[0.5, 0.0, 40.0], [0.5, -40.0, 0.0]], atol=1e-5
    )
    # Under way at 1 m/s and 3 cm behind the middle it still goes on, with 20 / s * 1 m/s.
    fields.target(3, 0.8, (0.0, 0.0, -0.03), (0.0, 0.03, 0.0))
    fields.values["hammer.vz_mps"] = [1.0, 0.0]
    fields.values["hammer.vy_mps"] = [0.0, -1.0]
    np.testing.assert_allclose(
        script(fields).hand_mps2(), [[0.0, 0.0, 20.0], [0.0, -20.0, 0.0]], atol=1e-5
    )


def test_it_prefers_what_is_near_and_in_time() -> None:
    fields = Fields()
    fields.target(0, 0.9, (0.3, 0.0, 0.1), (0.3, -0.1, 0.0))
    fields.target(1, 0.9, (-0.1, 0.0, 0.1), (-0.1, -0.1, 0.0))
    assert (script(fields).hand_mps2()[:, 0] < 0).all()
    # 0.14 m away: 0.1 s + 0.04 s are too many for the 0.12 s that it has left.
    fields.values["cell1.life_s"] = [0.12, 0.12]
    assert (script(fields).hand_mps2()[:, 0] > 0).all()


def test_joints_are_drawn_to_the_posture() -> None:
    wanted = script(Fields()).joints_radps2(np.zeros((2, 7)), np.full((2, 7), 0.5))
    # 10 / s^2 * 0.1 rad - 2 / s * 0.5 rad/s.
    np.testing.assert_allclose(wanted, np.zeros((2, 7)), atol=1e-12)


@pytest.mark.slow
def test_the_script_alone_plays_every_placement() -> None:
    class Idle:
        def act(self, observation: dict[str, np.ndarray], rng: object) -> np.ndarray:
            return np.zeros((len(observation["teacher"]), 3), np.float32)

    env = EnvConfig(app=AppConfig(options={"condition": "random", "round_seconds": 20.0}))
    scores = evaluate_teacher(Idle(), env, TeacherConfig(), rounds=3)  # type: ignore[arg-type]
    assert {score.condition for score in scores} == {"low-medium", "medium", "high-medium"}
    for score in scores:
        assert score.hit_rate > 0.3, score
    assert set(STROKES) == {"round.low", "round.mid", "round.high"}
