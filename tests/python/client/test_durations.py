"""Times to wait that cannot be waited are refused before anything is started."""

import math
import os
import re
from pathlib import Path

import pytest

from sim2vr_harness.base.paths import app_executable
from sim2vr_harness.client import Channel, Protocol1App, Protocol2Connection, connect
from sim2vr_harness.client.launch import start_sim2vr_app

NO_TIMES = [math.nan, math.inf, -math.inf, -1.0, 0.0, 1e300]
NOWHERE = "tcp://127.0.0.1:9"


def words(field: str, value: float) -> str:
    return re.escape(f"{field}: got {value}, expected a number above 0, at most 1e+09 s")


@pytest.mark.parametrize("value", NO_TIMES)
def test_clients_say_so(value: float) -> None:
    with pytest.raises(ValueError, match=words("timeout_s", value)):
        Channel(NOWHERE, timeout_s=value)
    for client in (Protocol1App, Protocol2Connection):
        with pytest.raises(ValueError, match=words("start_timeout_s", value)):
            client(connect(NOWHERE, 1.0), start_timeout_s=value)


def test_an_app_that_was_started_is_ended(tmp_path: Path) -> None:
    starting = start_sim2vr_app(app_executable(), ["--renderer", "null"])
    with pytest.raises(ValueError, match="start_timeout_s: got nan"):
        starting.channel(1.0, math.nan)
    assert not starting.process.running
    with pytest.raises(ProcessLookupError):
        os.kill(starting.process.pid, 0)
