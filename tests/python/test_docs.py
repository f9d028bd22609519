"""What the documentation points at is there."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted(
    page
    for page in [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")]
    if "engines" not in page.parts  # other people's
)


def anchor(heading: str) -> str:
    """A heading's name in links, as GitHub makes it."""
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")


def anchors(page: Path) -> set[str]:
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.S | re.M)
    return {anchor(heading) for heading in re.findall(r"^#+ (.*)$", text, flags=re.M)}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.S | re.M)
    dead = []
    for link in re.findall(r"\]\(([^)\s]+)\)", text):
        if re.match(r"[a-z]+:", link):
            continue  # of other sites
        name, _, heading = link.partition("#")
        target = page.parent / name if name else page
        if not target.exists() or (heading and heading not in anchors(target)):
            dead.append(link)
    assert dead == []


def test_pages_that_the_code_names_are_there() -> None:
    files = [
        *ROOT.glob("python/**/*.py"),
        *ROOT.glob("configs/*.yaml"),
        *ROOT.glob("tests/**/*.py"),
    ]
    files += [path for end in ("hpp", "cpp") for path in ROOT.glob(f"app_runtime/**/*.{end}")]
    named = {name for file in files for name in re.findall(r"docs/[\w/]+\.md", file.read_text())}
    assert len(named) > 3
    assert [name for name in sorted(named) if not (ROOT / name).exists()] == []


def test_presets_are_those_of_the_page() -> None:
    """CONTRIBUTING.md's table of presets names each that can be configured."""
    presets = json.loads((ROOT / "CMakePresets.json").read_text())["configurePresets"]
    names = [preset["name"] for preset in presets if not preset.get("hidden")]
    section = (
        (ROOT / "CONTRIBUTING.md").read_text().partition("## Presets")[2].partition("\n## ")[0]
    )
    assert re.findall(r"^\| `([\w-]+)` \|", section, flags=re.M) == names
