"""Published results of people who select targets within reach in VR, with a tracked hand or device.

Numbers are given only where the text that reports them was at hand. Other studies are listed for
their task, without numbers.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Study:
    """One group of people in one study.

    Attributes:
        citation: authors, title, place and year.
        people: how many; None where the text at hand does not say.
        task: what they did, and with what.
        a_s: intercept of MT = a + b ID; None where it is not known here, as below.
        b_s_per_bit: slope.
        r2: of that line.
        throughput_bps: effective, as the standard has it.
        note: where the numbers are from, and what is not known.
    """

    citation: str
    people: int | None
    task: str
    a_s: float | None = None
    b_s_per_bit: float | None = None
    r2: float | None = None
    throughput_bps: float | None = None
    note: str = ""

    @property
    def label(self) -> str:
        """Authors and year."""
        return f"{self.citation.partition(', *')[0]} {self.citation[-4:]}"


STUDIES = (
    Study(
        citation="Triantafyllidis et al., *Metrics for 3D object pointing and manipulation in "
        "virtual reality*, IEEE Robotics & Automation Magazine 29 (1), 2022",
        people=None,
        task="discrete reaching within arm's length in three dimensions, hand tracked optically, "
        "no controller",
        a_s=0.453,
        b_s_per_bit=0.557,
        r2=0.859,
        note="experiment 1, pointing (figure 6, page 87); the figure's seven models have slopes "
        "of 0.41 to 0.58 s/bit. This one is taken for Shannon's form: it is the fourth, as the "
        "form is in the text, and equals the fifth, which adds a direction that the experiment "
        "has not",
    ),
    Study(
        citation="arXiv 2510.18625, *Effects of virtual controller representation and virtuality "
        "on selection performance in extended reality*, 2025",
        people=40,
        task="rings of 13 targets, touched with a 1 cm ball on a Meta Quest 3 controller and "
        "confirmed with the trigger; the nearest to this game",
        note="only its beginning was at hand",
    ),
    Study(
        citation="University of Rijeka, *Empirical validation of Fitts' law in virtual reality*, "
        "Multimodal Technologies and Interaction 10 (5) 49, 2026",
        people=32,
        task="ISO 9241 pointing, Meta Quest 3 controller and bare hand; distances of 20 to 50 cm, "
        "targets of 2.5 to 5 cm",
        note="only its beginning was at hand",
    ),
    Study(
        citation="Batmaz et al., *Hitting the wall: mid-air interaction for eye-hand "
        "coordination*, VRST, 2019",
        people=12,
        task="touching targets in mid-air with and without a controller, and on a soft wall",
        note="slower, and with lower throughput, against the wall; only its beginning was at hand",
    ),
    Study(
        citation="Batmaz, Mutasim and Stuerzlinger, *Precision vs. power grip: a comparison of pen "
        "grip styles for selection in virtual reality*, IEEE VR Workshops, 2020",
        people=12,
        task="a pen at three depths",
        note="no effect of depth; fewer errors with a precision grip; only its beginning was at "
        "hand",
    ),
    Study(
        citation="Clark, Bhagat and Riggs, *Extending Fitts' law in three-dimensional virtual "
        "environments with current low-cost virtual reality technology*, International Journal of "
        "Human-Computer Studies, 2020",
        people=None,
        task="discrete reaching within arm's length, Oculus Rift controller",
        note="only its abstract was at hand",
    ),
)


def studies_table() -> str:
    """Return the studies as a table of Markdown."""
    lines = [
        "| study | people | task | a (s) | b (s/bit) | R2 | throughput (bits/s) | note |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for study in STUDIES:
        numbers = (study.a_s, study.b_s_per_bit, study.r2, study.throughput_bps)
        cells = [
            study.citation,
            "-" if study.people is None else str(study.people),
            study.task,
            *("-" if number is None else f"{number:.3g}" for number in numbers),
            study.note,
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)
