#!/usr/bin/env python3
"""Compare the audit's prediction with acting it out by muscles and trunk.

Persons and places are drawn; a pair agrees if both or neither bring the hand within 2 cm.

    python tools/research/audit_agreement.py [--people N] [--places N] [--seed N] [--csv FILE]

A run that was ended goes on after the last line of its CSV.
"""

import argparse
import csv
import time
from pathlib import Path

import numpy as np

from sim2vr_harness.audit.population import NONE, draw
from sim2vr_harness.audit.postures import BALANCE, Balancer
from sim2vr_harness.audit.reaching import Crowd, Rows
from sim2vr_harness.audit.report import act_out
from sim2vr_harness.statistics.intervals import wilson_interval

LOW, HIGH = np.array([-0.2, -0.8, 0.4]), np.array([0.9, 0.5, 1.8])
"""Corners of the box that places are drawn from: ahead, left, up, m."""
ATTEMPTS = 3
FIELDS = (
    "person,ahead,left,up,out_of_reach_m,leans,gap_m,left_nm,way_nm,predicted,"
    "acted,acted_gap_m,attempts"
)


def play(given: argparse.Namespace, file: Path) -> None:
    """Write a line per pair."""
    crowd = Crowd(draw(given.people, given.seed), "seated", NONE)
    rng = np.random.default_rng(given.seed)
    count = given.people * given.places
    places = LOW + rng.random((count, 3)) * (HIGH - LOW)
    persons = np.repeat(np.arange(given.people), given.places)
    right = np.zeros(count, dtype=bool)
    solved = crowd.solve(Rows(persons, right, places, np.full(count, BALANCE.near_m)))
    done = len(file.read_text(encoding="utf-8").splitlines()) - 1 if file.exists() else 0
    if done <= 0:
        file.write_text(FIELDS + "\n", encoding="utf-8")
    last = None
    for row in range(max(done, 0), count):
        if persons[row] != last:
            last = persons[row]
            subject = crowd.subjects[last]
            balancer = Balancer(subject.body)
        found = balancer.search(places[row], solved.angles[row], BALANCE.near_m)
        there, gap_m, attempts = False, np.inf, 0
        for posture in [*(each.angles for each in found[:ATTEMPTS]), None]:
            attempts += 1
            there, least_m = act_out(subject, places[row], posture=posture)
            gap_m = min(gap_m, least_m)
            if there:
                break
        values = [last, *(f"{x:.3f}" for x in places[row])]
        values += [f"{solved.gap_m[row]:.4f}", int(solved.leans[row])]
        values += [f"{x:.4f}" for x in (found[0].gap_m, found[0].left_nm, found[0].way_nm)]
        values += [int(found[0].holds(BALANCE.near_m)), int(there), f"{gap_m:.4f}", attempts]
        with file.open("a", encoding="utf-8") as lines:
            lines.write(",".join(map(str, values)) + "\n")


def cause(row: dict[str, float]) -> str:
    """Why the hand is predicted not to get there, or did not although it was predicted to."""
    if row["predicted"]:
        return "tolerance: within 3 cm" if row["acted_gap_m"] < 0.03 else "motor layer"
    if row["out_of_reach_m"] > 0.0:
        return "out of reach"
    still = row["left_nm"] <= 0.1 and row["gap_m"] <= BALANCE.near_m
    return "too weak on the way" if still else "too weak for any posture found"


def main() -> None:
    """Play what is left, then print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--people", type=int, default=40)
    parser.add_argument("--places", type=int, default=25)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--csv", default="agreement.csv")
    given = parser.parse_args()
    begun = time.process_time()
    play(given, Path(given.csv))
    with open(given.csv, encoding="utf-8") as lines:
        rows = [{name: float(x) for name, x in row.items()} for row in csv.DictReader(lines)]
    acted = np.array([row["acted"] for row in rows]) == 1
    reached = np.array([row["out_of_reach_m"] for row in rows]) <= 0.0
    predicted = np.array([row["predicted"] for row in rows]) == 1
    leans = np.array([row["leans"] for row in rows]) == 1
    for words, able in (("inverse kinematics", reached), ("muscles too", predicted)):
        for part, chosen in (("all", leans | ~leans), ("leaning", leans), ("upright", ~leans)):
            same, n = int((acted == able)[chosen].sum()), int(chosen.sum())
            low, high = wilson_interval(same, n)
            print(f"{words}, {part}: {n} pairs, agreement {same / n:.3f} [{low:.3f}, {high:.3f}]")
        for yes in (True, False):
            numbers = [int(((able == yes) & (acted == done)).sum()) for done in (True, False)]
            print(f"  predicted {yes}: acted {numbers[0]}, not {numbers[1]}")
    for agree in (False, True):
        kinds = [
            cause(r)
            for r in rows
            if (r["predicted"] == r["acted"]) == agree and (r["predicted"] != 1 or r["acted"] != 1)
        ]
        print(
            "same, not there" if agree else "differ",
            {kind: kinds.count(kind) for kind in sorted(set(kinds))},
        )
    print(f"CPU {time.process_time() - begun:.0f} s")


if __name__ == "__main__":
    main()
