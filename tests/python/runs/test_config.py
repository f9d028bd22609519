import re
from pathlib import Path

import pytest
import yaml

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.runs.config import (
    TrainingConfig,
    apply_overrides,
    first_difference,
    load_config,
    parse_config,
    to_yaml,
)

CONFIGS = Path(__file__).parents[3] / "configs"


@pytest.mark.parametrize(("group", "adaptive"), [("constrained", True), ("unconstrained", False)])
def test_shipped_configurations_are_the_reference(group: str, adaptive: bool) -> None:
    name = f"whacamole_{'adaptive_' if adaptive else ''}{group}"
    config = load_config(CONFIGS / f"{name}.yaml")
    assert config.name == name
    condition = {"constrained": "random", "unconstrained": "random-unconstrained"}[group]
    assert config.env.app.options == {"condition": condition, "adaptive": adaptive}
    ppo = config.ppo
    assert (ppo.n_envs, ppo.n_steps, ppo.batch_size, ppo.n_epochs) == (10, 4000, 1000, 10)
    assert (ppo.gamma, ppo.gae_lambda, ppo.clip_range, ppo.target_kl) == (0.99, 0.95, 0.2, 1.0)
    assert (ppo.ent_coef, ppo.vf_coef, ppo.max_grad_norm) == (0.0, 0.5, 0.5)
    rate = ppo.learning_rate
    assert (rate.initial, rate.final, rate.constant_fraction) == (5e-5, 1e-7, 0.2)
    assert config.total_timesteps == 100_000_000
    assert config.env.user.effort.weight == 0.1
    # Written out or left out, these are the defaults.
    ignored = ("name", "env", "evaluation")
    assert first_difference(config, TrainingConfig(), ignore=ignored) is None


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("ppo.n_stepz=3", r"^ppo\.n_stepz: got an unknown key, .*did you mean 'ppo\.n_steps'\?"),
        (
            "ppo.learning_rate=x",
            r"^ppo\.learning_rate: got 'x', expected a number, or initial, fin",
        ),
        ("env.app.options.x=.nan", r"^env\.app\.options\.x: got nan, expected"),
        ("ppo.n_envs=100000000", r"^ppo\.n_envs: got 100000000, expected less than or equal to"),
        ("ppo.n_steps=abc", r"^ppo\.n_steps: got 'abc', expected a whole number$"),
        ("ppo.gamma=1.5", r"^ppo\.gamma: got 1\.5, expected less than or equal to 1"),
        ("ppo.batch_size=7", r"^ppo\.batch_size: got 7, expected a divisor of .* 40000"),
        ("policy.scale_proprioception=x", r"_proprioception: got 'x', expected true or false$"),
        ("env.vision.channels=[green,x]", r"^env\.vision\.channels\.1: got 'x', expected 'red'"),
        ("env.user.effort.model=neurl", r"^env\.user\.effort\.model: got 'neurl', expected"),
        ("env.user.effort.weight=#1", r"^env\.user\.effort\.weight: got '#1', expected a number"),
        ("name", r"^--set: got 'name', expected key=value"),
        ("seed=[", r"^--set: got 'seed=\[', expected a value written as in YAML"),
    ],
)
def test_bad_overrides_name_the_key(override: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        load_config("whacamole_constrained", [override])


def test_missing_and_unreadable_files(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"^CONFIG: got 'nope\.yaml', .*whacamole_constrained"):
        load_config("nope.yaml")
    file = tmp_path / "a.yaml"
    file.write_text("a: [1")
    with pytest.raises(InputError, match=r"a\.yaml, line 1: got text that is not YAML \(expected"):
        load_config(file)
    file.write_text("# nothing yet\n")
    with pytest.raises(InputError, match=r"a\.yaml: got an empty file, expected a configuration"):
        load_config(file)
    bomb = "\n".join(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, 10))
    file.write_text(f"a0: &a0 [x]\n{bomb}\nname: *a9\n")
    with pytest.raises(InputError, match=r"a\.yaml, line 6: got more than 20,000 values"):
        load_config(file)


@pytest.mark.parametrize(
    ("override", "value"),
    [
        ("env.app.transport_options.enter=#go", "#go"),  # YAML: a comment
        ("env.app.transport_options.enter=[data-vr]", "[data-vr]"),
        ("env.app.options.adaptive=no", False),
        ("env.app.options.life_seconds=0.5", 0.5),
        ("env.app.page=a: b #1.html", "a: b #1.html"),
        ("env.app.connect=null", None),
        ("env.app.renderer=null", "null"),  # the name of one
        ("env.user.noise.constant=null", None),
        ("env.app.task={rules: 1}", {"rules": 1}),
        ("env.app.arguments=[-a, b]", ["-a", "b"]),
        ("name=2024", "2024"),
        ("env.user.torso=yes", True),
    ],
)
def test_a_value_is_what_its_key_is_declared_to_hold(override: str, value: object) -> None:
    node = apply_overrides({}, [override])
    for key in override.partition("=")[0].split("."):
        node = node[key]
    assert (node, type(node)) == (value, type(value))


def write(file: Path, text: str) -> Path:
    file.write_text(text)
    return file


def test_a_configuration_extends_another(tmp_path: Path) -> None:
    """Mappings are merged key by key, lists and values are replaced, overrides come last."""
    write(
        tmp_path / "base.yaml",
        "{extends: whacamole_constrained, seed: 5, ppo: {gamma: 0.9, n_epochs: 3}}",
    )
    senses = "[{sense: vision}]"
    text = f"{{extends: base, name: mine, ppo: {{n_epochs: 4}}, env: {{senses: {senses}}}}}"
    config = load_config(write(tmp_path / "mine.yaml", text), ["ppo.gamma=0.8"])
    told = ["name=mine", "seed=5", "ppo.gamma=0.8", "ppo.n_epochs=4", f"env.senses={senses}"]
    assert config == load_config("whacamole_constrained", told)
    assert "extends" not in to_yaml(config)
    assert parse_config(yaml.safe_load(to_yaml(config))) == config


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ({"0": "extends: '0'"}, "0.yaml: extends: got '0', expected a configuration that does not"),
        ({"0": "extends: b", "b": "extends: 0.yaml"}, "b.yaml: extends: got '0.yaml', expected a"),
        ({"0": "extends: nobody"}, "0.yaml: extends: got 'nobody', expected a configuration file"),
        (
            {str(k): f"extends: '{k + 1}'" for k in range(20)},
            "7.yaml: extends: got '8', expected a chain of at most 8 configurations",
        ),
    ],
)
def test_what_cannot_be_extended_is_refused(
    files: dict[str, str], message: str, tmp_path: Path
) -> None:
    for name, text in files.items():
        write(tmp_path / f"{name}.yaml", text)
    with pytest.raises(InputError, match=re.escape(message)):
        load_config(tmp_path / "0.yaml")


@pytest.mark.parametrize(
    ("game", "option", "written", "expected"),
    [
        *(("beats", "end_on_miss", word, False) for word in ("no", "off")),
        *(("whacamole", "sparse", word, True) for word in ("YES", "on")),
        *(("beats", "level", word, word) for word in ("no", "'no'")),
    ],
)
def test_yes_and_no_are_what_the_game_declares(
    game: str, option: str, written: str, expected: object
) -> None:
    overrides = [f"env.app.options.{option}={written}", f"env.app.game={game}"]
    options = apply_overrides({}, overrides)["env"]["app"]["options"]
    assert options == {option: expected if written != "'no'" else "no"}


def test_settings_of_a_game_s_model_are_checked() -> None:
    message = r"^teacher\.imagined\.game\.dwell: got an unknown key, .*game\.dwell_cost'\?"
    with pytest.raises(InputError, match=message):
        load_config("whacamole_constrained_distill", ["teacher.imagined.game.dwell=1"])
