"""Everything that a comparison finds, put together."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.games.behaviour import Behaviour
from sim2vr_harness.human_comparison.comparing import (
    Compared,
    ComparisonRow,
    Total,
    compare,
    left_out,
    total,
)
from sim2vr_harness.human_comparison.contrasts import (
    ContrastRow,
    Fatigue,
    FatigueDifference,
    contrasts,
    fatigue_of,
    group_contrasts,
)
from sim2vr_harness.human_comparison.fitts import AimedPerson, Law, law_of
from sim2vr_harness.human_comparison.persons import RecordedPerson
from sim2vr_harness.human_comparison.sources import Source


def aimed_of(source: Source) -> list[tuple[RecordedPerson, AimedPerson]]:
    """Return a source's persons and their aimed movements; none in other games."""
    persons = (person for own in source.persons.values() for person in own)
    return [(person, person.aimed) for person in persons if person.aimed is not None]


@dataclass(frozen=True)
class ComparisonReport:
    """Comparison of users with recorded people.

    Attributes:
        behaviour: of the game.
        people: recorded people, with whose range users are compared.
        users: the compared users.
    """

    behaviour: Behaviour
    people: Source
    users: Sequence[Source]

    @cached_property
    def compared(self) -> tuple[Compared, ...]:
        """A user each, in the order of the users.

        Raises:
            InputError: A user has no condition with people.
        """
        found = [
            compare(u.name, u.persons, self.people.persons, self.behaviour) for u in self.users
        ]
        for each, user in zip(found, self.users, strict=True):
            if not each.rows:
                played = ", ".join(sorted(" ".join(cell) for cell in user.persons))
                people = ", ".join(sorted(" ".join(cell) for cell in self.people.persons))
                got = f"{user.name!r}, who played {played}"
                raise InputError("USER", got, f"a condition of people's: {people}")
        return tuple(found)

    @cached_property
    def together(self) -> Total | None:
        """All users as one, where each plays by another rule; None of one user, or if not so."""
        groups = [group for each in self.compared for group in each.groups]
        if len(self.compared) < 2 or len(groups) > len(set(groups)):
            return None
        return total(self.rows())

    def rows(self) -> list[ComparisonRow]:
        """Return the rows of all users."""
        return [row for each in self.compared for row in each.rows]

    @cached_property
    def laws(self) -> dict[str, Law]:
        """Fitts' law of the users and of people, by name; none in games without aimed movements."""
        sources = [(source, aimed_of(source)) for source in (*self.users, self.people)]
        return {each.name: law_of([own for _, own in found]) for each, found in sources if found}

    @cached_property
    def left_out(self) -> dict[str, dict[str, Compared]]:
        """Comparison of each person with the others of the group: group -> person -> result."""
        return left_out(self.people.persons, self.behaviour)

    def contrasts(self, user: Source) -> list[ContrastRow]:
        """Return differences between a user's conditions."""
        return contrasts(user.persons, self.people.persons, self.behaviour)

    def group_contrasts(self) -> list[tuple[str, ContrastRow]]:
        """Return differences between groups, of users that are in both or are combined."""
        sets = [(user.name, dict(user.persons)) for user in self.users]
        if self.together is not None:
            joined = {cell: persons for _, own in sets for cell, persons in own.items()}
            sets = [(" and ".join(name for name, _ in sets), joined)]
        return [
            (name, row)
            for name, persons in sets
            for row in group_contrasts(persons, self.people.persons, self.behaviour)
        ]

    def fatigue(self, user: Source) -> tuple[list[Fatigue], list[FatigueDifference]]:
        """Return the fatigue of a user's conditions; see contrasts.fatigue_of."""
        return fatigue_of(user.fatigue, self.behaviour)
