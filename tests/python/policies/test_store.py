"""Trained users, packed: what they weigh, what they remember, and where they cannot play."""

import hashlib
import io
import json
import lzma
import re
import shutil
import threading
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch

from sim2vr_harness.base import paths
from sim2vr_harness.base.errors import InputError
from sim2vr_harness.cli.main import main
from sim2vr_harness.client import describe_game
from sim2vr_harness.envs.resolved import ResolvedEnv, contract_hash
from sim2vr_harness.evaluation import packing
from sim2vr_harness.evaluation.evaluate import Request
from sim2vr_harness.evaluation.packing import pack_measured
from sim2vr_harness.policies import store as trained_users
from sim2vr_harness.policies.registry import new_network
from sim2vr_harness.policies.store import find_user, list_cards, open_packed
from sim2vr_harness.runs.config import load_config
from sim2vr_harness.runs.run_folder import RunFolder

CONFIG = load_config(
    "whacamole_constrained", ["env.app.options.round_seconds=1.0", "evaluation.conditions=[easy]"]
)


def weights_of(packed: Path) -> Any:
    content = lzma.decompress((packed / "policy.pt.xz").read_bytes())
    return torch.load(io.BytesIO(content), weights_only=True)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run whose checkpoint holds known weights and nothing else."""
    folder = RunFolder(tmp_path_factory.mktemp("runs") / "run")
    folder.create(CONFIG)
    folder.checkpoint_file(7).write_bytes(b"")
    folder.note(
        stage_seconds={"teacher": 600.0, "student": 90.0, "ppo": 180.0},
        sessions=[
            {"started": "2026-01-01T10:00:00+00:00", "cores": 2, "device": "cpu"},
            {
                "started": "2026-01-01T11:00:00+00:00",
                "ended": "2026-01-01T11:03:00+00:00",
                "cores": 4,
                "device": "cpu",
            },
        ],
    )
    return folder.path


@pytest.fixture(scope="module")
def packed(run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    torch.manual_seed(3)

    def load(path: Path, policy: torch.nn.Module) -> int:
        for parameter in policy.parameters():
            parameter.data.uniform_(-0.02, 0.02)
        return 7

    folder = tmp_path_factory.mktemp("users") / "tester"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(trained_users, "load_policy_weights", load)
        details = {"recipe": "none"}
        pack_measured(run, "tester", folder, conditions=None, episodes=2, details=details)
    return folder


def test_a_packed_user_plays_and_its_card_says_how(packed: Path) -> None:
    card = json.loads((packed / "card.json").read_text())
    assert (card["name"], card["steps"], card["recipe"]) == ("tester", 7, "none")
    assert card["minutes"] == 14.5
    assert card["stage_minutes"] == {"teacher": 10.0, "student": 1.5, "from pixels": 3.0}
    assert (card["seeds"], card["machine"]) == ([1], "4 processor cores, cpu")
    assert card["results"]["easy"]["episodes"] == 2
    assert card["results"]["easy"]["effort"] > 0
    assert card["contract_hash"] == contract_hash(ResolvedEnv(CONFIG.env).contract)
    user = find_user(packed)
    assert user.config == CONFIG
    policy = new_network(user, ResolvedEnv(CONFIG.env).observation_space)
    assert user.load(policy) == 7
    weights = weights_of(packed)
    for key, value in policy.state_dict().items():
        stored = weights[key.replace("pi_features", "features").replace("vf_features", "features")]
        if isinstance(stored, tuple):
            levels, scale = stored
            assert (levels.dtype, levels.abs().amax(1).unique().tolist()) == (torch.int8, [127])
            stored = levels.float() * scale
        else:
            assert stored.dtype == torch.float16
        assert torch.equal(value, stored.float())
    assert (packed / "policy.pt.xz").stat().st_size < 2e6


def test_large_matrices_are_packed_as_bytes_with_a_scale_per_row(tmp_path: Path) -> None:
    """By hand: a row whose largest entry is 1.27 has steps of .01, so .634 is .63; a row of
    zeros stays one; 2^15 entries are large, a row fewer is not."""
    network = torch.nn.Sequential(torch.nn.Linear(2**13, 4), torch.nn.Linear(2**13, 3))
    large, small = (layer.weight.data.zero_() for layer in network)
    large[0, :4] = small[0, :4] = torch.tensor([1.27, -0.634, 0.016, 0.004])
    large[2, 5] = -1e-3
    user = trained_users.TrainedUser(tmp_path, CONFIG, {}, tmp_path, lambda policy: 7)
    trained_users.pack(user, network, tmp_path, "tester", {})
    assert (tmp_path / "policy.pt.xz").stat().st_size < 2**15 + 2 * 3 * 2**13 + 5000
    loaded = torch.nn.Sequential(torch.nn.Linear(2**13, 4), torch.nn.Linear(2**13, 3))
    assert open_packed(tmp_path).load(loaded) == 7
    read = loaded[0].weight.detach()
    torch.testing.assert_close(read[0, :4], torch.tensor([1.27, -0.63, 0.02, 0.0]))
    assert read[0, 4:].count_nonzero() == read[1].count_nonzero() == 0
    assert read[2, 5].item() == pytest.approx(-1e-3, rel=1e-6)
    assert torch.equal(loaded[1].weight, small.half().float())


def test_of_several_seeds_the_middle_one_is_packed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    runs = []
    for seed in (1, 2, 3):
        folder = RunFolder(tmp_path / f"run{seed}")
        folder.create(CONFIG.model_copy(update={"seed": seed}))
        folder.checkpoint_file(7).write_bytes(b"")
        folder.note(sessions=[])
        runs.append(str(folder.path))
    other = RunFolder(tmp_path / "other")
    other.create(CONFIG.model_copy(update={"seed": 4, "total_timesteps": 99}))
    other.checkpoint_file(7).write_bytes(b"")

    def measure(folder: Path, request: Request, **more: Any) -> SimpleNamespace:
        rate = {1: 0.9, 2: 0.7, 3: 0.8}[int(folder.name)]
        row = {"hits": 100 * rate, "hit_rate": rate, "cell_hit_rates": [rate] * 9, "episodes": 2}
        return SimpleNamespace(summaries={"easy": row}, facts=describe_game("whacamole"))

    monkeypatch.setattr(trained_users, "load_policy_weights", lambda path, policy: 7)
    monkeypatch.setattr(packing, "evaluate", measure)
    seeds = [f"--other-seed={run}" for run in runs[1:]]
    arguments = ["users", "pack", runs[0], "tester", "--out", str(tmp_path), *seeds]
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 0
    printed = capsys.readouterr().out
    assert "Seed 3 of 1, 2, 3:" in printed
    assert re.search(r"easy +0.80 +80 +2 +0.70-0.90", printed)
    assert open_packed(tmp_path / "tester").config.seed == 3
    card = json.loads((tmp_path / "tester" / "card.json").read_text())
    assert (card["seed"], card["seeds"]) == (3, [1, 2, 3])
    assert [card["seed_results"][str(k)]["easy"]["hit_rate"] for k in (1, 2, 3)] == [0.9, 0.7, 0.8]
    with pytest.raises(SystemExit) as ended:
        main([*arguments, f"--other-seed={other.path}"])
    assert ended.value.code == 2
    assert "total_timesteps: 99" in capsys.readouterr().err


def test_another_environment_is_refused_and_what_differs_is_named(packed: Path) -> None:
    user = open_packed(packed)
    other = CONFIG.env.model_copy(
        update={"vision": CONFIG.env.vision.model_copy(update={"width": 60, "height": 40})}
    )
    with pytest.raises(InputError) as refused:
        trained_users.require_contract(user, ResolvedEnv(other))
    text = str(refused.value)
    assert "image [60, 40]" in text
    assert "image [120, 80]" in text
    assert "muscles" not in text
    card = json.loads((packed / "card.json").read_text())
    card["contract"]["muscles"].pop()
    with pytest.raises(InputError, match="muscles"):
        trained_users.require_contract(
            trained_users.TrainedUser(user.source, user.config, card, packed, user.load),
            ResolvedEnv(CONFIG.env),
        )


def test_damaged_packages_are_named_with_their_file(packed: Path, tmp_path: Path) -> None:
    for name in ("card.json", "config.yaml"):
        (tmp_path / name).write_bytes((packed / name).read_bytes())
    file, whole = tmp_path / "policy.pt.xz", (packed / "policy.pt.xz").read_bytes()
    weights = weights_of(packed)
    (size,) = weights["log_std"].shape
    user = open_packed(tmp_path)
    network = new_network(user, ResolvedEnv(CONFIG.env).observation_space)

    def said(content: bytes) -> str:
        file.write_bytes(content)
        with pytest.raises(InputError, match="expected weights of this network") as error:
            user.load(network)
        assert str(file) in str(error.value)
        return str(error.value)

    assert "damaged" in said(whole[: len(whole) // 2])
    pair = (torch.zeros(size, dtype=torch.int8), torch.ones(1))
    for value, message in (
        (torch.zeros(size).to_sparse(), "log_std: got a tensor of torch.float32 on cpu"),
        (torch.zeros(2, 2), f"log_std: got 2 x 2, expected real numbers of shape {size}"),
        (pair, "log_std: got ("),
        (torch.full((size,), float("nan")), "log_std is not finite"),
    ):
        stream = io.BytesIO()
        torch.save(weights | {"log_std": value}, stream)
        assert message in said(lzma.compress(stream.getvalue(), preset=0))
    (tmp_path / "card.json").write_text("{")
    with pytest.raises(InputError, match=r"card\.json, line 1: got text that is not JSON"):
        open_packed(tmp_path)


def test_weights_never_change_without_their_table_of_results() -> None:
    """A card has its results and the hash of the weights that they are of; all take 12 MB."""
    files = [file for file in paths.trained_users_dir().rglob("*") if file.is_file()]
    assert sum(file.stat().st_size for file in files) <= 12e6
    folders = {file.parent for file in files if file.name == "policy.pt.xz"}
    assert len(folders) == len(list_cards()) >= 8
    for folder in folders:
        card = json.loads((folder / "card.json").read_text())
        digest = hashlib.sha256((folder / "policy.pt.xz").read_bytes()).hexdigest()
        assert card["weights_sha256"] == digest, f"{folder.name}: pack it anew: users pack"
        assert all(row["episodes"] > 0 for row in card["results"].values()) and card["results"]


@pytest.fixture
def more(packed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A place with a user that the package knows by its hashes alone."""
    shutil.copytree(packed, tmp_path / "place" / "tester")
    (tmp_path / "shipped").mkdir()
    files = [
        tmp_path / "place/tester" / name for name in ("card.json", "config.yaml", "policy.pt.xz")
    ]
    hashes = {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in files}
    (tmp_path / "shipped/more.json").write_text(json.dumps({"tester": hashes}))
    monkeypatch.setattr(paths, "trained_users_dir", lambda: tmp_path / "shipped")
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    return tmp_path / "place"


@pytest.mark.parametrize("served", [False, True])
def test_users_are_fetched_from_a_folder_or_an_address(
    more: Path, capsys: pytest.CaptureFixture[str], served: bool
) -> None:
    with pytest.raises(InputError, match=r"tester', who is not here .* users get tester"):
        find_user("pretrained:tester")
    handler = partial(SimpleHTTPRequestHandler, directory=str(more))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        place = f"http://127.0.0.1:{server.server_port}" if served else str(more)
        with pytest.raises(SystemExit) as ended:
            main(["users", "get", "tester", "--from", place])
        assert not ended.value.code
        server.shutdown()
    assert capsys.readouterr().out.startswith("Written: ")
    assert find_user("pretrained:tester").card["name"] == "tester"
    assert [card["name"] for card in list_cards()] == ["tester"]
    folder = find_user("tester").source.parent
    (folder / "config.yaml").write_text("name: other\n")
    with pytest.raises(InputError, match=r"config\.yaml: got a file with SHA-256"):
        find_user("pretrained:tester")


def test_a_file_that_is_another_one_is_refused_and_nothing_is_written(
    more: Path, tmp_path: Path
) -> None:
    (more / "tester" / "policy.pt.xz").write_bytes(b"other")
    for name, place, message in (
        (
            "tester",
            more,
            r"policy\.pt\.xz: got a file with SHA-256 .* of this version",
        ),
        ("tester", tmp_path / "none", "got nothing: there is no such file"),
        ("tester", "http://127.0.0.1:1", "refused"),
        ("nobody", more, "NAME: got 'nobody', expected one of tester"),
    ):
        with pytest.raises(InputError, match=message):
            trained_users.fetch_user(name, str(place))
    assert not (tmp_path / "data").exists()
