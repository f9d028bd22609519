"""A channel that is interrupted."""

import pytest
import zmq

from sim2vr_harness.client.channel import Channel


def test_who_is_interrupted_while_sending_does_not_send_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with zmq.Context() as context, context.socket(zmq.REP) as app:
        port = app.bind_to_random_port("tcp://127.0.0.1")
        channel = Channel(f"tcp://127.0.0.1:{port}", timeout_s=5.0)
        send = channel._connection.send

        def interrupted(frames: list[bytes]) -> None:
            send(frames)
            raise KeyboardInterrupt

        assert channel.usable
        monkeypatch.setattr(channel._connection, "send", interrupted)
        with pytest.raises(KeyboardInterrupt):
            channel.request([b"step"], "a step")
        # The message is on its way: a second one before its answer is an error of the socket's.
        assert not channel.usable
        channel.close()


def test_who_could_not_send_may_try_again(monkeypatch: pytest.MonkeyPatch) -> None:
    channel = Channel("tcp://127.0.0.1:1", timeout_s=5.0)

    def refused(frames: list[bytes]) -> None:
        raise OSError("no")

    monkeypatch.setattr(channel._connection, "send", refused)
    with pytest.raises(OSError, match="no"):
        channel.send([b"step"], "a step")
    assert channel.usable
    channel.close()
