"""OpenGL and PyTorch in one process."""

import subprocess
import sys

from parts import missing

_HEADSET = """
import numpy as np
from sim2vr_harness.client import DevicePoses, InProcessApp
app = InProcessApp("sample", renderer="egl")
app.reset(1, DevicePoses(np.array([0.0, 1.2, 0.0, 0.0, 0.0, 0.0, 1.0])))
"""
_BODY = """
from sim2vr_harness.users import load_body
from sim2vr_harness.users.rendering import UserRenderer
user = load_body("mobl_arms_wrist")
UserRenderer(user, 64, 64).render(user.coupled_qpos([0.0] * 7))
"""
_LEARN = """
import torch
torch.optim.Adam(torch.nn.Linear(2, 2).parameters())  # imports Triton where it is installed
print("learned")
"""


def test_an_optimiser_can_be_made_after_pictures() -> None:
    result = subprocess.run(
        [sys.executable, "-c", _HEADSET + _BODY + _LEARN], capture_output=True, text=True
    )
    if "no renderer" in result.stderr.lower() or "RenderError" in result.stderr:
        missing("runtime", f"no EGL: {result.stderr.splitlines()[-1]}")
    assert result.returncode == 0, result.stderr
    assert "learned" in result.stdout
