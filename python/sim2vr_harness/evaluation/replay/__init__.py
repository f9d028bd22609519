"""Recorded rounds played again, and how far our game agrees with what happened then."""
