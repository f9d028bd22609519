"""Sessions of any app beside each other: measures with numbers derived by hand."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from sim2vr_harness.cli.main import app
from sim2vr_harness.human_comparison import sources
from sim2vr_harness.human_comparison.persons import RoundMeasures, measure_session
from sim2vr_harness.human_comparison.rounds import behaviour_of_sessions
from sim2vr_harness.sessions import (
    AppIdentity,
    Controller,
    Session,
    SessionEvent,
    write_session,
)

RATE_HZ, SECONDS = 90, 20.0
AMPLITUDE_M, CYCLES_HZ = 0.2, 0.5


def swinging(amplitude_m: float = AMPLITUDE_M, still_s: float = 1.0, hits: int = 4) -> Session:
    """A right hand that swings across after a pause; every fourth second a target is hit."""
    times_s = np.arange(0.0, SECONDS, 1.0 / RATE_HZ)
    head = np.tile([0.1, 1.6, 0.2, 0.0, 0.0, 0.0, 1.0], (len(times_s), 1))
    moving = np.maximum(0.0, times_s - still_s)
    grip = head.copy()
    grip[:, :3] += np.array([0.0, -0.4, 0.5])
    grip[:, 0] += amplitude_m * np.sin(2 * np.pi * CYCLES_HZ * moving)
    left = head.copy()
    left[:, 1] -= 0.5
    events = [SessionEvent(3_000_000_000, "spawn")]
    for k in range(hits):
        events.append(SessionEvent(int((3.5 + 2 * k) * 1e9), "hit"))
        events.append(SessionEvent(int((4 + 2 * k) * 1e9), "spawn"))
    events.append(SessionEvent(int(19e9), "miss"))
    return Session(
        time_ns=np.rint(times_s * 1e9).astype(np.int64),
        head=head,
        left=Controller(left),
        right=Controller(grip),
        events=tuple(events),
        app=AppIdentity("page", "game.html"),
        seed=3,
    )


def measured(session: Session, person: str = "p") -> RoundMeasures:
    found = measure_session(session, behaviour_of_sessions("game.html", [session]), person)
    assert found is not None
    return found


def values(session: Session) -> dict[str, float]:
    return dict(measured(session).values)


def test_a_swinging_hand_has_the_numbers_of_its_sine() -> None:
    found = values(swinging())
    assert found["duration"] == pytest.approx(SECONDS - 1 / RATE_HZ)
    # 4 amplitudes a cycle, of which a grid of 20 Hz sees 0.4 % less.
    path = 4 * AMPLITUDE_M * CYCLES_HZ * 60.0
    assert found["path_per_min"] == pytest.approx(path, rel=0.02)
    top = 2 * np.pi * CYCLES_HZ * AMPLITUDE_M
    assert found["top_speed"] == pytest.approx(top, rel=0.01)
    assert found["first_movement"] == pytest.approx(1.0, abs=0.06)
    # sin of 45 of 50 %: 5 to 95 % of a sine's places lie within .988 of its amplitude.
    assert found["range_x"] == pytest.approx(2 * 0.988 * AMPLITUDE_M, rel=0.02)
    assert found["range_z"] == pytest.approx(0.0, abs=1e-9)
    away = np.linalg.norm([AMPLITUDE_M, 0.4, 0.5])
    assert found["reach_p95"] == pytest.approx(away, rel=0.01)
    assert found["wrist_share"] == pytest.approx(1.0)  # it does not turn
    assert found["other_path_per_min"] == pytest.approx(0.0, abs=1e-9)
    # Slower than 0.1 m/s, 16 % of the greatest speed, around each turn: .05 of a half cycle each.
    slow = 2 * np.arcsin(0.1 / top) / np.pi
    assert found["movement_time"] == pytest.approx(1.0 - slow, abs=0.06)
    jerk = AMPLITUDE_M * (2 * np.pi * CYCLES_HZ) ** 3 / np.sqrt(2)
    assert found["rms_jerk"] == pytest.approx(jerk, rel=0.15)  # it begins with a jerk


def test_targets_are_those_that_the_events_name() -> None:
    found = values(swinging())
    assert (found["hits"], found["misses"], found["hit_rate"]) == (4, 1, 0.8)
    assert found["tth_median"] == pytest.approx(1.5)  # 3.5 - 3, 5.5 - 4, 7.5 - 6, 9.5 - 8
    # The second target is hit before the first one: 1 s and 3 s, not 2 s twice.
    told = ((4, "spawn", 0), (5, "spawn", 1), (6, "hit", 1), (7, "hit", 0))
    events = [SessionEvent(t * 10**9, f"target_{what}", {"target_id": n}) for t, what, n in told]
    crossed = measured(replace(swinging(), events=tuple(events)))
    assert sorted(crossed.samples["tth"]) == pytest.approx([1.0, 3.0])
    # Without spawns each target comes up as the one before ends: 2 s.
    session = swinging()
    ends = tuple(event for event in session.events if event.kind != "spawn")
    assert values(replace(session, events=ends))["tth_median"] == pytest.approx(2.0)


def test_a_session_without_targets_has_no_measures_of_them(tmp_path: Path) -> None:
    for k, amplitude in enumerate((0.1, 0.2, 0.3)):
        write_session(replace(swinging(amplitude), events=()), tmp_path / "people" / f"p{k}.jsonl")
    write_session(replace(swinging(0.5), events=()), tmp_path / "user.jsonl")
    out = tmp_path / "out"
    arguments = ["compare", str(tmp_path / "user.jsonl"), "--recordings", str(tmp_path / "people")]
    ran = CliRunner().invoke(app, [*arguments, "--out", str(out), "--json"])
    assert ran.exit_code == 0, ran.output
    (user,) = json.loads((out / "comparison.json").read_text())["users"].values()
    rows = {row["measure"]: row for row in user["measures"]}
    assert not {"hits", "hit_rate", "tth_median"} & set(rows)
    assert rows["path_per_min"]["people"] == 3
    assert rows["path_per_min"]["inside"] == 0.0  # 0.5 m is outside 0.1 to 0.3 m
    assert rows["duration"]["inside"] == 1.0
    page = (out / "comparison.html").read_text()
    assert "path of the hand per minute" in page and "data:image/png;base64," in page


def test_one_person_has_no_range(tmp_path: Path) -> None:
    write_session(swinging(0.1), tmp_path / "person.jsonl")
    write_session(swinging(0.3), tmp_path / "user.jsonl")
    out = tmp_path / "out"
    arguments = ["compare", f"Mine={tmp_path / 'user.jsonl'}"]
    arguments += ["--recordings", str(tmp_path / "person.jsonl"), "--out", str(out)]
    ran = CliRunner().invoke(app, arguments)
    assert ran.exit_code == 0, ran.output
    assert "one person, who has no range" in ran.output
    rows = json.loads((out / "comparison.json").read_text())["users"]["Mine"]["measures"]
    assert all(row["inside"] is None and row["distance"] is None for row in rows)


def _must_not_play(*_: Any, **__: Any) -> None:
    raise AssertionError("it plays before it has checked the recordings")


@pytest.mark.parametrize(
    ("change", "user", "message"),
    [
        (
            {"app": AppIdentity("game", "pointing")},
            "random",
            "which does not say which condition of pointing was played, expected --condition NAME",
        ),
        (
            {"app": AppIdentity("game", "pointing", "mid")},
            "whacamole_people",
            "'whacamole_people', who plays whacamole, expected a user of pointing",
        ),
        ({"left": None, "right": None}, "random", "a session without a controller"),
    ],
)
def test_recordings_are_refused_before_anything_is_played(
    change: dict[str, Any],
    user: str,
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sources, "evaluate", _must_not_play)
    write_session(replace(swinging(), **change), tmp_path / "round.jsonl")
    arguments = ["compare", user, "--recordings", str(tmp_path / "round.jsonl")]
    ran = CliRunner().invoke(app, [*arguments, "--out", str(tmp_path / "out")])
    assert ran.exit_code != 0 and message in str(ran.exception)


def test_a_person_s_own_recording_of_a_game_is_compared(tmp_path: Path) -> None:
    condition = "keypad"
    write_session(replace(swinging(), app=AppIdentity("game", "panel")), tmp_path / "me.jsonl")
    arguments = ["compare", "random", "--recordings", str(tmp_path / "me.jsonl"), "--episodes", "1"]
    arguments += ["--condition", condition, "--out", str(tmp_path / "out")]
    ran = CliRunner().invoke(app, arguments)
    assert ran.exit_code == 0, ran.exception
    (user,) = json.loads((tmp_path / "out" / "comparison.json").read_text())["users"].values()
    assert {row["condition"] for row in user["measures"]} == {condition}
