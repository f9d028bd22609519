"""Training and benchmark of the goal-conditioned motor policy."""
