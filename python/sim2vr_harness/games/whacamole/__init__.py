"""Whac-A-Mole for the fast recipe: a differentiable model of its rules, and what helps to train.

- :mod:`.rules`: the numbers of the true game, checked against it by tests
- :mod:`.settings`: the keys of ``teacher.imagined.game``
- :mod:`.hammer`: where the hammer is, and how deep in a target
- :mod:`.twin`: B imagined rounds
- :mod:`.game`: the resident itself
- :mod:`.behaviour`: what measures of its players' behaviour need to know
"""
