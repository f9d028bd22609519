"""A page in a headless Chromium, as people would see it: opened, measured, pictures taken of it.

The browser and the conversation with it are those that play WebXR pages.
"""

from __future__ import annotations

import base64
import time
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any
from unittest import mock

from sim2vr_harness.client.webxr import browser
from sim2vr_harness.client.webxr.browser import Browser, find_browser

__all__ = ["Page"]


class Page:
    """One page of a browser of its own.

    Args:
        timeout_s: How long anything may take.
        served: Whether it may reach servers of this machine, as WebXR pages must not.

    Attributes:
        errors: What its console had of errors.
    """

    def __init__(self, timeout_s: float = 120.0, *, served: bool = False) -> None:
        self.errors: list[str] = []
        self._timeout_s = timeout_s
        walls = ("--proxy-", "--host-resolver-") if served else ()
        flags = [flag for flag in browser._ALWAYS if not flag.startswith(walls)]
        with mock.patch.object(browser, "_ALWAYS", tuple(flags)):
            self._browser = Browser(find_browser(), timeout_s)
        target = self._browser.request("Target.createTarget", timeout_s, url="about:blank")
        attached = self._browser.request(
            "Target.attachToTarget", timeout_s, targetId=target["targetId"], flatten=True
        )
        self._session = str(attached["sessionId"])
        for event, hear in (
            ("Runtime.exceptionThrown", self._thrown),
            ("Runtime.consoleAPICalled", self._called),
            ("Log.entryAdded", self._logged),
        ):
            self._browser.tools.on(event, hear)
        for domain in ("Page", "Runtime", "Log"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **parameters: Any) -> Any:
        """Ask the page; see Chromium's developer tools."""
        tools = self._browser.tools
        return tools.request(method, parameters, self._session, timeout_s=self._timeout_s)

    def open(self, address: str, width: int, height: int = 900) -> None:
        """Load an address into a window of so many pixels; a narrow one is a telephone's."""
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 500}
        self.call("Emulation.setDeviceMetricsOverride", **size)
        self.call("Page.navigate", url=address)

    def value(self, expression: str) -> Any:
        """Return what a JavaScript expression is worth."""
        found = self.call("Runtime.evaluate", expression=expression, returnByValue=True)
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def wait_for(self, condition: str) -> None:
        """Wait until a JavaScript expression is true."""
        deadline = time.monotonic() + self._timeout_s
        while not self.value(condition):
            if time.monotonic() > deadline:
                raise TimeoutError(f"{condition} did not come true")
            time.sleep(0.2)

    def picture(self, file: Path, whole: bool = True) -> None:
        """Write a PNG file of the whole page, or of the window."""
        found = self.call("Page.captureScreenshot", format="png", captureBeyondViewport=whole)
        file.write_bytes(base64.b64decode(found["data"]))

    def _thrown(self, told: Mapping[str, Any]) -> None:
        self.errors.append(str(told["exceptionDetails"].get("exception", {}).get("description")))

    def _called(self, told: Mapping[str, Any]) -> None:
        if told["type"] in ("error", "assert"):
            self.errors.append(" ".join(str(each.get("value", each)) for each in told["args"]))

    def _logged(self, told: Mapping[str, Any]) -> None:
        if told["entry"]["level"] == "error":
            self.errors.append(str(told["entry"]["text"]))

    def __enter__(self) -> Page:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._browser.stop()
