"""The recorder's JavaScript: in a page that is served, as a script tag, as a bookmarklet."""

import json
import re
from pathlib import Path
from urllib.parse import quote

from sim2vr_harness.client.webxr.page import read_script

_BEFORE_SCRIPTS = re.compile(
    rb"(?:\s|\xef\xbb\xbf|<!--.*?-->|<!doctype[^>]*>)*"
    rb"(?:<html(?:\s[^>]*)?>)?(?:\s|<!--.*?-->)*(?:<head(?:\s[^>]*)?>)?",
    re.DOTALL | re.IGNORECASE,
)
"""The beginning of a document in HTML, up to where its first script may be."""


def recorder_script(page: str, url: str, seed: int) -> str:
    """Return the recorder of a page that is served.

    Args:
        page: Name of the page.
        url: Address that the recorder sends its recording to.
        seed: Of the page's random numbers.
    """
    return _script(json.dumps({"page": page, "url": url, "seed": seed}), read_script("random.js"))


def script_tag(seed: int) -> str:
    """Return the recorder as an element for the top of a page; it downloads the session."""
    settings = json.dumps({"seed": seed, "realCrypto": True})
    return f"<script>\n{_script(settings, read_script('random.js'))}</script>\n"


def bookmarklet() -> str:
    """Return the recorder as an address to click in a page that is loaded.

    It sets no seed, because the page has already drawn random numbers.
    """
    return "javascript:" + quote(_script('{"late":true}', "").strip(), safe="(){}[]=>,;:'!?*+/|&.")


def with_script(document: bytes, address: str) -> bytes:
    """Return an HTML document whose first script is the one at an address."""
    match = _BEFORE_SCRIPTS.match(document)
    end = match.end() if match else 0
    return document[:end] + f'<script src="{address}"></script>'.encode() + document[end:]


def _script(settings: str, seeding: str) -> str:
    recorder = (Path(__file__).parent / "recorder.js").read_text(encoding="utf-8")
    parts = f"{seeding}{recorder}"
    return f"((window) => {{\nconst sim = {{ settings: {settings} }};\n{parts}}})(self);\n"
