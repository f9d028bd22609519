"""Options of the command line, made from the fields of a request."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import pytest
import typer.main

from python.cli.calls import call
from python.cli.test_help import shown_commands
from sim2vr_harness.base.requests import argument, option
from sim2vr_harness.cli.command import CommandGroup


@dataclass(frozen=True, kw_only=True)
class Shared:
    place: Path = argument("PLACE", "Where.")
    quiet: bool = option("Say nothing.", False)


@dataclass(frozen=True, kw_only=True)
class Request(Shared):
    names: tuple[str, ...] = argument("NAME...", "Who.", ())
    from_: str | None = option("Whence.", metavar="CITY", shown="here")
    figures: bool = option("Draw.", True)
    length_m: float = option("Length.", 1.5)
    count: int = option("Count.", 1, least=1, most=9)
    kind: Literal["a", "b"] = option("Kind.", "a")
    people: int | None = option("Persons.", metavar="[N]", bare=7)
    out: Path | None = option("Folder.", place="folder to write")
    tag: Sequence[int] = option("Tags.", ())
    inner: int = 4


def run(*words: str) -> Any:
    """The request that a command gets for these words."""
    got = []

    def command(request: Request) -> None:
        """Do it."""
        got.append(request)

    group = CommandGroup("Some commands.")
    group.add("do", command)
    group.add("other", command)
    typer.main.get_command(group)(["do", *words], standalone_mode=False)
    return got[0]


def test_every_kind_of_field_is_an_option() -> None:
    words = ("here", "x", "y", "--from", "Rome", "--no-figures", "--length-m", "2")
    more = ("--count", "9", "--kind", "b", "--quiet", "--tag", "3", "--tag", "1")
    expected = Request(
        place=Path("here"), names=("x", "y"), from_="Rome", figures=False, length_m=2.0,
        count=9, kind="b", tag=(3, 1), quiet=True,
    )  # fmt: skip
    assert run(*words, *more) == expected
    assert run("here") == Request(place=Path("here"))


@pytest.mark.parametrize(
    ("words", "people", "names"),
    [
        (["--people", "3", "here"], 3, ()),
        (["--people", "here", "x"], 7, ("x",)),
        (["here", "--people", "--quiet"], 7, ()),
        (["here"], None, ()),
    ],
)
def test_an_option_may_stand_without_its_number(
    words: list[str], people: int | None, names: tuple[str, ...]
) -> None:
    got = run(*words)
    assert (got.people, got.place, got.names) == (people, Path("here"), names)


def test_every_place_to_write_is_tried_first(capsys: Any) -> None:
    """Whatever else is given to the command; what is read by these names is not written."""
    tried = 0
    for words, command in shown_commands():
        for each in command.params:
            name = each.opts[0]
            if name in ("--out", "--log", "--video", "--junit") and not each.is_flag:
                status, out, err = call(capsys, *words.split(), name, "/proc/x.mp4", "x", "x")
                if words != "reach" or name != "--log":
                    problem = f"{name}: got '/proc/x.mp4', but nothing can be written in /proc"
                    assert (status, out) == (2, "") and problem in err, words
                    tried += 1
    assert tried >= 20
