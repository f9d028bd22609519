"""Searches: studies whose cells an optimiser chooses, trial by trial."""
