"""Writes the first inputs of the fuzz targets whose formats are our own.

To be run when the wire format or the saved states change; what fuzzing has found in the old format
is of no use in the new one. Frames are each behind their length (2 bytes, little-endian), messages
of a session are separated by the length 0xFFFF (targets.hpp).
"""

import base64
import io
import json
import zipfile
from pathlib import Path

import numpy as np

from sim2vr_harness.client import INPUT_COUNT, DevicePoses, InProcessApp, OptionValue
from sim2vr_harness.client import protocol2 as wire
from sim2vr_harness.client.openxr import link as openxr_wire
from sim2vr_harness.client.protocol2 import HEADER, MAGIC, VERSION, Type

CORPUS = Path(__file__).parent / "corpus"
MAPS = Path(__file__).parents[1] / "data" / "beats_maps"
STEP_NS = 50_000_000
BEATS_SEED = 5
APP_1 = wire.APP.pack(1)


def devices(frame: int, *, left: bool = False, pressed: bool = False) -> DevicePoses:
    """A player who strikes in every fourth frame."""
    head = np.array([0.0, 1.17, 0.0, 0.0, 0.0, 0.0, 1.0])
    hand = np.array([0.15, 1.03, 0.36 if frame % 4 == 3 else 0.2, 0.0, 0.0, 0.0, 1.0])
    inputs = np.zeros(INPUT_COUNT)
    inputs[[0, 5]] = 1.0
    row = inputs if pressed else None
    return DevicePoses(head, hand, hand if left else None, row, row if left else None)


def sabers(frame: int) -> DevicePoses:
    """A player who swings both sabers in front."""
    head = np.array([0.0, 1.17, 0.0, 0.0, 0.0, 0.0, 1.0])
    turn = 0.9 * np.sin(1.3 * frame)
    rows = [
        np.array([x, 0.95, 0.1, np.sin(turn / 2.0), 0.0, 0.0, np.cos(turn / 2.0)])
        for x in (0.2, -0.2)
    ]
    return DevicePoses(head, *rows)


def message(kind: Type, *frames: bytes, count: int = 0) -> bytes:
    parts = [HEADER.pack(MAGIC, VERSION, kind, 7, count, 0, 0), *frames]
    return b"".join(len(part).to_bytes(2, "little") + part for part in parts)


def text(value: object) -> bytes:
    return json.dumps(value).encode()


def reset(app: int, options: dict[str, object], **given: bool) -> bytes:
    record = wire.reset_record(app, 3, 0, devices(0, **given))
    return message(Type.RESET, record, text([options]) if options else b"", count=1)


def step(frames_of: dict[int, int], first: int = 1, drawn: int = -1, **given: bool) -> bytes:
    records, frames = b"", b""
    for app, count in frames_of.items():
        records += wire.STEP_RECORD.pack(app, count, drawn, 0)
        for frame in range(first, first + count):
            poses = devices(frame, **given)
            one = DevicePoses(**{k: None if v is None else v[None] for k, v in vars(poses).items()})
            frames += wire.step_frames(np.array([frame * STEP_NS]), one).tobytes()
    return message(Type.STEP, records, frames, count=len(frames_of))


HELLO = {"client": "fuzz", "apps": 2, "game": "sample", "options": {"round_seconds": 5}, "eyes": 2,
         "width": 8, "height": 6, "ipd_m": 0.06, "renderer": "null", "log_dir": "",
         "fixed_delta_time_s": 0.01, "maximum_delta_time_s": 0.5, "fixed_step_tolerance_s": 1e-5,
         "shared_memory": False, "capabilities": ["haptics", "sounds", "smells"]}  # fmt: skip
MESSAGES = {
    "hello": message(Type.HELLO, text(HELLO)),
    "reset": reset(1, {"condition": "easy"}, left=True, pressed=True),
    "reset_plain": reset(0, {}),
    "step": step({1: 2, 0: 1}, drawn=0, left=True, pressed=True),
    "render": message(Type.RENDER, text({"app": 1, "view": "recorder", "width": 8, "height": 6})),
    "save": message(Type.SAVE, APP_1),
    "load": message(Type.LOAD, APP_1, b"a state"),
    "hash": message(Type.HASH, APP_1),
    "head_request": message(
        Type.HEAD_REQUEST, text({"app": 1, "seed": 5, "options": {"condition": "low"}})
    ),
    "scene": message(Type.SCENE, text({"app": 1, "meshes": 0})),
    "quit": message(Type.QUIT),
}
SAMPLE = message(Type.HELLO, text({"apps": 2, "game": "sample", "width": 8, "height": 6}))
SESSIONS = {
    "round": [reset(0, {}), reset(1, {}), step({0: 1, 1: 1}), step({1: 2, 0: 1}, 2),
              MESSAGES["hash"]],
    "inputs": [reset(0, {}, left=True, pressed=True),
               step({0: 3}, drawn=1, left=True, pressed=True)],
    "early": [step({0: 1}), MESSAGES["save"], MESSAGES["hash"], MESSAGES["render"]],
    "hello_again": [SAMPLE, reset(1, {}, pressed=True), step({1: 1}, pressed=True)],
    "scene": [MESSAGES["scene"], reset(1, {}), MESSAGES["scene"]],
    "two_eyes": [MESSAGES["hello"], reset(0, {}), MESSAGES["head_request"], MESSAGES["quit"]],
}  # fmt: skip


def saved_states() -> dict[str, bytes]:
    """Of the app of the target, at the start, in the middle and after the end of a round."""
    options = {"condition": "hard", "round_seconds": 1.0}
    states = {}
    with InProcessApp("whacamole", options, width=8, height=6, renderer="null") as app:
        app.reset(3, devices(0))
        for frame in range(1, 22):
            app.step(frame * STEP_NS, devices(frame))
            name = {1: "start", 10: "play", 21: "over"}.get(frame)
            if name is not None:
                states[name] = app.save()
    return states


def saved_beats() -> dict[str, bytes]:
    """Of the app that plays Beats: at the start, and after cuts, a mine and a wall; and the end."""
    options: dict[str, OptionValue] = {
        "level": "generated",
        "level_seconds": 10,
        "reward": "shaped",
    }
    states = {}
    with InProcessApp("beats", options, width=8, height=6, renderer="null") as app:
        app.reset(BEATS_SEED, sabers(0))
        for frame in range(1, 201):
            app.step(frame * STEP_NS, sabers(frame))
            name = {1: "start", 70: "cut", 130: "play", 200: "over"}.get(frame)
            if name is not None:
                states[name] = app.save()
    return states


def load_message(state: bytes) -> bytes:
    """Of protocol 1: the second of three messages that zero bytes separate."""
    file = CORPUS / "session1" / "load"
    first, _, last = file.read_bytes().split(b"\0")
    return b"\0".join([first, text({"load": base64.b64encode(state).decode()}), last])


def map_files(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in sorted(folder.iterdir())}


def levels() -> dict[str, bytes]:
    """The maps of the tests, each as Info.dat, difficulty and audio file (targets.hpp)."""
    found = {}
    for folder in sorted(MAPS.iterdir()):
        files = {name.lower(): data for name, data in map_files(folder).items()}
        parts = [files.get(name, b"") for name in ("info.dat", "hard.dat", "audiodata.dat")]
        found[folder.name] = b"\0".join(parts)
    # Between these regions time went back once.
    regions = [{"ei": 40, "eb": 4}, {"si": 40, "ei": 60, "sb": 60, "eb": 62}]
    audio = {"songFrequency": 10, "bpmData": regions}
    found["gap"] = b"\0".join([*found["v4"].split(b"\0")[:2], text(audio)])
    info = found["v2"].split(b"\0")[0]
    chain = {"b": 2, "x": 1, "y": 2, "d": 1, "tb": 3, "tx": 1, "ty": 0, "sc": 3, "s": 0.5}
    chains = {"version": "3.3.0", "colorNotes": [{"b": 2, "a": 30}], "burstSliders": [chain]}
    found["chains"] = b"\0".join([info, text(chains), b""])
    return found


def zipped_levels() -> dict[str, bytes]:
    """The same zipped: plainly, deflated, and in a folder of the archive."""
    found = {}
    for name, method, prefix in (
        ("v2", zipfile.ZIP_STORED, ""),
        ("v3", zipfile.ZIP_DEFLATED, "map/"),
        ("v4", zipfile.ZIP_DEFLATED, ""),
    ):
        stream = io.BytesIO()
        with zipfile.ZipFile(stream, "w", method) as archive:
            for file, data in map_files(MAPS / name).items():
                archive.writestr(zipfile.ZipInfo(prefix + file), data, method)
        found[name] = stream.getvalue()
    return found


def openxr_message(kind: openxr_wire.Kind, body: bytes = b"") -> bytes:
    return openxr_wire.HEADER.pack(len(body) + 1, kind) + body


def openxr_step(*frames: int) -> bytes:
    """Of a player with both controllers, laid out as the runtime's documentation has it."""
    body = len(frames).to_bytes(4, "little")
    for frame in frames:
        poses = devices(frame, left=True, pressed=True)
        hand = poses.right_controller.astype("<f8").tobytes()
        inputs = np.zeros(INPUT_COUNT).astype("<f8").tobytes()
        head = poses.head.astype("<f8").tobytes()
        body += ((frame + 1) * STEP_NS).to_bytes(8, "little") + head + b"\1\1"
        body += hand + hand + inputs + inputs
    return openxr_message(openxr_wire.Kind.STEP, body + b"\1")


def openxr_inputs() -> dict[str, bytes]:
    config = {"width": 12, "height": 8, "eyes": 2, "hands": ["right"], "gate": "pipelined",
              "timeout_s": 5.0, "profile": "/interaction_profiles/valve/index_controller",
              "start_time_ns": 1, "images": True, "depth": True, "farthest_m": 10.0}  # fmt: skip
    start = openxr_message(openxr_wire.Kind.CONFIG, text(config))
    start += openxr_message(openxr_wire.Kind.ACCEPTED)
    return {
        "config": start,
        "round": start + openxr_step(0) + openxr_step(1, 2) + openxr_message(openxr_wire.Kind.QUIT),
        "refused": start + openxr_message(openxr_wire.Kind.ERROR, text({"error": "no depth"})),
    }


def main() -> None:
    states = saved_states()
    (CORPUS / "session1" / "load").write_bytes(load_message(states["play"]))
    for target, inputs in (
        ("protocol2", MESSAGES),
        ("session2", {name: b"\xff\xff".join(parts) for name, parts in SESSIONS.items()}),
        ("saved_state", states),
        ("saved_beats", saved_beats()),
        ("level", levels()),
        ("level_zip", zipped_levels()),
        ("openxr", openxr_inputs()),
    ):
        folder = CORPUS / target
        folder.mkdir(exist_ok=True)
        for file in folder.iterdir():
            file.unlink()
        for name, data in inputs.items():
            (folder / name).write_bytes(data)


if __name__ == "__main__":
    main()
