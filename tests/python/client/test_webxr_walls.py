"""What a page may not: read files outside its folder, reach the network, write anywhere."""

import re
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from sim2vr_harness.client import AppRefused, WebXRApp, frame_time_ns
from sim2vr_harness.client.webxr import page as page_module
from sim2vr_harness.client.webxr.files import HOST, PageFiles
from webxr_pages import NEEDS_BROWSER, hands, open_page, page_with

PRYING = """import { Boxes, button } from './boxes.js';
const app = window.app = { told: '' };
const tell = (what) => { app.told += what + ' '; };
const status = (url) => fetch(url).then((reply) => reply.status, () => 'refused');
tell(await status('../secret.txt'));
tell(await status('%2e%2e/secret.txt'));
tell(await status('..%2fsecret.txt'));
tell(await status('link.txt'));
tell(await status('inside.txt'));
tell(typeof SharedWorker === 'undefined' ? 'none' : 'made');
tell(await navigator.storage.getDirectory().then(() => 'made', () => 'none'));
tell(window.open('about:blank') === null ? 'none' : 'made');
const worker = new Worker('worker.js');
tell(await new Promise((resolve) => { worker.onmessage = ({ data }) => resolve(data); }));
const boxes = new Boxes();
button('Enter VR', () => boxes.enter(() => {}));
"""
WORKER = """const tries = ['https://example.com/', 'http://127.0.0.1:%d/', 'file:///etc/passwd'];
Promise.all(tries.map((url) => fetch(url).then(() => 'reached', () => 'refused')))
  .then((found) => new Promise((resolve) => {
    const socket = new WebSocket('ws://127.0.0.1:%d/');
    socket.onopen = () => resolve([...found, 'reached']);
    socket.onerror = () => resolve([...found, 'refused']);
  })).then((found) => postMessage(found.join(' ')));"""


@NEEDS_BROWSER
def test_a_page_cannot_leave_its_folder(tmp_path: Path) -> None:
    folder = tmp_path / "page"
    folder.mkdir()
    (tmp_path / "secret.txt").write_text("secret")
    (folder / "inside.txt").write_text("inside")
    (folder / "link.txt").symlink_to(tmp_path / "secret.txt")
    page = page_with(folder, PRYING)
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        (folder / "worker.js").write_text(WORKER % (port, port))
        before = sorted(tmp_path.rglob("*"))
        with open_page(page) as app:
            try:
                app.reset(1, hands(0))
            except AppRefused as error:
                # The worker's own tries are seen, or it answers too late for this page.
                assert re.search("which app.map maps to no folder|never calls WebXR", str(error))
            told = _told(app, "app.told.split(' ').length > 12 ? app.told : null").split()
        server.setblocking(False)
        with pytest.raises(BlockingIOError):
            server.accept()
    assert told[:5] == ["404", "404", "404", "404", "200"]
    assert told[5:8] == ["none"] * 3
    assert told[8:] == ["refused"] * 4
    assert sorted(tmp_path.rglob("*")) == before


def test_addresses_lead_below_their_folders_only(tmp_path: Path) -> None:
    page = tmp_path / "page"
    engine = tmp_path / "engine"
    for folder in (page, engine / "build"):
        folder.mkdir(parents=True)
    (page / "index.html").write_text("<!doctype html>")
    (page / "a b.txt").write_text("spaced")
    (engine / "build" / "e.mjs").write_text("export {}")
    (tmp_path / "secret.txt").write_text("secret")
    cdn = "https://cdn.example.com/engine@1/"
    files = PageFiles(
        str(page), {cdn: str(engine), "https://one.example.com/x.js": str(engine / "build/e.mjs")}
    )
    assert files.url == f"{HOST}index.html"
    assert files.answer(f"{HOST}a%20b.txt?version=2#top").content == b"spaced"
    found = files.answer(f"{cdn}build/e.mjs")
    assert (found.status, found.mime) == (200, "text/javascript")
    assert files.answer("https://one.example.com/x.js").content == b"export {}"
    assert files.answer("https://one.example.com/x.js.map").status == 404
    for url in (
        f"{HOST}../secret.txt",
        f"{HOST}%2e%2e/secret.txt",
        f"{cdn}/etc/passwd",
        f"{HOST}%00",
    ):
        assert files.answer(url).status == 404
    assert files.answer("https://cdn.example.com/other/e.mjs").status == 0
    assert list(files.refused) == ["https://cdn.example.com/other/e.mjs"]


@pytest.fixture
def ports() -> Iterator[tuple[socket.socket, socket.socket]]:
    """A server that takes connections, and one that takes datagrams, on this machine."""
    with (
        socket.create_server(("127.0.0.1", 0)) as tcp,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp,
    ):
        udp.bind(("127.0.0.1", 0))
        for one in (tcp, udp):
            one.setblocking(False)
        yield tcp, udp


REACHING = """import { Boxes, button } from './boxes.js';
const app = window.app = { told: '' };
const [tcp, udp] = ['127.0.0.1:TCP', '127.0.0.1:UDP'];
const rels = ['prefetch', 'preconnect', 'preload', 'modulepreload', 'stylesheet', 'prerender'];
for (const rel of rels) {
  const link = Object.assign(document.createElement('link'), { rel, href: `http://${tcp}/${rel}` });
  if (rel === 'preload') link.as = 'image';
  document.head.append(link);
}
new Image().src = `http://${tcp}/image`;
new EventSource(`http://${tcp}/events`);
navigator.sendBeacon(`http://${tcp}/beacon`);
for (const src of [`http://${tcp}/frame`, 'file:///etc/passwd', 'chrome://version']) {
  document.body.append(Object.assign(document.createElement('iframe'), { src }));
}
const within = document.createElement('iframe');
document.body.append(within);
const other = within.contentWindow; // a window whose functions are the browser's own
const tries = {
  rtc: async () => {
    const turn = { urls: `turn:${tcp}?transport=tcp`, username: 'a', credential: 'b' };
    const peer = new other.RTCPeerConnection({ iceServers: [{ urls: `stun:${udp}` }, turn] });
    peer.createDataChannel('x');
    await peer.setLocalDescription(await peer.createOffer());
    await new Promise((resolve) => {
      peer.onicegatheringstatechange = () => peer.iceGatheringState === 'complete' && resolve();
    });
  },
  socket: () => new Promise((resolve, reject) => {
    const socket = new other.WebSocket(`ws://${tcp}/`);
    socket.onopen = resolve;
    socket.onerror = reject;
  }),
  transport: () => new other.WebTransport(`https://${udp}/`).ready,
  file: () => fetch('file:///etc/passwd'),
  worker: () => other.navigator.serviceWorker.register('worker.js'),
  popup: () => other.open(`http://${tcp}/popup`),
  download: () => {
    const link = document.createElement('a');
    link.href = URL.createObjectURL(new Blob(['downloaded']));
    link.download = 'downloaded.txt';
    link.click();
  },
};
for (const [name, attempt] of Object.entries(tries)) {
  try { await attempt(); app.told += name + ' '; } catch { app.told += 'no '; }
}
app.told += 'end';
const boxes = new Boxes();
button('Enter VR', () => boxes.enter(() => {}));
"""


@NEEDS_BROWSER
@pytest.mark.parametrize("walls", [True, False])
def test_nothing_gets_out_even_by_a_frame_within(
    tmp_path: Path,
    ports: tuple[socket.socket, socket.socket],
    monkeypatch: pytest.MonkeyPatch,
    walls: bool,
) -> None:
    if not walls:  # The browser itself has no way out, whatever scripts could get hold of.
        read = page_module.read_script
        monkeypatch.setattr(
            page_module, "read_script", lambda name: "" if name == "walls.js" else read(name)
        )
    tcp, udp = ports
    script = REACHING.replace("TCP", str(tcp.getsockname()[1]))
    page = page_with(tmp_path, script.replace("UDP", str(udp.getsockname()[1])))
    before = sorted(tmp_path.rglob("*"))
    with open_page(page) as app:
        app.reset(1, hands(0))
        assert "which app.map maps to no folder" in app.notes[0]
        told = _told(app, "app.told.endsWith('end') ? app.told : null").split()
        kept = list(app._browser.home.rglob("*download*"))
    if walls:
        assert told == ["no"] * 5 + ["popup", "download", "end"]  # the popup is null
    else:
        assert told[1:4] == ["no"] * 3
    with pytest.raises(BlockingIOError):
        tcp.accept()
    with pytest.raises(BlockingIOError):
        udp.recv(100)
    assert kept == []
    assert sorted(tmp_path.rglob("*")) == before


def _told(app: WebXRApp, expression: str) -> Any:
    deadline = time.monotonic() + 60.0
    while time.monotonic() < deadline:
        if (found := app._page._evaluate(expression)) is not None:
            return found
        time.sleep(0.05)
    raise AssertionError(f"{expression} is null for ever")


KEEPING = """import { Boxes, button } from './boxes.js';
const app = window.app = {};
const found = indexedDB.open('rounds', 1);
app.databases = await new Promise((resolve) => {
  found.onupgradeneeded = () => { resolve(0); found.result.createObjectStore('x'); };
  found.onsuccess = () => resolve(1);
});
app.caches = (await caches.keys()).length;
await caches.open('rounds');
app.local = Number(localStorage.rounds ?? 0);
app.session = Number(sessionStorage.rounds ?? 0);
app.cookies = document.cookie.length;
app.name = window.name.length;
addEventListener('pagehide', () => { // as a game that saves when it is left
  localStorage.rounds = sessionStorage.rounds = 1;
});
document.cookie = 'rounds=1';
window.name = 'rounds';
const boxes = new Boxes();
button('Enter VR', () => boxes.enter(() => {}));
"""


@NEEDS_BROWSER
def test_what_a_round_keeps_is_gone_in_the_next(shared: Callable[..., WebXRApp]) -> None:
    names = ("databases", "caches", "local", "session", "cookies", "name")
    values = {name: f"app.{name}" for name in names}
    app = shared(KEEPING, values=values)
    for _ in range(3):
        assert app.reset(1, hands(0)).values == dict.fromkeys(names, 0)


WINDOWS = """import { Boxes, button } from './boxes.js';
const frame = document.createElement('iframe');
frame.srcdoc = '<a href=boxes.js target=_blank></a><form target=_blank></form>';
await new Promise((resolve) => { frame.onload = resolve; document.body.append(frame); });
const within = frame.contentDocument;
const link = document.body.appendChild(document.createElement('a'));
Object.assign(link, { href: 'boxes.js', target: '_blank', rel: 'noopener' });
const open = () => {
  window.open('about:blank');
  window.open('boxes.js', '_blank', 'noopener');
  frame.contentWindow.open('about:blank');
  link.click();
  within.querySelector('a').click();
  within.querySelector('form').submit();
};
const boxes = new Boxes();
let left = 300;
const storm = () => { for (let k = 0; k < 100 && left > 0; k++, left--) open(); };
button('Enter VR', () => boxes.enter(storm));
"""


@NEEDS_BROWSER
def test_a_storm_of_windows_opens_none(tmp_path: Path) -> None:
    with open_page(page_with(tmp_path, WINDOWS)) as app:
        app.reset(1, hands(0))
        for step in range(1, 6):
            assert not app.step(frame_time_ns(step, 20), hands(step)).finished
        targets = app._browser.request("Target.getTargets", 30.0)["targetInfos"]
        assert sum(one["type"] == "page" for one in targets) == 1
