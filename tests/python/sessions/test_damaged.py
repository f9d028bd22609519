"""Damaged and odd files, made from good ones: one clear sentence each."""

import gzip
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from python.sessions.bsor_made import bsor_bytes
from python.sessions.sessions_made import FRAMES, full_session
from sim2vr_harness.base import files
from sim2vr_harness.base.errors import InputError
from sim2vr_harness.cli.main import main
from sim2vr_harness.sessions import Session, read_session, replay, write_session
from sim2vr_harness.sessions.iwer import MOST_IWER
from sim2vr_harness.sessions.session import AppIdentity

Content = list[dict[str, Any]]


def lines() -> Content:
    """The objects of a good session: a header, frames, events."""
    from sim2vr_harness.sessions.file import session_lines

    return [json.loads(line) for line in session_lines(full_session())]


def text(content: Content) -> str:
    return "".join(json.dumps(each) + "\n" for each in content)


def changed(change: Callable[[Content], Any]) -> Callable[[], bytes]:
    """A session with something changed in its objects."""

    def make() -> bytes:
        content = lines()
        change(content)
        return text(content).encode()

    return make


def put(line: int, *path: str | int, value: Any) -> Callable[[], bytes]:
    """A session with another value in a line."""

    def change(content: Content) -> None:
        place: Any = content[line]
        for key in path[:-1]:
            place = place[key]
        place[path[-1]] = value

    return changed(change)


def good(name: str, edit: Callable[[str], str] = lambda text: text) -> Callable[[], bytes]:
    """A good file of another format with an edited text."""

    def make() -> bytes:
        import tempfile

        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / name
            write_session(full_session(), file)
            return edit(file.read_text()).encode()

    return make


def iwer(change: Callable[[dict[str, Any]], Any]) -> Callable[[], bytes]:
    def edit(text: str) -> str:
        content = json.loads(text)
        change(content)
        return json.dumps(content)

    return good("a.json", edit)


def cell(text: str, row: int, column: int, value: str) -> str:
    rows = [line.split(",") for line in text.splitlines()]
    rows[row][column] = value
    return "\n".join(map(",".join, rows)) + "\n"


BOM = "\N{BYTE ORDER MARK}"
WHOLE = text(lines())
TABLE = good("a.csv")
REPLAY = bsor_bytes([0.0, 0.1, 0.2], boxes=[])

# name of the case -> (name of the file, its bytes, words of the error)
REFUSED: dict[str, tuple[str, Callable[[], bytes], str]] = {
    "empty": ("a.jsonl", lambda: b"", "got an empty file, expected a session"),
    "cut off in a line": (
        "a.jsonl", lambda: WHOLE.encode()[:-1000], "the file may be cut off here",
    ),
    "no header": ("a.jsonl", changed(lambda c: c.pop(0)), "expected a recording of IWER"),
    "header twice": (
        "a.jsonl", changed(lambda c: c.insert(1, c[0])), "line 2: got 'format', expected one of t",
    ),
    "another version": ("a.jsonl", put(0, "version", value=2), "got version 2, expected version 1"),
    "NaN": ("a.jsonl", put(7, "head", 0, value=float("nan")), "head: got [nan, "),
    "time backwards": ("a.jsonl", put(3, "t", value=0), "expected times that do not go backwards"),
    "time of seconds": ("a.jsonl", put(3, "t", value=0.02), "line 4, t: got 0.02, expected whole"),
    "quaternion of zeros": (
        "a.jsonl", put(7, "head", slice(3, 7), value=[0, 0, 0, 0]), "a rotation of length 0",
    ),
    "millimetres": (
        "a.jsonl", put(4, "head", slice(0, 3), value=[0, 1600, 300]), "head: got a position of [0",
    ),
    "trigger of 2": (
        "a.jsonl", put(4, "left", "inputs", 0, value=2), "expected numbers from -1 to 1",
    ),
    "key twice": (
        "a.jsonl", lambda: WHOLE.replace('"t": 0,', '"t": 0, "t": 1,').encode(), "key 't' twice",
    ),
    "UTF-16": ("a.jsonl", lambda: WHOLE.encode("utf-16"), "got UTF-16, expected a session"),
    "gzip cut off": (
        "a.jsonl.gz", lambda: gzip.compress(WHOLE.encode())[:-30], "cut off or damaged",
    ),
    "IWER: unknown source": (
        "a.json", iwer(lambda c: c["schema"].pop()), "frame 0: got input source 1",
    ),
    "IWER: buttons": (
        "a.json", iwer(lambda c: c["frames"][2][8][9].pop()), "expected 7 buttons, 4 axes",
    ),
    "table without head": (
        "a.csv", good("a.csv", lambda t: t.replace("head_", "hat_")), "got no column head_x",
    ),
    "table with NaN in a pose": (
        "a.csv", good("a.csv", lambda t: cell(t, 5, 1, "")), "expected seven finite numbers",
    ),
    "BSOR cut off in the frames": ("a.bsor", lambda: REPLAY[:-60], "the file is cut off"),
    "BSOR of version 2": (
        "a.bsor", lambda: REPLAY[:4] + b"\2" + REPLAY[5:], "version 2, expected an open replay",
    ),
    "BSOR with a billion frames": (
        "a.bsor",
        lambda: bsor_bytes([0.0], boxes=[], count=10**9),
        "1,000,000,000 frames, expected 0 to",
    ),
    "a picture": ("a.png", lambda: b"\x89PNG\r\n\x1a\n" + b"\0" * 50, "got another file"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_a_damaged_file_is_refused_in_one_sentence(case: str, tmp_path: Path) -> None:
    name, make, words = REFUSED[case]
    file = tmp_path / name
    file.write_bytes(make())
    with pytest.raises(InputError) as caught:
        read_session(file)
    sentence = str(caught.value)
    assert words in sentence
    assert "\n" not in sentence and ", expected " in sentence
    assert sentence.startswith(str(file)), "the file is named first"


def with_a_gap(session: Session) -> Session:
    times = session.time_ns.copy()
    times[20:] += 10**9
    return replace(session, time_ns=times)


NOTED: dict[str, tuple[Callable[[Session], Session], str]] = {
    "controllers swapped": (lambda s: s.swapped(), "the controllers look swapped"),
    "another rate": (
        lambda s: replace(s, time_ns=s.time_ns * 3),
        "frames come at 24 Hz; the file names a display of 72 Hz",
    ),
    "a gap": (with_a_gap, "a gap of 1.01 s lies between frames 19 and 20"),
    "no left hand": (lambda s: replace(s, left=None), "there is no left controller"),
}


@pytest.mark.parametrize("case", NOTED)
def test_an_odd_file_is_read_with_a_note(case: str, tmp_path: Path) -> None:
    change, words = NOTED[case]
    write_session(change(full_session()), tmp_path / "a.jsonl")
    found = read_session(tmp_path / "a.jsonl")
    assert [note for note in found.notes if words in note], found.notes


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.jsonl", (BOM + WHOLE).replace("\n", "\r\n")),
        ("a.jsonl", WHOLE.replace("\n", "\n\n")),
        ("a.csv", BOM + TABLE().decode().replace(",", ";").replace("\n", "\r\n")),
    ],
    ids=["byte order mark and CR LF", "empty lines", "table of a spreadsheet"],
)
def test_what_editors_do_to_a_file_changes_nothing(name: str, content: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content.encode())
    found = read_session(tmp_path / name)
    np.testing.assert_array_equal(found.head, full_session().head)
    assert len(found) == FRAMES


def test_large_files_are_refused_before_they_are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Files with a hole, which takes no space, and a packed line that grows."""
    iwer_start = '{"schema": [], "frames": ['
    for name, start, size, most in (
        ("a.jsonl", WHOLE, 2**30, "268,435,456"),
        ("large.json", iwer_start, MOST_IWER + 1, "67,108,864"),
    ):
        with (tmp_path / name).open("wb") as stream:
            stream.write(start.encode())
            stream.truncate(size)
        with pytest.raises(InputError, match=f"more than {most} bytes"):
            read_session(tmp_path / name)
    monkeypatch.setattr(files, "MOST_LINE", 4096)
    (tmp_path / "a.jsonl.gz").write_bytes(gzip.compress(b" " * 2**22))
    with pytest.raises(InputError, match=r"line 1: got a line of more than 4,096 bytes"):
        read_session(tmp_path / "a.jsonl.gz")


def test_the_command_ends_with_status_2_and_one_line(capsys: Any, tmp_path: Path) -> None:
    (tmp_path / "a.jsonl").write_text(WHOLE[:-1000])
    for arguments in (["show"], ["strip", "OUT.jsonl"], ["convert", "OUT.json"]):
        command, *out = arguments
        with pytest.raises(SystemExit) as exit_:
            main(["session", command, str(tmp_path / "a.jsonl"), *(str(tmp_path / o) for o in out)])
        printed, err = capsys.readouterr()
        assert (exit_.value.code, printed, err.count("\n")) == (2, "", 1)
    assert [file.name for file in tmp_path.iterdir()] == ["a.jsonl"]


def test_numbers_and_texts_of_a_file_do_no_harm(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "round.jsonl"
    for line, path in ((0, ("rate_hz",)), (1, ("head", 0)), (1, ("t",))):
        file.write_bytes(put(line, *path, value=10**309)())
        with pytest.raises(InputError, match=r"round\.jsonl"):
            read_session(file)
    file.write_bytes(put(0, "headset", value="\x1b]0;owned\x07\x1b[2J")())
    with pytest.raises(SystemExit):
        main(["session", "show", str(file)])
    assert "\x1b" not in capsys.readouterr().out
    file.write_bytes(put(0, "person", value="\x1b[2Jeve")())
    assert read_session(file).person == r"\x1b[2Jeve"


def test_a_round_is_no_longer_than_its_limit(tmp_path: Path) -> None:
    """One gap of eleven days would be resampled at 20 Hz into 19 million rows."""
    file = tmp_path / "round.jsonl"
    good = full_session()
    times = good.time_ns.copy()
    times[-1] = 10**15
    write_session(replace(good, time_ns=times), file)
    with pytest.raises(InputError, match=r"round of .* s \(the longest gap .* at most 14400 s"):
        read_session(file)


def test_a_session_opens_levels_of_its_own_folder_only(tmp_path: Path) -> None:
    (tmp_path / "deep").mkdir()
    (tmp_path / "secret.dat").write_text("{}")
    (tmp_path / "deep" / "own.dat").write_text("{}")
    session = Session(
        time_ns=np.array([0], dtype=np.int64),
        head=np.array([[0.0, 1.6, 0.0, 0.0, 0.0, 0.0, 1.0]]),
        path=tmp_path / "deep" / "round.jsonl",
    )

    def chosen(level: str) -> Any:
        app = AppIdentity("game", "beats", "", {"level": level})
        return replay._own_options(replace(session, app=app))["level"]

    assert chosen("first") == "first"
    assert chosen("own.dat") == str(tmp_path / "deep" / "own.dat")
    for level in ("../secret.dat", str(tmp_path / "secret.dat"), "file:///etc/passwd"):
        with pytest.raises(InputError, match=r"option level: got .* copy it to "):
            chosen(level)
