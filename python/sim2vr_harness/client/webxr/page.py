"""A page in a browser of its own: loaded, brought into VR, played step by step."""

import json
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any, TypeVar
from urllib.parse import urlencode

from sim2vr_harness.client.base import OptionValue
from sim2vr_harness.client.errors import AppDied, AppRefused, AppTimeout, ProtocolError
from sim2vr_harness.client.webxr.browser import Browser
from sim2vr_harness.client.webxr.files import PageFiles
from sim2vr_harness.client.webxr.pipe import RefusedRequest
from sim2vr_harness.client.webxr.replies import (
    BadReply,
    Box,
    PageReport,
    Signs,
    StepReply,
    Thing,
    boxes_reply,
    door_reply,
    place_in,
    report_reply,
    signs_reply,
    step_reply,
    text_in,
    things_reply,
)
from sim2vr_harness.client.webxr.tab import RENDERER, PageSettings, bundle, open_tab
from sim2vr_harness.client.webxr.watch import PageWatch, words_of

T = TypeVar("T")

PROFILES = ("oculus-touch", "generic-trigger")
SCRIPT_ERRORS = ("ignore", "fail")
WINDOW_FRAMES = ("stop", "run")

_played: set[str] = set()
"""Pages that have entered VR in this process."""

_PATIENCE_S = 6.0
"""After so long a page that has not called WebXR is given up, if there is nothing left to click."""
_LEFT_S = 2.0
"""How long the address is waited for that a page has gone to."""
_CLEAN_EVERY = 4
"""How many documents may be left behind; a browser by itself keeps dozens, 200 MB of them."""


class Page:
    """The page of one user.

    Args:
        browser: to show it in; stays the caller's.
        files: what it may load.
        settings: of the scripts.
        values: name -> expression in JavaScript that is read after every step.
        enter: CSS selector of what to click to enter VR; None: found out.
        ignore_errors: whether an error in play that its scripts do not catch is only a note.
        timeout_s: of every answer.
        start_timeout_s: of loading the page; a quarter of it without an answer is too long.
    """

    def __init__(
        self,
        browser: Browser,
        files: PageFiles,
        settings: PageSettings,
        *,
        values: Mapping[str, str],
        enter: str | None,
        ignore_errors: bool,
        timeout_s: float,
        start_timeout_s: float,
    ) -> None:
        self.files = files
        self._tools = browser.tools
        self._values = tuple(values)
        self._picture_bytes = settings["width"] * settings["height"] * settings["eyes"] * 4
        self._enter, self._ignore_errors = enter, ignore_errors
        self._timeout_s, self._start_timeout_s = timeout_s, start_timeout_s
        self._silence_s = start_timeout_s / 4.0
        self._seed_script: str | None = None
        self._loads = 0
        self._tab = open_tab(browser, start_timeout_s)
        self._watch = PageWatch(browser, self._tab, files)
        browser.request("Target.setDiscoverTargets", start_timeout_s, discover=True)
        for method in ("Inspector.enable", "Page.enable", "Runtime.enable"):
            self._ask(method)
        self._ask(
            "Target.setAutoAttach", autoAttach=True, waitForDebuggerOnStart=True, flatten=True
        )
        self._ask("Fetch.enable", patterns=[{"urlPattern": "*"}])
        self._ask("Page.addScriptToEvaluateOnNewDocument", source=bundle(settings, values))

    # --- rounds --------------------------------------------------------------------------------

    def load(self, seed: int, options: Mapping[str, OptionValue]) -> None:
        """Load the page anew and bring it into VR; its clock is at 0 then.

        Args:
            seed: of its random numbers.
            options: become the query of its address.

        Raises:
            AppRefused: it cannot be played, and would not be another time; says why.
            AppDied, AppTimeout: the browser ended, or does not answer.
        """
        self.log_notes()
        address = _with_query(self.files.url, options)
        self._watch.clear(address, seed)
        if self._seed_script is not None:
            self._ask("Page.removeScriptToEvaluateOnNewDocument", identifier=self._seed_script)
        source = f"window.__sim2vr?.seed({seed});"  # frames within have none
        added = self._ask("Page.addScriptToEvaluateOnNewDocument", source=source)
        self._seed_script = added["identifier"]
        self._loads += 1
        if self._loads % _CLEAN_EVERY == 0:
            self._ask("HeapProfiler.collectGarbage")
        self._ask("Storage.clearDataForOrigin", origin=self.files.origin, storageTypes="all")
        found = self._ask("Page.navigate", url=address, timeout_s=self._start_timeout_s)
        if "errorText" in found:
            raise self._refused(f"cannot be loaded ({found['errorText']})")
        failure = None
        try:
            # Wait until the page has loaded; it goes on as long as it asks for files.
            deadline = time.monotonic() + self._start_timeout_s
            while not self._watch.loaded:
                before = self._watch.requests
                left_s = max(0.001, min(self._silence_s, deadline - time.monotonic()))
                self._tools.wait_until(
                    lambda: self._watch.loaded or self._watch.requests > before,  # noqa: B023
                    f"loading {self._name}",
                    left_s,
                )
            self._watch.loading = None
            failure = self._enter_vr()
        except AppTimeout as error:
            if self._name in _played:
                raise
            raise self._refused(
                f"gave no answer for {self._silence_s:g} s while it loaded, as in an endless loop; "
                "expected one within a quarter of app.start_timeout_s (raise it for a page that "
                "loads slowly)"
            ) from error
        except AppDied:
            if self._watch.left is None:
                raise
        if self._watch.left is not None:
            raise self._refused(
                f"{self._watch.departure} before it entered VR{self._watch.hints()}"
            )
        if failure:
            hints = self._watch.hints()
            self._watch.log_notes(silent=True)
            raise self._refused(failure + hints)
        if self._watch.errors and not self._ignore_errors:
            raise self._refused(f"script error: {self._watch.errors.first}")
        self._evaluate("__sim2vr.begin()")
        _played.add(self._name)

    def _enter_vr(self) -> str | None:
        """Bring the page into VR; return why it does not get there."""
        hurried_s = time.monotonic() + _PATIENCE_S
        while True:
            hurried = "true" if time.monotonic() > hurried_s else "false"
            expression = f"__sim2vr.enter({json.dumps(self._enter)}, {hurried})"
            answer = self._checked(door_reply, self._evaluate(expression, self._silence_s))
            if answer.done or self._watch.left is not None:
                return answer.failure
            if answer.at is not None:
                self._click(*answer.at)
            elif answer.click:
                self._run("__sim2vr.click()", userGesture=True)

    def _click(self, x: float, y: float) -> None:
        """Click with the browser's own mouse, which counts as a user's gesture."""
        for kind, held in (("mouseMoved", 0), ("mousePressed", 1), ("mouseReleased", 0)):
            button = {"button": "left", "clickCount": 1} if kind != "mouseMoved" else {}
            self._ask(
                "Input.dispatchMouseEvent",
                **{"type": kind, "x": x, "y": y, "buttons": held, **button},
                timeout_s=self._silence_s,
            )

    def restart(self, seed: int, expression: str) -> None:
        """Begin a round by the page's own expression instead of loading it again.

        Raises:
            AppRefused: the expression fails.
        """
        source = f"(__sim2vr.seed({seed}), Promise.resolve({expression}).then(() => null))"
        try:
            self._run(source)
        except RefusedRequest as error:
            raise AppRefused(
                f"task.reset: got {expression!r}, which {self._name} answers with {error}, "
                "expected an expression that begins a round"
            ) from error
        self._evaluate("__sim2vr.begin()")
        self._check_playing()

    def start_step(self, frames: Sequence[Any], with_values: bool) -> int:
        """Have frames run; returns what :meth:`finish_step` needs.

        Args:
            frames: see ``steps.js``.
            with_values: whether to read the values afterwards.
        """
        expression = f"__sim2vr.step({json.dumps(frames)},{'true' if with_values else 'false'})"
        return self._start(expression)

    def finish_step(self, number: int, with_values: bool) -> StepReply:
        """Return what the frames brought.

        Args:
            number: from :meth:`start_step`.
            with_values: as given there.

        Raises:
            AppDied, AppTimeout: the page cannot go on.
            ProtocolError: the answer is another thing.
        """
        try:
            answer = self._finish(number, self._timeout_s)
        except RefusedRequest as error:
            self._check_playing()
            raise self.died(str(error)) from error
        self._check_playing()
        names = self._values if with_values else ()
        reply = self._checked(step_reply, answer, names, self._picture_bytes)
        if reply.failure is not None:
            raise self.died(reply.failure + self._watch.hints())
        return reply

    def locate(self, name: str) -> tuple[float, float, float]:
        """Return the place of a named object; see :meth:`WebXRApp.locate`."""
        try:
            answer = self._run(f"__sim2vr.locate({json.dumps(name)})")
        except RefusedRequest as error:
            raise self._refused(str(error).removeprefix("Error: ")) from error
        return self._checked(place_in, f"the place of {name!r}", answer)

    def report(self) -> PageReport:
        """Return what the page is made of and requested so far."""
        return self._checked(report_reply, self._evaluate("__sim2vr.report()"))

    def things(self) -> tuple[Thing, ...]:
        """Return the objects that people may use, as they are now."""
        return self._checked(things_reply, self._evaluate("__sim2vr.things()"))

    def signs(self) -> Signs:
        """Return what people may notice of the page now."""
        return self._checked(signs_reply, self._evaluate("__sim2vr.signs()"))

    def boxes(self) -> tuple[Box, ...]:
        """Return what the page shows now, as boxes."""
        return self._checked(boxes_reply, self._evaluate("__sim2vr.boxes()"))

    def describe_renderer(self) -> str:
        """Return the name of what draws in this browser."""
        return self._checked(text_in, "the renderer", self._evaluate(RENDERER))

    # --- what goes wrong -----------------------------------------------------------------------

    @property
    def _name(self) -> str:
        return self.files.name

    def _check_playing(self) -> None:
        if self._watch.left is not None:
            raise self.died(self._watch.departure + self._watch.hints())
        if self._watch.errors and not self._ignore_errors:
            raise self.died(f"script error: {self._watch.errors.first}")

    @property
    def notes(self) -> list[str]:
        return self._watch.notes

    def log_notes(self) -> None:
        self._watch.log_notes()

    def _refused(self, what: str) -> AppRefused:
        return AppRefused(f"{self._name}: {what}")

    def died(self, what: str) -> Exception:
        return self._watch.died(what)

    def _checked(self, decode: Callable[..., T], *answer: Any) -> T:
        """A page's answer as ``decode`` has it.

        Raises:
            ProtocolError: it is another thing.
        """
        try:
            return decode(*answer)
        except BadReply as error:
            raise self._tools.give_up(
                ProtocolError(f"{self._name}: answered with another thing: {error}")
            ) from error

    # --- requests ------------------------------------------------------------------------------

    def _ask(self, method: str, *, timeout_s: float | None = None, **parameters: Any) -> Any:
        wait_s = timeout_s or self._timeout_s
        try:
            return self._tools.request(method, parameters, self._tab.session, timeout_s=wait_s)
        except RefusedRequest as error:
            raise self.died(f"its browser refused {error}") from error

    def _start(self, expression: str, **options: Any) -> int:
        parameters = {"expression": expression, "awaitPromise": True, "returnByValue": True}
        parameters |= options
        return self._tools.send("Runtime.evaluate", parameters, self._tab.session)

    def _finish(self, number: int, timeout_s: float) -> Any:
        """The value of an expression.

        Raises:
            RefusedRequest: it throws; says what.
        """
        try:
            found = self._tools.receive(number, self._name, timeout_s)
        except RefusedRequest as error:  # the document is gone; where to comes a moment later
            with suppress(AppTimeout, AppDied):
                self._tools.wait_until(lambda: self._watch.left is not None, self._name, _LEFT_S)
            self._check_playing()
            raise self.died(f"left its document ({error})") from error
        if "exceptionDetails" in found:
            raise RefusedRequest(words_of(found["exceptionDetails"]))
        return found["result"].get("value")

    def _run(self, expression: str, **options: Any) -> Any:
        """The value of an expression that may throw; raises RefusedRequest if it does."""
        return self._finish(self._start(expression, **options), self._timeout_s)

    def _evaluate(self, expression: str, timeout_s: float | None = None) -> Any:
        """The value of an expression that throws only where a page has broken what it uses."""
        try:
            return self._finish(self._start(expression), timeout_s or self._timeout_s)
        except RefusedRequest as error:
            raise self.died(f"stops the harness's own script: {error}") from error


def _with_query(url: str, options: Mapping[str, OptionValue]) -> str:
    if not options:
        return url
    plain = {
        name: json.dumps(value) if isinstance(value, (bool, list)) else str(value)
        for name, value in options.items()
    }
    address, mark, rest = url.partition("#")
    return address + ("&" if "?" in address else "?") + urlencode(plain) + mark + rest
