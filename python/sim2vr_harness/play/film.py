"""Pictures and films of play: body and game in one scene, and the headset view beside it."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.client import (
    AppClient,
    AppReply,
    GameFacts,
    Measure,
    Observer,
    facts_of_outside,
)
from sim2vr_harness.client.tasks import CONDITION
from sim2vr_harness.play.player import Job, Watcher
from sim2vr_harness.play.round import Round
from sim2vr_harness.sessions import Session

Picture = NDArray[np.uint8]

PANEL_HEIGHT = 420
_SCALE = 2
"""Bodies are drawn that much larger, and reduced: edges are smooth without antialiasing."""
_GIF_S = 10
_GIF_FILTER = (
    "[0:v]fps=10,scale='min(iw,800)':-2,split[a][b];[a]palettegen=stats_mode=diff[p];"
    "[b][p]paletteuse=dither=bayer:diff_mode=rectangle[gif]"
)
_HEADER = 44
_GAP = 6
_BACKGROUND = (24, 26, 30)
_INK = (236, 236, 236)
_FAINT = (168, 172, 180)
_LABELS = {
    "play": "Simulated user at play",
    "headset": "Headset view",
    "game": "Game, third person",
}


class PlainLooks:
    """A body drawn without antialiasing, in any size.

    Args:
        body: The body.
        size: Width and height, pixels.
        shadows: Whether it has shadows: without them and antialiasing it is drawn in a seventh of
            the time without a GPU.
    """

    appearance = True

    def __init__(self, body: Any, size: tuple[int, int], shadows: bool) -> None:
        self._body, self._size, self._shadows = body, size, shadows
        self.muscles = body.muscles

    def spec(self) -> Any:
        """Return the body's specification."""
        spec = self._body.spec()
        if not self._shadows:
            spec.visual.quality.shadowsize = 0
        spec.visual.quality.offsamples = 0
        spec.visual.global_.offwidth, spec.visual.global_.offheight = self._size
        return spec


class BodyPainter:
    """Draws the bodies of a simulation's users in what their apps show, and their headset views.

    An app with observers draws both views itself, pages in the steps to come, and the body is put
    into its picture by depth. Other apps leave it alone in its room.

    Args:
        simulation: Whose users to draw.
        size: Width and height, pixels, of the picture of the body.
        headset: Width and height of the headset view.
        fast: Leave out shadows, for films.
        users: Indices of those to draw; None: all.
    """

    def __init__(
        self,
        simulation: Any,
        size: tuple[int, int],
        headset: tuple[int, int],
        fast: bool = False,
        users: Sequence[int] | None = None,
    ) -> None:
        from sim2vr_harness.users.rendering import UserRenderer

        self._simulation, self._headset = simulation, headset
        self._observing = [
            simulation.apps[i]
            for i in (range(simulation.n) if users is None else users)
            if "observers" in simulation.apps[i].capabilities
        ]
        # MuJoCo's antialiasing mixes the body's edges with the black behind it.
        self._scale = _SCALE if fast or self._observing else 1
        width, height = size[0] * self._scale, size[1] * self._scale
        looks: Any = simulation.body
        if self._scale > 1:
            looks = PlainLooks(looks, (width, height), shadows=not fast)
        self._renderer = UserRenderer(looks, width, height)
        for app in self._observing:
            # Pages send pictures as PNG: larger ones would take long.
            own = (width, height) if "views" in app.capabilities else size
            app.observe((self._renderer.observer("play", *own), Observer(*headset)))

    def draw(self, index: int) -> tuple[Picture, Picture]:
        """Return user ``index``, with muscles coloured by activation, and its headset view."""
        users, app = self._simulation.users, self._simulation.apps[index]
        observed = app.observed() if app in self._observing else ()
        picture: Picture = self._renderer.render(
            users.qpos[index],
            camera="play" if observed else "third_person",
            activations=users.act[index],
            behind=observed[0] if observed else None,
        )
        if self._scale > 1:
            picture = np.asarray(Image.fromarray(picture).reduce(self._scale))
        return picture, observed[1].rgb if observed else headset_view(app, self._headset)

    def close(self) -> None:
        """Free the OpenGL context, and let apps draw their users' views only."""
        for app in self._observing:
            with suppress(RuntimeError):  # it may have ended
                app.observe(())
        self._renderer.close()


class Panels:
    """The two views of one user, each (height, width, 3) uint8.

    Where the app draws no views (a SIM2VR app of others) the headset's picture is enlarged.

    Args:
        users: Indices of those to draw.
        height: Height of every panel, pixels.
    """

    def __init__(self, simulation: Any, users: Sequence[int], height: int = PANEL_HEIGHT) -> None:
        vision = simulation.config.vision
        self.sizes = {
            "play": (round(height * 4 / 3 / 2) * 2, height),
            "headset": (round(height * vision.width / vision.height / 2) * 2, height),
        }
        self._body = BodyPainter(
            simulation, self.sizes["play"], self.sizes["headset"], fast=True, users=users
        )

    def draw(self, index: int) -> dict[str, Picture]:
        """Return the views of user ``index`` by name: ``play``, ``headset``."""
        return dict(zip(self.sizes, self._body.draw(index), strict=True))

    def close(self) -> None:
        """Free the OpenGL context of the body."""
        self._body.close()


def headset_view(app: AppClient, size: tuple[int, int]) -> Picture:
    """Return the headset's view, (height, width, 3); enlarged where the app draws no others."""
    if "views" in app.capabilities:
        drawn: Picture = app.render_headset(*size)[..., :3]
        return drawn
    picture = app.image[0] if app.image.ndim == 4 else app.image
    small = Image.fromarray(np.ascontiguousarray(picture[..., :3]))
    return np.asarray(small.resize(size, Image.Resampling.NEAREST))


class Painter:
    """Composes frames of panels of known sizes, a header above them.

    Args:
        sizes: name -> (width, height) of the panels, from left to right.
    """

    def __init__(self, sizes: Mapping[str, tuple[int, int]]) -> None:
        self._sizes = dict(sizes)
        width = sum(size[0] for size in sizes.values()) + _GAP * (len(sizes) - 1)
        height = max(size[1] for size in sizes.values()) + _HEADER
        self.width, self.height = width + width % 2, height + height % 2
        self._blank = Image.new("RGB", (self.width, self.height), _BACKGROUND)

    def frame(self, panels: Mapping[str, Picture], title: str, text: str) -> Picture:
        """Return a frame, (height, width, 3); both are even, as video codecs want it.

        Args:
            panels: name -> picture.
            title: Left part of the header.
            text: Right part of the header.
        """
        image = self._blank.copy()
        draw = ImageDraw.Draw(image)
        draw.text((12, _HEADER // 2), title, _INK, _font(20), anchor="lm")
        draw.text((self.width - 12, _HEADER // 2), text, _INK, _font(20), anchor="rm")
        left = 0
        for name, (width, _) in self._sizes.items():
            image.paste(Image.fromarray(np.ascontiguousarray(panels[name])), (left, _HEADER))
            _label(draw, _LABELS.get(name, name), left + 8, _HEADER + 8)
            left += width + _GAP
        return np.asarray(image)


def compose(panels: Mapping[str, Picture], title: str, text: str) -> Picture:
    """Return one frame of panels of whatever size; see :meth:`Painter.frame`."""
    sizes = {name: (picture.shape[1], picture.shape[0]) for name, picture in panels.items()}
    return Painter(sizes).frame(panels, title, text)


def round_title(facts: GameFacts, condition: str) -> str:
    """Return the header's title: the game, and its condition where it has several."""
    return facts.name if condition == CONDITION else f"{facts.name} {condition}".strip()


def score_text(facts: GameFacts, log: Mapping[str, float], seconds: float) -> str:
    """Return the header's numbers: ``Hits 3   Misses 1   Time 4.5 s``.

    Args:
        log: The game's log now.
        seconds: Since the round's start.
    """
    parts = [
        f"{measure.label.partition(' (')[0]} {_short(log[measure.log_key])}{_unit(measure)}"
        for measure in facts.with_log(log).counters
        if measure.log_key in log
    ]
    return "   ".join([*parts, f"Time {seconds:4.1f} s"])


def _short(value: float) -> str:
    return f"{value:.0f}" if value == round(value) else f"{value:.2f}"


def _unit(measure: Measure) -> str:
    return f" {measure.unit}" if measure.unit else ""


def _label(draw: ImageDraw.ImageDraw, text: str, x: int, y: int) -> None:
    box: Sequence[float] = draw.textbbox((x, y), text, _font(15))
    draw.rectangle((box[0] - 5, box[1] - 4, box[2] + 5, box[3] + 4), fill=_BACKGROUND)
    draw.text((x, y), text, _FAINT, _font(15))


@lru_cache
def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size)


class Film:
    """An MP4 file (H.264, yuv420p) that appears under its name when it is complete.

    Beside it are a poster frame of its middle (JPG) and a GIF of its first ten seconds.

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

        self.path, self._fps, self._frames = path, fps, 0
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
        self._frames += 1

    def finish(self) -> Path:
        """Close the file, give it its name, and write what belongs beside it."""
        import imageio_ffmpeg

        self._writer.close()
        self._temporary.replace(self.path)
        middle_s = self._frames // 2 / self._fps
        poster, gif = self.path.with_suffix(".jpg"), self.path.with_suffix(".gif")
        options = (
            *("-y", "-loglevel", "error", "-i", self.path),
            *("-ss", f"{middle_s:.3f}", "-map", "0:v", "-frames:v", "1", "-q:v", "3", poster),
            *("-t", f"{_GIF_S}", "-filter_complex", _GIF_FILTER, "-map", "[gif]", gif),
        )
        subprocess.run([imageio_ffmpeg.get_ffmpeg_exe(), *options], check=True)
        return self.path

    def discard(self) -> None:
        """Close and delete the file."""
        self._writer.close()
        self._temporary.unlink(missing_ok=True)


class RoundFilmer(Watcher):
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
        chosen = [i for i, job in enumerate(jobs) if job.episode < self._rounds]
        if not chosen:
            return
        self._panels = Panels(simulation, chosen)
        self._painter = Painter(self._panels.sizes)
        size = (self._painter.width, self._painter.height)
        for i in chosen:
            file = self._folder / f"{jobs[i].condition}_{jobs[i].episode}.mp4"
            self._films[i] = Film(file, *size, simulation.config.action_frequency_hz)

    def stepped(self, reward: NDArray, infos: Sequence[Mapping[str, Any]]) -> None:
        """Draw a frame of every filmed round."""
        self._steps += 1
        if self._panels is None:
            return
        seconds = self._steps / self._simulation.config.action_frequency_hz
        for i, film in list(self._films.items()):
            if infos[i].get("termination") == "app_failed":
                continue  # there is no app to draw the frame
            text = score_text(self._facts, infos[i].get("log", {}), seconds)
            title = round_title(self._facts, self._jobs[i].condition)
            film.add(self._painter.frame(self._panels.draw(i), title, text))
            if self._seconds is not None and seconds >= self._seconds:
                self.files.append(self._films.pop(i).finish())

    def ended(self, index: int, result: Round) -> None:
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


_COUNTDOWN_NS = 500_000_000
"""A longer first frame is the time before play; the film begins behind it."""

_HITS = ("hit", "target_hit")


class ReplayFilm:
    """Files and format of the videos of replayed rounds.

    Args:
        path: The MP4 file; with several rounds, each round's name is added before the suffix.
        size: (width, height) of each view, pixels.
        fps: Frames per second of game time.
        on_progress: Receives the proportion of a round that is rendered, 0 to 1.

    Raises:
        InputError: The path is no ``.mp4`` file, or the frame rate is out of range.
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
        time_ns = int(self._times_ns[i])
        size, title = self._films.size, self._title
        panels = {"headset": headset_view(app, size)}
        if "views" in app.capabilities:
            panels["game"] = app.render_third_person(*size, view="spectator")[..., :3]
        if len(self._hits_ns):
            title += f", {np.count_nonzero(self._hits_ns <= time_ns)} hits recorded"
        text = score_text(self._facts, reply.log, time_ns / 1e9)
        picture = Painter(dict.fromkeys(panels, size)).frame(panels, title, text)
        if self._film is None:
            height, width = picture.shape[:2]
            self._film = Film(self._path, width, height, self._films.fps)
        for _ in range(due - self._pictures):
            self._film.add(picture)
        self._pictures = due
        self._films.progress((i + 1) / len(self._times_ns))
