"""Tasks: rewards and outcomes for apps that report none."""

from sim2vr_harness.client.tasks.app import TaskedApp
from sim2vr_harness.client.tasks.check import check_task
from sim2vr_harness.client.tasks.facts import CONDITION, task_facts
from sim2vr_harness.client.tasks.loading import load_task, names_code
from sim2vr_harness.client.tasks.rules import RuleTask, TaskRules
from sim2vr_harness.client.tasks.task import Outcome, Task, TaskMoment

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
