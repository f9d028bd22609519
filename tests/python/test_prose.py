"""Pages and the package keep to the rules of tools/docs/prose.py."""

import importlib.util
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
_SPEC = importlib.util.spec_from_file_location("prose", ROOT / "tools/docs/prose.py")
assert _SPEC is not None and _SPEC.loader is not None
prose = importlib.util.module_from_spec(_SPEC)
sys.modules["prose"] = prose
_SPEC.loader.exec_module(prose)


def rules(text: str) -> list[str]:
    return [problem.rule for problem in prose.page_problems("page.md", text)]


def test_no_file_breaks_a_rule() -> None:
    assert [str(problem) for problem in prose.find_problems()] == []
