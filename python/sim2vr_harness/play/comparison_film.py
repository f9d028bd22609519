"""Films of several users who play the same round, one beside the other."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.client import GameFacts
from sim2vr_harness.envs.games import game_facts, with_condition
from sim2vr_harness.play.environment import evaluation_env, make_simulation
from sim2vr_harness.play.film import BodyPainter, Film, Painter, Picture, score_text
from sim2vr_harness.policies.protocol import episode_of
from sim2vr_harness.policies.registry import load_policy
from sim2vr_harness.policies.store import find_user, require_contract

_VIEW = (480, 360)
"""Width and height of each of the two pictures."""
_MOST = 4


class _Seat:
    """A user at play, and what one sees of it."""

    def __init__(
        self,
        run: str | Path,
        condition: str | None,
        seed: int,
        seconds: float,
        simulation: Callable[..., Any],
        *,
        trust_app: bool,
    ) -> None:
        user = find_user(run, code=True)
        config = evaluation_env(user.config, source=str(run), trust_app=trust_app)
        require_contract(user, config)
        self.facts: GameFacts = game_facts(config.app)
        self.condition = condition or self.facts.condition_of(config.app.options)
        try:
            config = with_condition(config, condition)
        except ValueError as error:
            got, _, expected = str(error).partition(": got ")[2].partition(", expected ")
            raise InputError("--condition", got, expected) from error
        self.name = str(user.card.get("name") or Path(run).name)
        self.frequency_hz = config.action_frequency_hz
        self.over = False
        self._steps, self._most = 0, round(seconds * self.frequency_hz)
        self._return, self._log = 0.0, dict[str, float]()
        mean = user.config.evaluation.deterministic
        self._rng = None if mean else np.random.default_rng([seed, 1])
        self._stack = ExitStack()
        self._users = self._stack.enter_context(closing(simulation(config, 1)))
        try:
            self._users.reset(seeds=[seed])
            if "views" not in self._users.apps[0].capabilities:
                got = f"{str(run)!r}, whose app draws no views"
                raise InputError("RUN", got, "users of an app that does")
            policy, _ = load_policy(user, self._users.observation_space, self._users.action_space)
            self._act = episode_of(policy)
            painter = BodyPainter(self._users, *_VIEW, fast=True)
            self._body = self._stack.enter_context(closing(painter))
        except BaseException:
            self.close()
            raise

    def step(self) -> None:
        """Play on; nothing once the round is over."""
        if self.over:
            return
        observation = {key: value[0] for key, value in self._users.observation().items()}
        outcome = self._users.step(np.asarray(self._act(observation, self._rng))[None])
        self._steps += 1
        self._return += float(outcome.reward[0])
        self._log = outcome.infos[0].get("log", self._log)
        ended = bool(outcome.terminated[0] or outcome.truncated[0])
        self.over = ended or self._steps >= self._most

    def picture(self) -> Picture:
        """The body in its game above the headset view; how it stands between them."""
        headset = self._users.apps[0].render_headset(*_VIEW)[..., :3]
        text = score_text(self.facts, self._log, self._steps / self.frequency_hz, self._return)
        return np.concatenate([self._body.draw(0), _line(text), np.ascontiguousarray(headset)])

    def close(self) -> None:
        """Free app and drawing context."""
        self._stack.close()


def film_comparison(
    runs: Sequence[str | Path],
    out: Path,
    *,
    condition: str | None = None,
    seed: int = 1,
    seconds: float = 60.0,
    trust_app: bool = False,
    simulation: Callable[..., Any] = make_simulation,
    on_progress: Callable[[float], None] = lambda share: None,
) -> Path:
    """Let users play a round of the same condition and seed, and film them in one video.

    Who is done first stands still until the last one is.

    Args:
        runs: Users, at most four: runs, checkpoints or ``pretrained:NAME``; from left to right.
        out: The MP4 file.
        condition: The game's condition; None leaves each user its training's.
        seed: Of bodies, policies and games.
        seconds: To film at most.
        trust_app: Whether apps that the runs name may be started, though these users never have.
        simulation: How to make a user: (EnvConfig, n) -> simulation.
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
        seats = []
        for run in runs:
            seat = _Seat(run, condition, seed, seconds, simulation, trust_app=trust_app)
            stack.callback(seat.close)
            seats.append(seat)
        rates = {seat.frequency_hz for seat in seats}
        if len(rates) > 1:
            got = f"users of {', '.join(f'{rate:g}' for rate in sorted(rates))} Hz"
            raise InputError("RUN", got, "users who act equally often")
        return _film(seats, out, seed, round(seconds * rates.pop()), on_progress)


def _film(
    seats: Sequence[_Seat],
    out: Path,
    seed: int,
    steps: int,
    on_progress: Callable[[float], None],
) -> Path:
    pictures: Mapping[str, Picture] = {}
    painter: Painter | None = None
    film: Film | None = None
    title = f"{seats[0].facts.name} {seats[0].condition}".strip()
    try:
        for step in range(steps):
            moving = [seat for seat in seats if not seat.over]
            if not moving:
                break
            for seat in moving:
                seat.step()
            drawn = {
                _numbered(k, seat): seat.picture() for k, seat in enumerate(seats) if seat in moving
            }
            pictures = {**pictures, **drawn}
            if film is None or painter is None:
                painter = Painter({name: (p.shape[1], p.shape[0]) for name, p in drawn.items()})
                film = Film(out, painter.width, painter.height, seats[0].frequency_hz)
            film.add(painter.frame(pictures, title, f"seed {seed}"))
            on_progress((step + 1) / steps)
    except BaseException:
        if film is not None:
            film.discard()
        raise
    assert film is not None
    return film.finish()


def _numbered(place: int, seat: _Seat) -> str:
    """A panel's name; the same user may be there twice."""
    return f"{place + 1}  {seat.name}"


def _line(text: str) -> Picture:
    """A line of text as wide as a view."""
    from PIL import ImageDraw, ImageFont

    image = Image.new("RGB", (_VIEW[0], 28), (24, 26, 30))
    draw = ImageDraw.Draw(image)
    draw.text((8, 14), text, (236, 236, 236), ImageFont.load_default(15), anchor="lm")
    return np.asarray(image)
