"""A channel: interrupted, and told to wait for times that are none."""

import math
import re

import pytest
import zmq

from sim2vr_harness.client import Channel, Protocol1App, Protocol2Connection, connect

NOWHERE = "tcp://127.0.0.1:9"


@pytest.mark.parametrize(("error", "usable"), [(KeyboardInterrupt, False), (OSError, True)])
def test_who_is_interrupted_while_sending_does_not_send_again(
    monkeypatch: pytest.MonkeyPatch, error: type[BaseException], usable: bool
) -> None:
    """After a signal the message may be on its way; after an error it is not."""
    with zmq.Context() as context, context.socket(zmq.REP) as app:
        port = app.bind_to_random_port("tcp://127.0.0.1")
        channel = Channel(f"tcp://127.0.0.1:{port}", timeout_s=5.0)

        def interrupted(*_: object, **__: object) -> None:
            raise error

        monkeypatch.setattr(zmq.Socket, "send_multipart", interrupted)
        with pytest.raises(error):
            channel.request([b"step"], "a step")
        assert channel.usable == usable
        channel.close()


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, -1.0, 0.0, 1e300])
def test_times_that_cannot_be_waited_are_refused(value: float) -> None:
    words = re.escape(f"timeout_s: got {value}, expected a number above 0, at most 1e+09 s")
    with pytest.raises(ValueError, match=words):
        Channel(NOWHERE, timeout_s=value)
    for client in (Protocol1App, Protocol2Connection):
        with pytest.raises(ValueError, match=f"start_{words}"):
            client(connect(NOWHERE, 1.0), start_timeout_s=value)
