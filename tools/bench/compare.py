"""Prints two runs of ``tools/bench/bench.py`` side by side.

Rows of the same scene, transport, number of users and of threads are put next to each other; where
a file holds several runs, the last row of each kind counts. The ratio is B / A, so that above 1 is
faster. Says where machines or settings differ, since then the ratio says little.

Run: python tools/bench/compare.py before.jsonl after.jsonl --fail-below 0.9
Ends with status 1 if a ratio lies below --fail-below, or with --same-states if a state hash
differs; with 2 if a file cannot be used.
"""

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

KEY = ("scene", "variant", "transport", "n", "threads")
MACHINE = ("cpu", "cores", "renderer", "gpu", "memory_total_mb")
SETTINGS = (
    "image",
    "channels",
    "game",
    "options",
    "effort",
    "physics_steps_per_user_step",
    "frames_per_step",
    "torch_threads",
    "device",
    "versions",
)
Row = Mapping[str, Any]
Key = tuple[Any, ...]


class BadFile(ValueError):
    """A file that does not hold rows."""


@dataclass(frozen=True)
class Pair:
    """A row of each run: values in ``unit``, and whether the hashes are equal (None: one has none).

    ``timed``: the values are rates, of which more is better; else they are MB.
    """

    name: str
    unit: str
    before: float
    after: float
    same_state: bool | None
    same_pictures: bool | None
    timed: bool

    @property
    def ratio(self) -> float:
        """After / before."""
        return self.after / self.before


def read_rows(path: Path) -> dict[Key, Row]:
    """The last row of each kind, in the file's order.

    Raises:
        BadFile: the file cannot be read, or a line is not a row.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise BadFile(f"{path}: got {error}, expected a file of JSON rows") from error
    rows: dict[Key, Row] = {}
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        try:
            row = json.loads(line)
            key = tuple(row[name] for name in KEY)
            row["rate_per_s"], row["state_hash"]
        except (ValueError, TypeError, KeyError) as error:
            expected = "a JSON row of tools/bench/bench.py"
            raise BadFile(
                f"{path}, line {number}: got {line[:40]!r}, expected {expected}"
            ) from error
        rows.pop(key, None)
        rows[key] = row
    if not rows:
        raise BadFile(f"{path}: got no rows, expected those of tools/bench/bench.py --output")
    return rows


def pairs(before: Mapping[Key, Row], after: Mapping[Key, Row]) -> list[Pair]:
    """What both runs have measured, in the order of A."""
    found = []
    for key in (key for key in before if key in after):
        a, b = before[key], after[key]
        timed = a["rate_per_s"] is not None
        name = "rate_per_s" if timed else "memory_mb"
        if not a.get(name) or not b.get(name):
            continue
        found.append(
            Pair(
                name=_name(a),
                unit=a["unit"],
                before=a[name],
                after=b[name],
                same_state=_same(a, b, "state_hash"),
                same_pictures=_same(a, b, "observation_hash"),
                timed=timed,
            )
        )
    return found


def _name(row: Row) -> str:
    parts = [
        row["scene"],
        row["variant"],
        "" if row["transport"] == "in_process" else row["transport"],
        f"N={row['n']}",
        f"threads={row['threads']}",
    ]
    return " ".join(part for part in parts if part)


def _same(a: Row, b: Row, name: str) -> bool | None:
    one, other = a.get(name), b.get(name)
    return None if one is None or other is None else one == other


def warnings(before: Mapping[Key, Row], after: Mapping[Key, Row]) -> list[str]:
    """What makes the comparison doubtful."""
    found = []
    common = [key for key in before if key in after]
    for what, names in (("machine", MACHINE), ("settings", SETTINGS)):
        for name in names:
            for key in common:
                a, b = before[key].get(name), after[key].get(name)
                # A run that draws nothing names no renderer.
                if a != b and not (name == "renderer" and None in (a, b)):
                    found.append(f"{what} differ: {name}: {a} | {b}")
                    break
    for label, rows in (("A", before), ("B", after)):
        first = next(iter(rows.values()))
        load, cores = first.get("load_average", [0.0])[0], first.get("cores", 1)
        if load > 0.5 * cores:
            found.append(f"run {label} began with a load of {load} on {cores} cores")
        if first.get("dirty"):
            found.append(f"run {label}: commit {str(first.get('commit'))[:12]} with changes")
    for label, here, there in (("A", before, after), ("B", after, before)):
        alone = [_name(row) for key, row in here.items() if key not in there]
        if alone:
            found.append(f"only in {label}: {', '.join(alone)}")
    return found


def _print(found: Sequence[Pair], before: Mapping[Key, Row], after: Mapping[Key, Row]) -> None:
    for label, rows in (("A", before), ("B", after)):
        first = next(iter(rows.values()))
        commit = first.get("commit") or f"version {first.get('version')}"
        print(f"{label}: {str(commit)[:12]}, {first.get('run')}, {first.get('cpu')}")
    width = max(len(pair.name) for pair in found)
    print(f"\n{'':{width}}  {'A':>12}  {'B':>12}  {'B / A':>7}  states    pictures")
    words = {True: "equal", False: "DIFFER", None: "-"}
    for pair in found:
        print(
            f"{pair.name:{width}}  {pair.before:>12,.1f}  {pair.after:>12,.1f}  {pair.ratio:>7.3f}"
            f"  {words[pair.same_state]:8}  {words[pair.same_pictures]:8}"
            + ("" if pair.timed else f"  {pair.unit}")
        )


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the program; returns its exit status."""
    parser = argparse.ArgumentParser(description="Compare two runs of tools/bench/bench.py.")
    parser.add_argument("a", type=Path, metavar="A.jsonl", help="the run before")
    parser.add_argument("b", type=Path, metavar="B.jsonl", help="the run after")
    parser.add_argument(
        "--fail-below", type=float, metavar="RATIO", help="status 1 if a rate's B / A is below this"
    )
    parser.add_argument(
        "--same-states", action="store_true", help="status 1 if a state hash differs"
    )
    options = parser.parse_args(arguments)
    try:
        before, after = read_rows(options.a), read_rows(options.b)
        found = pairs(before, after)
        if not found:
            raise BadFile("A and B: got no scene that both have measured, expected one at least")
    except BadFile as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    _print(found, before, after)
    for warning in warnings(before, after):
        print(f"warning: {warning}")
    failures = [
        f"{pair.name}: ratio {pair.ratio:.3f} is below {options.fail_below}"
        for pair in found
        if options.fail_below is not None and pair.timed and pair.ratio < options.fail_below
    ]
    if options.same_states:
        failures += [f"{pair.name}: states differ" for pair in found if pair.same_state is False]
    for failure in failures:
        print(f"FAILED: {failure}", file=sys.stderr)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
