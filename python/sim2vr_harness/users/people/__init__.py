"""People: who a user is, how people differ, and who the users of a batch are."""

from sim2vr_harness.users.people.people import PeopleSettings, Population
from sim2vr_harness.users.people.person import AVERAGE, FEATURES, Person
from sim2vr_harness.users.people.persons import Persons
from sim2vr_harness.users.people.traits import TRAITS, Trait, TraitName

__all__ = [
    "AVERAGE",
    "FEATURES",
    "TRAITS",
    "PeopleSettings",
    "Person",
    "Persons",
    "Population",
    "Trait",
    "TraitName",
]
