"""Options shared by commands, and checks of their values (numbers, output paths).

Values are checked before a command starts.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
import json
import math
import os
import re
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import MISSING, Field, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args, get_origin, get_type_hints

import typer

from sim2vr_harness.base import paths
from sim2vr_harness.base.errors import InputError, unknown_name
from sim2vr_harness.base.requests import Expected, option

if TYPE_CHECKING:
    from sim2vr_harness.evaluation.expectations import Planned, Results


def known_games(incomplete: str) -> list[str]:
    """Complete the name of a game."""
    from sim2vr_harness.client import list_games

    return [name for name in sorted(list_games()) if name.startswith(incomplete)]


def known_users(incomplete: str) -> list[str]:
    """Complete the name of a trained user that is here, without ``pretrained:``."""
    folders = (paths.trained_users_dir(), paths.fetched_users_dir())
    cards = [card for folder in folders for card in folder.glob(f"{incomplete}*/card.json")]
    return sorted(card.parent.name for card in cards)


def known_configs(incomplete: str) -> list[str]:
    """Complete the name of a configuration that ships, or of a game."""
    files = (paths.share_dir() / "configs").glob(f"{incomplete}*.yaml")
    return sorted({*known_games(incomplete), *(file.stem for file in files)})


def known_players(incomplete: str) -> list[str]:
    """Complete the name of a trained user that ships, or of a baseline."""
    baselines = [name for name in ("still", "random") if name.startswith(incomplete)]
    return [*baselines, *known_users(incomplete)]


def _checks(place: str | None) -> Callable[[typer.CallbackParam, Any], Any]:
    """Return the check of an option: numbers are finite, and its place can be read or written.

    What is written need not exist yet. An error names the folder that is in the way.
    """

    def check(parameter: typer.CallbackParam, value: Any) -> Any:
        options = [name for name in parameter.opts if name.startswith("--")]
        name = options[0] if options else str(parameter.name).upper()
        got = repr(str(value))
        if isinstance(value, float) and not math.isfinite(value):
            raise InputError(name, f"{value:g}", "a finite number")
        if place is None or value is None:
            return value
        if place == "file to read" and not value.is_file():
            raise InputError(name, f"{got}, which is no file", "a file to read")
        if place == "file to write" and value.is_dir():
            raise InputError(name, f"{got}, which is a folder", "a file")
        if place == "file to write" and value.is_symlink() and not value.exists():
            raise InputError(name, f"{got}, a link to nothing", "a file")
        if place != "file to read":
            _check(name, value, value.absolute().parent if place == "file to write" else value)
        return value

    return check


def _check(option: str, given: Path, folder: Path) -> None:
    """Try to write in the folder, or in the nearest one above it that exists."""
    above = folder.absolute()
    while not os.path.lexists(above) and above != above.parent:
        above = above.parent
    got = repr(str(given))
    if not above.is_dir():
        if above.is_symlink() and not above.exists():
            raise InputError(option, f"{got}, but {above} is a link to nothing", "a folder")
        problem = "which is a file" if above == folder.absolute() else f"but {above} is a file"
        raise InputError(option, f"{got}, {problem}", "a folder")
    try:
        with tempfile.TemporaryDirectory(prefix=".sim2vr-", dir=above):
            pass
    except OSError as error:
        problem = f"but nothing can be written in {above} ({(error.strerror or '').lower()})"
        raise InputError(option, f"{got}, {problem}", "a writable place") from error


_COMPLETIONS: dict[str | None, Any] = {
    "games": known_games,
    "users": known_users,
    "configs": known_configs,
    "players": known_players,
}


_REPEATED = (tuple, Sequence)
"""Types of options that may be repeated."""


def _of_a_field(name: str, field: Field[Any], type_: Any) -> inspect.Parameter:
    """Return the parameter, as Typer reads it, that a field of a request is."""
    about = field.metadata
    default = inspect.Parameter.empty if field.default is MISSING else field.default
    if get_origin(type_) in _REPEATED:
        type_ = list[get_args(type_)[0]]  # type: ignore[misc]
        default = default or None
    settings: dict[str, Any] = {
        "help": about["help"],
        "metavar": about.get("metavar"),
        "min": about.get("least"),
        "max": about.get("most"),
        "show_default": about.get("shown", True),
        "autocompletion": _COMPLETIONS.get(about.get("names")),
        "callback": _checks(about.get("place")),
    }
    if about.get("at"):
        declared: Any = typer.Argument(**settings)
    else:
        word = name.strip("_").replace("_", "-")
        both = f"--{word}/--no-{word}" if type_ is bool and default else f"--{word}"
        declared = typer.Option(about.get("name", both), **settings)
    return inspect.Parameter(
        name,
        inspect.Parameter.KEYWORD_ONLY,
        default=default,
        annotation=Annotated[type_, declared],
    )


def with_options(function: Callable[[Any], Any]) -> Callable[..., Any]:
    """Return a command that has an option for every field of the request which ``function`` takes.

    Its own options come first, then those of the groups that it inherits. Fields without a help
    sentence are for programs only.
    """
    (taken,) = inspect.signature(function, eval_str=True).parameters.values()
    request = taken.annotation
    types = get_type_hints(request)
    fields = {each.name: each for each in dataclasses.fields(request) if "help" in each.metadata}
    own_first = [n for c in request.__mro__ for n in inspect.get_annotations(c) if n in fields]
    arguments = [name for name, each in fields.items() if "at" in each.metadata]
    repeated = {name for name in fields if get_origin(types[name]) in _REPEATED}

    @functools.wraps(function)
    def run(**given: Any) -> Any:
        given |= {name: tuple(given[name] or ()) for name in repeated}
        return function(request(**given))

    parameters = [
        _of_a_field(name, fields[name], types[name])
        for name in dict.fromkeys([*arguments, *own_first])
    ]
    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {each.name: each.annotation for each in parameters}
    run.bare = {  # type: ignore[attr-defined]
        f"--{name}": each.metadata["bare"]
        for name, each in fields.items()
        if "bare" in each.metadata
    }
    return run


EVERYONE = 2**31
"""What ``--people`` means without a number where a population has no end: numbers have 31 bits."""


# --- groups of options that several requests inherit ----------------------------------------------


@dataclass(frozen=True, kw_only=True)
class JsonOutput:
    """``--json``."""

    json: bool = option("Print one JSON object, nothing else.", False)


@dataclass(frozen=True, kw_only=True)
class AnyUser:
    """``--user``."""

    user: str | None = option(
        "Who plays: a trained user, or one without training: still, random, 'touch NAME', "
        "'point NAME', 'press NAME by ray', 'grab NAME to NAME2', or a SCRIPT.yaml of such steps. "
        "NAME is an object, or X Y Z in metres.",
        names="players",
        metavar="USER",
    )


@dataclass(frozen=True, kw_only=True)
class TrainedPeople:
    """``--people`` of trainings: so many participants, or a population without end."""

    people: int | None = option(
        "Another virtual participant plays each round; N: one of N (docs/concepts/people.md).",
        metavar="[N]",
        least=1,
        bare=EVERYONE,
    )

    def count(self) -> int | None:
        """Return how many persons there are; None: a population without end."""
        return None if self.people == EVERYONE else self.people


def print_json(content: Any) -> None:
    """Print a JSON object or list."""
    sys.stdout.write(json.dumps(content, indent=2) + "\n")


def print_written(files: Iterable[Path]) -> None:
    """Print the names of written files."""
    for file in files:
        typer.echo(f"Written: {file}")


def who_plays(run: str | None, user: str | None) -> tuple[str | None, str | None]:
    """Return the trained user and the baseline that RUN and ``--user`` name, at most one of them.

    Raises:
        InputError: Both are given, or no user has that name.
    """
    if user is None:
        return run, None
    if run is not None:
        raise InputError("--user", f"it together with {run!r}", "one of them")
    from sim2vr_harness.policies.scripted.steps import FORMS, is_script, read_steps

    if is_script(user):
        read_steps(user)  # refuses another form before anything starts
    if is_script(user) or user in ("still", "random"):
        return None, user
    names = known_users("")
    trained = user.removeprefix("pretrained:") in names or re.search(r"\.py:\w+$", user)
    if trained or Path(user).exists():
        return user, None
    raise unknown_name("--user", user, ["still", "random", *FORMS, *names])


@dataclass(frozen=True, kw_only=True)
class Checked(Expected):
    """``--expect``, ``--against`` and ``--junit``."""

    against: Path | None = option(
        "Exit with status 1 if a measure is worse than in earlier results by more than their "
        "noise (95 % interval of the difference): results.json of evaluate, statistics.json of "
        "study.",
        metavar="BASELINE.json",
        place="file to read",
    )


class CheckedRun:
    """The checks of ``--expect`` and ``--against`` around what a command plays.

    Raises:
        InputError: One of the options cannot be used.
    """

    def __init__(self, request: Expected, command: str) -> None:
        against = request.against if isinstance(request, Checked) else None
        self.asked = bool(request.expect) or against is not None
        self._junit, self._command, self._began = request.junit, command, time.monotonic()
        if request.junit is not None and not self.asked:
            raise InputError("--junit", "it without --expect or --against", "one of them")
        if self.asked:
            from sim2vr_harness.evaluation.expectations import Checks

            self._checks = Checks.of(request.expect, against)

    def prepare(self, planned: Planned) -> None:
        """Refuse what will not be measured, before anything is played."""
        if self.asked:
            self._checks.prepare(planned)

    def status(self, results: Callable[[], Results]) -> int:
        """Print a sentence per failed check, write the file, and return the exit status."""
        if not self.asked:
            return 0
        from sim2vr_harness.evaluation.expectations import write_junit

        found = self._checks.run(results())
        for one in found:
            if one.skipped is not None:
                typer.echo(f"note: {one.group}: {one.name} was skipped: {one.skipped}", err=True)
        failures = [one.failure for one in found if one.failure is not None]
        for failure in failures:
            typer.echo(f"failed: {failure}", err=True)
        typer.echo(f"{len(failures)} of {len(found)} checks failed", err=True)
        if self._junit is not None:
            seconds = time.monotonic() - self._began
            write_junit(self._junit, f"sim2vr-harness {self._command}", found, seconds)
        return 1 if failures else 0
