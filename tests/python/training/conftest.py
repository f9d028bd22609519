from __future__ import annotations

import sys
from pathlib import Path

import pytest
import torch

sys.path.insert(0, str(Path(__file__).parent))  # fake_simulation


@pytest.fixture(autouse=True)
def few_threads():
    """Tiny networks are quickest on one thread, and other tests may run next to these."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)
