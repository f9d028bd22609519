"""What reward terms come to, against numbers worked out by hand."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.cli.main import main
from sim2vr_harness.envs.config import EffortConfig
from sim2vr_harness.games.registry import reward_terms
from sim2vr_harness.games.rewards import Formula, RewardTerms, Term
from sim2vr_harness.tools.rewards.contributions import Contributions, contributions
from sim2vr_harness.tools.rewards.description import read_terms
from sim2vr_harness.tools.rewards.files import write
from sim2vr_harness.tools.rewards.warnings import warnings_of
from sim2vr_harness.users import Body, load_body


@pytest.fixture(scope="module")
def body() -> Body:
    return load_body("mobl_arms_wrist", appearance=False)


def worked_out(body: Body, reward: RewardTerms, **effort: object) -> Contributions:
    return contributions(reward, EffortConfig(**effort), body)


def term(name: str, when: str, value: str | float) -> Term:
    return Term(name, when, Formula(value))


def test_whacamole_by_hand(body: Body) -> None:
    reward = reward_terms("whacamole", {"condition": "medium"})
    found = worked_out(body, reward)
    assert len(found.times_s) == 20
    # Never nearer than 0.5 m: 20 steps of (exp(-5) - 1) / 10.
    assert found.total("worst") == pytest.approx(2.0 * (np.exp(-5.0) - 1.0))
    # Linear: 2.5 cm a step, at most 2.5 cm away after 19 of 20; 0.5 m/s is too slow for a hit, and
    # the bonus for the slow touch is 2 * 0.5 / 0.8. Before that 18 steps at 0.475 ... 0.05 m.
    x = 0.5 - 0.025 * np.arange(1, 19)
    assert found.total("linear", "hits") == 0.0
    assert found.total("linear", "slow contacts") == pytest.approx(1.25)
    assert found.total("linear", "target closeness") == pytest.approx(
        ((np.exp(-10.0 * x) - 1.0) / 10.0).sum()
    )
    # Quadratic: 0.5 (1 - k/20)^2 <= 0.025 from k = 16 on (0.02 m): 0.0075 m / 0.05 s before it.
    speed = 0.5 * ((5 / 20) ** 2 - (4 / 20) ** 2) / 0.05
    assert found.total("quadratic", "slow contacts") == pytest.approx(2.0 * speed / 0.8)
    assert found.terms["quadratic"]["slow contacts"].nonzero()[0].tolist() == [15]
    # There at once, at 2 m/s: the hit, and nothing else.
    assert found.total("best") == 10.0
    free = reward_terms("whacamole", {"condition": "medium-unconstrained"})
    assert worked_out(body, free).total("linear", "hits") == 10.0
    paper = worked_out(body, reward_terms("whacamole", {"reward": "paper"}))
    assert paper.total("worst") == pytest.approx(20.0 * (np.exp(-5.0) - 1.0))
    assert paper.total("linear", "slow contacts") == pytest.approx(-1.25)


def test_beats_and_pointing_by_hand(body: Body) -> None:
    found = worked_out(body, reward_terms("beats", {}))
    # 0.8 m in a second: 125 + 75 (0.8 - 0.5) / 4.5 = 130; quadratic ends at 0.04 m/s: no cut.
    assert found.total("linear") == pytest.approx(130.0)
    assert found.total("quadratic") == 0.0
    assert found.total("best") == pytest.approx(125.0 + 75.0 * 1.5 / 4.5)
    shaped = reward_terms("beats", {"reward": "shaped", "miss_penalty": 30.0})
    found = worked_out(body, shaped)
    assert found.total("worst", "misses") == -30.0
    assert found.total("linear", "misses") == 0.0
    assert found.total("worst", "blade closeness") == pytest.approx(10.0 * np.exp(-3.2))
    assert worked_out(body, reward_terms("pointing", {})).total("linear", "hits") == 10.0
    with pytest.raises(InputError, match="game: got 'golf'"):
        reward_terms("golf", {})


def test_effort_by_hand(body: Body) -> None:
    reward = RewardTerms("r", (term("a", "step", 1.0),))
    # Neural: weight times the sum of squares of 32 controls, 20 steps.
    found = worked_out(body, reward, model="neural", weight=0.01)
    assert found.cost("full") == pytest.approx(0.01 * 32 * 20)
    assert found.cost("light") == pytest.approx(0.01 * 32 * 0.01 * 20)
    assert found.cost("none") == 0.0
    # The mean of a square of an even draw is 1/3.
    assert found.cost("random") == pytest.approx(0.01 * 32 * 20 / 3, rel=0.1)
    # 3CC-r asks for what is not there yet: |1 - MA| of 32 muscles, MA = 0.5 after the first step
    # (development 10 / s for 50 ms).
    fatigue = worked_out(body, reward, weight=0.1)
    assert fatigue.efforts["full"][0] == pytest.approx(0.1 * np.sqrt(32.0) * 0.5, rel=1e-6)
    assert worked_out(body, reward, model="zero").cost("full") == 0.0


@pytest.mark.parametrize(
    ("terms", "effort", "said"),
    [
        ([("hit", "arrival", 100), ("near", "step", "-x / 10")], {}, "'near' drowns: .* 'hit'"),
        ([("hit", "arrival", 9), ("near", "step", "exp(-50 * x)")], {}, "'near' vanishes beyond"),
        ([("gone", "step", 0.0), ("hit", "arrival", 1)], {}, "'gone' vanishes: it is the same"),
        ([("hit", "arrival", "1 if v > 1.5 else 0")], {}, "'hit' is paid to neither a linear"),
        ([("far", "step", "x")], {}, "A linear approach earns .* no more than staying away"),
        ([("hit", "arrival", 1)], {"model": "neural", "weight": 1e-5}, "Effort drowns: even full"),
        ([("hit", "arrival", 1)], {"model": "neural", "weight": 1.0}, "Doing nothing pays: .*"),
        ([("hit", "arrival", 1)], {"model": "zero"}, "Effort costs nothing"),
        ([("hit", "arrival", 1), ("near", "step", "1 - x")], {}, "Lingering pays: .* 18.5 in"),
    ],
)  # fmt: skip
def test_warnings(body: Body, terms: list, effort: dict, said: str) -> None:
    reward = RewardTerms("r", tuple(term(*each) for each in terms))
    told = warnings_of(worked_out(body, reward, **effort))

    assert any(re.search(said, line) for line in told), told


def test_a_sound_reward_has_no_warning(body: Body) -> None:
    reward = RewardTerms("r", (term("hit", "arrival", 10), term("near", "step", "-x")))
    assert warnings_of(worked_out(body, reward, model="neural", weight=0.003)) == []


def test_formulas() -> None:
    assert Formula("max(0, 1 - x) ** 2 + (1 if v >= 0.5 else -dt) / 2")(
        x=0.5, v=0.0, t=0.0, dt=0.1
    ) == pytest.approx(0.2)
    for text in ("__import__('os')", "x.real", "[1]", "y + 1", "exp()", "1 +", "True", "x if",
                 "exp(x, key=1)", "(" * 400, "lambda: 1", "9 ** 9 ** 9 ** 9"):  # fmt: skip
        with pytest.raises(InputError, match=r"^terms\.0\.value: got "):
            Formula(text, "terms.0.value")(x=1.0, v=0.0, t=0.0, dt=0.05)
    with pytest.raises(InputError, match="has no value at"):
        Formula("1 / (x - 1)")(x=1.0, v=0.0, t=0.0, dt=0.05)


def test_terms_of_one_s_own(tmp_path: Path) -> None:
    file = tmp_path / "own.yaml"
    file.write_text(
        "name: cup\nseconds: 2\nterms:\n- {name: grasp, when: arrival, value: 3}\n"
        "- {name: near, value: -x}\n"
    )
    reward = read_terms(file)
    assert (reward.name, reward.seconds) == ("cup", 2.0)
    assert [(each.name, each.when) for each in reward.terms] == [
        ("grasp", "arrival"),
        ("near", "step"),
    ]
    for text, message in (
        ("terms: []", "^terms"),
        ("- 1", "expected a mapping"),
        ("terms: [{name: a, when: never, value: 1}]", "when"),
        ("terms: [{name: a, value: z}]", r"^terms\.0\.value: got 'z'"),
        ("terms: [{name: a, value: 1}, {name: a, value: 1}]", "^terms: got a name twice"),
        ("start_m: 0.1\nreached_m: 0.2\nterms: [{name: a, value: 1}]", "^reached_m: got 0.2"),
        ("terms: [{name: a, vlaue: 1}]", "did you mean"),
    ):
        file.write_text(text)
        with pytest.raises(InputError, match=message):
            read_terms(file)


def test_files(body: Body, tmp_path: Path) -> None:
    pytest.importorskip("plotly")
    found = worked_out(body, reward_terms("whacamole", {}))
    files = write(found, ["one <two>"], tmp_path)
    assert [file.name for file in files] == ["rewards.csv", "rewards.html", "rewards.png"]
    rows = (tmp_path / "rewards.csv").read_text().splitlines()
    assert len(rows) == 1 + 4 * 20
    assert "one &lt;two>" in (tmp_path / "rewards.html").read_text()


def test_a_trained_user_in_another_game_is_refused(
    trained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for option in (["--game", "beats"], ["--set", "env.app.game=beats"]):
        with pytest.raises(SystemExit) as left:
            main(["rewards", str(trained), *option, "--out", str(tmp_path / "out")])
        assert left.value.code == 2
        told = capsys.readouterr().err.strip().splitlines()
        assert told == [
            f"error: --game: got 'beats' for {trained}, which was trained for 'whacamole', "
            "expected 'whacamole', or a body instead of the user"
        ]
    assert not (tmp_path / "out").exists()
    with pytest.raises(SystemExit) as left:
        main(["rewards", "mobl_arms_wrist", "--game", "beats", "--out", str(tmp_path / "body")])
    assert not left.value.code
    assert (tmp_path / "body" / "rewards.csv").is_file()
