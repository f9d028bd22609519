"""Model-based training: a learned, differentiable body plays a differentiable game.

The gradient of the reward reaches the muscles directly, which takes some hundred updates where
learning from rewards alone takes millions of user steps. Heess et al. (2015), "Learning Continuous
Control Policies by Stochastic Value Gradients"; Xu et al. (2022), "Accelerated Policy Learning with
Parallel Differentiable Simulation". The teacher's training in the game itself starts from the
result.

:mod:`.trainer` has the cycles of collecting, fitting and policy updates of any task, :mod:`.stage`
a game as the task, and the stage of a run.
"""
