"""Recorded hands that a body follows: files, frames and places by hand, and a circle."""

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.evaluation.data import read_data
from sim2vr_harness.policies.hierarchical.motor_policy import MotorGoals, MotorPolicy
from sim2vr_harness.policies.hierarchical.motor_store import motor_layer_for
from sim2vr_harness.tools.track.files import write
from sim2vr_harness.tools.track.paths import RecordedPath, read_paths
from sim2vr_harness.tools.track.postures import REACHED_M, beyond_reach_m, posture_at
from sim2vr_harness.tools.track.registration import estimated_stature_m, place
from sim2vr_harness.tools.track.tracking import Tracked, TrackingSettings, track
from sim2vr_harness.tools.track.tracking_controller import WARM_UP_S, Followed, wanted_of
from sim2vr_harness.tools.users import environment_of
from sim2vr_harness.users import Body, UserBatch
from sim2vr_harness.users.kinematics.posture_controller import PostureController

HEADER = (
    "time_s,headset_x,headset_y,headset_z,controller_right_x,controller_right_y,controller_right_z"
)
HEADSET = ["headset_x", "headset_y", "headset_z"]
UPRIGHT = (0.0, 0.0, 0.0, 1.0)


class StandIn(MotorPolicy):
    """A layer that needs no training: inverse kinematics and muscles bring the hand to its goal."""

    def __init__(self, body: Body, step_s: float) -> None:
        super().__init__(body, step_s, width=8)
        self._reacher = PostureController(body)

    def act(self, users: UserBatch, goals: MotorGoals) -> NDArray[np.float32]:
        goal = goals.place[0, 0].double().numpy() + np.array([0.0, 0.0, 0.01])
        state = users.qpos[0], users.qvel[0], users.act[0]
        start = self._reacher.angles(users.qpos[0])
        action = self._reacher.towards(
            *state, self._reacher.find(start, place=goal, nearby=True).angles
        )
        return np.asarray(action[None], dtype=np.float32)


def csv_file(folder: Path, text: str) -> Path:
    file = folder / "reach.csv"
    file.write_text(text)
    return file


def circle(seconds: float, round_s: float = 3.0, radius_m: float = 0.05) -> str:
    """The hand goes round in front of the shoulder, about a middle."""
    lines = [HEADER]
    for t in np.arange(0.0, seconds + 0.005, 0.01):
        angle = 2.0 * np.pi * t / round_s
        right, up = 0.15 + radius_m * np.cos(angle), 1.0 + radius_m * np.sin(angle)
        lines.append(f"{10.0 + t:.3f},0.0,1.2,0.0,{right:.5f},{up:.5f},0.3")
    return "\n".join(lines) + "\n"


@pytest.fixture(scope="module")
def tracked(tmp_path_factory: pytest.TempPathFactory) -> Tracked:
    file = csv_file(tmp_path_factory.mktemp("circle"), circle(2.0))
    env = environment_of("mobl_arms_wrist")
    return track(read_paths(file)[0], env, StandIn, TrackingSettings(refined=False))


# --- files ---------------------------------------------------------------------------------------


def test_a_csv_file_is_read_in_the_app_s_frame(tmp_path: Path) -> None:
    file = csv_file(
        tmp_path,
        "frame,right_x_m,right_y_m,right_z_m,time_s,head_x,head_y,head_z\n"
        "0,0.1,1.0,0.3,5.0,0,1.2,0\n1,0.2,1.0,0.3,5.5,0,1.2,0\n2,0.3,1.0,0.3,6.0,0,1.2,0\n",
    )
    (path,) = read_paths(file)
    assert path.name == "reach"
    assert path.times_s.tolist() == [5.0, 5.5, 6.0]
    assert path.duration_s == 1.0
    assert list(path.hands) == ["controller_right"]
    assert path.hands["controller_right"][1].tolist() == [0.2, 1.0, 0.3, *UPRIGHT]
    assert not path.turned
    assert path.headset is not None and path.headset[0, 1] == 1.2


def test_openxr_looks_along_minus_z(tmp_path: Path) -> None:
    """A hand 0.3 m ahead, turned by 90 degrees to the left: about +y where z points backward."""
    half = np.sqrt(0.5)
    row = f",0.1,1.0,-0.3,0,{half},0,{half}\n"
    names = ",".join(f"controller_right_{c}" for c in ("x", "y", "z", "qx", "qy", "qz", "qw"))
    text = f"time_s,{names}\n" + "".join(f"{t}{row}" for t in (0, 1, 2))
    (path,) = read_paths(csv_file(tmp_path, text), frame="openxr")
    pose = path.hands["controller_right"][0]
    # In Unity's frame ahead is +z, and turns about y go to the right.
    np.testing.assert_allclose(pose, [0.1, 1.0, 0.3, 0.0, -half, 0.0, half])
    ahead = place(path, np.zeros(3)).turns(path.hands["controller_right"])[0]
    # MuJoCo: about +z (up), to the left; w first, not less than 0.
    np.testing.assert_allclose(ahead, [half, 0.0, 0.0, half], atol=1e-12)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a,b\n1,2\n", "line 1: got 'a,b', expected a column time_s"),
        ("time_s,right_x,right_x,right_z\n", "got right_x twice"),
        ("time_s,right_x,right_y,right_z\n0,0,1,0\n1,0,1,0\n1,0,1,0\n",
         "line 4, time_s: got 1 after 1, expected a later time"),
        ("time_s,right_x,right_y,right_z\n0,0,1,0\n1,nan,1,0\n2,0,1,0\n",
         "line 3, right_x: got 'nan', expected a number"),
        (
            "time_s,right_x,right_y,right_z,right_qx,right_qy,right_qz,right_qw\n"
            "0,0,1,0,0,0,0,0\n1,0,1,0,0,0,0,1\n2,0,1,0,0,0,0,1\n",
            "got a rotation of length 0, expected a quaternion x y z w",
        ),
        ("time_s,right_x,right_y,right_z\n0,0,1,0\n1,0,1,0\n", "got 2 rows, expected at least 3"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_csv_file_is_said(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        read_paths(csv_file(tmp_path, text))
    assert message in str(caught.value)


# --- placement -----------------------------------------------------------------------------------


def path_of(
    hand: list[list[float]], head: list[float] | None, turn: tuple = UPRIGHT
) -> RecordedPath:
    rows = np.array([[*place, *UPRIGHT] for place in hand])
    heads = None if head is None else np.array([[*head, *turn]] * len(hand))
    times_s = np.arange(len(hand)) * 0.1
    return RecordedPath("hand", Path("hand.csv"), times_s, {"controller_right": rows}, heads)


def test_the_person_s_head_lies_where_the_body_s_is() -> None:
    path = path_of([[1.2, 1.4, 3.3]] * 3, [1.0, 1.6, 3.0])
    found = place(path, np.array([0.1, 0.0, 1.2]), scale=0.5, offset_m=np.array([0.0, 0.0, 0.01]))
    # 0.2 m right, 0.2 m below and 0.3 m ahead of the head, halved: x forward, y left, z up.
    hand = path.hands["controller_right"]
    np.testing.assert_allclose(found.places(hand)[0], [0.25, -0.1, 1.11])
    back = found.recorded(found.places(hand), found.turns(hand))
    np.testing.assert_allclose(back[:, :3], hand[:, :3], atol=1e-12)
    np.testing.assert_allclose(np.abs(back[:, 3:]), np.abs(hand[:, 3:]), atol=1e-12)


def test_a_person_who_faces_to_the_right_is_turned_to_the_left() -> None:
    """Head and hand look to the right (+x); ahead of the head comes to lie ahead of the body."""
    half = np.sqrt(0.5)
    path = path_of([[1.4, 1.5, 0.1]] * 3, [1.0, 1.5, 0.0], (0.0, half, 0.0, half))
    assert "looks 90 degrees to the right" in place(path, np.zeros(3)).notes[0]
    for yaw in (90.0, "head"):
        found = place(path, np.zeros(3), yaw=yaw)  # type: ignore[arg-type]
        assert found.notes == ()
        np.testing.assert_allclose(
            found.places(path.hands["controller_right"])[0], [0.4, 0.1, 0.0], atol=1e-12
        )
    turned = place(path, np.zeros(3), yaw="head").turns(path.headset)[0]  # type: ignore[arg-type]
    np.testing.assert_allclose(turned, [1.0, 0.0, 0.0, 0.0], atol=1e-12)


def test_without_a_head_the_hand_lies_where_it_usually_is() -> None:
    found = place(path_of([[5.0, 2.0, 7.0]] * 3, None), np.array([0.1, 0.0, 1.2]))
    hand = path_of([[5.0, 2.0, 7.0]], None).hands["controller_right"]
    np.testing.assert_allclose(found.places(hand)[0], [0.41, -0.14, 1.05])
    assert "no head was recorded" in found.notes[0]


def test_only_heads_of_those_who_stand_say_how_tall_they_are() -> None:
    assert estimated_stature_m(path_of([[0, 1, 0]] * 3, [0.0, 1.17, 0.0])) is None
    assert estimated_stature_m(path_of([[0, 1, 0]] * 3, None)) is None
    found = estimated_stature_m(path_of([[0, 1, 0]] * 3, [0.0, 1.5912, 0.0]))
    assert found == pytest.approx(1.70)  # 0.936 of it are the eyes' height


# --- what is wanted ------------------------------------------------------------------------------


def test_goals_run_at_the_body_s_pace() -> None:
    """0.1 m per 0.1 s to the right for 0.4 s: 1 m/s, in MuJoCo's -y; the start is held before."""
    path = path_of([[0.1 * i, 1.0, 0.3] for i in range(5)], [0.0, 1.0, 0.0])
    wanted = wanted_of(path, place(path, np.zeros(3)), ("controller_right",), 0.05)
    assert wanted.first == round(WARM_UP_S / 0.05)
    assert wanted.steps == wanted.first + 8
    np.testing.assert_allclose(wanted.places[: wanted.first, 0], [[0.3, 0.0, 0.0]] * wanted.first)
    np.testing.assert_allclose(wanted.places[wanted.first + 3, 0], [0.3, -0.15, 0.0])
    np.testing.assert_allclose(wanted.velocities[wanted.first + 3, 0], [0.0, -1.0, 0.0])
    assert not wanted.axes.any()


# --- reach ---------------------------------------------------------------------------------------


def test_the_body_begins_with_its_hand_at_the_path() -> None:
    body = environment_of("mobl_arms_wrist").body
    layer = StandIn(body, 0.05)
    place_m = np.array([[0.35, -0.2, 1.0]])
    angles = posture_at(layer, place_m, np.zeros((1, 3)), np.array([True]), seed=1)
    flat = torch.from_numpy(angles[None]).float()
    there = layer.places(flat, torch.zeros_like(flat))[0][0, 0, :3, 3].numpy()
    np.testing.assert_allclose(there, place_m[0], atol=2e-3)
    again = angles[None].repeat(2, axis=0)
    # 3 m ahead is out of reach of an arm that ends within 0.9 m of its shoulder at (0, -0.17, 1).
    places = np.stack([place_m[0], [3.0, -0.17, 1.0]])
    beyond = beyond_reach_m(body, "controller_right", places, again)
    assert beyond[0] < REACHED_M
    assert 2.1 < beyond[1] < 2.5


# --- all of it -----------------------------------------------------------------------------------


def test_a_body_follows_a_circle(tracked: Tracked) -> None:
    (hand,) = tracked.hands
    assert hand.unreachable == 0.0
    assert hand.median_m < 0.03  # of a circle with a radius of 0.05 m
    assert hand.median_m == hand.reachable_median_m
    assert len(tracked.followed.passes) == 1
    assert len(tracked.followed.values) == 40
    assert tracked.stature_m is None
    assert tracked.outcomes == {}


@pytest.mark.slow
def test_muscles_that_are_planned_do_better_with_less(tmp_path: Path) -> None:
    """A circle of 22 cm in .4 s, at 1.7 m/s: the hand is nearer to the person's, and as fast, and
    muscles work less against each other than the layer's. Cores change no bit."""
    path = read_paths(csv_file(tmp_path, circle(0.8, 0.4, 0.11)))[0]
    layer_for = partial(motor_layer_for, following=True)

    def follow(cores: int, settings: TrackingSettings) -> Followed:
        env = environment_of("mobl_arms_wrist", overrides=[f"env.cores={cores}"])
        return track(path, env, layer_for, settings).followed

    alone = follow(1, TrackingSettings(refined=False))
    planned, again = (follow(cores, TrackingSettings()) for cores in (1, 2))
    before, after = planned.passes
    assert before == alone.passes[0]
    assert after.median_m < 0.3 * before.median_m
    assert after.most_m < 0.3 * before.most_m
    assert (planned.activations**2).mean() < 0.8 * (alone.activations**2).mean()
    assert np.array_equal(planned.activations, again.activations)
    moved = np.linalg.norm(np.diff(planned.places[:, 0], axis=0), axis=1).sum()
    wanted = np.linalg.norm(np.diff(planned.targets[:, 0], axis=0), axis=1).sum()
    assert moved == pytest.approx(wanted, rel=0.05)


def test_hands_that_are_planned_point_as_asked(tmp_path: Path) -> None:
    """Held still and turned 60 degrees to the left: by itself the hand does not care."""
    half = np.radians(-60.0) / 2.0
    names = ["x", "y", "z", "qx", "qy", "qz", "qw"]
    head = ["time_s", *(f"controller_right_{name}" for name in names), *HEADSET]
    lines = [",".join(head)]
    for t in np.arange(0.0, 0.8, 0.05):
        lines.append(f"{t:.2f},0.1,1.0,0.35,0,{np.sin(half):.6f},0,{np.cos(half):.6f},0,1.2,0")
    path = read_paths(csv_file(tmp_path, "\n".join(lines) + "\n"))[0]
    layer_for = partial(motor_layer_for, following=True)
    apart = []
    for pointed in (False, True):
        env = environment_of("mobl_arms_wrist")
        followed = track(path, env, layer_for, TrackingSettings(pointed=pointed)).followed
        _, turns = followed.sampled["controller_right"]
        w, x, y, z = turns[-1]  # forward is x in MuJoCo's world, and right is -y
        ahead, left = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z)
        along = ahead * np.cos(2.0 * half) - left * np.sin(2.0 * half)
        apart.append(np.degrees(np.arccos(along)))
        assert followed.passes[-1].median_m < 0.01
    assert apart[1] < 15.0 < 25.0 < apart[0]


def test_muscles_work_and_tire(tracked: Tracked) -> None:
    loads = tracked.muscles
    assert len(loads) == len(tracked.body.muscles)
    assert [load.mean for load in loads] == sorted((load.mean for load in loads), reverse=True)
    assert 0.0 < loads[0].mean <= loads[0].most <= 1.0
    assert tracked.fatigued is not None and 0.0 < tracked.fatigued < 0.0146 * 2.0 * 1.1
    assert tracked.followed.effort.sum() > 0.0


def test_what_was_done_is_written(tracked: Tracked, tmp_path: Path) -> None:
    write([tracked], tmp_path)
    steps = read_data(tmp_path).steps("reach")
    assert len(steps) == 40
    assert steps["time_s"].iloc[-1] == pytest.approx(2.0)
    apart = np.linalg.norm(
        steps[["right_x_m", "right_y_m", "right_z_m"]].to_numpy()
        - steps[["right_wanted_x_m", "right_wanted_y_m", "right_wanted_z_m"]].to_numpy(),
        axis=1,
    )
    np.testing.assert_allclose(apart, steps["right_error_m"], atol=1e-6)
    for name in ("q_elbow_flexion", "act_DELT1", "fatigued_DELT1", "right_beyond_reach_m"):
        assert name in steps.columns
    summary = json.loads((tmp_path / "summary.json").read_text())["recordings"][0]
    assert summary["hands"][0]["median_m"] == pytest.approx(np.median(apart), abs=1e-6)
    assert read_data(tmp_path).episodes["episode"].tolist() == ["reach"]
    joints = (tmp_path / "opensim" / "reach_joints.mot").read_text()
    assert "nRows=40" in joints and "inDegrees=yes" in joints
    assert (tmp_path / "reach.png").read_bytes().startswith(b"\x89PNG")


def test_somebody_else_s_size(tmp_path: Path) -> None:
    path = read_paths(csv_file(tmp_path, circle(0.3)))[0]
    env = environment_of("mobl_arms_wrist")
    found = track(path, env, StandIn, TrackingSettings(refined=False, stature_m=1.5))
    assert found.stature_m == 1.5 and not found.estimated
    # The body's own headset is at 1.170 m, that of its 1.70 m.
    assert found.placement.at_m[2] == pytest.approx(1.170 * 1.5 / 1.7, abs=2e-3)
