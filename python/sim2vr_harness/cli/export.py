"""``sim2vr-harness export``: an evaluation's steps for other programs."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.requests import argument, option
from sim2vr_harness.cli.options import print_written


@dataclass(frozen=True, kw_only=True)
class ExportRequest:
    """What to write, and as what."""

    folder: Path = argument(
        "FOLDER", "Folder of an evaluation or study with its steps; with --iwer also a session."
    )
    episode: tuple[str, ...] = option(
        "A key of the table episodes; may be repeated.", (), metavar="KEY", shown="all"
    )
    out: Path | None = option(
        "Folder for the files.", shown="opensim, csv or iwer", place="folder to write"
    )
    csv: bool = option("Write the tables as CSV files instead.", False)
    iwer: bool = option("Write recordings for IWER's ActionPlayer instead.", False)


def export(request: ExportRequest) -> None:
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

    folder, episodes, out = request.folder, request.episode, request.out
    if request.csv and request.iwer:
        raise InputError("--csv", "it together with --iwer", "one of them")
    if request.iwer:
        print_written(_iwer_files(folder, out or Path("iwer"), episodes))
        return
    write = EvaluationData.export_csv if request.csv else export_opensim
    out = out or Path("csv" if request.csv else "opensim")
    if (folder / STUDY_FILE).is_file():
        files = read_study(folder).export(write, out, episodes)
        if request.csv:  # the study's own tables, beside the folders of its cells
            files = read_data(folder).export_csv(out) + files
    else:
        files = write(read_data(folder), out, episodes)
    print_written(files)


def _iwer_files(source: Path, out: Path, episodes: Sequence[str]) -> list[Path]:
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
