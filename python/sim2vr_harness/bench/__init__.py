"""How fast this machine simulates, draws and learns; and whether it still plays the same.

- :mod:`.scenes`: what can be measured, one class each
- :mod:`.plan`: which scenes with how many users and threads; scenes of one run take turns
- :mod:`.turns`: the measurement itself
- :mod:`.rows`: results as JSON rows, and what machine they are of
- :mod:`.report`: the table and the ratios that the command line prints
- :mod:`.memory`: memory per user, in fresh processes
- :mod:`.profile`: where the time of a step goes
- :mod:`.reference_way`: the same users as the reference runs them, for comparison

A scene is also a test that nothing has changed: its row holds a hash of the state after a fixed
number of steps with fixed seeds and actions.
"""
