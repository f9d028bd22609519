"""Finding the app, the shaders and the configurations in a checkout and in an installed wheel."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import sim2vr_harness
from sim2vr_harness.base import paths

PACKAGE = Path(sim2vr_harness.__file__).resolve().parent


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """A package folder as a wheel lays it out; nothing of the checkout is visible."""
    package = tmp_path / "site-packages" / "sim2vr_harness"
    for folder in ("bin", "share/shaders", "share/configs"):
        (package / folder).mkdir(parents=True)
    (package / "share/configs/a_user.yaml").write_text("")
    app = package / "bin/sim2vr-app"
    app.write_text("#!/bin/sh\nexit 7\n")
    app.chmod(0o755)
    monkeypatch.setattr(paths, "_PACKAGE", package)
    monkeypatch.setattr(sim2vr_harness, "__path__", [str(package)])
    monkeypatch.delenv(paths.APP_VARIABLE, raising=False)
    return package


def test_a_wheel_serves_what_it_installed(installed):
    assert paths.checkout_dir() is None
    assert paths.share_dir() == installed / "share"
    assert paths.config_path("a_user") == installed / "share/configs/a_user.yaml"
    assert paths.app_executable() == installed / "bin/sim2vr-app"


@pytest.mark.parametrize("name", ["a_user", "a_user.yaml", "configs/a_user", "configs/a_user.yaml"])
def test_shipped_configurations_go_by_several_names(installed, name):
    assert paths.config_path(name).name == "a_user.yaml"


@pytest.mark.parametrize("name", ["a_usr", "elsewhere/a_user.yaml"])
def test_an_unknown_configuration_is_refused_with_the_known_ones(installed, name):
    with pytest.raises(FileNotFoundError, match=r"no configuration '.*'.*\(a_user\)"):
        paths.config_path(name)


def test_wrong_environment_variables_are_named(installed, tmp_path, monkeypatch):
    monkeypatch.setenv(paths.APP_VARIABLE, str(tmp_path))
    with pytest.raises(FileNotFoundError, match=r"SIM2VR_APP is '.*', which is no executable"):
        paths.app_executable()


def test_the_console_script_becomes_the_app(installed):
    code = (
        "import sys\nfrom pathlib import Path\nfrom sim2vr_harness.base import paths\n"
        "sys.argv = ['sim2vr-app']\npaths.exec_app()"
    )
    environment = {**os.environ, paths.APP_VARIABLE: str(installed / "bin/sim2vr-app")}
    environment["PYTHONPATH"] = str(PACKAGE.parent)
    assert subprocess.run([sys.executable, "-c", code], env=environment).returncode == 7
