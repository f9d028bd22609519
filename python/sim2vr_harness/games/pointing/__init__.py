"""Pointing for the fast recipe: a differentiable model of the tapping task.

- :mod:`.rules`: the numbers of the true game, checked against it by tests
- :mod:`.settings`: the keys of ``teacher.imagined.game``
- :mod:`.stylus`: where the tip is
- :mod:`.game_model`: the differentiable game model, B imagined rounds
- :mod:`.game`: the game's entry in the registry
- :mod:`.behaviour`: what `compare` has to know of it
"""
