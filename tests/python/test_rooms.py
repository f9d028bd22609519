"""No arrow runs back up: a room of the package imports only the rooms below it."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[2] / "python" / "sim2vr_harness"
NAME = "sim2vr_harness"

_ENVIRONMENTS = ("base", "client", "users", "perception", "games", "envs")
_POLICIES = (*_ENVIRONMENTS, "runs", "world_models", "policies")
_PLAY = (*_POLICIES, "sessions", "play")
_EVALUATION = (*_PLAY, "figures", "statistics", "evaluation")
_TOP = (*_EVALUATION, "human_comparison", "training")

BELOW: dict[str, tuple[str, ...]] = {
    "base": (),
    "statistics": (),
    "client": ("base",),
    "sessions": ("base", "client"),
    "users": ("base", "client"),
    "games": ("base", "client"),
    "figures": ("base", "client"),
    "perception": ("base", "client", "users"),
    "envs": ("base", "client", "users", "perception"),
    "world_models": _ENVIRONMENTS,
    "runs": _ENVIRONMENTS,
    "policies": (*_ENVIRONMENTS, "runs", "world_models"),
    "play": (*_POLICIES, "sessions"),
    "training": (*_PLAY, "statistics"),
    "evaluation": (*_PLAY, "figures", "statistics"),
    "human_comparison": _EVALUATION,
    "studies": _TOP,
    "tools": _TOP,
    "audit": (*_TOP, "tools"),
}
"""What each room may import beside itself; ``cli`` may import all, and nothing imports it."""

ALONE = {
    "stable_baselines3": {"policies", "training"},
    "zmq": {"client"},
    "ray": {"studies"},
    "plotly": {"figures", "studies"},
    "viser": {"tools"},
}
"""Packages that only these rooms import."""


def imports(file: Path) -> Iterator[tuple[int, str]]:
    """Line and dotted name of everything that a module imports, wherever in it."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield from ((node.lineno, f"{node.module}.{alias.name}") for alias in node.names)


def rooms() -> list[str]:
    return sorted(path.parent.name for path in PACKAGE.glob("*/__init__.py"))


def test_every_room_has_its_place() -> None:
    assert set(rooms()) - {"cli"} <= BELOW.keys()


@pytest.mark.parametrize("room", sorted(BELOW))
def test_a_room_imports_only_the_rooms_below_it(room: str) -> None:
    wrong = []
    for file in sorted((PACKAGE / room).rglob("*.py")):
        for line, name in imports(file):
            parts = name.split(".")
            if parts[0] != NAME or len(parts) < 2 or not (PACKAGE / parts[1]).is_dir():
                continue
            if parts[1] not in (room, *BELOW[room]):
                wrong.append(f"{file.relative_to(PACKAGE)}:{line}: {name}")
    assert wrong == []


@pytest.mark.parametrize("package", sorted(ALONE))
def test_a_package_has_one_importer(package: str) -> None:
    found = {
        file.relative_to(PACKAGE).parts[0]
        for file in PACKAGE.rglob("*.py")
        for _, name in imports(file)
        if name.split(".")[0] == package
    }
    assert found <= ALONE[package]


def test_a_game_s_own_room_is_found_by_its_name_only() -> None:
    games = [folder.name for folder in (PACKAGE / "games").iterdir() if folder.is_dir()]
    found = []
    for file in sorted(PACKAGE.rglob("*.py")):
        for line, name in imports(file):
            parts = name.split(".")
            theirs = parts[:2] == [NAME, "games"] and len(parts) > 2 and parts[2] in games
            if theirs and parts[2] not in file.relative_to(PACKAGE).parts:
                found.append(f"{file.relative_to(PACKAGE)}:{line}: {name}")
    assert found == []
