"""``sim2vr-harness users``: the trained users that ship with the package, and how to add one."""

from __future__ import annotations

import json as jsonlib
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

app = typer.Typer(
    help="Trained users: list them, look at one, pack one of a run.", no_args_is_help=True
)

JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON, nothing else.")]


@app.command("list")
def list_users(json: JsonOption = False) -> None:
    """List the users that `sim2vr-harness evaluate pretrained:NAME` can play."""
    from sim2vr_harness.training.trained_users import list_cards

    cards = list_cards()
    if json:
        typer.echo(jsonlib.dumps(cards, indent=2))
        return
    if not cards:
        typer.echo("No trained users are installed.")
        return
    table = Table(title="Trained users", title_justify="left", title_style="bold")
    for heading in ("Name", "Recipe", "User steps", "Minutes", "Hit rate (hits) per condition"):
        table.add_column(heading, overflow="fold")
    for card in cards:
        table.add_row(
            f"pretrained:{card['name']}",
            str(card.get("recipe", "")),
            f"{card['steps']:,}",
            f"{card['minutes']:.0f}" if "minutes" in card else "",
            "\n".join(_result(card, name) for name in card.get("results", {})),
        )
    Console().print(table)


def _result(card: dict[str, Any], condition: str) -> str:
    row = card["results"][condition]
    if row["hit_rate"] is None:
        return f"{condition}: no targets in {row['episodes']} rounds"
    text = f"{condition}: {row['hit_rate']:.2f} ({row['hits']:.0f}), {row['episodes']} rounds"
    rates = [rows[condition]["hit_rate"] for rows in card.get("seed_results", {}).values()]
    if rates:
        text += f"; {len(rates)} seeds {min(rates):.2f}-{max(rates):.2f}"
    return text


@app.command()
def show(name: str) -> None:
    """Print everything that is known of a trained user."""
    from sim2vr_harness.training.trained_users import find_user

    user = find_user(name if Path(name).exists() else f"pretrained:{name.split(':')[-1]}")
    typer.echo(jsonlib.dumps(user.card, indent=2))


@app.command()
def pack(
    run: Annotated[str, typer.Argument(metavar="RUN", help="A run's folder or a checkpoint.")],
    name: Annotated[str, typer.Argument(help="What the user will be called.")],
    out: Annotated[Path, typer.Option(help="Folder that gets a folder NAME.")],
    description: Annotated[str, typer.Option(help="A sentence on who it is.")] = "",
    condition: Annotated[
        list[str] | None, typer.Option(help="A condition to measure; may be repeated.")
    ] = None,
    episodes: Annotated[int, typer.Option(help="Rounds per condition.")] = 12,
    other_seed: Annotated[
        list[str] | None,
        typer.Option(
            metavar="RUN",
            help="The same training with another seed; may be repeated. The one in the middle is "
            "packed, the card shows all.",
        ),
    ] = None,
    details: Annotated[
        Path | None, typer.Option(help="JSON object with further entries of the card.")
    ] = None,
) -> None:
    """Pack the user of a run, and measure what was packed."""
    from sim2vr_harness.evaluation.packing import pack_measured

    card = pack_measured(
        run,
        name,
        out / name,
        conditions=condition,
        episodes=episodes,
        details={
            **({} if details is None else jsonlib.loads(details.read_text(encoding="utf-8"))),
            **({"description": description} if description else {}),
        },
        other_seeds=other_seed or (),
    )
    if other_seed:
        typer.echo(f"Seed {card['seed']} of {', '.join(map(str, card['seeds']))}:")
    for condition_name in card["results"]:
        typer.echo(_result(card, condition_name))
    typer.echo(f"Written: {out / name}")
