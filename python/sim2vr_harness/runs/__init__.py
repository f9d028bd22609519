"""Run folders, configurations, checkpoints, and trust in received files."""
