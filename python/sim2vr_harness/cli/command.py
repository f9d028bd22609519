"""Classes of commands: groups in ``--help``, and examples.

The docstring of a command ends with the line ``Examples:`` and its examples, one a line.
"""

import inspect
import re
from collections.abc import Callable
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

from sim2vr_harness.cli.options import with_options

HEADINGS = DESIGNS, USERS, RECORDED, LOOK, SETUP = (
    "Who can use it, and which design is better",
    "What does a user do, or learn to do",
    "How do recorded people do it",
    "How does it look",
    "What is there, and does it work",
)
"""The groups of ``sim2vr-harness --help``, in order."""

_EXAMPLES = "\nExamples:\n"


class _WithExamples:
    """A command whose help text ends with examples, which are kept line by line."""

    examples: tuple[str, ...] = ()

    def __init__(self, *arguments: Any, help: str | None = None, **settings: Any) -> None:
        text, _, examples = inspect.cleandoc(help or "").partition(_EXAMPLES)
        super().__init__(*arguments, help=text.strip() or None, **settings)  # type: ignore[call-arg]
        self.examples = tuple(line.strip() for line in examples.splitlines() if line.strip())

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """Write the examples below the options."""
        if self.examples:
            with formatter.section("Examples"):
                for line in self.examples:
                    formatter.write(f"{'':{formatter.current_indent}}{line}\n")


class Command(_WithExamples, TyperCommand):
    """A command with examples, and options whose value may be left out before another word."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Give an option without its number what it then means, which Typer cannot."""
        for name, meant in getattr(self.callback, "bare", {}).items():
            for k, word in enumerate(args):
                if word == name and not re.fullmatch(r"[+-]?\d.*", "".join(args[k + 1 : k + 2])):
                    args = [*args[:k], f"{name}={meant}", *args[k + 1 :]]
        return super().parse_args(ctx, args)


class Group(_WithExamples, TyperGroup):
    """A command with commands below it, listed in the groups that they name."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write a list of commands per group; names in a column of one width."""
        groups: dict[str, list[tuple[str, str]]] = {}
        shown = [(name, each) for name, each in self.commands.items() if not each.hidden]
        width = max(len(name) for name, _ in shown)
        for name, each in shown:
            heading = getattr(each, "rich_help_panel", None)
            text = each.get_short_help_str(formatter.width - width - 4)
            rows = groups.setdefault(heading if isinstance(heading, str) else "Commands", [])
            rows.append((name.ljust(width), text))
        for heading, rows in sorted(
            groups.items(), key=lambda group: (*HEADINGS, group[0]).index(group[0])
        ):
            with formatter.section(heading):
                formatter.write_dl(rows)


class CommandGroup(typer.Typer):
    """A Typer app of such commands; ``help`` ends with examples."""

    def __init__(self, help: str, **settings: Any) -> None:
        super().__init__(
            help=help,
            cls=Group,
            no_args_is_help=True,
            rich_markup_mode=None,
            **{"add_completion": False, **settings},
        )

    def add(
        self, name: str, function: Callable[..., Any], group: str | None = None, **settings: Any
    ) -> None:
        """Add a command of a request, listed in the group of that heading."""
        settings = {"cls": Command, "rich_help_panel": group, **settings}
        self.command(name, **settings)(with_options(function))
