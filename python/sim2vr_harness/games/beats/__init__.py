"""Beats for the fast recipe: a differentiable model of its rules.

- :mod:`.rules`: the numbers of the true game, checked against it by tests
- :mod:`.settings`: the keys of ``teacher.imagined.game``
- :mod:`.levels`: the levels that imagined rounds play
- :mod:`.sabers`: where the blades are, how far from a box, how fast
- :mod:`.lane`: what of a level is where, for every round
- :mod:`.game_model`: the differentiable game model, B imagined rounds
- :mod:`.game`: the game's entry in the registry
"""
