"""Requests to let users play: what the commands ``evaluate`` and ``compare`` have as options."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sim2vr_harness.base.requests import ActionMode, ChangedEnvironment, TrustedApp, option


@dataclass(frozen=True)
class Plays(ChangedEnvironment, TrustedApp):
    """Rounds to play; None takes the value of the run's configuration.

    Attributes:
        people: How many participants (``env.user.people``, docs/concepts/people.md) play
            ``episodes`` rounds per condition each; None: as in the training.
        app: Settings that replace those of ``env.app``, for example another executable.
    """

    conditions: Sequence[str] = option(
        "A condition of the game; may be repeated.",
        (),
        name="--condition",
        metavar="NAME",
        shown="the run's evaluation.conditions",
    )
    episodes: int | None = option(
        "Rounds per condition and participant.",
        metavar="N",
        shown="the run's evaluation.episodes: 10 unless set",
    )
    people: int | None = option(
        "Let N virtual participants play, who differ in size, strength, delays, noise and effort; "
        "means and SDs are then over participants (docs/concepts/people.md).",
        metavar="N",
    )
    seed: int | None = option(
        "Seed of the participants and of the first round; each further round adds one.",
        metavar="N",
        shown="the run's evaluation.seed: 1 unless set",
    )
    out: Path | None = option(
        "Folder for files. Results are added to those in it.",
        shown="RUN/evaluation/step_N",
        place="folder to write",
    )
    batch: int = option("How many rounds are played in parallel at most.", 12)
    app: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class KeptFiles:
    """What an evaluation keeps, and in the place of what.

    Attributes:
        film_seconds: The longest film, game time; None: whole rounds.
    """

    record: bool = option("Film the first round of every condition (MP4).", False)
    film_seconds: float | None = None
    log: bool = option("Keep the game's CSV logs, a folder per round.", False)
    steps: bool = option(
        "Write tables of every user step and app frame beside those of episodes and events.", True
    )
    overwrite: bool = option("Replace the results that are in the folder.", False)


@dataclass(frozen=True)
class Request(Plays, KeptFiles, ActionMode):
    """What to evaluate.

    Files go to ``out``; None takes the run's ``evaluation/step_<N>``, and in it a folder named
    after what is different from the run's own settings, if anything is. Of a user without training
    nothing is written then.

    Attributes:
        cores: How many to use, whatever the run says; changes no number.
        watchers: Further ones that look on.
    """

    cores: int | None = None
    watchers: Sequence[Any] = ()
