"""Tests, effect sizes and distances: arrays in, numbers out."""
