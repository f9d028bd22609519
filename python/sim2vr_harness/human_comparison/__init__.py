"""Measures of users' behaviour, compared with people's.

- :mod:`.rounds`: a session as it is measured: tool, hand, head and targets
- :mod:`.grid`: positions on an even grid of time, and values computed from them
- :mod:`.measures`: the list of measures
- :mod:`.persons`, :mod:`.reaction`: measures of a round, and of one person's rounds
- :mod:`.fitts`: aimed movements: Fitts' law, throughput, what is published
- :mod:`.comparing`: users against people, and one of the people against the others
- :mod:`.contrasts`: differences between conditions, fatigue
- :mod:`.sources`: recorded people and users; lets users play if needed
- :mod:`.report`, :mod:`.tables`, :mod:`.files`, :mod:`.figures`: output
"""
