"""Model-based training: rollouts in a learned model of the body."""
