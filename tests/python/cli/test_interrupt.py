"""An interrupted command of the console exits at once, and in order."""

import subprocess
import sys

SCRIPT = """
import atexit, os, signal, sys, time
from sim2vr_harness.cli import main as console

class Freed:
    def __del__(self):
        print("freed")

class Interrupts:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGTERM)

console.kept = Freed()
atexit.register(print, "cleaned up")
console.app = lambda *given, **how: {body}
sys.argv = ["sim2vr-harness", "games"]
console.main()
"""


def ended(body: str) -> tuple[int, str, str]:
    """Exit status and output of the console whose command does this."""
    script = SCRIPT.format(body=body)
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    return done.returncode, done.stdout, done.stderr


def test_an_interrupted_command_cleans_up_and_frees_no_modules() -> None:
    status, out, err = ended('print("plays") or os.kill(os.getpid(), signal.SIGTERM)')
    assert (status, out) == (130, "plays\ncleaned up\n")
    assert err.rstrip().endswith("interrupted")


def test_an_interrupt_in_a_finalizer_is_not_lost() -> None:
    status, out, err = ended("Interrupts() and None or time.sleep(30)")
    assert (status, out) == (130, "cleaned up\n")
    assert "Exception ignored" not in err
