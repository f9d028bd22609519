"""One training session: stages, progress, loggers."""
