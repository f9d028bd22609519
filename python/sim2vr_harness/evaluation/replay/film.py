"""Films a replay: what the player saw, and the game from outside."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.client import AppClient, AppReply, describe_game
from sim2vr_harness.evaluation.replay.recordings import GAME, Recording
from sim2vr_harness.evaluation.replay.timing import Timing
from sim2vr_harness.evaluation.scene_images import Painter, score_text
from sim2vr_harness.evaluation.video import Film

__all__ = ["ReplayFilm", "RoundFilm"]


class ReplayFilm:
    """Where the films of replayed rounds go, and what they look like.

    Args:
        path: The MP4 file; of several rounds, each gets its name between stem and suffix.
        size: (width, height) of each of the two views, pixels.
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
        on_progress: Callable[[float], None] | None = None,
    ) -> None:
        if path.suffix.lower() != ".mp4":
            raise InputError("--video", str(path), "a file name that ends in .mp4")
        if not 1.0 <= fps <= 240.0:
            raise InputError("--fps", f"{fps:g}", "1 to 240")
        self._path, self._size, self._fps, self._on_progress = path, size, fps, on_progress
        self.files: list[Path] = []

    def round(self, recording: Recording, only: bool) -> RoundFilm:
        """Start the film of a round; ``only``: there is no other one."""
        path = self._path
        if not only:
            path = path.with_stem(f"{path.stem}-{recording.name.replace('/', '-')}")
        return RoundFilm(path, self._size, self._fps, recording, self)

    def progress(self, share: float) -> None:
        """Pass on how much of the round is filmed."""
        if self._on_progress is not None:
            self._on_progress(share)


class RoundFilm:
    """The film of one round: a context that keeps the file only when the round went through."""

    def __init__(
        self,
        path: Path,
        size: tuple[int, int],
        fps: float,
        recording: Recording,
        films: ReplayFilm,
    ) -> None:
        self._size, self._fps, self._recording, self._films = size, fps, recording, films
        self._painter = Painter({"headset": size, "game": size})
        self._film = Film(path, self._painter.width, self._painter.height, fps)
        self._pictures = 0

    def __enter__(self) -> RoundFilm:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self._films.files.append(self._film.finish())
        else:
            self._film.discard()

    def watch(self, app: AppClient, timing: Timing, frame: int, reply: AppReply) -> None:
        """Show the frame for as long as it was there, from the first frame of play on."""
        times_ns = timing.frame_times_ns
        first = 0 if timing.play_start_ns is None else 1
        if frame < first:
            return
        last = frame + 1 == len(times_ns)
        until_ns = int(times_ns[frame]) + 1 if last else int(times_ns[frame + 1])
        due = int(np.ceil((until_ns - int(times_ns[first])) / 1e9 * self._fps - 1e-9))
        if due <= self._pictures:
            return
        picture = self._picture(app, int(times_ns[frame]), int(times_ns[first]), reply)
        for _ in range(due - self._pictures):
            self._film.add(picture)
        self._pictures = due
        self._films.progress((frame + 1) / len(times_ns))

    def _picture(self, app: AppClient, time_ns: int, first_ns: int, reply: AppReply) -> np.ndarray:
        panels = {
            "headset": app.render_headset(*self._size)[..., :3],
            "game": app.render_third_person(*self._size, view="spectator")[..., :3],
        }
        recorded = sum(
            event.kind == "hit" and event.time_s <= time_ns / 1e9
            for event in self._recording.events
        )
        title = f"{self._recording.name}: {self._recording.condition}, {recorded} hits recorded"
        return self._painter.frame(
            panels, title, score_text(describe_game(GAME), reply.log, (time_ns - first_ns) / 1e9)
        )
