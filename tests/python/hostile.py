"""Files that would run code, and commands that are given them."""

import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import yaml

from python.users.bodies import OWN_ARM
from sim2vr_harness.base.errors import InputError
from sim2vr_harness.cli.main import main


class Evil:
    """What runs a command when a pickle is read."""

    def __init__(self, marker: Path) -> None:
        self._marker = marker

    def __reduce__(self) -> Any:
        return os.system, (f"touch {self._marker}",)


@dataclass
class Case:
    """A place for hostile files, and what is done with them."""

    folder: Path
    marker: Path
    trained: Path
    capsys: Any
    refusals: int = 0
    agreements: int = 0
    reads: int = 0

    def program(self) -> Path:
        """A program that leaves the marker."""
        file = self.folder / "app.sh"
        file.write_text(f"#!/bin/sh\ntouch {self.marker}\nexit 1\n")
        file.chmod(0o755)
        return file

    def python(self, name: str) -> Path:
        """A file of Python that leaves the marker when it is imported."""
        file = self.folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        text = f"open({str(self.marker)!r}, 'w').close()\n"
        text += "from sim2vr_harness.client import Task\nclass Mine(Task):\n    pass\n"
        file.write_text(text + "def load_spec(name):\n    raise ValueError(name)\n")
        return file

    def run(self, **env: Any) -> Path:
        """A run's folder whose configuration has these settings."""
        place = self.folder / f"run{len(list(self.folder.glob('run*')))}"
        shutil.copytree(self.trained, place)
        self.change(place / "config.yaml", **env)
        return place

    def change(self, file: Path, **env: Any) -> None:
        tree = yaml.safe_load(file.read_text())
        for part, values in env.items():
            tree["env"][part] |= values
        file.write_text(yaml.safe_dump(tree))

    def study(self, **fixed: Any) -> Path:
        """A study's file; its cells last half a second."""
        tree = {
            "name": f"study{len(list(self.folder.glob('*.study.yaml')))}",
            "fixed": {"user": "whacamole_constrained", "env.max_episode_seconds": 0.5, **fixed},
            "factors": {"level": {"key": "condition", "levels": ["easy", "medium"]}},
            "episodes": 1,
            "measures": ["hits"],
        }
        file = self.folder / f"{tree['name']}.study.yaml"
        file.write_text(yaml.safe_dump(tree))
        return file

    def body(self, **source: Any) -> Path:
        """A body's file with another model."""
        tree = yaml.safe_load(Path(OWN_ARM).read_text())
        tree.pop("mjcf")
        file = self.folder / f"body{len(list(self.folder.glob('body*')))}.yaml"
        file.write_text(yaml.safe_dump(tree | source))
        return file

    def _call(self, *command: str | Path) -> tuple[int, str]:
        with pytest.raises(SystemExit) as ended:
            main([str(part) for part in command])
        out, err = self.capsys.readouterr()
        return int(ended.value.code or 0), out + err

    def refused(self, *command: str | Path, key: str = "env.app.") -> None:
        """A command asks, and runs nothing."""
        status, text = self._call(*command)
        assert status == 2, text
        assert key in text, text
        assert "expected --trust-app, if you know where it comes from" in text, text
        assert not self.marker.exists(), command
        self.refusals += 1

    def asked(self, call: Callable[[], object]) -> None:
        """A call of Python asks, and runs nothing."""
        with pytest.raises(InputError, match="--trust-app"):
            call()
        assert not self.marker.exists()
        self.refusals += 1

    def agreed(self, *command: str | Path) -> None:
        """With the question answered the code runs: it was hostile."""
        _, text = self._call(*command, "--trust-app")
        assert self.marker.exists(), text
        self.agreements += 1

    def read(self, *command: str | Path) -> None:
        """A command takes a file, or refuses it, and runs nothing of it."""
        _, text = self._call(*command)
        assert "Traceback" not in text
        assert not self.marker.exists(), command
        self.reads += 1

    def would(self, act: Callable[[], object]) -> None:
        """What is in the file leaves the marker if somebody is careless."""
        act()
        assert self.marker.exists()
        self.marker.unlink()
