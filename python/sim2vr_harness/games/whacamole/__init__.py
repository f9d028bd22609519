"""Whac-A-Mole for the fast recipe: a differentiable model of its rules, and what helps to train.

- :mod:`.rules`: the numbers of the true game, checked against it by tests
- :mod:`.settings`: the keys of ``teacher.imagined.game``
- :mod:`.hammer`: where the hammer is, and how deep in a target
- :mod:`.game_model`: the differentiable game model, B imagined rounds
- :mod:`.shaping`: reward shaping: the worth of a hit, and terms between hits
- :mod:`.game`: the game's entry in the registry
- :mod:`.behaviour`: what measures of its players' behaviour need to know
"""
