from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.base.notices import set_notice
from sim2vr_harness.runs.config import (
    TrainingConfig,
    apply_overrides,
    first_difference,
    load_config,
    parse_config,
    to_yaml,
)
from sim2vr_harness.runs.migration import changed_constant, renamed
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
            r"^teacher\.imagined\.game\.speed_mps: got 1, expected it left out: it is 0\.3 in all",
        ),
    ],
)
def test_settings_of_a_game_s_model_are_checked(override: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        load_config("whacamole_constrained_distill", [f"teacher.imagined.game.{override}"])


def test_recorded_configurations_are_read_with_today_s_keys() -> None:
    recorded = {
        "recipe": "distill",
        "env": {"threads": 2},
        "ppo": {"value_warmup_iterations": 3},
        "teacher": {
            "coarse_physics_s": 0.005,
            "imagination": {"cycles": 12, "stuck_cost": 0.5},
            "aids": {
                "near_starts": {"start": 0.5, "end": 0.3, "from_step": 0, "to_step": 9},
                "near_start_m": 0.1,
                "progress": {"start": 0.0, "end": 0.0},
            },
        },
    }
    with pytest.raises(InputError, match="unknown key"):
        parse_config(recorded)
    config = parse_config(renamed(recorded))
    assert config.env.cores == 2
    assert config.ppo.critic_first_updates == 3
    teacher = config.teacher
    assert (teacher.imagined.cycles, teacher.imagined.game["dwell_cost"]) == (12, 0.5)
    assert teacher.curriculum.near_starts == 0.3
    assert changed_constant(recorded) == ("teacher.curriculum.near_start_m", 0.1, 0.08)
    assert renamed(recorded["env"]) == {"threads": 2}, "only where the key is"
    assert "imagination" in recorded["teacher"], "the recorded one is left as it is"  # type: ignore[operator]


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


OLD_NAMES = {
    "skills": {"user": "decider", "practice": {"cycles": 3}, "looking": {"users": 5}},
    "policy": {"glimpses": None},
    "teacher": {
        "recognition_steps": 2,
        "imagined": {
            "growing_lag_cycles": 1,
            "carry_cost": 0.5,
            "rest_cost": 0.25,
            "game": {"stuck_cost": 0.125, "impact_share": 0.75},
        },
    },
}
NEW_NAMES = {
    "skills": {
        "user": "hierarchical",
        "motor_training": {"cycles": 3},
        "q_learning": {"users": 5},
    },
    "policy": {"attention_crops": None},
    "teacher": {
        "recognition_latency_steps": 2,
        "imagined": {
            "delay_ramp_cycles": 1,
            "movement_cost": 0.5,
            "activation_cost": 0.25,
            "game": {"dwell_cost": 0.125, "impact_speed_weight": 0.75},
        },
    },
}


@pytest.fixture
def notices() -> Iterator[list[str]]:
    said: list[str] = []
    set_notice(said.append)
    yield said
    set_notice(None)


def test_old_names_are_read_with_a_warning_where_a_user_writes_them(notices: list[str]) -> None:
    assert parse_config(renamed(OLD_NAMES)) == parse_config(NEW_NAMES)
    assert notices == []
    assert parse_config(OLD_NAMES) == parse_config(NEW_NAMES)
    assert len(notices) == 10
    warning = (
        "skills.looking is now called skills.q_learning: the old name works in this version only."
    )
    assert warning in notices


def test_the_last_of_an_old_and_a_new_name_counts(notices: list[str]) -> None:
    tree = {"skills": {"looking": {"users": 5, "user_steps": 7}}}
    for name in ("looking", "q_learning"):
        config = parse_config(apply_overrides(tree, [f"skills.{name}.users=6"]))
        assert (config.skills.q_learning.users, config.skills.q_learning.user_steps) == (6, 7)
    assert "skills.looking.users is now called skills.q_learning.users: the old" in notices[1]
    tree = {"skills": {"q_learning": {"users": 5}}}
    assert (
        parse_config(apply_overrides(tree, ["skills.looking.users=6"])).skills.q_learning.users == 6
    )


def test_a_constant_under_its_old_name() -> None:
    recorded = {"skills": {"practice": {"aim_cost": 0.2}}}
    key = "skills.motor_training.actuator_range_cost"
    assert changed_constant(recorded) == (key, 0.2, 0.1)
    assert parse_config(renamed(recorded)) == parse_config({})
    with pytest.raises(InputError, match=f"^{key}: got 0.2, expected it left out: it is 0.1"):
        parse_config(recorded)


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


def test_old_names_do_not_count_more_than_new_ones_of_what_extends(tmp_path: Path) -> None:
    write(tmp_path / "old.yaml", "skills: {looking: {users: 3, user_steps: 50}}")
    file = write(tmp_path / "new.yaml", "{extends: old.yaml, skills: {q_learning: {users: 4}}}")
    found = load_config(file).skills.q_learning
    assert (found.users, found.user_steps) == (4, 50)


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


@pytest.mark.parametrize("wrong", [{"skills": 3}, {"skills": {"practice": 3, "motor_training": 4}}])
def test_wrong_shapes_with_old_names_are_refused_in_a_sentence(wrong: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=r"^skills.*a mapping of keys to values"):
        parse_config(wrong)


def test_keys_that_became_constants() -> None:
    """Recorded ones load; user-written ones are taken with the constant's value only."""
    teacher = {"imagined": {"lam": 0.8}, "start": None}
    recorded = {"teacher": teacher}
    assert parse_config(renamed(recorded)) == parse_config({})
    assert changed_constant(recorded) == ("teacher.imagined.lam", 0.8, 0.9)
    assert changed_constant({"student": {"noisy_users": 0.25}}) is None
    assert parse_config({"student": {"noisy_users": 0.25}}) == parse_config({})
    game = {"speed_mps": 0.5}  # of Beats; Whac-A-Mole's is 0.3
    recorded = {"env": {"app": {"game": "beats"}}, "teacher": {"imagined": {"game": game}}}
    assert changed_constant(recorded) is None
    assert "speed_mps" not in renamed(recorded)["teacher"]["imagined"]["game"]
    del recorded["env"]
    assert changed_constant(recorded) == ("teacher.imagined.game.speed_mps", 0.5, 0.3)
    with pytest.raises(InputError) as caught:
        load_config("whacamole_constrained_distill", ["teacher.imagined.lam=0.8"])
    expected = "teacher.imagined.lam: got 0.8, expected it left out: it is 0.9 in all trainings now"
    assert str(caught.value) == expected


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


def test_shaping_stands_for_keys_of_before() -> None:
    """All its values together are the shaping; any other mixture is refused."""
    keys = {
        "busy_starts": 0.6,
        "angle_deg": 50.0,
        "near_reward": 40.0,
        "hazard_cost": 200.0,
        "look_cost": 20.0,
        "wall_cost": 40.0,
        "early_error_cost": 1.0,
    }

    def beats(**game: object) -> dict[str, Any]:
        app = {"app": {"game": "beats"}}
        return {"recipe": "distill", "env": app, "teacher": {"imagined": {"game": game}}}

    whole = parse_config(beats(**keys))
    assert (
        whole == parse_config(renamed(beats(**keys))) == parse_config(beats(shaping="whole_levels"))
    )
    assert whole.teacher.imagined.game == {"shaping": "whole_levels", "stroke_reward": 0.0}
    assert changed_constant(beats(**keys)) is None
    plain = {"busy_starts": 0.9, "hazard_cost": 0.0}
    assert parse_config(beats(**plain)).teacher.imagined.game["shaping"] == "none"
    mixed = beats(**{**keys, "wall_cost": 0.0})
    assert changed_constant(mixed) == ("teacher.imagined.game.busy_starts", 0.6, 0.9)
    with pytest.raises(InputError, match=r"busy_starts: got 0.6, .* it is 0.9 with shaping: none"):
        parse_config(mixed)
    with pytest.raises(InputError, match=r"look_cost: got 0.0, .* 20.0 with shaping: whole_levels"):
        parse_config(beats(shaping="whole_levels", look_cost=0.0))
