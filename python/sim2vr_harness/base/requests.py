"""Fields of requests: what a command does for one call.

A request is a frozen dataclass with keywords only. The command line makes an option of every field
(``cli.options``) that has a help sentence, so that its name, type, default and help are written
once.
"""

from collections.abc import Sequence
from dataclasses import MISSING, dataclass, field
from pathlib import Path
from typing import Any, Literal

Names = Literal["games", "users", "configs", "players"]
Place = Literal["folder to write", "file to write", "file to read"]


def option(help: str, default: Any = None, **about: Any) -> Any:
    """Return a field that is an option, by default ``--NAME`` of the field's name.

    Args:
        help: A sentence for ``--help``.
        default: What is meant without the option.
        about: Any of ``name`` (as written on the command line), ``metavar``, ``shown`` (the default
            in words), ``names`` (:data:`Names` that complete it), ``place`` (:data:`Place`, tried
            before the command starts), ``least`` and ``most`` (bounds of a number) and ``bare``
            (what the option means without a value).
    """
    return field(default=default, metadata={"help": help, **about})


def argument(metavar: str, help: str, default: Any = MISSING, **about: Any) -> Any:
    """Return a field that is given by its place; ``about`` as for an option."""
    return field(default=default, metadata={"help": help, "metavar": metavar, "at": True, **about})


# --- groups of options that requests of several rooms inherit ---


@dataclass(frozen=True, kw_only=True)
class TrustedApp:
    """``--trust-app``."""

    trust_app: bool = option("Run programs and Python code that a file names, from now on.", False)


@dataclass(frozen=True, kw_only=True)
class ChangedEnvironment:
    """``--set`` of commands that play."""

    overrides: Sequence[str] = option(
        "Change the environment: --set env.user.noise.constant=white; may be repeated.",
        (),
        name="--set",
        metavar="KEY=VALUE",
    )


@dataclass(frozen=True, kw_only=True)
class OnePerson:
    """``--person``."""

    person: int | None = option(
        "Let a virtual participant play: this number, from 0, of the population of --seed.",
        metavar="N",
        shown="as the user was trained; a script by an ideal hand",
        least=0,
        most=9999,
    )


@dataclass(frozen=True, kw_only=True)
class ActionMode:
    """``--deterministic`` and ``--stochastic``."""

    deterministic: bool | None = option(
        "Take the policy's mean action, or sample one.",
        name="--deterministic/--stochastic",
        shown="the user's evaluation.deterministic",
    )


@dataclass(frozen=True, kw_only=True)
class Expected:
    """``--expect`` and ``--junit``."""

    expect: tuple[str, ...] = option(
        "Exit with status 1 unless this holds: 'hit_rate >= 0.8' (of an audit 'reach.min >= 0.9'), "
        "or 'CONDITION_OR_CELL:hit_rate >= 0.8' (of an audit 'GROUP:...'); may be repeated.",
        (),
        metavar="TEXT",
    )
    junit: Path | None = option(
        "With --expect or --against: write the checks as JUnit XML.",
        metavar="FILE.xml",
        place="file to write",
    )
