"""What pages tell people to type works, from an empty folder on, in the state that setup leaves."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from parts import needs
from webxr_pages import NEEDS_BROWSER, NEEDS_ENGINES

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.slow
@NEEDS_BROWSER
@NEEDS_ENGINES
@needs("openxr", shutil.which("hello_xr"), "no hello_xr (apt-get install libopenxr-utils)")
def test_commands_of_the_readme_and_the_first_of_each_guide(tmp_path: Path) -> None:
    """`tools/dev/nightly.sh guides` runs all commands of all pages."""
    command = [sys.executable, ROOT / "tools/docs/run_guides.py", "--first", "--limit", "180"]
    done = subprocess.run(
        [*command, "--folder", tmp_path / "new"], capture_output=True, text=True, check=False
    )
    assert "README.md" in done.stdout and "own_page.md" in done.stdout, done.stderr
    assert done.returncode == 0, done.stdout
