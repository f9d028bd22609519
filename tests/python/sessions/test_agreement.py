"""The figures of a replay, worked out by hand for a handful of events."""

import numpy as np
import pytest

from sim2vr_harness.client import ClockSettings
from sim2vr_harness.sessions import AppIdentity, Session, SessionEvent
from sim2vr_harness.sessions.agreement import Agreement, agreement_of, as_json, pooled, rounds_json
from sim2vr_harness.sessions.logs import TargetEvent as Event

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


def session_of(events: tuple[Event, ...], condition: str = "medium") -> Session:
    found = []
    for each in events:
        data = {"target_id": each.target, "grid_id": each.cell}
        data |= {} if each.velocity_mps is None else {"velocity": list(each.velocity_mps)}
        found.append(SessionEvent(round(each.time_s * 1e9), f"target_{each.kind}", data))
    app = AppIdentity("game", "whacamole", condition)
    clock = ClockSettings(fixed_delta_time_s=0.014)
    times = np.array([0, 500_000_000, 3_000_000_000])
    return Session(times, np.zeros((3, 7)), events=tuple(found), app=app, clock=clock)


def agreement(predicted: tuple[Event, ...]) -> Agreement:
    return agreement_of(session_of(RECORDED), session_of(predicted))


def changed(index: int, event: Event | None) -> tuple[Event, ...]:
    events = list(RECORDED)
    if event is None:
        del events[index]
    else:
        events[index] = event
    return tuple(events)


def test_the_same_events() -> None:
    figures = as_json(agreement(RECORDED))
    for name in ("outcome_agreement", "hit_recall_50ms", "hit_precision_100ms", "same_step"):
        assert figures[name] == 1.0
    assert (figures["mean_abs_dt_s"], figures["dv_median"]) == (0.0, 0.0)
    assert (figures["targets"], figures["contacts_recorded"]) == (4, 1)
    assert agreement(RECORDED).first_divergence_s is None


def test_a_hit_one_fixed_step_late() -> None:
    late = Event(1.514, "hit", 0, 4, (0.3, 0.0, 1.4))
    part = agreement(changed(3, late))
    figures = as_json(part)
    assert figures["outcome_agreement"] == 1.0
    assert figures["hit_recall_50ms"] == 1.0
    assert figures["same_step"] == 0.5
    assert figures["mean_abs_dt_s"] == pytest.approx(0.007)
    assert figures["dv_median"] == pytest.approx(0.25)  # of 0 and |(0.3, 0, 0.4)| = 0.5
    assert part.identical == 1.0  # 14 ms apart


def test_a_hit_70_ms_early_counts_within_100_ms_only() -> None:
    part = agreement(changed(5, Event(1.83, "hit", 1, 0, V)))
    figures = as_json(part)
    assert (figures["hit_recall_50ms"], figures["hit_recall_100ms"]) == (0.5, 1.0)
    assert (figures["hit_precision_50ms"], figures["hit_precision_100ms"]) == (0.5, 1.0)
    assert part.identical == 0.0
    assert part.first_divergence_s == pytest.approx(1.33)  # from the first frame of play, 0.5 s


def test_a_miss_instead_of_a_hit() -> None:
    part = agreement(changed(3, Event(2.1, "miss", 0, 4)))
    figures = as_json(part)
    assert figures["outcome_agreement"] == 0.75
    assert (figures["hit_recall_50ms"], figures["hit_precision_50ms"]) == (0.5, 1.0)
    assert (figures["hits_recorded"], figures["hits_predicted"]) == (2, 1)
    assert part.first_divergence_s == pytest.approx(1.0)


def test_targets_alive_at_the_end_agree() -> None:
    figures = as_json(agreement((*RECORDED, Event(3.0, "hit", 3, 1, V))))
    assert figures["outcome_agreement"] == 0.75
    assert figures["hit_precision_50ms"] == pytest.approx(2 / 3)


def test_another_cell_is_another_target() -> None:
    elsewhere = tuple(
        Event(e.time_s, e.kind, e.target, 7 if e.target == 0 else e.cell, e.velocity_mps)
        for e in RECORDED
    )
    figures = as_json(agreement(elsewhere))
    assert figures["outcome_agreement"] == 0.75
    assert figures["hit_recall_50ms"] == 0.5


def test_a_missing_contact_is_a_difference() -> None:
    part = agreement(changed(4, None))
    assert part.identical == 0.0
    assert part.first_divergence_s == pytest.approx(1.1)
    assert as_json(part)["outcome_agreement"] == 1.0


def test_totals_pool_the_targets_and_split_the_kinds() -> None:
    miss = changed(3, Event(2.1, "miss", 0, 4))
    rounds = [
        (name, session_of(RECORDED, condition), agreement(predicted))
        for name, condition, predicted in (
            ("a", "medium", RECORDED),
            ("b", "medium", miss),
            ("c", "medium-unconstrained", RECORDED),
        )
    ]
    found = rounds_json(rounds, closed_loop=False)
    assert [entry["identical"] for entry in found["rounds"]] == [True, False, True]
    total = found["total"]
    assert total["outcome_agreement"] == pytest.approx(11 / 12)
    assert total["hit_recall_50ms"] == pytest.approx(5 / 6)
    assert total["constrained"]["outcome_agreement"] == pytest.approx(7 / 8)
    assert total["constrained"]["identical"] == 0.5
    assert total["unconstrained"]["identical"] == 1.0
    assert rounds_json(rounds[:2], closed_loop=False)["total"]["unconstrained"] is None


def test_nothing_to_pool() -> None:
    with pytest.raises(ValueError, match="got no rounds"):
        pooled([])
