"""Learned models of body dynamics, differentiable; torch only."""

from sim2vr_harness.base.cores import settle_torch

settle_torch()  # before torch is loaded
