"""Check of a task: it judges recorded steps twice."""

import math
from collections.abc import Mapping, Sequence

from sim2vr_harness.base.python_classes import words_of
from sim2vr_harness.client.devices import INPUT_NAMES
from sim2vr_harness.client.games import Measure
from sim2vr_harness.client.tasks.task import Outcome, Task, TaskMoment

_CONTROLLERS = ("controller_left", "controller_right")


def check_task(task: Task, moments: Sequence[TaskMoment], seed: int = 1) -> list[str]:
    """Return what is wrong with a task, a sentence each; nothing if all is well.

    Args:
        task: to check; its present round is lost.
        moments: of one round that was played, the reset's first (:meth:`TaskedApp.record`).
        seed: of the round.
    """
    problems = []
    if not isinstance(task.values, Mapping) or not all(
        isinstance(name, str) and isinstance(value, str) and value.strip()
        for name, value in task.values.items()
    ):
        problems.append(f"values: got {task.values!r}, expected names and expressions, all text")
    if not 0.0 < task.round_seconds < math.inf:
        problems.append(f"round_seconds: got {task.round_seconds}, expected a number above 0")
    for name in task.devices:
        if name not in _CONTROLLERS:
            problems.append(f"devices: got {name!r}, expected any of {', '.join(_CONTROLLERS)}")
    for name in task.inputs:
        if name not in INPUT_NAMES:
            problems.append(f"inputs: got {name!r}, expected any of {', '.join(INPUT_NAMES)}")
    measures: Sequence[object] = task.measures
    for measure in measures:
        if not isinstance(measure, Measure):
            problems.append(f"measures: got {measure!r}, expected Measure(...)")
    names = [one.name for one in measures if isinstance(one, Measure)]
    if task.score is not None and task.score not in names:
        problems.append(f"score: got {task.score!r}, expected one of {', '.join(names) or 'none'}")
    if len(moments) < 2:
        return [*problems, f"moments: got {len(moments)}, expected a reset and steps"]
    first, wrong = _played(task, moments, seed)
    problems += wrong
    if wrong:
        return problems
    again, wrong = _played(task, moments, seed)
    if wrong or [vars(one) for one in again] != [vars(one) for one in first]:
        problems.append(
            "reset: got other outcomes when the same round was judged again, expected equal ones: "
            "reset has to begin everything anew"
        )
    return problems + _in_outcomes(task, moments, first)


def _played(
    task: Task, moments: Sequence[TaskMoment], seed: int
) -> tuple[list[Outcome], list[str]]:
    """The outcomes of a round, or what went wrong in it first."""
    outcomes: list[Outcome] = []
    try:
        task.reset(moments[0], seed)
    except Exception as error:
        return outcomes, [f"reset: raised {words_of(error)}"]
    for number, moment in enumerate(moments[1:], start=1):
        try:
            outcome: object = task.step(moment)
        except Exception as error:
            return outcomes, [f"step {number}: raised {words_of(error)}"]
        if not isinstance(outcome, Outcome):
            got = type(outcome).__name__
            return outcomes, [f"step {number}: returned {got}, expected an Outcome"]
        feature = outcome.time_feature
        numbers = {"reward": outcome.reward, **outcome.log}
        for name, value in numbers.items():
            if not isinstance(value, (bool, int, float)) or not math.isfinite(value):
                return outcomes, [f"step {number}: {name} is {value!r}, expected a finite number"]
        if feature is not None and not -1.0 <= feature <= 1.0:
            return outcomes, [f"step {number}: time_feature is {feature}, expected -1 to 1"]
        outcomes.append(outcome)
    return outcomes, []


def _in_outcomes(
    task: Task, moments: Sequence[TaskMoment], outcomes: Sequence[Outcome]
) -> list[str]:
    problems = []
    if not any(outcome.reward for outcome in outcomes):
        problems.append(
            f"reward: got 0 in all of the {len(outcomes)} steps, expected some that are rewarded; "
            "check the task's reward, or play longer or better"
        )
    known = {key for moment in moments for key in (*moment.values, *moment.log)}
    known |= {key for outcome in outcomes for key in outcome.log}
    for measure in task.measures:
        if measure.grid is None and measure.log_key not in known:
            problems.append(
                f"measures: {measure.name} reads {measure.log_key!r} from the log, expected one of "
                f"{', '.join(sorted(known)) or 'no numbers'}"
            )
    for name in task.values:
        if all(moment.values.get(name) is None for moment in moments):
            problems.append(f"values: the app never has one for {name}")
    return problems
