"""Hierarchical policies: a motor policy below, options above."""
