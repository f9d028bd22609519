"""Description of pointing for the measures of its players' behaviour: Fitts' law."""

from sim2vr_harness.games.behaviour import Behaviour

_SHOWN = (
    *("throughput", "aimed_time", "fitts_a", "fitts_b", "fitts_r2", "fitts_a_effective"),
    *("fitts_b_effective", "fitts_r2_effective", "endpoint_spread", "submovements"),
    *("aimed_errors", "timeouts"),
)

BEHAVIOUR = Behaviour(
    game="pointing",
    tool="tip",
    root_m=(0.0, 0.0, 0.0),
    places_m=((0.0, 0.0),),
    groups={"pointing": ""},
    conditions={"all": ()},
    headlines=tuple(("all", name) for name in _SHOWN),
    aimed=True,
)
