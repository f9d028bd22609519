"""Prints how long the stages of a run took, and their parts.

Run: python tools/bench/stages.py runs/NAME
"""

import argparse

from measure.profile import stage_lines
from sim2vr_harness.runs.run_folder import RunFolder


def main() -> None:
    """Print a line for each part of each stage."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", help="the run's folder")
    print("\n".join(stage_lines(RunFolder.open(parser.parse_args().run))))


if __name__ == "__main__":
    main()
