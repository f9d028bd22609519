"""Classes of Python files that a setting names as ``FILE.py:CLASS``; loading one runs the file."""

import importlib.util
import inspect
import sys
from collections.abc import Callable
from pathlib import Path
from traceback import extract_tb

from sim2vr_harness.base.errors import InputError, reason, unknown_name


def load_class(field: str, text: str, expected: str, fits: Callable[[type], bool]) -> type:
    """Run a Python file and return a class of it.

    Args:
        field: of the setting, for errors.
        text: ``FILE.py:CLASS``.
        expected: such a class, for people.
        fits: whether a class of the file is one.

    Raises:
        InputError: there is no such file or class, or the file cannot be run.
    """
    name, colon, class_name = text.rpartition(":")
    if not colon or not name.endswith(".py") or not class_name.isidentifier():
        raise InputError(field, repr(text), expected)
    file = Path(name).expanduser()
    if not file.is_file():
        raise InputError(field, f"{text!r}, but there is no file {str(file)!r}", expected)
    module = f"sim2vr_file_{abs(hash(str(file.resolve()))):x}"
    spec = importlib.util.spec_from_file_location(module, file)
    assert spec is not None
    assert spec.loader is not None
    made = importlib.util.module_from_spec(spec)
    sys.modules[module] = made  # dataclasses look for their module
    try:
        spec.loader.exec_module(made)
    except Exception as error:
        raise InputError(
            field, f"{str(file)!r}, which cannot be read ({words_of(error)})", "a file of Python"
        ) from error
    classes = {
        key: value
        for key, value in vars(made).items()
        if inspect.isclass(value) and value.__module__ == module and fits(value)
    }
    if class_name not in classes:
        if not classes:
            raise InputError(field, repr(text), expected)
        raise unknown_name(field, class_name, classes)
    return classes[class_name]


def words_of(error: BaseException) -> str:
    """Return kind, text and line of an error in a file of the user's."""
    return f"{type(error).__name__}: {reason(error)}{_line_of(error)}"


def _line_of(error: BaseException) -> str:
    """Return the innermost line of the error's traceback outside this package."""
    own = str(Path(__file__).parents[1])
    frames = [frame for frame in extract_tb(error.__traceback__) if "<" not in frame.filename]
    theirs = [frame for frame in frames if not frame.filename.startswith(own)]
    return f", {Path(theirs[-1].filename).name} line {theirs[-1].lineno}" if theirs else ""
