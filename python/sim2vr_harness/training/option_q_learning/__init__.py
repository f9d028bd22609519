"""Q-learning of options over image cells."""
