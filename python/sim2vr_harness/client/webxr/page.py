"""A page in a browser of its own: loaded, brought into VR, played step by step, and watched."""

import base64
import json
import logging
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import urlencode

from pydantic import TypeAdapter

from sim2vr_harness.client import limits
from sim2vr_harness.client.answers import BadReply, checked
from sim2vr_harness.client.base import OptionValue
from sim2vr_harness.client.errors import AppDied, AppRefused, AppTimeout, ProtocolError
from sim2vr_harness.client.limits import Kept
from sim2vr_harness.client.scene import Observer
from sim2vr_harness.client.webxr import replies
from sim2vr_harness.client.webxr.browser import RENDERER, Browser, Tab, open_tab
from sim2vr_harness.client.webxr.files import PageFiles
from sim2vr_harness.client.webxr.pipe import RefusedRequest

T = TypeVar("T")
_LOG = logging.getLogger(__name__)

PROFILES = ("oculus-touch", "generic-trigger")
SCRIPT_ERRORS = ("ignore", "fail")
WINDOW_FRAMES = ("stop", "run")

_played: set[str] = set()
"""Pages that have entered VR in this process."""
_noted: set[str] = set()
"""Notes that the log of this process has."""

_PATIENCE_S = 6.0
"""After so long a page that has not called WebXR is given up, if there is nothing left to click."""
_LEFT_S = 2.0
"""Time to wait for the new address of a page that navigated away, s."""
_CLEAN_EVERY = 4
"""Number of documents after which the browser is cleaned: it keeps dozens by itself, 200 MB."""


class Page:
    """The page of one user.

    Args:
        browser: to show it in; stays the caller's.
        files: what it may load.
        settings: that the scripts receive: seed, size, eyes and so on (:class:`~.app.WebXRApp`).
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
        settings: Mapping[str, Any],
        *,
        values: Mapping[str, str],
        enter: str | None,
        ignore_errors: bool,
        timeout_s: float,
        start_timeout_s: float,
    ) -> None:
        self._url, self._name, self._origin = files.url, files.name, files.origin
        self._tools = browser.tools
        self._values = tuple(values)
        self._picture_bytes = settings["width"] * settings["height"] * settings["eyes"] * 4
        self._enter, self._ignore_errors = enter, ignore_errors
        self._timeout_s, self._start_timeout_s = timeout_s, start_timeout_s
        self._silence_s = start_timeout_s / 4.0
        self._seed_script: str | None = None
        self._loads = 0
        self._asked: set[str] = set()
        self._sought: list[str] = []
        """Names of the objects that were located since the last step, and before it."""
        self._places: dict[str, tuple[float, float, float] | None] = {}
        """Where the latter are after it; None: there is none of the name."""
        self._tab = open_tab(browser, start_timeout_s)
        self.watch = PageWatch(self._tab, files)
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
        self.watch.log_notes()
        address = _with_query(self._url, options)
        self.watch.clear(address, seed)
        if self._seed_script is not None:
            self._ask("Page.removeScriptToEvaluateOnNewDocument", identifier=self._seed_script)
        source = f"window.__sim2vr?.seed({seed});"  # frames within have none
        added = self._ask("Page.addScriptToEvaluateOnNewDocument", source=source)
        self._seed_script = added["identifier"]
        self._loads += 1
        if self._loads % _CLEAN_EVERY == 0:
            self._ask("HeapProfiler.collectGarbage")
        self._ask("Storage.clearDataForOrigin", origin=self._origin, storageTypes="all")
        found = self._ask("Page.navigate", url=address, timeout_s=self._start_timeout_s)
        if "errorText" in found:
            raise self._refused(f"cannot be loaded ({found['errorText']})")
        failure = None
        try:
            # Wait until the page has loaded; it goes on as long as it asks for files.
            deadline = time.monotonic() + self._start_timeout_s
            while not self.watch.loaded:
                before = self.watch.requests
                left_s = max(0.001, min(self._silence_s, deadline - time.monotonic()))
                self._tools.wait_until(
                    lambda: self.watch.loaded or self.watch.requests > before,  # noqa: B023
                    f"loading {self._name}",
                    left_s,
                )
            self.watch.loading = None
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
            if self.watch.left is None:
                raise
        if self.watch.left is not None:
            raise self._refused(f"{self.watch.departure} before it entered VR{self.watch.hints()}")
        if failure:
            hints = self.watch.hints()
            self.watch.log_notes(silent=True)
            raise self._refused(failure + hints)
        if self.watch.errors and not self._ignore_errors:
            raise self._refused(f"script error: {self.watch.errors.first}")
        self._evaluate("__sim2vr.begin()")
        _played.add(self._name)

    def _enter_vr(self) -> str | None:
        """Bring the page into VR; return why it does not get there."""
        hurried_s = time.monotonic() + _PATIENCE_S
        while True:
            hurried = "true" if time.monotonic() > hurried_s else "false"
            expression = f"__sim2vr.enter({json.dumps(self._enter)}, {hurried})"
            door = self._evaluate(expression, self._silence_s)
            answer = self._checked("the way into VR", replies.DOOR, door)
            if answer.done or self.watch.left is not None:
                return answer.failure and answer.failure[1]
            if answer.at is not None:  # by the browser's own mouse: counts as a user's gesture
                x, y = answer.at
                for kind, held in (("mouseMoved", 0), ("mousePressed", 1), ("mouseReleased", 0)):
                    button = {"button": "left", "clickCount": 1} if kind != "mouseMoved" else {}
                    self._ask(
                        "Input.dispatchMouseEvent",
                        timeout_s=self._silence_s,
                        **{"type": kind, "x": x, "y": y, "buttons": held, **button},
                    )
            elif answer.click:
                self._run("__sim2vr.click()", userGesture=True)

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
        # What was located will be located again: the step's answer saves a request.
        self._sought, self._asked, self._places = sorted(self._asked), set(), {}
        given = (json.dumps(each) for each in (frames, with_values, self._sought))
        return self._start(f"__sim2vr.step({','.join(given)})")

    def finish_step(self, number: int, with_values: bool) -> replies.StepReply:
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
        try:
            reply = replies.step_reply(
                answer, self._values if with_values else (), len(self._sought), self._picture_bytes
            )
        except BadReply as error:
            raise self._malformed(error) from error
        if reply.failure is not None:
            raise self.died(reply.failure[1] + self.watch.hints())
        self._places = dict(zip(self._sought, reply.places, strict=True))
        return reply

    def observe(self, observers: Sequence[Observer]) -> None:
        """Have the page draw further views in the frames to come; see :meth:`AppClient.observe`."""
        rows = [
            {
                "place": one.pose,
                "fov_deg": one.vertical_fov_deg,
                "width": one.width,
                "height": one.height,
                "deep": one.pose is not None,
            }
            for one in observers
        ]
        self._evaluate(f"__sim2vr.watchFrom({json.dumps(rows)})")

    def locate(self, name: str) -> tuple[float, float, float]:
        """Return the place of a named object; see :meth:`WebXRApp.locate`."""
        self._asked.add(name)
        known = self._places.get(name)
        if known is not None:
            return known
        try:
            answer = self._run(f"__sim2vr.locate({json.dumps(name)})")
        except RefusedRequest as error:
            raise self._refused(str(error).removeprefix("Error: ")) from error
        return self._checked(f"the place of {name!r}", replies.PLACE, answer)

    def report(self) -> replies.PageReport:
        """Return what the page is made of and requested so far."""
        return self._checked("the report", replies.REPORT, self._evaluate("__sim2vr.report()"))

    def things(self) -> tuple[replies.Thing, ...]:
        """Return the objects that people may use, as they are now."""
        return self._checked("things", replies.THINGS, self._evaluate("__sim2vr.things()"))

    def signs(self) -> replies.Signs:
        """Return what people may notice of the page now."""
        return self._checked("signs", replies.SIGNS, self._evaluate("__sim2vr.signs()"))

    def boxes(self) -> tuple[replies.Box, ...]:
        """Return what the page shows now, as boxes."""
        return self._checked("boxes", replies.BOXES, self._evaluate("__sim2vr.boxes()"))

    def describe_renderer(self) -> str:
        """Return the name of what draws in this browser."""
        return self._checked("the renderer", replies.TEXT, self._evaluate(RENDERER))

    # --- what goes wrong -----------------------------------------------------------------------

    def _check_playing(self) -> None:
        if self.watch.left is not None:
            raise self.died(self.watch.departure + self.watch.hints())
        if self.watch.errors and not self._ignore_errors:
            raise self.died(f"script error: {self.watch.errors.first}")

    def _refused(self, what: str) -> AppRefused:
        return AppRefused(f"{self._name}: {what}")

    def died(self, what: str) -> Exception:
        """Return the error of a page that cannot go on; nothing more is asked of it."""
        return self.watch.died(what)

    def _malformed(self, error: Exception) -> Exception:
        words = f"{self._name}: answered with another thing: {error}"
        return self._tools.give_up(ProtocolError(words))

    def _checked(self, what: str, kind: TypeAdapter[T], answer: object) -> T:
        try:
            return checked(what, kind, answer)
        except BadReply as error:
            raise self._malformed(error) from error

    # --- requests ------------------------------------------------------------------------------

    def _ask(self, method: str, *, timeout_s: float | None = None, **parameters: Any) -> Any:
        try:
            return self._tab.ask(method, timeout_s or self._timeout_s, **parameters)
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
                self._tools.wait_until(lambda: self.watch.left is not None, self._name, _LEFT_S)
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


# --- watching ------------------------------------------------------------------------------------


class PageWatch:
    """Serves the requests of one tab and keeps what its page did wrong.

    Args:
        tab: to watch.
        files: what its page may load.

    Attributes:
        errors: what its scripts threw and did not catch, in this round.
        complaints: what it wrote to the console as an error or warning.
        left: the address that it went to by itself; None: it stayed.
        loaded: whether it has loaded.
        loading: the address that the harness loads now; None: no such.
        requests: how many files it requested, in all rounds.
    """

    def __init__(self, tab: Tab, files: PageFiles) -> None:
        self.errors = Kept()
        self.left: str | None = None
        self.loaded = False
        self.loading: str | None = None
        self.requests = 0
        self._address = ""
        self._seed = 0
        self.complaints = Kept()
        self._files = files
        self._tab = tab
        self._tools = tab.browser.tools
        self._group = tab.browser.process.pid
        self._tools.watch(self._check_memory)
        for method in (
            "Target.targetCreated",
            "Target.attachedToTarget",
            "Fetch.requestPaused",
            "Page.loadEventFired",
            "Page.frameNavigated",
            "Page.javascriptDialogOpening",
            "Runtime.exceptionThrown",
            "Runtime.consoleAPICalled",
            "Inspector.targetCrashed",
        ):
            self._tools.on(method, partial(self._take, method))

    def clear(self, loading: str, seed: int) -> None:
        """Forget the round before: the harness is about to load an address."""
        self._seed = seed
        self.errors.clear()
        self.complaints.clear()
        self._files.clear()
        self.left, self.loaded, self.loading = None, False, loading
        self._address = loading

    # --- events --------------------------------------------------------------------------------

    def _tell(self, method: str, **parameters: Any) -> None:
        self._tools.send(method, parameters, self._tab.session, answered=False)

    def _answer(self, event: Mapping[str, Any]) -> None:
        """Serve a request from its file, or refuse it."""
        number, url = event["requestId"], event["request"]["url"]
        self.requests += 1
        answer = self._files.answer(url)
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

    def _take(self, method: str, event: Mapping[str, Any]) -> None:
        """Take an event of the browser."""
        send = self._tools.send
        match method:
            case "Fetch.requestPaused":
                self._answer(event)
            case "Target.targetCreated":
                # A window that the page got in spite of the browser's flag (not all know it).
                target = event["targetInfo"]
                ours = target.get("browserContextId") == self._tab.context
                if ours and target["type"] == "page" and target["targetId"] != self._tab.target:
                    send("Target.closeTarget", {"targetId": target["targetId"]}, answered=False)
            case "Target.attachedToTarget":
                # A worker, which waits for it, gets the scripts of virtual time; all others go on.
                session = event["sessionId"]
                if event["targetInfo"]["type"] == "worker":
                    expression = worker_bundle(self._seed)
                    send("Runtime.evaluate", {"expression": expression}, session, answered=False)
                if event.get("waitingForDebugger"):
                    send("Runtime.runIfWaitingForDebugger", {}, session, answered=False)
            case "Page.loadEventFired":
                self.loaded = True
            case "Page.frameNavigated":
                frame = event["frame"]
                own = "parentId" not in frame and frame["url"] != "about:blank"
                if own and self.loading is None:
                    self.left = str(frame["url"])[:200]
            case "Page.javascriptDialogOpening":
                self._tell("Page.handleJavaScriptDialog", accept=True)
            case "Runtime.exceptionThrown":
                self.errors.add(words_of(event["exceptionDetails"]))
            case "Runtime.consoleAPICalled":
                if event["type"] in ("error", "warning", "assert"):
                    words = (
                        str(one.get("value", one.get("description", ""))) for one in event["args"]
                    )
                    self.complaints.add(" ".join(words).partition("\n")[0])
            case "Inspector.targetCrashed":  # what is asked of it gets no answer
                raise self.died("its tab crashed (its process ended)")

    def _check_memory(self) -> None:
        used = limits.memory_of_group(self._group)
        if used > limits.MOST_MEMORY_BYTES:
            raise self.died(
                f"takes {used >> 20} MB of memory with its browser, expected at most "
                f"{limits.MOST_MEMORY_BYTES >> 20} MB"
            )

    # --- words ---------------------------------------------------------------------------------

    def died(self, what: str) -> Exception:
        """Return the error of a page that cannot go on; nothing more is asked of it."""
        return self._tools.give_up(AppDied(f"{self._files.name}: {what}"))

    @property
    def departure(self) -> str:
        """Destination of a page that navigated by itself, as the beginning of a sentence."""
        if self.left == self._address[:200]:
            return "loaded itself again"
        return f"went to another address, {self.left}"

    @property
    def notes(self) -> list[str]:
        """Problems in this round that do not prevent playing, a sentence for each kind."""
        files, found = self._files, []
        if files.sources:
            found.append(
                f"loads {files.sources.listed()}, source code that no browser runs: build the "
                "page, as with `npm run build`, and name the page that this makes"
            )
        if files.refused:
            listed = files.refused.listed()
            found.append(f"asks for {listed}, which app.map maps to no folder; try: page vendor")
        if files.missing:
            outside = files.outside
            hint = f" (above the page's folder; it plays with {outside})" if outside else ""
            found.append(f"not found: {files.missing.listed()}{hint}")
        if self.errors:
            found.append(f"script error: {self.errors.listed()}")
        return found

    def hints(self) -> str:
        """Return the notes and what the page said last, in brackets; "" without any."""
        words = self.notes
        if self.complaints:
            words.append(f"it says: {self.complaints.last}")
        return f" ({'; '.join(words)})" if words else ""

    def log_notes(self, *, silent: bool = False) -> None:
        """Log the notes of this round that the log does not have.

        Args:
            silent: whether an error says the same.
        """
        for note in self.notes:
            line = f"{self._files.name}: {note}"
            if line not in _noted:
                _noted.add(line)
                if not silent:
                    _LOG.warning(line)


def words_of(details: Mapping[str, Any]) -> str:
    """Return what an exception says, in one line, and where it was thrown."""
    thrown = details.get("exception", {})
    text = thrown.get("description") or thrown.get("value") or details.get("text", "an error")
    line = " ".join(str(text).partition("\n    at ")[0].split())[:300]
    url = details.get("url") or ""
    where = url.rpartition("/")[2].partition("?")[0]
    return f"{line} ({where}:{details.get('lineNumber', 0) + 1})" if where else line


# --- scripts -------------------------------------------------------------------------------------

_SCRIPTS = (
    "own.js",
    "random.js",
    "clock.js",
    "loads.js",
    "elements.js",
    "workers.js",
    "animations.js",
    "sound.js",
    "messages.js",
    "observers.js",
    "spaces.js",
    "controllers.js",
    "gl.js",
    "solid.js",
    "picture.js",
    "session.js",
    "objects.js",
    "things.js",
    "signs.js",
    "boxes.js",
    "report.js",
    "steps.js",
)
"""In the order in which they build on each other; ``walls.js`` is for the frames within, too."""

_WORKER_SCRIPTS = ("own.js", "random.js", "clock.js", "loads.js", "worker.js")


def read_script(name: str) -> str:
    """Return one of the scripts that pages are given."""
    return (Path(__file__).parent / "scripts" / name).read_text(encoding="utf-8")


def worker_bundle(seed: int) -> str:
    """Return the scripts of a worker as one, which runs before its own."""
    parts = "\n".join(read_script(name) for name in _WORKER_SCRIPTS)
    return f"((window) => {{ const sim = {{ settings: {{ seed: {seed} }} }};\n{parts}\n}})(self)"


def bundle(settings: Mapping[str, Any], values: Mapping[str, str]) -> str:
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
