"""``sim2vr-harness audit``: who can use an app, and how hard it is."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from sim2vr_harness.audit.request import AuditRequest
from sim2vr_harness.cli.app_options import PageOptions
from sim2vr_harness.cli.options import (
    CheckedRun,
    print_written,
)
from sim2vr_harness.cli.progress import say

if TYPE_CHECKING:
    from sim2vr_harness.evaluation.expectations import Planned


@dataclass(frozen=True, kw_only=True)
class AuditOptions(AuditRequest, PageOptions):
    """The request, and the app."""


def audit(options: AuditOptions) -> int:
    """Say who can see, reach and hold an app's targets, and why not.

    Examples:
        sim2vr-harness audit --page shop.html --people 100
        sim2vr-harness audit --user mobl_arms_wrist --targets shelf=0.3,1.6,0.5
    """
    from sim2vr_harness.audit.auditing import population_audit
    from sim2vr_harness.audit.summary import estimates
    from sim2vr_harness.base.optional import needed

    request = replace(options, app=options.remote())
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
    if request.user is not None and request.script is None:
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
    from sim2vr_harness.audit.report import answers, headline, unanswered, write
    from sim2vr_harness.audit.summary import plain

    values = plain(done)
    rows = (", ".join(filter(None, row)) for row in answers(values))
    typer.echo("\n".join(filter(None, (headline(values), *rows, unanswered(values)))))
    print_written(write(done, out))


def _planned(request: AuditRequest) -> Planned:
    from sim2vr_harness.audit.auditing import limitations_of
    from sim2vr_harness.audit.population import GROUPS
    from sim2vr_harness.audit.summary import EVERYONE, MEASURES
    from sim2vr_harness.evaluation.expectations import Planned

    limited = (each.name for each in limitations_of(request.stance, request.recline))
    return Planned((EVERYONE, *GROUPS, *limited), MEASURES, ())
