"""Tools around a study: what can be reached, what rewards are worth, a look at play.

The only importer of viser.
"""
