"""The figures of a replay, worked out by hand for a handful of events."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sim2vr_harness.client import ClockSettings
from sim2vr_harness.evaluation.replay.agreement import agreement_of, as_json, pooled
from sim2vr_harness.evaluation.replay.recordings import Event, Recording
from sim2vr_harness.evaluation.replay.replayer import Replay
from sim2vr_harness.evaluation.replay.report import ReplayReport
from sim2vr_harness.evaluation.replay.timing import Timing

V = (0.0, 0.0, 1.0)
RECORDED = (
    Event(1.0, "spawn", 0, 4),
    Event(1.2, "spawn", 1, 0),
    Event(1.4, "spawn", 2, 8),
    Event(1.5, "hit", 0, 4, V),
    Event(1.6, "contact", 1, 0, V),
    Event(1.9, "hit", 1, 0, V),
    Event(2.5, "miss", 2, 8),
    Event(2.6, "spawn", 3, 1),
)


def replay_of(predicted: tuple[Event, ...], name: str = "a", condition: str = "medium") -> Replay:
    times = np.array([0.0, 0.5, 3.0])
    pose = np.zeros((3, 7))
    recording = Recording(name, Path(name), condition, 1, times, pose, pose, RECORDED, True)
    clock = ClockSettings(fixed_delta_time_s=0.014)
    timing = Timing((times * 1e9).astype(np.int64), None, 0.0, 60.0, clock, False)
    return Replay(recording, timing, False, predicted)


def changed(index: int, event: Event | None) -> tuple[Event, ...]:
    events = list(RECORDED)
    if event is None:
        del events[index]
    else:
        events[index] = event
    return tuple(events)


def test_the_same_events() -> None:
    figures = as_json(agreement_of(replay_of(RECORDED)))
    for name in ("outcome_agreement", "hit_recall_50ms", "hit_precision_100ms", "same_step"):
        assert figures[name] == 1.0
    assert (figures["mean_abs_dt_s"], figures["dv_median"]) == (0.0, 0.0)
    assert (figures["targets"], figures["contacts_recorded"]) == (4, 1)
    assert agreement_of(replay_of(RECORDED)).first_divergence_s is None


def test_a_hit_one_fixed_step_late() -> None:
    late = Event(1.514, "hit", 0, 4, (0.3, 0.0, 1.4))
    part = agreement_of(replay_of(changed(3, late)))
    figures = as_json(part)
    assert figures["outcome_agreement"] == 1.0
    assert figures["hit_recall_50ms"] == 1.0
    assert figures["same_step"] == 0.5
    assert figures["mean_abs_dt_s"] == pytest.approx(0.007)
    assert figures["dv_median"] == pytest.approx(0.25)  # of 0 and |(0.3, 0, 0.4)| = 0.5
    assert part.identical == 1.0  # 14 ms apart


def test_a_hit_70_ms_early_counts_within_100_ms_only() -> None:
    part = agreement_of(replay_of(changed(5, Event(1.83, "hit", 1, 0, V))))
    figures = as_json(part)
    assert (figures["hit_recall_50ms"], figures["hit_recall_100ms"]) == (0.5, 1.0)
    assert (figures["hit_precision_50ms"], figures["hit_precision_100ms"]) == (0.5, 1.0)
    assert part.identical == 0.0
    assert part.first_divergence_s == pytest.approx(1.33)  # from the first frame of play, 0.5 s


def test_a_miss_instead_of_a_hit() -> None:
    part = agreement_of(replay_of(changed(3, Event(2.1, "miss", 0, 4))))
    figures = as_json(part)
    assert figures["outcome_agreement"] == 0.75
    assert (figures["hit_recall_50ms"], figures["hit_precision_50ms"]) == (0.5, 1.0)
    assert (figures["hits_recorded"], figures["hits_predicted"]) == (2, 1)
    assert part.first_divergence_s == pytest.approx(1.0)


def test_targets_alive_at_the_end_agree() -> None:
    figures = as_json(agreement_of(replay_of((*RECORDED, Event(3.0, "hit", 3, 1, V)))))
    assert figures["outcome_agreement"] == 0.75
    assert figures["hit_precision_50ms"] == pytest.approx(2 / 3)


def test_another_cell_is_another_target() -> None:
    elsewhere = tuple(
        Event(e.time_s, e.kind, e.target, 7 if e.target == 0 else e.cell, e.velocity_mps)
        for e in RECORDED
    )
    figures = as_json(agreement_of(replay_of(elsewhere)))
    assert figures["outcome_agreement"] == 0.75
    assert figures["hit_recall_50ms"] == 0.5


def test_a_missing_contact_is_a_difference() -> None:
    part = agreement_of(replay_of(changed(4, None)))
    assert part.identical == 0.0
    assert part.first_divergence_s == pytest.approx(1.1)
    assert as_json(part)["outcome_agreement"] == 1.0


def test_totals_pool_the_targets_and_split_the_kinds() -> None:
    replays = [
        replay_of(RECORDED),
        replay_of(changed(3, Event(2.1, "miss", 0, 4)), "b"),
        replay_of(RECORDED, "c", "medium-unconstrained"),
    ]
    found = ReplayReport(replays).as_json()
    assert [entry["identical"] for entry in found["rounds"]] == [True, False, True]
    total = found["total"]
    assert total["outcome_agreement"] == pytest.approx(11 / 12)
    assert total["hit_recall_50ms"] == pytest.approx(5 / 6)
    assert total["constrained"]["outcome_agreement"] == pytest.approx(7 / 8)
    assert total["constrained"]["identical"] == 0.5
    assert total["unconstrained"]["identical"] == 1.0
    assert ReplayReport(replays[:2]).as_json()["total"]["unconstrained"] is None


def test_nothing_to_pool() -> None:
    with pytest.raises(ValueError, match="got no rounds"):
        pooled([])
