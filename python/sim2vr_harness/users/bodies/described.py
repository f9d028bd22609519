"""Bodies made of someone's MJCF, as a YAML file describes them (`description.py`)."""

import fnmatch
import itertools
import math
import re
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from importlib import resources
from pathlib import Path

import mujoco
import numpy as np

from sim2vr_harness.base.errors import unknown_name
from sim2vr_harness.users import appearance as looks
from sim2vr_harness.users.bodies.body import (
    DEVICES,
    MEAN_IPD_M,
    ActuatorGroup,
    Body,
    BodyPlan,
    EffortInputs,
    ResetRule,
    held,
)
from sim2vr_harness.users.bodies.description import (
    ActuatorsDescription,
    BodyDescription,
    read_description,
)
from sim2vr_harness.users.bodies.meshes import compose
from sim2vr_harness.users.bodies.options import LEAST_STEP_S, MOST_STEP_S, BodyOptions
from sim2vr_harness.users.bodies.packages import folder_of_package, package_of_models
from sim2vr_harness.users.bodies.person import Anatomy, Segment, tailored_body
from sim2vr_harness.users.bodies.posture import Lock, idle_actuators, lock_joints, still_legs
from sim2vr_harness.users.bodies.rules import usual_rule
from sim2vr_harness.users.bodies.tables import load_device_rows

MOST_ELEMENTS = 10_000
MOST_FILE_BYTES = 200_000_000
MOST_PIXELS = 8192

_SAMPLES = 10_000
MOST = {
    "option.iterations": 10_000,
    "option.ls_iterations": 10_000,
    "option.noslip_iterations": 10_000,
    "option.ccd_iterations": 10_000,
    "option.sdf_iterations": 1000,
    "option.sdf_initpoints": 10_000,
    "size.memory": 2**30,
    "size.nstack": 2**27,
    "size.njmax": 1_000_000,
    "size.nconmax": 1_000_000,
    "size.nkey": 10_000,
    "size.nuserdata": 1_000_000,
    "size.nuser_*": 1000,
    "lengthrange.inttotal": 1000,
    "numeric.size": 100_000,
    "mesh.params": 1000,
    "global.offwidth": MOST_PIXELS,
    "global.offheight": MOST_PIXELS,
    "quality.shadowsize": 16_384,
    "quality.offsamples": 64,
    "quality.num*": 1000,
    "hfield.nrow": 4096,
    "hfield.ncol": 4096,
    "texture.width": MOST_PIXELS,
    "texture.height": MOST_PIXELS,
    "texture.gridsize": 16,
    "camera.resolution": MOST_PIXELS,
    "*.nsample": _SAMPLES,
    "*.actdim": 1000,
    "replicate.count": MOST_ELEMENTS,
    "composite.count": MOST_ELEMENTS,
    "flexcomp.count": MOST_ELEMENTS,
    "flexcomp.cellcount": MOST_ELEMENTS,
}
"""Element and attribute -> the greatest number; of several their product counts for counts."""
LEAST = {"lengthrange.timestep": 1e-4, "option.timestep": 1e-6}
"""Element and attribute -> the least number."""

_FILES = (
    "file",
    "filename",
    "fileback",
    "filedown",
    "filefront",
    "fileleft",
    "fileright",
    "fileup",
)
_NOT_FINITE = re.compile(r"[+-]?(nan(\(\w*\))?|inf(inity)?)", re.IGNORECASE)
_COMMENT = re.compile(rb"<!--.*?-->", re.DOTALL)
_PNG = b"\x89PNG\r\n\x1a\n"
_UNITS = {"K": 2**10, "M": 2**20, "G": 2**30, "T": 2**40, "P": 2**50, "E": 2**60}


@dataclass(frozen=True)
class _Element:
    """An element of an MJCF or of a file that it includes; `copies`: how often it is made."""

    xml: ET.Element
    file: Path
    copies: int

    def __str__(self) -> str:
        name = self.xml.get("name")
        return f"{self.file.name}: {self.xml.tag}{f' {name!r}' if name else ''}"


def check_mjcf(path: Path, folders: Sequence[Path]) -> None:
    """Check an MJCF and the files that it includes, before anything is made of it.

    Args:
        path: of the MJCF.
        folders: where the files that it names may lie, beside its own folder.

    Raises:
        ValueError: it is not XML, has a number that is not finite or too great, or names a file
            elsewhere; names the file, the element and the attribute.
    """
    _Check(path, [folder.resolve() for folder in (path.parent, *folders)]).run()


class _Check:
    def __init__(self, path: Path, folders: Sequence[Path], within: tuple[Path, ...] = ()) -> None:
        self._path = path
        self._chain = (*within, path.resolve())
        self._folders = folders

    def run(self) -> int:
        """Check everything; returns the number of elements."""
        elements = list(self._elements())
        names = {element.xml.get("name") for element in elements}
        # Where the files of assets may be.
        bases = dict.fromkeys([self._path.parent, *(element.file.parent for element in elements)])
        kinds = ("assetdir", "meshdir", "texturedir")
        compilers = [element.xml for element in elements if element.xml.tag == "compiler"]
        named = [xml.get(kind, "") for xml in compilers for kind in kinds]
        places = [base / folder for base in bases for folder in dict.fromkeys(["", *named])]
        attached: dict[str, int] = {}
        total = 0
        for element in sorted(elements, key=lambda element: element.xml.tag != "model"):
            for attribute, value in element.xml.attrib.items():
                field = f"mjcf: {element}: {attribute}"
                if attribute in _FILES and element.xml.tag != "include":
                    file = self._inside(field, value, places)
                    if element.xml.tag == "model" and file is not None:
                        name = element.xml.get("name") or file.stem
                        attached[name] = self._attached(field, file)
                elif value not in names and element.xml.tag != "text":
                    _check_numbers(field, element.xml.tag, attribute, value)
            xml = element.xml
            if xml.tag == "attach":
                made = attached.get(xml.get("model", ""), 1)
            elif xml.tag in ("composite", "flexcomp"):
                made = max(1, int(math.prod(_numbers(xml.get("count", "")))))
            else:
                made = 1
            total += element.copies * made
            if total > MOST_ELEMENTS:
                raise ValueError(
                    f"mjcf: {element}: got more than {MOST_ELEMENTS} elements up to here, copies "
                    f"of replicate, flexcomp and attach included; expected at most that many"
                )
        return total

    def _elements(self) -> Iterator[_Element]:
        """Every element of the MJCF and of what it includes, parents first."""
        read: set[Path] = set()
        left = [_Element(_parsed(self._path), self._path, 1)]
        while left:
            element = left.pop()
            yield element
            xml, file, copies = element.xml, element.file, element.copies
            if xml.tag == "include":
                places = [file.parent, self._path.parent]
                included = self._inside(f"mjcf: {element}: file", xml.get("file", ""), places)
                if included is not None and included not in read:
                    read.add(included)
                    left.append(_Element(_parsed(included), included, copies))
            if xml.tag == "replicate":
                copies *= max(1, int(math.prod(_numbers(xml.get("count", "")))))
            left.extend(_Element(child, file, copies) for child in reversed(xml))

    def _attached(self, field: str, file: Path) -> int:
        """Check a model that this one attaches; returns its number of elements."""
        if file in self._chain:
            raise ValueError(f"{field}: got {file.name!r}, which attaches itself, expected another")
        return _Check(file, self._folders, self._chain).run()

    def _inside(self, field: str, name: str, places: Sequence[Path]) -> Path | None:
        """The file of that name in one of the places; None if there is none."""
        found = [place for folder in places if (place := (folder / name).resolve()).is_file()]
        for place in found or [(places[0] / name).resolve()]:
            if not any(place.is_relative_to(folder) for folder in self._folders):
                raise ValueError(
                    f"{field}: got {name!r}, which is {place}, outside the folder of the MJCF; "
                    "expected a file inside it: move the file there, or name its folder under "
                    "'folders' in the body's description"
                )
        for place in found:
            _check_file(field, place)
        return found[0] if found else None


def _parsed(path: Path) -> ET.Element:
    _check_file(f"mjcf: {path.name}", path)
    try:
        # MuJoCo takes comments that XML forbids, such as lines of dashes.
        return ET.fromstring(_COMMENT.sub(b"", path.read_bytes()))
    except (ET.ParseError, ValueError) as error:
        raise ValueError(
            f"mjcf: got {str(path)!r}, which is not XML: {error}; expected an MJCF file"
        ) from error


def _check_file(field: str, file: Path) -> None:
    size = file.stat().st_size
    if size > MOST_FILE_BYTES:
        raise ValueError(
            f"{field}: got {file.name!r} of {size:,} bytes, expected at most {MOST_FILE_BYTES:,}"
        )
    with file.open("rb") as stream:
        head = stream.read(24)
    if head.startswith(_PNG):
        width, height = (int.from_bytes(head[i : i + 4], "big") for i in (16, 20))
        if max(width, height) > MOST_PIXELS:
            raise ValueError(
                f"{field}: got {file.name!r} of {width} x {height} pixels, expected at most "
                f"{MOST_PIXELS} x {MOST_PIXELS}"
            )


def _check_numbers(field: str, tag: str, attribute: str, value: str) -> None:
    wrong = [token for token in value.split() if _NOT_FINITE.fullmatch(token)]
    if wrong:
        raise ValueError(f"{field}: got {wrong[0]!r}, expected finite numbers")
    numbers, key = _numbers(value), f"{tag}.{attribute}"
    if not numbers:
        return
    if min(numbers) < (least := LEAST.get(key, -math.inf)):
        raise ValueError(f"{field}: got {value!r}, expected at least {least:g}")
    greatest = math.prod(numbers) if "count" in attribute else max(numbers)
    if greatest > (
        most := min(
            (most for name, most in MOST.items() if fnmatchcase(key, name)), default=math.inf
        )
    ):
        raise ValueError(f"{field}: got {value!r}, expected at most {most:.12g}")


def _numbers(value: str) -> list[float]:
    """The numbers of an attribute; none where it has something else. Sizes may have a unit."""
    try:
        return [
            float(token[:-1]) * _UNITS[token[-1].upper()]
            if token[-1].upper() in _UNITS
            else float(token)
            for token in value.split()
        ]
    except ValueError:
        return []


_KINDS = {
    "body": "bodies",
    "joint": "joints",
    "geom": "geoms",
    "site": "sites",
    "camera": "cameras",
    "light": "lights",
    "flex": "flexes",
    "skin": "skins",
    "tendon": "tendons",
    "actuator": "actuators",
    "sensor": "sensors",
    "equality": "equalities",
    "pair": "pairs",
    "exclude": "excludes",
    "key": "keys",
}
"""Kind of element -> the list of a specification that has them. Assets have their file's name."""


def read_model(description: BodyDescription, file: Path) -> mujoco.MjSpec:
    """Read the model that a description names; every element of it has a name.

    Args:
        description: of the body.
        file: where the description was read from.

    Raises:
        ValueError: there is no such model, or it cannot be read; names the key.
    """
    spec = _read(description, file)
    # Name the elements without names by kind and number, such as joint_0.
    for kind, many in _KINDS.items():
        elements = getattr(spec, many)
        taken = {element.name for element in elements}
        free = (name for i in itertools.count() if (name := f"{kind}_{i}") not in taken)
        for element in elements:
            if not element.name:
                element.name = next(free)
    return spec


def compiled(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Compile a specification without warnings about specifications attached to others."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return spec.compile()


def check_finite(model: mujoco.MjModel) -> None:
    """Check that no number of a model is NaN, wherever it came from (a mesh, a package).

    Raises:
        ValueError: one is; names MuJoCo's field and its row.
    """
    for prefix, owner in (("", model), ("opt.", model.opt)):
        for name in dir(owner):
            value = getattr(owner, name, None)
            if name.startswith("_") or not isinstance(value, float | np.ndarray):
                continue
            numbers = np.asarray(value)
            if numbers.dtype.kind == "f" and np.isnan(numbers).any():
                row = int(np.argwhere(np.isnan(numbers))[0][0]) if numbers.ndim else 0
                raise ValueError(
                    f"mjcf: got NaN in {prefix}{name}[{row}] of the compiled model, expected "
                    "finite numbers"
                )


def _read(description: BodyDescription, file: Path) -> mujoco.MjSpec:
    package = description.package
    folders = [file.parent / folder for folder in description.folders]
    if package is None:
        return _from_file(file.parent / str(description.mjcf), folders)
    if description.mjcf is not None:
        home = folder_of_package(package)
        return _from_file(home / description.mjcf, [home, *folders])
    module = package_of_models(package)
    if not hasattr(module, "load_spec"):
        raise ValueError(
            f"model: got {description.model!r} of {package!r}, which has no load_spec(name); "
            "expected 'mjcf' with a file of the package"
        )
    # Packages attach specifications to each other; MuJoCo warns of that, too, on the standard
    # error stream and in a file beside the caller.
    said = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda text: None)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return module.load_spec(description.model)
    except ValueError as error:
        raise ValueError(f"model: got {description.model!r}; {package}: {error}") from error
    finally:
        mujoco.set_mju_user_warning(said)


def _from_file(path: Path, folders: Sequence[Path]) -> mujoco.MjSpec:
    if not path.is_file():
        raise ValueError(f"mjcf: got {str(path)!r}, which is not there, expected an MJCF file")
    check_mjcf(path, folders)
    try:
        return mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise ValueError(f"mjcf: got {str(path)!r}, which MuJoCo cannot read: {error}") from error


DESCRIPTIONS = Path(str(resources.files("sim2vr_harness.users").joinpath("data", "described")))
"""Folder of the descriptions that ship with the package."""


def described_body(file: Path, options: BodyOptions) -> Body:
    """Makes the body that a YAML file describes.

    Raises:
        ValueError: the file, the model or what one says of the other cannot be used; names the
            file and the key.
    """
    description = read_description(file)
    if options.torso:
        raise ValueError(
            f"{file}: torso: got true, expected false: trunk and neck are what the MJCF has"
        )
    try:
        return _Described(description, file, options).body()
    except ValueError as error:
        text = str(error)
        raise ValueError(text if text.startswith(str(file)) else f"{file}: {text}") from error


class _Described:
    def __init__(self, description: BodyDescription, file: Path, options: BodyOptions) -> None:
        self._file = file
        self._description = description
        self._options = options
        self._source = read_model(description, file)
        model = compiled(self._source)
        check_finite(model)
        self._own_step = float(model.opt.timestep)
        # Names of the model's parts, as they are in the MJCF.
        self._joints, self._bodies, self._sites, self._actuators = (
            tuple(getattr(model, kind)(i).name for i in range(count))
            for kind, count in (
                ("joint", model.njnt),
                ("body", model.nbody),
                ("site", model.nsite),
                ("actuator", model.nu),
            )
        )
        posture, yaw = description.posture, math.radians(description.place.yaw_deg)
        left = np.array([math.sin(yaw), math.cos(yaw), 0.0])  # turned by yaw it is along y
        self._legs = still_legs(model, posture, left) if posture else None
        wanted = description.actuators
        idle = idle_actuators(model, self._legs.locks, self._actuators) if self._legs else ()
        groups: list[ActuatorGroup] = []
        for group in wanted or (ActuatorsDescription(names=("*",)),):
            for name in _found("actuators", group.names, self._actuators):
                if name in idle:
                    continue
                rule = group.rule or usual_rule(model, model.actuator(name).id)
                if groups and groups[-1].rule == rule:
                    groups[-1] = ActuatorGroup(rule, (*groups[-1].actuators, name))
                else:
                    groups.append(ActuatorGroup(rule, (name,)))
        if not groups:
            raise ValueError(
                "actuators: got none in the model that moves a joint, expected at least one"
            )
        self._groups = tuple(groups)
        self._locked = self._locked_joints(model)
        wearable = tuple(name for name in DEVICES if name in description.devices)
        self._devices = wearable if options.devices is None else options.devices
        for name in self._devices:
            _known("device", name, wearable)
            self._check_device(name)
        for segment in description.anatomy.segments.values():
            for body in segment.bodies:
                _known("anatomy.segments", body, self._bodies)
            for end in (segment.start, segment.end):
                _known("anatomy.segments", end, (*self._bodies, *self._sites))

    def body(self) -> Body:
        """Makes the body."""
        description = self._description
        joints = [name for name in self._joints if name not in self._locked]
        observed = description.observed_joints
        effectors = description.end_effectors
        if effectors is None:
            effectors = held(self._devices) or ("headset",)
        for name in effectors:
            _known("end_effectors", name, (*self._sites, *self._devices))
        lifting = description.effort.lifting
        step = self._options.timestep_s or description.timestep_s or self._own_step
        if not LEAST_STEP_S <= step <= MOST_STEP_S:
            raise ValueError(
                f"timestep_s: got the MJCF's own, {step:g}, expected a number from "
                f"{LEAST_STEP_S:g} to {MOST_STEP_S:g} (s)"
            )
        used = [name for group in self._groups for name in group.actuators]
        plan = BodyPlan(
            name=description.name or self._file.stem,
            devices=self._devices,
            actuator_groups=self._groups,
            end_effectors=effectors,
            timestep=step,
            observed_joints=None
            if observed is None
            else _found("observed_joints", observed, joints),
            reset_rule=ResetRule(**description.reset.model_dump()),
            effort_inputs=EffortInputs(
                lifting=_found("effort.lifting", lifting, used),
                peak_forces=dict(description.effort.peak_forces),
            ),
            ipd_m=description.ipd_m or MEAN_IPD_M,
            stance=description.posture or "",
        )
        table = description.anatomy
        segments = {n: Segment(s.bodies, s.start, s.end) for n, s in table.segments.items()}
        anatomy = Anatomy(table.stature_m, table.mass_kg, segments)
        return tailored_body(plan, self._build, self._options, anatomy)

    def _build(self, appearance: bool) -> mujoco.MjSpec:
        spec = self._source.copy()
        # Takes away what no one uses: other actuators and their tendons, sensors, keyframes.
        used = {name for group in self._groups for name in group.actuators}
        idle = [actuator for actuator in spec.actuators if actuator.name not in used]
        targets = {actuator.target for actuator in idle}
        kept = {actuator.target for actuator in spec.actuators if actuator.name in used}
        for element in [*spec.sensors, *spec.keys, *idle]:
            spec.delete(element)
        for tendon in list(spec.tendons):
            passive = not (np.any(tendon.stiffness) or np.any(tendon.damping))
            if tendon.name in targets - kept and passive and not _coupled(spec, tendon.name):
                spec.delete(tendon)
        lock_joints(spec, self._locked)
        self._place(spec)
        rows = load_device_rows()
        model = compiled(spec)
        for name in self._devices:
            device = self._description.devices[name]  # type: ignore[index]
            pose = np.array(device.pos_m), _unit(device.quat_wxyz)
            if device.site is not None:
                site = model.site(device.site)
                parent = spec.body(model.body(int(site.bodyid[0])).name)
                pose = compose((np.array(site.pos), np.array(site.quat)), pose)
            else:
                parent = spec.body(device.body)
            if name == "headset":
                half = math.radians(self._options.skull_rotation_deg) / 2.0
                down = np.array([math.cos(half), 0.0, math.sin(half), 0.0])
                pose = compose(pose, (np.zeros(3), down))
            place, turn = pose[0].tolist(), pose[1].tolist()
            rows[name].attach(parent, place, turn, device.weight)
        # A diverged state must stay visible to the caller: no silent reset to the start pose.
        flags = mujoco.mjtDisableBit.mjDSBL_AUTORESET
        if not self._description.contacts:
            flags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        spec.option.disableflags = int(spec.option.disableflags) | int(flags)
        if appearance:
            # Draws the devices, and a room where the model has none.
            if not any(geom.type == mujoco.mjtGeom.mjGEOM_PLANE for geom in spec.geoms):
                looks.draw_room(spec)
            else:
                looks.picture_settings(spec)
            for camera in list(spec.cameras):
                if camera.name in looks.CAMERAS:
                    spec.delete(camera)
            looks.add_cameras(spec)
            looks.draw_devices(spec, self._devices)
        else:
            spec.discard_visual()
        return spec

    # --- what the description says -----------------------------------------------------------

    def _locked_joints(self, model: mujoco.MjModel) -> dict[str, Lock]:
        locked: dict[str, Lock] = dict(self._legs.locks) if self._legs else {}
        for pattern, angle in self._description.locked_joints.items():
            for name in _found("locked_joints", [pattern], self._joints):
                locked[name] = angle
        joint = int(mujoco.mjtTrn.mjTRN_JOINT)
        for name in (name for group in self._groups for name in group.actuators):
            actuator = model.actuator(name)
            moved = model.joint(int(actuator.trnid[0])).name if actuator.trntype == joint else None
            if moved in locked:
                raise ValueError(
                    f"locked_joints: got {moved!r}, which the actuator {name!r} moves; expected "
                    "another joint, or actuators without it"
                )
        return locked

    def _check_device(self, name: str) -> None:
        device = self._description.devices[name]  # type: ignore[index]
        if device.site is not None:
            _known(f"devices.{name}.site", device.site, self._sites)
        else:
            _known(f"devices.{name}.body", device.body or "", self._bodies)
        for kind, known in (("body", self._bodies), ("site", self._sites)):
            if name in known:
                raise ValueError(
                    f"devices.{name}: got a model with a {kind} of that name already, expected "
                    f"the name free: rename the model's {kind}, or place the device by it"
                )

    # --- what is made of it ------------------------------------------------------------------

    def _place(self, spec: mujoco.MjSpec) -> None:
        place = self._description.place
        half = math.radians(place.yaw_deg) / 2.0
        whole = np.array(place.pos_m), np.array([math.cos(half), 0.0, 0.0, math.sin(half)])
        if not (any(place.pos_m) or place.yaw_deg or self._legs):
            return
        model = compiled(spec)
        if self._legs:
            model.body_pos[model.body(self._legs.root).id, 2] -= self._legs.lowered_m
        for poses, holders in (
            ((model.body_pos, model.body_quat), model.body_parentid),
            ((model.site_pos, model.site_quat), model.site_bodyid),
        ):
            for i in np.flatnonzero(holders == 0).tolist():
                if holders is model.body_parentid and i == 0:
                    continue
                own = np.array(poses[0][i]), np.array(poses[1][i])
                poses[0][i], poses[1][i] = compose(whole, own)
        spec.copy_back(model)


def _coupled(spec: mujoco.MjSpec, tendon: str) -> bool:
    kind = mujoco.mjtEq.mjEQ_TENDON
    return any(e.type == kind and tendon in (e.name1, e.name2) for e in spec.equalities)


def _found(field: str, patterns: Iterable[str], known: Iterable[str]) -> tuple[str, ...]:
    """The names that patterns stand for, in the patterns' order, each once."""
    names = list(known)
    found: dict[str, None] = {}
    for pattern in patterns:
        matches = [name for name in names if fnmatch.fnmatchcase(name, pattern)]
        if not matches:
            raise unknown_name(field, pattern, names)
        found |= dict.fromkeys(matches)
    return tuple(found)


def _known(field: str, name: str, known: Iterable[str] | Mapping[str, object]) -> None:
    names = tuple(known)
    if name not in names:
        raise unknown_name(field, name, names)


def _unit(quaternion: Iterable[float]) -> np.ndarray:
    values = np.array(tuple(quaternion))
    return values / np.linalg.norm(values)
