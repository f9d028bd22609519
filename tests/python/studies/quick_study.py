"""A study of four cells, and what it leaves."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from sim2vr_harness.studies import StudyConfig
from sim2vr_harness.studies.config import parse_study
from sim2vr_harness.studies.pool import Here, Pool


def study(trained: Path, **changes: Any) -> StudyConfig:
    return parse_study(
        {
            "name": "quick",
            "fixed": {"user": str(trained)},
            "factors": {
                "difficulty": {"key": "condition", "levels": ["easy", "hard"]},
                "noise": {"key": "env.user.noise.constant", "levels": {"off": None, "on": "white"}},
            },
            "episodes": 2,
            "measures": ["hits", "return"],
            "comparisons": [{"factor": "difficulty", "where": {"noise": "off"}}],
            **changes,
        }
    )


def content(folder: Path) -> dict[str, bytes]:
    """Every file of a study by its name; locks and Optuna's journal, with its times, left out."""
    return {
        str(file.relative_to(folder)): file.read_bytes()
        for file in sorted(folder.rglob("*"))
        if file.is_file() and file.name not in (".lock", "search.journal")
    }


def killed_after(count: int, played: Sequence[Any]) -> Callable[[Path, int], Pool]:
    """Make pools that stop as if killed when so many have been played."""

    class Killed(Here):
        def next(self) -> Any:
            if len(played) == count:
                raise KeyboardInterrupt
            return super().next()

    return lambda root, tasks: Killed(root, 1)
