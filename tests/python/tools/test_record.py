"""The recorder: a session file has what the page's headset reports, and strangers stay out."""

import hashlib
import http.client
import importlib.util
import random
import shutil
import socket
import ssl
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing, suppress
from pathlib import Path
from types import ModuleType
from typing import Any
from urllib.parse import unquote, urlsplit

import numpy as np
import pytest

from chromium import Page
from parts import needs
from sim2vr_harness.sessions import Session, read_session
from sim2vr_harness.sessions.replay import replay_session
from sim2vr_harness.tools.record import RecordingServer, bookmarklet, parts, script_tag, server
from sim2vr_harness.tools.record.parts import MAX_PART_BYTES, Parts, RefusedPart
from sim2vr_harness.tools.record.script import with_script
from webxr_pages import ENGINES, NEEDS_BROWSER, PAGES

FRAMES = 120
SEED = 20260
ONE = "0" * 32
HEADER = '{"format":"sim2vr-session","version":1,"app":{"kind":"page"}}\n'
FRAME = '{"t":0,"head":[0,1.5,0,0,0,0,1]}\n'


def mulberry(seed: int) -> Iterator[int]:
    """The published Mulberry32, in Python's integers."""
    mask, state = 2**32 - 1, seed
    while True:
        state = (state + 0x6D2B79F5) & mask
        t = ((state ^ (state >> 15)) * (1 | state)) & mask
        t = ((t + ((t ^ (t >> 7)) * (61 | t) & mask)) & mask) ^ t
        yield (t ^ (t >> 14)) & mask


def about_y(position: tuple[object, object, object], angle: object) -> np.ndarray:
    """Poses of WebXR's frame in the app's: z and the turn about y have the other sign."""
    x, y, z, half = np.broadcast_arrays(*position, np.asarray(angle) / 2)
    zero = np.zeros_like(half)
    return np.stack([x, y, -z, zero, -np.sin(half), zero, np.cos(half)], axis=-1)


def check_session(session: Session) -> None:
    """Compare a recording of ``recorded.html`` with the formulas of its headset."""
    n = np.arange(FRAMES)
    np.testing.assert_allclose(session.time_ns, n * 1e9 / 90, atol=2000)  # performance.now: 1 us
    exact = {"rtol": 0, "atol": 1e-12}
    np.testing.assert_allclose(session.head, about_y((0.01 * n, 1.5, -0.1), 0.01 * n), **exact)
    right, left = session.right, session.left
    assert right is not None and left is not None
    height = 1.0 + 0.001 * n
    np.testing.assert_allclose(right.grip, about_y((0.2, height, -0.3), -0.02 * n), **exact)
    np.testing.assert_allclose(right.aim, about_y((0.2, height, -0.35), 0.03 * n), **exact)
    row = np.zeros((FRAMES, 13))
    row[:, 0], row[:, 2], row[:, 3], row[:, 8] = n / FRAMES, 0.25, 0.5, n % 2
    np.testing.assert_allclose(right.inputs, row, **exact)
    assert right.joints is None
    seen = (n < 50) | (n >= 60)
    assert left.tracked.tolist() == seen.tolist()
    grip = about_y((-0.2, 1.1, -0.3 - 0.002 * n), 0.1)
    np.testing.assert_allclose(left.grip[seen], grip[seen], **exact)
    pinched = (n >= 30) & (n < 45)
    np.testing.assert_allclose(left.inputs[seen, 0], pinched[seen], **exact)
    k = np.arange(25)
    joints = np.concatenate([about_y((0.01 * k, 1, -0.5), 0.3), 0.001 * k[:, None]], axis=1)
    np.testing.assert_allclose(left.joints[seen], np.broadcast_to(joints, (110, 25, 8)), **exact)
    assert [(event.kind, dict(event.data)) for event in session.events] == [
        ("haptic", {"hand": "right", "amplitude": 0.5, "frequency_hz": 0, "duration_s": 0.04}),
        ("haptic", {"hand": "right", "amplitude": 0.5, "frequency_hz": 0, "duration_s": 0.08}),
    ]
    assert [event.time_ns for event in session.events] == session.time_ns[[40, 80]].tolist()
    assert (session.rate_hz, session.headset, session.app.kind) == (90, "test-controller", "page")


@pytest.fixture
def recording(tmp_path: Path) -> Iterator[RecordingServer]:
    """A server of the page with a headset of its own."""
    with (
        closing(RecordingServer(PAGES / "recorded.html", SEED, tmp_path / "out.jsonl")) as made,
        made.running(),
    ):
        yield made


@NEEDS_BROWSER
def test_what_the_headset_reports_is_recorded(recording: RecordingServer) -> None:
    with Page(60.0, served=True) as page:
        page.open(recording.address, 800)
        assert recording.wait(60.0)
        drawn, beside = page.value("drawn"), page.value("window.beside")
        assert page.value("window.asked") == ["immersive-vr", "hand-tracking", "local-floor"]
        assert page.errors == []
    session = recording.session()
    assert session is not None
    check_session(session)
    assert (session.app.name, session.seed) == ("recorded.html", SEED)
    assert beside is True
    assert drawn[4:] == ["0.5 40", "0.5 80"]  # the pulses reached the headset
    bits = mulberry(SEED)
    numbers = [(next(bits) * 2**21 + (next(bits) >> 11)) / 2**53 for _ in range(2)]
    octets = f"{next(bits) & 255},{next(bits) & 255}"
    last = (next(bits) * 2**21 + (next(bits) >> 11)) / 2**53
    assert drawn[:4] == [*numbers, octets, last]


@NEEDS_BROWSER
@pytest.mark.parametrize("way", ["script tag", "bookmarklet"])
def test_a_page_that_is_not_served_downloads_the_same(way: str, tmp_path: Path) -> None:
    text = (PAGES / "recorded.html").read_text()
    if way == "script tag":
        text = text.replace("<head>", f"<head>{script_tag(SEED)}", 1)
    else:  # as a click on it: after the page's own scripts, before the session
        code = unquote(bookmarklet().removeprefix("javascript:"))
        text = text.replace("</head>", f"<script>{code}</script></head>")
    file = tmp_path / "recorded.html"
    file.write_text(text)
    session, drawn = downloaded(file, tmp_path)
    check_session(session)
    assert session.seed == (SEED if way == "script tag" else None)
    if way == "script tag":
        bits = mulberry(SEED)
        expected = [(next(bits) * 2**21 + (next(bits) >> 11)) / 2**53 for _ in range(3)]
        assert [drawn[0], drawn[1], drawn[3]] == expected  # crypto stays the browser's own


def downloaded(file: Path, folder: Path) -> tuple[Session, list[object]]:
    """The session that a page downloads, and what it drew."""
    with Page(60.0, served=True) as page:
        page.call("Browser.setDownloadBehavior", behavior="allow", downloadPath=str(folder))
        page.open(f"file://{file}", 800)
        page.wait_for("window.over")
        drawn = page.value("drawn")
        found = folder / "session.jsonl"
        for _ in range(300):
            if found.is_file():
                break
            time.sleep(0.1)
    return read_session(found), drawn


# --- the server ----------------------------------------------------------------------------------


def ask(
    made: RecordingServer, method: str, path: str, body: bytes = b"", **headers: str
) -> tuple[int, str, dict[str, str]]:
    """Status, body and headers of an answer."""
    connection = http.client.HTTPConnection("127.0.0.1", made.port, timeout=10.0)
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    connection.request(method, path, body or None, named)
    answer = connection.getresponse()
    found = answer.status, answer.read().decode(), dict(answer.getheaders())
    connection.close()
    return found


def part(made: RecordingServer, number: int = 0, last: int = 0, session: str = ONE) -> str:
    return f"/{made.gate.token}/__sim2vr/part?session={session}&part={number}&last={last}"


def own(made: RecordingServer) -> dict[str, str]:
    """Headers of the page itself."""
    return {"Origin": f"http://localhost:{made.port}", "Host": f"localhost:{made.port}"}


def test_only_the_page_sends_parts(recording: RecordingServer) -> None:
    good, body = part(recording), (HEADER + FRAME).encode()
    right = own(recording)
    for path, headers, why in (
        (good, {}, "Origin"),
        (good, {"Origin": "null"}, "Origin"),
        (good, {"Origin": "http://evil.example"}, "Origin"),
        (good, right | {"Host": "evil.example"}, "Host"),
        (good.replace(recording.gate.token, "a" * 32), right, "Token"),
        (good.replace(f"/{recording.gate.token}", ""), right, "Token"),
    ):
        status, text, _ = ask(recording, "POST", path, body, **headers)
        assert (status, text.split(":")[0]) == (403, why), (path, headers, text)
    assert recording.session() is None
    assert ask(recording, "POST", good, body, **right)[0] == 204
    session = recording.session()
    assert session is not None and len(session) == 1


def test_the_cookie_reads_files_and_sends_nothing(recording: RecordingServer) -> None:
    assert ask(recording, "GET", "/beside.js")[0] == 403
    status, text, headers = ask(recording, "GET", f"/{recording.gate.token}/recorded.html")
    assert status == 200
    assert text.index("recorder.js") < text.index("const FRAMES")
    cookie = headers["Set-Cookie"]
    assert "HttpOnly" in cookie and "SameSite=Strict" in cookie
    assert recording.gate.token not in cookie
    pair = cookie.split(";")[0]
    assert ask(recording, "GET", "/beside.js", Cookie=pair)[0] == 200
    assert ask(recording, "GET", "/beside.js", Cookie=f"{pair}x")[0] == 403
    assert ask(recording, "GET", "/beside.js", Cookie=pair, Host="evil.example")[0] == 403
    sent = part(recording).replace(f"/{recording.gate.token}", "")
    body = (HEADER + FRAME).encode()
    assert ask(recording, "POST", sent, body, Cookie=pair, **own(recording))[0] == 403


def test_files_outside_the_folder_and_hidden_ones_are_not_served(tmp_path: Path) -> None:
    folder = tmp_path / "page"
    folder.mkdir()
    (folder / "index.html").write_text("<p>hello")
    (folder / ".env").write_text("secret")
    (tmp_path / "outside.txt").write_text("secret")
    (folder / "link.txt").symlink_to(tmp_path / "outside.txt")
    with closing(RecordingServer(folder, 1, tmp_path / "out.jsonl")) as made, made.running():
        token = f"/{made.gate.token}"
        assert "recorder.js" in ask(made, "GET", f"{token}/")[1]
        for path in ("/.env", "/%2eenv", "/../outside.txt", "/..%2foutside.txt", "/link.txt"):
            status, text, _ = ask(made, "GET", token + path)
            assert (status, "secret" in text) == (404, False), path


def test_sizes_and_rates_are_bounded(
    recording: RecordingServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    headers, url = own(recording), part(recording)
    connection = http.client.HTTPConnection("127.0.0.1", recording.port, timeout=10.0)
    connection.putrequest("POST", url, skip_host=True)
    for name, value in headers.items():
        connection.putheader(name, value)
    connection.putheader("Content-Length", str(MAX_PART_BYTES + 1))
    connection.endheaders()
    assert connection.getresponse().status == 413  # before any of it was sent
    connection.close()
    assert ask(recording, "POST", url.replace("part=0", "part=x"), b"1", **headers)[0] == 400
    monkeypatch.setattr(parts, "MAX_BYTES", 100)
    assert ask(recording, "POST", url, b" " * 101, **headers)[0] == 413
    assert ask(recording, "POST", url, b" " * 99, **headers)[0] == 204
    assert ask(recording, "POST", part(recording, 1), b"  ", **headers)[0] == 413
    other = part(recording, 1, session="1" * 32)
    assert ask(recording, "POST", other, b" ", **headers)[0] == 409
    monkeypatch.setattr(parts, "PARTS_PER_SECOND", 0.0)
    found = [ask(recording, "POST", part(recording, 1), b" ", **headers)[0] for _ in range(41)]
    assert found[-1] == 429


def test_strangers_make_room_for_the_page(recording: RecordingServer) -> None:
    """The page has the same address as they, and is answered all the same."""
    place = ("127.0.0.1", recording.port)
    with ExitStack() as held:
        strangers = [held.enter_context(socket.create_connection(place)) for _ in range(64)]
        for each in strangers:
            with suppress(OSError):
                each.send(b"GET / HT")
        body = (HEADER + FRAME).encode()
        assert ask(recording, "POST", part(recording), body, **own(recording))[0] == 204
        strangers[0].settimeout(5.0)
        assert b"more than 16 from one address" in strangers[0].recv(1000)


def attacks() -> ModuleType:
    """The program that attacks the recorder."""
    file = Path(__file__).parents[3] / "tools/attack/recorder.py"
    spec = importlib.util.spec_from_file_location("attack_recorder", file)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_killed_recorders_lose_nothing(tmp_path: Path) -> None:
    counts = attacks().kills(tmp_path, 3, random.Random(1))
    assert counts == {"SIGHUP": 1, "SIGQUIT": 1, "SIGKILL": 1}


def test_parts_come_in_any_order_and_twice(tmp_path: Path) -> None:
    kept = Parts(tmp_path / "out.jsonl")
    lines = [HEADER, FRAME, FRAME.replace('"t":0', '"t":5')]
    for number in (2, 0, 0):
        kept.take(f"session={ONE}&part={number}&last={int(number == 2)}", lines[number].encode())
    assert not kept.complete.is_set()
    early = kept.session()
    assert early is not None and early.time_ns.tolist() == [5]
    assert "1 part of the session did not arrive" in early.notes
    kept.take(f"session={ONE}&part=1&last=0", lines[1].encode())
    assert kept.complete.is_set()
    session = kept.session()
    assert session is not None and session.time_ns.tolist() == [0, 5]
    with pytest.raises(RefusedPart, match="no more parts"):
        kept.take(f"session={ONE}&part=3&last=0", b"")
    kept.close()


@pytest.mark.skipif(shutil.which("openssl") is None, reason="no openssl")
def test_the_local_network_is_served_over_https(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(server, "local_address", lambda: "127.0.0.2")
    page, out = PAGES / "recorded.html", tmp_path / "out.jsonl"
    with closing(RecordingServer(page, 1, out, lan=True)) as made, made.running():
        at = urlsplit(made.address)
        assert (at.scheme, at.hostname) == ("https", "127.0.0.2")
        context = ssl.create_default_context()
        context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
        connection = http.client.HTTPSConnection(
            "127.0.0.2", made.port, timeout=10.0, context=context
        )
        connection.connect()
        given = connection.sock.getpeercert(binary_form=True)
        print_of = hashlib.sha256(given).hexdigest()
        assert made.fingerprint.replace(":", "").lower() == print_of
        connection.request("GET", at.path)
        assert b"recorder.js" in connection.getresponse().read()
        body, origin = (HEADER + FRAME).encode(), f"https://127.0.0.2:{made.port}"
        connection.request("POST", part(made), body, {"Origin": origin})
        assert connection.getresponse().status == 204
        connection.close()


@pytest.mark.parametrize(
    ("document", "before"),
    [
        (b"<!doctype html><html lang=en><head><title>", b"<!doctype html><html lang=en><head>"),
        (b"\xef\xbb\xbf<!-- <head> -->\n<script>1</script>", b"\xef\xbb\xbf<!-- <head> -->\n"),
        (b"<header>hello", b""),
        (b"<HTML>\n<HEAD ><script>", b"<HTML>\n<HEAD >"),
        (b"", b""),
    ],
)
def test_the_recorder_comes_first(document: bytes, before: bytes) -> None:
    rest = document.removeprefix(before)
    assert with_script(document, "/a.js") == before + b'<script src="/a.js"></script>' + rest


# --- an emulated headset -------------------------------------------------------------------------

BALLS = """
const device = window.device = new IWER.XRDevice(IWER.metaQuest3);
device.installRuntime({ forceInstall: true });
window.drive = () => {
  const begun = Date.now();
  const ball = BABYLON.EngineStore.LastCreatedScene.getMeshByName('ball').position;
  const at = { x: 0.2, y: 1, z: 0.2 };
  let last = begun;
  setInterval(() => {  // what the hand covers depends on time: a busy machine calls this seldom
    const now = Date.now(), covered = 1 - Math.exp((last - now) / 200);
    last = now;
    const goal = { x: ball.x, y: ball.y, z: Math.min(0.8, Math.max(0.3, ball.z)) };
    for (const axis of 'xyz') at[axis] += covered * (goal[axis] - at[axis]);
    device.controllers.right.position.set(at.x, at.y, -at.z);
    if (now - begun > 12000 && app.caught > 1) device.activeSession?.end();
  }, 10);
};
"""
IWER = ENGINES / "iwer@2.5.0" / "build" / "iwer.js"
needs_iwer = needs("npm", IWER.is_file(), "docs/examples/webxr/engines.sh was not run")


def recorded(page: Path, drive: str, button: str, ready: str, over: str) -> tuple[Session, Any]:
    """Record a page, with an emulated headset that a script moves; its session, and ``over``."""
    shutil.copy(IWER, page.parent)
    (page.parent / "drive.js").write_text(drive)
    scripts = '<script src="iwer.js"></script><script src="drive.js"></script>'
    page.write_text(page.read_text().replace("<title>", f"{scripts}<title>"))
    with (
        closing(RecordingServer(page, SEED, page.with_name("out.jsonl"))) as made,
        made.running(),
        Page(60.0, served=True) as shown,
    ):
        shown.open(made.address, 800)
        shown.wait_for(f"!!{button} && {ready}")
        shown.value(f"{button}.click()")
        shown.wait_for("!!device.activeSession")
        shown.value("drive()")
        assert made.wait(60.0)
        found = shown.value(over)
        session = made.session()
    assert session is not None
    return session, found


@NEEDS_BROWSER
@needs_iwer
def test_a_page_that_moves_before_vr_replays_the_same(tmp_path: Path) -> None:
    """Its balls fly while the page waits, and each is thrown by chance."""
    folder = ENGINES.parent / "balls"
    text = (folder / "index.html").read_text()
    address = "https://cdn.jsdelivr.net/npm/babylonjs@9.34.0/babylon.js"
    shutil.copy(ENGINES / "babylonjs@9.34.0" / "babylon.js", tmp_path)
    (tmp_path / "index.html").write_text(text.replace(address, "babylon.js"))
    button, counts = "document.querySelector('.babylonVRicon')", "[app.caught, app.missed]"
    session, (caught, missed) = recorded(
        tmp_path / "index.html", BALLS, button, "app.missed > 0", counts
    )
    assert session.page_start is not None
    assert missed >= 1 and caught >= 2
    assert session.page_start.requested_ms > 2000 and len(session.page_start.frames_ms) > 10
    settings = {
        "transport": "webxr",
        "page": str(folder),
        "map": {"https://cdn.jsdelivr.net/npm/": str(ENGINES)},
        "task": str(folder / "task.yaml"),
    }
    replayed = replay_session(session, app=settings)
    assert replayed.comparison.same and replayed.comparison.same_frame == caught
    assert (replayed.values["caught"], replayed.values["missed"]) == (caught, missed)
