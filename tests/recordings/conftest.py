"""Recordings of others have no licence and are not included; SIM2VR_RECORDINGS names them."""

from parts import RECORDINGS

collect_ignore_glob = [] if RECORDINGS.is_dir() else ["test_*.py"]
