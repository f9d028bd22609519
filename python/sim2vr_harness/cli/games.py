"""``sim2vr-harness games``: what can be played, in which conditions, and how it is measured."""

import json as jsonlib
from dataclasses import asdict, dataclass
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table

from sim2vr_harness.base.requests import argument
from sim2vr_harness.cli.app_options import GameLibrary
from sim2vr_harness.cli.command import Command
from sim2vr_harness.cli.options import JsonOutput, print_json
from sim2vr_harness.client import GameFacts, describe_game, list_games, list_options


class HelpWithGames(Command):
    """A command whose help lists the conditions that games are evaluated in."""

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """Write the games and their conditions below the options."""
        try:
            known = [(name, ", ".join(describe_game(name).evaluated)) for name in list_games()]
        except RuntimeError:  # the extension module is not built
            known = []
        if known:
            heading = "Conditions that are played by default (all: sim2vr-harness games)"
            with formatter.section(heading):
                formatter.write_dl(known)
        super().format_epilog(ctx, formatter)


@dataclass(frozen=True, kw_only=True)
class GamesRequest(JsonOutput, GameLibrary):
    """Which games to describe."""

    name: str | None = argument("GAME", "A game.", None, shown="all, in short", names="games")


def games(request: GamesRequest) -> None:
    """List the games; of one, its conditions, measures and options.

    Examples:
        sim2vr-harness games
        sim2vr-harness games beats
    """
    request.library()
    name = request.name
    facts = [describe_game(each) for each in ([name] if name else sorted(list_games()))]
    if request.json:
        print_json(
            [
                {**asdict(each), "options": [asdict(option) for option in list_options(each.name)]}
                for each in facts
            ]
        )
        return
    console = Console()
    for each in facts:
        console.print(f"[bold]{each.name}[/bold]  {each.description}", highlight=False)
        if name is None:
            console.print(_in_short(each), style="dim", highlight=False, markup=False)
        else:
            console.print(_in_short(each), highlight=False, markup=False)
            table = Table("Condition", "What it is", box=box.SIMPLE)
            for condition in each.conditions:
                mark = " (default)" if condition.name == each.default_condition else ""
                table.add_row(condition.name, condition.description + mark)
            console.print(table)
            console.print(_measures(each) if each.measures else "No measures but the player's own.")
            console.print(_options(each.name))


def _in_short(facts: GameFacts) -> str:
    length = f"rounds of {facts.round_seconds:g} s; " if facts.round_seconds else ""
    count = len(facts.conditions)
    conditions = f"{count} condition{'' if count == 1 else 's'}"
    return f"{length}Gymnasium id sim2vr/{facts.id}-v0; {conditions}"


def _measures(facts: GameFacts) -> Table:
    table = Table(box=box.SIMPLE, padding=(0, 1))
    for heading in ("Measure", "Key", "Unit", "Better", "What it is"):
        table.add_column(heading, no_wrap=heading == "Key")
    for measure in facts.measures:
        better = "" if measure.better == "none" else measure.better
        table.add_row(measure.label, measure.name, measure.unit, better, measure.description)
    return table


def _options(game: str) -> Table:
    title = "Options: --set env.app.options.NAME=VALUE"
    table = Table(
        *("Option", "Type", "Default", "Range"),
        title=title,
        title_justify="left",
        box=box.SIMPLE,
        padding=(0, 1),
    )
    for option in list_options(game):
        default = option.default if isinstance(option.default, str) else None
        shown = jsonlib.dumps(option.default) if default is None else default
        table.add_row(option.name, option.type, shown, option.range)
    return table
