"""What the simulated user perceives: its own body, and the headset's picture."""

from sim2vr_harness.perception.proprioception import Proprioception
from sim2vr_harness.perception.vision import CHANNELS, HeadsetVision

__all__ = ["CHANNELS", "HeadsetVision", "Proprioception"]
