"""Fields of requests: what a command does for one call.

A request is a frozen dataclass with keywords only. The command line makes an option of every field
(``cli.options``), so that its name, type, default and help are written once.
"""

from dataclasses import MISSING, field
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
