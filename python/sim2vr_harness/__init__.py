"""sim2vr: automated biomechanical testing of VR applications.

Importing this package is cheap. It registers the Gymnasium ids of the environments, by name only::

    import gymnasium
    import sim2vr_harness

    gymnasium.make("sim2vr/WhacAMole-v0")
    gymnasium.make_vec("sim2vr/WhacAMole-v0", num_envs=64)

What else there is, import as you need it:

- :mod:`sim2vr_harness.client`: talk to a VR app, in process or over ZeroMQ
- :mod:`sim2vr_harness.users`: biomechanical users in MuJoCo
- :mod:`sim2vr_harness.envs`: Gymnasium environments
- :mod:`sim2vr_harness.training`, :mod:`sim2vr_harness.evaluation`: Stable-Baselines3
- :func:`load_user_policy`, :func:`evaluate`: a trained user, to play with and to measure
- :func:`load_config`, :func:`train`: a configuration, and a training of it
- :class:`EnvConfig`: the settings of an environment
- :func:`read_data`: what an evaluation measured, as data frames
- :func:`run_study`, :func:`read_study`: factors, cells, comparisons (docs/guide/study.md)
- :mod:`sim2vr_harness.base.paths`: where the app, shaders and configurations are
"""

from __future__ import annotations

import os
from importlib import import_module
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as _installed_version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sim2vr_harness.registration import register_envs

if TYPE_CHECKING:
    from sim2vr_harness.envs.config import EnvConfig
    from sim2vr_harness.evaluation.data.folder import read_data
    from sim2vr_harness.evaluation.playing import evaluate, load_user_policy
    from sim2vr_harness.runs.config import load_config
    from sim2vr_harness.studies.data import read_study
    from sim2vr_harness.studies.runner import run_study
    from sim2vr_harness.training.run.trainer import train

__all__ = [
    "EnvConfig",
    "__version__",
    "evaluate",
    "load_config",
    "load_user_policy",
    "read_data",
    "read_study",
    "run_study",
    "train",
]

# MKL, before its first product: the same bits wherever in memory the factors lie. Without it a
# training that is resumed differs from one that is not.
os.environ.setdefault("MKL_CBWR", "AUTO,STRICT")

_LAZY = {
    "EnvConfig": "sim2vr_harness.envs.config",
    "evaluate": "sim2vr_harness.evaluation.playing",
    "load_config": "sim2vr_harness.runs.config",
    "load_user_policy": "sim2vr_harness.evaluation.playing",
    "read_data": "sim2vr_harness.evaluation.data.folder",
    "read_study": "sim2vr_harness.studies.data",
    "run_study": "sim2vr_harness.studies.runner",
    "train": "sim2vr_harness.training.run.trainer",
}
"""Names of this package -> the module that has them, imported on first access."""


def __dir__() -> list[str]:
    """List the public names, lazily loaded ones included."""
    return sorted({*globals(), *__all__})


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_LAZY[name]), name)


def _version() -> str:
    """Return the version of the checkout if this is one, else of the installed package."""
    file = Path(__file__).resolve().parents[2] / "VERSION"
    if file.is_file() and file.with_name("CMakeLists.txt").is_file():
        return file.read_text(encoding="utf-8").split()[0]
    try:
        return _installed_version("sim2vr-harness")
    except PackageNotFoundError:
        return "0+unknown"


__version__: str = _version()

register_envs()
