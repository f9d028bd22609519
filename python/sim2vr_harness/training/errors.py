"""Errors of the inputs of a training; at home in :mod:`sim2vr_harness.errors`."""

from __future__ import annotations

from sim2vr_harness.errors import InputError, UnusableFile, closest, unknown_name

__all__ = ["InputError", "UnusableFile", "closest", "unknown_name"]
