"""What a page may have us keep, and how much memory it may take."""

from pathlib import Path

import pytest

from sim2vr_harness.client import AppDied, AppRefused, frame_time_ns, limits
from sim2vr_harness.client.limits import Kept
from sim2vr_harness.client.webxr.files import HOST, PageFiles
from webxr_pages import NEEDS_BROWSER, hands, open_page, page_with


def test_the_first_and_the_last_texts_are_kept() -> None:
    kept = Kept()
    assert not kept
    for k in range(1000):
        kept.add(f"{k} " + "x" * 10_000)
    words = [text.split()[0] for text in kept]
    assert words == [str(k) for k in [*range(20), *range(980, 1000)]]
    assert (len(kept), max(map(len, kept))) == (1000, 300)
    assert (kept.first[:2], kept.last[:4]) == ("0 ", "999 ")
    kept.clear()
    assert (len(kept), list(kept)) == (0, [])
    kept.add("one")
    assert kept.first == kept.last == "one"


def test_addresses_without_a_file_are_counted(tmp_path: Path) -> None:
    (tmp_path / "index.html").write_text("<!doctype html>")
    files = PageFiles(str(tmp_path), {})
    for k in range(1000):
        assert files.answer(f"{HOST}{k}.png").status == 404
        assert files.answer(f"https://elsewhere.example.com/{k}.png").status == 0
    assert (len(files.missing), len(list(files.missing))) == (1000, 40)
    assert (len(files.refused), len(list(files.refused))) == (1000, 40)


@NEEDS_BROWSER
def test_a_flood_of_messages_is_counted(tmp_path: Path) -> None:
    script = """import { Boxes, button } from './boxes.js';
    const boxes = new Boxes();
    const flood = () => { for (let k = 0; k < 20000; k++) console.error('message', k); };
    button('Enter VR', () => boxes.enter(flood));"""
    with open_page(page_with(tmp_path, script)) as app:
        app.reset(1, hands(0))
        app.step(frame_time_ns(1, 20), hands(1))
        complaints = app._page._watch._complaints
        assert (len(complaints), len(list(complaints))) == (40_000, 40)
        assert complaints.last == "message 19999"


@NEEDS_BROWSER
def test_files_that_are_missing_are_said_in_one_line(tmp_path: Path) -> None:
    script = "for (let k = 0; k < 300; k++) await fetch(`${k}.png`);"
    with (
        open_page(page_with(tmp_path, script)) as app,
        pytest.raises(AppRefused, match=r"not found: \S*/0\.png, .*/4\.png and 295 more"),
    ):
        app.reset(1, hands(0))


@NEEDS_BROWSER
@pytest.mark.parametrize(
    "kept", ["new Uint8Array(2e7).fill(1)", "Array(2e6).fill().map(() => [0])"]
)
def test_a_page_that_takes_too_much_memory_has_failed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kept: str
) -> None:
    monkeypatch.setattr(limits, "MOST_MEMORY_BYTES", 400 << 20)
    script = f"""import {{ Boxes, button }} from './boxes.js';
    const boxes = new Boxes();
    const all = [];
    let frames = 0;
    const take = () => {{ while (frames > 0) all.push({kept}); frames++; }};
    button('Enter VR', () => boxes.enter(take));"""
    with open_page(page_with(tmp_path, script)) as app:
        app.reset(1, hands(0))
        with pytest.raises(
            AppDied,
            match=r"page\.html: takes \d+ MB of memory with its browser, expected at most 400",
        ):
            app.step(frame_time_ns(1, 20), hands(1))
