"""Reading files that are damaged, of another kind, or made to hurt."""

import errno
import io
import math
import tracemalloc
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from sim2vr_harness.base import files
from sim2vr_harness.base.bounded_yaml import parse_yaml
from sim2vr_harness.base.errors import InputError

EXPECTED = "a thing"
READERS: dict[str, Callable[[Path, str], Any]] = {
    "text": files.read_text,
    "yaml": files.read_yaml,
    "json": files.read_json,
    "arrays": files.read_arrays,
    "tensors": files.read_tensors,
    "members": lambda path, expected: files.read_members(path, ["one"], expected),
}


def bomb(levels: int) -> str:
    """YAML that stands for 9 ** levels values, in some hundred bytes."""
    lines = ["a0: &a0 [x]"]
    lines += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, levels + 1)]
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (bomb(9), "f, line 6: got more than 20,000 values"),
        ("a: &a [*a]", "f, line 1: got an anchor that is used inside itself"),
        ("[" * 100_000, "f, line 1: got more than 32 levels"),
        ("a: 1\nb: 2\na: 3", "f, line 3: got the key 'a' twice"),
        (f"a: {'9' * 400}", "f, line 1: got a number of 400 digits"),
        ("a: [1", "f, line 1: got text that is not YAML (expected ',' or ']', but got"),
        ("a: !!python/name:os.system", "f, line 1: got text that is not YAML ("),
        ("--- 1\n--- 2", "f, line 2: got text that is not YAML ("),
    ],
)
def test_yaml_is_bounded_and_says_where_it_is_wrong(text: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_yaml(text, "f", EXPECTED)
    assert str(caught.value).startswith(message)
    assert str(caught.value).endswith(", expected a thing")


def test_aliases_and_merged_keys_are_what_they_were() -> None:
    assert parse_yaml(bomb(2), "f", EXPECTED)["a2"] == [[["x"]] * 9] * 9
    text = "a: &a {k: 1, l: 2}\nb: [&b {<<: *a, k: 3}]\nc: {<<: *b, l: 4}"
    assert parse_yaml(text, "f", EXPECTED) == {
        "a": {"k": 1, "l": 2},
        "b": [{"k": 3, "l": 2}],
        "c": {"k": 3, "l": 4},
    }


def test_an_integer_that_no_float_holds_is_infinite() -> None:
    assert files.parse_json('{"a": ' + "9" * 5000 + "}", "f", "a thing") == {"a": math.inf}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"a": 1,\n}', "f, line 2: got text that is not JSON (Expecting property name"),
        ("[" * 100_000, "f: got JSON nested too deep"),
        ('{"a": 1, "a": 2}', "f: got the key 'a' twice"),
    ],
)
def test_json_says_where_it_is_wrong(text: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        files.parse_json(text, "f", EXPECTED)
    assert str(caught.value).startswith(message)


def zipped(members: dict[str, bytes]) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return stream.getvalue()


def npy(shape: tuple[int, ...], dtype: str = "<f4") -> bytes:
    stream = io.BytesIO()
    header = {"descr": dtype, "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(stream, header)
    return stream.getvalue() + bytes(64)


def torch_archive(pickle: bytes, storage: bytes = b"") -> bytes:
    return zipped({"a/data.pkl": pickle, "a/version": b"3", "a/data/0": storage})


def saved(content: dict[str, Any], **options: Any) -> bytes:
    stream = io.BytesIO()
    torch.save(content, stream, **options)
    return stream.getvalue()


@pytest.fixture(scope="module")
def zeros() -> bytes:
    """A part of 0.3 GB, of which 0.3 MB are left when it is packed."""
    return bytes(300_000_000)


@pytest.mark.parametrize("kind", ["members", "arrays", "tensors"])
def test_an_archive_is_refused_by_the_sizes_in_its_headers(
    kind: str, zeros: bytes, tmp_path: Path
) -> None:
    place = tmp_path / "file"
    place.write_bytes(zipped({"one": b"1", "t.npy": zeros}))
    assert place.stat().st_size < 1_000_000
    tracemalloc.start()
    with pytest.raises(InputError, match=r"file: got [\d,]+ bytes that unpack to 300,000,001, exp"):
        READERS[kind](place, EXPECTED)
    assert tracemalloc.get_traced_memory()[1] < 10_000_000
    tracemalloc.stop()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (
            zipped({"t.npy": npy((850_000_000,))}),
            r"'t.npy' declares shape \(850000000,\) of float32",
        ),
        (zipped({"t.npy": npy((4,), "(200000000,)<f4")}), "'t.npy' declares shape"),
    ],
)
def test_an_array_is_refused_by_the_shape_in_its_header(content: bytes, message: str) -> None:
    tracemalloc.start()
    with pytest.raises(InputError, match=message):
        files.parse_arrays(content, "f", EXPECTED)
    assert tracemalloc.get_traced_memory()[1] < 10_000_000
    tracemalloc.stop()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        # bytearray(400,000,000), by an instruction of torch.load's own list
        (
            torch_archive(b"\x80\x02}U\x01wcbuiltins\nbytearray\nJ\x00\x84\xd7\x17\x85Rs."),
            "a bytearray in it",
        ),
        (saved({"w": [torch.zeros(1).expand(100_000_000)]}), "f: got .* unpack to 400,000,000,"),
    ],
)
def test_tensors_are_refused_by_what_they_declare(content: bytes, message: str) -> None:
    with pytest.raises(InputError, match=message):
        files.parse_tensors(content, "f", EXPECTED)


def test_a_full_disk_is_named(tmp_path: Path) -> None:
    with (
        pytest.raises(OSError, match="No space left") as caught,
        files.naming(tmp_path / "results.json"),
        open("/dev/full", "wb", buffering=0) as stream,
    ):
        stream.write(b"x")
    assert caught.value.errno == errno.ENOSPC
    assert caught.value.filename == str(tmp_path / "results.json")
