"""Playback control of frames: pause, step, speed, back and forth."""

from collections.abc import Iterator

from sim2vr_harness.tools.watch.frames import Playlist, ViewerFrame

SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0)


class Playback:
    """Walks through a show's moments; new ones are made when they are needed, and kept.

    Args:
        show: whose.

    Attributes:
        moments: made so far.
        at: number of the one that is shown; -1: none yet.
        playing: whether time goes on.
        speed: game seconds per second.
        over: whether the last one was made.
    """

    def __init__(self, show: Playlist) -> None:
        self._show = show
        self._source: Iterator[ViewerFrame] | None = None
        self._due = 0.0
        self.moments: list[ViewerFrame] = []
        self.at, self.playing, self.speed, self.over = -1, True, 1.0, False

    @property
    def now(self) -> ViewerFrame | None:
        """The moment that is shown."""
        return self.moments[self.at] if self.at >= 0 else None

    def tick(self, seconds: float) -> bool:
        """Let time go by; return whether another moment is shown now.

        At most one moment is made at a time: where that takes longer than its time, play is slower.
        """
        if not self.playing or (self.over and self.at == len(self.moments) - 1):
            self._due = 0.0
            return False
        self._due += seconds * self.speed * self._show.frequency_hz
        steps = int(self._due)
        self._due -= steps
        if steps == 0:
            return False
        known = min(steps, len(self.moments) - 1 - self.at)
        if known > 0:
            self.at += known
            return True
        return self.step()

    def step(self) -> bool:
        """Show the next moment; return whether there is one."""
        if self.at + 1 < len(self.moments):
            self.at += 1
            return True
        if self.over:
            return False
        if self._source is None:
            self._source = self._show.moments()
        moment = next(self._source, None)
        if moment is None:
            self.over = True
            return False
        self.moments.append(moment)
        self.at += 1
        return True

    def seek(self, number: int) -> bool:
        """Show a moment that was made; return whether it is another one than before."""
        number = max(0, min(number, len(self.moments) - 1))
        if not self.moments or number == self.at:
            return False
        self.at = number
        return True

    def restart(self) -> None:
        """Begin anew: another round where the show is live."""
        self.close()
        self.moments, self.at, self.over = [], -1, False

    def close(self) -> None:
        """Let go of what the show opened."""
        source, self._source = self._source, None
        if source is not None:
            source.close()  # type: ignore[attr-defined]
