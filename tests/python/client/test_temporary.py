"""Temporary folders of apps: what is swept, and what is left alone."""

import tempfile
from pathlib import Path

import pytest

from sim2vr_harness.client import temporary
from sim2vr_harness.client.temporary import TemporaryFolder


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A temporary folder of the test's, in which this process has no folder yet."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(temporary, "_the_place", None)
    return tmp_path


def named(folder: Path, name: str, lock: bool = True) -> Path:
    made = folder / name
    made.mkdir(parents=True)
    (made / "profile").touch()
    if lock:
        (made / "lock").touch()
    return made


def test_a_folder_without_an_owner_is_swept_and_no_other(place: Path) -> None:
    swept = named(place, "sim2vr-1234567-abcdefgh")
    theirs = named(place, "theirs")
    link = place / "sim2vr-1234567-linklink"
    link.symlink_to(theirs)
    within = named(place, "sim2vr-1234567-withinit")
    (within / "out").symlink_to(theirs)
    lock_elsewhere = named(place, "sim2vr-1234567-locklink", lock=False)
    (lock_elsewhere / "lock").symlink_to(theirs / "lock")
    kept = [
        theirs,
        lock_elsewhere,
        named(place, "sim2vr-1234567-unlocked", lock=False),
        named(place, "sim2vr-app-logs-0"),
        named(place, "sim2vr-x-abcdefgh"),
    ]
    folder = TemporaryFolder()
    assert folder.path.is_dir()
    assert not swept.exists() and not within.exists()
    assert [file for file in kept if not (file / "profile").exists()] == []
    assert link.is_symlink()
    folder.remove()
    assert not folder.path.exists()
    folder.remove()


def test_files_elsewhere_go_with_the_folder_unless_they_are_others_by_now(
    place: Path, tmp_path: Path
) -> None:
    """Of a process that was killed together with its watcher: the next start deletes them."""
    left, anew = tmp_path / "left socket", tmp_path / "anew"
    left.touch()
    anew.touch()
    app = named(place, "sim2vr-1234567-xservers") / "0"
    app.mkdir()
    number = left.stat().st_ino
    (app / "outside").write_text(f"{number} {left}\n{number} {anew}\nno line\n")
    TemporaryFolder().remove()
    assert not app.exists() and not left.exists()
    assert anew.exists()
