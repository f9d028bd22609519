"""Tasks from files: ``file.py:Class``, or rules in YAML."""

from pathlib import Path

import pydantic

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.files import read_yaml
from sim2vr_harness.base.python_classes import load_class, words_of
from sim2vr_harness.base.settings import first_problem
from sim2vr_harness.client.tasks.rules import RuleTask, TaskRules
from sim2vr_harness.client.tasks.task import Task

FIELD = "env.app.task"
_EXPECTED = "rules, a YAML file of them, or FILE.py:CLASS"
_CLASS = "FILE.py:CLASS with a class below sim2vr_harness.client.Task in it"


def names_code(task: str | TaskRules | None) -> bool:
    """Whether a task is Python, which runs when it is loaded."""
    return isinstance(task, str) and not task.endswith((".yaml", ".yml"))


def load_task(task: str | TaskRules | None) -> Task:
    """Return the task that a configuration names; None rewards nothing for a minute.

    Raises:
        InputError: there is no such file or class, or it cannot be made; one line.
    """
    if task is None:
        return RuleTask(TaskRules())
    if isinstance(task, TaskRules):
        return RuleTask(task)
    if not names_code(task):
        return RuleTask(_rules_of(Path(task).expanduser()))
    found = load_class(
        FIELD, task, _CLASS if ".py" in task else _EXPECTED, lambda made: issubclass(made, Task)
    )
    try:
        return found()
    except Exception as error:
        raise InputError(
            FIELD, f"{task!r}, which cannot be made ({words_of(error)})", "a task without arguments"
        ) from error


def _rules_of(file: Path) -> TaskRules:
    tree = read_yaml(file, "rules of a task in YAML")
    try:
        return TaskRules.model_validate(tree)
    except pydantic.ValidationError as error:
        raise first_problem(error, TaskRules, (str(file),)) from error
