"""What users do beside what people do.

- :mod:`.rounds`: a recorded round in the coordinates of the targets' plane
- :mod:`.grid`: positions on an even grid of time, and what is worked out from them
- :mod:`.measures`: the list of measures
- :mod:`.outcomes`, :mod:`.motion`, :mod:`.reaction`, :mod:`.strikes`: what is measured of a round
- :mod:`.round_measures`, :mod:`.persons`: of one round, and of one person's rounds
- :mod:`.distances`: inside people's range, distance, Wasserstein ratio
- :mod:`.comparing`: users against people, and one of the people against the others
- :mod:`.contrasts`: differences between conditions, fatigue
- :mod:`.sources`: where rounds come from; plays them if need be
- :mod:`.tables`, :mod:`.files`, :mod:`.figures`: what is made of it
"""
