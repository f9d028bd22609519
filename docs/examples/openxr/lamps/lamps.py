"""A game in Qt Quick 3D XR: touch the lamp that moves, and pull the trigger.

Run: python lamps.py [--seed N]   (pip install PySide6; needs an OpenXR runtime and an X server)
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
from pathlib import Path

os.environ.setdefault("QSG_RHI_BACKEND", "opengl")

from PySide6.QtGui import QGuiApplication
from PySide6.QtQml import QQmlApplicationEngine

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--seed", type=int, default=1, help="of the places where lamps appear")
given = parser.parse_args()

signal.signal(signal.SIGINT, signal.SIG_DFL)
app = QGuiApplication(sys.argv[:1])
engine = QQmlApplicationEngine()
engine.setInitialProperties({"seed": given.seed % 2147483646 + 1})  # the generator's own range
engine.load(Path(__file__).with_name("Main.qml"))
sys.exit(app.exec() if engine.rootObjects() else 1)
