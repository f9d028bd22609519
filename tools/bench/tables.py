"""Writes the tables of docs/performance.md from rows of ``sim2vr-harness bench``.

A table stands between the comments ``<!-- table NAME -->`` and ``<!-- end -->`` and is replaced as
a whole; one whose scenes no run has measured stays as it is. Where the file holds several runs, the
last one with the table's scenes counts. Numbers are thus never typed by hand.

Run: python tools/bench/tables.py build/bench/performance.jsonl docs/performance.md
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

Row = Mapping[str, Any]
Run = list[Row]

TRANSPORTS = ("in_process", "protocol2", "protocol1")
WORDS = {
    "physics": "physics: MuJoCo's own batch",
    "game": "game: apps that draw nothing",
    "render": "render: apps that draw",
    "env": "env: users in apps, observations",
    "reference-way": "reference-way: two processes per user",
    "train": "train: rollout and update",
}


def table_key(run: Run) -> str | None:
    """All scenes at one N, and the ratios."""
    rows = [row for row in run if row["scene"] in WORDS and row["variant"] == ""]
    if not {"physics", "env", "reference-way"} <= {row["scene"] for row in rows}:
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
    ratios = [
        [f"env / {other}", f"{env['ratios'][other]:.2f}", f"{env['ratios'][f'{other}, cpu']:.2f}"]
        for other in ("physics", "reference-way")
    ]
    return "\n\n".join(
        [
            f"N = {env['n']}, {env['threads']} threads. {machine(env)}",
            markdown(head, lines),
            markdown(["ratio", "steps/s", "by processor time"], ratios),
        ]
    )


def table_scaling(run: Run) -> str | None:
    """The env over N and threads."""
    rows = {
        (row["scene"], row["n"], row["threads"]): row
        for row in run
        if row["scene"] in ("env", "physics")
        and row["variant"] == ""
        and row["transport"] in (None, "in_process")
    }
    numbers = sorted({n for scene, n, _ in rows if scene == "env"})
    threads = sorted({t for scene, _, t in rows if scene == "env"})
    if len(numbers) < 3:
        return None
    head = ["users"]
    words = [f"{t} thread{'s' * (t != 1)}" for t in threads]
    head += [f"steps/s, {word}" for word in words]
    head += [f"{t} threads / 1" for t in threads if t != 1]
    head += [f"cost, {word}" for word in words]
    head += [f"env / physics, {word}" for word in words]
    lines = []
    for n in numbers:
        envs = [rows["env", n, t] for t in threads]
        line = [str(n), *(rate(env) for env in envs)]
        line += [ratio(env, "1 thread") for env in envs if env["threads"] != 1]
        line += ["1" if n == 16 else ratio(env, "N=16", inverse=True) for env in envs]
        line += [ratio(env, "physics") for env in envs]
        lines.append(line)
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


def table_targets(run: Run) -> str | None:
    """Cost as targets grow in number."""
    rows = {(row["scene"], row["variant"]): row for row in run if row["variant"]}
    counts = [variant for scene, variant in rows if scene == "render"]
    conditions = [variant for scene, variant in rows if scene == "env"]
    if not counts or not conditions:
        return None
    lines = []
    for variant in counts:
        game, render = rows["game", variant], rows["render", variant]
        drawing_us = 1e6 / render["rate_per_s"] - 1e6 / game["rate_per_s"]
        cpu_us = f"{render['cpu_us_per_step']:,.0f}"
        name = variant.removeprefix("targets=")
        lines.append([name, us(game), us(render), f"{drawing_us:,.0f}", cpu_us])
    head = [
        "targets standing",
        "frame without drawing, us",
        "frame, us",
        "difference, us",
        "frame, processor time, us",
    ]
    envs = [rows["env", variant] for variant in conditions]
    env_lines = [
        [
            env["variant"].removeprefix("condition="),
            rate(env),
            us(env),
            f"{env['cpu_us_per_step']:,.0f}",
        ]
        for env in envs
    ]
    env_head = ["condition", "env steps/s", "us per step", "processor time, us"]
    where = f"N = {envs[0]['n']}, {envs[0]['threads']} threads. {machine(envs[0])}"
    return "\n\n".join([where, markdown(env_head, env_lines), markdown(head, lines)])


def table_transports(run: Run) -> str | None:
    """Ways to the app, as shares of in process."""
    rows = {(row["scene"], row["transport"], row["n"]): row for row in run if not row["variant"]}
    if not any(transport == "protocol2" for _, transport, _ in rows):
        return None
    numbers = sorted({n for _, _, n in rows})
    head = ["scene", "N", *(name.replace("_", " ") for name in TRANSPORTS)]
    lines = []
    for n in numbers:
        for scene in ("game", "render", "env"):
            if (scene, "in_process", n) not in rows:
                continue
            base = rows[scene, "in_process", n]["rate_per_s"]
            shares = [rows.get((scene, name, n)) for name in TRANSPORTS]
            cells = ["" if row is None else f"{row['rate_per_s'] / base:.2f}" for row in shares]
            lines.append([WORDS[scene], str(n), *cells])
    return f"{machine(run[0])}\n\n{markdown(head, lines)}"


def table_profile(run: Run) -> str | None:
    """Where the time goes."""
    rows = [row for row in run if row["scene"].startswith("profile-")]
    if not rows:
        return None
    parts = []
    for row in rows:
        stages, cpu = row["extra"]["stages_us"], row["extra"]["stages_cpu_us"]
        total_us, total_cpu_us = sum(stages.values()), sum(cpu.values())
        lines = [
            [name, f"{us:,.0f}", percent(us / total_us), percent(cpu[name] / total_cpu_us)]
            for name, us in stages.items()
        ]
        scene = row["scene"].removeprefix("profile-")
        parts.append(f"{scene}, N = {row['n']}, {row['threads']} threads. {machine(row)}")
        head = ["stage", "us per user step", "share", "share of processor time"]
        parts.append(markdown(head, lines))
    return "\n\n".join(parts)


TABLES: dict[str, Callable[[Run], str | None]] = {
    "key": table_key,
    "scaling": table_scaling,
    "memory": table_memory,
    "targets": table_targets,
    "transports": table_transports,
    "profile": table_profile,
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


def ratio(row: Row, other: str, *, inverse: bool = False) -> str:
    """One of the row's ratios; empty where it was not measured."""
    value = row["ratios"].get(other)
    if value is None:
        return ""
    return f"{1 / value if inverse else value:.2f}"


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
            raise ValueError(f"{path}: got {line[:40]!r}, expected rows of sim2vr-harness bench")
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
