"""The scene ``scaling``: users on 1, 2, 4, ... cores, and the serial share of a step."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from measure.scene import IN_PROCESS, Spec
from sim2vr_harness.runs.config import TrainingConfig

ONE = "shards=1"
PREDICTED_CORES, CORES_OF_A_SHARD = 16, 4


def scaling_specs(config: TrainingConfig, n: int, most: int) -> list[Spec]:
    """Return ``physics``, and ``env`` in one process and in several, for 1, 2, 4, ... cores."""
    found = []
    for threads in (2**k for k in range(most.bit_length())):
        found.append(Spec("physics", config, n, threads, transport=None))
        for shards in sorted({1, min(2, threads, n), min(max(1, threads // CORES_OF_A_SHARD), n)}):
            own = config.env.model_copy(update={"shards": shards})
            divided = config.model_copy(update={"env": own})
            variant = f"shards={shards}"
            found.append(Spec("env", divided, n, threads, IN_PROCESS, variant=variant))
    return found


def serial_share(rows: Sequence[Mapping[str, Any]], *, divided: bool) -> float | None:
    """Return the serial share s of Amdahl's law, least squares over cores c and users.

    A step takes (physics on c cores) / r, and r(c) = r(1) / (1 + s (c - 1)); for processes of
    one core each, c is their number.
    """
    alone = {row["n"]: row["ratios"]["physics"] for row in rows if row["threads"] == 1}
    used = [
        (row["threads"] - 1, alone[row["n"]] / row["ratios"]["physics"] - 1.0)
        for row in rows
        if row["threads"] > 1
        and row["n"] in alone
        and row["variant"] == (f"shards={row['threads']}" if divided else ONE)
    ]
    more, slower = np.array(used).reshape(-1, 2).T
    return max(0.0, float(more @ slower / (more @ more))) if len(more) else None


def scaling_lines(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return what the rows of ``scaling`` say together; none for other scenes."""
    rows = [row for row in rows if row["variant"].startswith("shards=")]
    threads, shards = (serial_share(rows, divided=divided) for divided in (False, True))
    if threads is None or shards is None:
        return []
    lines = [f"serial share of a step: {threads:.3f} among threads, {shards:.3f} among processes"]
    several = PREDICTED_CORES // CORES_OF_A_SHARD
    for row in rows:
        if row["threads"] == 1:
            alone = row["ratios"]["physics"]
            one = alone / (1.0 + threads * (PREDICTED_CORES - 1))
            more = alone / (1.0 + threads * (CORES_OF_A_SHARD - 1)) / (1.0 + shards * (several - 1))
            where = f"{row['n']} users on {PREDICTED_CORES} cores, predicted env"
            lines.append(f"{where}: {one:.2f} x physics in one process, {more:.2f} in {several}")
    return lines
