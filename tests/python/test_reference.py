"""The generated reference pages are up to date and leave nothing out."""

import importlib.util
import sys
from pathlib import Path

import pytest
from pydantic import BaseModel, Field

from sim2vr_harness.runs.config import TrainingConfig

ROOT = Path(__file__).resolve().parents[2]
_SPEC = importlib.util.spec_from_file_location("reference", ROOT / "tools/docs/reference.py")
assert _SPEC is not None and _SPEC.loader is not None
reference = importlib.util.module_from_spec(_SPEC)
sys.modules["reference"] = reference
_SPEC.loader.exec_module(reference)


@pytest.mark.parametrize("path", list(reference.PAGES), ids=lambda path: path.name)
def test_page_is_up_to_date(path: Path) -> None:
    assert path.read_text(encoding="utf-8") == reference.PAGES[path](), "run make reference"


def dumped(tree: object, at: str = "") -> list[str]:
    """Dotted keys of a configuration's dump, without those of mappings and lists."""
    if not isinstance(tree, dict) or not tree:
        return [at]
    return [key for name, part in tree.items() for key in dumped(part, f"{at}.{name}".strip("."))]


def test_every_key_has_a_row() -> None:
    rows = {each.key for each in reference.settings(TrainingConfig, TrainingConfig())}
    assert len(rows) > 200
    assert [key for key in dumped(TrainingConfig().model_dump()) if key not in rows] == []


class Inner(BaseModel):
    delay_s: float = Field(default=0.5, ge=0.0, lt=2.0)
    """How late. More text."""


Inner.__module__ = "sim2vr_harness.test"


class Outer(BaseModel):
    one: Inner = Inner(delay_s=1.0)
    some: dict[str, Inner] = {}
    """Named ones (docs/reference/senses.md)."""
    many: int | None = None


Outer.__module__ = "sim2vr_harness.test"
