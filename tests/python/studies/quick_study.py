"""A study of four cells, and what it leaves."""

from pathlib import Path
from typing import Any

from sim2vr_harness.studies import StudyConfig
from sim2vr_harness.studies.config import parse_study


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
    """Every file of a study by its name, the lock left out."""
    return {
        str(file.relative_to(folder)): file.read_bytes()
        for file in sorted(folder.rglob("*"))
        if file.is_file() and file.name != ".lock"
    }
