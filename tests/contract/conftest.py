"""Makes the scripted players importable, and the games of a library known."""

import os
import sys
from pathlib import Path

from sim2vr_harness.client import load_game_library

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[2] / "docs" / "examples"))  # beats_player

if file := os.environ.get("SIM2VR_GAME_LIBRARY"):
    load_game_library(file)
