"""Teacher policies with privileged observations."""
