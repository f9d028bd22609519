"""What the documentation points at is there."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import pytest
import typer.main

from sim2vr_harness.cli.main import app

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


def _code_lines(page: Path) -> list[str]:
    """Lines of a page's shell blocks, continued lines joined."""
    blocks = re.findall(
        r"^ *```sh\n(.*?)^ *```", page.read_text(encoding="utf-8"), flags=re.S | re.M
    )
    return [line for block in blocks for line in block.replace("\\\n", " ").splitlines()]


def _problems(page: Path) -> list[str]:
    """Commands of a page that do not exist, and options that they do not take."""
    commands = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    found = []
    for line in _code_lines(page):
        for call in re.findall(r"sim2vr-harness (\w[^;|]*)", line):
            name, *words = shlex.split(call, comments=True)
            if name not in commands:
                found.append(call)
                continue
            options = {option for each in commands[name].params for option in each.opts}
            options |= {option for each in commands[name].params for option in each.secondary_opts}
            found += [
                f"{name} {word}" for word in words if word[:2] == "--" and word not in options
            ]
    return found


SHORT = [
    ROOT / "README.md",
    *sorted(ROOT.glob("docs/guide/*.md")),
    *sorted(ROOT.glob("docs/tutorials/*.md")),
    ROOT / "docs/concepts/people.md",
    ROOT / "docs/reference/apps.md",
    ROOT / "docs/reference/performance.md",
]


@pytest.mark.parametrize("page", SHORT, ids=lambda page: str(page.relative_to(ROOT)))
def test_commands_of_a_page_exist(page: Path) -> None:
    assert any("sim2vr-harness" in line for line in _code_lines(page))
    assert _problems(page) == []


def test_every_command_is_in_the_readme() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    commands = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    assert [name for name in commands if f"`{name}`" not in text] == []


def test_the_readme_is_short() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 150
    assert text.count("![") == 1


def test_problems_are_found(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("```sh\nsim2vr-harness trian x\nsim2vr-harness train x --sed 1 --seed 1\n```\n")
    assert _problems(page) == ["trian x", "train --sed"]
