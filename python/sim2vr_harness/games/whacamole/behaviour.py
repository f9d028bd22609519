"""Description of Whac-A-Mole for the measures of its players' behaviour."""

from sim2vr_harness.games.behaviour import Behaviour, Contrast, Ratings

_SPACING_M = 0.125

BEHAVIOUR = Behaviour(
    game="whacamole",
    tool="marker",
    # The hammer's root near the hand; its velocity is what the game tests (games/whacamole/hammer).
    root_m=(0.0096, -0.0491, -0.0545),
    places_m=tuple(
        (_SPACING_M * (cell % 3 - 1), _SPACING_M * (1 - cell // 3)) for cell in range(9)
    ),
    groups={"constrained": "", "unconstrained": "-unconstrained"},
    # The study's people played "medium" a second time as "mid", the middle one of the placements.
    conditions={
        "easy": ("easy",),
        "medium": ("medium", "mid", "mid-medium"),
        "hard": ("hard",),
        "low": ("low", "low-medium"),
        "high": ("high", "high-medium"),
    },
    one_target=frozenset({"easy"}),
    speed_rule=frozenset({"constrained"}),
    alive_after_s=0.1,
    contrasts=(
        Contrast("medium - easy", "medium", "easy"),
        Contrast("hard - medium", "hard", "medium"),
        Contrast("medium - low", "medium", "low"),
        Contrast("high - medium", "high", "medium"),
        Contrast("high - low", "high", "low"),
    ),
    tiring=("low", "medium", "high"),
    ratings=Ratings(
        scale="Borg's scale of exertion, 6 to 20, whole body",
        medians={
            "constrained": {"low": 9.0, "medium": 9.0, "high": 9.5},
            "unconstrained": {"low": 8.5, "medium": 8.0, "high": 10.0},
        },
        people={"constrained": 12, "unconstrained": 6},
        source="Fischer et al., SIM2VR, UIST 2024",
    ),
    headlines=(
        ("easy", "vm_latency"),
        ("easy", "strike_early"),
        ("easy", "tth_median"),
        ("medium", "tth_median"),
        ("easy", "hits"),
        ("medium", "wrist_ratio"),
        *((condition, "hit_rate") for condition in ("easy", "medium", "hard", "low", "high")),
    ),
)
"""Nine cells, a hammer, and two rules: a hit needs speed, or any touch is one."""
