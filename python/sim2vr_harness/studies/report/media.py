"""Examples to watch: excerpts of films, or strips of their pictures, small enough for a page."""

import base64
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from sim2vr_harness.studies.report.source import Group

_WIDTH = 720
_SECONDS = 10.0
_POSTER_S = 3.0
"""When arms have risen from where they hung."""
_QUALITY = 30  # of H.264: larger is smaller
_STRIP, _STRIP_WIDTH = 5, 640
_MOST_BYTES = 3_000_000
"""Of all excerpts together; those beyond become strips."""
_MOST_STRIPS = 6


@dataclass(frozen=True)
class Example:
    """A film of a round.

    Attributes:
        label: Of the group.
        name: Of the whole film's file, relative to the report's folder.
        video: An excerpt as MP4, Base64; None: too large, or it cannot be cut.
        poster: What is shown before it plays, JPEG, Base64.
        strip: Pictures from it, JPEG, Base64, from first to last.
    """

    label: str
    name: str
    video: str | None
    poster: str
    strip: Sequence[str]


def examples_of(groups: Sequence[Group], root: Path) -> list[Example]:
    """Return what was filmed (``--record``), a film per group."""
    found: list[Example] = []
    left = _MOST_BYTES
    for group in groups:
        film = _film_of(group)
        if film is None:
            continue
        video = _excerpt(film) if left > 0 else None
        if video is not None and len(video) > left:
            video = None
        if video is None and len(found) >= _MOST_STRIPS:
            continue
        left -= len(video or b"")
        name = film.relative_to(root) if film.is_relative_to(root) else Path(film.name)
        found.append(
            Example(
                group.label,
                str(name),
                None if video is None else base64.b64encode(video).decode(),
                "" if video is None else _poster(film),
                [] if video is not None else _strip(film),
            )
        )
    return [example for example in found if example.video or example.strip]


def _film_of(group: Group) -> Path | None:
    for data, _ in group.parts:
        for film in sorted(data.root.parent.glob("*.mp4")):
            if film.stem.rpartition("_")[0] == group.condition:
                return film
    return None


def _excerpt(film: Path) -> bytes | None:
    """The first seconds, smaller; None where that fails."""
    how = ["-t", f"{_SECONDS:g}", "-vf", f"scale={_WIDTH}:-2", "-an", "-c:v", "libx264"]
    how += ["-crf", str(_QUALITY), "-pix_fmt", "yuv420p", "-movflags", "+faststart"]
    made = _ffmpeg(film, how, "excerpt.mp4")
    return made[0] if made else None


def _poster(film: Path) -> str:
    """A picture from the middle of the excerpt; empty where that fails."""
    how = ["-vf", f"select=gte(t\\,{_POSTER_S:g}),scale={_WIDTH}:-2", "-frames:v", "1", "-q:v", "6"]
    made = _ffmpeg(film, how, "poster.jpg")
    return base64.b64encode(made[0]).decode() if made else ""


def _strip(film: Path) -> list[str]:
    """Pictures from first to last."""
    import imageio_ffmpeg

    try:
        frames, _ = imageio_ffmpeg.count_frames_and_secs(str(film))
    except RuntimeError:
        return []
    every = max(1, int(frames) // _STRIP)
    choose = f"select=not(mod(n\\,{every})),scale={_STRIP_WIDTH}:-2"
    how = ["-vf", choose, "-vsync", "0", "-frames:v", str(_STRIP), "-q:v", "5"]
    return [base64.b64encode(picture).decode() for picture in _ffmpeg(film, how, "%03d.jpg")]


def _ffmpeg(film: Path, how: Sequence[str], name: str) -> list[bytes]:
    """Files that ffmpeg makes of a film, in the order of their names; none where it fails."""
    import imageio_ffmpeg

    with tempfile.TemporaryDirectory() as folder:
        start = [imageio_ffmpeg.get_ffmpeg_exe(), "-nostdin", "-loglevel", "error"]
        command = [*start, "-i", str(film), *how, str(Path(folder) / name)]
        done = subprocess.run(command, capture_output=True, check=False)
        if done.returncode != 0:
            return []
        return [file.read_bytes() for file in sorted(Path(folder).iterdir())]
