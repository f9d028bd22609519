"""``sim2vr-harness export``: an evaluation's steps for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.cli.options import print_written, writable_folder


def export(
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="FOLDER",
            help="Of an evaluation or study that kept its steps; with --iwer also a session.",
        ),
    ],
    episode: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY", help="A key of the table episodes; may be repeated.", show_default="all"
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder for the files.",
            show_default="opensim, csv or iwer",
            callback=writable_folder,
        ),
    ] = None,
    csv: Annotated[
        bool, typer.Option("--csv", help="Write the tables as CSV files instead.")
    ] = False,
    iwer: Annotated[
        bool, typer.Option("--iwer", help="Write recordings for IWER's ActionPlayer instead.")
    ] = False,
) -> None:
    """Write rounds for OpenSim, as CSV, or for tests of WebXR pages.

    Angles go to .mot files, activations and forces to .sto files. Of a study, every cell has a
    folder of its name. With --csv, every table goes to a .csv file. With --iwer, head,
    controllers and inputs of a round go to one .json file.

    Examples:
        sim2vr-harness export evaluation/sample --out opensim/sample
        sim2vr-harness export evaluation/buttons --iwer --out tests/fixtures
    """
    from sim2vr_harness.evaluation.data import EvaluationData, export_opensim, read_data
    from sim2vr_harness.studies.data import STUDY_FILE, read_study

    if csv and iwer:
        raise InputError("--csv", "it together with --iwer", "one of them")
    if iwer:
        print_written(_iwer_files(folder, out or Path("iwer"), episode or []))
        return
    write = EvaluationData.export_csv if csv else export_opensim
    out = out or Path("csv" if csv else "opensim")
    if (folder / STUDY_FILE).is_file():
        files = read_study(folder).export(write, out, episode or ())
        if csv:  # the study's own tables, beside the folders of its cells
            files = read_data(folder).export_csv(out) + files
    else:
        files = write(read_data(folder), out, episode or ())
    print_written(files)


def _iwer_files(source: Path, out: Path, episodes: list[str]) -> list[Path]:
    """Write a recording per episode, or that of a session."""
    from sim2vr_harness.evaluation.data import read_data, session_of_steps
    from sim2vr_harness.sessions import read_session
    from sim2vr_harness.sessions.iwer import write_iwer

    if source.is_file() or (source / "states.csv").is_file():
        if episodes:
            raise InputError("--episode", "it with a session", "it with an evaluation")
        file = out / f"{source.name.split('.')[0]}.json"
        write_iwer(read_session(source), file)
        return [file]
    data = read_data(source)
    files = []
    for episode in data.episode_keys(episodes):
        files.append(out / f"{episode}.json")
        write_iwer(session_of_steps(data, episode), files[-1])
    return files
