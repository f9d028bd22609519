"""Films a replay: what the player saw, and the app from outside where it draws that."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.client import AppClient, AppReply, facts_of_outside
from sim2vr_harness.play.film import Film, Painter, headset_view, score_text
from sim2vr_harness.sessions import Session

_COUNTDOWN_NS = 500_000_000
"""A longer first frame is the time before play; the film begins behind it."""

_HITS = ("hit", "target_hit")


class ReplayFilm:
    """Where the films of replayed rounds go, and what they look like.

    Args:
        path: The MP4 file; of several rounds, each gets its name between stem and suffix.
        size: (width, height) of each view, pixels.
        fps: Pictures per second of game time.
        on_progress: Told the filmed share of a round, 0 to 1.

    Raises:
        InputError: The path is no ``.mp4`` file, or a silly frame rate.
    """

    def __init__(
        self,
        path: Path,
        size: tuple[int, int] = (640, 480),
        fps: float = 30.0,
        on_progress: Callable[[float], None] = lambda share: None,
    ) -> None:
        if path.suffix.lower() != ".mp4":
            raise InputError("--video", str(path), "a file name that ends in .mp4")
        if not 1.0 <= fps <= 240.0:
            raise InputError("--fps", f"{fps:g}", "1 to 240")
        self.size, self.fps, self.progress = size, fps, on_progress
        self.files: list[Path] = []
        self._path = path

    def round(self, session: Session, name: str, game: str, *, only: bool) -> RoundFilm:
        """Start the film of a round in a game or app; ``only``: there is no other one."""
        path = self._path
        if not only:
            path = path.with_stem(f"{path.stem}-{name.replace('/', '-')}")
        return RoundFilm(path, session, name, game, self)


class RoundFilm:
    """The film of one round: a context that keeps the file only when the round went through."""

    def __init__(
        self, path: Path, session: Session, name: str, game: str, films: ReplayFilm
    ) -> None:
        self._path, self._facts, self._films = path, facts_of_outside(game), films
        times_ns = session.time_ns
        self._first = int(len(times_ns) > 1 and times_ns[1] - times_ns[0] >= _COUNTDOWN_NS)
        self._times_ns = times_ns - times_ns[self._first]
        hits_ns = [each.time_ns for each in session.events if each.kind in _HITS]
        self._hits_ns = np.array(hits_ns, dtype=np.int64) - times_ns[self._first]
        self._title = ": ".join(part for part in (name, session.app.condition) if part)
        self._film: Film | None = None
        self._pictures = 0

    def __enter__(self) -> RoundFilm:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if self._film is None:
            return
        if kind is None:
            self._films.files.append(self._film.finish())
        else:
            self._film.discard()

    def watch(self, app: AppClient, i: int, reply: AppReply) -> None:
        """Show frame i for as long as it was there, from the first frame of play on."""
        if i < self._first:
            return
        last = i + 1 == len(self._times_ns)
        until_ns = int(self._times_ns[i]) + 1 if last else int(self._times_ns[i + 1])
        due = int(np.ceil(until_ns / 1e9 * self._films.fps - 1e-9))
        if due <= self._pictures:
            return
        picture = self._picture(app, int(self._times_ns[i]), reply)
        if self._film is None:
            height, width = picture.shape[:2]
            self._film = Film(self._path, width, height, self._films.fps)
        for _ in range(due - self._pictures):
            self._film.add(picture)
        self._pictures = due
        self._films.progress((i + 1) / len(self._times_ns))

    def _picture(self, app: AppClient, time_ns: int, reply: AppReply) -> np.ndarray:
        size, title = self._films.size, self._title
        panels = {"headset": headset_view(app, size)}
        if "views" in app.capabilities:
            panels["game"] = app.render_third_person(*size, view="spectator")[..., :3]
        if len(self._hits_ns):
            title += f", {np.count_nonzero(self._hits_ns <= time_ns)} hits recorded"
        text = score_text(self._facts, reply.log, time_ns / 1e9)
        return Painter(dict.fromkeys(panels, size)).frame(panels, title, text)
