import pytest

from sim2vr_harness.audit.population import NONE, draw
from sim2vr_harness.audit.reaching import Crowd


@pytest.fixture(scope="session")
def crowd() -> Crowd:
    """Six seated persons; bodies are made once."""
    return Crowd(draw(6, 1), "seated", NONE)
