"""``sim2vr-harness users``: trained users and bodies: list, look, pack, export."""

from __future__ import annotations

import json as jsonlib
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any

import pydantic
import typer
from rich import box
from rich.console import Console
from rich.table import Table

from sim2vr_harness.base.files import read_json
from sim2vr_harness.base.requests import TrustedApp, argument, option
from sim2vr_harness.cli import motor
from sim2vr_harness.cli.command import CommandGroup
from sim2vr_harness.cli.options import JsonOutput, print_json, print_written
from sim2vr_harness.cli.progress import Share
from sim2vr_harness.client import Measure
from sim2vr_harness.evaluation.tables import cell

if TYPE_CHECKING:
    from sim2vr_harness.policies.store import TrainedUser
    from sim2vr_harness.users import Physique


@dataclass(frozen=True, kw_only=True)
class ListRequest(JsonOutput):
    """What to list."""


@dataclass(frozen=True, kw_only=True)
class ShowRequest(JsonOutput):
    """Which user to show."""

    name: str = argument(
        "NAME", "A name of `sim2vr-harness users list`, or a folder.", names="users"
    )


@dataclass(frozen=True, kw_only=True)
class GetRequest:
    """Which users to fetch, and where they are."""

    name: tuple[str, ...] = argument("NAME...", "Names of `sim2vr-harness users list`.")
    source: str = option(
        "Folder or http(s) address with a folder for each user.",
        MISSING,
        name="--from",
        metavar="PLACE",
    )


@dataclass(frozen=True, kw_only=True)
class PackRequest(TrustedApp):
    """Which user to pack, and how to measure it."""

    run: str = argument("RUN", "A run's folder or a checkpoint.")
    name: str = argument("NAME", "What the user will be called.")
    out: Path = option("Folder that gets a folder NAME.", MISSING, place="folder to write")
    description: str = option("A sentence on who it is.", "")
    condition: tuple[str, ...] = option("A condition to measure; may be repeated.", ())
    episodes: int = option("Rounds per condition.", 12)
    other_seed: tuple[str, ...] = option(
        "The same training with another seed; may be repeated. The one in the middle is packed, "
        "and the card shows all.",
        (),
        metavar="RUN",
    )
    details: Path | None = option("JSON object with further entries of the card.")


@dataclass(frozen=True, kw_only=True)
class ExportRequest(TrustedApp):
    """A body to write, and the person who has it."""

    name: str = argument("NAME", "A body's name, or a YAML file that describes one.")
    file: Path = argument("FILE", "MJCF file to write, such as body.xml.", place="file to write")
    stature_m: float | None = option("Body height in m.")
    mass_kg: float | None = option("Body mass in kg.")
    segment: tuple[str, ...] = option(
        "Length of a segment in m; may be repeated.", (), metavar="NAME=M"
    )
    strength: float = option("Factor on peak forces.", 1.0)
    hand: str | None = option("right or left: the hand that plays.")
    skull_rotation_deg: float = option("How far the head looks down, degrees.", 10.0)
    torso: bool = option("With a trunk and a neck that move.", False)


def list_users(request: ListRequest) -> None:
    """List the trained users that are here, and those that can be fetched.

    `sim2vr-harness evaluate pretrained:NAME` lets one play.

    Examples:
        sim2vr-harness users list
        sim2vr-harness users list --json
    """
    from sim2vr_harness.policies.store import list_cards, more_users

    cards = list_cards()
    if request.json:
        print_json(cards)
        return
    if not cards:
        typer.echo("No trained users are installed.")
        return
    table = Table("User", "Game", "Recipe", "Mean over conditions", box=box.SIMPLE, padding=(0, 1))
    for card in cards:
        table.add_row(
            card["name"], card["contract"]["game"], card.get("recipe", ""), _headline(card)
        )
    Console().print(table)
    typer.echo("More on one: sim2vr-harness users show NAME")
    if more := sorted(more_users().keys() - {card["name"] for card in cards}):
        typer.echo("More, with sim2vr-harness users get NAME --from PLACE:")
        typer.echo(fill(", ".join(more), 78, initial_indent="  ", subsequent_indent="  "))


def _headline(card: Mapping[str, Any]) -> str:
    """The game's score, mean over the measured conditions."""
    from sim2vr_harness.client import facts_of_outside
    from sim2vr_harness.evaluation.packing import card_measures

    score = card_measures(facts_of_outside(card["contract"]["game"]))[0]
    found = [row.get(score.name) for row in card.get("results", {}).values()]
    values = [value for value in found if value is not None]
    if not values:
        return "not measured"
    mean = cell(sum(values) / len(values), None, _digits(score))
    return f"{score.label} {mean} {score.unit}".strip()


def _seed(card: Mapping[str, Any]) -> str:
    seeds = ", ".join(map(str, card["seeds"]))
    return f"seed {card['seed']} of {seeds}" if "seed" in card else f"seed {seeds}"


def _results(card: Mapping[str, Any]) -> Table:
    from sim2vr_harness.client import facts_of_outside
    from sim2vr_harness.evaluation.packing import card_measures

    seeds = card.get("seed_results", {})
    measures = card_measures(facts_of_outside(card["contract"]["game"]))
    table = Table("Condition", box=box.SIMPLE)
    for measure in measures:
        table.add_column(measure.heading, justify="right")
    table.add_column("Rounds", justify="right")
    if seeds:
        table.add_column(f"{measures[0].label} of {len(seeds)} seeds", justify="right")
    for condition, row in card.get("results", {}).items():
        cells = [cell(row.get(measure.name), None, _digits(measure)) for measure in measures]
        cells.append(str(row["episodes"]))
        if seeds:
            cells.append(_spread(card, condition, measures[0]))
        table.add_row(condition, *cells)
    return table


def _digits(measure: Measure) -> int:
    """One fewer than in a table of an evaluation, which has deviations."""
    return max(0, measure.digits - 1)


def _spread(card: Mapping[str, Any], condition: str, measure: Measure) -> str:
    """The least and the highest of all seeds."""
    found = [rows[condition].get(measure.name) for rows in card["seed_results"].values()]
    known = [value for value in found if value is not None]
    digits = _digits(measure)
    return f"{min(known):.{digits}f}-{max(known):.{digits}f}" if known else "-"


def show(request: ShowRequest) -> None:
    """Print what a trained user is, its results, and how to use it.

    Examples:
        sim2vr-harness users show whacamole_people
        sim2vr-harness users show whacamole_people --json
    """
    from sim2vr_harness.policies.store import find_user

    name = request.name
    user = find_user(name if Path(name).exists() else f"pretrained:{name.split(':')[-1]}")
    if request.json:
        print_json(user.card)
        return
    console = Console()
    for heading, lines in _sections(user, name):
        if heading == "Use" and user.card.get("results"):
            console.print("Results", style="bold")
            console.print(_results(user.card))
        console.print(heading, style="bold", highlight=False)
        for line in lines:
            console.print(f"  {line}", highlight=False, markup=False, soft_wrap=True)


def _sections(user: TrainedUser, name: str) -> Iterator[tuple[str, list[str]]]:
    """Yield headings and lines of a user's page, the results left out."""
    card, env = user.card, user.config.env
    terms = card.get("contract") or user.env.contract
    called = user.source.parent.name if Path(name).exists() else f"pretrained:{card['name']}"
    yield called, [card.get("description") or f"Plays {env.app.game}."]
    options = [f"{key}: {value}" for key, value in env.app.options.items()]
    yield "App", [f"{env.app.transport}, game {env.app.game}", *options]
    people = "one body" if env.user.people is None else "another participant in every round"
    rate = f"{env.action_frequency_hz:g} user steps per second"
    motors = sum(len(names) - 1 for names in terms.get("actuators", ()))
    muscles = f"{len(terms['muscles'])} muscles" if terms["muscles"] else f"{motors} joint motors"
    yield "Body", [f"{env.user.model}, {muscles}; {people}; {rate}", f"action: {terms['action']}"]
    shapes = [
        f"{key}: {' x '.join(map(str, shape))} {kind}"
        for key, (shape, kind) in terms["observation"].items()
    ]
    width, height = terms["image"]
    pixels = f"image of {width} x {height} px, channels {', '.join(terms['channels'])}"
    yield "Observations", [pixels, *shapes]
    # How a user was trained, and for what environment, in a line.
    parts = [f"{card['steps']:,} user steps from pixels"]
    if "recipe" in card:
        parts.insert(0, f"recipe {card['recipe']}")
    if "minutes" in card:
        parts.append(f"{card['minutes']:.0f} minutes in all")
    if "machine" in card:
        parts.append(card["machine"])
    if "seeds" in card:
        parts.append(_seed(card))
    parts.append(f"environment contract {card['contract_hash']}")
    training = "; ".join(parts)
    yield "Training", [training]
    word = shlex.quote(name) if Path(name).exists() else called
    yield (
        "Use",
        [
            f"sim2vr-harness evaluate {word} --episodes 5",
            f"sim2vr-harness watch {word}",
            f"sim2vr-harness train --from {word} --out runs/more",
            f"sim2vr_harness.load_user_policy({word!r})  # in Python",
        ],
    )


def get(request: GetRequest) -> None:
    """Fetch trained users that are not part of the package.

    Each file must have the SHA-256 that the package knows. Afterwards they are called
    `pretrained:NAME`.

    Examples:
        sim2vr-harness users get beats_songs --from ~/Downloads/users
        sim2vr-harness users get beats_songs --from https://example.org/users
    """
    from sim2vr_harness.policies.store import fetch_user

    for name in request.name:
        typer.echo(f"Written: {fetch_user(name, request.source)}")


def pack(request: PackRequest) -> None:
    """Pack the user of a run, and measure what was packed.

    Examples:
        sim2vr-harness users pack runs/sample my_user --out users
        sim2vr-harness users pack runs/a mine --out users --other-seed runs/b
    """
    from sim2vr_harness.evaluation.packing import pack_measured

    details, out = request.details, request.out / request.name
    own = {} if details is None else read_json(details, "entries of the card in JSON")
    own |= {"description": request.description} if request.description else {}
    with Share("Measuring") as share:
        card = pack_measured(
            request.run,
            request.name,
            out,
            conditions=request.condition or None,
            episodes=request.episodes,
            details=own,
            other_seeds=request.other_seed,
            trust_app=request.trust_app,
            on_progress=share.show,
        )
    if request.other_seed:
        typer.echo(f"{_seed(card).capitalize()}:")
    Console().print(_results(card))
    typer.echo(f"Written: {out}")


def bodies(request: ListRequest) -> None:
    """List the bodies that `env.user.model` and `users export` take.

    Examples:
        sim2vr-harness users bodies
        sim2vr-harness users bodies --json
    """
    from sim2vr_harness.users import list_bodies

    names = list_bodies()
    typer.echo(jsonlib.dumps(names, indent=2) if request.json else "\n".join(names))


def export(request: ExportRequest) -> None:
    """Write a body, devices included, as MJCF that MuJoCo loads.

    `python -m mujoco.viewer --mjcf=FILE` (or mujoco-studio) shows it; where there is no display,
    MUJOCO_GL=egl or osmesa draws without one.

    Examples:
        sim2vr-harness users export mobl_arms_wrist body.xml
        sim2vr-harness users export mobl_arms_wrist tall.xml --stature-m 1.95
    """
    from sim2vr_harness.runs.trust import require_trusted_body
    from sim2vr_harness.users import load_body
    from sim2vr_harness.users.bodies.export import export_body

    name, person = request.name, _physique(request)
    require_trusted_body(name, name, trust=request.trust_app)
    skull = request.skull_rotation_deg
    body = load_body(name, person=person, skull_rotation_deg=skull, torso=request.torso)
    print_written(export_body(body, request.file))


def _lengths(segments: Sequence[str]) -> dict[str, float]:
    """Return lengths in m by segment, of ``NAME=M``."""
    from sim2vr_harness.base.errors import InputError

    lengths: dict[str, float] = {}
    for each in segments:
        part, _, length = each.partition("=")
        try:
            lengths[part] = float(length)
        except ValueError as error:
            raise InputError(
                "--segment", repr(each), "NAME=M, for example upper_arm=0.31"
            ) from error
    return lengths


def _physique(request: ExportRequest) -> Physique:
    """Return the person; a problem names the option."""
    from sim2vr_harness.base.errors import InputError
    from sim2vr_harness.users import Physique

    lengths = _lengths(request.segment)
    try:
        return Physique.model_validate(
            {
                "stature_m": request.stature_m,
                "mass_kg": request.mass_kg,
                "segment_lengths_m": lengths,
                "strength": request.strength,
                "handedness": request.hand,
            }
        )
    except pydantic.ValidationError as error:
        problem = error.errors()[0]
        option = {"handedness": "hand", "segment_lengths_m": "segment"}.get(
            str(problem["loc"][0]), str(problem["loc"][0]).replace("_", "-")
        )
        expected = str(problem["msg"]).removeprefix("Input should be ")
        raise InputError(f"--{option}", repr(problem["input"]), expected) from error


app = CommandGroup(
    """List, get and pack users; export bodies; train motor policies.

    Examples:
        sim2vr-harness users list
        sim2vr-harness users show whacamole_people
    """
)
app.add("list", list_users)
app.add("show", show)
app.add("get", get)
app.add("pack", pack)
app.add("bodies", bodies)
app.add("export", export)
app.add_typer(motor.app, name="motor")
