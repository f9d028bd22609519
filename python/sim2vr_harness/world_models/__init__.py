"""Learned models of body dynamics, differentiable; torch only."""
