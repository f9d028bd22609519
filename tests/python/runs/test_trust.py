"""Programs that a run's configuration names are started only if this user has said so."""

import stat
from pathlib import Path
from typing import Any

import pytest
from fake_simulation import FakeSimulation, played_by

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.cli.main import main
from sim2vr_harness.envs.config import AppConfig, EnvConfig
from sim2vr_harness.runs.trust import named_app, remember, require_trust, state_folder


@pytest.fixture(autouse=True)
def stranger(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A user of this machine who has never trusted anything."""
    home = tmp_path / "home"
    home.mkdir()
    monkeypatch.setenv("XDG_STATE_HOME", str(home))
    monkeypatch.setattr("sim2vr_harness.runs.trust._told", [])
    return home


@pytest.fixture(autouse=True)
def started(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The programs that commands would have started; everything plays on the stand-in."""
    programs: list[str] = []

    class Simulation(FakeSimulation):
        def __init__(self, config: Any = None, n: int = 1, **how: Any) -> None:
            super().__init__(config, n, **how)
            app = self.config.app
            programs.append(app.executable or app.connect or "our own")

    played_by(monkeypatch, Simulation)
    # It plays idle users, which the stand-in has none of.
    idle = "sim2vr_harness.play.users.doing_nothing_pays"
    monkeypatch.setattr(idle, lambda _: None)
    monkeypatch.setattr("sim2vr_harness.evaluation.evaluate.doing_nothing_pays", lambda _: None)
    return programs


SETTINGS = (
    *("policy.net_arch=[16]", "policy.vision_features=8", "policy.proprioception_features=8"),
    *("ppo.n_envs=3", "ppo.n_steps=20", "ppo.batch_size=15", "ppo.n_epochs=1"),
    *("total_timesteps=120", "evaluation.episodes_after_training=0", "evaluation.episodes=1"),
)


def call(capsys: Any, *arguments: str) -> tuple[int, str]:
    with pytest.raises(SystemExit) as ended:
        main(list(arguments))
    return int(ended.value.code or 0), capsys.readouterr().err


@pytest.fixture
def received(tmp_path: Path, capsys: Any, started: list[str]) -> Path:
    """A run that somebody else has trained here: it names a program."""
    folder = tmp_path / "received"
    settings = [part for setting in SETTINGS for part in ("--set", setting)]
    train = ("train", "whacamole_constrained", *settings, "--out", str(folder))
    assert call(capsys, *train, "--timesteps", "60")[0] == 0
    config = folder / "config.yaml"
    text = config.read_text().replace("transport: in_process", "transport: protocol1")
    text = text.replace("executable: null", f"executable: {folder}/app.x86_64")
    config.write_text(text.replace("arguments: []", "arguments: [-run, 'a b']"))
    started.clear()
    return folder


def test_naming_it_or_trusting_it_starts_it(
    received: Path, capsys: Any, started: list[str], tmp_path: Path
) -> None:
    program = f"{received}/app.x86_64"
    same = ("--app", program, "--app-arg=-run", "--app-arg=a b")
    assert call(capsys, "evaluate", str(received), *same, "--condition", "medium")[0] == 0
    assert call(capsys, "evaluate", str(received), "--condition", "medium", "--trust-app")[0] == 0
    assert set(started) == {program}
    # A program that came with the run is asked for every time: a new process knows nothing of it.
    assert not any(state_folder().parent.parent.rglob("*.json"))


def test_what_was_trained_with_is_remembered_outside_of_the_run(
    capsys: Any, started: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program, folder = tmp_path / "build/app.x86_64", tmp_path / "run"
    settings = [part for setting in SETTINGS for part in ("--set", setting)]
    train = ("train", "whacamole_constrained", *settings, "--out", str(folder))
    assert call(capsys, *train, "--timesteps", "60", "--app", str(program))[0] == 0
    monkeypatch.setattr("sim2vr_harness.runs.trust._told", [])  # another process
    assert call(capsys, "evaluate", str(folder), "--condition", "medium")[0] == 0
    assert call(capsys, "train", "--resume", str(folder))[0] == 0
    assert set(started) == {str(program)}
    # The same program with other arguments is another thing.
    config = folder / "config.yaml"
    config.write_text(config.read_text().replace("arguments: []", "arguments: [--erase, /]"))
    status, err = call(capsys, "evaluate", str(folder))
    assert status == 2
    assert f'got "{program} --erase /"' in err.replace("'", '"')


def app(**settings: Any) -> EnvConfig:
    return EnvConfig(app=AppConfig(transport="protocol1", **settings))


def test_what_counts_as_the_same_program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = tmp_path / "run"
    run.mkdir()
    (tmp_path / "app").write_text("")
    program = str(tmp_path / "app")
    remember(app(executable=program, arguments=("-a",)).app, run)
    monkeypatch.setattr("sim2vr_harness.runs.trust._told", [])
    monkeypatch.chdir(tmp_path)
    for fine in ({"executable": program}, {"executable": "./app"}, {"executable": "run/../app"}):
        require_trust(app(**fine, arguments=("-a",)), run)
    # Arguments of the command line are its own business, but not the file's with its program.
    require_trust(app(executable=program, arguments=("-b",)), run, named={"arguments"})
    (tmp_path / "link").symlink_to(program)
    for other in (
        {"executable": program},
        {"executable": program, "arguments": ("-a", "-b")},
        {"executable": "link", "arguments": ("-a",)},  # some programs go by their name
        {"executable": "/bin/sh", "arguments": ("-a",)},
        {"connect": "localhost:5555"},
    ):
        with pytest.raises(InputError, match="--trust-app"):
            require_trust(app(**other), run)
    with pytest.raises(InputError, match="--trust-app"):
        require_trust(app(executable="/bin/sh", arguments=("-a",)), run, named={"executable"})
    address = app(connect="elsewhere.example:5555")
    with pytest.raises(InputError, match=r"^env\.app\.connect: .*--connect with the same"):
        require_trust(address, run)
    require_trust(address, run, named=named_app(["env={app: {connect: 'elsewhere.example:5555'}}"]))
    require_trust(address, run, trust=True)
    require_trust(address, run)
    # A trusted path that leads elsewhere by now.
    (tmp_path / "app").unlink()
    (tmp_path / "app").symlink_to("/bin/sh")
    with pytest.raises(InputError, match="--trust-app"):
        require_trust(app(executable=program, arguments=("-a",)), run)


def test_trust_that_others_could_have_written_does_not_count(
    stranger: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    remember(app(executable="/opt/app").app, tmp_path)
    monkeypatch.setattr("sim2vr_harness.runs.trust._told", [])
    place = stranger / "sim2vr/trusted_apps"
    assert stat.S_IMODE(place.stat().st_mode) == 0o700
    require_trust(app(executable="/opt/app"), tmp_path)
    place.chmod(0o770)
    with pytest.raises(InputError, match="--trust-app"):
        require_trust(app(executable="/opt/app"), tmp_path)
