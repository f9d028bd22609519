"""Play rounds: a simulation, a policy and watchers make a :class:`~.round.Round`."""
