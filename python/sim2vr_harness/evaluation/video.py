"""Films rounds as MP4 files."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.client import GameFacts
from sim2vr_harness.evaluation.metrics import RoundResult
from sim2vr_harness.evaluation.rollouts import Job
from sim2vr_harness.evaluation.scene_images import Painter, Panels, score_text


class Film:
    """An MP4 file (H.264, yuv420p) that appears under its name when it is complete.

    Args:
        path: The file.
        width: Even number of pixels.
        height: Even number of pixels.
        fps: Frames per second.

    Raises:
        RuntimeError: ffmpeg cannot be started.
    """

    def __init__(self, path: Path, width: int, height: int, fps: float) -> None:
        import imageio_ffmpeg

        self.path = path
        path.parent.mkdir(parents=True, exist_ok=True)
        for abandoned in path.parent.glob(f".{path.stem}.*.mp4"):
            abandoned.unlink()
        self._temporary = path.with_name(f".{path.stem}.{os.getpid()}.mp4")
        self._writer: Any = imageio_ffmpeg.write_frames(
            str(self._temporary),
            (width, height),
            fps=fps,
            codec="libx264",
            pix_fmt_out="yuv420p",
            macro_block_size=2,
            quality=None,
            output_params=["-crf", "20", "-preset", "veryfast", "-movflags", "+faststart"],
        )
        self._writer.send(None)

    def add(self, frame: NDArray[np.uint8]) -> None:
        """Append a frame, (height, width, 3)."""
        self._writer.send(np.ascontiguousarray(frame))

    def finish(self) -> Path:
        """Close the file and give it its name."""
        self._writer.close()
        self._temporary.replace(self.path)
        return self.path

    def discard(self) -> None:
        """Close and delete the file."""
        self._writer.close()
        self._temporary.unlink(missing_ok=True)


class RoundFilmer:
    """A watcher that films the first rounds of every condition.

    Args:
        folder: Where ``<condition>_<episode>.mp4`` goes.
        facts: What the game publishes, for the numbers in the header.
        rounds: How many rounds per condition.
        seconds: The longest film, game time; None: the whole round.
    """

    def __init__(
        self, folder: Path, facts: GameFacts, rounds: int = 1, seconds: float | None = None
    ) -> None:
        self._folder, self._facts = folder, facts
        self._rounds, self._seconds = rounds, seconds
        self._films: dict[int, Film] = {}
        self._panels: Panels | None = None
        self.files: list[Path] = []

    def started(self, simulation: Any, jobs: Sequence[Job]) -> None:
        """Open a film for every round to record."""
        self.close()
        self._simulation, self._jobs = simulation, jobs
        self._steps = 0
        self._returns = np.zeros(len(jobs))
        chosen = [i for i, job in enumerate(jobs) if job.episode < self._rounds]
        if not chosen:
            return
        self._panels = Panels(simulation)
        self._painter = Painter(self._panels.sizes)
        size = (self._painter.width, self._painter.height)
        for i in chosen:
            file = self._folder / f"{jobs[i].condition}_{jobs[i].episode}.mp4"
            self._films[i] = Film(file, *size, simulation.config.action_frequency_hz)

    def stepped(self, reward: NDArray, infos: Sequence[Mapping[str, Any]]) -> None:
        """Draw a frame of every filmed round."""
        self._steps += 1
        self._returns += reward
        if self._panels is None:
            return
        seconds = self._steps / self._simulation.config.action_frequency_hz
        for i, film in list(self._films.items()):
            if infos[i].get("termination") == "app_failed":
                continue  # there is no app to draw the frame
            text = score_text(
                self._facts, infos[i].get("log", {}), seconds, float(self._returns[i])
            )
            film.add(self._painter.frame(self._panels.draw(i), self._jobs[i].condition, text))
            if self._seconds is not None and seconds >= self._seconds:
                self.files.append(self._films.pop(i).finish())

    def ended(self, index: int, result: RoundResult) -> None:
        """Finish the film of a round; a round whose app failed leaves none."""
        film = self._films.pop(index, None)
        if film is None:
            return
        if result.ended == "app_failed":
            film.discard()
        else:
            self.files.append(film.finish())

    def close(self) -> None:
        """Delete what was not finished and free the drawing context."""
        for film in self._films.values():
            film.discard()
        self._films = {}
        if self._panels is not None:
            self._panels.close()
            self._panels = None
