import platform

from sim2vr_harness.training.run.trainer import keep_freed_memory


def test_only_glibc_is_asked(monkeypatch) -> None:
    assert keep_freed_memory() is (platform.libc_ver()[0] == "glibc")
    monkeypatch.setattr(platform, "libc_ver", lambda: ("", ""))
    assert keep_freed_memory() is False
