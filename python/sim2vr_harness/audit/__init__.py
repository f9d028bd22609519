"""Audit of an app: a population beside its targets."""
