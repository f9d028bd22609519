"""Imagined (model-based) rollouts: a learned, differentiable body plays a differentiable game.

The gradient of the reward reaches the muscles directly, which takes some hundred updates where
learning from rewards alone takes millions of user steps. Heess et al. (2015), "Learning Continuous
Control Policies by Stochastic Value Gradients"; Xu et al. (2022), "Accelerated Policy Learning with
Parallel Differentiable Simulation". What is learned here is only where the teacher's training in
the true game begins.

- :mod:`.chain`, :mod:`.body`: the body model, and how it is fitted
- :mod:`.noise`, :mod:`.users`: imagined users who move by it
- :mod:`.collecting`: user steps of the true game to fit it to
- :mod:`.critic`: what a state is worth
- :mod:`.rollouts`: cycles of the three
- :mod:`.stage`: the stage of a run
"""

from sim2vr_harness.training.model_based.trainer import CycleReport, ImaginedRollouts

__all__ = ["CycleReport", "ImaginedRollouts"]
