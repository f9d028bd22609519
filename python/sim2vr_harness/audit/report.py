"""The report of an audit: who is excluded from targets, reasons, and changes that include them."""

import json
import logging
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray
from PIL import Image, ImageColor, ImageDraw, ImageFont

from sim2vr_harness.audit.hull import ball_scene
from sim2vr_harness.audit.judging import GRIP
from sim2vr_harness.audit.pacing import MODELS
from sim2vr_harness.audit.population import FEWEST, MODEL, Subject
from sim2vr_harness.audit.postures import BALANCE
from sim2vr_harness.audit.remedies import GOAL
from sim2vr_harness.audit.summary import CARRIED_OUT, CLAUSES, EVERYONE, Audit, plain
from sim2vr_harness.base.files import naming, write_atomically
from sim2vr_harness.client.frames import position_to_app
from sim2vr_harness.figures.figure import GREY, INK, Figure, Panel
from sim2vr_harness.figures.figure import Path as Places
from sim2vr_harness.figures.html import Part, drawn, image, listed, save_page, table
from sim2vr_harness.figures.matplotlib_backend import write_figure
from sim2vr_harness.play.film import Film
from sim2vr_harness.users import UserBatch, load_body
from sim2vr_harness.users.kinematics.posture_controller import PostureController
from sim2vr_harness.users.rendering import OrbitView, RenderingError, UserRenderer

FloatArray = NDArray[np.float64]

LIMITS = (
    "The trunk leans and turns, but participants do not stand up, step, turn their feet or shift "
    "on a seat. People who do so reach further.",
    "Joint limits are independent of each other, and the arm may pass through trunk, head and "
    "objects: some postures are not possible for people.",
    "Postures are the easiest of those found, held without motion; contacts do not support the "
    "arm. Forces of pressing are not modelled; grip is a rule with assumed friction (*).",
    "Muscles are a man's arm, scaled by body size and strength; raised arms are too weak in this "
    "model, so that activations are for comparison and exclude no one. Age, endurance and skill do "
    "not vary.",
    "Participants with limitations are the sampled ones with narrower joint limits, weaker muscles "
    "or one hand, not patients.",
)
"""Limitations of the model, as a report states them."""

_CLASSES = (
    (GOAL, "95 % or more can use it", "#009e73"),
    (0.8, "80 to 95 %", "#e69f00"),
    (0.5, "50 to 80 %", "#d55e00"),
    (0.0, "fewer than 50 %", "#b3201f"),
)
_SETTLED, _SECONDS = 3, 6.0
"""User steps in a row that a hand that is filmed has to be near, and time at most."""
_IDLE_S, _NEARER = 1.5, 0.01
"""Time and proportion: a reach ends when the distance has decreased by less within this time."""
_DEVICE = "controller_right"
_SIZE = (640, 480)
_RED, _GREY = (0.7, 0.12, 0.1, 1.0), (0.5, 0.55, 0.6, 1.0)
_BALL_M = 0.04
_TRUNK_M = 0.6
"""Below the head, which the film shows too."""
_AWAY_M, _AWAY = 0.6, 1.1
"""Distance of the camera: a constant in m, plus a factor on the size of its view."""
_AZIMUTH_DEG, _ELEVATION_DEG = 115.0, -12.0
_PICTURE, _LEGEND, _PAPER = (1280, 960), 96, "#ffffff"
_BEHIND = (38.0, -14.0)
"""Azimuth and elevation of the picture's view: over the right shoulder, degrees."""
VIEWS = ((-130.0, 18.0), (-60.0, 30.0))
"""Azimuth and elevation of the cameras of web pages and of printed figures, degrees."""
_LETTER = (0.02, 0.05)
"""Width of a letter and height of a line, shares of the scene's extent."""


def write(audit: Audit, out: Path, *, film: bool = True) -> list[Path]:
    """Write ``report.html``, ``report.pdf``, ``audit.json``, ``targets.png`` and ``worst.mp4``.

    The PDF needs a browser. There is no film if bodies cannot be rendered, or if all participants
    reach all targets.

    Args:
        audit: The audit to report.
        out: The folder.
        film: Whether to film the worst case.
    """
    out.mkdir(parents=True, exist_ok=True)
    values = plain(audit)
    file = out / "audit.json"
    text = json.dumps(values, indent=1, ensure_ascii=False, allow_nan=False)
    write_atomically(file, text.encode() + b"\n")
    worst, still = None, out / "targets.png"
    try:
        write_picture(audit, still)
    except RenderingError:  # no OpenGL
        write_figure(Figure("targets", "Targets", _CAPTION, (_space(audit),)), still)
    if film:
        (out / "worst.mp4").unlink(missing_ok=True)
        try:
            worst = write_film(audit, out / "worst.mp4")
        except RuntimeError as error:  # no OpenGL, or no ffmpeg
            logging.getLogger(__name__).info("no film: %s", error)
    title = f"Who can use {audit.title}?"
    first, sections = _first(values, still), _sections(audit, values, worst)
    page, *pdf = save_page(
        out / "report.html", title, headline(values), first, sections, printed=True
    )
    return [page, file, still, *pdf, *([] if worst is None else [worst])]


def headline(values: Mapping[str, Any]) -> str:
    """Return the answer in a sentence."""
    every, targets = values["groups"][0], values["targets"]
    missed = sum(each["remedy"] is not None for each in targets)
    if every["n"] < FEWEST:
        few = f"{every['n']} participants are too few to judge {len(targets)} targets"
        return f"{few}: {FEWEST} are needed."
    who = f"{values['people']} {values['stance']} virtual participants"
    share = every["every_target"]["share"]
    if share == 1.0:
        return f"All {who} can see, reach and hold all {len(targets)} targets."
    everything = f"{100 * share:.0f} % can use every target"
    if not missed:
        return f"At least 95 % of {who} can use each of {len(targets)} targets; {everything}."
    verb = "excludes" if missed == 1 else "exclude"
    return f"{missed} of {len(targets)} targets {verb} more than 5 % of {who}; {everything}."


def too_weak(values: Mapping[str, Any]) -> str:
    """Return a sentence about targets at which the model excludes people, not nature; or none."""
    names = [
        f"{each['name']} ({_percent(each['muscles_suffice'])})"
        for each in values["targets"]
        if each["muscles_suffice"]["share"] is not None and each["muscles_suffice"]["share"] < GOAL
    ]
    if not names:
        return ""
    return (
        "Limit of the model, not of people: the muscles of the arm model suffice for fewer than "
        f"95 % of those who reach {', '.join(names)}."
    )


def unanswered(values: Mapping[str, Any]) -> str:
    """Return a sentence about targets to which the app did not react, or none."""
    tried = [each for each in values["targets"] if each["in_app"]]
    silent = [f"{each['name']} ({each['in_app']})" for each in tried if not each["app_reacts"]]
    if not silent:
        return ""
    return (
        f"The app reacts to {len(tried) - len(silent)} of {len(tried)} targets when they are "
        f"operated. It does not to {', '.join(silent)}."
    )


def _missed(values: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    missed = [each for each in values["targets"] if each["remedy"] is not None]
    return sorted(missed, key=lambda each: (each["usable"]["share"] or 0.0, each["name"]))


def _offers(target: Mapping[str, Any]) -> list[str]:
    fix = target["remedy"]
    offers = []
    if fix["reach_shift"] not in (None, fix["shift"]):
        offers.append(f"move it {fix['reach_shift']} to be seen and reached")
    if fix["shift"] is not None:
        offers.append(f"move it {fix['shift']} so that {100 * fix['share_after']:.0f} % can use it")
    if fix["load_kg"] is not None:
        offers.append(f"make it no heavier than {fix['load_kg']:g} kg")
    if fix["grip_n"] is not None:
        offers.append(f"let it take no more than {fix['grip_n']:g} N of grip")
    if fix["hold_s"] is not None:
        offers.append(f"let it be held no longer than {fix['hold_s']:g} s")
    if fix["one_hand"] is not None:
        offers.append(f"let one hand do it ({100 * fix['one_hand']:.0f} % can)")
    if fix["by_ray"] is not None:
        offers.append(f"let a ray reach it ({100 * fix['by_ray']:.0f} % can)")
    return offers


def _percent(share: Mapping[str, Any]) -> str:
    """Return a proportion with its interval, in per cent."""
    if share["share"] is None:
        return "-"
    low, high = 100.0 * share["low"], 100.0 * share["high"]
    return f"{100.0 * share['share']:.0f} % [{low:.0f}, {high:.0f}]"


def _share(share: Mapping[str, Any]) -> str:
    return "-" if share["share"] is None else f"{100.0 * share['share']:.0f} %"


def answers(values: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Return who is excluded from which target, why, and what would include them."""
    rows: list[tuple[str, ...]] = []
    for target in _missed(values):
        why = next(iter(target["causes"]), "")
        change = ", or ".join(_offers(target)) or _NO_SHIFT
        change = change[:1].upper() + change[1:]
        rows.append((EVERYONE, target["name"], _share(target["usable"]), why, change))
    # Groups that are excluded from more than everyone.
    every = values["groups"][0]["targets"]
    for group in values["groups"][1:]:
        if not group["verified"] or group["n"] < FEWEST:
            continue
        worse = [
            (name, share)
            for name, share in group["targets"].items()
            if share["share"] < GOAL and share["share"] < every[name]["share"] - 0.05
        ]
        for name, share in worse[:_MOST]:
            why = next(iter(group["causes"][name]), "")
            change = "Let one hand do it" if why == "needs two hands" else ""
            rows.append((group["name"], name, _share(share), why, change))
        if len(worse) > _MOST:
            rows.append((group["name"], f"{len(worse) - _MOST} more", "", "", ""))
    return rows


def _first(values: Mapping[str, Any], still: Path) -> list[Part]:
    """Return the picture and the table of the first screen."""
    header, rows = _ANSWER, answers(values)
    if not rows:
        header, columns = ("target", "can use it", "seen", "reached"), ("usable", "seen", "reached")
        hard = sorted(values["targets"], key=lambda each: each["usable"]["share"] or 0.0)
        rows = [(each["name"], *(_share(each[one]) for one in columns)) for each in hard[:_SHOWN]]
    kept = [number for number, _ in enumerate(header) if any(row[number] for row in rows)]
    rows = [tuple(row[number] for number in kept) for row in rows]
    picture = image(still.read_bytes(), "A participant and the targets")
    picture += Markup('<p class="caption">{}</p>').format(_CAPTION)
    return [picture, table([header[number] for number in kept], rows)]


def _sections(
    audit: Audit, values: Mapping[str, Any], worst: Path | None
) -> list[tuple[str, list[Part]]]:
    missing = [text for text in (unanswered(values), too_weak(values)) if text]
    sections: list[tuple[str, list[Part]]] = [
        ("What limits this answer", [listed([*missing, *LIMITS])])
    ]
    reasons = sorted({row[3] for row in answers(values)} & CLAUSES.keys())
    if reasons:
        told = [(reason, CLAUSES[reason]) for reason in reasons]
        sections.append(("Requirements that this concerns", [table(("why not", "see"), told)]))
    figure = drawn(Figure("targets", "Targets", _TURN, (_space(audit),)), still=False)
    sections.append(("Where the targets are", [figure]))
    case = worst_case(audit)
    if worst is not None and case is not None:
        person, column = audit.subjects[case[0]], audit.targets[case[1]].name
        who = f"a {'man' if person.man else 'woman'} of {person.person.stature_m:.2f} m"
        link = Markup('<p>Worst case: {}, by {} (<a href="{}">film</a>).</p>')
        sections[-1][1].append(link.format(column, who, worst.name))
    sections.append(("By target", [_target_table(values)]))
    if rows := [[each["name"], each["in_app"]] for each in values["targets"] if each["in_app"]]:
        sections.append(("Operated in the app", [table(["target", "reaction"], rows)]))
    # Groups by targets, some targets a table, so that it fits a page.
    sections.append(("By group", [_GROUPS]))
    names = [each["name"] for each in values["targets"]]
    for begin in range(0, len(names), _ABREAST):
        chosen, first = names[begin : begin + _ABREAST], begin == 0
        shares = []
        for group in values["groups"]:
            own = [group["every_target"]] if first else []
            own += [group["targets"][name] for name in chosen]
            mark = "" if group["verified"] else " *"
            shares.append((group["name"] + mark, str(group["n"]), *map(_percent, own)))
        header = ("group", "participants", *(["every target"] if first else []), *chosen)
        sections[-1][1].append(table(header, shares))
    sections.append(("Exertion by target", [_exertion_table(values), _EXERTION]))
    necks = [
        (
            each["name"],
            *(f"{each['gaze'][key][1]:.0f}" for key in ("rotation_deg", "elevation_deg")),
            f"{each['gaze']['share_of_neck_strength'][1]:.2f}",
            _percent(each["gaze"]["easy_elevation"]),
        )
        for each in values["targets"]
    ]
    sections.append(("Neck and eyes", [table(_NECK_HEADER, necks), _NECK]))
    if values["script"]:
        header = (
            *("condition", "participants", "did it", "s per step", "proportion beside"),
            *("steps not done", "why"),
        )
        done = [
            (
                each["condition"],
                str(each["n"]),
                str(each["done"]),
                *("-" if each[key] is None else f"{each[key]:.2f}" for key in CARRIED_OUT),
                ", ".join(f"{why} ({n})" for why, n in each["excluded"].items()) or "-",
            )
            for each in values["carried_out"]
        ]
        sections.append((f"Carried out: {values['script']}", [table(header, done), _SCRIPT]))
    if values["paths"]:
        paths = [
            (f"{path['start']} to {path['end']}", f"{path['mean']:.2f}", f"{path['peak']:.2f}")
            for path in values["paths"]
        ]
        path_table = table(("path", "mean", "peak"), paths)
        sections.append(("Exertion between targets", [path_table, _PATHS]))
    sources = [
        (EVERYONE, "stature, segments, strength, handedness: docs/concepts/people.md", "yes"),
        ("field of view, neck", "90 degrees; Apti, Colak and Akcay 2023", "yes"),
        ("grip", GRIP.source, "no"),
        ("height of targets", "Penumudi et al. 2020, abstract", "yes"),
        ("neck strength", "Fice et al. 2014", "no"),
    ]
    sources += [
        (group["name"], group["source"], "yes" if group["verified"] else "no")
        for group in values["groups"]
        if group["source"] != "sampled"
    ]
    return [*sections, ("Sources", [table(("group", "source", "verified"), sources)])]


_NECK_HEADER = (
    "target",
    "degrees to the right",
    "degrees up",
    "of neck strength",
    "0 to 15 degrees below the eyes",
)
_NECK = (
    "Medians, seen from the eyes at rest. The neck turns to the target within its limits; beyond "
    "them the eyes do. Targets 15 degrees above or 30 degrees below the eyes loaded people's necks "
    "most; recommended are 0 to 15 degrees below (Penumudi et al. 2020, 20 people). Of neck "
    "strength: the torque of the weight of head and headset in flexion (Fice et al. 2014)."
)
_NO_SHIFT = "No shift of up to 1.5 m"
_ANSWER: tuple[str, ...] = (
    "who",
    "target",
    "can use it",
    "why not",
    "smallest change that includes 95 %",
)
_SCRIPT = (
    "Virtual participants carry out the script in the app by their muscles, with their own "
    "delays and noise. Values are means of those who did a step."
)
_PATHS = (
    "Torque at the shoulder of the participant of median stature who moves from one target to the "
    "next in 0.5 s, as a share of published strength (*)."
)


_CAPTION = (
    "A participant of median stature among the targets; colours say how many can use a target."
)
_TURN = (
    "The same in space: turn it with the mouse or a finger. Lines: eyes, shoulders, and the way "
    "down to the floor."
)
_GROUPS = (
    "Share who can use a target, with Wilson's 95 % interval. Groups of fewer than "
    f"{FEWEST} participants are not judged. Groups with a source that was not read are marked * "
    "and are not in the answer above."
)
_EXERTION = (
    "Median (5 % to 95 %) of the participants who reach the target. Activation: least largest "
    "activation of the shoulder's muscles that holds the posture; above 1 they are too weak. "
    "Minutes: until exhaustion, held without a break, or at the app's pace with the arm down "
    "between; endless: more than 30 at that pace. "
    "NICER's published strength (*) decides who "
    "holds a target; it was not verified. The trunk's strength (*) was read second-hand."
)


_MOST = 4
"""Targets that the answer names for a group."""
_SHOWN = 10
"""Targets on the first screen, the hardest first."""
_ABREAST = 5
"""Number of targets in a row."""


def _target_table(values: Mapping[str, Any]) -> Markup:
    header = ["target", "how", "can use *", "seen", "reached", "held *", "must lean"]
    header += ["model's muscles suffice", "excluded by"]
    rows, bad = [], []
    for number, each in enumerate(values["targets"]):
        why = ", ".join(f"{cause} {count}" for cause, count in each["causes"].items())
        how = each["how"] + (", both hands" if each["hand"] == "both" else "")
        columns = ("usable", "seen", "reached", "held", "leans", "muscles_suffice")
        parts = [_percent(each[part]) for part in columns]
        rows.append([each["name"], how, *parts, why])
        if each["remedy"] is not None:
            bad.append(number)
    return table(header, rows, bad)


def _exertion_table(values: Mapping[str, Any]) -> Markup:
    pace = f"{values['pace_per_minute']:g} a minute"
    gripped = any(each["grip_n"] or each["load_kg"] for each in values["targets"])
    keys = {
        "activation": "share_of_activation",
        "of published strength *": "share_of_published_strength",
        "of trunk strength *": "share_of_trunk_strength",
        **({"of grip strength *": "share_of_grip_strength"} if gripped else {}),
        **{f"minutes held, {model}": f"minutes, {model}" for model in MODELS},
        **{f"minutes at {pace}, {model}": f"minutes at pace, {model}" for model in MODELS},
    }
    rows = [
        [each["name"], *(_spread(each, key) for key in keys.values())]
        for each in values["targets"]
        if each["how"] != "look"
    ]
    return table(["target", *keys], rows)


def _spread(target: Mapping[str, Any], key: str) -> str:
    quantiles = target["exertion"].get(key)
    if not target["exertion"]["n"] or quantiles is None:
        return "not reached"
    missing = "endless" if key.startswith("minutes") else "too weak"
    low, middle, high = (
        missing if x is None or (x > 1.0 and missing == "too weak") else f"{x:.2f}"
        for x in quantiles
    )
    return middle if low == middle == high else f"{middle} ({low} to {high})"


def _space(audit: Audit) -> Panel:
    """Return the targets, the eyes and the shoulders of the participant of median stature."""
    usable = audit.judged.usable.mean(axis=0)
    places = audit.judged.places_m[audit.middle]
    landmarks = audit.crowd.landmarks(audit.middle)
    eyes, right, left = landmarks
    neck = (right + left) / 2.0
    figure = np.array([eyes, neck, right, left, neck, neck * [1.0, 0.0, 1.0]])

    def layer(name: str, at: FloatArray, colour: str, **more: Any) -> Places:
        right, up, ahead = at.T
        return Places(name, right, ahead, up, colour, **{"places": True} | more)

    layers = [
        layer("a participant, down to the floor", figure, GREY, places=False),
        layer("eyes and shoulders", landmarks, GREY),
    ]
    names = np.array([each.name for each in audit.targets])
    extent = max(float(np.ptp(np.concatenate([places, figure]), axis=0).max()), 1e-9)
    views = [screen(places, *view) / extent for view in VIEWS]
    labels = np.array(labels_of(names.tolist(), views, _LETTER))
    for number, (least, name, colour) in enumerate(_CLASSES):
        most = np.inf if number == 0 else _CLASSES[number - 1][0]
        chosen = (usable >= least) & (usable < most)
        if chosen.any():
            told = {"text": labels[chosen].tolist(), "hover": names[chosen].tolist()}
            layers.append(layer(name, places[chosen], colour, **told))
    return Panel("", tuple(layers), legend=True, square=True, wide=True)


def worst_case(audit: Audit) -> tuple[int, int] | None:
    """Return the participant who misses the target that fewest reach by most, and that target.

    None: all participants reach all targets that need a hand.
    """
    judged = audit.judged
    hands = np.array([each.how not in ("look", "point") for each in audit.targets])
    missed = np.where(hands, (~judged.reached).mean(axis=0), 0.0)
    target = int(missed.argmax())
    if missed[target] == 0.0:
        return None
    gaps = np.linalg.norm(judged.needed_m[:, target], axis=1) * ~judged.reached[:, target]
    return int(gaps.argmax()), target


def act_out(
    subject: Subject,
    place: FloatArray,
    watch: Callable[[FloatArray, FloatArray], None] = lambda qpos, activations: None,
    posture: FloatArray | None = None,
) -> tuple[bool, float]:
    """Bring the right hand from rest to a place; return if it stays there, and its least gap, m.

    Args:
        subject: The participant.
        place: (3,) in the body's own frame, m.
        watch: Receives posture (nq,) and activations (M,) after each user step.
        posture: (J,) of the independent joints, to try; None: one is searched.
    """
    users = UserBatch(subject.body, 1, threads=1)
    controller = PostureController(subject.body, _DEVICE)
    users.reset([0], [np.random.default_rng(1)])
    controller.begin()
    if posture is None:
        posture = controller.find(controller.angles(users.qpos[0]), place=place).angles
    settled, nearer, idle = 0, 0, round(_IDLE_S / users.dt)
    gaps: list[float] = []
    for step in range(round(_SECONDS / users.dt)):
        gaps.append(float(np.linalg.norm(place - users.device_poses(_DEVICE)[0][0])))
        settled = settled + 1 if gaps[-1] <= BALANCE.near_m else 0
        if step < idle or gaps[-1] < (1.0 - _NEARER) * gaps[step - idle]:
            nearer = step
        if settled == _SETTLED or step - nearer >= idle:
            break
        action = controller.towards(users.qpos[0], users.qvel[0], users.act[0], posture)
        users.step(action[None])
        watch(users.qpos[0], users.act[0])
    return settled == _SETTLED, min(gaps)


def write_film(audit: Audit, file: Path) -> Path | None:
    """Write a film of the worst case's reach; None: there is no worst case.

    Raises:
        RenderingError: No renderer is available.
        RuntimeError: ffmpeg cannot be started.
    """
    found = worst_case(audit)
    if found is None:
        return None
    person, column = found
    subject = audit.subjects[person]
    places = audit.in_body(person)
    # From the right and a little ahead: head, trunk and target are in the picture.
    head = audit.in_body(person, audit.crowd.heads[[person]])[0]
    shown = np.stack([head, head - [0.0, 0.0, _TRUNK_M], places[column]])
    (low, high), colours = (shown.min(axis=0), shown.max(axis=0)), [_GREY] * len(places)
    x, y, z = ((low + high) / 2.0).tolist()
    distance = _AWAY_M + _AWAY * float(np.linalg.norm(high - low))
    view = OrbitView((x, y, z), distance, _AZIMUTH_DEG, _ELEVATION_DEG)
    colours[column] = _RED
    scene = ball_scene(list(position_to_app(places)), colours, _BALL_M)
    frames: list[tuple[FloatArray, FloatArray]] = []
    act_out(subject, places[column], lambda qpos, act: frames.append((qpos, act)))
    body = load_body(MODEL, person=subject.user.person, torso=True, appearance=True)
    film = Film(file, *_SIZE, fps=20.0)
    try:
        with UserRenderer(body, *_SIZE) as renderer:
            for qpos, act in frames:
                film.add(renderer.render(qpos, view, act, scene))
        return film.finish()
    except BaseException:
        film.discard()
        raise


def write_picture(audit: Audit, file: Path) -> None:
    """Write a picture of the participant of median stature among the targets.

    The participant holds the target that most people can use. Colours and percentages show the
    proportion of people who can use a target.

    Raises:
        RenderingError: No renderer is available.
    """
    person = audit.subjects[audit.middle]
    # The drawn participant is right-handed, so targets of a left-handed one are mirrored, too.
    places = audit.in_body(audit.middle)
    usable = audit.judged.usable.mean(axis=0)
    classes = [
        next(k for k, (least, *_) in enumerate(_CLASSES) if part >= least) for part in usable
    ]
    colours = [(*(c / 255.0 for c in ImageColor.getrgb(_CLASSES[k][2])), 1.0) for k in classes]
    body = load_body(MODEL, person=person.user.person, torso=True, appearance=True)
    reached = np.isfinite(audit.judged.postures[audit.middle]).all(axis=1)
    posture = np.zeros(len(body.independent_joints))
    if reached.any():
        easiest = int(np.where(reached, usable, -1.0).argmax())
        posture = audit.judged.postures[audit.middle, easiest]
    head = audit.in_body(audit.middle, audit.crowd.heads[[audit.middle]])[0]
    shown = np.stack([head, head * [1.0, 1.0, 0.0], *places])
    low, high = shown.min(axis=0), shown.max(axis=0)
    extent_m = float(np.linalg.norm(high - low))
    x, y, z = ((low + high) / 2.0).tolist()
    view = OrbitView((x, y, z), _AWAY_M + _AWAY * extent_m, *_BEHIND)
    scene = ball_scene(list(position_to_app(places)), colours, max(_BALL_M, 0.015 * extent_m))
    with UserRenderer(body, *_PICTURE) as renderer:
        pixels = renderer.render(body.coupled_qpos(posture), view, None, scene)
        at = renderer.project(places, view)
    image = Image.fromarray(pixels)
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(36)
    order = np.argsort(usable, kind="stable")  # where labels share a place, the worst is named
    names = [audit.targets[i].name for i in order]
    if len(audit.subjects) >= FEWEST:
        names = [f"{n}: {100.0 * usable[i]:.0f} %" for n, i in zip(names, order, strict=True)]
    at, side = at[order], np.where(at[order, 0] < _PICTURE[0] / 2, 1.0, -1.0)
    middles = at + [[s * (20 + font.getlength(n) / 2), 0] for s, n in zip(side, names, strict=True)]
    for text, (x, y) in zip(labels_of(names, [middles], (18.0, 48.0)), at, strict=True):
        aside = 20 if x < _PICTURE[0] / 2 else -20
        box = draw.textbbox((x + aside, y), text, font, "lm" if aside > 0 else "rm")
        if text:
            draw.rectangle((box[0] - 4, box[1] - 3, box[2] + 4, box[3] + 3), _PAPER)
            draw.text((x + aside, y), text, INK, font, "lm" if aside > 0 else "rm")
    draw.rectangle((0, _PICTURE[1] - _LEGEND, *_PICTURE), _PAPER)
    for k, number in enumerate(sorted(set(classes))):
        x, y = 24 + k % 2 * _PICTURE[0] / 2, _PICTURE[1] - _LEGEND * (0.75 - 0.5 * (k // 2))
        draw.ellipse((x - 10, y - 10, x + 10, y + 10), _CLASSES[number][2])
        draw.text((x + 20, y), _CLASSES[number][1], INK, font, "lm")
    with naming(file):
        image.save(file)


def screen(places: FloatArray, azimuth_deg: float, elevation_deg: float) -> FloatArray:
    """(N, 2) places right, up, ahead as a far camera sees them: to the right, up."""
    a, e = np.radians([azimuth_deg, elevation_deg])
    x, z, y = np.reshape(places, (-1, 3)).T  # figures have right, forward, up
    aside = -np.sin(a) * x + np.cos(a) * y
    upward = -np.sin(e) * (np.cos(a) * x + np.sin(a) * y) + np.cos(e) * z
    return np.stack([aside, upward], axis=1)


def labels_of(
    names: Sequence[str], views: Sequence[FloatArray], letter: tuple[float, float]
) -> list[str]:
    """Return a label for each name, empty if another one's label includes it.

    Names whose labels would overlap share one: "key 1 and 8 more".

    Args:
        names: N of them.
        views: (N, 2) where labels are in each view: to the right, and up or down.
        letter: Width of a letter and height of a line.
    """
    groups = [[i] for i in range(len(names))]

    def text(group: Sequence[int]) -> str:
        return names[group[0]] + (f" and {len(group) - 1} more" if len(group) > 1 else "")

    def overlap(first: Sequence[int], second: Sequence[int]) -> bool:
        width = letter[0] * (len(text(first)) + len(text(second))) / 2.0
        gaps = (np.abs(view[first[0]] - view[second[0]]) for view in views)
        return any(gap[0] < width and gap[1] < letter[1] for gap in gaps)

    merged = True
    while merged:
        merged = False
        for i in range(len(groups)):
            for j in range(len(groups) - 1, i, -1):
                if overlap(groups[i], groups[j]):
                    groups[i] += groups.pop(j)
                    merged = True
    found = [""] * len(names)
    for group in groups:
        found[group[0]] = text(group)
    return found
