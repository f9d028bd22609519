"""Measures of users' behaviour, compared with people's.

- :mod:`.rounds`: a recorded round in the coordinates of the targets' plane
- :mod:`.grid`: positions on an even grid of time, and values computed from them
- :mod:`.measures`: the list of measures
- :mod:`.outcomes`, :mod:`.motion`, :mod:`.reaction`, :mod:`.strikes`: measures of a round
- :mod:`.round_measures`, :mod:`.persons`: of one round, and of one person's rounds
- :mod:`.distances`: inside people's range, distance, Wasserstein ratio
- :mod:`.comparing`: users against people, and one of the people against the others
- :mod:`.contrasts`: differences between conditions, fatigue
- :mod:`.sources`: sources of rounds; plays them if needed
- :mod:`.tables`, :mod:`.files`, :mod:`.figures`: output
"""
