"""A skip for want of a part that should be there is a failure; a run ends with what it left out."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]
SKIPPING = """
import pytest
from parts import missing, needs

@needs("browser", False, "no Chromium")
def test_marked(): pass

def test_inside(): missing("gpu", "no GPU")

def test_without_a_part(): pytest.skip("just so")

def test_passes(): pass
"""


@pytest.mark.parametrize(
    ("required", "failed"),
    [
        ("", 0),
        ("browser,gpu", 3),
    ],
)
def test_a_missing_part_that_is_required_fails(required: str, failed: int, tmp_path: Path) -> None:
    """Without a list of parts nothing fails; with one, a skip that names no part does as well."""
    for name in ("parts.py", "conftest.py"):
        shutil.copy(TESTS / name, tmp_path)
    (tmp_path / "pytest.ini").write_text("[pytest]\npythonpath = .\n")
    (tmp_path / "test_it.py").write_text(SKIPPING)
    environment = os.environ | {"SIM2VR_REQUIRE": required, "SIM2VR_RECORDINGS": ""}
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-n", "2"]
    done = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert len(re.findall(r"^(?:FAILED|ERROR) ", done.stdout, re.M)) == failed, done.stdout
    assert "1 passed" in done.stdout
    assert bool(done.returncode) == bool(failed)
    if "browser" in required:
        assert (
            "skipped because browser is missing (no Chromium), which SIM2VR_REQUIRE" in done.stdout
        )
    else:
        assert "browser: 1 tests: no Chromium\n    unproven: WebXR pages play" in done.stdout
    assert "recordings: tests/recordings: SIM2VR_RECORDINGS names no folder" in done.stdout
