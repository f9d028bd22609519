"""Compare what the commands do with the golden files beside this script, or update the files.

python tests/golden/golden.py compare [--bits] [NAME ...]
python tests/golden/golden.py update [NAME ...]
"""

import argparse
import dataclasses
import difflib
import hashlib
import io
import json
import re
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
RECORDING = ROOT / "tests" / "data" / "whacamole_reaches"
USERS = ROOT / "python" / "sim2vr_harness" / "trained_users"

# Closed loops amplify the last bit, which differs between processors, so these bounds are wide.
RELATIVE = 0.1  # of the golden value
ABSOLUTE = {"count": 1.0, "number": 0.05}  # counts: whole numbers, such as hits

_SECONDS = 2.0  # of a round
_NUMBERS = re.compile(r"(head|right|left)_[xyz]_m|q_elbow_flexion.*|.*reward.*|.*effort.*")
_SHORT = [f"env.max_episode_seconds={_SECONDS}", "env.cores=1"]
_PPO = [
    *("recipe=ppo", "device=cpu", "total_timesteps=16", "evaluation.episodes_after_training=0"),
    *("ppo.n_envs=2", "ppo.n_steps=8", "ppo.batch_size=8", "ppo.n_epochs=1"),
]
_TOUCH = "touch ball"

Golden = dict[str, Any]


def run(*arguments: str | Path) -> str:
    """Run a command and return what it prints."""
    from sim2vr_harness.cli.main import main

    text = io.StringIO()
    with redirect_stdout(text):
        try:
            main([str(each) for each in arguments])
        except SystemExit as end:
            if end.code:
                raise RuntimeError(
                    f"{arguments}: exit status {end.code}\n{text.getvalue()}"
                ) from end
    return text.getvalue()


def changes(*settings: str) -> list[str]:
    return [part for setting in settings for part in ("--set", setting)]


# --- what is kept of a file ----------------------------------------------------------------------


def plain(value: Any, folder: Path) -> Any:
    """Return a JSON value without the places of files, which differ between checkouts."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
        return {"is": type(value).__name__, **plain(fields, folder)}
    if isinstance(value, dict):
        return {str(key): plain(each, folder) for key, each in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist(), folder)
    if isinstance(value, list | tuple):
        return [plain(each, folder) for each in value]
    if isinstance(value, float) and not np.isfinite(value):
        return str(value)
    if isinstance(value, str | Path):
        return str(value).replace(str(folder), "OUT").replace(str(ROOT), "ROOT")
    return value


def digest(value: Any) -> str:
    text = json.dumps(value, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def leaves(value: Any, name: str = "") -> Iterator[tuple[str, float]]:
    """Yield every number of a JSON value by its path."""
    if isinstance(value, dict):
        for key, each in value.items():
            yield from leaves(each, f"{name}/{key}" if name else str(key))
    elif isinstance(value, list):
        for index, each in enumerate(value):
            yield from leaves(each, f"{name}/{index}")
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield name, value


def document(value: Any, folder: Path, keep: str = ".*") -> Golden:
    """Return a JSON value as its hash and its numbers."""
    value = plain(value, folder)
    numbers = {name: number for name, number in leaves(value) if re.fullmatch(keep, name)}
    return {"sha256": digest(value), "numbers": numbers}


def table(file: Path, folder: Path) -> Golden:
    """Return a table as the hash of its columns' values and the means of some columns."""
    import pyarrow.parquet as parquet

    found = parquet.read_table(file)
    total = hashlib.sha256()
    for name in sorted(found.column_names):
        column = found.column(name)
        values = column.to_pylist()
        total.update(f"{name} {column.type} ".encode())
        total.update(digest(plain(values, folder)).encode())
    numbers: dict[str, float] = {"rows": found.num_rows}
    for name in found.column_names:
        if _NUMBERS.fullmatch(name):
            values = [v for v in found.column(name).to_pylist() if isinstance(v, int | float)]
            if values:
                numbers[f"mean {name}"] = float(np.mean(values))
    return {"sha256": total.hexdigest(), "numbers": numbers}


def evaluation(folder: Path) -> Golden:
    """Return results.json and the tables of an evaluation."""
    found: Golden = {}
    for file in sorted(folder.rglob("results.json")):
        results = json.loads(file.read_text(encoding="utf-8"))
        # One line for each muscle and each missing deviation would hide the rest.
        kept = r"(?!.*(_sd$|fatigue\.[A-Z]|cell_hit_rates)).*"
        found[str(file.relative_to(folder))] = document(results, folder, kept)
    for file in sorted(folder.rglob("*.parquet")):
        found[str(file.relative_to(folder))] = table(file, folder)
    return found


# --- subjects ------------------------------------------------------------------------------------


def shipped(name: str) -> Callable[[Path], Golden]:
    def play(out: Path) -> Golden:
        import yaml

        config = yaml.safe_load((USERS / name / "config.yaml").read_text(encoding="utf-8"))
        conditions = config["evaluation"]["conditions"]
        # A hit that nearly fails differs between processors; those of the condition medium do not.
        chosen = "medium" if "medium" in conditions else conditions[0] if conditions else None
        condition = ["--condition", chosen] if chosen else []
        how = ["--episodes", "1", *condition, *changes(*_SHORT)]
        run("evaluate", f"pretrained:{name}", *how, "--out", out)
        return evaluation(out)

    return play


def sample_people(out: Path) -> Golden:
    """A network after one PPO update: untrained, but the same path as a trained user's."""
    run("train", "sample", *changes(*_PPO, *_SHORT), "--out", out / "run")
    how = ["--people", "2", "--episodes", "1", "--condition", "big", *changes(*_SHORT)]
    run("evaluate", out / "run", *how, "--out", out / "played")
    return evaluation(out / "played")


def baseline(user: str) -> Callable[[Path], Golden]:
    def play(out: Path) -> Golden:
        how = ["--condition", "big", "--episodes", "1", *changes("env.app.game=sample", *_SHORT)]
        run("evaluate", "--user", user, *how, "--out", out)
        return evaluation(out)

    return play


def replayed(out: Path) -> Golden:
    found: Golden = {}
    for name, options in (("open", []), ("closed", ["--closed"])):
        printed = run("replay", RECORDING, *options, "--json")
        found[name] = document(json.loads(printed), out)
    return found


def compared(out: Path) -> Golden:
    how = ["--recordings", RECORDING, "--condition", "medium", "--episodes", "1", "--no-figures"]
    short = changes("env.max_episode_seconds=6", "env.cores=1")
    printed = run("compare", "whacamole_constrained", *how, *short, "--out", out, "--json")
    return {"printed": document(json.loads(printed), out)}


def report_figures(out: Path) -> Golden:
    """The data of every figure of a study of two cells."""
    import yaml

    from sim2vr_harness.figures.figure import Figure

    study = {
        "name": "golden",
        "fixed": {"user": "pretrained:whacamole_constrained", "env.max_episode_seconds": _SECONDS},
        "factors": {"difficulty": {"key": "condition", "levels": ["easy", "hard"]}},
        "episodes": 2,
        "measures": ["hits", "return"],
        "comparisons": [{"factor": "difficulty"}],
    }
    file = out / "golden.yaml"
    file.write_text(yaml.safe_dump(study), encoding="utf-8")
    run("study", file, "--jobs", "1", "--no-report", "--out", out / "study")
    figures: dict[str, Figure] = {}
    original = Figure.__init__

    def kept(self: Figure, *args: Any, **kwargs: Any) -> None:
        original(self, *args, **kwargs)
        figures[self.key] = self

    with patch.object(Figure, "__init__", kept):
        run("report", out / "study", "--no-figures")
    found: Golden = {}
    for key, figure in sorted(figures.items()):
        one = document(figure, out)
        numbers = list(one["numbers"].values())
        one["numbers"] = {"values": len(numbers), "mean": float(np.mean(numbers))}
        one["title"] = figure.title
        found[key] = one
    return found


SUBJECTS: dict[str, Callable[[Path], Golden]] = {
    "replay": replayed,
    "compare": compared,
    "user_still": baseline("still"),
    "user_touch": baseline(_TOUCH),
    "sample_people": sample_people,
    "report_figures": report_figures,
    **{
        folder.name: shipped(folder.name)
        for folder in sorted(USERS.iterdir())
        if (folder / "config.yaml").is_file()
    },
}


# --- comparing -----------------------------------------------------------------------------------


def made(name: str) -> Golden:
    """Return what a subject is at present."""
    with tempfile.TemporaryDirectory() as folder:
        return SUBJECTS[name](Path(folder))


def stored(name: str) -> Golden:
    file = HERE / f"{name}.json"
    if not file.is_file():
        raise SystemExit(f"{file.name} is missing: run golden.py update {name}")
    return json.loads(file.read_text(encoding="utf-8"))


def differences(golden: Golden, found: Golden, *, bits: bool) -> list[str]:
    """Return a sentence for each difference.

    Args:
        golden: What is stored.
        found: What is there at present.
        bits: Compare hashes and every number exactly; else numbers within their tolerance.
    """
    if bits and golden != found:
        one, other = (text(each).splitlines() for each in (golden, found))
        diff = difflib.unified_diff(one, other, "golden", "found", lineterm="", n=2)
        return list(diff)
    wrong: list[str] = []
    for key in sorted({*golden, *found}):
        if key not in golden or key not in found:
            wrong.append(f"{key}: {'not found' if key in golden else 'not in the golden file'}")
        else:
            wrong += _beyond(key, golden[key]["numbers"], found[key]["numbers"])
    return wrong


def _beyond(key: str, golden: dict[str, float], found: dict[str, float]) -> list[str]:
    wrong = []
    for name in sorted({*golden, *found}):
        was, now = golden.get(name), found.get(name)
        if was is None or now is None:
            wrong.append(f"{key}: {name}: got {now}, expected {was}")
            continue
        kind = "count" if float(was).is_integer() else "number"
        bound = max(ABSOLUTE[kind], RELATIVE * abs(was))
        if abs(now - was) > bound:
            wrong.append(f"{key}: {name}: got {now}, expected {was} +- {bound:.3g}")
    return wrong


def text(golden: Golden) -> str:
    return json.dumps(golden, indent=1, sort_keys=True, ensure_ascii=False) + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("what", choices=["compare", "update"])
    parser.add_argument("names", metavar="NAME", nargs="*", help="subjects (default: all)")
    parser.add_argument("--bits", action="store_true", help="compare hashes, too")
    chosen = parser.parse_args(arguments)
    unknown = sorted({*chosen.names} - {*SUBJECTS})
    if unknown:
        parser.error(f"got {', '.join(unknown)}, expected of {', '.join(SUBJECTS)}")
    failed = 0
    for name in chosen.names or SUBJECTS:
        start = time.perf_counter()
        found = made(name)
        wrong: list[str] = []
        if chosen.what == "update":
            (HERE / f"{name}.json").write_text(text(found), encoding="utf-8")
        else:
            wrong = differences(stored(name), found, bits=chosen.bits)
        failed += bool(wrong)
        state = "updated" if chosen.what == "update" else "differs" if wrong else "same"
        lines = [f"{name}: {state} ({time.perf_counter() - start:.1f} s)", *wrong]
        sys.stdout.write("\n  ".join(lines) + "\n")
        sys.stdout.flush()
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
