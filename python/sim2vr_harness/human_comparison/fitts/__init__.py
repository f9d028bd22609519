"""Aimed movements from the logs of the game ``pointing``: Fitts' law, throughput, submovements.

- :mod:`.taps`: what a round's log says of every target
- :mod:`.movements`: movements from one selection to the next, blocks, and their effective numbers
- :mod:`.law`: movement time against the index of difficulty, and all of a user's numbers
- :mod:`.users`: users of several persons; they play if need be
- :mod:`.beside`: users beside people
- :mod:`.submovements`: how many pieces a movement is made of
- :mod:`.published`: what is published of people
- :mod:`.picture`: movement time over index of difficulty
"""

from sim2vr_harness.human_comparison.fitts.law import FittsResult, measure_user
from sim2vr_harness.human_comparison.fitts.movements import Block, Movement, blocks_of, movements_of
from sim2vr_harness.human_comparison.fitts.taps import Tap, read_taps
from sim2vr_harness.statistics.fitts import FittedLine, fit_line

__all__ = [
    "Block",
    "FittedLine",
    "FittsResult",
    "Movement",
    "Tap",
    "blocks_of",
    "fit_line",
    "measure_user",
    "movements_of",
    "read_taps",
]
