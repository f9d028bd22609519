"""CPU budget of a process (``env.cores``), shared by physics, apps and torch.

The defaults below count the cores that this process may run on, not those of the machine, so that
containers, batch systems and ``taskset`` get what they ask for.
"""

import os


def available() -> int:
    """Return how many cores this process may run on."""
    return len(os.sched_getaffinity(0))


def free() -> int:
    """Return about how many of these cores no program uses, at least 1; by the last minute."""
    used = max(0, round(os.getloadavg()[0] - 0.3))
    idle = (os.cpu_count() or 1) - used  # other programs may run on cores that are not ours
    return max(1, min(available(), idle))


def budget(setting: int) -> int:
    """Return the number of cores that ``env.cores`` means; 0 is all that are available."""
    return setting or available()


def torch_budget(setting: int) -> int:
    """Return the number of torch's threads that ``env.cores`` means.

    0 is what torch takes by itself: the cores, or fewer where OMP_NUM_THREADS says so.
    """
    import torch

    return setting or torch.get_num_threads()


def settle_torch() -> None:
    """Set how torch's threads wait; without effect once torch is loaded.

    They wait asleep: awake, they slow an update down to a quarter as soon as another program wants
    a core. They stay awake for the instant between two operations, without which imagined rollouts
    take 1.9 times as long. What the environment says already is left.
    """
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    os.environ.setdefault("GOMP_SPINCOUNT", "30000")
