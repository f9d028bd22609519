"""Tasks from files: ``file.py:Class``, or rules in YAML."""

from __future__ import annotations

import importlib.util
import inspect
import sys
from pathlib import Path
from traceback import extract_tb

import pydantic

from sim2vr_harness.base.errors import InputError, reason, unknown_name
from sim2vr_harness.base.files import read_yaml
from sim2vr_harness.base.settings import first_problem
from sim2vr_harness.client.tasks.rules import RuleTask, TaskRules
from sim2vr_harness.client.tasks.task import Task

__all__ = ["FIELD", "load_task", "names_code", "words_of"]

FIELD = "env.app.task"
_EXPECTED = "rules, a YAML file of them, or FILE.py:CLASS"


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
    file, colon, name = task.rpartition(":")
    if not colon or not file.endswith(".py") or not name.isidentifier():
        raise InputError(FIELD, repr(task), _EXPECTED)
    found = _class_of(Path(file).expanduser(), name, task)
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


def _class_of(file: Path, name: str, task: str) -> type[Task]:
    if not file.is_file():
        raise InputError(FIELD, f"{task!r}, but there is no file {str(file)!r}", _EXPECTED)
    module = f"sim2vr_task_{abs(hash(str(file.resolve()))):x}"
    spec = importlib.util.spec_from_file_location(module, file)
    assert spec is not None
    assert spec.loader is not None
    made = importlib.util.module_from_spec(spec)
    sys.modules[module] = made  # dataclasses look for their module
    try:
        spec.loader.exec_module(made)
    except Exception as error:
        raise InputError(
            FIELD, f"{str(file)!r}, which cannot be read ({words_of(error)})", "a file of Python"
        ) from error
    tasks = {
        key: value
        for key, value in vars(made).items()
        if inspect.isclass(value) and issubclass(value, Task) and value.__module__ == module
    }
    if name not in tasks:
        if not tasks:
            raise InputError(FIELD, f"{task!r}", "a class below sim2vr_harness.client.Task in it")
        raise unknown_name(FIELD, name, tasks)
    return tasks[name]


def words_of(error: BaseException) -> str:
    """Return kind, text and line of an error in somebody's code."""
    return f"{type(error).__name__}: {reason(error)}{_line_of(error)}"


def _line_of(error: BaseException) -> str:
    """Where it was raised: the innermost line that is not the package's own."""
    own = str(Path(__file__).parents[2])
    frames = [frame for frame in extract_tb(error.__traceback__) if "<" not in frame.filename]
    theirs = [frame for frame in frames if not frame.filename.startswith(own)]
    return f", {Path(theirs[-1].filename).name} line {theirs[-1].lineno}" if theirs else ""
