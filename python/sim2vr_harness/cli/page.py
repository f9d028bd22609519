"""``sim2vr-harness page``: what a WebXR page needs, and the npm packages behind its addresses."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from sim2vr_harness.base.requests import argument, option
from sim2vr_harness.cli.app_options import PageFiles, mapped_places, page_and_options
from sim2vr_harness.cli.command import CommandGroup
from sim2vr_harness.cli.options import JsonOutput, print_json

if TYPE_CHECKING:
    pass

MOST_ROUNDS = 8
"""Loads of a page, each of which may bring scripts that ask for more."""


@dataclass(frozen=True, kw_only=True)
class PageRequest(PageFiles):
    """A page, and where it finds its files."""

    page: str = argument("PAGE", "A file, a folder, or a mapped address.")


@dataclass(frozen=True, kw_only=True)
class CheckRequest(PageRequest, JsonOutput):
    """What to check."""

    seconds: float = option("How many seconds to play.", 2.0)


@dataclass(frozen=True, kw_only=True)
class VendorRequest(PageRequest):
    """What to fetch."""

    out: Path = option(
        "Folder for the packages and their map.", Path("engines"), place="folder to write"
    )
    yes: bool = option("Do not ask before npm fetches.", False)


def check(request: CheckRequest) -> int:
    """List what a page asks for, is made of and lacks, and whether it plays.

    The exit status is 0 if it plays.

    Examples:
        sim2vr-harness page check game.html
        sim2vr-harness page check game.html --map engines/map.json
    """
    from sim2vr_harness.client.webxr.app import check_page

    place, options = page_and_options(request.page)
    places = mapped_places(request.map_)
    found = check_page(place, places, request.browser, options, seconds=request.seconds)
    if request.json:
        print_json({**asdict(found), "missing": found.missing, "plays": found.failure is None})
    else:
        # Report, a line for each thing.
        report, missing = found.report, found.missing
        rows = [
            ("engine", report.engines),
            ("sessions", report.sessions),
            ("features", report.features),
            ("objects", report.objects),
            ("inputs", report.inputs),
            ("addresses", [each for each in found.asked if each not in missing]),
            ("missing", [f"{address}  ({help})" for address, help in missing.items()]),
            ("notes", [note for note in found.notes if note.startswith("script error")]),
        ]
        lines = []
        for name, values in rows:
            long = name in ("addresses", "missing", "notes")
            shown = list(values) if long else [", ".join(values)]
            lines += [
                f"{name if k == 0 else '':<10} {value or 'none'}"
                for k, value in enumerate(shown or ["none"])
            ]
        lines.append(f"{'plays':<10} {'yes' if found.failure is None else f'no: {found.failure}'}")
        typer.echo("\n".join(lines))
    return int(found.failure is not None)


def vendor(request: VendorRequest) -> int:
    """Fetch the npm packages behind a page's addresses, and write a map file for --map.

    npm fetches, from its cache where it can; no script of a package runs. Addresses of jsdelivr,
    unpkg, cdnjs, skypack, esm.sh and of the engines' own hosts are known.

    Examples:
        sim2vr-harness page vendor game.html
        sim2vr-harness page vendor game.html --out engines --yes
    """
    from sim2vr_harness.client.webxr.app import check_page
    from sim2vr_harness.client.webxr.vendor import MAP_FILE, packages_behind, read_map
    from sim2vr_harness.client.webxr.vendor import vendor as fetch

    places, file = mapped_places(request.map_), request.out / MAP_FILE
    place, options = page_and_options(request.page)
    tried: set[str] = set()
    for _ in range(MOST_ROUNDS):
        known = {**places, **(read_map(file) if file.exists() else {})}
        found = check_page(place, known, request.browser, options, seconds=0.5)
        packages, without = packages_behind(
            address for address in found.missing if address not in tried
        )
        for one in without:
            typer.echo(f"{one.address}: {one.why}", err=True)
        tried.update(found.missing)
        if not packages:
            break
        typer.echo("npm packages: " + ", ".join(sorted({each.spec for each in packages})))
        if not request.yes and not typer.confirm(f"Fetch them into {request.out}?"):
            return 1
        for one in fetch(packages, request.out):
            typer.echo(f"{one.address}: {one.why}", err=True)
    if file.exists():
        typer.echo(f"Written: {file}")
    if found.failure is not None:
        typer.echo(f"does not play: {found.failure}", err=True)
        return 1
    with_map = f" --map {file}" if file.exists() else ""
    typer.echo(f"It plays: sim2vr-harness render snapshot --page {request.page}{with_map}")
    return 0


app = CommandGroup(
    """Check a WebXR page; fetch the npm packages that it needs.

    Examples:
        sim2vr-harness page check game.html
        sim2vr-harness page vendor game.html
    """
)
app.add("check", check)
app.add("vendor", vendor)
