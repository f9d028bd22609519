"""Reachable workspace of a user, and the targets within it."""
