"""Contributions of reward terms over a movement, beside its effort cost."""
