"""Record a round of a WebXR page on any headset: a script in the page, a server for its folder."""

from sim2vr_harness.tools.record.parts import recover
from sim2vr_harness.tools.record.script import bookmarklet, script_tag
from sim2vr_harness.tools.record.server import RecordingServer

__all__ = ["RecordingServer", "bookmarklet", "recover", "script_tag"]
