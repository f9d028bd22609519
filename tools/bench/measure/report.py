"""Benchmark output on the command line: a table and ratios."""

from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Console
from rich.table import Table

from measure.scaling import scaling_lines
from measure.scene import IN_PROCESS


def print_rows(rows: Sequence[Mapping[str, Any]], console: Console) -> None:
    """Prints the rows of one run.

    Args:
        rows: as JSON objects, see :class:`~measure.rows.Row`.
        console: where to.
    """
    console.print(_table(rows))
    lines = ratio_lines(rows)
    width = max((len(label) for label, _ in lines), default=0)
    for label, text in lines:
        console.print(f"{label:<{width}}  {text}", highlight=False, soft_wrap=True)
    for line in scaling_lines(rows):
        console.print(line, highlight=False, soft_wrap=True)
    first = rows[0]
    commit = first["commit"] or f"version {first['version']}"
    console.print(
        f"\n{first['cpu']}, {first['cores']} cores, load {first['load_average'][0]} at the start; "
        f"{first['renderer'] or 'nothing drawn'}; images {first['image'][0]}x{first['image'][1]}, "
        f"{len(first['channels'])} channels; {commit[:12]}{' with changes' * bool(first['dirty'])}",
        highlight=False,
        soft_wrap=True,
    )


def _table(rows: Sequence[Mapping[str, Any]]) -> Table:
    table = Table(box=None, pad_edge=False, collapse_padding=True, header_style="bold")
    table.add_column("scene", overflow="fold")
    for name in ("users", "threads", "rate/s", "spread", "us", "cpu us", "state"):
        table.add_column(name, justify="right", no_wrap=True)
    for row in rows:
        transport = "" if row["transport"] in (None, IN_PROCESS) else f" {row['transport']}"
        name = f"{row['scene']}{transport} {row['variant']}".strip()
        table.add_row(name, str(row["n"]), str(row["threads"]), *_numbers(row))
        for part, rate in row["parts"].items():
            table.add_row(f"  {part.removesuffix('_steps_per_s')}", "", "", f"{rate:,.0f}")
    return table


def _numbers(row: Mapping[str, Any]) -> list[str]:
    if row["rate_per_s"] is None:
        per_user = row["extra"].get("memory_mb_per_user")
        return [f"{row['memory_mb']:,.0f} MB", "" if per_user is None else f"+{per_user}"]
    rate = row["rate_per_s"]
    return [
        f"{rate:,.0f}",
        f"{row['spread']:.0%}",
        f"{1e6 / rate:,.0f}",
        f"{row['cpu_us_per_step']:,.0f}",
        (row["state_hash"] or "-")[:8],
    ]


def ratio_lines(rows: Sequence[Mapping[str, Any]]) -> list[tuple[str, str]]:
    """The ratios between scenes of one run, each with what it says."""
    lines = []
    for row in rows:
        where = f"N={row['n']}, {row['threads']} thread{'s' * (row['threads'] != 1)}"
        where += "" if row["transport"] in (None, IN_PROCESS) else f", {row['transport']}"
        where += f", {row['variant']}" if row["variant"] else ""
        for other in [name for name in row["ratios"] if not name.endswith(", cpu")]:
            ratio, cpu = row["ratios"][other], row["ratios"][f"{other}, cpu"]
            lines.append((f"env, {where}", f"{ratio:.3g} x {other} ({cpu:.3g} by processor time)"))
    return lines
