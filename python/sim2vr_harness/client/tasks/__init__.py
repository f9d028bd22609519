"""Tasks: rewards and outcomes for apps that report none."""

from sim2vr_harness.client.tasks.rules import RuleTask, TaskRules, load_task, names_code
from sim2vr_harness.client.tasks.task import (
    CONDITION,
    Outcome,
    Task,
    TaskedApp,
    TaskMoment,
    check_task,
    task_facts,
)

__all__ = [
    "CONDITION",
    "Outcome",
    "RuleTask",
    "Task",
    "TaskMoment",
    "TaskRules",
    "TaskedApp",
    "check_task",
    "load_task",
    "names_code",
    "task_facts",
]
