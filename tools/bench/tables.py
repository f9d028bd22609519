"""Writes the tables of docs/evidence/training_and_speed.md from rows of ``tools/bench/bench.py``.

A table stands between the comments ``<!-- table NAME -->`` and ``<!-- end -->`` and is replaced as
a whole; one whose scenes no run has measured stays as it is. Where the file holds several runs, the
last one with the table's scenes counts. Numbers are thus never typed by hand.

Run: python tools/bench/tables.py build/bench/performance.jsonl docs/evidence/training_and_speed.md
"""

import json
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

Row = Mapping[str, Any]
Run = list[Row]

WORDS = {
    "physics": "physics: MuJoCo's own batch",
    "render": "render: apps that draw",
    "env": "env: users in apps, observations",
    "train": "train: rollout and update",
}


def table_key(run: Run) -> str | None:
    """All scenes at one N, and the ratio."""
    rows = [row for row in run if row["scene"] in WORDS and row["variant"] == ""]
    if not {"physics", "env", "train"} <= {row["scene"] for row in rows}:
        return None
    lines = []
    for row in rows:
        cpu_us = f"{row['cpu_us_per_step']:,.0f}"
        lines.append([WORDS[row["scene"]], rate(row), us(row), cpu_us, percent(row["spread"])])
        for part, value in row["parts"].items():
            name = part.removesuffix("_steps_per_s")
            lines.append([f"train, {name} alone", f"{value:,.0f}", f"{1e6 / value:,.0f}", "", ""])
    head = ["scene", "steps/s", "us per step", "processor time, us", "spread"]
    (env,) = [row for row in rows if row["scene"] == "env"]
    return (
        f"N = {env['n']}, {env['threads']} threads. {machine(env)}\n\n{markdown(head, lines)}\n\n"
        f"env / physics: {ratio(env, 'physics')} ({ratio(env, 'physics, cpu')} by processor time)"
    )


def table_scaling(run: Run) -> str | None:
    """The env over N and threads."""
    rows = {
        (row["n"], row["threads"]): row
        for row in run
        if row["scene"] == "env" and row["variant"] == "" and row["transport"] == "in_process"
    }
    numbers = sorted({n for n, _ in rows})
    threads = sorted({t for _, t in rows})
    if len(numbers) < 3:
        return None
    words = [f"{t} thread{'s' * (t != 1)}" for t in threads]
    head = ["users", *(f"steps/s, {word}" for word in words)]
    head += [f"{word} / 1" for word in words[1:]]
    head += [f"env / physics, {word}" for word in words]
    lines = []
    for n in numbers:
        envs = [rows[n, t] for t in threads]
        line = [str(n), *(rate(env) for env in envs)]
        line += [ratio(env, "1 thread") for env in envs[1:]]
        lines.append(line + [ratio(env, "physics") for env in envs])
    return f"{machine(run[0])}\n\n{markdown(head, lines)}"


def table_memory(run: Run) -> str | None:
    """Peak memory of processes that hold N users."""
    rows = [row for row in run if row["scene"] == "memory"]
    if not rows:
        return None
    lines = [
        [str(row["n"]), f"{row['memory_mb']:,.0f}", str(row["extra"].get("memory_mb_per_user", ""))]
        for row in rows
    ]
    return markdown(["users", "peak of the process, MB", "per user added, MB"], lines)


def table_senses(run: Run) -> str | None:
    """What a sense, or something done to one, adds to a user step."""
    rows = [row for row in run if row["scene"] == "env" and "without" in row["ratios"]]
    if not rows:
        return None
    lines = []
    for row in rows:
        step_us = 1e6 / row["rate_per_s"]
        more_us, more_cpu_us = (
            whole * (1.0 - row["ratios"][key])
            for whole, key in ((step_us, "without"), (row["cpu_us_per_step"], "without, cpu"))
        )
        lines.append([row["variant"], f"{more_us:+,.0f}", f"{more_cpu_us:+,.0f}"])
    head = ["env with", "us per step more", "processor time more, us"]
    where = f"N = {rows[0]['n']}, {rows[0]['threads']} threads. {machine(rows[0])}"
    return f"{where}\n\n{markdown(head, lines)}"


def table_transports(run: Run) -> str | None:
    """Ways to the app, as shares of in process."""
    rows = {(row["scene"], row["transport"], row["n"]): row for row in run if not row["variant"]}
    names = list(dict.fromkeys(transport for _, transport, _ in rows if transport is not None))
    if len(names) < 2:
        return None
    lines = []
    for n in sorted({n for _, _, n in rows}):
        for scene in ("render", "env"):
            base = rows[scene, "in_process", n]
            shares = [rows[scene, name, n]["rate_per_s"] / base["rate_per_s"] for name in names]
            lines.append([WORDS[scene], str(n), *(f"{share:.2f}" for share in shares)])
    head = ["scene", "N", *(name.replace("_", " ") for name in names)]
    return f"{machine(run[0])}\n\n{markdown(head, lines)}"


TABLES: dict[str, Callable[[Run], str | None]] = {
    "key": table_key,
    "scaling": table_scaling,
    "memory": table_memory,
    "transports": table_transports,
    "senses": table_senses,
}


def rate(row: Row) -> str:
    """Steps per second."""
    return f"{row['rate_per_s']:,.0f}"


def us(row: Row) -> str:
    """Wall time per step, us."""
    return f"{1e6 / row['rate_per_s']:,.0f}"


def percent(share: float) -> str:
    """A share as whole percent, or one decimal where it is small."""
    return f"{share:.0%}" if share >= 0.1 else f"{share:.1%}"


def ratio(row: Row, other: str) -> str:
    """One of the row's ratios; empty where it was not measured."""
    value = row["ratios"].get(other)
    return "" if value is None else f"{value:.2f}"


def machine(row: Row) -> str:
    """What the numbers were measured on."""
    commit = row["commit"] or f"version {row['version']}"
    changes = " with changes" if row["dirty"] else ""
    drawn = "" if row["renderer"] is None else f" {row['renderer'].partition(', OpenGL')[0]};"
    return (
        f"{row['cpu']}, {row['cores']} cores;{drawn} load {row['load_average'][0]} at the start; "
        f"{row['run'].partition('T')[0]}, {commit[:12]}{changes}."
    )


def markdown(head: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    """A table."""
    rows = [head, ["---"] + ["---:"] * (len(head) - 1), *lines]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def read_runs(path: Path) -> list[Run]:
    """The rows of a file by run, in order."""
    runs: dict[str, Run] = {}
    for line in path.read_text(encoding="utf-8").splitlines():
        row = json.loads(line)
        if not isinstance(row, dict) or "run" not in row or "scene" not in row:
            raise ValueError(f"{path}: got {line[:40]!r}, expected rows of tools/bench/bench.py")
        runs.setdefault(row["run"], []).append(row)
    return list(runs.values())


def fill(text: str, runs: Sequence[Run]) -> tuple[str, list[str], list[str]]:
    """Replaces the tables of a page.

    Returns:
        The page, the names of the tables that were replaced, and of those that no run is for.

    Raises:
        ValueError: the page has a table of an unknown name, or rows are of another version.
    """
    written: list[str] = []
    left: list[str] = []

    def replaced(match: re.Match[str]) -> str:
        name = match.group(1)
        if name not in TABLES:
            raise ValueError(f"table: got {name!r}, expected one of {', '.join(TABLES)}")
        try:
            found = [table for run in runs if (table := TABLES[name](run)) is not None]
        except KeyError as error:
            raise ValueError(
                f"table {name}: got rows without {error}, expected those of this version; "
                "measure again"
            ) from error
        (written if found else left).append(name)
        if not found:
            return match.group(0)
        return f"<!-- table {name} -->\n{found[-1]}\n<!-- end -->"

    pattern = r"<!-- table ([a-z-]+) -->\n.*?<!-- end -->"
    return re.sub(pattern, replaced, text, flags=re.DOTALL), written, left


def main(arguments: Sequence[str]) -> int:
    """Runs the program; returns its exit status."""
    if len(arguments) != 2:
        print("usage: tables.py ROWS.jsonl PAGE.md", file=sys.stderr)
        return 2
    rows, page = map(Path, arguments)
    try:
        text, written, left = fill(page.read_text(encoding="utf-8"), read_runs(rows))
    except (OSError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    page.write_text(text, encoding="utf-8")
    print(f"{page}: wrote {', '.join(written) or 'no table'}")
    if left:
        print(f"left as they were, not measured: {', '.join(left)}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
