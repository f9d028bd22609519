"""Errors, settings, files, paths, locks and cores: what every room stands on."""
