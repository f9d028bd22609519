"""Sessions replayed in games and pages: the same events, or the first difference and its cause."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from python.sessions.sessions_made import ROOT, full_session
from sim2vr_harness.cli.main import main
from sim2vr_harness.sessions import (
    Controller,
    Session,
    SessionEvent,
    read_session,
    write_session,
)
from sim2vr_harness.sessions.replay import compare_events, replay_session
from webxr_pages import NEEDS_BROWSER, PAGES

ROUND = ROOT / "tests" / "data" / "whacamole_round"


def test_a_logged_round_comes_again_event_by_event() -> None:
    done = replay_session(read_session(ROUND))
    found = done.comparison
    # 18 spawns, 7 hits, 8 misses, 4 contacts, the plane and the grid; see the log.
    assert (found.recorded, found.again, found.same_frame, found.extra) == (39, 39, 39, 0)
    assert found.same and found.first is None and done.finished
    assert (done.values["Points"], done.values["Misses"]) == (7, 8)


def test_another_seed_shows_where_and_why() -> None:
    session = replace(read_session(ROUND), seed=None)
    found = replay_session(session).comparison
    assert not found.same and found.first is not None
    assert found.first.cause.startswith("seed: the session has none")


def shifted(session: Session, by_ns: Any) -> Session:
    events = [replace(event, time_ns=int(event.time_ns + by_ns(event))) for event in session.events]
    return replace(session, events=tuple(events))


def ticks() -> Session:
    events = tuple(SessionEvent(50_000_000 * k, "tick", {"number": k}) for k in range(1, 11))
    return replace(full_session(), events=events)


def test_causes_by_hand() -> None:
    session = ticks()
    assert compare_events(session, session).same
    late = compare_events(session, shifted(session, lambda event: 30_000_000))
    assert late.again == 10 and late.same_frame == 0 and late.first is not None
    assert late.first.text == "tick (number 1) came 30 ms later"
    assert "all events come 30 ms later" in late.first.cause
    drift = compare_events(session, shifted(session, lambda event: 0.15 * event.time_ns))
    assert drift.first is not None
    assert "events come 9000 ms per minute later" in drift.first.cause
    fewer = compare_events(session, replace(session, events=session.events[:4]))
    assert (fewer.again, fewer.extra) == (4, 0) and fewer.first is not None
    assert fewer.first.text == "tick (number 5) did not come"
    assert fewer.first.time_s == pytest.approx(0.25)
    times = session.time_ns.copy()
    times[10:] += 50_000_000
    gap = replace(session, time_ns=times)
    found = compare_events(gap, replace(gap, events=session.events[:4])).first
    assert found is not None and found.cause.startswith("frame rate: a frame before it lasts 64 ms")


def test_strict_is_the_exit_status(tmp_path: Path, capsys: Any) -> None:
    session = read_session(ROUND)
    for name, each, status in (("same", session, 0), ("other", replace(session, seed=3), 1)):
        write_session(each, tmp_path / f"{name}.jsonl")
        with pytest.raises(SystemExit) as exit_:
            main(["replay", str(tmp_path / f"{name}.jsonl"), "--closed", "--strict", "--json"])
        (found,) = json.loads(capsys.readouterr().out)["rounds"]
        assert int(exit_.value.code or 0) == status
        assert found["identical"] == (status == 0)


def sweep() -> Session:
    """The right hand in steps of .1 m through the room in which touch.html puts its ball."""
    grid = np.meshgrid(*(np.arange(low, high, 0.1) for low, high in RANGES), indexing="ij")
    places = np.tile(np.stack(grid, axis=-1).reshape(-1, 3), (2, 1))
    grip = np.column_stack([places, np.tile([0.0, 0.0, 0.0, 1.0], (len(places), 1))])
    head = np.tile([0.0, 1.6, 0.0, 0.0, 0.0, 0.0, 1.0], (len(places), 1))
    times = np.arange(len(places)) * 13_888_889
    return Session(times, head, right=Controller(grip), seed=5)


RANGES = ((-0.3, 0.31), (0.9, 1.41), (0.3, 0.51))
PAGE = {"transport": "webxr", "page": str(PAGES / "touch.html")}


@NEEDS_BROWSER
def test_a_page_does_the_same_again_and_another_seed_does_not() -> None:
    first = replay_session(sweep(), app=PAGE).session
    # Every place of the ball is within .1 m of the sweep.
    assert [event.kind for event in first.events].count("haptic") >= 1
    assert first.events[0].data["amplitude"] == pytest.approx(0.7)
    again = replay_session(first, app=PAGE)
    assert again.comparison.same
    assert again.session.events == first.events
    other = replay_session(replace(first, seed=6), app=PAGE).comparison
    assert not other.same and other.first is not None
