#!/usr/bin/env python3
"""Compare the audit's inverse kinematics with acting it out by muscles and trunk.

Persons and places are drawn; a pair agrees if both or neither bring the hand within 2 cm.

    python tools/research/audit_agreement.py [--persons N] [--places N] [--seed N] [--csv FILE]
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

import numpy as np

from sim2vr_harness.audit.acting import NEAR_M, Actor
from sim2vr_harness.audit.judging import hold
from sim2vr_harness.audit.population import NONE, Subject, draw
from sim2vr_harness.audit.reaching import Crowd, Rows
from sim2vr_harness.envs.config import body_of

LOW, HIGH = np.array([-0.2, -0.8, 0.4]), np.array([0.9, 0.5, 1.8])
"""Corners of the box that places are drawn from: ahead, left, up, m."""


def stronger(subject: Subject, factor: float) -> Subject:
    """The person with stronger muscles."""
    physique = subject.user.person
    more = physique.model_copy(update={"strength": factor * physique.strength})
    return replace(subject, body=body_of(subject.user.model_copy(update={"person": more})))


def main() -> None:
    """Print a line per person, then the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--persons", type=int, default=40)
    parser.add_argument("--places", type=int, default=25)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--strength", type=float, default=1.0, help="factor on muscles that act")
    parser.add_argument("--csv", default="agreement.csv")
    given = parser.parse_args()
    crowd = Crowd(draw(given.persons, given.seed), "seated", NONE)
    rng = np.random.default_rng(given.seed)
    count = given.persons * given.places
    places = LOW + rng.random((count, 3)) * (HIGH - LOW)
    persons = np.repeat(np.arange(given.persons), given.places)
    right = np.zeros(count, dtype=bool)
    found = crowd.solve(Rows(persons, right, places, np.full(count, NEAR_M)))
    acted, shares = [], []
    begun = time.process_time()
    with open(given.csv, "w", encoding="utf-8") as file:
        file.write(
            "person,ahead,left,up,reached,gap_m,leans,share,acted,acted_gap_m,attempts,seconds\n"
        )
        for row in range(count):
            if row % given.places == 0:
                actor = Actor(stronger(crowd.subjects[persons[row]], given.strength))
            subject, postures = crowd.subjects[persons[row]], found.angles[row][found.found[row]]
            held = [hold(subject, each, 0.0, NONE)[0] for each in postures]
            order = np.argsort(held)
            shares.append(min(held, default=np.inf))
            done = actor.act(places[row], postures[order][:3])
            acted.append(done.done)
            where = ",".join(f"{x:.3f}" for x in places[row])
            file.write(
                f"{persons[row]},{where},{int(found.reached[row])},{found.gap_m[row]:.4f},"
                f"{int(found.leans[row])},{shares[-1]:.3f},{int(done.done)},{done.gap:.4f},{done.attempts},"
                f"{done.seconds or 0:.2f}\n"
            )
            file.flush()
    both, strong = np.array(acted), np.array(shares) <= 1.0
    for words, able in (("reached", found.reached), ("reached, muscles suffice", strong)):
        print(f"{words}: {count} pairs, agreement {(both == able).mean():.3f}")
        for ik in (True, False):
            for done in (True, False):
                n = int(((able == ik) & (both == done)).sum())
                print(f"  audit {ik}, acted {done}: {n}")
    print(f"CPU {time.process_time() - begun:.0f} s")


if __name__ == "__main__":
    main()
