"""Bodies: what they are (`body.py`), where they come from (tables, MJCF), who has them (people).

A new body is a YAML file about an MJCF file, a folder of tables, or a `Body` with a function of
one's own that builds its specification; see docs/reference/bodies.md.
"""

from sim2vr_harness.users.bodies.body import (
    DEVICES,
    ActuatorGroup,
    Body,
    BodyPlan,
    Coupling,
    EffortInputs,
    ResetRule,
    held,
)
from sim2vr_harness.users.bodies.options import Physique, ResetOptions
from sim2vr_harness.users.bodies.packages import allow_package, origin_of
from sim2vr_harness.users.bodies.registry import (
    foreign_package,
    installed_bodies,
    is_file,
    list_bodies,
    load_body,
)

__all__ = [
    "DEVICES",
    "ActuatorGroup",
    "Body",
    "BodyPlan",
    "Coupling",
    "EffortInputs",
    "Physique",
    "ResetOptions",
    "ResetRule",
    "allow_package",
    "foreign_package",
    "held",
    "installed_bodies",
    "is_file",
    "list_bodies",
    "load_body",
    "origin_of",
]
