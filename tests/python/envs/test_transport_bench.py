"""The benchmark of the transports: all in one run, and they play the same round."""

from __future__ import annotations

import json
from typing import Any

import pytest

from sim2vr_harness.cli.main import main
from sim2vr_harness.envs import AppConfig, EnvConfig
from sim2vr_harness.envs.transport_bench import transport_bench


def test_all_transports_in_one_run(capsys: Any) -> None:
    with pytest.raises(SystemExit) as exit_:
        main(["bench", "--transport", "all", "--seconds", "0.2", "--json"])
    assert exit_.value.code == 0
    values = json.loads(capsys.readouterr().out)
    assert list(values["exchanges_per_s"]) == ["in_process", "protocol1", "protocol2"]
    for rates in values["exchanges_per_s"].values():
        assert rates["image"] > 0.0
        assert rates["null"] > 0.0
    assert all(rate > 0.0 for rate in values["env_steps_per_s"].values())
    rates = values["exchanges_per_s"]
    assert values["ratios"]["protocol2_to_protocol1_null"] == pytest.approx(
        rates["protocol2"]["null"] / rates["protocol1"]["null"], abs=1e-3
    )
    assert set(values["ratios"]) == {
        f"protocol2_to_{other}_{kind}"
        for other in ("in_process", "protocol1")
        for kind in ("image", "null")
    }
    assert values["renderer"]["null"] == "null renderer: no pictures"


def test_the_round_does_not_depend_on_how_it_is_measured() -> None:
    config = EnvConfig(app=AppConfig(renderer="null"))
    one = transport_bench(config, ["in_process"], seconds=0.05)
    two = transport_bench(config, ["protocol2"], n=3, seconds=0.05)
    assert one["state_hash"] == two["state_hash"]
    assert two["ratios"] == {}
