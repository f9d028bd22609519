"""Tasks: rules and code, over any transport; what is wrong is said in one line."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim2vr_harness.client import (
    AppReply,
    DevicePoses,
    HapticPulse,
    Measure,
    Outcome,
    Task,
    TaskedApp,
    TaskMoment,
    TaskRules,
    check_task,
    frame_time_ns,
)
from sim2vr_harness.client.tasks import RuleTask, task_facts
from sim2vr_harness.envs import AppConfig, EnvConfig, Simulation, VisionConfig
from sim2vr_harness.envs.resolved import ResolvedEnv
from webxr_pages import NEEDS_BROWSER, PAGES, hands, open_page

HEAD = np.array([0.0, 1.2, 0.0, 0.0, 0.0, 0.0, 1.0])


def moment(time_s: float, **told: Any) -> TaskMoment:
    hand = np.array([0.0, 1.0, told.pop("hand_z", 0.3), 0.0, 0.0, 0.0, 1.0])
    return TaskMoment(time_s, 0.0 if time_s == 0.0 else 0.05, DevicePoses(HEAD, hand), **told)


def rewards(rules: dict[str, Any], moments: list[TaskMoment]) -> list[float]:
    task = RuleTask(TaskRules(**rules))
    task.reset(moments[0], 1)
    return [task.step(one).reward for one in moments[1:]]


def test_rules_are_worth_what_they_say() -> None:
    scores = [moment(0.05 * k, values={"score": v}) for k, v in enumerate([2, 2, 5, 4])]
    assert rewards({"reward": {"expression": "app.score"}}, scores) == [0.0, 3.0, -1.0]
    per = {"expression": "app.score", "per": "second", "weight": 10.0}
    assert rewards({"reward": per}, scores) == pytest.approx([1.0, 2.5, 2.0])
    per = {"expression": "app.score", "per": "step", "name": "score"}
    assert rewards({"reward": [per, {"seconds": True, "weight": -2.0}]}, scores) == pytest.approx(
        [1.9, 4.9, 3.9]
    )
    pulses = [
        moment(0.0),
        moment(0.05, haptics=(HapticPulse("right", 0.5, 0.0, 0.1),)),
        moment(0.1, haptics=(HapticPulse("left", 0.5, 0.0, 0.1), HapticPulse("right", 0.0, 0, 0))),
    ]
    assert rewards({"reward": {"haptics": "right", "weight": 3.0}}, pulses) == [3.0, 0.0]
    assert rewards({"reward": {"haptics": "any"}}, pulses) == [1.0, 1.0]
    # From (0, 1, 0.3) and (0, 1, 0.4) to (0.3, 1, 0.7): 0.5 m and 0.3 * sqrt 2 m.
    place = {"values": {"distance_ball": (0.3, 1.0, 0.7)}}
    near = [moment(0.0, **place), moment(0.05, hand_z=0.4, **place)]
    rule = {"distance": {"object": "ball"}, "weight": -1.0}
    assert rewards({"reward": rule}, near) == pytest.approx([0.5 - 0.3 * 2**0.5])


def test_a_rule_task_says_what_it_reads_and_measures() -> None:
    task = RuleTask(
        TaskRules(
            reward=[{"expression": "app.hits"}, {"distance": {"object": "a 'b'"}}],
            finished="app.over",
            values={"misses": "app.misses"},
            seconds=30.0,
        )
    )
    assert task.values == {
        "misses": "app.misses",
        "hits": "app.hits",
        "distance_b": "locate(\"a 'b'\")",
        "is_finished": "app.over",
    }
    facts = task_facts(task, "page")
    assert [one.name for one in facts.measures] == ["hits", "misses"]
    assert (facts.score, facts.round_seconds, facts.evaluated) == ("hits", 30.0, ("standard",))
    task.reset(moment(0.0, values={"hits": 0, "distance_b": (0, 0, 0)}), 1)
    over = {"hits": 1, "distance_b": (0, 0, 0), "is_finished": True}
    outcome = task.step(moment(0.05, values=over))
    assert outcome.finished
    assert outcome.log["reward_hits"] == outcome.log["reward_hitsSum"] == 1.0


TIMED: dict[str, Any] = {
    "events": [
        {"name": "shown", "expression": "app.shown"},
        {"name": "hit", "expression": "app.hits"},
        {"name": "wrong", "expression": "app.wrong"},
        {"name": "open", "on": {"object": "lid", "becomes": "absent"}},
        {"name": "moved", "on": {"object": "lid", "becomes": "moved"}},
    ],
    "measures": [
        {"name": "selection_time", "time": {"start": "shown", "end": "hit"}, "label": "Selection"},
        {"name": "between", "time": {"end": "hit"}},
        {"name": "error_rate", "proportion": {"of": "wrong", "other": "hit"}, "better": "lower"},
        {"name": "opened", "count": "open", "unit": "times"},
        {"name": "moves", "count": "moved"},
    ],
    "score": "opened",
}


def test_events_are_counted_and_timed() -> None:
    """By hand: shown at 0 s (true then), hit at 0.1 s; shown again with that hit, hit at 0.25 s."""
    rows: list[tuple[Any, int, int, Any]] = [
        (True, 0, 0, (0.0, 1.0, 0.5)),
        (False, 0, 1, (0.0, 1.0, 0.5)),
        (True, 1, 1, (0.0, 1.0, 0.505)),  # 5 mm are no move
        (True, 1, 1, (0.0, 1.0, 0.515)),  # 15 mm are
        (True, 1, 3, None),
        (False, 2, 3, None),
    ]
    names = ("event_shown", "event_hit", "event_wrong", "event_open")
    moments = [
        moment(0.05 * k, values={**dict(zip(names, row, strict=True)), "event_moved": row[3]})
        for k, row in enumerate(rows)
    ]
    task = RuleTask(TaskRules(**TIMED))
    log: Any = {}
    for _ in range(2):  # a new round begins everything anew
        task.reset(moments[0], 1)
        for one in moments[1:]:
            log = task.step(one).log
    found = {one.name: one.value(log) for one in task.measures}
    assert found["selection_time"] == pytest.approx((0.1 + 0.15) / 2)
    assert found["between"] == pytest.approx((0.1 + 0.15) / 2)
    assert found["error_rate"] == pytest.approx(3 / 5)
    assert (found["opened"], found["moves"]) == (1.0, 1.0)
    headings = {one.name: (one.heading, one.better) for one in task.measures}
    assert headings["selection_time"] == ("Selection (s)", "lower")
    assert headings["error_rate"] == ("Error rate", "lower")
    assert headings["opened"] == ("Opened (times)", "higher")
    assert (task.score, task.measures[0].name) == ("opened", "opened")
    task.reset(moments[0], 1)
    log = task.step(moments[1]).log
    assert next(one for one in task.measures if one.name == "selection_time").value(log) is None


@pytest.mark.parametrize(
    ("rules", "words"),
    [
        ({"events": [{"name": "a"}]}, "got neither or both of expression and on"),
        ({"measures": [{"name": "a", "count": "b"}]}, "got the event 'b' of a, expected one of"),
        (
            {"events": [{"name": "a", "on": {"object": "b", "becomes": "blue"}}]},
            r"events\.0\.on\.becomes: got 'blue', expected 'present', 'absent' or 'moved'",
        ),
        (
            {"reward": {"expression": "a", "haptics": "any"}},
            "got expression and haptics, expected one",
        ),
        ({"reward": {"distance": {"device": "head"}}}, "expected one of them"),
        ({"seconds": 0}, "seconds: got 0"),
        ({"inputs": ["right.trigga"]}, "inputs: got 'right.trigga', expected any of"),
    ],
)
def test_rules_that_cannot_be(rules: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words) as caught:
        TaskRules(**rules)
    assert "\n" not in str(caught.value)


CODE = """
from sim2vr_harness.client import Measure, Outcome, Task

class Good(Task):
    values = {{"score": "Points"}}
    measures = (Measure("score", "Score", log_key="score"),)
    score = "score"
    def reset(self, moment, seed):
        self.before = moment.number("score")
    def step(self, moment):
        before, self.before = self.before, moment.number("score")
        {line}
        return Outcome(self.before - before + 1.0)
"""


def code(folder: Path, line: str = "pass") -> str:
    file = folder / "task.py"
    file.write_text(CODE.format(line=line))
    return f"{file}:Good"


def test_a_task_judges_any_transport(tmp_path: Path) -> None:
    settings: dict[str, Any] = {"game": "sample", "options": {}, "task": code(tmp_path)}
    rows = []
    for transport in ("in_process", "protocol2", "protocol1"):
        app = AppConfig(**settings, transport=transport)
        simulation = Simulation(EnvConfig(app=app, vision=VisionConfig(width=16, height=16)), 2)
        assert not simulation.exact_states
        simulation.reset(seeds=[1, 2])
        rng = np.random.default_rng(0)
        shape = (2, simulation.action_space.shape[0])
        steps = [simulation.step(rng.uniform(-1, 1, shape)) for _ in range(5)]
        rows.append([(s.game_reward.tolist(), s.infos[0]["log"]["score"]) for s in steps])
        simulation.close()
    assert rows[0] == rows[1] == rows[2]
    assert rows[0][0][0] == [1.0, 1.0]
    assert [one.name for one in ResolvedEnv(EnvConfig(app=settings)).facts.measures] == ["score"]


class _Still:
    """An app of which only the time moves."""

    capabilities = frozenset({"save", "haptics"})
    image = np.zeros((2, 2, 4), np.uint8)

    def reset(self, seed: int, poses: Any, options: Any = None, *, time_ns: int = 0) -> AppReply:
        return AppReply(0.0, False, 0.0, {})

    def start_step(self, times_ns: Any, poses: Any, drawn: int = -1, *, last: bool = False) -> None:
        pass

    def finish_step(self) -> AppReply:
        return AppReply(0.0, False, 0.0, {})


def test_a_round_is_over_in_the_frame_of_its_last_second() -> None:
    app = TaskedApp(_Still(), RuleTask(TaskRules(seconds=0.5)))  # type: ignore[arg-type]
    assert app.capabilities == {"haptics"}
    app.reset(1, hands(0))
    replies = [app.step(frame_time_ns(k, 20), hands(0)) for k in range(1, 11)]
    assert [reply.finished for reply in replies] == [False] * 9 + [True]
    assert replies[4].time_feature == pytest.approx(0.0, abs=1e-6)
    assert replies[9].time_feature == pytest.approx(1.0, abs=1e-6)


class _Counting(Task):
    measures = (Measure("steps", "Steps", log_key="steps"),)
    score = "steps"

    def reset(self, moment: TaskMoment, seed: int) -> None:
        self.steps = 0

    def step(self, moment: TaskMoment) -> Outcome:
        self.steps += 1
        return Outcome(1.0, log={"steps": self.steps})


def test_the_checker_says_what_is_wrong() -> None:
    moments = [moment(0.05 * k) for k in range(5)]
    assert check_task(_Counting(), moments) == []

    class Wrong(_Counting):
        score = "hits"
        inputs = ("right.trigga",)
        devices = ("controller",)

    found = check_task(Wrong(), moments)
    assert [line.partition(":")[0] for line in found] == ["devices", "inputs", "score"]

    class Forgets(_Counting):
        steps = 0

        def reset(self, moment: TaskMoment, seed: int) -> None:
            pass

    (line,) = check_task(Forgets(), moments)
    assert line.startswith("reset: got other outcomes")

    assert check_task(_Counting(), moments[:1]) == ["moments: got 1, expected a reset and steps"]


@NEEDS_BROWSER
def test_a_page_is_judged_by_what_it_holds() -> None:
    task = RuleTask(
        TaskRules(
            reward=[
                {"expression": "app.score", "weight": 5},
                {"haptics": "right"},
                {"distance": {"expression": "app.target"}, "weight": -1, "name": "gap"},
            ]
        )
    )
    with TaskedApp(open_page(PAGES / "touch.html", values=task.values), task) as app:
        app.record()
        start = app.reset(7, hands(0)).values["gap"]
        assert isinstance(start, tuple)
        touching = DevicePoses(HEAD, np.array([*start, 0.0, 0.0, 0.0, 1.0]))
        reply = app.step(frame_time_ns(1, 20), touching)
        assert reply.log["score"] == 1.0
        assert reply.log["reward_score"] == 5.0
        assert reply.log["reward_haptics_right"] == 1.0
        before = np.linalg.norm(hands(0).right_controller[:3] - np.array(start))
        after = np.linalg.norm(np.array(start) - np.array(reply.values["gap"]))
        assert reply.log["reward_gap"] == pytest.approx(before - after)
        assert reply.reward == pytest.approx(6.0 + before - after)
        assert app.moments is not None
        assert check_task(task, app.moments) == []
