"""Unmodified OpenXR programs in lockstep: a runtime of our own inside them."""
