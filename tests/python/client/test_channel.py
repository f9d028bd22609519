"""A channel: interrupted, and told to wait for times that are none."""

import pytest
import zmq

from sim2vr_harness.client import Channel


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
