"""``sim2vr-harness compare``: what users do beside what people do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rich.console import Console

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.requests import argument, option
from sim2vr_harness.cli.app_options import AppOptions
from sim2vr_harness.cli.options import (
    JsonOutput,
    print_json,
    print_written,
)
from sim2vr_harness.cli.progress import Share
from sim2vr_harness.evaluation.request import Plays


@dataclass(frozen=True, kw_only=True)
class CompareRequest(Plays, JsonOutput, AppOptions):
    """Users, recorded people, and what is played to compare them."""

    users: tuple[str, ...] = argument(
        "USER...",
        "A pretrained user, a run or a checkpoint, which plays; a folder of logged rounds; or a "
        "study (STUDY.yaml, or its folder), whose users are trained and played first if they were "
        "not. NAME=USER sets the name in tables and figures. If --recordings are sessions, USER "
        "may also be sessions, or a user without training such as 'touch NAME'.",
        names="users",
    )
    recordings: tuple[Path, ...] = option(
        "People's recorded rounds: packed with a manifest.json, or logs in a folder per person, or "
        "sessions of any app; may be repeated. Pointing needs none: figures are published.",
        (),
        metavar="PATH",
    )
    game: str | None = option(
        "The game.", metavar="NAME", shown="that of the first user", names="games"
    )
    conditions: Sequence[str] = option(
        "A condition to play; may be repeated.",
        (),
        name="--condition",
        metavar="NAME",
        shown="all compared, by the rules of the user's training",
    )
    group: tuple[str, ...] = option(
        "Play by the rules of a group of people (constrained, unconstrained), whatever the user "
        "was trained with; may be repeated.",
        (),
        metavar="NAME",
    )
    episodes: int | None = option(
        "Rounds per condition.", metavar="N", shown="6; beside sessions 2", least=1
    )
    seed: int | None = option("Seed of the first round.", 77, metavar="N")
    out: Path = option(
        "Folder for played rounds, JSON, CSV and figures; rounds that are there are used again.",
        Path("comparison"),
        place="folder to write",
    )
    unconstrained: bool = option("Count every touch of people as a hit (no speed rule).", False)
    figures: bool = option("Draw the figures.", True)
    every: bool = option("Print every measure.", False)


def compare(request: CompareRequest) -> None:
    """Compare users with recorded people: measures, range, distance.

    Examples:
        sim2vr-harness compare whacamole_people --recordings recordings
        sim2vr-harness compare 'touch ball' --recordings round.jsonl --page game.html
    """
    from sim2vr_harness.figures.matplotlib_backend import write_figure
    from sim2vr_harness.human_comparison.figures import figures_of
    from sim2vr_harness.human_comparison.files import as_json, write_csv, write_json, write_page
    from sim2vr_harness.human_comparison.report import ComparisonReport
    from sim2vr_harness.human_comparison.sources import read_sources
    from sim2vr_harness.human_comparison.tables import SETTLING, missing_values, report_tables

    users, told = _told_names(request.users)
    plays = replace(request, out=request.out / "rounds", app=request.remote())
    with Share("Comparing") as share:
        found = read_sources(
            [user for user in users if not _is_study(user)],
            request.recordings,
            plays,
            game=request.game,
            groups=request.group,
            unconstrained=request.unconstrained,
            on_progress=share.show,
        )
    sources = {user: [source] for user, source in found.users.items()}
    for user in filter(_is_study, users):
        # The users of a study, which is run first, or gone on with, if its file is given.
        from sim2vr_harness.cli.studies import Shown
        from sim2vr_harness.human_comparison.sources import read_folders
        from sim2vr_harness.studies import read_study, run_study
        from sim2vr_harness.studies.config import load_study
        from sim2vr_harness.studies.data import players_of

        path = Path(user)
        if path.is_dir():
            data = read_study(path)
        else:
            study = load_study(path)
            if not study.logs:
                raise InputError(
                    f"{user}: logs", "false", "true: what is compared is read from logs"
                )
            with Shown() as shown:
                place = request.out / "studies" / study.name
                data = run_study(
                    path, place, trust_app=plays.trust_app, on_progress=shown.show
                ).data
        players = players_of(data)
        sources[user] = [
            read_folders(name, folders, found.behaviour) for name, folders in players.items()
        ]
    read = [(user, source) for user in users for source in sources[user]]
    names = _names([(user, source.name) for user, source in read], told)
    named = [replace(source, name=name) for (_, source), name in zip(read, names, strict=True)]
    report = ComparisonReport(found.behaviour, found.people, named)
    files = [write_json(report, request.out / "comparison.json"), *write_csv(report, request.out)]
    figures = figures_of(report) if request.figures else []
    files += [write_figure(each, request.out / f"{each.key}.png") for each in figures]
    notes = (*(() if report.behaviour.aimed else (SETTLING,)), *missing_values(report))
    files += write_page(report, figures, request.out / "comparison.html", notes)
    if request.json:
        print_json(as_json(report))
        return
    Console().print(report_tables(report, every=request.every))
    print_written(files)


def _told_names(users: Sequence[str]) -> tuple[list[str], dict[str, str]]:
    """Users without the names that stand before them, and those names."""
    told: dict[str, str] = {}
    found = []
    for given in users:
        name, equals, user = given.partition("=")
        named = bool(equals) and not Path(given).exists()
        if not named:
            name, user = "", given
        elif not (name.strip() and user):
            raise InputError("USER", f"'{given}'", "NAME=USER with both of them")
        elif name in told.values():
            raise InputError("USER", f"the name '{name}' twice", "a name for each user")
        if user in told or (named and (user in found or _is_study(user))):
            expected = "a user once, and no name for a study, whose users have theirs"
            raise InputError("USER", f"'{given}'", expected)
        if named:
            told[user] = name
        found.append(user)
    return found, told


def _names(users: Sequence[tuple[str, str]], told: Mapping[str, str]) -> list[str]:
    """What users are called: as was said, or by their own names, told apart by where they are from.

    Args:
        users: what was given, and the name that it has of its own; folders such as step_1000 are
            called alike.
        told: names that were said, by what was given.
    """
    own = [name for _, name in users]

    def called(user: str, name: str) -> str:
        if user in told:
            return told[user]
        if own.count(name) == 1:
            return name
        return user if Path(user).name == name else f"{user} {name}"

    return [called(user, name) for user, name in users]


def _is_study(user: str) -> bool:
    """Whether a USER is a study: its file, or its folder."""
    path = Path(user)
    return (path.suffix in (".yaml", ".yml") and path.is_file()) or (path / "study.json").is_file()
