"""A page in a browser of its own: loaded, brought into VR, watched for what goes wrong."""

from __future__ import annotations

import base64
import json
import logging
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any, NamedTuple, TypeVar
from urllib.parse import urlencode

from sim2vr_harness.client.base import OptionValue
from sim2vr_harness.client.errors import AppDied, AppRefused, AppTimeout, ProtocolError
from sim2vr_harness.client.webxr import limits
from sim2vr_harness.client.webxr.browser import Browser, read_script
from sim2vr_harness.client.webxr.files import PageFiles
from sim2vr_harness.client.webxr.limits import Kept
from sim2vr_harness.client.webxr.pipe import RefusedRequest
from sim2vr_harness.client.webxr.replies import (
    BadReply,
    StepReply,
    door_reply,
    place_in,
    step_reply,
    text_in,
)

__all__ = [
    "PROFILES",
    "SCRIPT_ERRORS",
    "Page",
    "PageSettings",
    "describe_browser",
    "open_tab",
]

T = TypeVar("T")

PROFILES = ("oculus-touch", "generic-trigger")
SCRIPT_ERRORS = ("ignore", "fail")

_LOG = logging.getLogger(__name__)
_noted: set[str] = set()
_played: set[str] = set()
"""Notes that the log has, and pages that have entered VR, of this process."""

_CLEAN_EVERY = 4
"""How many documents may be left behind; a browser by itself keeps dozens, 200 MB of them."""

_SCRIPTS = (
    "own.js",
    "clock.js",
    "loads.js",
    "messages.js",
    "observers.js",
    "spaces.js",
    "controllers.js",
    "picture.js",
    "session.js",
    "objects.js",
    "steps.js",
)
"""In the order in which they build on each other; ``walls.js`` is for the frames within, too."""

PageSettings = Mapping[str, Any]
"""What the scripts receive: seed, size, eyes and so on (:class:`~.app.WebXRApp`)."""


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
        self._errors = Kept()
        self._complaints = Kept()
        self._left: str | None = None
        self._loaded = False
        self._seed_script: str | None = None
        self._loads = 0
        self._requests = 0
        self._loading: str | None = None
        self._tab = open_tab(browser, start_timeout_s)
        self._group = browser.process.pid
        self._tools.watch(self._check_memory)
        self._listen()
        browser.request("Target.setDiscoverTargets", start_timeout_s, discover=True)
        for method in ("Inspector.enable", "Page.enable", "Runtime.enable"):
            self._ask(method)
        self._ask("Fetch.enable", patterns=[{"urlPattern": "*"}])
        self._ask("Page.addScriptToEvaluateOnNewDocument", source=_bundle(settings, values))

    def _listen(self) -> None:
        on = self._tools.on
        on("Target.targetCreated", self._close_other_window)
        on("Fetch.requestPaused", self._answer)
        on("Page.loadEventFired", self._note_loaded)
        on("Page.frameNavigated", self._note_navigation)
        on("Page.javascriptDialogOpening", self._dismiss)
        on("Runtime.exceptionThrown", self._note_error)
        on("Runtime.consoleAPICalled", self._note_complaint)
        on("Inspector.targetCrashed", self._end)

    # --- events --------------------------------------------------------------------------------

    def _answer(self, event: Mapping[str, Any]) -> None:
        """Serve a request from its file, or refuse it."""
        number, url = event["requestId"], event["request"]["url"]
        self._requests += 1
        answer = self.files.answer(url)
        if answer.status == 0:
            self._tell("Fetch.failRequest", requestId=number, errorReason="BlockedByClient")
            return
        headers = {
            "Content-Type": answer.mime,
            "Content-Length": str(len(answer.content)),
            "Access-Control-Allow-Origin": "*",
            "Cache-Control": "max-age=31536000",
        }
        self._tell(
            "Fetch.fulfillRequest",
            requestId=number,
            responseCode=answer.status,
            responseHeaders=[{"name": name, "value": value} for name, value in headers.items()],
            body=base64.b64encode(answer.content).decode(),
        )

    def _close_other_window(self, event: Mapping[str, Any]) -> None:
        """Close a window that the page got in spite of the browser's flag (not all know it)."""
        target = event["targetInfo"]
        ours = target.get("browserContextId") == self._tab.context
        if ours and target["type"] == "page" and target["targetId"] != self._tab.target:
            self._tools.send("Target.closeTarget", {"targetId": target["targetId"]}, answered=False)

    def _note_loaded(self, event: Mapping[str, Any]) -> None:
        self._loaded = True

    def _note_navigation(self, event: Mapping[str, Any]) -> None:
        frame = event["frame"]
        if "parentId" not in frame and self._loading is None and frame["url"] != "about:blank":
            self._left = str(frame["url"])[:200]

    def _dismiss(self, event: Mapping[str, Any]) -> None:
        self._tell("Page.handleJavaScriptDialog", accept=True)

    def _note_error(self, event: Mapping[str, Any]) -> None:
        self._errors.add(_words_of(event["exceptionDetails"]))

    def _note_complaint(self, event: Mapping[str, Any]) -> None:
        if event["type"] in ("error", "warning", "assert"):
            words = [str(one.get("value", one.get("description", ""))) for one in event["args"]]
            self._complaints.add(" ".join(words).partition("\n")[0])

    def _end(self, event: Mapping[str, Any]) -> None:
        """Give up: what is asked of a crashed tab gets no answer."""
        raise self.died("its tab crashed (its process ended)")

    def _check_memory(self) -> None:
        used = limits.memory_of_group(self._group)
        if used > limits.MOST_MEMORY_BYTES:
            raise self.died(
                f"takes {used >> 20} MB of memory with its browser, expected at most "
                f"{limits.MOST_MEMORY_BYTES >> 20} MB"
            )

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
        for kept in (self._errors, self._complaints, self.files.missing, self.files.refused):
            kept.clear()
        self._loaded = False
        if self._seed_script is not None:
            self._ask("Page.removeScriptToEvaluateOnNewDocument", identifier=self._seed_script)
        source = f"window.__sim2vr?.seed({seed});"  # frames within have none
        added = self._ask("Page.addScriptToEvaluateOnNewDocument", source=source)
        self._seed_script = added["identifier"]
        self._loads += 1
        if self._loads % _CLEAN_EVERY == 0:
            self._ask("HeapProfiler.collectGarbage")
        self._loading = _with_query(self.files.url, options)
        self._ask("Storage.clearDataForOrigin", origin=self.files.origin, storageTypes="all")
        found = self._ask("Page.navigate", url=self._loading, timeout_s=self._start_timeout_s)
        if "errorText" in found:
            raise self._refused(f"cannot be loaded ({found['errorText']})")
        failure = None
        try:
            self._wait_for_load()
            self._loading = None
            failure = self._enter_vr()
        except AppTimeout as error:
            if self._name in _played:
                raise
            raise self._refused(
                f"gave no answer for {self._silence_s:g} s while it loaded, as in an endless loop; "
                "expected one within a quarter of app.start_timeout_s"
            ) from error
        except AppDied:
            if self._left is None:
                raise
        if self._left is not None:
            raise self._refused(f"went to another address, {self._left}, before it entered VR")
        if failure:
            hints = self._hints()
            _noted.update(f"{self._name}: {note}" for note in self.notes)
            raise self._refused(failure + hints)
        if self._errors and not self._ignore_errors:
            raise self._refused(f"script error: {self._errors.first}")
        self._evaluate("__sim2vr.begin()")
        _played.add(self._name)

    def _wait_for_load(self) -> None:
        """Wait until the page has loaded; it goes on as long as it asks for files."""
        deadline = time.monotonic() + self._start_timeout_s
        while not self._loaded:
            before = self._requests
            left_s = max(0.001, min(self._silence_s, deadline - time.monotonic()))
            self._tools.wait_until(
                lambda: self._loaded or self._requests > before,  # noqa: B023
                f"loading {self._name}",
                left_s,
            )

    def _enter_vr(self) -> str | None:
        """Bring the page into VR; return why it does not get there."""
        expression = f"__sim2vr.enter({json.dumps(self._enter)})"
        while True:
            answer = self._checked(door_reply, self._evaluate(expression, self._silence_s))
            if answer.done or self._left is not None:
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
            raise self.died(reply.failure + self._hints())
        return reply

    def locate(self, name: str) -> tuple[float, float, float]:
        """Return the place of a named object; see :meth:`WebXRApp.locate`."""
        try:
            answer = self._run(f"__sim2vr.locate({json.dumps(name)})")
        except RefusedRequest as error:
            raise self._refused(str(error).removeprefix("Error: ")) from error
        return self._checked(place_in, f"the place of {name!r}", answer)

    def describe_renderer(self) -> str:
        """Return the name of what draws in this browser."""
        return self._checked(text_in, "the renderer", self._evaluate(_RENDERER))

    # --- what goes wrong -----------------------------------------------------------------------

    @property
    def _name(self) -> str:
        return self.files.name

    def _check_playing(self) -> None:
        if self._left is not None:
            raise self.died(f"went to another address, {self._left}")
        if self._errors and not self._ignore_errors:
            raise self.died(f"script error: {self._errors.first}")

    @property
    def notes(self) -> list[str]:
        """What went wrong in this round that the page can do without, a sentence for each kind."""
        found = []
        if self.files.refused:
            found.append(f"asks for {self.files.refused.listed()}, which app.map maps to no folder")
        if self.files.missing:
            outside = self.files.outside
            hint = f" (above the page's folder; it plays with {outside})" if outside else ""
            found.append(f"not found: {self.files.missing.listed()}{hint}")
        if self._errors:
            found.append(f"script error: {self._errors.listed()}")
        return found

    def log_notes(self) -> None:
        """Log the notes of this round that the log does not have."""
        for note in self.notes:
            line = f"{self._name}: {note}"
            if line not in _noted:
                _noted.add(line)
                _LOG.warning(line)

    def _hints(self) -> str:
        words = self.notes
        if self._complaints:
            words.append(f"it says: {self._complaints.last}")
        return f" ({'; '.join(words)})" if words else ""

    def _refused(self, what: str) -> AppRefused:
        return AppRefused(f"{self._name}: {what}")

    def died(self, what: str) -> Exception:
        """Return the error of a page that cannot go on; nothing more is asked of it."""
        return self._tools.give_up(AppDied(f"{self._name}: {what}"))

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

    def _tell(self, method: str, **parameters: Any) -> None:
        self._tools.send(method, parameters, self._tab.session, answered=False)

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
        except RefusedRequest as error:  # the document is gone
            self._check_playing()
            raise self.died(f"left its document ({error})") from error
        if "exceptionDetails" in found:
            raise RefusedRequest(_words_of(found["exceptionDetails"]))
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


class Tab(NamedTuple):
    """A tab of a browser: its session, its target and the context that keeps it from others."""

    session: str
    target: str
    context: str


def open_tab(browser: Browser, timeout_s: float) -> Tab:
    """Open an empty tab that stores and downloads nothing.

    Args:
        browser: in which.
        timeout_s: of every answer.
    """
    ask = browser.request
    context = ask("Target.createBrowserContext", timeout_s)["browserContextId"]
    with suppress(RefusedRequest):
        ask("Browser.setDownloadBehavior", timeout_s, behavior="deny", browserContextId=context)
    target = ask("Target.createTarget", timeout_s, url="about:blank", browserContextId=context)
    ours = set(ask("Target.getBrowserContexts", timeout_s)["browserContextIds"])
    for other in ask("Target.getTargets", timeout_s)["targetInfos"]:
        if other["type"] == "page" and other["browserContextId"] not in ours:
            ask(
                "Target.closeTarget", timeout_s, targetId=other["targetId"]
            )  # with which it started
    attached = ask("Target.attachToTarget", timeout_s, targetId=target["targetId"], flatten=True)
    return Tab(attached["sessionId"], target["targetId"], context)


def describe_browser(program: str, timeout_s: float = 30.0) -> str:
    """Return the version of a browser and what draws WebGL 2 in it; starts and ends it.

    Raises:
        AppRefused, AppDied, AppTimeout: it cannot be started.
    """
    browser = Browser(program, timeout_s)
    try:
        tab = open_tab(browser, timeout_s).session
        asked = {"expression": _RENDERER, "returnByValue": True}
        told = browser.tools.request("Runtime.evaluate", asked, tab, timeout_s=timeout_s)
        return f"{browser.version}, {told['result'].get('value', 'no WebGL 2')}"
    finally:
        browser.stop()


_RENDERER = """(() => {
  const gl = document.createElement('canvas').getContext('webgl2');
  if (!gl) return 'no WebGL 2';
  const names = gl.getExtension('WEBGL_debug_renderer_info');
  const name = gl.getParameter(names ? names.UNMASKED_RENDERER_WEBGL : gl.RENDERER);
  gl.getExtension('WEBGL_lose_context')?.loseContext();
  return name;
})()"""


def _bundle(settings: PageSettings, values: Mapping[str, str]) -> str:
    """The scripts as one, which runs before any of the page's."""
    parts = "\n".join(read_script(name) for name in _SCRIPTS)
    reads = "\n".join(
        f"sim.values.set({json.dumps(name)}, (locate) => ({expression}\n));"
        for name, expression in values.items()
    )
    return (
        f"{{ if (window === window.top) {{ const sim = {{ settings: {json.dumps(settings)} }};\n"
        "Object.defineProperty(window, '__sim2vr', { value: sim });\n"
        f"{{ {parts}\n}}\n{reads}\n}} }}\n{read_script('walls.js')}"
    )


def _with_query(url: str, options: Mapping[str, OptionValue]) -> str:
    if not options:
        return url
    plain = {
        name: json.dumps(value) if isinstance(value, (bool, list)) else str(value)
        for name, value in options.items()
    }
    address, mark, rest = url.partition("#")
    return address + ("&" if "?" in address else "?") + urlencode(plain) + mark + rest


def _words_of(details: Mapping[str, Any]) -> str:
    """What an exception says, in one line, and where it was thrown."""
    thrown = details.get("exception", {})
    text = thrown.get("description") or thrown.get("value") or details.get("text", "an error")
    line = " ".join(str(text).partition("\n    at ")[0].split())[:300]
    url = details.get("url") or ""
    where = url.rpartition("/")[2].partition("?")[0]
    return f"{line} ({where}:{details.get('lineNumber', 0) + 1})" if where else line
