"""How fast this machine simulates, draws and learns; and whether it still plays the same.

- :mod:`.scene`: what a scene is; seeds, actions and hashes that all of them share
- :mod:`.scenes`: the scenes: the body alone, drawing apps, whole users, the learner
- :mod:`.senses`: variants of whole users with one sense more
- :mod:`.plan`: which scenes, with how many users and threads, over which transports
- :mod:`.run`: a run: scenes take turns, rows are compared
- :mod:`.turns`: the measurement itself
- :mod:`.rows`: results as JSON rows, and what machine they are of
- :mod:`.report`: the table and the ratios that the command line prints
- :mod:`.memory`: memory per user, in fresh processes

A scene is also a test that nothing has changed: its row holds a hash of the state after a fixed
number of steps with fixed seeds and actions.
"""
