"""``sim2vr-harness audit``: who can use an app, and how hard it is."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sim2vr_harness.cli.app_options import with_page_options
from sim2vr_harness.cli.options import (
    CheckedRun,
    ConditionsOption,
    EnvSetOption,
    ExpectOption,
    JunitOption,
    TrustOption,
    finite,
    known_games,
    known_users,
    print_written,
    readable_file,
    writable_folder,
)
from sim2vr_harness.cli.progress import say

if TYPE_CHECKING:
    from sim2vr_harness.audit.auditing import AuditRequest
    from sim2vr_harness.evaluation.expectations import Planned

_Game = Annotated[
    str | None,
    typer.Option(
        autocompletion=known_games, metavar="NAME", help="Targets of a game, found by running it."
    ),
]
_Objects = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Which of the game's objects are targets, with * and ?, by their names.",
        show_default="those that come, go or move, and small ones",
    ),
]
_Targets = Annotated[
    list[str] | None,
    typer.Option(
        metavar="SOURCE",
        help="A file of targets (name, place or object, how, hold_s and more), the log of a round, "
        "or a place, [NAME=]X,Y,Z in m to the right, up and ahead; may be repeated.",
    ),
]
_User = Annotated[
    str | None,
    typer.Option(
        autocompletion=known_users,
        metavar="USER",
        help="Audit this user alone: a body or its YAML file, a configuration, or a trained user. "
        "Draws the hull of what it reaches.",
    ),
]
_Point = Annotated[
    str | None,
    typer.Option(
        metavar="PART",
        help="With --user: what is to get there, a device or part of the body.",
        show_default="the first controller",
    ),
]
_Tool = Annotated[
    str | None,
    typer.Option(
        metavar="NAME", help="With --user: an object that the game puts in the hand, for --point."
    ),
]
_Cell = Annotated[
    float,
    typer.Option(help="With --user: edge of the cells of the hull, m.", callback=finite),
]
_Pose = Annotated[
    str | None,
    typer.Option(
        metavar="JOINT=DEGREES,...",
        help="With --user: how long this posture can be held. Other joints stay where episodes "
        "start; one without _r or _l is that of both arms.",
    ),
]
_Load = Annotated[
    float,
    typer.Option(
        help="With --pose: mass in each hand, kg, beside the controller.", callback=finite
    ),
]
_How = Annotated[
    str, typer.Option(metavar="HOW", help="What is done with a game's targets: touch or point.")
]
_Seconds = Annotated[
    float,
    typer.Option(
        help="How long to look at each round of the game, or at the page.", callback=finite
    ),
]
_People = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        help="Persons, 1 to 10,000; with --user of its population.",
        show_default="500; with --user it alone",
    ),
]
_Stance = Annotated[str, typer.Option(metavar="STANCE", help="Of the persons: seated or standing.")]
_Pace = Annotated[
    float, typer.Option(metavar="N", help="Uses of a target in a minute.", callback=finite)
]
_Operate = Annotated[int, typer.Option(metavar="N", help="How many persons act it out.")]
_Session = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Targets are where a recorded session's hands pressed a trigger or squeeze.",
        callback=readable_file,
    ),
]
_Seed = Annotated[int, typer.Option(help="Other persons for another seed.")]
_Out = Annotated[Path, typer.Option(help="Folder for the files.", callback=writable_folder)]


@with_page_options
def audit(
    game: _Game = None,
    condition: ConditionsOption = None,
    objects: _Objects = None,
    targets: _Targets = None,
    session: _Session = None,
    how: _How = "touch",
    seconds: _Seconds = 10.0,
    user: _User = None,
    point: _Point = None,
    tool: _Tool = None,
    cell: _Cell = 0.05,
    pose: _Pose = None,
    load: _Load = 0.0,
    people: _People = None,
    stance: _Stance = "seated",
    pace: _Pace = 20.0,
    operate: _Operate = 0,
    seed: _Seed = 1,
    out: _Out = Path("audit"),
    expect: ExpectOption = None,
    junit: JunitOption = None,
    overrides: EnvSetOption = None,
    trust_app: TrustOption = False,
    remote: Mapping[str, Any] | None = None,
) -> int:
    """Say who can see, reach and hold an app's targets.

    Examples:
        sim2vr-harness audit --page shop.html --people 100
        sim2vr-harness audit --user mobl_arms_wrist --targets shelf=0.3,1.6,0.5
    """
    from sim2vr_harness.audit.auditing import AuditRequest, population_audit
    from sim2vr_harness.audit.summary import estimates
    from sim2vr_harness.base.optional import needed

    # fmt: off
    request = AuditRequest(
        game=game, condition=condition or (), objects=objects, targets=targets or (),
        session=session, how=how, seconds=seconds, user=user, point=point, tool=tool, cell=cell,
        pose=pose, load=load, people=people, stance=stance, pace=pace, operate=operate, seed=seed,
        expect=expect or (), overrides=overrides or (), trust_app=trust_app, remote=remote or {},
    )
    # fmt: on
    if pose is None:
        needed("plotly", "studies", "audit")
    request.check()
    checked = CheckedRun(_with_group(expect), None, junit, "audit")
    if user is not None:
        _of_user(request, out)
        return 0
    if checked.asked:
        checked.prepare(_planned(request))
    done = population_audit(request, say)
    _tell(done, out)
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


def _with_group(expect: list[str] | None) -> list[str] | None:
    """Expectations without a group are about everyone."""
    from sim2vr_harness.audit.summary import EVERYONE
    from sim2vr_harness.evaluation.expectations import Expectation

    return [
        text if Expectation.of(text).group is not None else f"{EVERYONE}: {text}"
        for text in expect or ()
    ] or None


def _planned(request: AuditRequest) -> Planned:
    from sim2vr_harness.audit.auditing import limitations_of
    from sim2vr_harness.audit.population import GROUPS
    from sim2vr_harness.audit.summary import EVERYONE, MEASURES
    from sim2vr_harness.evaluation.expectations import Planned

    limited = (each.name for each in limitations_of(request.stance))
    return Planned((EVERYONE, *GROUPS, *limited), MEASURES, ())
