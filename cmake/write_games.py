"""Writes which games an extension module has: name in Gymnasium ids -> name of the game.

Usage: write_games.py MODULE.so games.json
"""

from __future__ import annotations

import importlib.util
import json
import os
import sys
from pathlib import Path


def main(module_file: str, out: str) -> None:
    """Loads the module and writes the file."""
    spec = importlib.util.spec_from_file_location("_app_runtime", module_file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    games = {json.loads(module.game_facts(name))["id"]: name for name in module.list_games()}
    # Written beside and renamed: a reader at the same time finds the old file or the new one.
    beside = Path(f"{out}.{os.getpid()}.new")
    try:
        beside.write_text(json.dumps(games, indent=1, sort_keys=True) + "\n", encoding="utf-8")
        beside.replace(out)
    finally:
        beside.unlink(missing_ok=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
