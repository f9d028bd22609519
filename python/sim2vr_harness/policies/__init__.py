"""Policies: networks, hierarchical policies, and the store of trained users."""
