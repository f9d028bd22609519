"""Errors of the command line: one line on the standard error stream and an exit status."""

import errno
import sys
from collections.abc import Callable, Sequence
from typing import Any

import typer

from sim2vr_harness.base.errors import InputError, closest, printable, reason
from sim2vr_harness.base.files import file_name

BAD_INPUT = 2
FAILED = 1
INTERRUPTED = 130

# The class at the root of typer's errors; typer brings its own copy of click along.
_ClickException: type[Exception] = typer.BadParameter.__mro__[2]


def report(
    command: Callable[[], int | None], given: Sequence[str] = (), debug: bool = False
) -> int:
    """Run a command and return its exit status, 2 for bad input and 1 for a failure.

    Args:
        command: Runs the command.
        given: The arguments that it was given.
        debug: Let errors through, traceback and all.
    """
    try:
        return command() or 0
    except KeyboardInterrupt:
        return _say("interrupted", INTERRUPTED)
    except typer.Abort:
        return _say("interrupted", INTERRUPTED)
    except _ClickException as error:
        if type(error).__name__ == "NoArgsIsHelpError":
            sys.stdout.write(f"{str(error).strip()}\n")
            return BAD_INPUT
        return _say(_usage(error, given), BAD_INPUT)
    except Exception as error:
        if debug:
            raise
        bad = isinstance(error, ValueError) or _is_bad_path(error)
        if isinstance(error, OSError) and error.filename is not None and error.strerror:
            file = error.filename.decode() if isinstance(error.filename, bytes) else error.filename
            words = f"{file_name(file)}: got {reason(error)!r}, expected to read or write it"
        else:
            text = " ".join(str(error).split())
            if not text:
                words = type(error).__name__
            elif isinstance(error, (ValueError, RuntimeError, OSError)):
                words = text
            else:
                words = f"{type(error).__name__}: {text} (run again with --debug for the traceback)"
        return _say(words, BAD_INPUT if bad else FAILED)


def _usage(error: Exception, given: Sequence[str]) -> str:
    """Word an error in the options or arguments that typer found: field, got, expected."""
    context = getattr(error, "ctx", None)
    command = getattr(context, "command", None)
    path = context.command_path if context is not None else "sim2vr-harness"
    message = str(getattr(error, "message", "") or error).strip().rstrip(".")
    if option := getattr(error, "option_name", None):
        if message.startswith("No such option"):
            text = f"{option}: got an unknown option, expected {_known_options(option, command)}"
        elif "does not take a value" in message:
            text = f"{option}: got a value, expected none"
        else:
            text = f"{option}: got nothing, expected a value"
    elif parameter := getattr(error, "param", None):
        field = _parameter_name(parameter)
        if message and not message.startswith("Missing"):
            got = _value_of(parameter, given)
            text = f"{field}: got {got}, expected {_expected(message)}"
        else:
            text = f"{field}: got nothing, expected {_missing(parameter)}"
    elif message.startswith("No such command "):
        name = message.removeprefix("No such command ").split()[0].strip("'.")
        # Word the error for a command; the nearest one may be in a group below.
        commands = getattr(command, "commands", {}).items()
        shown = {known: each for known, each in commands if not each.hidden}
        below = {
            inner: f"{known} {inner}"
            for known, each in shown.items()
            for inner in getattr(each, "commands", {})
        }
        best = closest(name, [*shown, *below])
        hint = f" (did you mean {below.get(best, best)!r}?)" if best else ""
        unknown_command = InputError(
            "command", repr(name), f"one of {', '.join(sorted(shown))}{hint}"
        )
        text = str(unknown_command)
    elif message.startswith("Got unexpected extra argument"):
        more = message.partition("(")[2].partition("(")[2].rstrip(")")
        text = f"arguments: got {more!r} behind the others, expected no more"
    else:
        text = message
    return f"{text} (see: {path} --help)"


def _known_options(option: str, command: Any) -> str:
    known = [_parameter_name(parameter) for parameter in getattr(command, "params", [])]
    names = [name for name in known if name.startswith("--")]
    best = closest(option, [*names, "--help"])
    return (
        f"one of the command's (did you mean {best!r}?)" if best else f"one of {', '.join(names)}"
    )


def _parameter_name(parameter: Any) -> str:
    options = [name for name in getattr(parameter, "opts", []) if name.startswith("--")]
    if options:
        return options[0]
    return str(getattr(parameter, "metavar", None) or parameter.name).strip("[].").upper()


def _value_of(parameter: Any, given: Sequence[str]) -> str:
    """What was given to an option, as far as it can be found again."""
    for option in getattr(parameter, "opts", []):
        for i, word in reversed(list(enumerate(given))):
            if word == option and i + 1 < len(given):
                return repr(given[i + 1])
            if word.startswith(f"{option}="):
                return repr(word.removeprefix(f"{option}="))
    return "another value"


def _expected(message: str) -> str:
    if "integer" in message:
        return "a whole number"
    if "number" in message or "float" in message:
        return "a number"
    text = message.removeprefix("Input should be ")
    return text[:1].lower() + text[1:]


def _missing(parameter: Any) -> str:
    """The first sentence of what help says of an argument."""
    sentence = str(getattr(parameter, "help", None) or "").partition(". ")[0].strip().rstrip(".")
    return sentence[:1].lower() + sentence[1:] if sentence else "a value"


def _is_bad_path(error: Exception) -> bool:
    """Whether the system says that no file can have such a path."""
    wrong = (errno.ENAMETOOLONG, errno.ELOOP, errno.ENOTDIR, errno.EISDIR, errno.EINVAL)
    return isinstance(error, OSError) and error.errno in wrong


def _say(message: str, status: int) -> int:
    sys.stderr.write(f"error: {printable(message)}\n")
    return status
