"""Facts that a task publishes of its app, in the form of a game's."""

from sim2vr_harness.client.games import Condition, GameFacts
from sim2vr_harness.client.tasks.task import Task

CONDITION = "standard"
"""The only condition of an app that a task judges."""


def task_facts(task: Task, name: str) -> GameFacts:
    """Return what tables, curves and the command line go by.

    Args:
        name: what the app is called.
    """
    return GameFacts(
        name=name,
        description=task.description,
        round_seconds=float(task.round_seconds),
        devices=tuple(task.devices),
        measures=tuple(task.measures),
        score=task.score,
        reward_terms=tuple(task.reward_terms),
        reward_rest="rest",
        conditions=(Condition(CONDITION, "the app as it is", evaluated=True),),
        default_condition=CONDITION,
    )
