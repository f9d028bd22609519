"""Run folders, configurations, checkpoints, and trust in received files."""

from sim2vr_harness.base.cores import settle_torch

settle_torch()  # before torch is loaded
