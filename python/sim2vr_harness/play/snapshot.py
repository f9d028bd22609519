"""``sim2vr-harness render snapshot``: pictures of a game for people to look at."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.files import naming
from sim2vr_harness.base.notices import notice_once
from sim2vr_harness.client import AppDied
from sim2vr_harness.envs.config import AppConfig, EnvConfig, VisionConfig
from sim2vr_harness.envs.games import game_facts, with_condition, with_game, without_training
from sim2vr_harness.play.environment import evaluation_env, make_simulation
from sim2vr_harness.play.film import BodyPainter, compose, score_text
from sim2vr_harness.policies.protocol import Act, episode_of
from sim2vr_harness.policies.registry import load_policy
from sim2vr_harness.policies.scripted import scripted_policy, with_inputs
from sim2vr_harness.policies.store import TrainedUser, find_user, require_contract
from sim2vr_harness.runs.config import TrainingConfig


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
    condition: str | None = None,
    size: tuple[int, int] = (640, 480),
    seconds: float = 2.0,
    seed: int = 1,
    game: str | None = None,
    run: str | Path | None = None,
    baseline: str | None = None,
    app: Mapping[str, Any] | None = None,
    overrides: Sequence[str] = (),
    trust_app: bool = False,
    simulation: Callable[..., Any] = make_simulation,
) -> list[Path]:
    """Play a little and write what it looks like.

    Args:
        out: Folder for ``headset.png``, ``third_person.png``, ``recorder.png``, ``body.png``, the
            user's own image ``observation.png`` (colour left, depth right) and ``overview.png``.
        condition: The game's condition; None leaves it at its default.
        size: (width, height) of the pictures, pixels.
        seconds: How long to play first.
        game: The game; None takes the run's, or that of a default environment.
        run: A trained user to play; None leaves the user idle.
        baseline: The untrained user that plays, as of :func:`.scripted_policy`.
        app: Settings that replace those of ``env.app``, for example a page.
        overrides: ``env.KEY=VALUE``, what else is different.
        trust_app: Whether the app that the run names may be started, though this user never has.

    Raises:
        InputError: A number or the run cannot be used.
        ValueError: The game does not know the condition.
    """
    _check(out, seconds)
    user, config = _played(run, app, game, overrides, trust_app=trust_app)
    facts = game_facts(config.app)
    title = f"{facts.name} {condition or facts.condition_of(config.app.options)}".strip()
    config = with_condition(config, condition)
    if baseline is not None:
        config = with_inputs(config, baseline)
    with closing(simulation(config, 1)) as users:
        users.reset(seeds=[seed])
        log, total, moves = _play(users, _act_of(user, baseline, users), seconds, seed)
        pictures = _draw(users, size)
    if "headset" not in pictures:
        pictures["headset"] = _drawn_larger(simulation, config, seed, moves, size)
    text = score_text(facts, log, len(moves) / config.action_frequency_hz, total)
    panels = {"play": pictures["body"], "headset": pictures["headset"]}
    return _write(out, {**pictures, "overview": compose(panels, title, text)})


def _check(out: Path, seconds: float) -> None:
    if not 0.0 <= seconds <= 60.0:
        raise InputError("--seconds", str(seconds), "0 to 60")
    if out.exists() and not out.is_dir():
        raise InputError("--out", f"{str(out)!r}, which is a file", "a folder")


def _played(
    run: str | Path | None,
    app: Mapping[str, Any] | None,
    game: str | None,
    overrides: Sequence[str],
    *,
    trust_app: bool,
) -> tuple[TrainedUser | None, EnvConfig]:
    """Return the user of a run, None without one, and the environment to play in."""
    if run is None:
        plain_env = EnvConfig(app=AppConfig(**app)) if app else EnvConfig()
        config = without_training(plain_env) if app else plain_env
        if overrides:
            plain, source = TrainingConfig(env=with_game(EnvConfig(), game)), "--set"
            changed = evaluation_env(plain, app, overrides, source=source, trust_app=trust_app)
            config = without_training(changed, overrides)
        return None, with_game(config, game)
    user = find_user(run, code=True)
    config = evaluation_env(user.config, app, overrides, source=str(run), trust_app=trust_app)
    config = with_game(config, game)
    require_contract(user, config)
    return user, config


def _act_of(user: TrainedUser | None, baseline: str | None, users: Any) -> Callable[..., Any]:
    """Return the policy of a trained user, or of a baseline: the idle one, if none is named.

    A trained user's is its mean if its configuration says so.
    """
    if user is None or baseline is not None:
        return episode_of(scripted_policy(baseline or "still", users))
    policy, _ = load_policy(user, users.observation_space, users.action_space)
    act = episode_of(policy)
    return partial(_mean, act) if user.config.evaluation.deterministic else act


def _mean(act: Act, observation: dict[str, Any], rng: np.random.Generator) -> Any:
    """Take the policy's mean, as the user's own configuration says."""
    return act(observation, None)


def _play(
    users: Any, act: Callable[..., Any], seconds: float, seed: int
) -> tuple[dict[str, float], float, list[Any]]:
    """Play for some seconds, or to the end of the round; return log, return and moves."""
    rng = np.random.default_rng([seed, 1])
    log: dict[str, float] = {}
    total = 0.0
    moves: list[Any] = []
    for _ in range(round(seconds * users.config.action_frequency_hz)):
        observation = {key: value[0] for key, value in users.observation().items()}
        moves.append(np.asarray(act(observation, rng))[None])
        outcome = users.step(moves[-1])
        total += float(outcome.reward[0])
        log = outcome.infos[0].get("log", log)
        if outcome.terminated[0] or outcome.truncated[0]:
            if "app_error" in outcome.infos[0]:
                raise AppDied(outcome.infos[0]["app_error"])
            if "app_left" in outcome.infos[0]:
                notice_once(outcome.infos[0]["app_left"])
            break
    return log, total, moves


def _drawn_larger(
    simulation: Callable[..., Any],
    config: EnvConfig,
    seed: int,
    moves: list[Any],
    size: tuple[int, int],
) -> Any:
    """What the headset shows after the same moves, from between the eyes, (height, width, 3).

    Of an app that draws no views, such as a page: it is played once more.
    """
    channels = config.vision.channels
    vision = VisionConfig(width=size[0], height=size[1], channels=channels)
    larger = config.model_copy(update={"vision": vision})
    with closing(simulation(larger, 1)) as users:
        users.reset(seeds=[seed])
        for move in moves:
            users.step(move)
        return users.apps[0].image[..., :3].copy()


def _draw(users: Any, size: tuple[int, int]) -> dict[str, Any]:
    app = users.apps[0]
    with closing(BodyPainter(users, *size)) as painter:
        body = painter.draw(0)
    vision = users.config.vision
    views = "views" in app.capabilities
    own = app.render_headset(*vision.drawn) if views else _both_eyes(app.image)
    depth = np.repeat(own[..., 3:], 3, axis=2)
    if not views:
        return {"body": body, "observation": np.concatenate([own[..., :3], depth], axis=1)}
    return {
        "headset": app.render_headset(*size)[..., :3],
        "third_person": app.render_third_person(*size, view="spectator")[..., :3],
        "recorder": app.render_third_person(*size, view="recorder")[..., :3],
        "body": body,
        "observation": np.concatenate([own[..., :3], depth], axis=1),
    }


def _both_eyes(image: Any) -> Any:
    """(H, W, 4), of two eyes (H, 2 W, 4)."""
    return image.copy() if image.ndim == 3 else np.concatenate(list(image), axis=1)


def _write(out: Path, pictures: Mapping[str, Any]) -> list[Path]:
    out.mkdir(parents=True, exist_ok=True)
    files = []
    for name, picture in pictures.items():
        file = out / f"{name}.png"
        with naming(file):
            Image.fromarray(np.ascontiguousarray(picture)).save(file)
        files.append(file)
    return files
