"""Benchmarks of simulation, rendering and learning, with a regression test by state hashes.

- :mod:`.scene`: base class of benchmark scenes; shared seeds, actions and hashes
- :mod:`.scenes`: the scenes: the body alone, drawing apps, whole users, the learner
- :mod:`.senses`: variants of whole users with one additional sense
- :mod:`.plan`: selection of scenes, numbers of users, threads and transports
- :mod:`.run`: a run: scenes take turns, rows are compared
- :mod:`.turns`: the measurement itself
- :mod:`.rows`: results as JSON rows with a description of the machine
- :mod:`.report`: table and ratios on the command line
- :mod:`.memory`: memory per user, in fresh processes

Each scene is also a regression test: its row has a hash of the state after a fixed number of steps
with fixed seeds and actions.
"""
