"""Policies: networks, hierarchical policies, and the store of trained users."""

from sim2vr_harness.base.cores import settle_torch

settle_torch()  # before torch is loaded
