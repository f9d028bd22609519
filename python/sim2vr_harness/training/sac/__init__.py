"""Soft actor-critic of Stable-Baselines3."""
