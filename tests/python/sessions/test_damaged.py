"""Damaged and odd files, made from good ones: one clear sentence each."""

import gzip
import json
import struct
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
from sim2vr_harness.sessions.logs import numbered_events
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


def packed(content: bytes) -> bytes:
    return gzip.compress(content)


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
    "header alone": (
        "a.jsonl", changed(lambda c: c.__delitem__(slice(1, None))), "a header without frames",
    ),
    "no header": ("a.jsonl", changed(lambda c: c.pop(0)), "expected a recording of IWER"),
    "header twice": (
        "a.jsonl", changed(lambda c: c.insert(1, c[0])), "line 2: got 'format', expected one of t",
    ),
    "another version": ("a.jsonl", put(0, "version", value=2), "got version 2, expected version 1"),
    "unknown key": ("a.jsonl", put(0, "sede", value=1), "(did you mean 'seed'?)"),
    "seed of text": ("a.jsonl", put(0, "seed", value="7"), "line 1, seed: got '7'"),
    "negative rate": ("a.jsonl", put(0, "rate_hz", value=-72), "line 1, rate_hz: got -72"),
    "kind of app": ("a.jsonl", put(0, "app", "kind", value="game2"), "app.kind: got 'game2'"),
    "options": ("a.jsonl", put(0, "app", "options", value=[1]), "app.options: got [1]"),
    "NaN": ("a.jsonl", put(7, "head", 0, value=float("nan")), "head: got [nan, "),
    "infinite": ("a.jsonl", put(7, "head", 1, value=float("inf")), "head: got ["),
    "null in a pose": ("a.jsonl", put(7, "head", 1, value=None), "expected 7 finite numbers"),
    "six numbers": (
        "a.jsonl", put(7, "head", value=[0, 1, 0, 0, 0, 1]), "expected 7 finite numbers",
    ),
    "no head": ("a.jsonl", changed(lambda c: c[7].pop("head")), "line 8, head: got None"),
    "time backwards": ("a.jsonl", put(3, "t", value=0), "expected times that do not go backwards"),
    "time of seconds": ("a.jsonl", put(3, "t", value=0.02), "line 4, t: got 0.02, expected whole"),
    "negative time": ("a.jsonl", put(1, "t", value=-1), "line 2, t: got -1"),
    "no time": ("a.jsonl", changed(lambda c: c[2].pop("t")), "line 3, t: got None"),
    "quaternion of zeros": (
        "a.jsonl", put(7, "head", slice(3, 7), value=[0, 0, 0, 0]), "a rotation of length 0",
    ),
    "quaternion too long": (
        "a.jsonl", put(7, "right", "grip", slice(3, 7), value=[0, 0, 1, 1]),
        "right grip: got a rotation of length 1.41",
    ),
    "millimetres": (
        "a.jsonl", put(4, "head", slice(0, 3), value=[0, 1600, 300]), "head: got a position of [0",
    ),
    "controller without grip": (
        "a.jsonl", changed(lambda c: c[4]["left"].pop("grip")), "line 5, left: got {",
    ),
    "12 inputs": (
        "a.jsonl", changed(lambda c: c[4]["left"]["inputs"].pop()), "left.inputs: got [",
    ),
    "trigger of 2": (
        "a.jsonl", put(4, "left", "inputs", 0, value=2), "expected numbers from -1 to 1",
    ),
    "event of a number": ("a.jsonl", changed(lambda c: c[-1].update(event=3)), "event: got 3"),
    "data of a list": (
        "a.jsonl", changed(lambda c: c[-1].update(data=[1])), "data: got [1]",
    ),
    "key twice": (
        "a.jsonl", lambda: WHOLE.replace('"t": 0,', '"t": 0, "t": 1,').encode(), "key 't' twice",
    ),
    "UTF-16": ("a.jsonl", lambda: WHOLE.encode("utf-16"), "got UTF-16, expected a session"),
    "Latin-1": (
        "a.jsonl", lambda: WHOLE.replace("p1", "é").encode("latin-1"), "got no UTF-8 text",
    ),
    "gzip cut off": ("a.jsonl.gz", lambda: packed(WHOLE.encode())[:-30], "cut off or damaged"),
    "gzip damaged": (
        "a.jsonl.gz", lambda: packed(WHOLE.encode())[:40] + b"\0" * 40, "cut off or damaged",
    ),
    "IWER: unknown source": (
        "a.json", iwer(lambda c: c["schema"].pop()), "frame 0: got input source 1",
    ),
    "IWER: buttons": (
        "a.json", iwer(lambda c: c["frames"][2][8][9].pop()), "expected 7 buttons, 4 axes",
    ),
    "IWER: null": (
        "a.json", iwer(lambda c: c["frames"][2].__setitem__(3, None)), "frame 2: got [",
    ),
    "IWER: time backwards": (
        "a.json", iwer(lambda c: c["frames"][9].__setitem__(0, 0)), "do not go backwards",
    ),
    "IWER: no frames": ("a.json", iwer(lambda c: c["frames"].clear()), "got 0 frames"),
    "JSON of another kind": ("a.json", lambda: b'{"a": 1}', "expected a recording of IWER"),
    "table without head": (
        "a.csv", good("a.csv", lambda t: t.replace("head_", "hat_")), "got no column head_x",
    ),
    "table with a short row": (
        "a.csv", good("a.csv", lambda t: t.rstrip().rsplit(",", 3)[0]), "line 41: got ",
    ),
    "table with a word": (
        "a.csv", good("a.csv", lambda t: cell(t, 5, 1, "left")), "line 6, head_x: got 'left'",
    ),
    "table with NaN in a pose": (
        "a.csv", good("a.csv", lambda t: cell(t, 5, 1, "")), "expected seven finite numbers",
    ),
    "table with a column twice": (
        "a.csv", good("a.csv", lambda t: t.replace("head_y", "head_x")), "the column head_x twice",
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
    "BSOR with NaN": (
        "a.bsor",
        lambda: REPLAY.replace(struct.pack("<f", 0.1), struct.pack("<f", np.nan)),
        "a time that is not finite",
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


def test_there_are_at_least_forty() -> None:
    assert len(REFUSED) + len(NOTED) >= 40


def swapped(session: Session) -> Session:
    return session.swapped()


def slow(session: Session) -> Session:
    return replace(session, time_ns=session.time_ns * 3)


def with_a_gap(session: Session) -> Session:
    times = session.time_ns.copy()
    times[20:] += 10**9
    return replace(session, time_ns=times)


NOTED: dict[str, tuple[Callable[[Session], Session], str]] = {
    "controllers swapped": (swapped, "the controllers look swapped"),
    "another rate": (slow, "frames come at 24 Hz; the file names a display of 72 Hz"),
    "a gap": (with_a_gap, "a gap of 1.01 s lies between frames 19 and 20"),
    "no left hand": (lambda s: replace(s, left=None), "there is no left controller"),
    "no right hand": (lambda s: replace(s, right=None), "there is no right controller"),
}


@pytest.mark.parametrize("case", NOTED)
def test_an_odd_file_is_read_with_a_note(case: str, tmp_path: Path) -> None:
    change, words = NOTED[case]
    write_session(change(full_session()), tmp_path / "a.jsonl")
    found = read_session(tmp_path / "a.jsonl")
    assert [note for note in found.notes if words in note], found.notes


@pytest.mark.parametrize(
    "content",
    [
        (BOM + WHOLE).encode(),
        WHOLE.replace("\n", "\r\n").encode(),
        WHOLE.replace("\n", "\n\n").encode(),
    ],
    ids=["byte order mark", "CR LF", "empty lines"],
)
def test_what_editors_do_to_a_file_changes_nothing(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "a.jsonl").write_bytes(content)
    found = read_session(tmp_path / "a.jsonl")
    np.testing.assert_array_equal(found.head, full_session().head)
    assert len(found) == FRAMES and len(found.events) == 3


def test_a_table_of_a_spreadsheet(tmp_path: Path) -> None:
    table = TABLE().decode().replace(",", ";").replace("\n", "\r\n")
    (tmp_path / "a.csv").write_text(BOM + table, encoding="utf-8")
    np.testing.assert_array_equal(read_session(tmp_path / "a.csv").head, full_session().head)


def test_a_file_of_a_gigabyte_is_refused_before_it_is_read(tmp_path: Path) -> None:
    file = tmp_path / "a.jsonl"
    file.write_text(WHOLE)
    with file.open("r+b") as stream:
        stream.truncate(2**30)  # a hole: takes no space
    with pytest.raises(InputError, match=r"more than 268,435,456 bytes, expected a session"):
        read_session(file)


def test_gzip_that_grows_is_refused_within_bounds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
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


def test_a_round_is_no_longer_than_its_limit(tmp_path: Path) -> None:
    """One gap of eleven days would be resampled at 20 Hz into 19 million rows."""
    file = tmp_path / "round.jsonl"
    good = full_session()
    times = good.time_ns.copy()
    times[-1] = 10**15
    write_session(replace(good, time_ns=times), file)
    with pytest.raises(InputError, match=r"round of .* s \(the longest gap .* at most 14400 s"):
        read_session(file)
    log = "condition x random seed 1\ntime," + ",".join(
        f"{device}_{part}"
        for device in ("left", "head", "right")
        for part in ("pos_x", "pos_y", "pos_z", "quat_x", "quat_y", "quat_z", "quat_w")
    )
    pose = ",".join(["0,1,0,0,0,0,1"] * 3)
    (tmp_path / "states.csv").write_text(f"{log}\n0,{pose}\n1000000,{pose}\n2000000,{pose}\n")
    (tmp_path / "events.csv").write_text("0, target_spawn, target ID 0, grid ID 1\n")
    with pytest.raises(InputError, match="at most 14400 s"):
        read_session(tmp_path)


def test_a_time_of_events_is_a_finite_number(tmp_path: Path) -> None:
    events = tmp_path / "events.csv"
    events.write_text(f"{10**400}, target_spawn, target ID 0, grid ID 1\n1, x\n")
    with pytest.raises(InputError, match=r"line 1: got the time .*, expected -1e9 to 1e9 s"):
        numbered_events(events)


def test_a_recording_of_iwer_has_a_limit_of_its_own(tmp_path: Path) -> None:
    file = tmp_path / "large.json"
    with file.open("wb") as stream:
        stream.write(b'{"schema": [], "frames": [')
        stream.truncate(MOST_IWER + 1)
    with pytest.raises(InputError, match="more than 67,108,864 bytes"):
        read_session(file)


def test_texts_of_a_session_have_no_control_characters(tmp_path: Path) -> None:
    file = tmp_path / "round.jsonl"
    file.write_bytes(put(0, "person", value="\x1b[2Jeve")())
    assert read_session(file).person == r"\x1b[2Jeve"


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
    for level in (
        "../secret.dat",
        str(tmp_path / "secret.dat"),
        "/etc/passwd",
        "file:///etc/passwd",
    ):
        with pytest.raises(InputError, match=r"option level: got .* copy it to "):
            chosen(level)
