"""Audit of an app: a population and the targets that it has to use."""
