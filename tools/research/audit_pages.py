#!/usr/bin/env python3
"""Count which interactive things of public pages the audit finds and operates; print a table.

The things are listed by hand in audit_pages.yaml; npm has the pages. Names of things that were not
operated follow, with the audit's own observations.

    python tools/research/audit_pages.py [--folder FOLDER] [--only WORD] [--held-out]
"""

import argparse
import resource
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sim2vr_harness.audit.pages import FoundThing, find_things
from sim2vr_harness.base.files import read_yaml
from sim2vr_harness.client import APP_FAILURES, AppRefused
from sim2vr_harness.client.webxr.packages import package_of
from sim2vr_harness.client.webxr.vendor import packages_behind, read_map, vendor
from sim2vr_harness.envs.config import AppConfig, EnvConfig

LIST = Path(__file__).with_suffix(".yaml")
ROOT = Path(__file__).parents[2]
CDN = "https://cdn.jsdelivr.net/npm/"
HANDS = "https://cdn.aframe.io/controllers/"
MODELS = [
    *(f"{HANDS}hands/{side}HandLow.glb" for side in ("left", "right")),
    *(f"{HANDS}oculus/oculus-touch-controller-gen2-{side}.gltf" for side in ("left", "right")),
]
"""Models of hands and controllers, which npm has not: a cube of 10 cm stands in for each."""
PATIENT: dict[str, Any] = {"timeout_s": 120.0, "start_timeout_s": 300.0}
ENGINES = ("three@0.187.0", "aframe@1.8.0", "babylonjs@9.34.0")


def environment(row: Mapping[str, Any], folder: Path) -> EnvConfig:
    """Fetch what a page needs, and return it as an app."""
    files: Mapping[str, list[str]] = row.get("files", {})
    addresses = [row["page"], *row.get("loads", [])]
    addresses = [one for one in addresses if "://" in one]
    addresses += [CDN + part for parts in files.values() for part in parts]
    if "://" not in row["page"]:
        addresses += [f"{CDN}{each}/package.json" for each in ENGINES]
    found, without = packages_behind(addresses)
    without += vendor(found, folder)
    if without:
        raise AppRefused(f"{without[0].address}: {without[0].why}")
    mapped = read_map(folder / "map.json")
    for number, (address, parts) in enumerate(files.items()):
        joined = folder / f"{row['name'].replace(' ', '_').replace('/', '_')}_{number}.js"
        joined.write_text(";\n".join(_content(CDN + part, mapped) for part in parts))
        mapped[address] = str(joined)
    mapped |= dict.fromkeys(MODELS, str(LIST.with_name("audit_hand.gltf")))
    page = row["page"] if "://" in row["page"] else str(ROOT / row["page"])
    return EnvConfig(app=AppConfig(transport="webxr", page=page, map=mapped, **PATIENT))


def _content(address: str, mapped: Mapping[str, str]) -> str:
    package = package_of(address)
    assert package is not None
    return (Path(mapped[package.prefix]) / package.path).read_text()


def wanted_names(things: Mapping[str, int]) -> list[str]:
    """Return the names of things as the audit numbers them."""
    return [
        name if number == 1 else f"{name} ({number})"
        for name, count in things.items()
        for number in range(1, count + 1)
    ]


def judge(row: Mapping[str, Any], found: Sequence[FoundThing]) -> tuple[int, int, list[str]]:
    """Return how many of a page's listed things were found, were operated, and what was not."""
    by_name = {each.name: each for each in found}
    names = wanted_names(row["things"])
    missing = [name for name in names if name not in by_name]
    idle = [name for name in names if name in by_name and not by_name[name].reacts]
    notes = [f"not found: {', '.join(missing)}"] if missing else []
    notes += [f"not operated: {', '.join(idle)}"] if idle else []
    others = [name for name in by_name if name not in names]
    notes += [f"not listed: {', '.join(others)}"] if others else []
    return len(names) - len(missing), len(names) - len(missing) - len(idle), notes


def main() -> None:
    """Print a row per page, and all together."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--folder", type=Path, help="keep the packages here")
    parser.add_argument("--only", default="", help="pages whose name has this word")
    parser.add_argument("--held-out", action="store_true", help="the pages that were held out")
    given = parser.parse_args()
    sums = [0, 0, 0]
    print("| page | listed | found | operated | CPU s |\n|---|---|---|---|---|", flush=True)
    with tempfile.TemporaryDirectory() as passing:
        for row in read_yaml(LIST, "a list of pages"):
            if given.only not in row["name"] or row.get("held_out", False) != given.held_out:
                continue
            before = _cpu_s()
            try:
                found = find_things(environment(row, given.folder or Path(passing)))
            except (*APP_FAILURES, AppRefused) as error:
                found = []
                print(error)
            listed = sum(row["things"].values())
            seen, operated, notes = judge(row, found)
            sums = [a + b for a, b in zip(sums, (listed, seen, operated), strict=True)]
            print(f"| {row['name']} | {listed} | {seen} | {operated} | {_cpu_s() - before:.0f} |")
            print(*(f"  {note}" for note in notes), sep="\n", flush=True)
    print(f"| all | {' | '.join(map(str, sums))} | |")


def _cpu_s() -> float:
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


if __name__ == "__main__":
    main()
