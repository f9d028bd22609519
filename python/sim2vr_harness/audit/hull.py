"""Hull of a user's reach: by joint limits, with the margins of targets, and as an image."""

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import count, product, repeat
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from scipy.sparse import coo_matrix
from scipy.spatial import cKDTree

from sim2vr_harness.audit.targets import Target, alike
from sim2vr_harness.base.errors import InputError, unknown_name
from sim2vr_harness.base.files import naming
from sim2vr_harness.client import AppScene, SceneMesh, SceneObject
from sim2vr_harness.client.frames import position_to_app, position_to_mujoco
from sim2vr_harness.envs.people_preset import with_people
from sim2vr_harness.envs.resolved import ResolvedEnv
from sim2vr_harness.figures.figure import Figure, Layer, Panel
from sim2vr_harness.figures.figure import Path as Path_
from sim2vr_harness.figures.html import Part, drawn, image, save_page, table
from sim2vr_harness.users import Body
from sim2vr_harness.users.kinematics.forward import Linkage, Point
from sim2vr_harness.users.kinematics.inverse import CLOSE_M, solve
from sim2vr_harness.users.rendering import OrbitView, UserRenderer

FloatArray = NDArray[np.float64]

FURTHEST_MARGIN_M = 0.3
"""Largest margin inside that is searched, m."""

_SAMPLES = 6000
_FAR_M = 1000.0
"""Distance of a place that stands for a direction, m: the error is 0.1 mm."""
_STARTS = 4
_MOST_SIDES = 4
"""Of the six sides of a cell."""
_DIRECTIONS = 32
"""Number of directions in which a margin is searched first."""
_ROUNDS = 12
_SHRINK, _SWELL = 0.5, -0.53
"""Taubin's two steps of smoothing, which together keep the volume."""
_PICTURE = (1280, 720)
_MOST_POINTS = 1500
"""Of the surface of the reach, in space."""
_BALL_M = 0.025
_MOST_NAMES = 3
"""Of targets out of reach, in the answer."""
_ROOM_RGBA, _INSIDE_RGBA, _OUTSIDE_RGBA = (
    (0.16, 0.45, 0.85, 0.20),
    (0.10, 0.65, 0.20, 1.0),
    (0.85, 0.10, 0.10, 1.0),
)
_INSIDE, _OUTSIDE, _ROOM, _BONES = "#1a9e3f", "#c9211e", "#2a6fd6", "#444b55"


@dataclass(frozen=True)
class Verdict:
    """Reachability of a place.

    Attributes:
        margin_m: inside: distance by which the place can be moved in any direction and still be
            reached, up to the searched distance; outside: minus the distance to the nearest
            reachable place.
        nearest_m: (3,) the reachable place nearest to it, MuJoCo's world.
        posture: (K,) joint angles that bring the point there.
    """

    margin_m: float
    nearest_m: FloatArray
    posture: FloatArray

    @property
    def inside(self) -> bool:
        """Return whether the place can be reached."""
        return self.margin_m >= 0.0


@dataclass(frozen=True)
class Volume:
    """The cells of a grid whose middles can be reached.

    Attributes:
        cell_m: edge of a cell.
        low_m: (3,) middle of the first cell, MuJoCo's world.
        reached: (X, Y, Z) True if the cell can be reached.
    """

    cell_m: float
    low_m: FloatArray
    reached: NDArray[np.bool_]

    @property
    def litres(self) -> float:
        """Reachable volume, litres."""
        return float(self.reached.sum() * self.cell_m**3 * 1000.0)

    def middles(self, cells: NDArray[np.integer]) -> FloatArray:
        """(N, 3) middles of cells (N, 3)."""
        return self.low_m + cells * self.cell_m

    def surface(self) -> FloatArray:
        """(N, 3) middles of the reached cells with a neighbour that is not."""
        rim = np.pad(self.reached, 1) & (self.beside() < 6)
        return self.middles(np.argwhere(rim) - 1)

    def beside(self) -> NDArray[np.int64]:
        """(X + 2, Y + 2, Z + 2) reached neighbours of each cell and of the cells around."""
        padded = np.pad(self.reached, 1).astype(int)
        sides = product(range(3), (1, -1))
        return np.sum([np.roll(padded, step, axis) for axis, step in sides], axis=0)


@dataclass
class Reach:
    """All positions that a point can reach within the joints' limits.

    Collisions of the body and strength of its muscles are not considered.

    Args:
        linkage: moves the point.
        seed: of the initial random postures.
    """

    linkage: Linkage
    seed: int = 1
    postures: FloatArray = field(init=False)
    """(N, K) angles, drawn from the limits: half of them evenly, half of them near the limits."""
    points: FloatArray = field(init=False)
    """(N, 3) where they bring the point, m."""

    def __post_init__(self) -> None:
        rng = np.random.default_rng(self.seed)
        low, high = self.linkage.limits.T
        shape = (_SAMPLES // 2, len(low))
        shares = np.concatenate([rng.random(shape), rng.beta(0.3, 0.3, shape)])
        self.postures = np.concatenate([self.linkage.rest[None], low + shares * (high - low)])
        self.points = self.linkage.place(self.postures)
        self._tree = cKDTree(self.points)

    def extent(self) -> FloatArray:
        """(2, 3) least and greatest coordinates that can be reached, MuJoCo's world, m."""
        found = np.stack([self.furthest(sign * np.eye(3)) for sign in (-1.0, 1.0)])
        return np.stack([found[0].diagonal(), found[1].diagonal()])

    def furthest(self, directions: FloatArray) -> FloatArray:
        """(D, 3) the places reached furthest in directions (D, 3), m."""
        best = np.argsort(-(directions @ self.points.T), axis=1)[:, :_STARTS]
        starts = self.postures[best].reshape(-1, self.postures.shape[1])
        towards = np.repeat(self.points.mean(axis=0) + directions * _FAR_M, _STARTS, axis=0)
        q, _ = solve(self.linkage, towards, starts, iterations=300, gain_m=1e-9)
        places = self.linkage.place(q).reshape(len(directions), _STARTS, 3)
        along = np.einsum("dsx,dx->ds", places, directions)
        return places[np.arange(len(directions)), along.argmax(axis=1)]

    def nearest(
        self, places: FloatArray, also: FloatArray | None = None, starts: int = _STARTS
    ) -> tuple[FloatArray, FloatArray]:
        """Bring the point as near to places as it gets.

        Args:
            places: (B, 3) m.
            also: (B, S, K) postures to start from before those that were drawn.
            starts: how many of those, the nearest ones.

        Returns:
            Angles (B, K) and distances (B,) m.
        """
        _, near = self._tree.query(places, k=starts)
        first = self.postures[near]
        if also is not None:
            first = np.concatenate([also, first], axis=1)
        b, s, k = first.shape
        q, distance = np.empty((b, k)), np.full(b, np.inf)
        for start in range(s):
            # A point that is there already needs no other start.
            rows = np.flatnonzero(distance > CLOSE_M)
            if not len(rows):
                break
            found, off = solve(self.linkage, places[rows], first[rows, start])
            better = off < distance[rows]
            q[rows[better]], distance[rows[better]] = found[better], off[better]
        return q, distance

    def judge(self, places: FloatArray) -> list[Verdict]:
        """Return the reachability and margins of places (T, 3), MuJoCo's world."""
        q, distance = self.nearest(places)
        nearest = self.linkage.place(q)
        margins = -distance
        inside = np.flatnonzero(distance <= CLOSE_M)
        margins[inside] = self._margins(places[inside], q[inside])
        return [
            Verdict(float(margin), near, posture)
            for margin, near, posture in zip(margins, nearest, q, strict=True)
        ]

    def _margins(self, places: FloatArray, postures: FloatArray) -> FloatArray:
        """Return the radius around each place within which everything can be reached, (T,) m.

        See :attr:`Verdict.margin_m`. A direction that is reachable at a radius is assumed to be
        reachable at every smaller one.
        """
        n = len(places)
        # Directions all around, by Fibonacci's spiral, and last the one that points out where
        # something failed.
        i = np.arange(_DIRECTIONS + 1) + 0.5
        z, turn = 1.0 - 2.0 * i / len(i), np.pi * (1.0 + np.sqrt(5.0)) * i
        ring = np.sqrt(1.0 - z * z)
        around = np.stack([ring * np.cos(turn), ring * np.sin(turn), z], axis=1)
        directions = np.repeat(around[None], n, axis=0)
        failing = np.ones((n, len(i)), dtype=bool)
        good, bad = np.zeros(n), np.full(n, FURTHEST_MARGIN_M)
        radius, open_ = bad.copy(), np.ones(n, dtype=bool)
        while open_.any():
            target, direction = np.nonzero(failing & open_[:, None])
            tested = places[target] + directions[target, direction] * radius[target, None]
            q, distance = self.nearest(tested, postures[target][:, None], starts=2)
            off = np.zeros(failing.shape)
            off[target, direction] = distance
            outwards = np.zeros(directions.shape)
            outwards[target, direction] = tested - self.linkage.place(q)
            fails = off > CLOSE_M
            any_fails = fails.any(axis=1)
            good = np.where(open_ & ~any_fails, radius, good)
            bad = np.where(open_ & any_fails, radius, bad)
            for row in np.flatnonzero(open_ & any_fails):
                worst = off[row].argmax()
                directions[row, -1] = outwards[row, worst] / off[row, worst]
                failing[row] = fails[row]
                failing[row, -1] = True
            open_ &= (bad - good > 1e-3) & (good < FURTHEST_MARGIN_M)
            radius = 0.5 * (good + bad)
        return good

    def fill(self, cell_m: float = 0.05) -> Volume:
        """Find all reachable cells of a grid, starting from the random postures.

        Args:
            cell_m: edge of a cell, m.
        """
        low, high = self.extent()
        first = np.floor(low / cell_m) * cell_m
        shape = tuple((np.ceil((high - first) / cell_m).astype(int) + 1).tolist())
        volume = Volume(cell_m, first, np.zeros(shape, dtype=bool))
        known = np.zeros(shape, dtype=np.int64)  # how often it was tried
        postures: dict[int, FloatArray] = {}
        cells = np.unique(np.rint((self.points - first) / cell_m).astype(int), axis=0)
        own: FloatArray | None = None
        while len(cells):
            known[tuple(cells.T)] += 1
            places = volume.middles(cells)
            start = self.postures[self._tree.query(places)[1]] if own is None else own
            q, distance = solve(self.linkage, places, start, iterations=25, close_m=0.5 * CLOSE_M)
            ok = distance <= CLOSE_M
            reached = cells[ok]
            volume.reached[tuple(reached.T)] = True
            flat = np.ravel_multi_index(tuple(reached.T), shape)
            postures.update(zip(flat.tolist(), q[ok], strict=True))
            # Cells beside those just reached that are worth a try, and the posture to begin it
            # with.
            sides = np.concatenate([np.eye(3, dtype=int), -np.eye(3, dtype=int)])
            beside = (reached[:, None] + sides).reshape(-1, 3)
            source = np.repeat(flat, len(sides))
            within = ((beside >= 0) & (beside < volume.reached.shape)).all(axis=1)
            beside, source = beside[within], source[within]
            worth = ~volume.reached[tuple(beside.T)] & (known[tuple(beside.T)] < 3)
            beside, source = beside[worth], source[worth]
            cells, index = np.unique(beside, axis=0, return_index=True)
            own = np.array([postures[i] for i in source[index].tolist()])
        # Look again at cells that most neighbours of can be reached, from other postures.
        doubtful = np.argwhere(~np.pad(volume.reached, 1) & (volume.beside() >= _MOST_SIDES)) - 1
        if len(doubtful):
            _, distance = self.nearest(volume.middles(doubtful))
            volume.reached[tuple(doubtful[distance <= CLOSE_M].T)] = True
        return volume


def shell(volume: Volume) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return the smoothed faces between reachable cells and others.

    Returns:
        Vertices (V, 3), MuJoCo's world, m, and triangles (T, 3) whose fronts, counter-clockwise,
        are outside.
    """
    padded = np.pad(volume.reached, 1)
    quads = []
    for axis, step in product(range(3), (1, -1)):
        cells = np.argwhere(padded & ~np.roll(padded, -step, axis)) - 1
        one, other = np.eye(3, dtype=int)[[(axis + 1) % 3, (axis + 2) % 3]]
        base = cells + (np.eye(3, dtype=int)[axis] if step > 0 else 0)
        ring = [base, base + one, base + one + other, base + other]
        quads.append(np.stack(ring if step > 0 else ring[::-1], axis=1))
    corners, flat = np.unique(np.concatenate(quads).reshape(-1, 3), axis=0, return_inverse=True)
    faces = flat.reshape(-1, 4)
    vertices = corners.astype(float)
    # Pulls each vertex towards the middle of its neighbours and pushes it back, a few times.
    rows = np.concatenate([faces, np.roll(faces, 1, axis=1)], axis=1).ravel()
    columns = np.concatenate([np.roll(faces, 1, axis=1), faces], axis=1).ravel()
    shape = (len(vertices), len(vertices))
    beside = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=shape).tocsr()
    beside.data[:] = 1.0
    share = 1.0 / np.asarray(beside.sum(axis=1))
    for pull in (_SHRINK, _SWELL) * _ROUNDS:
        vertices = vertices + pull * (beside @ vertices * share - vertices)
    triangles = np.concatenate([faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]])
    return volume.low_m + (vertices - 0.5) * volume.cell_m, triangles


@dataclass(frozen=True)
class Measured:
    """Measured reach of a body.

    Attributes:
        body: the measured body.
        reach: everything that the joints' limits allow.
        extent_m: (2, 3) least and greatest right, up, ahead: the app's frame, m.
        volume: the cells that can be reached.
        targets: the requested places, in the world.
        verdicts: one for each of them.
        people: (N, T) margins of N participants at the targets, m; see :func:`people_margins`.
    """

    body: Body
    point: Point
    reach: Reach
    extent_m: FloatArray
    volume: Volume
    targets: tuple[Target, ...]
    verdicts: tuple[Verdict, ...]
    people: FloatArray


def chosen_point(body: Body, name: str | None) -> Point:
    """Return the point of a body that a name stands for: a device, site or part of its model.

    Without a name it is the first controller that the body wears.

    Raises:
        InputError: The body has no controller, or nothing of that name.
    """
    model = body.physics_model
    parts = [model.site(i).name for i in range(model.nsite)]
    parts += [model.body(i).name for i in range(model.nbody)]
    if name is None:
        worn = [device for device in body.devices if device.startswith("controller")]
        if not worn:
            raise InputError("--point", "none", f"a part of {body.name}, which holds no controller")
        return Point(worn[0])
    if name not in parts:
        raise unknown_name("--point", name, [part for part in parts if part])
    return Point(name)


def measure(
    body: Body,
    point: Point,
    targets: Sequence[Target] = (),
    people: FloatArray | None = None,
    *,
    cell_m: float = 0.05,
) -> Measured:
    """Measure the reach of a point of a body.

    Args:
        targets: Places to judge; those that follow the head are at their place at rest.
        people: As of :class:`Measured`; None: no participants.
        cell_m: Edge of the cells that the room is divided into.

    Raises:
        InputError: No joint moves the point.
    """
    try:
        linkage = Linkage(body, point)
    except ValueError as error:
        raise InputError("--point", repr(point.part), "a part that joints can move") from error
    reach = Reach(linkage)
    extent = position_to_app(reach.extent())
    targets = _in_world(body, targets)
    return Measured(
        body,
        point,
        reach,
        np.stack([extent.min(axis=0), extent.max(axis=0)]),
        reach.fill(cell_m),
        tuple(targets),
        tuple(reach.judge(position_to_mujoco([t.place_m for t in targets]))) if targets else (),
        np.zeros((0, len(targets))) if people is None else people,
    )


def _in_world(body: Body, targets: Sequence[Target]) -> list[Target]:
    """Return targets with their places in the world, those of the head from where it rests."""
    if not any(target.from_head for target in targets):
        return [*targets]
    head_m = position_to_app(_resting(body).site("headset").xpos)
    return [
        replace(each, place_m=head_m + each.place_m, from_head=False) if each.from_head else each
        for each in targets
    ]


def _resting(body: Body) -> mujoco.MjData:
    """Return the body in the posture that episodes start near."""
    data = mujoco.MjData(body.physics_model)
    rest = np.array([body.reset_rule.posture.get(name, 0.0) for name in body.independent_joints])
    data.qpos[:] = body.coupled_qpos(np.clip(rest, *body.joint_ranges.T))
    mujoco.mj_kinematics(body.physics_model, data)
    return data


def people_margins(
    env: ResolvedEnv,
    point: Point,
    places: Sequence[Target],
    people: int,
    look: Callable[[ResolvedEnv, int], Sequence[Target]],
    seed: int = 1,
) -> FloatArray:
    """Measure the margins of participants at places, each with their own body and targets.

    Args:
        env: User and app.
        point: The point that has to reach the places.
        places: Of the average user.
        people: Number of participants; they are those of an evaluation with the same number.
        look: Finds the targets of a participant by its number.
        seed: Of the population.

    Returns:
        (N, T) margin of each participant at each place, see :class:`Verdict`; NaN if the
        participant's rounds did not have the place.

    Raises:
        InputError: ``people`` is not positive.
    """
    average = with_people(alike(env), people, seed)
    population = average.people
    assert population is not None
    margins = np.full((people, len(places)), np.nan)
    for person in range(people):
        body = average.body_for(population.physique(population.number(person)))
        reach = Reach(Linkage(body, point))
        targets = look(average, person)
        found = [next((i for i, p in enumerate(places) if p.same_as(t)), None) for t in targets]
        kept = [(i, t) for i, t in zip(found, targets, strict=True) if i is not None]
        if kept:
            placed = _in_world(body, [target for _, target in kept])
            verdicts = reach.judge(position_to_mujoco([each.place_m for each in placed]))
            for (i, _), verdict in zip(kept, verdicts, strict=True):
                margins[person, i] = verdict.margin_m
    return margins


def margin_words(margin_m: float) -> str:
    """Return a margin for people: ``inside, 3.2 cm to spare``."""
    if margin_m >= FURTHEST_MARGIN_M:
        return f"inside, more than {100 * FURTHEST_MARGIN_M:.0f} cm to spare"
    if margin_m >= 0.0:
        return f"inside, {100 * margin_m:.1f} cm to spare"
    return f"outside by {-100 * margin_m:.1f} cm"


def told(found: Measured) -> list[str]:
    """Return lines on the reach: the answer, volume, extent along the axes, and each target.

    For a target with participants, for example: ``9 of 10 people, at worst outside by 2.5 cm``.
    """
    lines = [_answer(found), f"Within reach: {found.volume.litres:,.0f} litres"]
    for name, low, high in zip(("right", "up", "ahead"), *found.extent_m, strict=True):
        lines.append(f"  {name:5} {low:7.3f} to {high:6.3f} m")
    for target, verdict, margins in zip(found.targets, found.verdicts, found.people.T, strict=True):
        known = margins[~np.isnan(margins)]
        text = f"  {target.name}: {margin_words(verdict.margin_m)}"
        if len(known):
            worst, inside = margin_words(float(known.min())), int((known >= 0.0).sum())
            text += f"; {inside} of {len(known)} participants, at worst {worst}"
        elif len(margins):
            text += "; in no round of participants"
        lines.append(text)
    return lines


def _answer(found: Measured) -> str:
    """Say who can reach how many targets, and by how much the others are out of reach."""
    body, n, point = found.body, len(found.targets), found.point.part
    stature = f"{body.stature_m:.2f} m" if body.stature_m is not None else ""
    traits = ", ".join(filter(None, (stature, body.stance)))
    who = f"{body.name} ({traits})" if traits else body.name
    pairs = zip(found.targets, found.verdicts, strict=True)
    off = [f"{t.name} by {-100 * v.margin_m:.1f} cm" for t, v in pairs if not v.inside]
    if not off:
        what = f"all {n} targets" if n else f"{found.volume.litres:,.0f} litres"
        return f"{who} can reach {what} with {point}."
    named = ", ".join(off[:_MOST_NAMES])
    named += f" and {len(off) - _MOST_NAMES} more" if len(off) > _MOST_NAMES else ""
    return f"{who} cannot reach {len(off)} of {n} targets with {point}; out of reach: {named}."


def write(found: Measured, out: Path) -> list[Path]:
    """Write the measured reach.

    Args:
        out: Folder for ``targets.csv`` (verdicts; right, up, ahead in m, angles in degrees),
            ``hull.csv`` (the cells on the surface of the reachable volume), ``hull.html`` and
            ``hull.png``.
    """
    out.mkdir(parents=True, exist_ok=True)
    joints = found.reach.linkage.joints
    header = ["target", "right_m", "up_m", "ahead_m", "inside", "margin_cm"]
    header += ["nearest_right_m", "nearest_up_m", "nearest_ahead_m", *(f"{j}_deg" for j in joints)]
    rows = []
    for target, verdict in zip(found.targets, found.verdicts, strict=True):
        nearest = position_to_app(verdict.nearest_m).round(4).tolist()
        angles = np.degrees(verdict.posture).round(2).tolist()
        margin = round(100.0 * verdict.margin_m, 2)
        place = target.place_m.round(4).tolist()
        rows.append([target.name, *place, int(verdict.inside), margin, *nearest, *angles])
    surface = position_to_app(found.volume.surface()).round(4).tolist()
    files = []
    for name, titles, values in (
        ("targets.csv", header, rows),
        ("hull.csv", ["right_m", "up_m", "ahead_m"], surface),
    ):
        with naming(out / name), (out / name).open("w", newline="") as stream:
            csv.writer(stream).writerows([titles, *values])
        files.append(out / name)
    picture = write_picture(found, out / "hull.png")
    return [*files, write_page(found, picture, out / "hull.html"), picture]


def write_picture(found: Measured, file: Path) -> Path:
    """Write a PNG file: the body from two sides, its reach, the targets, and a line of text."""
    vertices, triangles = shell(found.volume)
    room = SceneMesh("reach", position_to_app(vertices).astype(np.float32), triangles[:, ::-1])
    colours = [_INSIDE_RGBA if each.inside else _OUTSIDE_RGBA for each in found.verdicts]
    things = ball_scene([each.place_m for each in found.targets], colours, _BALL_M, room)
    views = []
    qpos = np.array(_resting(found.body).qpos)
    x, y, z = found.reach.points.mean(axis=0).tolist()
    with UserRenderer(found.body, _PICTURE[0] // 2, _PICTURE[1]) as renderer:
        middle = np.array(_PICTURE) / (4, 2)
        places = position_to_mujoco(np.reshape([t.place_m for t in found.targets], (-1, 3)))
        away_m = float(np.linalg.norm(places - [x / 2, y / 2, z], axis=1).max(initial=0.0))
        for azimuth in (150.0, 60.0):
            # From as far as shows all targets below the caption.
            for distance_m in np.arange(max(2.8, away_m + 0.5), 3.0 * away_m + 5.0, 0.2).tolist():
                view = OrbitView((x / 2, y / 2, 0.88 * z), distance_m, azimuth, -14.0)
                if (np.abs(renderer.project(places, view) - middle) < middle - (20, 65)).all():
                    break
            views.append(renderer.render(qpos, view, scene=things))
    image = Image.fromarray(np.concatenate(views, axis=1))
    draw = ImageDraw.Draw(image)
    draw.rectangle((0, 0, _PICTURE[0], 40), fill=(24, 26, 30))
    text = _answer(found).partition(";")[0]
    draw.text((14, 20), text, (236, 236, 236), ImageFont.load_default(19), anchor="lm")
    with naming(file):
        image.save(file)
    return file


def ball_scene(
    places: Sequence[FloatArray],
    colours: Sequence[tuple[float, ...]],
    radius_m: float,
    room: SceneMesh | None = None,
) -> AppScene:
    """Return balls at places, right, up, ahead, and a room around them as an app's objects."""
    # Twice-divided triangles of an octahedron.
    corners = np.concatenate([np.eye(3), -np.eye(3)])
    signs = [(0, 1, 2), (1, 3, 2), (3, 4, 2), (4, 0, 2), (1, 0, 5), (3, 1, 5), (4, 3, 5), (0, 4, 5)]
    faces = corners[np.array(signs)]
    for _ in range(2):
        a, b, c = faces[:, 0], faces[:, 1], faces[:, 2]
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        faces = np.concatenate([np.stack(part, axis=1) for part in parts])
    points = faces.reshape(-1, 3)
    points = (points / np.linalg.norm(points, axis=1)[:, None]).astype(np.float32)
    ball = SceneMesh("ball", points, np.arange(len(points)).reshape(-1, 3))

    def placed(mesh: int, place_m: FloatArray, size: float, colour: Sequence[float]) -> SceneObject:
        pose, rgba = np.r_[place_m, 0.0, 0.0, 0.0, 1.0], np.array(colour, np.float32)
        return SceneObject(next(numbers), "audit", 0, mesh, pose, np.full(3, size), rgba, mesh == 0)

    numbers = count(1)
    objects = [placed(0, *each) for each in zip(places, repeat(radius_m), colours)]
    if room is None:
        return AppScene(tuple(objects), (ball,))
    # What is seen through the room has to be drawn before it.
    return AppScene((*objects, placed(1, np.zeros(3), 1.0, _ROOM_RGBA)), (ball, room))


def write_page(found: Measured, picture: Path, file: Path) -> Path:
    """Write the page, with the picture on its first screen.

    Raises:
        InputError: Plotly is not installed.
    """
    low, high = found.extent_m
    words = (
        f"Reach is everywhere that {found.point.part} can be brought within the limits of "
        f"{len(found.reach.linkage.joints)} joints, from {low[0]:.2f} to {high[0]:.2f} m to the "
        f"right, {low[1]:.2f} to {high[1]:.2f} m up and {low[2]:.2f} to {high[2]:.2f} m ahead. "
        "Origin: the floor below the body. Collisions with oneself and strength do not count."
    )
    first: list[Part] = [image(picture.read_bytes(), "The body and its reach")]
    if found.targets:
        rows, pairs = [], zip(found.targets, found.verdicts, strict=True)
        for target, verdict in pairs:
            place = [f"{value:.3f}" for value in target.place_m]
            rows.append([target.name, margin_words(verdict.margin_m), *place])
        bad = [i for i, verdict in enumerate(found.verdicts) if not verdict.inside]
        first.append(
            table(["Target", "Within reach", "Right (m)", "Up (m)", "Ahead (m)"], rows, bad)
        )
    caption = "Turn it with the mouse or a finger; pointing at a target shows its name."
    turned = drawn(Figure("hull", "Reach", caption, [_space(found)]), still=False)
    title = f"What can {found.point.part} of {found.body.name} reach?"
    sections: list[tuple[str, list[Part]]] = [("What limits this answer", [words])]
    sections.append(("Reach in space", [turned]))
    return save_page(file, title, _answer(found), first, sections)[0]


def _space(found: Measured) -> Panel:
    """Return the surface of the reach, the body's bones and the targets in space."""

    def places(name: str, at: FloatArray, colour: str, hover: Sequence[str] | None = None) -> Path_:
        right, up, ahead = np.reshape(at, (-1, 3)).T
        return Path_(name, right, ahead, up, colour, places=True, hover=hover)

    surface = position_to_app(found.volume.surface())
    x, y, z = _bones(found.body)
    layers: list[Layer] = [
        places("within reach", surface[:: 1 + len(surface) // _MOST_POINTS], _ROOM),
        Path_("the body", x, y, z, _BONES),
    ]
    for inside, colour, label in ((True, _INSIDE, "reached"), (False, _OUTSIDE, "not reached")):
        pairs = zip(found.targets, found.verdicts, strict=True)
        chosen = [(target, verdict) for target, verdict in pairs if verdict.inside == inside]
        if chosen:
            at = np.array([target.place_m for target, _ in chosen])
            hover = [f"{t.name}: {margin_words(v.margin_m)}" for t, v in chosen]
            layers.append(places(f"targets {label}", at, colour, hover))
    return Panel("", layers, legend=True)


def _bones(body: Body) -> tuple[list[float | None], ...]:
    """Return lines between the body's parts in the posture that episodes start near."""
    model = body.physics_model
    places = position_to_app(_resting(body).xpos).round(4)[:, [0, 2, 1]].tolist()
    lines: list[list[float | None]] = []
    for part in range(1, model.nbody):
        above = int(model.body_parentid[part])
        if above:
            lines += [places[above], places[part], [None] * 3]
    x, y, z = (list(column) for column in zip(*lines, strict=True))
    return x, y, z
