"""Errors of the command line: one line on the standard error stream and an exit status."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import typer

from sim2vr_harness.training.errors import unknown_name

__all__ = ["BAD_INPUT", "FAILED", "INTERRUPTED", "report"]

BAD_INPUT = 2
FAILED = 1
INTERRUPTED = 130

# The class at the root of typer's errors; typer brings its own copy of click along.
_ClickException: type[Exception] = typer.BadParameter.__mro__[2]


def report(command: Callable[[], int | None], debug: bool = False) -> int:
    """Run a command and return its exit status, 2 for bad input and 1 for a failure.

    Args:
        command: Runs the command.
        debug: Let errors through, traceback and all.
    """
    try:
        return command() or 0
    except KeyboardInterrupt:
        return _say("interrupted", INTERRUPTED)
    except typer.Abort:
        return _say("interrupted", INTERRUPTED)
    except _ClickException as error:
        return _say(_usage(error), BAD_INPUT)
    except Exception as error:
        if debug:
            raise
        return _say(_words(error), BAD_INPUT if isinstance(error, ValueError) else FAILED)


def _usage(error: Exception) -> str:
    """Word an error in the options or arguments that typer found: field, got, expected."""
    context = getattr(error, "ctx", None)
    path = context.command_path if context is not None else "sim2vr-harness"
    message = str(getattr(error, "message", "") or error).strip().rstrip(".")
    if option := getattr(error, "option_name", None):
        text = f"{option}: got an unknown option, expected {_closest_option(error)}"
    elif parameter := getattr(error, "param", None):
        field = _parameter_name(parameter)
        if message and not message.startswith("Missing"):
            text = f"{field}: got another value, expected {_expected(message)}"
        else:
            text = f"{field}: got nothing, expected a value"
    elif message.startswith("No such command "):
        name = message.removeprefix("No such command ").split()[0].strip("'.")
        known = getattr(getattr(context, "command", None), "commands", {})
        text = str(unknown_name("command", name, sorted(known)))
    else:
        text = message
    return f"{text} (see: {path} --help)"


def _closest_option(error: Exception) -> str:
    found = getattr(error, "possibilities", None) or []
    return f"one of the command's (did you mean '{found[0]}'?)" if found else "one of the command's"


def _parameter_name(parameter: Any) -> str:
    options = [name for name in getattr(parameter, "opts", []) if name.startswith("--")]
    if options:
        return options[0]
    return str(getattr(parameter, "metavar", None) or parameter.name).strip("[].").upper()


def _expected(message: str) -> str:
    text = message.removeprefix("Input should be ")
    return text[:1].lower() + text[1:]


def _words(error: Exception) -> str:
    text = " ".join(str(error).split())
    if not text:
        return type(error).__name__
    if isinstance(error, (ValueError, RuntimeError, OSError)):
        return text
    return f"{type(error).__name__}: {text} (run again with --debug for the traceback)"


def _say(message: str, status: int) -> int:
    sys.stderr.write(f"error: {message}\n")
    return status
