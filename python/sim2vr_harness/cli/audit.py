"""``sim2vr-harness audit``: who can use an app, and how hard it is."""

from __future__ import annotations

import json
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from sim2vr_harness.base.requests import ChangedEnvironment, TrustedApp, option
from sim2vr_harness.cli.app_options import PageOptions
from sim2vr_harness.cli.options import (
    CheckedRun,
    Expected,
    GameConditions,
    print_written,
)
from sim2vr_harness.cli.progress import say

if TYPE_CHECKING:
    from sim2vr_harness.audit.auditing import AuditRequest
    from sim2vr_harness.evaluation.expectations import Planned


@dataclass(frozen=True, kw_only=True)
class AuditOptions(GameConditions, Expected, ChangedEnvironment, TrustedApp, PageOptions):
    """The targets of an audit, and its persons."""

    game: str | None = option(
        "Targets of a game, found by running it.", metavar="NAME", names="games"
    )
    objects: str | None = option(
        "Which of the game's objects are targets, with * and ?, by their names.",
        metavar="NAME",
        shown="those that come, go or move, and small ones",
    )
    targets: tuple[str, ...] = option(
        "A file of targets (name, place or object, how, hold_s and more), the log of a round, or a "
        "place, [NAME=]X,Y,Z in m to the right, up and ahead; may be repeated.",
        (),
        metavar="SOURCE",
    )
    session: Path | None = option(
        "Targets are where a recorded session's hands pressed a trigger or squeeze.",
        metavar="FILE",
        place="file to read",
    )
    how: str = option("What is done with a game's targets: touch or point.", "touch", metavar="HOW")
    seconds: float = option("How long to look at each round of the game, or at the page.", 10.0)
    user: str | None = option(
        "Audit this user alone: a body or its YAML file, a configuration, or a trained user. Draws "
        "the hull of what it reaches.",
        metavar="USER",
        names="users",
    )
    point: str | None = option(
        "With --user: what is to get there, a device or part of the body.",
        metavar="PART",
        shown="the first controller",
    )
    tool: str | None = option(
        "With --user: an object that the game puts in the hand, for --point.", metavar="NAME"
    )
    cell: float = option("With --user: edge of the cells of the hull, m.", 0.05)
    pose: str | None = option(
        "With --user: how long this posture can be held. Other joints stay where episodes start; "
        "one without _r or _l is that of both arms.",
        metavar="JOINT=DEGREES,...",
    )
    load: float = option("With --pose: mass in each hand, kg, beside the controller.", 0.0)
    people: int | None = option(
        "Persons, 1 to 10,000; with --user of its population.",
        metavar="N",
        shown="500; with --user it alone",
    )
    stance: str = option("Of the persons: seated or standing.", "seated", metavar="STANCE")
    pace: float = option("Uses of a target in a minute.", 20.0, metavar="N")
    operate: int = option("How many persons act it out.", 0, metavar="N")
    seed: int = option("Other persons for another seed.", 1)
    out: Path = option("Folder for the files.", Path("audit"), place="folder to write")


def audit(options: AuditOptions) -> int:
    """Say who can see, reach and hold an app's targets.

    Examples:
        sim2vr-harness audit --page shop.html --people 100
        sim2vr-harness audit --user mobl_arms_wrist --targets shelf=0.3,1.6,0.5
    """
    from sim2vr_harness.audit.auditing import AuditRequest, population_audit
    from sim2vr_harness.audit.summary import estimates
    from sim2vr_harness.base.optional import needed

    names = {each.name for each in fields(AuditRequest)} - {"overrides", "remote"}
    request = AuditRequest(
        **{name: getattr(options, name) for name in names},
        overrides=options.overrides,
        remote=options.remote(),
    )
    if request.pose is None:
        needed("plotly", "studies", "audit")
    request.check()
    # Expectations without a group are about everyone.
    from sim2vr_harness.audit.summary import EVERYONE
    from sim2vr_harness.evaluation.expectations import Expectation

    with_group = tuple(
        text if Expectation.of(text).group is not None else f"{EVERYONE}: {text}"
        for text in options.expect
    )
    checked = CheckedRun(replace(options, expect=with_group), "audit")
    if request.user is not None:
        _of_user(request, options.out)
        return 0
    if checked.asked:
        checked.prepare(_planned(request))
    done = population_audit(request, say)
    _tell(done, options.out)
    return checked.status(lambda: estimates(done))


def _of_user(request: AuditRequest, out: Path) -> None:
    """Print and write what a user reaches, or how long it holds a posture."""
    from sim2vr_harness.audit import hull, postures
    from sim2vr_harness.audit.auditing import posture_endurance, user_reach
    from sim2vr_harness.base.files import write_atomically

    if request.pose is None:
        found = user_reach(request, say)
        typer.echo("\n".join(hull.told(found)))
        print_written(hull.write(found, out))
        return
    held = posture_endurance(request)
    for arms in zip(*held, strict=True):
        typer.echo("\n".join(postures.told(arms, request.load)))
    asked = {"user": request.user, "pose": request.pose, "load_kg": request.load}
    persons = [[postures.plain(arm) for arm in person] for person in held]
    out.mkdir(parents=True, exist_ok=True)
    text = json.dumps(asked | {"persons": persons}, indent=2, allow_nan=False)
    write_atomically(out / "postures.json", text.encode() + b"\n")
    print_written([out / "postures.json"])


def _tell(done: Any, out: Path) -> None:
    """Print what was found, and write the report."""
    from sim2vr_harness.audit.report import findings, headline, unanswered, write
    from sim2vr_harness.audit.summary import plain

    values = plain(done)
    for sentence in (headline(values), *findings(values), unanswered(values)):
        if sentence:
            typer.echo(sentence)
    print_written(write(done, out))


def _planned(request: AuditRequest) -> Planned:
    from sim2vr_harness.audit.auditing import limitations_of
    from sim2vr_harness.audit.population import GROUPS
    from sim2vr_harness.audit.summary import EVERYONE, MEASURES
    from sim2vr_harness.evaluation.expectations import Planned

    limited = (each.name for each in limitations_of(request.stance))
    return Planned((EVERYONE, *GROUPS, *limited), MEASURES, ())
