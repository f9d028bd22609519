"""The seam between measures of behaviour and a game.

What people and simulated users do is measured of a tool that strikes at targets in a plane. Where
the targets and the plane are, a round's log says; what it does not say is described here, so that
the measures know no game by name.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Ratings:
    """Published ratings of fatigue in the conditions of the same task.

    Attributes:
        scale: name of the rating scale.
        medians: group -> condition -> median rating.
        people: group -> number of people.
        source: publication of the figures.
    """

    scale: str
    medians: Mapping[str, Mapping[str, float]]
    people: Mapping[str, int]
    source: str


@dataclass(frozen=True)
class Contrast:
    """Two conditions whose difference is of interest, such as a harder minus an easier one."""

    name: str
    condition: str
    minus: str


@dataclass(frozen=True)
class Behaviour:
    """Facts about a game that its behavioural measures need.

    Attributes:
        game: name of the game in the runtime.
        tool: the columns of ``states.csv`` that hold the tool's pose, without ``_pos_x``.
        root_m: the point whose speed the game tests, in the controller's frame (Unity's axes), m.
        places_m: x and y of each cell's target in the plane, m; for recordings whose log has no
            ``grid mapping``.
        groups: name of a set of people who play by the same rule -> suffix of the names of its
            conditions; one suffix is empty.
        conditions: label, in the order of the tables -> all names of the condition in the game,
            without the group's suffix; the first one is played.
        one_target: conditions with at most one target at a time: a spawn is then a stimulus, and
            the family ``reaction`` is measured.
        speed_rule: groups in which a touch can be too slow to count; contacts and swings through
            the plane are measured in these.
        alive_after_s: time after its spawn from which a target counts as available.
        without: measures that do not apply to this game.
        contrasts: differences between conditions that people show.
        tiring: conditions that differ in fatigue, in the order of the tables.
        ratings: fatigue ratings of these conditions; None: not known.
        headlines: (condition, measure) shown first.
        any_app: True if rounds are sessions of any app: the hand is measured, not a tool.
        aimed: True for a game of aimed movements: Fitts' law and throughput are measured over all
            conditions.
    """

    game: str
    tool: str
    root_m: Vector
    places_m: tuple[tuple[float, float], ...]
    groups: Mapping[str, str]
    conditions: Mapping[str, tuple[str, ...]]
    one_target: frozenset[str] = frozenset()
    speed_rule: frozenset[str] = frozenset()
    alive_after_s: float = 0.0
    without: frozenset[str] = frozenset()
    contrasts: tuple[Contrast, ...] = ()
    tiring: tuple[str, ...] = ()
    ratings: Ratings | None = None
    headlines: tuple[tuple[str, str], ...] = field(default_factory=tuple)
    any_app: bool = False
    aimed: bool = False

    @property
    def least_people(self) -> int:
        """Lowest number of recorded people for a comparison.

        It is 0 for aimed movements, whose figures are published, and 2 for a range of people.
        """
        return 0 if self.aimed else 1 if self.any_app else 2

    def recognise(self, name: str) -> tuple[str, str] | None:
        """Return group and condition for a game's condition name; None if it is not compared."""
        group = self.group_of(name)
        base = name.removesuffix(self.groups[group])
        for condition, names in self.conditions.items():
            if base in names:
                return group, condition
        return None

    def group_of(self, name: str) -> str:
        """Group of a game's name of a condition: the one with the longest ending that it has."""
        fitting = [group for group, ending in self.groups.items() if name.endswith(ending)]
        return max(fitting, key=lambda group: len(self.groups[group]))

    def played(self, group: str) -> tuple[str, ...]:
        """The game's names of the conditions of a group, in the order of the tables."""
        return tuple(names[0] + self.groups[group] for names in self.conditions.values())
