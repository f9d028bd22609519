"""Memory: what a training needs of it, and keeping what was freed for the next minibatch."""

import ctypes
import os
import platform

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.runs.config import TrainingConfig
from sim2vr_harness.training.ppo.rollout_buffer import buffer_bytes

USER_BYTES = 100_000
"""At least so much for a user's body and app (docs/reference/performance.md)."""

_M_TRIM_THRESHOLD = -1
_M_MMAP_MAX = -4


def keep_freed_memory() -> bool:
    """Ask the C library to keep large freed blocks instead of returning them to the system.

    A minibatch of 1,000 images allocates and frees some 700 MB; glibc gives blocks of that size
    back at once, and the next minibatch pays for fresh pages again. Keeping them makes an update
    1.7 times as fast on the CPU, for about 200 MB more memory. Results are the same to the bit.

    Returns:
        Whether the C library could be asked (it is glibc).
    """
    if platform.libc_ver()[0] != "glibc":
        return False
    libc = ctypes.CDLL(None)
    return bool(libc.mallopt(_M_MMAP_MAX, 0) and libc.mallopt(_M_TRIM_THRESHOLD, 2**31 - 1))


def require_memory(config: TrainingConfig) -> None:
    """Check that the users and the rollouts of a training can fit this machine's memory.

    Raises:
        InputError: They cannot, however little the rest takes.
    """
    from sim2vr_harness.envs.senses import observation_space_of

    have = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    space = observation_space_of(config.env)
    ppo = config.ppo
    users, rollout = ppo.n_envs * USER_BYTES, buffer_bytes(space, ppo.steps_per_iteration)
    if users + rollout > have:
        key = "ppo.n_envs" if users > rollout else "ppo.n_steps"
        got = ppo.n_envs if users > rollout else ppo.n_steps
        raise InputError(
            key,
            f"{got}, which needs {(users + rollout) / 2**30:,.0f} GiB for {ppo.n_envs:,} users and "
            f"the observations of {ppo.steps_per_iteration:,} user steps",
            f"less than the machine's {have / 2**30:,.0f} GiB",
        )
