"""Rounds played with trained users: metrics, tables, videos, learning curves and pictures."""
