"""Studies on Ray: a cluster of three nodes on this machine, one of which dies."""

import os
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pool_tasks
import pytest
import ray
from test_pool import task

from sim2vr_harness.base.errors import InputError
from sim2vr_harness.studies.cluster import OnRay, _fetch


@pytest.mark.parametrize(
    ("address", "message"),
    [
        ("nonsense", r"^--ray: got 'nonsense', expected auto, or HOST:PORT of a running Ray"),
        ("127.0.0.1:1", r"^--ray: got '127.0.0.1:1', where no one answers \(connection refused\)"),
    ],
)
def test_a_cluster_that_is_not_there_is_said(address: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message):
        OnRay(tmp_path, address, 1)


@pytest.mark.parametrize("name", ["data/../../b/x", "/etc/x", "..\\x"])
def test_names_of_a_storage_stay_in_their_folder(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Storage:
        """Lists what no storage should."""

        def exists(self, path: str) -> bool:
            return True

        def find(self, path: str) -> list[str]:
            return [f"{path}/cell.json", f"{path}/{name}"]

        def get_file(self, path: str, place: str) -> None:
            Path(place).write_text("{}")

    monkeypatch.setattr("fsspec.core.url_to_fs", lambda url: (Storage(), "bucket/study"))
    folder = tmp_path / "study" / "cells" / "a"
    with pytest.raises(InputError, match=r"^--storage: got 's3://b', which lists the file .*name"):
        _fetch("s3://b", folder, "cell.json")
    assert [file for file in tmp_path.rglob("*") if file.is_file()] == []


@pytest.fixture
def cluster(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Three nodes of one core each, whose workers find what the tests import."""
    from ray.cluster_utils import Cluster

    here = str(Path(pool_tasks.__file__).parent)
    monkeypatch.setenv("PYTHONPATH", f"{here}:{os.environ.get('PYTHONPATH', '')}")
    made = Cluster(initialize_head=True, head_node_args={"num_cpus": 1})
    nodes = [made.add_node(num_cpus=1) for _ in range(2)]
    made.wait_for_nodes()
    try:
        yield made, nodes
    finally:
        ray.shutdown()
        made.shutdown()


@pytest.mark.slow
def test_a_lost_node_s_tasks_run_again_and_results_come_through_a_storage(
    cluster: Any, tmp_path: Path
) -> None:
    made, nodes = cluster
    storage, here = f"file://{tmp_path}/storage", tmp_path / "here"
    with closing(OnRay(here, made.address, 1, storage=storage, work=pool_tasks.folder)) as pool:
        pool.submit(task("a"))
        assert pool.next().error is None
    assert (here / "cells" / "a" / "cell.json").read_text() == "{}"
    assert (here / "cells" / "a" / "data" / "x.csv").read_text() == "1"
    tasks = [task(f"t{i}", "takes a while") for i in range(4)] + [task("c", "fails")]
    with closing(OnRay(tmp_path, made.address, 1, work=pool_tasks.work)) as pool:
        for one in tasks:
            pool.submit(one)
        done = [pool.next()]
        deadline = time.monotonic() + 60.0
        while len(list(tmp_path.glob("*.attempts"))) < 4 and time.monotonic() < deadline:
            time.sleep(0.1)
        made.remove_node(nodes[0], allow_graceful=False)
        done += [pool.next() for _ in tasks[1:]]
    found = {one.task.key: one.error for one in done}
    assert found.pop("c") == "condition: got 'fails', expected another"
    assert found == {f"t{i}": None for i in range(4)}
    assert all((tmp_path / f"t{i}").is_file() for i in range(4))
