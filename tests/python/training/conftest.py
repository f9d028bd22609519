import sys
from pathlib import Path

for room in ("dagger", "motor_control", "option_q_learning", "ppo", "teacher"):
    sys.path.insert(0, str(Path(__file__).parent / room))  # what test_resuming makes
