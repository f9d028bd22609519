"""``sim2vr-harness rewards``: what the parts of a reward are worth."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from sim2vr_harness.cli.options import (
    EnvSetOption,
    TrustOption,
    game_option,
    known_users,
    print_written,
    writable_folder,
)

_User = Annotated[
    str,
    typer.Argument(
        autocompletion=known_users,
        metavar="USER",
        help="A configuration, a trained user, or a body: whose game, effort and muscles.",
    ),
]
_Terms = Annotated[
    Path | None,
    typer.Option(metavar="FILE.yaml", help="Terms of one's own instead of the game's."),
]
_Game = Annotated[
    str | None,
    game_option("Another game than that of a body or configuration.", "the user's"),
]
_Condition = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="The game's condition.", show_default="the user's"),
]
_Out = Annotated[Path, typer.Option(help="Folder for the files.", callback=writable_folder)]


def rewards(
    user: _User = "whacamole_constrained",
    terms: _Terms = None,
    game: _Game = None,
    condition: _Condition = None,
    out: _Out = Path("rewards"),
    set_: EnvSetOption = None,
    trust_app: TrustOption = False,
) -> None:
    """Print and draw what each term of a reward amounts to.

    Terms are summed over one movement and stand beside the cost of effort.

    Examples:
        sim2vr-harness rewards whacamole_constrained
        sim2vr-harness rewards pointing_people --out rewards/pointing
    """
    from sim2vr_harness.base.errors import InputError
    from sim2vr_harness.base.optional import needed
    from sim2vr_harness.envs.config import body_of
    from sim2vr_harness.games.registry import reward_terms, rewarding_games
    from sim2vr_harness.tools.rewards.contributions import contributions
    from sim2vr_harness.tools.rewards.description import read_terms
    from sim2vr_harness.tools.rewards.files import sums, write
    from sim2vr_harness.tools.rewards.warnings import warnings_of
    from sim2vr_harness.tools.users import environment_of, require_own_game

    needed("plotly", "studies", "rewards")
    own = None if terms is None else read_terms(terms)
    env = environment_of(
        user, game=game, condition=condition, overrides=set_ or (), trust_app=trust_app
    )
    if own is None:
        require_own_game(user, env)
        if env.app.game not in rewarding_games():
            expected = f"--terms FILE.yaml, or a game of {', '.join(rewarding_games())}"
            raise InputError("--game", repr(env.app.game), expected)
        own = reward_terms(env.app.game, env.app.options)
    found = contributions(
        own, env.user.effort, body_of(env.user), frequency_hz=env.action_frequency_hz
    )
    told = warnings_of(found)
    header, rows = sums(found)
    _print(header, rows, f"{own.name}: one target, {own.start_m:g} m, {own.seconds:g} s")
    for line in told:
        typer.echo(f"note: {line}")
    print_written(write(found, told, out))


def _print(header: Sequence[str], rows: Sequence[Sequence[str]], title: str) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table(*header, title=title)
    for row in rows:
        table.add_row(*row)
    Console().print(table)
