"""Sessions written and read again, in every format."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from python.sessions.sessions_made import FRAMES, ROOT, full_session
from sim2vr_harness.sessions import Session, read_session, write_session
from sim2vr_harness.sessions.frames import aim_of, composed, grip_of, relative, to_webxr
from sim2vr_harness.sessions.privacy import personal_content, stripped

ROUND = ROOT / "tests" / "data" / "whacamole_round"


def assert_same(found: Session, session: Session, parts: tuple[str, ...], apart: float) -> None:
    np.testing.assert_array_equal(found.time_ns, session.time_ns)
    np.testing.assert_allclose(found.head, session.head, atol=apart, rtol=0)
    assert found.controllers.keys() == session.controllers.keys()
    for side, one in session.controllers.items():
        for part in parts:
            expected, got = getattr(one, part), getattr(found.controllers[side], part)
            assert (expected is None) == (got is None), (side, part)
            if expected is not None:
                np.testing.assert_allclose(got, expected, atol=apart, rtol=0)


@pytest.mark.parametrize("name", ["a.jsonl", "a.jsonl.gz"])
def test_the_session_format_keeps_every_bit(name: str, tmp_path: Path) -> None:
    session = full_session()
    write_session(session, tmp_path / name)
    found = read_session(tmp_path / name)
    assert_same(found, session, ("grip", "aim", "inputs"), 0.0)
    assert_same(found, session, ("joints",), 0.0)
    for field in ("events", "app", "seed", "clock", "headset", "rate_hz", "person", "rounding_m"):
        assert getattr(found, field) == getattr(session, field), field
    assert found.notes == ()


@pytest.mark.parametrize(
    ("name", "parts", "apart"),
    [
        ("a.json", ("grip", "aim", "inputs", "joints"), 1e-5),
        ("a.csv", ("grip", "aim", "inputs"), 0.0),
        ("log", ("grip",), 1e-8),
    ],
)
def test_other_formats_keep_what_they_can_hold(
    name: str, parts: tuple[str, ...], apart: float, tmp_path: Path
) -> None:
    session = full_session()
    write_session(session, tmp_path / name)
    found = read_session(tmp_path / name)
    if name == "log":  # in seconds of nine digits
        assert np.abs(found.time_ns - session.time_ns).max() <= 100  # on the lockstep grid
        found = replace(found, time_ns=session.time_ns)
        assert [event.kind for event in found.events] == ["haptic", "value", "end"]
        assert found.seed == 7
    assert_same(found, session, parts, apart)


def test_a_controller_that_is_away_is_away_in_every_format(tmp_path: Path) -> None:
    session = full_session()
    assert session.right is not None
    away = session.right.map(lambda rows: np.where(_column(rows) < 10, np.nan, rows))
    session = replace(session, right=away)
    for name in ("a.jsonl", "a.json", "a.csv"):
        write_session(session, tmp_path / name)
        found = read_session(tmp_path / name)
        assert found.right is not None
        assert found.right.tracked.tolist() == [False] * 10 + [True] * (FRAMES - 10), name
        assert "the right controller is not tracked in 10 of 40 frames" in found.notes
    # The app receives the first pose that the controller will have.
    devices = session.devices()
    np.testing.assert_array_equal(devices.right_controller[0], session.right.grip[10])


def _column(rows: np.ndarray) -> np.ndarray:
    return np.arange(len(rows)).reshape(-1, *[1] * (rows.ndim - 1))


def test_our_logs_are_read_with_options_and_events() -> None:
    session = read_session(ROUND)
    assert (session.app.name, session.app.condition, session.seed) == ("whacamole", "hard", 42)
    assert session.app.options == {"round_seconds": 6.0}
    assert session.frame_rate_hz == pytest.approx(20, rel=1e-5)
    kinds = [event.kind for event in session.events]
    assert [kinds.count(f"target_{kind}") for kind in ("spawn", "hit", "miss", "contact")] == [
        18, 7, 8, 4,
    ]  # fmt: skip
    hit = next(event for event in session.events if event.kind == "target_hit")
    assert hit.data == {
        "target_id": 0,
        "grid_id": 8,
        "velocity": [0.34425142, 0.66905236, 2.1885223],
    }


def test_webxr_s_frame_by_hand() -> None:
    # Forward is +z here and -z there; a turn to the right is positive about y here, negative there.
    quarter = np.sqrt(0.5)
    found = to_webxr(np.array([1.0, 2.0, 3.0, 0.0, quarter, 0.0, quarter]))
    np.testing.assert_allclose(found, [1.0, 2.0, -3.0, 0.0, -quarter, 0.0, quarter])


def test_the_ray_points_60_degrees_down() -> None:
    grip = np.array([0.1, 1.0, 0.2, 0.0, 0.0, 0.0, 1.0])
    ray = aim_of(grip)
    forward = composed(ray, np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]))[:3] - ray[:3]
    np.testing.assert_allclose(forward, [0.0, -np.sqrt(0.75), 0.5], atol=1e-12)
    np.testing.assert_allclose(grip_of(ray), grip, atol=1e-12)
    np.testing.assert_allclose(composed(grip, relative(grip, ray)), ray, atol=1e-12)


def test_strip_takes_joints_name_and_height() -> None:
    session = full_session()
    bare = stripped(session)
    assert bare.person == ""
    assert np.median(bare.head[:, 1]) == pytest.approx(1.6)
    assert bare.right is not None and session.right is not None
    assert bare.right.joints is None
    # The hand stays where it was, seen from the head.
    apart = session.right.grip[:, :3] - session.head[:, :3]
    np.testing.assert_allclose(bare.right.grip[:, :3] - bare.head[:, :3], apart, atol=1e-12)
    told, left = " ".join(personal_content(session)), " ".join(personal_content(bare))
    assert "hand joints" in told and "'p1'" in told
    assert "hand joints" not in left and "p1" not in left and "removed" in left
