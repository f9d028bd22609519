"""The command line, ``sim2vr-harness``. Nothing imports it."""
