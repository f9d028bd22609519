"""The figures of a replay, worked out by hand for a handful of events."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from sim2vr_harness.client import ClockSettings
from sim2vr_harness.sessions import AppIdentity, Session, SessionEvent
from sim2vr_harness.sessions.agreement import Agreement, agreement_of, as_json, rounds_json
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


def changed(index: int, *events: Event) -> tuple[Event, ...]:
    """The recorded events with others in place of one."""
    return (*RECORDED[:index], *events, *RECORDED[index + 1 :])


SAME = {
    "outcome_agreement": 1.0, "hit_recall_50ms": 1.0, "hit_precision_50ms": 1.0,
    "hit_recall_100ms": 1.0, "hit_precision_100ms": 1.0, "same_step": 1.0, "mean_abs_dt_s": 0.0,
    "dv_median": 0.0, "targets": 4, "contacts_recorded": 1,
}  # fmt: skip


@pytest.mark.parametrize(
    ("predicted", "figures", "identical", "first_divergence_s"),
    [
        (RECORDED, SAME, 1.0, None),
        (  # a fixed step late, which is 14 ms; dv is the median of 0 and |(0.3, 0, 0.4)|
            changed(3, Event(1.514, "hit", 0, 4, (0.3, 0.0, 1.4))),
            SAME | {"same_step": 0.5, "mean_abs_dt_s": 0.007, "dv_median": 0.25},
            1.0,
            None,
        ),
        (  # 70 ms early counts within 100 ms only; times from the first frame of play, 0.5 s
            changed(5, Event(1.83, "hit", 1, 0, V)),
            {"hit_recall_50ms": 0.5, "hit_precision_50ms": 0.5, "hit_recall_100ms": 1.0},
            0.0,
            1.33,
        ),
        (
            changed(3, Event(2.1, "miss", 0, 4)),
            {"outcome_agreement": 0.75, "hit_recall_50ms": 0.5, "hit_precision_50ms": 1.0},
            0.0,
            1.0,
        ),
        (  # a target that is alive at the end of the recording
            (*RECORDED, Event(3.0, "hit", 3, 1, V)),
            {"outcome_agreement": 0.75, "hit_precision_50ms": 2 / 3},
            0.0,
            2.5,
        ),
        (changed(4), {"outcome_agreement": 1.0}, 0.0, 1.1),  # a contact is missing
    ],
)
def test_figures_by_hand(
    predicted: Any, figures: dict[str, float], identical: float, first_divergence_s: float | None
) -> None:
    part = agreement(predicted)
    found = as_json(part)
    assert {name: found[name] for name in figures} == pytest.approx(figures)
    assert part.identical == identical
    assert part.first_divergence_s == pytest.approx(first_divergence_s)


def test_another_cell_is_another_target() -> None:
    elsewhere = tuple(replace(e, cell=7) if e.target == 0 else e for e in RECORDED)
    figures = as_json(agreement(elsewhere))
    assert (figures["outcome_agreement"], figures["hit_recall_50ms"]) == (0.75, 0.5)


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
