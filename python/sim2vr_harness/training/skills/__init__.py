"""A motor layer for every body, and users who learn any game with it."""
