"""Gives every reader of the Python half files that are damaged on purpose.

Whatever is in a file, a reader ends with its content or with one sentence
(``base.errors.InputError`` or another ``ValueError``), within seconds. Inputs are valid files whose
bytes, tokens, lines and numbers are changed by a random generator; the same seed makes the same
inputs.

    .venv/bin/python tools/attack/fuzz_files.py --seconds 600
    .venv/bin/python tools/attack/fuzz_files.py --seconds 60 --target yaml --seed 7

What broke is written to ``--keep`` (build/fuzz_files), a file per input; the exit status is 1 then.
"""

import argparse
import contextlib
import io
import json
import random
import re
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import torch

from sim2vr_harness.base import files, paths
from sim2vr_harness.base.bounded_yaml import parse_yaml
from sim2vr_harness.cli.errors import report
from sim2vr_harness.cli.main import app
from sim2vr_harness.evaluation.curves import plot
from sim2vr_harness.evaluation.evaluate import EvaluationResults
from sim2vr_harness.policies.store import open_packed
from sim2vr_harness.runs.config import defaults, load_config, to_yaml
from sim2vr_harness.runs.run_folder import RunFolder
from sim2vr_harness.sessions import read_sessions
from sim2vr_harness.users.bodies.description import read_description

SLOW_S = 10.0
"""Longer than any input may take, on a machine that does other things as well."""

NUMBERS = (
    "nan",
    ".nan",
    "inf",
    "-.inf",
    "-1",
    "0",
    "1e-9",
    "1e300",
    "9" * 25,
    "-0.0",
    "0x" + "f" * 40,
)
TOKENS = (
    *(
        b"{",
        b"}",
        b"[",
        b"]",
        b":",
        b",",
        b"- ",
        b"\n",
        b"\r",
        b"\t",
        b"'",
        b'"',
        b"&a ",
        b"*a",
        b"<<: ",
    ),
    *(
        b"null",
        b"true",
        b"!!binary ",
        b"!!set ",
        b"---\n",
        b"? ",
        b"|\n",
        b"#",
        b"%",
        b"\x00",
        b"\xff",
    ),
    *(
        b"\xff\xfe",
        b"\xef\xbb\xbf",
        b"\xc3",
        b"\\ud800",
        b"../",
        b"/dev/zero",
        b"PK\x03\x04",
        b"\x93NUMPY",
    ),
)

_DIGITS = re.compile(r"0x\w+|\d+|'.*'")
"""What makes two of a kind differ in their words."""

Case = Callable[[bytes], None]


class Targets:
    """The readers, each with valid content to begin with.

    Args:
        place: an empty folder.
    """

    def __init__(self, place: Path) -> None:
        self._place = place

    def all(self) -> dict[str, tuple[list[bytes], Case]]:
        """Name -> valid files, and what reads one."""
        config = to_yaml(defaults()).encode()
        shipped = [path.read_bytes() for path in sorted((paths.share_dir() / "configs").glob("*"))]
        bodies = Path(files.__file__).parents[1] / "users" / "data" / "described"
        described = [path.read_bytes() for path in sorted(bodies.glob("*.yaml"))]
        users = sorted(paths.trained_users_dir().glob("whacamole_constrained/card.json"))
        card = users[0].read_bytes()
        return {
            "yaml": ([config, *shipped, *described], lambda b: parse_yaml(_text(b), "f", "YAML")),
            "config": ([config, *shipped], self._config),
            "override": ([b"ppo.n_envs=4", b"env.app.options={a: [1.0]}"], self._override),
            "body": (described, self._body),
            "json": (
                [card, b'{"sessions": []}'],
                lambda b: files.parse_json(b, "f", "JSON") and None,
            ),
            "run": ([config, *shipped], self._run),
            "card": ([card], self._card),
            "results": ([b'{"easy": {"user": "a", "seed": 1, "rounds": []}}'], self._results),
            "curves": (self._curve_rows(), self._curves),
            "arrays": ([_packed_round()], lambda b: files.parse_arrays(b, "f", "arrays") and None),
            "packed": ([_packed_round()], self._packed),
            "manifest": ([_manifest()], self._manifest),
            "states": ([_states()], self._states),
            "events": ([_events()], self._events),
            "tensors": ([_tensors()], lambda b: files.parse_tensors(b, "f", "tensors") and None),
            "arguments": (_commands(), self._arguments),
        }

    def _file(self, name: str, content: bytes) -> Path:
        file = self._place / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content)
        return file

    def _config(self, content: bytes) -> None:
        load_config(self._file("config/some.yaml", content))

    def _override(self, content: bytes) -> None:
        defaults([_text(content)])

    def _body(self, content: bytes) -> None:
        read_description(self._file("body.yaml", content))

    def _run(self, content: bytes) -> None:
        RunFolder(self._file("run/config.yaml", content).parent).load_config()

    def _card(self, content: bytes) -> None:
        self._file("user/config.yaml", to_yaml(defaults()).encode())
        open_packed(self._file("user/card.json", content).parent)

    def _results(self, content: bytes) -> None:
        EvaluationResults(self._file("results/results.json", content).parent)

    @staticmethod
    def _curve_rows() -> list[bytes]:
        rows = [{"step": k, "rollout/ep_rew_mean": 0.5 * k, "train/std": 1.0} for k in range(3)]
        return ["".join(json.dumps(row) + "\n" for row in rows).encode()]

    def _curves(self, content: bytes) -> None:
        self._file("curves/config.yaml", to_yaml(defaults()).encode())
        plot([self._file("curves/metrics.jsonl", content).parent], self._place / "curves.png")

    def _packed(self, content: bytes) -> None:
        self._file("packed/manifest.json", _manifest())
        self._file("packed/one_events.csv", b"t,type,target_id,grid_id,vx,vy,vz\n")
        read_sessions(self._file("packed/one.npz", content))

    def _manifest(self, content: bytes) -> None:
        self._file("manifest/one_events.csv", b"t,type,target_id,grid_id,vx,vy,vz\n")
        self._file("manifest/one.npz", _packed_round())
        read_sessions(self._file("manifest/manifest.json", content).parent)

    def _states(self, content: bytes) -> None:
        self._file("states/events.csv", _events())
        read_sessions(self._file("states/states.csv", content))

    def _events(self, content: bytes) -> None:
        self._file("events/events.csv", content)
        read_sessions(self._file("events/states.csv", _states()).parent)

    def _arguments(self, content: bytes) -> None:
        words = [word.replace("PLACE", str(self._place)) for word in _text(content).split("\x1f")]
        words = [word.replace("\x00", "") for word in words]
        out, err = io.StringIO(), io.StringIO()
        silent = contextlib.redirect_stdout(out), contextlib.redirect_stderr(err)
        with silent[0], silent[1], contextlib.chdir(self._place):
            status = report(lambda: app(words, prog_name="p", standalone_mode=False), words)
        said = err.getvalue()
        if status not in (0, 2) or said.count("\n") > 1 or "Traceback" in said:
            raise AssertionError(f"exit {status}: {said[:300]}")


def _text(content: bytes) -> str:
    return content.decode("utf-8", errors="replace")


def _tensors() -> bytes:
    stream = io.BytesIO()
    torch.save({"weight": torch.arange(6.0).reshape(2, 3), "steps": 3}, stream)
    return stream.getvalue()


def _packed_round() -> bytes:
    stream = io.BytesIO()
    pose = np.tile([0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0], (4, 1))
    np.savez(stream, t=np.arange(4) * 0.05, head=pose, right=pose)
    return stream.getvalue()


def _manifest() -> bytes:
    trial = {"file": "one", "condition": "easy", "seed": 3, "fixed_timestep": 0.002}
    return json.dumps({"trials": [trial]}).encode()


def _states() -> bytes:
    parts = ("left", "head", "right")
    axes = ("pos_x", "pos_y", "pos_z", "rot_x", "rot_y", "rot_z", "rot_w")
    names = ", ".join(["timestamp", *(f"{part}_{axis}" for part in parts for axis in axes)])
    pose = ["0.1", "1.2", "0.3", "0", "0", "0", "1"]
    rows = [", ".join([f"{0.05 * k:.3f}", *pose * 3]) for k in range(5)]
    return "\n".join(["condition easy, random seed 7", names, *rows, ""]).encode()


def _events() -> bytes:
    return b'0.0, game options {"hand": "left"}\n0.1, target_spawn, target ID 0, grid ID 4\n'


def _commands() -> list[bytes]:
    """Commands that name nothing that exists, so that none begins to train or to play."""
    commands = (
        "train PLACE/none.yaml --set ppo.n_envs=4 --timesteps 0 --out PLACE/run",
        "train --resume --out PLACE/none --set env.user.timestep_s=0.002 --seed 3",
        "evaluate PLACE/none --episodes 0 --condition easy --set env.user.noise.constant=white",
        "evaluate pretrained:nobody --seed -1 --batch 0 --out PLACE/out",
        "replay PLACE/none --fixed-step 0.002 --size 640x480 --fps 30",
        "plot curves PLACE/none --out PLACE/curves.png",
        "render snapshot --game none --size 8x8 --seconds 1 --seed 1 --out PLACE/out",
        "users show nobody",
        "users pack PLACE/none name --out PLACE/out --details PLACE/none.json",
        "users export nobody PLACE/body.xml --stature-m 1.8 --segment upper_arm=0.3",
        "games nothing --json",
    )
    return ["\x1f".join(command.split()).encode() for command in commands]


# --- changes ----------------------------------------------------------------------------------


def mutated(seeds: list[bytes], rng: random.Random) -> Iterator[bytes]:
    """Endless inputs: valid ones with one to six changes."""
    while True:
        data = bytearray(rng.choice(seeds))
        for _ in range(rng.choice((1, 1, 1, 2, 3, 6))):
            _change(data, seeds, rng)
        yield bytes(data[: 2**19])


def _change(data: bytearray, seeds: list[bytes], rng: random.Random) -> None:
    at = rng.randrange(len(data) + 1)
    to = min(len(data), at + rng.choice((1, 1, 2, 4, 16, 64, 1000)))
    match rng.randrange(9):
        case 0:
            data[at:to] = rng.randbytes(rng.choice((1, 1, 2, 8)))
        case 1:
            data[at:at] = rng.choice(TOKENS) * rng.choice((1, 1, 1, 2, 50))
        case 2:
            del data[at:to]
        case 3:
            del data[at:]
        case 4:
            data[at:at] = bytes(data[at:to]) * rng.choice((1, 2, 30))
        case 5:
            other = rng.choice(seeds)
            start = rng.randrange(len(other) + 1)
            data[at:to] = other[start : start + 64]
        case 6:
            _change_number(data, rng)
        case 7:
            lines = bytes(data).split(b"\n")
            i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
            lines[i] = lines[j] if rng.random() < 0.5 else b""
            data[:] = b"\n".join(lines)
        case 8:
            with contextlib.suppress(UnicodeDecodeError):
                data[:] = data.decode().encode(rng.choice(("utf-16", "utf-16-le", "utf-8-sig")))


def _change_number(data: bytearray, rng: random.Random) -> None:
    digits = [i for i, byte in enumerate(data) if 48 <= byte <= 57]
    if digits:
        at = end = rng.choice(digits)
        while end < len(data) and chr(data[end]) in "0123456789.e":
            end += 1
        data[at:end] = rng.choice(NUMBERS).encode()


# --- running ----------------------------------------------------------------------------------


def attack(
    seconds: float, seed: int, only: str | None, keep: Path, most: int | None = None
) -> tuple[Counter[str], list[str]]:
    """Give the readers inputs, in turns, for so long.

    Args:
        seconds: until which an input is begun.
        seed: of the inputs.
        only: a single target.
        keep: folder for inputs that broke something; made if needed.
        most: inputs of each target.

    Returns:
        How many inputs each target took (``NAME``) and how many it read (``NAME read``), and what
        broke, a line each.
    """
    counts: Counter[str] = Counter()
    broken: list[str] = []
    kinds: set[str] = set()
    with tempfile.TemporaryDirectory() as folder:
        targets = Targets(Path(folder)).all()
        inputs = {
            name: mutated(seeds, random.Random(f"{seed} {name}"))
            for name, (seeds, _) in targets.items()
            if only in (None, name)
        }
        for valid, case in map(targets.__getitem__, inputs):
            case(valid[0])  # what is imported at first use is not an input's time
        spent = dict.fromkeys(inputs, 0.0)
        until = time.monotonic() + seconds
        while inputs and (began := time.monotonic()) < until:
            name = min(inputs, key=lambda each: spent[each])  # every target gets its share of time
            content = next(inputs[name])
            problem = _try(targets[name][1], content)
            spent[name] += time.monotonic() - began
            counts[name] += 1
            if most is not None and counts[name] >= most:
                del inputs[name]
            if problem == "":
                counts[f"{name} read"] += 1
            elif (
                problem is not None and (kind := f"{name} {_DIGITS.sub('', problem)}") not in kinds
            ):
                kinds.add(kind)
                keep.mkdir(parents=True, exist_ok=True)
                file = keep / f"{name}_{len(broken)}"
                file.write_bytes(content)
                broken.append(f"{name}: {problem} ({file})")
                print(broken[-1], flush=True)
    return counts, broken


def _try(case: Case, content: bytes) -> str | None:
    """Return what broke, None for a refusal in one sentence, and nothing if it was read."""
    began = time.monotonic()
    problem: str | None = ""
    try:
        case(content)
    except ValueError as error:
        text = str(error)
        wrong = "\n" in text or len(text) > 2000 or ("expected" not in text)
        problem = f"{type(error).__name__} of {len(text)}: {text[:200]!r}" if wrong else None
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        problem = f"{type(error).__name__} at {Path(where.filename).name}:{where.lineno}: {error}"
        problem = problem[:300]
    took = time.monotonic() - began
    return f"slow: {took:.1f} s" if took > SLOW_S else problem


def main() -> int:
    """Run and report."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--target")
    parser.add_argument("--keep", type=Path, default=Path("build/fuzz_files"))
    given = parser.parse_args()
    counts, broken = attack(given.seconds, given.seed, given.target, given.keep)
    names = [name for name in counts if not name.endswith(" read")]
    for name in names:
        print(f"{name:10} {counts[name]:9,} inputs, {counts[f'{name} read']:9,} read")
    print(f"{sum(counts[name] for name in names):,} inputs; {len(broken)} kinds of failures")
    return bool(broken)


if __name__ == "__main__":
    sys.exit(main())
