"""``sim2vr-harness render``: pictures of a game, and films of users who play the same round."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.files import naming
from sim2vr_harness.client import AppDied
from sim2vr_harness.play.environment import make_simulation
from sim2vr_harness.play.film import (
    BodyPainter,
    Film,
    Painter,
    Picture,
    compose,
    round_title,
    score_text,
)
from sim2vr_harness.play.player import Job, Player
from sim2vr_harness.play.users import SimulatedUser

_VIEW = (480, 360)
"""Width and height of each of the two pictures of a user in a comparison."""
_MOST = 4


def parse_size(text: str, largest: tuple[int, int] = (1280, 960)) -> tuple[int, int]:
    """Return (width, height) of ``WIDTHxHEIGHT``, 16x16 to ``largest``.

    Raises:
        InputError: It is something else, or out of range.
    """
    width, _, height = text.lower().partition("x")
    if not (width.isdigit() and height.isdigit()):
        raise InputError("--size", repr(text), "WIDTHxHEIGHT in pixels, for example 640x480")
    size = int(width), int(height)
    if not (16 <= size[0] <= largest[0] and 16 <= size[1] <= largest[1]):
        raise InputError("--size", repr(text), f"16x16 to {largest[0]}x{largest[1]}")
    return size


def snapshot(
    out: Path,
    *,
    user: str | Path = "still",
    condition: str | None = None,
    size: tuple[int, int] = (640, 480),
    seconds: float = 2.0,
    seed: int = 1,
    game: str | None = None,
    app: Mapping[str, Any] | None = None,
    person: int | None = None,
    overrides: Sequence[str] = (),
    trust_app: bool = False,
    simulation: Callable[..., Any] = make_simulation,
) -> list[Path]:
    """Play a little and write what it looks like.

    Args:
        out: Folder for ``headset.png``, ``third_person.png``, ``recorder.png``, ``body.png``, the
            user's own image ``observation.png`` (colour left, depth right) and ``overview.png``.
        user: Who plays, as of :meth:`SimulatedUser.find`.
        condition: The game's condition; None leaves it at its default.
        size: (width, height) of the pictures, pixels.
        seconds: How long to play first.
        game: The game; None takes the user's.
        app: Settings that replace those of ``env.app``, for example a page.
        person: Number of the virtual participant who plays; None: as the environment says.
        overrides: ``env.KEY=VALUE``, what else is different.
        trust_app: Whether the app that the user names may be started, though you never have.

    Raises:
        InputError: A number or the user cannot be used.
        ValueError: The game does not know the condition.
    """
    if not 0.0 <= seconds <= 60.0:
        raise InputError("--seconds", str(seconds), "0 to 60")
    if out.exists() and not out.is_dir():
        raise InputError("--out", f"{str(out)!r}, which is a file", "a folder")
    who = SimulatedUser.find(user)
    env = who.env(app, overrides, game=game, trust_app=trust_app, person=person, seed=seed)
    who.require_contract(env)
    facts = env.facts
    title = round_title(facts, condition or facts.condition_of(env.config.app.options))
    env = env.with_condition(condition)
    config = env.config
    with closing(simulation(env, 1)) as users:
        policy, _ = who.policy(users, facts)
        mean = who.config.evaluation.deterministic
        player = Player(users, policy, facts, deterministic=mean)
        player.begin([Job("", 0, seed, person=person)])
        steps, painter = round(seconds * config.action_frequency_hz), None
        for outcome in islice(player.steps(), steps):
            if "app_error" in outcome.infos[0]:
                raise AppDied(outcome.infos[0]["app_error"])
            if player.step_count == steps - 1:  # a page draws for it in the last step only
                painter = BodyPainter(users, size, size)
        with closing(painter or BodyPainter(users, size, size)) as painter:
            pictures = _draw(users, painter, size)
    text = score_text(facts, player.logs[0], player.seconds)
    panels = {"play": pictures["body"], "headset": pictures["headset"]}
    out.mkdir(parents=True, exist_ok=True)
    files = []
    for name, picture in {**pictures, "overview": compose(panels, title, text)}.items():
        file = out / f"{name}.png"
        with naming(file):
            Image.fromarray(np.ascontiguousarray(picture)).save(file)
        files.append(file)
    return files


def _draw(users: Any, painter: BodyPainter, size: tuple[int, int]) -> dict[str, Any]:
    app = users.apps[0]
    body, headset = painter.draw(0)
    vision = users.config.vision
    views = "views" in app.capabilities
    if views:
        own = app.render_headset(vision.width, vision.height)
    else:  # two eyes (2, H, W, 4) beside each other
        own = app.image if app.image.ndim == 3 else np.concatenate(list(app.image), axis=1)
    depth = np.repeat(own[..., 3:], 3, axis=2)
    drawn = {"headset": headset, "body": body}
    if views:
        for name, view in (("third_person", "spectator"), ("recorder", "recorder")):
            drawn[name] = app.render_third_person(*size, view=view)[..., :3]
    return {**drawn, "observation": np.concatenate([own[..., :3], depth], axis=1)}


class _Seat:
    """A user at play, and what one sees of it."""

    def __init__(
        self,
        run: str | Path,
        condition: str | None,
        seed: int,
        stack: ExitStack,
        simulation: Callable[..., Any],
        *,
        game: str | None,
        app: Mapping[str, Any] | None,
        person: int | None,
        overrides: Sequence[str],
        trust_app: bool,
    ) -> None:
        user = SimulatedUser.find(run)
        env = user.env(app, overrides, game=game, trust_app=trust_app, person=person, seed=seed)
        user.require_contract(env)
        self.facts = env.facts
        self.condition = condition or self.facts.condition_of(env.config.app.options)
        try:
            env = env.with_condition(condition)
        except ValueError as error:
            got, _, expected = str(error).partition(": got ")[2].partition(", expected ")
            raise InputError("--condition", got, expected) from error
        self.name = user.name
        self.frequency_hz = env.config.action_frequency_hz
        self._users = stack.enter_context(closing(simulation(env, 1)))
        policy, _ = user.policy(self._users, self.facts)
        mean = user.config.evaluation.deterministic
        self._player = Player(self._users, policy, self.facts, deterministic=mean)
        self._player.begin([Job("", 0, seed, person=person)])
        self.steps: Iterator[Any] = self._player.steps()
        self._body = stack.enter_context(closing(BodyPainter(self._users, _VIEW, _VIEW, fast=True)))

    def picture(self) -> Picture:
        """The body in its game above the headset view; how it stands between them."""
        body, headset = self._body.draw(0)
        player = self._player
        text = score_text(self.facts, player.logs[0], player.seconds)
        line = Image.new("RGB", (_VIEW[0], 28), (24, 26, 30))
        ImageDraw.Draw(line).text(
            (8, 14), text, (236, 236, 236), ImageFont.load_default(15), anchor="lm"
        )
        return np.concatenate([body, np.asarray(line), headset])


def film_comparison(
    runs: Sequence[str | Path],
    out: Path,
    *,
    game: str | None = None,
    app: Mapping[str, Any] | None = None,
    condition: str | None = None,
    person: int | None = None,
    seed: int = 1,
    seconds: float = 60.0,
    overrides: Sequence[str] = (),
    trust_app: bool = False,
    simulation: Callable[..., Any] = make_simulation,
    on_progress: Callable[[float], None] = lambda share: None,
) -> Path:
    """Let users play a round of the same condition and seed, and film them in one video.

    Who is done first stands still until the last one is.

    Args:
        runs: Users, at most four, as of :meth:`SimulatedUser.find`; from left to right.
        out: The MP4 file.
        game: The game; None takes each user's.
        app: Settings that replace those of ``env.app``, for example a page.
        condition: The game's condition; None leaves each user its training's.
        person: Number of the virtual participant who plays; None: as each environment says.
        seed: Of bodies, policies and games.
        seconds: To film at most.
        overrides: ``env.KEY=VALUE``, what is different from the users' own environments.
        trust_app: Whether apps that the runs name may be started, though these users never have.
        simulation: How to make a user: (ResolvedEnv, n) -> simulation.
        on_progress: Called with the share of the seconds filmed.

    Raises:
        InputError: A run, a condition, a number or the file cannot be used.
    """
    if out.suffix.lower() != ".mp4":
        raise InputError("--out", repr(str(out)), "a file name that ends in .mp4")
    if not 1 <= len(runs) <= _MOST:
        raise InputError("RUN", f"{len(runs)} users", f"1 to {_MOST}")
    if not 0.0 < seconds <= 3600.0:
        raise InputError("--seconds", f"{seconds:g}", "more than 0, at most 3600")
    if not 0 <= seed < 2**31:
        raise InputError("--seed", str(seed), "0 to 2147483647")
    with ExitStack() as stack:
        seats = [
            _Seat(
                run,
                condition,
                seed,
                stack,
                simulation,
                game=game,
                app=app,
                person=person,
                overrides=overrides,
                trust_app=trust_app,
            )
            for run in runs
        ]
        rates = {seat.frequency_hz for seat in seats}
        if len(rates) > 1:
            got = f"users of {', '.join(f'{rate:g}' for rate in sorted(rates))} Hz"
            raise InputError("RUN", got, "users who act equally often")
        steps = round(seconds * rates.pop())
        title = round_title(seats[0].facts, seats[0].condition)
        # The same user may be there twice.
        names = [f"{place}  {seat.name}" for place, seat in enumerate(seats, start=1)]
        pictures: dict[str, Picture] = {}
        painter: Painter | None = None
        film: Film | None = None
        try:
            for step in range(steps):
                moving = [seat for seat in seats if next(seat.steps, None) is not None]
                if not moving:
                    break
                for name, seat in zip(names, seats, strict=True):
                    if seat in moving:
                        pictures[name] = seat.picture()
                if film is None or painter is None:
                    painter = Painter({n: (p.shape[1], p.shape[0]) for n, p in pictures.items()})
                    film = Film(out, painter.width, painter.height, seats[0].frequency_hz)
                film.add(painter.frame(pictures, title, f"seed {seed}"))
                on_progress((step + 1) / steps)
        except BaseException:
            if film is not None:
                film.discard()
            raise
    assert film is not None
    return film.finish()
