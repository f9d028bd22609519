"""Tools around a study: recording, motion tracking, and watching play.

The only importer of viser.
"""
