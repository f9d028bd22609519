"""The request of ``sim2vr-harness audit``, as its options have it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.requests import ChangedEnvironment, Expected, TrustedApp, option

_MOST_PEOPLE = 10_000


@dataclass(frozen=True, kw_only=True)
class AuditRequest(ChangedEnvironment, TrustedApp, Expected):
    """The targets of an audit, and its participants.

    Attributes:
        app: Settings of ``env.app`` that the options of pages and programs mean.
    """

    game: str | None = option(
        "Targets of a game, found by running it.", metavar="NAME", names="games"
    )
    condition: Sequence[str] = option("The game's condition; may be repeated.", (), metavar="NAME")
    objects: str | None = option(
        "Which of the game's objects are targets, with * and ?, by their names.",
        metavar="NAME",
        shown="those that come, go or move, and small ones",
    )
    targets: Sequence[str] = option(
        "A file of targets (name, place or object, how, hold_s and more), the log of a round, or a "
        "place, [NAME=]X,Y,Z in m to the right, up and ahead; may be repeated.",
        (),
        metavar="SOURCE",
    )
    session: Path | None = option(
        "Targets are where a recorded session's hands pressed a trigger or squeeze.",
        metavar="FILE",
        place="file to read",
    )
    how: str = option("What is done with a game's targets: touch or point.", "touch", metavar="HOW")
    seconds: float = option("How long to look at each round of the game, or at the page.", 10.0)
    user: str | None = option(
        "Audit this user alone: a body or its YAML file, a configuration, or a trained user. Draws "
        "the hull of what it reaches. With --operate: a script, carried out by a population.",
        metavar="USER",
        names="users",
    )
    point: str | None = option(
        "With --user: the device or part of the body that has to get there.",
        metavar="PART",
        shown="the first controller",
    )
    tool: str | None = option(
        "With --user: an object that the game puts in the hand, for --point.", metavar="NAME"
    )
    cell: float = option("With --user: edge of the cells of the hull, m.", 0.05)
    pose: str | None = option(
        "With --user: how long this posture can be held. Other joints stay where episodes start; "
        "a name without _r or _l sets both arms.",
        metavar="JOINT=DEGREES,...",
    )
    load: float = option("With --pose: mass in each hand, kg, beside the controller.", 0.0)
    people: int | None = option(
        "Number of virtual participants, 1 to 10,000; with --user, of its population.",
        metavar="N",
        shown="500; with --user it alone",
    )
    stance: str = option("Participants' stance: seated or standing.", "seated", metavar="STANCE")
    recline: float = option(
        "How far the trunk leans back about the hips, degrees; 90: the participants lie.", 0.0
    )
    height_offset: float = option(
        "How far the app raises its users above their place, m; negative if it lowers them.", 0.0
    )
    pace: float = option("Uses of a target per minute.", 20.0, metavar="N")
    operate: int = option(
        "With a script as --user: how many participants carry it out.", 0, metavar="N"
    )
    seed: int = option("Seed of the participants.", 1)
    out: Path = option("Folder for the files.", Path("audit"), place="folder to write")
    app: Mapping[str, Any] = field(default_factory=dict)

    @property
    def script(self) -> str | None:
        """What virtual participants do in the app; None: there is no script."""
        from sim2vr_harness.policies.scripted import is_script

        return self.user if self.user and self.operate and is_script(self.user) else None

    def check(self) -> None:
        """Refuse options that are out of range or do not go together.

        Raises:
            InputError: Names the flag.
        """
        self._check_together()
        for flag, got, known in (
            ("--how", self.how, ("touch", "point")),
            ("--stance", self.stance, ("seated", "standing")),
        ):
            if got not in known:
                raise InputError(flag, repr(got), " or ".join(known))
        if self.recline and self.stance == "standing":
            raise InputError("--recline", "it with --stance standing", "it with --stance seated")
        people = 500 if self.people is None else self.people
        for flag, number, low, high, expected in (
            ("--people", people, 1, _MOST_PEOPLE, f"1 to {_MOST_PEOPLE:,}"),
            ("--seed", self.seed, 0, 2**31 - 1, f"0 to {2**31 - 1}"),
            ("--pace", self.pace, 0.1, 120.0, "0.1 to 120 uses in a minute"),
            ("--operate", self.operate, 0, people, f"0 to the {people} of --people"),
            ("--recline", self.recline, 0.0, 90.0, "0 to 90 degrees"),
            ("--height-offset", self.height_offset, -2.0, 2.0, "-2 to 2 m"),
            ("--cell", self.cell, 0.01, 0.2, "0.01 to 0.2 m"),
            ("--seconds", self.seconds, 1e-9, 600.0, "more than 0, at most 600"),
        ):
            if not low <= number <= high:
                raise InputError(flag, f"{number:g}", expected)

    def _check_together(self) -> None:
        page, alone = self.app.get("page"), AuditRequest()
        listed = bool(self.targets) or self.session is not None
        if self.script and self.game is None and not self.app:
            raise InputError("--user", "a script without an app", "it with --game or --page")
        if self.operate and not self.script:
            expected = "it with a script as --user, such as --user 'press lit by ray'"
            raise InputError("--operate", str(self.operate), expected)
        if self.user is None or self.script:
            for flag in ("point", "tool", "cell", "pose", "load"):
                if getattr(self, flag) != getattr(alone, flag):
                    raise InputError(f"--{flag}", "it without --user", "it with --user")
            if self.game is None and page is None and not listed:
                if self.app:
                    expected = (
                        "it with --targets FILE.yaml or --session, since a program lists no objects"
                    )
                    raise InputError("--openxr", "a program without --targets", expected)
                raise InputError("--game, --page, --targets or --session", "none", "one of them")
            if self.overrides and self.game is None and not self.app:
                raise InputError("--set", "it without an app", "it with --game or --page")
        for flag in (
            ("stance", "recline", "height_offset", "pace", "how", "expect")
            if self.user and not self.script
            else ()
        ):
            if getattr(self, flag) != getattr(alone, flag):
                expected = "it without --user: it is about a population"
                name = flag.replace("_", "-")
                raise InputError(f"--{name}", "it together with --user", expected)
        if self.pose is not None:
            for flag in ("game", "targets", "session", "point", "tool", "app", "cell"):
                if getattr(self, flag) != getattr(alone, flag):
                    name = "page or --openxr" if flag == "app" else flag
                    raise InputError(f"--{name}", "it together with --pose", "one of them")
        elif self.load:
            raise InputError("--load", "it without --pose", "it with --pose")
        if self.game is not None and self.app:
            raise InputError("--page or --openxr", "it together with --game", "one of them")
        if self.game is None and (self.condition or self.objects is not None):
            raise InputError("--condition or --objects", "it without --game", "it with --game")
        if self.tool is not None and (self.point is not None or self.game is None):
            wrong = "it together with --point" if self.point is not None else "it without --game"
            raise InputError("--tool", wrong, "it with --game and without --point")

    @property
    def title(self) -> str:
        """What the audited app or list is called."""
        if page := self.app.get("page"):
            file = Path(page).resolve()
            return file.parent.name if file.name == "index.html" else file.name
        source = Path(self.targets[0]) if self.targets else self.session
        listed = source.stem if source is not None and source.exists() else "the listed targets"
        return self.game or self.app.get("game") or listed
