"""No arrow runs back up: a room of the package imports only the rooms below it."""

import ast
from collections.abc import Iterator
from pathlib import Path

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


def test_rooms_import_the_rooms_below_them_only() -> None:
    """A game's own room is found by its name, and packages of others have one importer."""
    games = {folder.name for folder in (PACKAGE / "games").iterdir() if folder.is_dir()}
    rooms = {path.parent.name for path in PACKAGE.glob("*/__init__.py")}
    assert rooms - {"cli"} <= BELOW.keys()
    wrong = []
    for file in sorted(PACKAGE.rglob("*.py")):
        place = file.relative_to(PACKAGE).parts
        for line, name in imports(file):
            parts = name.split(".")
            own = parts[0] == NAME and len(parts) > 1 and parts[1] in rooms
            above = own and place[0] in BELOW and parts[1] not in (place[0], *BELOW[place[0]])
            game = own and parts[1] == "games" and len(parts) > 2 and parts[2] in games - {*place}
            if above or game or place[0] not in ALONE.get(parts[0], {place[0]}):
                wrong.append(f"{'/'.join(place)}:{line}: {name}")
    assert wrong == []
