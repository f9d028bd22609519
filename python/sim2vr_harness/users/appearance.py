"""Draws the user: shapes without mass and without contacts, lights and cameras.

Nothing here changes the simulation; it makes pictures and videos of the user readable. The body
model has only a torso, a head and one or two arms. A left arm that is missing, the legs and the
stool are drawn as scenery, seated because the model's sternum is 1.0 m above the ground.

Frames: the thorax and skull frames are x forward, y up, z right; the world is z up.
"""

from collections.abc import Sequence
from itertools import pairwise

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim2vr_harness.users.bodies.tables import ModelTables

Point = Sequence[float]
Colour = tuple[float, float, float, float]

BODY_GROUP = 1
MUSCLE_GROUP = 2

_BONE: Colour = (0.93, 0.89, 0.80, 1.0)
_SKIN: Colour = (0.87, 0.69, 0.57, 1.0)
_LIPS: Colour = (0.75, 0.48, 0.44, 1.0)
_SHIRT: Colour = (0.36, 0.50, 0.62, 1.0)
_TROUSERS: Colour = (0.24, 0.27, 0.33, 1.0)
_SHOES: Colour = (0.16, 0.16, 0.18, 1.0)
_WOOD: Colour = (0.55, 0.42, 0.30, 1.0)
_DEVICE: Colour = (0.13, 0.13, 0.15, 1.0)
_STRAP: Colour = (0.22, 0.22, 0.25, 1.0)
_LENS: Colour = (0.45, 0.50, 0.58, 1.0)

_RELAXED = np.array([0.80, 0.66, 0.57, 1.0])
_ACTIVE = np.array([0.88, 0.12, 0.10, 1.0])

# Torso in the thorax frame: height y, centre x, half depth along x, half width along z, in m.
_TORSO_OUTLINE = np.array(
    [
        [0.035, -0.040, 0.020, 0.030],
        [0.022, -0.040, 0.042, 0.085],
        [-0.005, -0.036, 0.056, 0.132],
        [-0.040, -0.030, 0.070, 0.150],
        [-0.080, -0.024, 0.085, 0.146],
        [-0.130, -0.021, 0.095, 0.140],
        [-0.190, -0.022, 0.095, 0.133],
        [-0.280, -0.028, 0.086, 0.120],
        [-0.350, -0.031, 0.085, 0.120],
        [-0.420, -0.034, 0.092, 0.134],
        [-0.470, -0.035, 0.096, 0.142],
        [-0.500, -0.035, 0.080, 0.120],
    ]
)

_WAIST_M = -0.40  # height y of the waist, in the thorax frame

# Torso and neck are drawn as surfaces, so their bones would only poke through.
_COVERED_BODIES = {"thorax", "skull"}
_HAND_BODIES = {"hand", "index0", "index1", "index2", "index3", "proximal_row"}
_HAND_FLESH_M = 0.0045
_MUSCLE_WIDTH_M = 0.0052  # drawn radius of a muscle with 500 N peak force
_FLOOR_BELOW_M = 0.005  # games have floors at 0: two in one plane would show in turn, in stripes


def dress(spec: mujoco.MjSpec, tables: ModelTables, devices: Sequence[str]) -> None:
    """Adds everything drawn to `spec` in place; `devices` names those that it wears."""
    pen = _Pen(spec)
    draw_room(spec)
    moves = any(row.name == "pelvis" for row in tables.bodies)
    seat = "pelvis" if moves else "thorax"
    # Draws neck, trunk and pelvis; a trunk that moves on its seat ends at the waist.
    neck = "skull" if moves else "thorax"
    outline = (
        _TORSO_OUTLINE if seat == "thorax" else _TORSO_OUTLINE[_TORSO_OUTLINE[:, 0] > _WAIST_M]
    )
    pen.loft("thorax", "shirt", outline, _SHIRT)
    if seat != "thorax":
        pen.ellipsoid("thorax", [-0.040, _WAIST_M + 0.005, 0], [0.094, 0.075, 0.138], _SHIRT)
    pen.capsule(neck, [-0.045, 0.0, 0], [-0.028, 0.11, 0], 0.046, _SKIN)
    pen.ellipsoid(seat, [-0.035, -0.470, 0], [0.100, 0.085, 0.150], _TROUSERS)
    if not any(row.name == "humerus_l" for row in tables.bodies):
        shoulder, elbow, wrist = (
            [-0.02, -0.015, -0.165],
            [-0.04, -0.275, -0.215],
            [0.19, -0.385, -0.15],
        )
        pen.ellipsoid("thorax", shoulder, [0.052, 0.052, 0.052], _SHIRT)
        pen.capsule("thorax", shoulder, [-0.03, -0.15, -0.192], 0.043, _SHIRT)
        pen.capsule("thorax", [-0.03, -0.15, -0.192], elbow, 0.037, _SKIN)
        pen.capsule("thorax", elbow, wrist, 0.031, _SKIN)
        pen.ellipsoid("thorax", [0.245, -0.398, -0.135], [0.062, 0.020, 0.040], _SKIN)
    for side in (-1.0, 1.0):
        hip, knee = [-0.02, -0.485, side * 0.085], [0.37, -0.465, side * 0.115]
        ankle, toe = [0.33, -0.925, side * 0.115], [0.50, -0.965, side * 0.135]
        pen.capsule(seat, hip, knee, 0.068, _TROUSERS)
        pen.capsule(seat, knee, ankle, 0.047, _TROUSERS)
        pen.capsule(seat, [0.31, -0.963, side * 0.115], toe, 0.034, _SHOES)
    # The thorax is 1 m above the ground with its y upwards; the stool grows with who sits on it.
    pen.cylinder(seat, [-0.03, -0.60, 0], [-0.03, -0.56, 0], 0.19, _WOOD)
    pen.cylinder(seat, [-0.03, -0.98, 0], [-0.03, -0.60, 0], 0.025, _SHOES)
    pen.cylinder(seat, [-0.03, -1.0, 0], [-0.03, -0.98, 0], 0.20, _SHOES)
    pen.ellipsoid("skull", [-0.018, 0.200, 0], [0.092, 0.086, 0.074], _SKIN)
    pen.ellipsoid("skull", [0.020, 0.145, 0], [0.054, 0.070, 0.056], _SKIN)
    pen.ellipsoid("skull", [0.038, 0.094, 0], [0.030, 0.022, 0.032], _SKIN)
    pen.ellipsoid("skull", [0.074, 0.148, 0], [0.016, 0.012, 0.012], _SKIN)
    pen.capsule("skull", [0.058, 0.115, -0.015], [0.058, 0.115, 0.015], 0.009, _LIPS)
    for head_side in (-1.0, 1.0):
        pen.ellipsoid("skull", [-0.022, 0.165, head_side * 0.073], [0.016, 0.026, 0.009], _SKIN)
    for bone in tables.bones:
        if bone.body in _COVERED_BODIES:
            continue
        if bone.body.removesuffix("_r").removesuffix("_l") in _HAND_BODIES:
            pen.capsule(bone.body, bone.end1, bone.end2, bone.radius + _HAND_FLESH_M, _SKIN)
        else:
            pen.capsule(bone.body, *_shortened(bone.end1, bone.end2, bone.radius), _BONE)
    draw_devices(spec, devices)
    for row in tables.muscles:
        tendon = spec.tendon(f"{row.name}_tendon")
        # Thickness shows strength: cross-section area grows with peak force.
        tendon.width = float(np.clip(_MUSCLE_WIDTH_M * np.sqrt(row.peak_force / 500), 0.003, 0.009))
        tendon.rgba = _RELAXED
        tendon.group = MUSCLE_GROUP
    add_cameras(spec)


def draw_devices(spec: mujoco.MjSpec, devices: Sequence[str]) -> None:
    """Draws worn devices on the bodies of their names."""
    pen = _Pen(spec)
    if "headset" in devices:
        # In the device frame: x forward, y left, z up; the origin is near the front plate.
        pen.box("headset", [-0.028, 0, 0.0], [0.040, 0.086, 0.044], _DEVICE)
        for y in (-0.086, 0.086):
            pen.capsule("headset", [-0.068, y, -0.030], [-0.068, y, 0.030], 0.010, _DEVICE)
        for y in (-0.066, 0.066):
            for z in (-0.028, 0.028):
                pen.cylinder("headset", [0.010, y, z], [0.014, y, z], 0.007, _LENS)
        angles = np.linspace(-np.pi / 2, np.pi / 2, 9)
        band = [[-0.115 - 0.105 * np.cos(a), 0.082 * np.sin(a), 0.012] for a in angles]
        pen.line("headset", [[-0.06, -0.082, 0.0], *band, [-0.06, 0.082, 0.0]], 0.009, _STRAP)
        arch = np.linspace(0.08 * np.pi, 0.95 * np.pi, 8)
        top = [[-0.125 + 0.088 * np.cos(a), 0.0, 0.012 + 0.082 * np.sin(a)] for a in arch]
        pen.line("headset", top, 0.008, _STRAP)
    for name, side in (("controller_right", 1.0), ("controller_left", -1.0)):
        if name in devices:
            # A handle through the fist, a head with a thumb stick and a tracking ring.
            pen.capsule(
                name, [-0.045, 0.008 * side, -0.066], [0.018, 0.002 * side, -0.030], 0.014, _DEVICE
            )
            pen.ellipsoid(name, [0.020, 0.000, -0.022], [0.020, 0.024, 0.018], _DEVICE)
            pen.capsule(name, [0.022, 0.0, -0.01], [0.024, 0.0, 0.004], 0.006, _LENS)
            controller_angles = np.linspace(0, 2 * np.pi, 15)
            ring = [
                [0.024, side * (-0.006 + 0.048 * np.sin(a)), 0.018 - 0.046 * np.cos(a)]
                for a in controller_angles
            ]
            pen.line(name, ring, 0.0055, _DEVICE)


def colour_muscles(
    model: mujoco.MjModel, muscles: Sequence[str], activations: NDArray[np.floating]
) -> None:
    """Colours the tendons of muscles from skin (relaxed) to red (fully active), in place.

    Args:
        model: a model the caller owns (not the shared `Body.model`).
        muscles: names of M muscles.
        activations: (M,) their activations in [0, 1].

    Raises:
        ValueError: not one activation per muscle.
    """
    level = np.clip(np.asarray(activations, dtype=np.float64), 0.0, 1.0)
    if level.shape != (len(muscles),):
        raise ValueError(f"activations: got shape {level.shape}, expected ({len(muscles)},)")
    ids = np.array([model.actuator(name).id for name in muscles], dtype=np.int64)
    drawn = model.actuator_trntype[ids] == mujoco.mjtTrn.mjTRN_TENDON
    tendons = model.actuator_trnid[ids[drawn], 0]
    model.tendon_rgba[tendons] = _RELAXED + level[drawn, None] * (_ACTIVE - _RELAXED)


class _Pen:
    """Adds massless shapes that touch nothing to named bodies."""

    def __init__(self, spec: mujoco.MjSpec) -> None:
        self._spec = spec

    def capsule(self, body: str, end1: Point, end2: Point, radius: float, colour: Colour) -> None:
        """A rod with round ends between two points."""
        self._add(
            body, mujoco.mjtGeom.mjGEOM_CAPSULE, [radius, 0, 0], colour, fromto=[*end1, *end2]
        )

    def cylinder(self, body: str, end1: Point, end2: Point, radius: float, colour: Colour) -> None:
        """A disc or rod with flat ends between two points."""
        self._add(
            body, mujoco.mjtGeom.mjGEOM_CYLINDER, [radius, 0, 0], colour, fromto=[*end1, *end2]
        )

    def ellipsoid(self, body: str, centre: Point, radii: Point, colour: Colour) -> None:
        """An ellipsoid along the axes of the body."""
        self._add(body, mujoco.mjtGeom.mjGEOM_ELLIPSOID, radii, colour, pos=centre)

    def box(self, body: str, centre: Point, half_sizes: Point, colour: Colour) -> None:
        """A box along the axes of the body."""
        self._add(body, mujoco.mjtGeom.mjGEOM_BOX, half_sizes, colour, pos=centre)

    def loft(self, body: str, name: str, outline: NDArray[np.float64], colour: Colour) -> None:
        """A smooth skin over ellipses stacked along y, one (y, x, half depth, half width) a row."""
        around = np.linspace(0.0, 2.0 * np.pi, 32, endpoint=False)
        y, x, depth, width = (column[:, None] for column in outline.T)
        rings = np.stack(
            [
                x + depth * np.cos(around),
                np.broadcast_to(y, (len(outline), len(around))),
                width * np.sin(around),
            ],
            axis=-1,
        )
        ids = np.arange(rings.shape[0] * rings.shape[1]).reshape(rings.shape[:2])
        here, beside = ids, np.roll(ids, -1, axis=1)
        corners = (here[:-1], beside[:-1], beside[1:], here[1:])
        sides = [
            np.stack([corners[0], *corners[k : k + 2]], axis=-1).reshape(-1, 3) for k in (1, 2)
        ]
        caps = [
            np.stack([np.broadcast_to(ring[0], 30), ring[1:-1], ring[2:]], axis=-1)
            for ring in (ids[0, ::-1], ids[-1])
        ]
        mesh = self._spec.add_mesh(name=name)
        mesh.uservert = rings.ravel()
        mesh.userface = np.concatenate(sides + caps).ravel()
        mesh.smoothnormal = True
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
        self._add(body, mujoco.mjtGeom.mjGEOM_MESH, [0, 0, 0], colour, mesh=name)

    def line(self, body: str, points: Sequence[Point], radius: float, colour: Colour) -> None:
        """Rods through successive points."""
        for end1, end2 in pairwise(points):
            self.capsule(body, end1, end2, radius, colour)

    def _add(
        self,
        body: str,
        shape: mujoco.mjtGeom,
        size: Point,
        colour: Colour,
        pos: Point = (0.0, 0.0, 0.0),
        fromto: Point | None = None,
        mesh: str = "",
    ) -> None:
        geom = self._spec.body(body).add_geom(
            type=shape,
            size=size,
            pos=pos,
            rgba=colour,
            mass=0.0,
            group=BODY_GROUP,
            contype=0,
            conaffinity=0,
            meshname=mesh,
        )
        if fromto is not None:
            geom.fromto = fromto


def draw_room(spec: mujoco.MjSpec) -> None:
    """Adds sky, floor and light, and the settings of pictures."""
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.93, 0.95, 0.98],
        rgb2=[0.62, 0.70, 0.80],
        width=256,
        height=256 * 6,
    )
    spec.add_texture(
        name="floor",
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        rgb1=[0.80, 0.81, 0.83],
        rgb2=[0.74, 0.75, 0.78],
        width=256,
        height=256,
    )
    floor = spec.add_material(name="floor", texrepeat=[2, 2], texuniform=True)
    floor.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "floor"
    spec.worldbody.add_geom(
        name="floor",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        pos=[0, 0, -_FLOOR_BELOW_M],
        size=[4, 4, 0.1],
        material="floor",
        rgba=[1, 1, 1, 1],
        contype=0,
        conaffinity=0,
        group=BODY_GROUP,
    )
    sun = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    spec.worldbody.add_light(
        type=sun, pos=[1.5, -1.0, 3.0], dir=[-0.45, 0.3, -0.85], diffuse=[0.55] * 3, castshadow=True
    )
    spec.worldbody.add_light(
        type=sun, pos=[1.0, 2.0, 2.0], dir=[-0.4, -0.8, -0.4], diffuse=[0.22] * 3, castshadow=False
    )
    picture_settings(spec)
    spec.visual.headlight.ambient = [0.32] * 3
    spec.visual.headlight.diffuse = [0.25] * 3
    spec.visual.headlight.specular = [0.05] * 3


def picture_settings(spec: mujoco.MjSpec) -> None:
    """Sets what pictures of the size of a person need."""
    # Lights and clipping planes scale with these; without them, with the floor's size.
    spec.stat.extent = 1.6
    spec.stat.center = [0.1, 0.0, 0.6]
    # The square that casts shadows, clip times extent to every side of the light's middle. Near its
    # rim a floor casts specks of shadow on itself: the rim lies outside of what is looked at.
    spec.visual.map.shadowclip = 4.5
    spec.visual.quality.shadowsize = 4096
    spec.visual.global_.offwidth = 1280
    spec.visual.global_.offheight = 960
    spec.visual.map.znear = 0.01
    spec.visual.map.zfar = 30.0


def _shortened(end1: Point, end2: Point, radius: float) -> tuple[Point, Point, float]:
    """Pulls the ends in by the radius, so that the round caps end where the bone does."""
    a, b = np.asarray(end1), np.asarray(end2)
    axis = (b - a) / np.linalg.norm(b - a)
    return (a + radius * axis).tolist(), (b - radius * axis).tolist(), radius


CAMERAS = ("front", "side", "arm", "third_person", "play")
"""Names of the cameras that `add_cameras` adds."""


def add_cameras(spec: mujoco.MjSpec) -> None:
    """Adds the cameras of `CAMERAS`, which look at a seated user."""
    views = {
        "front": ([2.35, -0.85, 1.30], [0.12, -0.03, 0.64], 40.0),
        "side": ([0.20, -2.45, 1.00], [0.18, 0.0, 0.68], 40.0),
        "arm": ([0.95, -1.15, 1.15], [0.10, -0.14, 0.88], 40.0),
        # The reference's third-person view is taken from here (User-in-the-Box reference); it is
        # turned up a little, so that an arm above the head stays in the picture.
        "third_person": ([1.2, -0.8, 0.95], [0.05, -0.05, 0.90], 54.0),
        # Over the right shoulder: body, hands and what they reach for.
        "play": ([-1.05, -1.65, 1.65], [0.62, -0.05, 0.92], 46.0),
    }
    for name, (position, target, fovy) in views.items():
        forward = np.subtract(target, position)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        up = np.cross(right, forward)
        axes = np.stack([right, up, -forward], axis=1)  # a camera looks along its -z
        quat = np.empty(4)
        mujoco.mju_mat2Quat(quat, (axes / np.linalg.norm(axes, axis=0)).ravel())
        spec.worldbody.add_camera(name=name, pos=position, quat=quat, fovy=fovy)
