"""Selection of a playlist: a trained user, a body, a recorded round, a page or a game."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.play.users import SimulatedUser
from sim2vr_harness.sessions import read_sessions
from sim2vr_harness.sessions.whacamole import is_recorded_round, with_clock
from sim2vr_harness.tools.users import environment_of
from sim2vr_harness.tools.watch.frames import Playlist, person_show, user_show
from sim2vr_harness.tools.watch.sessions import session_show


def choose(
    run: str | None,
    *,
    played: bool = False,
    person: int | None = None,
    game: str | None = None,
    condition: str | None = None,
    seed: int = 1,
    deterministic: bool | None = None,
    trust_app: bool = False,
    app: Mapping[str, Any] | None = None,
    untrained: str | None = None,
    overrides: Sequence[str] = (),
) -> Playlist:
    """Return the playlist to watch.

    Args:
        run: a user, configuration or body, or a logged or recorded round's folder or file.
        played: True if you play.
        person: number of the virtual participant who plays; None: as the environment says.
        game: another game than the user's.
        condition: of the game.
        seed: of the round.
        deterministic: True: actions are the policy's mean; None: as in the user's configuration.
        trust_app: True: the app that it names may be started, even if you never started it before.
        app: settings of ``env.app``, which name a page or program; no user is needed then.
        untrained: instead of ``run``, a user without training.
        overrides: ``env.KEY=VALUE``, further settings.

    Raises:
        InputError: It is none of them, or options exclude each other.
    """
    if app and (run is not None or played or game is not None or condition is not None):
        raise InputError("--page", "it with a user, a game or --try", "the page alone")
    if app or untrained is not None:
        player = SimulatedUser.find(untrained or "random")
        env = player.env(app, overrides, game=game, trust_app=trust_app, person=person, seed=seed)
        return user_show(player, env.with_condition(condition), seed=seed, person=person)
    if run is not None and _recorded(Path(run)):
        if played:
            raise InputError("--try", "it with a recording", "it with a game, a user, or alone")
        if game is not None or condition is not None:
            raise InputError("--game or --condition", "it with a recording", "neither of them")
        return recorded_show(Path(run))
    who = run or "mobl_arms_wrist"
    env = _environment(who, game, condition, overrides, trust_app=trust_app)
    if played:
        return person_show(env, seed=seed)
    try:
        user = SimulatedUser.find(who)
    except InputError:  # a configuration or a body
        return user_show(None, env, seed=seed)
    if person is not None:
        env = user.with_people(env, person + 1, seed, overrides)
    user.require_contract(env)
    return user_show(user, env, seed=seed, deterministic=deterministic, person=person)


def recorded_show(path: Path) -> Playlist:
    """Return a recorded round of Whac-A-Mole, played again by its poses: no body.

    Raises:
        InputError: there is no such recording, or several.
    """
    found = read_sessions(path)
    if len(found) != 1:
        names = ", ".join(each.name for each in found[:5])
        raise InputError("RUN", f"{len(found)} recordings ({names})", "the folder of one")
    session, name = found[0], found[0].name
    if is_recorded_round(session):
        session = with_clock(session, closed_loop=False)
    return session_show(session, name)


def _environment(
    who: str,
    game: str | None,
    condition: str | None,
    overrides: Sequence[str],
    *,
    trust_app: bool,
) -> ResolvedEnv:
    try:
        return environment_of(
            who, game=game, condition=condition, overrides=overrides, trust_app=trust_app
        )
    except InputError as error:
        if error.field != "USER":
            raise
        expected = f"the folder of a logged or recorded round, {error.expected}"
        raise InputError("RUN", error.got, expected) from error


def _recorded(path: Path) -> bool:
    """Return whether a path is a round's log or a recording rather than a run."""
    if path.is_file():
        return path.suffix in (".csv", ".npz", ".json")
    if not path.is_dir() or (path / "config.yaml").exists() or (path / "card.json").exists():
        return False
    return any(path.rglob("states.csv")) or any(path.rglob("manifest.json"))
