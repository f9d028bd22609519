"""The same round of a page four times beside a busy processor: equal logs of what ran when."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from sim2vr_harness.client import frame_time_ns
from webxr_pages import NEEDS_BROWSER, hands, open_page, page_with

pytestmark = NEEDS_BROWSER

ROUNDS, STEPS = 4, 30

BETWEEN_FRAMES = """import { Boxes, button } from './boxes.js';
const boxes = new Boxes();
const app = window.app = { log: [] };
const note = (...what) => app.log.push([...what, performance.now()].join(' '));
const box = document.body.appendChild(document.createElement('div'));
box.style.cssText = 'width: 300px; height: 200px; transition: opacity 0.3s';
new ResizeObserver(([{ contentRect }]) => note('resize', contentRect.width)).observe(box);
new IntersectionObserver(([{ intersectionRatio }]) => note('seen', intersectionRatio)).observe(box);
box.ontransitionend = () => note('faded');
crypto.subtle.digest('SHA-256', new Uint8Array(4e6)).then(() => note('digest'));
createImageBitmap(new ImageData(900, 900)).then(() => note('bitmap'));
new OfflineAudioContext(1, 441000, 44100).startRendering().then(() => note('sound'));
const picture = new Image();
picture.onload = () => picture.decode().then(() => note('image'));
picture.src = `data:image/svg+xml,<svg xmlns="http://www.w3.org/2000/svg" width="2000"
  height="2000">
  <rect width="2000" height="2000"/></svg>`;
const copied = async (name) => { // a body that the page feeds, as engines count what has come
  const reader = (await fetch(`boxes.js?${name}`)).body.getReader();
  const pull = (controller) => reader.read().then(({ done, value }) => {
    if (done) controller.close();
    else controller.enqueue(value);
    if (!done) pull(controller);
  });
  note('copied', name, (await new Response(new ReadableStream({ start: pull })).text()).length);
};
copied('a').then(() => copied('b'));
copied('c');
const channel = new MessageChannel();
let left = 2000;
channel.port1.onmessage = () => (--left ? channel.port2.postMessage(0) : note('chain'));
channel.port2.postMessage(0);
const chain = async () => { for (let k = 0; k < 1000; k++) await null; note('promises'); };
chain();
requestIdleCallback(() => note('idle'));
document.fonts.ready.then(() => note('fonts'));
const text = 'onmessage = ({ data }) => setTimeout(() => postMessage(data + 1), 40);';
const worker = new Worker(URL.createObjectURL(new Blob([text])));
worker.onmessage = ({ data }) => { note('worker', data); worker.postMessage(data); };
worker.postMessage(0);
let wide = 300;
setInterval(() => { box.style.width = `${wide++}px`; }, 20);
setInterval(() => { box.style.opacity = 1.5 - box.style.opacity; }, 700);
box.style.opacity = 1;
button('Enter VR', (event) => {
  note('click', event.isTrusted);
  boxes.enter((time) => note('frame', time));
});"""


@pytest.fixture
def busy() -> Iterator[None]:
    processes = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(3)]
    yield
    for process in processes:
        process.kill()
        process.wait()


@pytest.mark.usefixtures("busy")
def test_what_the_browser_does_between_frames(tmp_path: Path) -> None:
    """Every second round is in a browser that has played."""
    logs = []
    for _ in range(ROUNDS // 2):
        page = page_with(tmp_path, BETWEEN_FRAMES)
        with open_page(page, timeout_s=120.0, start_timeout_s=120.0) as app:
            for _ in range(2):
                app.reset(1, hands(0))
                for step in range(1, STEPS):
                    app.step(frame_time_ns(step, 20), hands(step))
                logs.append(app._page._evaluate("app.log"))
    assert logs[1:] == logs[:1] * (ROUNDS - 1)
    kinds = {line.split()[0] for line in logs[0]}
    assert kinds >= {
        *("resize", "seen", "faded", "digest", "bitmap", "sound", "image", "chain", "promises"),
        *("idle", "fonts", "worker", "click", "frame", "copied"),
    }
    assert sum(line.startswith("frame") for line in logs[0]) == STEPS
