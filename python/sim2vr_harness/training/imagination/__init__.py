"""Practice in the mind: a learned, differentiable body plays a differentiable game.

The gradient of the reward reaches the muscles directly, which takes some hundred updates where
learning from rewards alone takes millions of user steps. Heess et al. (2015), "Learning Continuous
Control Policies by Stochastic Value Gradients"; Xu et al. (2022), "Accelerated Policy Learning with
Parallel Differentiable Simulation". What was learned here is only where the teacher's training in
the true game begins.
"""

from sim2vr_harness.training.imagination.practice import Practice, PracticeReport

__all__ = ["Practice", "PracticeReport"]
