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
from sim2vr_harness.training.ppo.ppo import LearningRate

CONFIGS = Path(__file__).parents[3] / "configs"


@pytest.mark.parametrize("adaptive", [False, True])
@pytest.mark.parametrize("group", ["constrained", "unconstrained"])
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


@pytest.mark.parametrize("group", ["constrained", "unconstrained", "adaptive_constrained"])
def test_the_fast_recipe_s_users_live_in_the_reference_s_environment(group: str) -> None:
    fast = load_config(f"whacamole_{group}_distill")
    reference = load_config(f"whacamole_{group}")
    assert fast.recipe == "distill"
    options = {"adaptive": False} | fast.env.app.options
    app = fast.env.app.model_copy(update={"options": options})
    assert fast.env.model_copy(update={"app": app}) == reference.env
    assert fast.evaluation.conditions == reference.evaluation.conditions
    assert fast.teacher.conditions == reference.evaluation.conditions
    dwell = {"unconstrained": 0.5}.get(group, 0.0)
    assert fast.teacher.imagined.game["dwell_cost"] == dwell


def test_people_learn_both_rules_and_pointing_as_the_same_people() -> None:
    people = load_config("whacamole_people")
    other, pointing = load_config("whacamole_people_unconstrained"), load_config("pointing_people")
    app = {"options": {"condition": "random-easy-medium-unconstrained"}}
    assert other.env.app == people.env.app.model_copy(update=app)
    ending = "-unconstrained"
    for stage in ("teacher", "evaluation"):
        own = getattr(people, stage).conditions
        assert getattr(other, stage).conditions == tuple(name + ending for name in own)
    sizes = ("users", "body_width", "updates", "window_steps", "action_rate_cost")
    for size in sizes:
        assert getattr(other.teacher.imagined, size) == getattr(people.teacher.imagined, size)
    assert other.ppo == people.ppo
    # Who is learned from longer, and tells numbers too, was tried without the rule only.
    more = {"frames": 600_000, "numbers_weight": 0.5}
    assert other.student == people.student.model_copy(update=more)
    assert other.env.model_copy(update={"app": people.env.app}) == people.env
    # Who points has the published wrist still; light hands were made to strike with.
    hands = people.env.user.model_copy(update={"person": pointing.env.user.person})
    there = {"app": people.env.app, "vision": people.env.vision}
    heavy = people.env.model_copy(update={"user": hands})
    assert pointing.env.model_copy(update=there) == heavy
    assert pointing.recipe == "distill"


def test_written_configuration_reads_back_the_same() -> None:
    config = load_config("whacamole_adaptive_unconstrained", ["seed=7", "ppo.n_envs=5"])
    assert parse_config(yaml.safe_load(to_yaml(config))) == config


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("ppo.n_stepz=3", r"^ppo\.n_stepz: got an unknown key, .*did you mean 'ppo\.n_steps'\?"),
        ("n_steps=3", r"^n_steps: got an unknown key, .*did you mean 'ppo\.n_steps'\?"),
        ("sead=3", r"^sead: got an unknown key, .*did you mean 'seed'\?"),
        ("env.user.name=foo", r"^env\.user\.name: .*did you mean 'env\.user\.model'\?"),
        (
            "ppo.learning_rate=x",
            r"^ppo\.learning_rate: got 'x', expected a number, or initial, fin",
        ),
        (
            "ppo.learning_rate.initial=.nan",
            r"^ppo\.learning_rate\.initial: got nan, expected a fin",
        ),
        ("ppo.gamma=.inf", r"^ppo\.gamma: got inf, expected"),
        ("env.app.options.x=.nan", r"^env\.app\.options\.x: got nan, expected"),
        ("ppo.n_envs=100000000", r"^ppo\.n_envs: got 100000000, expected less than or equal to"),
        ("env.app.gam=x", r"^env\.app\.gam: .*did you mean 'env\.app\.game'\?"),
        ("ppo.n_steps=abc", r"^ppo\.n_steps: got 'abc', expected a whole number$"),
        ("ppo.gamma=1.5", r"^ppo\.gamma: got 1\.5, expected less than or equal to 1"),
        ("ppo=3", r"^ppo: got 3, expected a mapping"),
        ("ppo.batch_size=7", r"^ppo\.batch_size: got 7, expected a divisor of .* 40000"),
        ("ppo.n_steps=2.5", r"^ppo\.n_steps: got 2.5, expected a whole number$"),
        ("ppo.gamma=x", r"^ppo\.gamma: got 'x', expected a number$"),
        ("policy.scale_proprioception=x", r"_proprioception: got 'x', expected true or false$"),
        ("policy.net_arch=[1,x]", r"^policy\.net_arch\.1: got 'x', expected a whole number$"),
        (
            "policy.vision_precision=half",
            r"^policy\.vision_precision: got 'half', expected 'float32'",
        ),
        ("env.vision.channels=[green,x]", r"^env\.vision\.channels\.1: got 'x', expected 'red'"),
        ("env.user.effort.model=neurl", r"^env\.user\.effort\.model: got 'neurl', expected"),
        ("name", r"^--set: got 'name', expected key=value"),
        ("name.x=1", r"^--set name\.x: got a key inside name"),
        ("seed=[", r"^--set: got 'seed=\[', expected a value written as in YAML"),
    ],
)
def test_bad_overrides_name_the_key(override: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        load_config("whacamole_constrained", [override])


def test_overrides_are_typed_and_leave_the_file_alone() -> None:
    tree = {"ppo": {"n_envs": 2}}
    changed = apply_overrides(
        tree, ["ppo.learning_rate.initial=1e-4", "env.app.options.condition=easy", "seed=4"]
    )
    assert tree == {"ppo": {"n_envs": 2}}
    config = parse_config(changed | {"ppo": changed["ppo"] | {"batch_size": 100}})
    assert config.ppo.learning_rate.initial == 1e-4
    assert config.env.app.options["condition"] == "easy"
    assert config.seed == 4


def test_missing_and_unreadable_files(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"^CONFIG: got 'nope\.yaml', .*whacamole_constrained"):
        load_config("nope.yaml")
    file = tmp_path / "a.yaml"
    file.write_text("a: [1")
    with pytest.raises(InputError, match=r"a\.yaml, line 1: got text that is not YAML \(expected"):
        load_config(file)
    file.write_text("- 1")
    with pytest.raises(
        InputError, match=r"a\.yaml: got YAML of \[1\], expected a configuration in YAML, a mapping"
    ):
        load_config(file)
    file.write_text("# nothing yet\n")
    with pytest.raises(InputError, match=r"a\.yaml: got an empty file, expected a configuration"):
        load_config(file)
    bomb = "\n".join(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, 10))
    file.write_text(f"a0: &a0 [x]\n{bomb}\nname: *a9\n")
    with pytest.raises(InputError, match=r"a\.yaml, line 6: got more than 20,000 values"):
        load_config(file)


def test_first_difference_names_the_key() -> None:
    one = load_config("whacamole_constrained")
    other = load_config("whacamole_constrained", ["ppo.learning_rate.final=0.0"])
    assert first_difference(one, other) == ("ppo.learning_rate.final", 1e-7, 0.0)
    assert first_difference(one, other, ignore=["ppo"]) is None


def test_a_plain_number_is_a_constant_rate() -> None:
    rate = load_config("whacamole_constrained", ["ppo.learning_rate=0.0003"]).ppo.learning_rate
    assert (rate.initial, rate.final) == (3e-4, 3e-4)
    assert [LearningRate(rate)(left) for left in (1.0, 0.5, 0.0)] == [3e-4] * 3


@pytest.mark.parametrize(
    ("override", "message"),
    [
        (
            "dwell=1",
            r"^teacher\.imagined\.game\.dwell: got an unknown key, .*game\.dwell_cost'\?",
        ),
        (
            "dwell_cost=-1",
            r"^teacher\.imagined\.game\.dwell_cost: got -1, expected greater than or equal",
        ),
        (
            "speed_mps=1",
            r"^teacher\.imagined\.game\.speed_mps: got an unknown key",
        ),
    ],
)
def test_settings_of_a_game_s_model_are_checked(override: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        load_config("whacamole_constrained_distill", [f"teacher.imagined.game.{override}"])


@pytest.mark.parametrize(
    ("override", "value"),
    [
        ("env.app.transport_options.enter=#go", "#go"),  # YAML: a comment
        ("env.app.transport_options.enter=no", "no"),  # YAML: false
        ("env.app.transport_options.enter=[data-vr]", "[data-vr]"),
        ("env.app.transport_options.enter='#go'", "#go"),
        ("env.app.options.title=#go", "#go"),
        ("env.app.options.adaptive=no", False),
        ("env.app.options.life_seconds=0.5", 0.5),
        ("env.app.options.place=[0, 1]", [0, 1]),
        ("env.app.page=a: b #1.html", "a: b #1.html"),
        ("env.app.connect=null", None),
        ("env.app.connect=#1", "#1"),
        ("env.app.renderer=null", "null"),  # the name of one
        ("env.user.noise.constant=null", None),
        ("env.app.task={rules: 1}", {"rules": 1}),
        ("env.app.task=task.yaml", "task.yaml"),
        ("env.app.arguments=[-a, b]", ["-a", "b"]),
        ("name=2024", "2024"),
        ("ppo.n_envs=4", 4),
        ("env.user.torso=yes", True),
    ],
)
def test_a_value_is_what_its_key_is_declared_to_hold(override: str, value: object) -> None:
    node = apply_overrides({}, [override])
    for key in override.partition("=")[0].split("."):
        node = node[key]
    assert (node, type(node)) == (value, type(value))


def test_a_number_is_not_nothing_because_of_a_comment() -> None:
    with pytest.raises(InputError, match=r"^env.user.effort.weight: got '#1', expected a number"):
        load_config("whacamole_constrained", ["env.user.effort.weight=#1"])


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


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ({"0": "extends: '0'"}, "0.yaml: extends: got '0', expected a configuration that does not"),
        ({"0": "extends: b", "b": "extends: 0.yaml"}, "b.yaml: extends: got '0.yaml', expected a"),
        ({"0": "extends: nobody"}, "0.yaml: extends: got 'nobody', expected a configuration file"),
        ({"0": "extends: [a]"}, "0.yaml: extends: got"),
        ({"0": "extends: b", "b": "[1]"}, "b.yaml: got YAML of"),
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
        *(("beats", "end_on_miss", word, False) for word in ("no", "No", "off", "false")),
        *(("whacamole", "sparse", word, True) for word in ("yes", "YES", "on", "true")),
        *(("beats", "level", word, word) for word in ("no", "Yes", "off", "'no'")),
    ],
)
def test_yes_and_no_are_what_the_game_declares(
    game: str, option: str, written: str, expected: object
) -> None:
    overrides = [f"env.app.options.{option}={written}", f"env.app.game={game}"]
    options = apply_overrides({}, overrides)["env"]["app"]["options"]
    assert options == {option: expected if written != "'no'" else "no"}


def test_other_options_of_a_game_are_left_to_it() -> None:
    overrides = ["env.app.game=whacamole", "env.app.options.spawn_times=no"]
    assert apply_overrides({}, overrides)["env"]["app"]["options"] == {"spawn_times": False}


@pytest.mark.parametrize("app", ["env.app.page=a.html", "env.app.game=golf"])
def test_yes_and_no_of_games_that_do_not_say(app: str) -> None:
    with pytest.raises(InputError) as refused:
        apply_overrides({}, [app, "env.app.options.mirror=no"])
    assert str(refused.value) == (
        "--set: got 'env.app.options.mirror=no', a truth or a word, expected true or false, or "
        "text in quotes, such as mirror=\"'no'\""
    )
    said = apply_overrides({}, [app, "env.app.options.mirror=false"])["env"]["app"]["options"]
    assert said == {"mirror": False}
