"""Learning to play with Stable-Baselines3; the only room that imports it.

- :mod:`.config`: the validated training configuration (no torch needed)
- :mod:`.policy`: the reference's network
- :mod:`.vec_env`, :mod:`.buffer`, :mod:`.ppo`: the pieces PPO runs on
- :mod:`.checkpoint`, :mod:`.run_folder`: what is kept of a run, and exact resumption
- :mod:`.trainer`: one training session from start to table
- :mod:`.measuring`: what the benchmark needs of Stable-Baselines3
"""
