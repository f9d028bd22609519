"""What the room says is public is there, is documented, and costs no torch until it needs it."""

import os
import subprocess
import sys
from pathlib import Path

PAGE = Path(__file__).resolve().parents[3] / "docs/reference/api.md"


def test_configurations_are_read_without_torch() -> None:
    code = (
        "import os, sys; from sim2vr_harness.training import load_config; "
        "load_config('whacamole_constrained_distill'); assert 'torch' not in sys.modules; "
        "print(os.environ['OMP_WAIT_POLICY'], os.environ['GOMP_SPINCOUNT'])"
    )
    kept = {key: value for key, value in os.environ.items() if not key.startswith(("OMP", "GOMP"))}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=kept)
    assert (done.stdout, done.stderr) == ("PASSIVE 30000\n", "")
