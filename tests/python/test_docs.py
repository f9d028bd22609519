"""What the documentation points at is there."""

import re
import shlex
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
import typer.main

from sim2vr_harness.base.paths import config_path
from sim2vr_harness.cli.errors import _ClickException as ClickError
from sim2vr_harness.cli.errors import _usage
from sim2vr_harness.cli.main import app
from sim2vr_harness.client import list_games
from sim2vr_harness.runs.config import apply_overrides, defaults, load_config, parse_config

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


BLOCK = re.compile(r"^ *```\w*\n(.*?)^ *```", flags=re.S | re.M)
COMMANDS: Any = typer.main.get_command(app)


def _calls(page: Path) -> list[tuple[list[str], bool]]:
    """Words of every command line of a page, and whether it is a whole one, to be typed so."""
    sections = re.split(r"^## ", page.read_text(encoding="utf-8"), flags=re.M)
    return [call for section in sections for call in _calls_of(section)]


def _calls_of(text: str) -> list[tuple[list[str], bool]]:
    found = []
    for block in BLOCK.findall(text):
        first = dict(re.findall(r"\bfor (\w+) in (\S+)", block))
        for call in re.findall(r"sim2vr-harness (\w[^;|\n]*)", block.replace("\\\n", " ")):
            # Variables and braces of the shell stand for their first value.
            for name, value in first.items():
                call = call.replace(f"${name}", value)
            call = re.sub(r"{(\w+),[\w,]+}", r"\1", call)
            found.append((shlex.split(call, comments=True), True))
    # Settings below one `train GAME` are meant for it.
    trained = {words[1] for words, _ in found if words[0] == "train"}
    game = list(trained & set(list_games())) if len(trained) == 1 else []
    for code in re.findall(r"`([^`]+)`", BLOCK.sub("", text)):
        words = " ".join(code.split()).removeprefix(".venv/bin/")
        named = words.partition(" ")[0] in COMMANDS.commands and " --" in words
        if words.startswith("--set ") and words != "--set KEY=VALUE":
            found.append((["train", *game, *shlex.split(words)], False))
        elif words.startswith("sim2vr-harness ") or named:
            said = shlex.split(words.removeprefix("sim2vr-harness "))
            found.append((said, not named and any(word[0] == "-" for word in said)))
    return found


def _problem(words: list[str], whole: bool) -> str | None:
    """What the command line of a page gets wrong; None: nothing."""
    command: Any = COMMANDS
    names: list[str] = []
    rest = list(words)
    while hasattr(command, "commands") and rest and rest[0][0] != "-":
        names.append(rest.pop(0))
        if names[-1] not in command.commands:
            return f"no command {' '.join(names)}"
        command = command.commands[names[-1]]
    known = {option for each in command.params for option in (*each.opts, *each.secondary_opts)}
    for word in rest:
        if word[:2] == "--" and word not in {"--help", *known}:
            return f"no option {word} of {' '.join(names)}"
    if whole and "--help" not in rest:
        for parameter in command.params:
            parameter.callback = None  # it looks for the files that a page talks of
        try:
            command.make_context(names[-1], list(rest))
        except ClickError as error:
            return _usage(error, words)
    changes = [rest[k + 1] for k, word in enumerate(rest) if word == "--set"]
    return _refused(names, rest, changes) if changes else None


def _refused(names: list[str], rest: list[str], changes: list[str]) -> str | None:
    """What is wrong with the values of ``--set``."""
    try:
        below = "skills.motor_training." if names[:2] == ["users", "motor"] else ""
        first = defaults()
        with suppress(FileNotFoundError):  # of the reader's own
            first = load_config(config_path(rest[0]))
        if any(change.startswith("env.app.transport_options.") for change in changes):
            changes = ["env.app.transport=webxr", "env.app.page=PAGE", *changes]
        parse_config(apply_overrides(first.model_dump(), [below + change for change in changes]))
    except ValueError as error:
        return str(error)
    return None


def _problems(page: Path) -> list[str]:
    """Command lines of a page that the program does not take, with what it says of them."""
    answers = [(words, _problem(words, whole)) for words, whole in _calls(page)]
    return [f"{' '.join(words)}: {answer}" for words, answer in answers if answer is not None]


GUIDE = [page for page in PAGES if page == ROOT / "README.md" or "docs" in page.parts]
GUIDE = [page for page in GUIDE if page.name != "command_line.md"]  # the last is generated


@pytest.mark.parametrize("page", GUIDE, ids=lambda page: str(page.relative_to(ROOT)))
def test_the_program_takes_the_commands_of_a_page(page: Path) -> None:
    assert _problems(page) == []


def _examples(command: Any) -> list[str]:
    below = [each for each in getattr(command, "commands", {}).values() if not each.hidden]
    return [*command.examples, *(example for each in below for example in _examples(each))]
