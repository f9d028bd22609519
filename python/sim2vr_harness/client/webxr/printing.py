"""Print a page of our own as a PDF, by the browser that shows WebXR pages."""

import base64
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sim2vr_harness.base.files import naming
from sim2vr_harness.client.errors import AppTimeout
from sim2vr_harness.client.webxr.browser import Browser, find_browser
from sim2vr_harness.client.webxr.tab import open_tab

_WAIT_S = 0.1


def print_page(page: Path, file: Path, *, timeout_s: float = 60.0) -> Path:
    """Print an HTML file on A4.

    Args:
        page: The HTML file, which needs no network.
        file: The PDF.
        timeout_s: Of the browser.

    Raises:
        AppRefused: There is no browser.
        AppDied, AppTimeout: It ends, or does not answer.
    """
    browser = Browser(find_browser(), timeout_s)
    try:
        tab = open_tab(browser, timeout_s).session

        def ask(method: str, **parameters: object) -> Mapping[str, Any]:
            return browser.tools.request(method, parameters, tab, timeout_s=timeout_s)

        ask("Page.enable")
        ask("Page.navigate", url=page.resolve().as_uri())
        deadline = time.monotonic() + timeout_s
        state = {"expression": "document.readyState", "returnByValue": True}
        while ask("Runtime.evaluate", **state)["result"] != {"type": "string", "value": "complete"}:
            if time.monotonic() > deadline:
                raise AppTimeout(f"{page.name}: the browser did not load it in {timeout_s:g} s")
            time.sleep(_WAIT_S)
        printed = ask(
            "Page.printToPDF", printBackground=True, paperWidth=8.27, paperHeight=11.69, scale=0.75
        )
        with naming(file):
            file.write_bytes(base64.b64decode(str(printed["data"])))
        return file
    finally:
        browser.stop()
