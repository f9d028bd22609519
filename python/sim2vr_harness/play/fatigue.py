"""Names of measures of fatigue per muscle and per body part."""

from collections.abc import Iterable

from sim2vr_harness.client import Measure

FATIGUE = "fatigue."
"""Prefix of the names of these measures; a muscle or a body part follows."""

MUSCLE_NAMES = {
    "DELT1": "deltoid anterior",
    "DELT2": "deltoid middle",
    "DELT3": "deltoid posterior",
    "SUPSP": "supraspinatus",
    "INFSP": "infraspinatus",
    "SUBSC": "subscapularis",
    "TMIN": "teres minor",
    "TMAJ": "teres major",
    "PECM1": "pectoralis major clavicular",
    "PECM2": "pectoralis major sternal",
    "PECM3": "pectoralis major ribs",
    "LAT1": "latissimus dorsi thoracic",
    "LAT2": "latissimus dorsi lumbar",
    "LAT3": "latissimus dorsi iliac",
    "CORB": "coracobrachialis",
    "TRIlong": "triceps long head",
    "TRIlat": "triceps lateral head",
    "TRImed": "triceps medial head",
    "ANC": "anconeus",
    "SUP": "supinator",
    "BIClong": "biceps long head",
    "BICshort": "biceps short head",
    "BRA": "brachialis",
    "BRD": "brachioradialis",
    "ECRL": "extensor carpi radialis longus",
    "ECRB": "extensor carpi radialis brevis",
    "ECU": "extensor carpi ulnaris",
    "FCR": "flexor carpi radialis",
    "FCU": "flexor carpi ulnaris",
    "PL": "palmaris longus",
    "PT": "pronator teres",
    "PQ": "pronator quadratus",
}
"""Abbreviation in MoBL ARMS -> muscle (Holzbaur et al. 2005, doi 10.1007/s10439-005-3320-7; Saul
et al. 2015 keep the names)."""

PARTS = {
    "elv_angle": "shoulder",
    "shoulder_elv": "shoulder",
    "shoulder_rot": "shoulder",
    "elbow_flexion": "elbow",
    "pro_sup": "forearm",
    "deviation": "wrist",
    "flexion": "wrist",
}
"""Joint of MoBL ARMS -> body part; another joint is a part of its own name."""
SIDES = {"_r": "right", "_l": "left"}


def full_name(name: str) -> str:
    """Return a muscle or part for people: ``ANC_r`` -> ``anconeus, right``; others as they are."""
    stem, side = split_side(name)
    words = MUSCLE_NAMES.get(stem, stem)
    if not side or (stem not in MUSCLE_NAMES and stem not in PARTS.values()):
        return MUSCLE_NAMES.get(name, name)
    return f"{words}, {SIDES[side]}"


def fatigue_measure(name: str) -> Measure:
    """Return the measure of a name that begins with :data:`FATIGUE`."""
    who = full_name(name.removeprefix(FATIGUE))
    return Measure(name, f"Fatigue of {who}", unit="proportion", better="lower", digits=3)


def fatigue_measures(names: Iterable[str]) -> tuple[Measure, ...]:
    """Return the measures of those names that are of fatigue, each once, in their order."""
    return tuple(fatigue_measure(name) for name in dict.fromkeys(names) if name.startswith(FATIGUE))


def split_side(name: str) -> tuple[str, str]:
    """Return a name without its side, and the side: ``_r``, ``_l`` or nothing."""
    return (name[:-2], name[-2:]) if name[-2:] in SIDES else (name, "")
