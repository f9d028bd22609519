"""Proximal policy optimisation, on Stable-Baselines3."""
